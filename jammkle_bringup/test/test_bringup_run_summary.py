"""The summary of a run, from bags with known answers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from jammkle_bringup.core.landing import RunSummary, read_run, summary_of
from jammkle_bringup.core.picture import draw
from jammkle_common.command.errors import InputError
from jammkle_common.names import CHANNELS

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
PARTS = ("imu", "load_cell", "events", "jam_state", "solenoids", "pressures", "carriage")


class Landing:
    """Writes a landing of which everything is known, one method for each kind of topic."""

    def __init__(self, maker: Any, namespace: str, reach: float) -> None:
        self.maker = maker
        self.namespace = namespace
        self.reach = reach

    def write(self, topic: str, time_s: float, message_type: str, *fields: Any) -> None:
        """Write a message, with a header if its type has one."""
        header = [self.maker.header(START_S + time_s)] if "std_msgs" not in message_type else []
        message = self.maker.make(message_type, *header, *fields)
        self.maker.write(f"{self.namespace}/{topic}", START_S + time_s, message)

    def vector(self, z: float) -> Any:
        return self.maker.make("geometry_msgs/msg/Vector3", 0.0, 0.0, z)

    def imu(self) -> None:
        nine = np.zeros(9)
        upright = self.maker.make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0)
        # a knock before touch-down is not the landing's peak
        knocks = {100: 500.0, 555: PEAK_M_S2}
        for step in range(1, 1001):
            force = self.vector(9.80665 + knocks.get(step, 0.0))
            fields = (upright, nine, self.vector(0.0), nine, force, nine)
            self.write("imu/data", step * 0.002, "sensor_msgs/msg/Imu", *fields)

    def load_cell(self) -> None:
        for step in range(1, 1001):
            push = -40.0 if step * 0.002 >= TOUCH_DOWN_S - 1e-9 else 3.5
            wrench = self.maker.make("geometry_msgs/msg/Wrench", self.vector(push), self.vector(0.0))
            self.write("load_cell/wrench", step * 0.002, "geometry_msgs/msg/WrenchStamped", wrench)

    def carriage(self) -> None:
        nothing = np.zeros(0)
        for step in range(1, 1001):
            fields = (["ankle_roll", "carriage"], np.array([0.0, 0.1]), nothing, nothing)
            self.write("joint_states", step * 0.002, "sensor_msgs/msg/JointState", *fields)

    def pressures(self) -> None:
        for step in range(1, 201):
            vacuum = min(max(0.0, (step * 0.01 - ENERGISED_S) * RATE_PA_S), self.reach * COMMANDED_PA)
            for channel in CHANNELS:
                pressure = AMBIENT_PA + OFFSETS_PA[channel] - vacuum
                self.write(f"{channel}/pressure", step * 0.01, "sensor_msgs/msg/FluidPressure", pressure, 0.0)

    def solenoids(self) -> None:
        for time_s, energised in ((0.5, False), (ENERGISED_S, True), (1.6, True)):
            for channel in CHANNELS:
                self.write(f"{channel}/solenoid", time_s, "std_msgs/msg/Bool", energised)

    def events(self) -> None:
        at_s = START_S + DETECTED_S
        self.maker.write(f"{self.namespace}/contact_events", at_s, self.maker.impact(at_s))

    def jam_state(self) -> None:
        for time_s, commanded_pa in ((0.1, 0.0), (ENERGISED_S, COMMANDED_PA)):
            at_s = START_S + time_s
            state = self.maker.jam_state(at_s, 2, commanded_pa, *CHANNELS)
            self.maker.write(f"{self.namespace}/jam_state", at_s, state)


def landing(maker: Any, parts: tuple[str, ...] = PARTS, namespace: str = "", reach: float = 1.0) -> Path:
    """Write the named parts of a landing; `reach` is the part of the command that the pump holds."""
    begun = True
    maker.write("/other", START_S, maker.make("std_msgs/msg/Bool", begun))
    written = Landing(maker, namespace, reach)
    for part in parts:
        getattr(written, part)()
    path: Path = maker.close()
    return path


def summarise(path: Path, namespace: str | None = None) -> RunSummary:
    return summary_of(read_run(path, namespace), str(path))


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
    """Without one kind of topic the rest is still there, what is missing is named, and the picture is drawn."""
    parts = tuple(part for part in PARTS if part != lost)
    path = landing(bag_maker("bag"), parts)
    run = read_run(path)
    summary = summary_of(run, str(path))
    expected = {
        "imu": "imu/data",
        "load_cell": "load_cell/wrench",
        "events": "contact_events",
        "jam_state": "jam_state",
        "solenoids": "achilles/solenoid",
        "pressures": "achilles/pressure",
    }
    if lost in expected:
        assert any(expected[lost] in line for line in summary.missing), summary.missing
    assert (summary.touch_down_s is None) == (lost == "load_cell")
    assert (summary.detected_s is None) == (lost == "events")
    assert (summary.peak_deceleration_m_s2 is None) == (lost == "imu")
    picture = tmp_path / "run.png"
    draw(run, summary, picture)
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_recording_with_standard_types_only_is_enough(bag_maker: Callable[[str], Any]) -> None:
    """Without any type of this project, touch-down, peak, solenoids and the greatest vacuum are still there."""
    parts = tuple(part for part in PARTS if part not in {"events", "jam_state"})
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
