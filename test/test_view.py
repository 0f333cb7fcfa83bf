"""`jammkle up --view` in a browser: it loads, the scene moves, a click jams a channel and the driver says so."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest

from browser import NO_CHROMIUM, Browser, chromium, wait_until
from jammkle_common.names import ACHILLES, CARRIAGE_JOINT, JAM_STATE, JOINT_STATES, PERONEAL_LEFT
from jammkle_msgs.msg import ChannelJamState

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from graph import Probe, Up

CARRIAGE_M = "window.__viserMutable?.nodeRefFromName['/ankle/carriage']?.position.z"
"""Height of the carriage in the scene; viser keeps its nodes there for tests like this one."""
RAISED_M = 0.1
PATIENT = """
/**/sim: {ros__parameters: {release_time_s: 3600.0, speed: 0.75}}
/**/controller: {ros__parameters: {auto_at_start: false}}
/**/driver: {ros__parameters: {pressure_timeout_s: 30.0, jam_timeout_s: 30.0}}
/**/viewer: {ros__parameters: {frame_rate_hz: 5.0}}
"""
"""The ankle hangs and is left alone; nobody minds a machine that is busy with a browser."""
SMALL = (900, 700)
"""Leaves little room between the panels: without a graphics card every pixel of the scene costs."""


@pytest.mark.skipif(chromium() is None, reason=NO_CHROMIUM)
@pytest.mark.timeout(300)
def test_the_page_shows_the_robot_and_hands_on_what_is_clicked(
    start: Callable[..., Up], make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    """Everything goes by the graph's own services, topics and parameters: the probe sees what they did."""
    (tmp_path / "patient.yaml").write_text(PATIENT)
    up = start("up", "--view", "--params", str(tmp_path / "patient.yaml"))
    probe = make_probe()
    probe.listen(JAM_STATE, JOINT_STATES)
    probe.wait_until_up()
    address = wait_until(lambda: re.findall(r"page: (http://localhost:\d+)", up.text()), "there is a page", up.text)[0]
    with Browser(tmp_path / "browser", SMALL) as browser:
        browser.open(address)
        browser.wait_for_text("real-time factor")
        browser.wait_for_text("UNJAMMED")
        wait_until(lambda: browser.field("speed") == "0.75", "the slider is where the simulation's speed is")
        held_m = carriage_m(probe)
        wait_until(lambda: near(browser.value(CARRIAGE_M), held_m), "the scene shows where the carriage is held")

        browser.click("Jam", beside="achilles")
        probe.spin_until(lambda: has_jammed(probe, ACHILLES), "the driver says that it has jammed the channel")
        assert not has_jammed(probe, PERONEAL_LEFT)

        browser.type_into("drop height [mm]", "150")
        browser.wait_for_text("drop_height_m is 0.15")
        browser.click("Reset")
        probe.spin_until(lambda: near(carriage_m(probe), held_m + RAISED_M), "the carriage is held higher")
        wait_until(lambda: near(browser.value(CARRIAGE_M), held_m + RAISED_M), "the scene shows it there")

        browser.click("EMERGENCY STOP")
        probe.spin_until(lambda: probe.last(JAM_STATE).emergency_stopped, "the driver has stopped")
        browser.click("Clear fault")
        probe.spin_until(lambda: not probe.last(JAM_STATE).emergency_stopped, "the driver goes on")
    assert up.stop() == 0


def carriage_m(probe: Probe) -> float:
    """Height that joint_states tells now."""
    before = len(probe.received[JOINT_STATES.name])
    probe.spin_until(lambda: len(probe.received[JOINT_STATES.name]) > before, "joint_states are received")
    message = probe.last(JOINT_STATES)
    return float(dict(zip(message.name, message.position, strict=True))[CARRIAGE_JOINT])


def has_jammed(probe: Probe, channel: str) -> bool:
    """Whether the driver has ever said so: a machine too busy to simulate in time may be let go again."""
    received = (each for message in probe.received[JAM_STATE.name] for each in message.channels)
    return any(each.channel == channel and each.state == ChannelJamState.JAMMED for each in received)


def near(one_m: float | None, other_m: float) -> bool:
    return one_m is not None and abs(one_m - other_m) < 1e-3
