"""Recordings from bags: of `jammkle rig`, of the live graph, and of anybody else's recorder.

What a machine was made to do is taken from its bag: commands, the course of a driven carriage, when another was let go,
the weather. How it was set stands on the run sheet. What is on none is the rig's default, and said to be.
"""

from __future__ import annotations

import dataclasses
import re
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from jammkle_common import names
from jammkle_common.bags.run_sheet import FILE_NAME, read_text
from jammkle_gap.ankle import checks
from jammkle_gap.ankle.bag import (
    CARRIAGE,
    COMMANDS,
    Bag,
    Samples,
    check_commands,
    checked_clocks,
    checked_topics,
    is_exact,
    on_one_clock,
    read_bag,
    with_acknowledgements,
)
from jammkle_gap.ankle.inputs import (
    FALLING_RIGS,
    AnkleInputs,
    begins_vented,
    course_of,
    first_command_s,
    known_options,
    nominal_rig,
    weather_pa,
    with_air,
)
from jammkle_gap.ankle.repeats import setting_text
from jammkle_gap.ankle.segmentation import (
    Segment,
    commanded_segment,
    driven_segment,
    exercise_segment,
    falling_segments,
    not_before,
    recording_phases,
    seen_release_s,
    segment_of_simulation,
    whole_segment,
)
from jammkle_gap.ankle.sensors import ACCELERATION, RATE, RESOLUTION, UNITS, declared_noise, quantity_of
from jammkle_gap.ankle.shank import place_of, shank_motion
from jammkle_gap.core.data import BadRecordingError, Recording, Signal
from jammkle_sim.rigs.catalogue import RIGS
from jammkle_sim.rigs.replay import CommandTrack, Timeline, has_ground, is_driven, is_guided, timestep_s
from jammkle_sim.rigs.rig import assembled

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from jammkle_sim.rigs.recording import Series
    from jammkle_sim.rigs.rig import Rig
    from jammkle_sim.rigs.run import RigRun

_FALL_SAMPLES = 2500
"""Samples per signal that a fall is thinned to at most: at 1 kHz all of the 2.5 s of a drop."""
_STRETCHED_M = 0.001
"""Extension at the start from which on it is said that nobody knows what a tendon went through before. Assumed."""
_WORTH_SAYING_S = 0.01
"""Time from the first stamp to the start of a run from which on it is said."""
_JOINTS = (*names.ANKLE_JOINTS, names.CARRIAGE_JOINT)
_ROUNDING_S = 1e-9
"""What stamps of the same time may differ by, s."""
_ON_THE_GRID = 1e-6
"""Rounding of a number of samples."""
_SLOW_HZ = 200.0
"""Rate that signals of slow rigs are thinned to. Assumed: nothing there is faster than 50 Hz, and a diagnosis keeps
hundreds of runs."""
_EXPECTED = (
    names.MANIFOLD_PRESSURE.name,
    *(topic.name for topic in names.PRESSURES.values()),
    names.JOINT_STATES.name,
    names.IMU.name,
    names.LOAD_CELL.name,
)
"""Topics of a rig with all its sensors; instrumented tendons are an extra."""


_OF_A_LIMB = (
    "; they are diagnosed from the same bag, where they were commanded, by `jammkle gap diagnose --model leg.xml BAG`, "
    "and `jammkle robot leg --behaviour hang --mjcf > leg.xml` is their model"
)


def load_recordings(
    path: Path, rig: str | None = None, *, options: Mapping[str, Any] | None = None, namespace: str | None = None
) -> tuple[Recording, ...]:
    """Read a bag: one recording of a machine that was driven or jammed, one per release of a machine that was let go.

    Args:
        path: The bag.
        rig: What it was recorded on, where its run sheet does not say: a name of `rigs.catalogue`.
        options: How that rig was set; they go before the run sheet. What is on neither keeps its default.
        namespace: Of the ankle; None takes the only one that is there.

    Returns:
        Named as the bag, or BAG#1, BAG#2 and so on where it holds several.

    Raises:
        BadRecordingError: it cannot be used; the message says why and what to record instead.

    """
    return recordings_of(read_bag(path, namespace), rig, options or {})


