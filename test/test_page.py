"""The page of a running graph, from a browser's end of the line: what is clicked has its effect on the graph."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Any

import pytest
from page_client import PageClient

from jammkle_common.names import ACHILLES, CARRIAGE_JOINT, CLOCK, JAM_STATE, JOINT_STATES, PERONEAL_LEFT
from jammkle_msgs.msg import ChannelJamState
from jammkle_view.core.models import Knob
from jammkle_view.core.samples import Action, Ask, Channel, ChannelState, Jam, SetSim, Unjam
from jammkle_view.page.live import AnkleControls, SimControls
from jammkle_view.page.server import address_of, serve

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from graph import Probe, Up
    from jammkle_view.core.samples import Request

RAISED_M = 0.1
"""150 mm less the 50 mm from which the ankle falls by default."""
STEEP_DEG = 12.0
PATIENT = """
/**/sim: {ros__parameters: {release_time_s: 3600.0}}
/**/controller: {ros__parameters: {auto_at_start: false}}
/**/driver: {ros__parameters: {pressure_timeout_s: 30.0, jam_timeout_s: 30.0}}
"""


@pytest.mark.timeout(300)
def test_what_is_clicked_has_its_effect(
    start: Callable[..., Up], make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    """Jam, Unjam, Pause, Go on, Reset, a slider: services and parameters of the graph, as the probe sees."""
    (tmp_path / "patient.yaml").write_text(PATIENT)
    up = start("up", "--view", "--params", str(tmp_path / "patient.yaml"))
    probe = make_probe()
    probe.listen(JAM_STATE, JOINT_STATES, CLOCK)
    with PageClient(page_of(up, probe)) as page:

        def until(holds: Callable[[], bool], what: str) -> None:
            page.wait_until(holds, what, lambda: probe.executor.spin_once(timeout_sec=0.0))

        until(lambda: "drop height [mm]" in page.labels(), "the page knows what is simulated")
        until(lambda: probe.has(JOINT_STATES), "joint_states are received")
        held_m = joint(probe, CARRIAGE_JOINT)
        until(lambda: near(page.positions_m["/ankle/carriage"][2], held_m), "the scene shows where it is held")

        page.change("achilles", "Jam")
        until(lambda: state_of(probe, ACHILLES) == ChannelJamState.JAMMED, "the driver has jammed the channel")
        assert state_of(probe, PERONEAL_LEFT) == ChannelJamState.UNJAMMED
        until(lambda: "JAMMED" in page.text().replace("UNJAMMED", ""), "the page says so")
        page.change("achilles", "Unjam")
        until(lambda: state_of(probe, ACHILLES) == ChannelJamState.UNJAMMED, "the driver has let it go")

        page.change("time", "Pause")
        until(lambda: "paused" in page.text(), "the simulation has answered")
        until(lambda: ticks(probe) == 0, "time stands still")
        stopped_ns = clock_ns(probe)
        page.change("time", "Go on")
        until(lambda: clock_ns(probe) > stopped_ns, "time goes on")

        page.change("drop height [mm]", 150.0)
        until(lambda: "drop_height_m is 0.15" in page.text(), "the simulation has taken the height")
        page.change("time", "Reset")
        until(lambda: near(joint(probe, CARRIAGE_JOINT), held_m + RAISED_M), "the carriage is held higher")
        until(lambda: near(page.positions_m["/ankle/carriage"][2], held_m + RAISED_M), "the scene shows it there")

        shown = [field["visible"] for field in page.fields.values() if field.get("type") == "GuiUplotMessage"]
        page.change("IMU", "Angular rate [rad/s]")
        until(lambda: plots(page) != shown, "another plot is shown")
        assert sum(plots(page)) == sum(shown)
    assert up.stop() == 0


@pytest.mark.timeout(300)
def test_a_leg_is_put_on_a_slope(start: Callable[..., Up], make_probe: Callable[..., Probe]) -> None:
    """From the next reset on it stands on ground that is inclined: a flat foot turns by as much."""
    flat = ("-p", "sim:hang_pitch_deg:=0.0", "-p", "controller:hang_pitch_deg:=0.0")
    up = start("up", "--view", "--robot", "leg", *flat)
    probe = make_probe()
    probe.listen(JOINT_STATES)
    with PageClient(page_of(up, probe)) as page:

        def until(holds: Callable[[], bool], what: str) -> None:
            page.wait_until(holds, what, lambda: probe.executor.spin_once(timeout_sec=0.0))

        until(lambda: "slope [deg]" in page.labels(), "the page knows what is simulated")
        until(lambda: probe.has(JOINT_STATES), "joint_states are received")
        flat_rad = joint(probe, "ankle_pitch")
        page.change("slope [deg]", STEEP_DEG)
        until(lambda: "slope_deg is 12" in page.text(), "the simulation has taken the slope")
        page.change("time", "Reset")
        turned_rad = 0.5 * math.radians(STEEP_DEG)
        until(lambda: abs(joint(probe, "ankle_pitch") - flat_rad) > turned_rad, "the foot lies on the slope")
    assert up.stop() == 0


def test_every_simulation_is_asked() -> None:
    """Two ankles in simulations of their own are paused by one click, and get the same slope."""
    requests: list[Request] = []
    server = serve("localhost", 0, "two ankles")
    try:
        controls = SimControls(server.gui, requests.append)
        with PageClient(address_of(server)) as page:
            controls.offer(("left", "right"), (Knob("slope_deg", "slope [deg]", 0.0, 40.0, 1.0, 0.0),))
            page.wait_until(lambda: "slope [deg]" in page.labels(), "it can be asked")
            page.change("time", "Pause")
            page.change("slope [deg]", 7.0)
            asked = {*(Ask(who, Action.PAUSE) for who in ("left", "right"))}
            asked |= {SetSim(who, "slope_deg", 7.0) for who in ("left", "right")}
            page.wait_until(lambda: asked <= set(requests), "both are asked")
            controls.show("slope_deg", 3.0)
            page.wait_until(lambda: page.value("slope [deg]") == 3.0, "it shows what a simulation has")
    finally:
        server.stop()


def test_controls_agree_with_what_is_held() -> None:
    """The slider goes to what the controller holds, stays where it is moved, and a jam that undoes an unjam is said."""

    def channels(state: ChannelState, vacuum_pa: float = 0.0) -> dict[str, Channel]:
        return {ACHILLES: Channel(state, vacuum_pa, vacuum_pa, "asked by jam_command")}

    requests: list[Request] = []
    server = serve("localhost", 0, "an ankle")
    try:
        controls = AnkleControls(server.gui, "", requests.append)
        with PageClient(address_of(server)) as page:
            assert controls.show(channels(ChannelState.JAMMED, 4e4)) == ""
            page.wait_until(lambda: "vacuum [kPa]" in page.labels(), "the page is there")
            page.wait_until(lambda: page.value("vacuum [kPa]") == 40.0, "the slider is where the controller is")
            page.change("achilles", "Jam")
            page.wait_until(lambda: Jam("", (ACHILLES,), 4e4) in requests, "what is held is asked for")
            page.change("vacuum [kPa]", 60.0)
            page.wait_until(lambda: controls._vacuum_kpa.value == 60.0, "the slider was moved")
            controls.show(channels(ChannelState.JAMMED, 4e4))
            page.change("achilles", "Jam")
            page.wait_until(lambda: Jam("", (ACHILLES,), 6e4) in requests, "what was chosen is asked for")
            page.change("peroneal left", "Jam")
            page.wait_until(lambda: Jam("", (PERONEAL_LEFT,), 4e4) in requests, "with another jammed, its vacuum")
            page.wait_until(lambda: page.value("vacuum [kPa]") == 40.0, "and the slider says so")
            page.change("vacuum [kPa]", 60.0)
            page.wait_until(lambda: controls._vacuum_kpa.value == 60.0, "the slider was moved again")
            page.change("all channels", "Jam")
            page.wait_until(lambda: Jam("", (), 6e4) in requests, "all channels may change at once")

            page.change("achilles", "Unjam")
            page.wait_until(lambda: Unjam("", (ACHILLES,)) in requests, "it is to be unjammed")
            assert controls.show(channels(ChannelState.JAMMED, 4e4)) == ""  # it has not been yet
            assert controls.show(channels(ChannelState.VENTING)) == ""
            said = controls.show(channels(ChannelState.JAMMING, 4e4))
            assert "achilles: asked by jam_command" in said
            assert "Page alone" in said
            assert controls.show(channels(ChannelState.JAMMED, 4e4)) == ""  # once is enough
    finally:
        server.stop()


def page_of(up: Up, probe: Probe) -> str:
    """Address of the page, once it and the graph are there."""
    probe.spin_until(lambda: "jammkle: up\n" in up.text(), "the graph is up")
    probe.spin_until(lambda: "page: " in up.text(), "there is a page")
    return re.findall(r"page: (http://localhost:\d+)", up.text())[0]


def joint(probe: Probe, name: str) -> float:
    message = probe.last(JOINT_STATES)
    return float(dict(zip(message.name, message.position, strict=True))[name])


def clock_ns(probe: Probe) -> int:
    stamp: Any = probe.last(CLOCK).clock
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def ticks(probe: Probe) -> int:
    """How often /clock is received in some 0.4 s."""
    before = len(probe.received[CLOCK.name])
    for _ in range(20):
        probe.executor.spin_once(timeout_sec=0.02)
    return len(probe.received[CLOCK.name]) - before


def state_of(probe: Probe, channel: str) -> int:
    return probe.channel_states().get(channel, ChannelJamState.UNKNOWN)


def plots(page: PageClient) -> list[bool]:
    return [bool(field["visible"]) for field in page.fields.values() if field.get("type") == "GuiUplotMessage"]


def near(one_m: float, other_m: float) -> bool:
    return abs(one_m - other_m) < 1e-3
