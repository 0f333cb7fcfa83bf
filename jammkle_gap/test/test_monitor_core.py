"""The live gap: a rig's own readings, played to the monitor as a robot's, are close; an effect in them is placed."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from jammkle_common import names
from jammkle_gap.ankle.effects import ankle_library, apply_effects
from jammkle_gap.ankle.inputs import known_options
from jammkle_gap.monitor.followers import Track
from jammkle_gap.monitor.parameters import GapMonitorParameters
from jammkle_gap.monitor.twin import GapMonitor, GapState
from jammkle_sim.rigs.catalogue import run_rig
from jammkle_sim.rigs.landing import LandingRunOptions

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_gap.monitor.twin import SubsystemReport
    from jammkle_sim.rigs.rig import Rig

SETTINGS = GapMonitorParameters(hold_s=0.3, command_jitter_s=0.005)
EFFECTS = {
    "pneumatics": ("line_leak_manifold.conductance_dm3_s_bar", 0.004),
    "tendon": ("fibre_loss_achilles_left.lost", 0.4),
    "mechanics": ("payload.mass_kg", 1.0),
    "sensing": ("imu_offset.z_m_s2", 0.3),
}
Sample = tuple[float, str, dict[str, float]]


@lru_cache
def landing(key: str, value: float) -> tuple[Sample, ...]:
    """Samples of a landing with an effect in it, as they come in; an empty key is none."""
    library = ankle_library()

    def change(rig: Rig) -> Rig:
        return apply_effects(rig, library, {key: value}) if key else rig

    run = run_rig("landing", LandingRunOptions(seed=3), lambda _: None, lambda: False, change)
    samples: list[Sample] = []
    for topic, series in run.topics.items():
        for time_s, row in zip(series.time_s.tolist(), series.values.tolist(), strict=True):
            samples.append((time_s, topic, columns(topic, series.columns, row)))
    return tuple(sorted(samples, key=lambda sample: sample[0]))


def columns(topic: str, given: tuple[str, ...], row: list[float]) -> dict[str, float]:
    """Columns as the diagnosis names them, from those of a rig's run."""
    if topic in {names.MANIFOLD_PRESSURE.name, *(each.name for each in names.PRESSURES.values())}:
        return {"pressure": row[0]}
    if topic == names.IMU.name:
        axes = [f"specific_force_{axis}" for axis in "xyz"] + [f"angular_velocity_{axis}" for axis in "xyz"]
        return dict(zip(axes, row, strict=True))
    plain = {"extension_m": "extension", "tension_n": "tension"}
    pairs = zip(given, row, strict=True)
    return {"/".join((*name.split(".")[:-1], plain.get(name.split(".")[-1], name.split(".")[-1]))).lstrip("/"): value
            for name, value in pairs}  # fmt: skip


def followed(samples: tuple[Sample, ...], left_out: str = "", **changes: Any) -> dict[str, SubsystemReport]:
    """Play samples to a monitor, and return its last reports."""
    monitor = GapMonitor("landing", known_options("landing", {}), SETTINGS)
    now_s = 0.0
    for time_s, topic, values in samples:
        if topic == left_out:
            continue
        monitor.take(topic, time_s, values, time_s)
        if time_s >= now_s + 0.1:
            now_s = time_s
            while monitor.advance(now_s):
                pass
    return {report.name: report for report in monitor.reports(changes.get("at_s", now_s))}


def states(reports: Mapping[str, SubsystemReport]) -> dict[str, GapState]:
    return {name: report.state for name, report in reports.items()}


def test_a_robot_like_its_simulator_is_close_in_every_subsystem() -> None:
    """Without an effect no signal of any subsystem gets near the limit, landing and jamming included."""
    reports = followed(landing("", 0.0))
    assert set(states(reports).values()) == {GapState.CLOSE}
    for report in reports.values():
        assert max(report.gaps.values()) < 0.75 * SETTINGS.limit


@pytest.mark.parametrize("subsystem", EFFECTS)
def test_an_effect_is_warned_of_in_its_own_subsystem_alone(subsystem: str) -> None:
    """As each subsystem is fed with what was measured at its inputs, only the one with the effect is wide."""
    reports = followed(landing(*EFFECTS[subsystem]))
    assert {name for name, state in states(reports).items() if state is GapState.WIDE} == {subsystem}


def test_a_leak_is_named_where_it_shows() -> None:
    """It says that a pressure is off, while the vacuum is made or held."""
    worst = followed(landing(*EFFECTS["pneumatics"]))["pneumatics"].worst
    assert worst is not None
    assert worst.signal.endswith("/pressure")
    assert worst.phase in {"evacuating", "holding"}


def received_late(samples: tuple[Sample, ...], late_s: float, *, acknowledged: bool) -> dict[str, float]:
    """Play samples whose commands are received late, their acknowledgements at any rate; return the largest gaps."""
    monitor = GapMonitor("landing", known_options("landing", {}), SETTINGS)
    commands = {names.PUMP_DUTY.name: 0.0, **dict.fromkeys((each.name for each in names.SOLENOIDS.values()), 0.0)}
    worst: dict[str, float] = {}
    for time_s, topic, values in samples:
        if topic in commands:
            commands[topic] = values["data"]
            monitor.take(topic, time_s + late_s, values, time_s)
        else:
            monitor.take(topic, time_s, values, time_s)
        if acknowledged:
            monitor.take_acknowledged(time_s, commands, time_s)
        while monitor.advance(time_s):
            gaps = {each.name: each.worst.gap for each in monitor.reports(time_s) if each.worst is not None}
            worst = {name: max(gap, worst.get(name, 0.0)) for name, gap in gaps.items()}
    return worst