def load_recording(
    path: Path, rig: str | None = None, *, options: Mapping[str, Any] | None = None, namespace: str | None = None
) -> Recording:
    """Read a bag of one run; see `load_recordings`.

    Raises:
        BadRecordingError: it cannot be used, or holds several runs.

    """
    return recording_of(read_bag(path, namespace), rig, options or {})


def recording_of(bag: Bag, rig: str | None = None, options: Mapping[str, Any] | None = None) -> Recording:
    """Return the recording that a bag of one run holds; see `load_recordings`.

    Raises:
        BadRecordingError: it cannot be used, or holds several runs.

    """
    found = recordings_of(bag, rig, options)
    if len(found) > 1:
        msg = f"bag {bag.name} holds {len(found)} runs, one per release; give a bag of one run here"
        raise BadRecordingError(msg)
    return found[0]


def recordings_of(bag: Bag, rig: str | None = None, options: Mapping[str, Any] | None = None) -> tuple[Recording, ...]:
    """Return the recordings that a bag holds; see `load_recordings`.

    Raises:
        BadRecordingError: it cannot be used.

    """
    bag = with_acknowledgements(on_one_clock(bag))
    inputs = _inputs_by_sheet(bag, rig, options or {})
    check_commands(bag)
    topics = checked_topics(bag)
    of_recorder = checked_clocks(bag, topics)
    first_s = whole_segment(topics).start_s
    whole = {each.name: each for each in signals_of(bag.name, topics, first_s, np.inf)}
    checks.check_commands_from_start(bag.name, whole, commands_of(topics, first_s))
    segments = _segments(bag, topics, inputs, whole)
    found, errors = [], []
    for place, segment in enumerate(segments):
        name = bag.name if len(segments) == 1 else f"{bag.name}#{place + 1}"
        try:
            found.append(_recording(name, bag, topics, inputs, segment, first_s))
        except checks.TooShortError as error:
            errors.append(error)
    if not found:
        raise errors[0]
    left_out = (f"{len(errors)} of {len(segments)} runs left out as too short",) if errors else ()
    return tuple(dataclasses.replace(each, notes=(*each.notes, *left_out, *of_recorder)) for each in found)


def _inputs_by_sheet(bag: Bag, rig: str | None, options: Mapping[str, Any]) -> AnkleInputs:
    """Return inputs of a rig that is set as the run sheet says, and is commanded nothing.

    Raises:
        BadRecordingError: the rig is not known, or contradicted, or one of its options cannot be right.

    """
    name = bag.sheet.rig
    if rig is None and not name:
        msg = f"bag {bag.name} does not say what it was recorded on; name it with --rig, one of: {', '.join(RIGS)}"
        msg += f"; or write {FILE_NAME}, of which `jammkle info` prints a template"
        raise BadRecordingError(msg)
    if rig is not None and name and rig != name:
        msg = f"bag {bag.name} was recorded on rig '{name}', not '{rig}'"
        msg += "; leave --rig out, or give the right bag"
        raise BadRecordingError(msg)
    rig = name or str(rig)
    given = {option: value for option, value in {**bag.sheet.options, **options}.items() if option != "seed"}
    taken = known_options(rig, given)
    strange = sorted(given.keys() - {option for option, _ in taken})
    if strange and not bag.simulated:
        known = ", ".join(option for option, _ in taken)
        msg = f"run sheet of bag {bag.name}: {strange[0]} is no option of rig {rig}; it has: {known}"
        raise BadRecordingError(msg)
    nothing = CommandTrack(Timeline(np.zeros(1), np.zeros(1)), {})
    return AnkleInputs(rig, taken, nothing, known=frozenset(given) & {option for option, _ in taken})


