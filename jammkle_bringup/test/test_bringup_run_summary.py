"""The summary of a run, from bags with known answers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from jammkle_bringup.core.errors import InputError
from jammkle_bringup.core.picture import draw
from jammkle_bringup.core.run_series import read_run
from jammkle_bringup.core.run_summary import summarise, summary_of
from jammkle_graph.names import CHANNELS

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

START_S = 100.0
AMBIENT_PA = 98000.0
OFFSETS_PA = dict(zip(CHANNELS, (0.0, 150.0, -80.0), strict=True))
TOUCH_DOWN_S = 1.10
DETECTED_S = 1.104
ENERGISED_S = 1.15
RATE_PA_S = 100e3
COMMANDED_PA = 50e3
REACHED_S = ENERGISED_S + 0.95 * COMMANDED_PA / RATE_PA_S
PEAK_M_S2 = 60.0
PARTS = ("imu", "load cell", "events", "jam state", "solenoids", "pressures", "carriage")


def landing(maker: Any, parts: tuple[str, ...] = PARTS, namespace: str = "", reach: float = 1.0) -> Path:
    """Write a landing of which everything is known; `reach` is the part of the command that the pump holds."""

    def at(time_s: float) -> tuple[float, Any]:
        return START_S + time_s, maker.header(START_S + time_s)

    maker.write("/other", START_S, maker.make("std_msgs/msg/Bool", True))  # noqa: FBT003 - the field of a message
    for step in range(1, 1001):
        time_s = step * 0.002
        log_s, header = at(time_s)
        zero = maker.make("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
        if "imu" in parts:
            force = 9.80665 + (PEAK_M_S2 if step == 555 else 0.0)
            # a knock before touch-down, which is not the landing's peak
            force += 500.0 if step == 100 else 0.0
            vector = maker.make("geometry_msgs/msg/Vector3", 0.0, 0.0, force)
            quaternion = maker.make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0)
            nine = np.zeros(9)
            imu = maker.make("sensor_msgs/msg/Imu", header, quaternion, nine, zero, nine, vector, nine)
            maker.write(f"{namespace}/imu/data", log_s, imu)
        if "load cell" in parts:
            push = -40.0 if time_s >= TOUCH_DOWN_S - 1e-9 else 3.5
            wrench = maker.make(
                "geometry_msgs/msg/Wrench", maker.make("geometry_msgs/msg/Vector3", 0.0, 0.0, push), zero
            )
            stamped = maker.make("geometry_msgs/msg/WrenchStamped", header, wrench)
            maker.write(f"{namespace}/load_cell/wrench", log_s, stamped)
        if "carriage" in parts:
            nothing = np.zeros(0)
            joints = maker.make(
                "sensor_msgs/msg/JointState", header, ["ankle_roll", "carriage"], np.array([0.0, 0.1]), nothing, nothing
            )
            maker.write(f"{namespace}/joint_states", log_s, joints)
        if "pressures" in parts and step % 5 == 0:
            vacuum = min(max(0.0, (time_s - ENERGISED_S) * RATE_PA_S), reach * COMMANDED_PA)
            for channel in CHANNELS:
                pressure = AMBIENT_PA + OFFSETS_PA[channel] - vacuum
                message = maker.make("sensor_msgs/msg/FluidPressure", header, pressure, 0.0)
                maker.write(f"{namespace}/{channel}/pressure", log_s, message)
    if "solenoids" in parts:
        for time_s, on in ((0.5, False), (ENERGISED_S, True), (1.6, True)):
            for channel in CHANNELS:
                maker.write(f"{namespace}/{channel}/solenoid", START_S + time_s, maker.make("std_msgs/msg/Bool", on))
    if "events" in parts:
        log_s, header = at(DETECTED_S)
        event = maker.make("jammkle_msgs/msg/ContactEvent", header, 1, 61.0, "m/s^2", 0.002)
        maker.write(f"{namespace}/contact_events", log_s, event)
    if "jam state" in parts:
        for time_s, commanded in ((0.1, 0.0), (ENERGISED_S, COMMANDED_PA)):
            log_s, header = at(time_s)
            states = [
                maker.make("jammkle_msgs/msg/ChannelJamState", channel, 2, commanded, 0.0, "") for channel in CHANNELS
            ]
            state = maker.make("jammkle_msgs/msg/JamState", header, False, 0.0, states)  # noqa: FBT003 - as above
            maker.write(f"{namespace}/jam_state", log_s, state)
    path: Path = maker.close()
    return path


def test_a_known_landing_is_summarised(bag_maker: Callable[[str], Any]) -> None:
    """Touch-down, detection, solenoids, times of reaching the vacuum and the peak come out as they were put in."""
    summary = summarise(landing(bag_maker("bag")))
    assert summary.touch_down_s == pytest.approx(TOUCH_DOWN_S)
    assert summary.detected_s == pytest.approx(DETECTED_S)
    assert summary.detection_delay_s == pytest.approx(0.002)
    assert summary.peak_deceleration_m_s2 == pytest.approx(PEAK_M_S2)
    assert [channel.channel for channel in summary.channels] == list(CHANNELS)
    for channel in summary.channels:
        assert channel.energised_s == pytest.approx(ENERGISED_S)
        assert channel.commanded_vacuum_pa == pytest.approx(COMMANDED_PA)
        # samples are 10 ms apart
        assert channel.reached_s == pytest.approx(REACHED_S, abs=0.01)
        assert channel.greatest_vacuum_pa == pytest.approx(COMMANDED_PA)
    assert summary.missing == ()


def test_a_pump_that_is_too_weak_never_reaches(bag_maker: Callable[[str], Any]) -> None:
    """At 94 % of the command no channel has reached its vacuum; at 96 % all have."""
    weak = summarise(landing(bag_maker("weak"), reach=0.94))
    strong = summarise(landing(bag_maker("strong"), reach=0.96))
    assert all(channel.reached_s is None for channel in weak.channels)
    assert all(channel.reached_s is not None for channel in strong.channels)


@pytest.mark.parametrize("lost", PARTS)
def test_any_piece_may_be_missing(bag_maker: Callable[[str], Any], lost: str, tmp_path: Path) -> None:
    """Without one kind of topic the rest is still told, what is missing is named, and the picture is drawn."""
    parts = tuple(part for part in PARTS if part != lost)
    path = landing(bag_maker("bag"), parts)
    run = read_run(path)
    summary = summary_of(run, str(path))
    expected = {
        "imu": "imu/data",
        "load cell": "load_cell/wrench",
        "events": "contact_events",
        "jam state": "jam_state",
        "solenoids": "achilles/solenoid",
        "pressures": "achilles/pressure",
    }
    if lost in expected:
        assert any(expected[lost] in line for line in summary.missing), summary.missing
    assert (summary.touch_down_s is None) == (lost == "load cell")
    assert (summary.detected_s is None) == (lost == "events")
    assert (summary.peak_deceleration_m_s2 is None) == (lost == "imu")
    picture = tmp_path / "run.png"
    draw(run, summary, picture)
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_recording_with_standard_types_only_is_enough(bag_maker: Callable[[str], Any]) -> None:
    """Without any type of this project, touch-down, peak, solenoids and the greatest vacuum are still told."""
    parts = tuple(part for part in PARTS if part not in {"events", "jam state"})
    summary = summarise(landing(bag_maker("bag"), parts))
    assert summary.touch_down_s == pytest.approx(TOUCH_DOWN_S)
    assert summary.channels[0].greatest_vacuum_pa == pytest.approx(COMMANDED_PA)


def test_a_namespace_is_found_or_asked_for(bag_maker: Callable[[str], Any]) -> None:
    """One ankle in a namespace needs no option; a wrong namespace is refused with what there is."""
    path = landing(bag_maker("bag"), namespace="/lf_ankle")
    assert summarise(path).namespace == "/lf_ankle"
    with pytest.raises(InputError, match="/lf_ankle"):
        summarise(path, "/rf_ankle")


def test_a_bag_of_something_else_is_refused(bag_maker: Callable[[str], Any]) -> None:
    """A bag without any topic of an ankle, or without messages, gets one line."""
    other = bag_maker("other")
    other.write("/chatter", 1.0, other.make("std_msgs/msg/String", "hello"))
    for path, what in ((other.close(), "no topic of an ankle"), (bag_maker("empty").close(), "no messages")):
        with pytest.raises(InputError, match=what) as caught:
            summarise(path)
        assert "\n" not in str(caught.value)