def test_commands_that_are_received_late_do_not_count_where_the_hardware_acknowledges_its_own() -> None:
    """The driver's wishes come 40 ms late: a wide gap, unless the hardware said when it took them."""
    samples = landing("", 0.0)
    assert received_late(samples, 0.04, acknowledged=False)["pneumatics"] > SETTINGS.limit
    assert received_late(samples, 0.04, acknowledged=True)["pneumatics"] < 0.5 * SETTINGS.limit


def test_late_valves_are_seen_where_the_hardware_tells_of_its_commands() -> None:
    """With true times of the commands, valves that are 10 ms late are a gap; a sensor's usual offset is none."""
    late = received_late(landing("valve_dead_time.extra_s", 0.01), 0.0, acknowledged=True)
    assert late["pneumatics"] > SETTINGS.limit


@pytest.mark.parametrize("begin_s", [0.02, 0.05, 0.06, 0.09])
def test_an_impact_is_close_wherever_a_stretch_begins(begin_s: float) -> None:
    """Whether the impact falls early or late into a stretch, the bodies follow."""
    monitor, worst = GapMonitor("landing", known_options("landing", {}), SETTINGS), 0.0
    now_s = begin_s
    for time_s, topic, values in landing("", 0.0):
        monitor.take(topic, time_s, values, time_s)
        if time_s >= now_s + 0.1:
            now_s = time_s
            while monitor.advance(now_s):
                gaps = {each.name: each.worst.gap for each in monitor.reports(now_s) if each.worst is not None}
                worst = max(worst, gaps.get("mechanics", 0.0))
    assert 0.0 < worst < 0.75 * SETTINGS.limit


@pytest.mark.parametrize("from_s", [-0.04, 0.0])
def test_lost_samples_make_no_gap(from_s: float) -> None:
    """A busy machine loses 50 ms of a landing's samples: what cannot be known after that is not compared."""
    samples = landing("", 0.0)
    height = [(values["carriage/position"], time_s) for time_s, topic, values in samples
              if topic == names.JOINT_STATES.name]  # fmt: skip
    begin_s = min(height)[1] + from_s
    streams = {names.JOINT_STATES.name, names.TENDON_STATES.name}
    reports = followed(tuple(
        each for each in samples if each[1] not in streams or not begin_s < each[0] < begin_s + 0.05
    ))  # fmt: skip
    assert GapState.WIDE not in states(reports).values()
    assert reports["mechanics"].state is GapState.CLOSE
    assert reports["pneumatics"].state is GapState.CLOSE


def test_a_missing_input_makes_its_subsystems_stale_and_is_named() -> None:
    """Without tendon_states neither tendons nor bodies can be followed; the others can."""
    reports = followed(landing("", 0.0), left_out=names.TENDON_STATES.name)
    stale = {name for name, state in states(reports).items() if state is GapState.STALE}
    assert stale == {"tendon", "mechanics"}
    assert reports["tendon"].missing == (names.TENDON_STATES.name,)


def test_silence_makes_everything_stale() -> None:
    """A robot of which nothing comes for longer than the silence allowed is not judged by what it was."""
    reports = followed(landing("", 0.0), at_s=100.0)
    assert set(states(reports).values()) == {GapState.STALE}


def test_a_clock_that_is_set_back_begins_anew() -> None:
    """A second run from time zero is followed like the first."""
    samples = landing("", 0.0)
    monitor = GapMonitor("landing", known_options("landing", {}), SETTINGS)
    for _ in range(2):
        for time_s, topic, values in samples:
            monitor.take(topic, time_s, values, 0.0)
            monitor.advance(0.0)
    assert GapState.WIDE not in [report.state for report in monitor.reports(0.0)]


def test_what_is_not_a_number_is_left_out() -> None:
    """NaN from a broken sensor spoils nothing that comes later."""
    monitor = GapMonitor("landing", known_options("landing", {}), SETTINGS)
    for time_s, topic, values in landing("", 0.0):
        broken = topic == names.IMU.name and 0.3 < time_s < 0.4
        monitor.take(topic, time_s, dict.fromkeys(values, np.nan) if broken else values, time_s)
        monitor.advance(time_s)
    (sensing,) = [report for report in monitor.reports(time_s) if report.name == "sensing"]
    assert sensing.state is GapState.CLOSE


def test_what_a_driver_does_not_measure_loses_no_sample() -> None:
    """Velocities of NaN, as hardware without tachometers publishes them, leave positions; a broken reading does not."""
    track = Track()
    for step in range(5):
        broken = step == 3
        track.add(0.01 * step, {"ankle/position": np.nan if broken else 0.1 * step, "ankle/velocity": np.nan})
    time_s, position_rad = track.column("ankle/position")
    assert time_s.tolist() == pytest.approx([0.0, 0.01, 0.02, 0.04])
    assert position_rad.tolist() == pytest.approx([0.0, 0.1, 0.2, 0.4])
    assert track.columns == ("ankle/position",)
    one_speed = Track()
    for step in range(200):
        one_speed.add(0.01 * step, {"ankle/position": 0.1, "ankle/velocity": np.nan if step else 0.0})
    assert len(one_speed.column("ankle/position")[0]) > 100
    two_nodes = Track()
    for step in range(10):
        two_nodes.add(0.01 * step, {"ankle/position" if step % 2 else "head/position": 0.1})
    assert len(two_nodes.column("ankle/position")[0]) == 5