def _segments(
    bag: Bag, topics: Mapping[str, Samples], inputs: AnkleInputs, whole: Mapping[str, Signal]
) -> tuple[Segment, ...]:
    """Return the runs of a bag, of which `whole` holds all signals."""
    built = nominal_rig(inputs)
    joints = topics.get(names.JOINT_STATES.name)
    first_s = whole_segment(topics).start_s
    if inputs.rig in FALLING_RIGS:
        segments = falling_segments(topics, built)
        if not segments and not bag.simulated:
            _check_rig(bag.name, bag, built, whole)
            checks.refuse_no_release(bag.name, inputs.rig)
    elif is_driven(built):
        has_carriage = joints is not None and CARRIAGE in joints.columns
        if not has_carriage and not bag.simulated:
            checks.check_course_is_known(bag.name, inputs)
        segments = (driven_segment(topics, built),) if has_carriage else ()
    elif is_guided(built):
        checks.check_guide_is_known(bag.name, built, topics)
        segments = (exercise_segment(topics, first_command_s(inputs)),)
    else:
        segments = (commanded_segment(topics),)
    if bag.simulated:
        segments = tuple(segment_of_simulation(segment, first_s) for segment in segments or (whole_segment(topics),))
    if not begins_vented(topics):
        segments = tuple(not_before(segment, first_s) for segment in segments)
    return segments or (whole_segment(topics),)


def _recording(
    name: str, bag: Bag, topics: Mapping[str, Samples], inputs: AnkleInputs, segment: Segment, first_s: float
) -> Recording:
    """Return one run of a bag."""
    said = []
    if abs(segment.start_s - first_s) > _WORTH_SAYING_S:
        said.append(
            f"times count from {segment.start_s - first_s:.3f} s after the first stamp, by its motion or commands"
        )
    if not inputs.known:
        said.append(f"how rig '{inputs.rig}' was set is not known, and taken to be by default; write {FILE_NAME}")
    commands = commands_of(topics, segment.start_s)
    built = nominal_rig(inputs)
    signals = _signals(name, topics, segment, built)
    checks.check_signals(name, signals, commands.solenoids)
    _check_rig(name, bag, built, signals)
    inputs = dataclasses.replace(inputs, commands=commands, began_s=segment.start_s, exact=is_exact(bag))
    inputs = _with_motion(name, inputs, topics, segment, built)
    weather = weather_pa(topics, described=bag.simulated)
    inputs = with_air(inputs, weather, signals, built.pneumatics.ambient_pa, said)
    if inputs.rig == "tensile" and inputs.course is not None and inputs.course.start_m > _STRETCHED_M:
        stretched = f"the tendon is stretched by {1e3 * inputs.course.start_m:.1f} mm as the recording begins"
        said.append(f"{stretched}, and taken to have relaxed there; record from its free length on")
    phases = recording_phases(inputs.rig, signals, commands, inputs.shank)
    if inputs.course is not None or inputs.shank is not None:  # what is driven is an input, and not compared
        signals.pop(CARRIAGE, None)
    if inputs.shank is not None and inputs.shank.is_input_alone:
        signals = {name: each for name, each in signals.items() if quantity_of(name) not in (ACCELERATION, RATE)}
    strange = strange_joints(topics)
    if strange:
        how = _OF_A_LIMB if {*names.LEG_JOINTS} & {*strange} else ""
        said.append(f"joints that are not an ankle's, and left out: {', '.join(strange)}{how}")
    missing = [topic for topic in _EXPECTED if topic not in topics or not topics[topic].columns]
    if missing:
        said.append(f"not recorded: {', '.join(missing)}")
    fewest = _FALL_SAMPLES if inputs.rig in FALLING_RIGS else 0
    thin = tuple(thinned(signal, fewest) for signal in signals.values())
    recording = Recording(name, thin, inputs, phases, notes=tuple(said))
    return dataclasses.replace(recording, setting=setting_text(recording))


def _with_motion(
    name: str, inputs: AnkleInputs, topics: Mapping[str, Samples], segment: Segment, built: Rig
) -> AnkleInputs:
    """Return inputs with how the carriage was driven or when it was let go, as far as that was seen."""
    if inputs.rig in FALLING_RIGS:
        release_s = seen_release_s(segment, built)
        seen_by = segment.seen_by if release_s is not None else ""
        return dataclasses.replace(inputs, release_s=release_s, release_seen_by=seen_by)
    joints = topics.get(names.JOINT_STATES.name)
    if is_guided(built):
        checks.check_motion_is_whole(
            name, names.IMU.name, topics[names.IMU.name].stamp_s, segment.start_s, segment.end_s
        )
        place = place_of(joints) if joints is not None and has_ground(built) else None
        if place is not None:
            checks.check_motion_is_whole(name, names.CARRIAGE_JOINT, place[0], segment.start_s, segment.end_s)
        motion = shank_motion(topics[names.IMU.name], place, segment.start_s, segment.end_s)
        return dataclasses.replace(inputs, shank=motion)
    if not is_driven(built) or joints is None or CARRIAGE not in joints.columns:
        return inputs
    stamp_s, position_m = joints.readings(CARRIAGE)
    within = stamp_s <= segment.end_s
    checks.check_motion_is_whole(name, names.CARRIAGE_JOINT, stamp_s, segment.start_s, segment.end_s)
    return dataclasses.replace(inputs, course=course_of(stamp_s[within] - segment.start_s, position_m[within]))


def _signals(name: str, topics: Mapping[str, Samples], segment: Segment, built: Rig) -> dict[str, Signal]:
    noise = declared_noise(built, timestep_s(built))
    return {
        each.name: dataclasses.replace(
            each, noise=noise[quantity_of(each.name)], resolution=RESOLUTION.get(quantity_of(each.name), 0.0)
        )
        for each in signals_of(name, topics, segment.start_s, segment.end_s)
    }


def _check_rig(name: str, bag: Bag, built: Rig, signals: Mapping[str, Signal]) -> None:
    joints, is_known = assembled(built).joints, bool(bag.sheet.rig)
    checks.check_rig(name, built, signals, joints, _start_m(built), is_known=is_known)


def _start_m(built: Rig) -> float:
    return float(assembled(built).data.joint(names.CARRIAGE_JOINT).qpos[0])


def commands_of(topics: Mapping[str, Samples], start_s: float) -> CommandTrack:
    """Return what was commanded, since a start; what was commanded before it has negative times.

    Args:
        topics: With commands among them.
        start_s: By the clock of the stamps.

    """

    def timeline(topic: str) -> Timeline:
        samples = topics[topic]
        order = np.argsort(samples.log_s, kind="stable")
        return Timeline(samples.log_s[order] - start_s, samples.columns["data"][order])

    solenoids = {channel: timeline(topic.name) for channel, topic in names.SOLENOIDS.items() if topic.name in topics}
    return CommandTrack(timeline(names.PUMP_DUTY.name), solenoids)


def signals_of(bag: str, topics: Mapping[str, Samples], start_s: float, end_s: float) -> Iterator[Signal]:
    """Give the signals between a start and an end, by the clock of the stamps, times since the start, without noise.

    Args:
        bag: Name of the bag.
        topics: Measured ones; commands among them are left out.
        start_s: First time that is taken.
        end_s: Last time that is taken.

    Raises:
        BadRecordingError: a reading is not a number.

    """
    for topic, samples in topics.items():
        if topic in COMMANDS:
            continue
        for column in samples.columns:
            name = _signal_name(topic, column)
            if name is None:
                continue
            stamp_s, values = samples.readings(column)
            _check_finite(bag, name, stamp_s - start_s, values)
            inside = (stamp_s >= start_s - _ROUNDING_S) & (stamp_s <= end_s + _ROUNDING_S)
            if inside.any():
                yield Signal(name, UNITS[quantity_of(name)], stamp_s[inside] - start_s, values[inside])


def strange_joints(topics: Mapping[str, Samples]) -> list[str]:
    """Return the names of joints that no rig with an ankle has, sorted."""
    samples = topics.get(names.JOINT_STATES.name)
    joints = {column.partition("/")[0] for column in samples.columns} if samples is not None else set()
    return sorted(joints - {*_JOINTS, names.CARRIAGE_X_JOINT})


def thinned(signal: Signal, fewest: int) -> Signal:
    """Return every n-th sample of a signal, so that neither `fewest` samples nor 200 Hz are fallen below."""
    length_s = float(signal.time_s[-1] - signal.time_s[0])
    every = max(int((len(signal.time_s) - 1) / max(length_s * _SLOW_HZ, fewest, 1.0) + _ON_THE_GRID), 1)
    return dataclasses.replace(signal, time_s=signal.time_s[::every].copy(), values=signal.values[::every].copy())


def _signal_name(topic: str, column: str) -> str | None:
    """Return the name of a signal: a pressure's topic, a tendon's or joint's column, else topic and column."""
    if column == "pressure":
        return topic
    owner, _, what = column.rpartition("/")
    if what == "velocity" or (topic == names.JOINT_STATES.name and owner not in _JOINTS):
        return None
    if "/" in column:
        return column
    return f"{topic.split('/', maxsplit=1)[0]}/{column}"


def _check_finite(bag: str, name: str, time_s: NDArray[np.float64], values: NDArray[np.float64]) -> None:
    bad = ~np.isfinite(values)
    if bad.any():
        when_s = float(time_s[int(np.argmax(bad))])
        msg = (
            f"{name} in bag {bag} is not a number at {int(bad.sum())} of {len(values)} samples, first at {when_s:.3f} s"
        )
        msg += "; leave such samples out when recording, and check the sensor"
        raise BadRecordingError(msg)


_COLUMNS = (
    (re.compile(r"fluid_pressure_pa"), "pressure"),
    (re.compile(r"linear_acceleration_([xyz])_m_s2"), r"specific_force_\1"),
    (re.compile(r"angular_velocity_([xyz])_rad_s"), r"angular_velocity_\1"),
    (re.compile(r"force_([xyz])_n"), r"force_\1"),
    (re.compile(r"(\w+)\.(position|velocity)"), r"\1/\2"),
    (re.compile(r"(\w+)\.(extension)_m"), r"\1/\2"),
    (re.compile(r"(\w+)\.(tension)_n"), r"\1/\2"),
    (re.compile(r"data"), "data"),
)
"""Columns of a run, and those of a bag."""
_KNOWN = {topic.name for topic in names.TOPICS}


def recording_of_run(run: RigRun, name: str = "") -> Recording:
    """Return what a bag of this run would be read as.

    Args:
        run: Finished.
        name: Of the recording; by default that of the rig.

    Raises:
        BadRecordingError: it cannot be used, as where it is too short.

    """
    return recording_of(bag_of_run(run, name))


def bag_of_run(run: RigRun, name: str = "") -> Bag:
    """Return what a bag of this run would hold.

    Args:
        run: Finished.
        name: Of the bag; by default that of the rig.

    """
    topics = {topic: _samples(series) for topic, series in run.topics.items() if topic in _KNOWN}
    return Bag(name or run.rig, topics, read_text(yaml.safe_dump(dict(run.description)), run.rig), simulated=True)


def _samples(series: Series) -> Samples:
    columns = {}
    for name in series.columns:
        for pattern, template in _COLUMNS:
            match = pattern.fullmatch(name)
            if match is not None:
                columns[match.expand(template)] = series.column(name)
    return Samples(series.time_s, series.time_s, columns)
