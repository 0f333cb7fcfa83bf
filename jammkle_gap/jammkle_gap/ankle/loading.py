"""Recordings from bags: of `jammkle rig`, of the live graph, and of anybody else's recorder."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from jammkle_gap.ankle import checks
from jammkle_gap.ankle.bag import Samples, read_bag
from jammkle_gap.ankle.inputs import AnkleInputs, known_options, nominal_rig
from jammkle_gap.ankle.instruments import RESOLUTION, UNITS, declared_noise, quantity_of
from jammkle_gap.ankle.phases import FALLING_RIGS, pressure_signals, recording_phases
from jammkle_gap.ankle.starting import rig_start
from jammkle_gap.core.data import BadRecordingError, Recording, Signal
from jammkle_graph import names
from jammkle_graph.constants import STANDARD_ATMOSPHERE_PA
from jammkle_sim.rigs.assembly import assembled
from jammkle_sim.rigs.catalogue import RIGS
from jammkle_sim.rigs.replay import CommandTrack, timestep_s
from jammkle_sim.rigs.timeline import Timeline

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from jammkle_gap.ankle.bag import Bag
    from jammkle_gap.ankle.inputs import Options

_NOT_VENTED_PA = 3e3
"""Distance from the atmosphere from which on a channel counts as evacuated at the start. Assumed: twenty times the
scatter of the sensors' offsets."""
_WEATHER_PA = 500.0
"""Distance from the standard atmosphere from which on the recording's own is taken. Assumed: three such scatters."""
_FALL_SAMPLES = 2500
"""Samples per signal that a fall is thinned to at most: at 1 kHz all of the 2.5 s of a drop."""
_ON_THE_GRID = 1e-6
"""Rounding of a number of samples."""
_SLOW_HZ = 200.0
"""Rate that signals of slow rigs are thinned to. Assumed: nothing there is faster than 50 Hz, and a diagnosis keeps
hundreds of runs."""
_ROUNDING_S = 1e-9
"""What stamps of the same time may differ by, s."""
_REGIME = ("foot", "material", "membrane", "jam", "channel", "vacuum_pa", "speed_m_s")
"""Options that make a regime of their own; the others only scatter or are the same for all."""


def load_recording(
    path: Path, rig: str | None = None, *, options: Mapping[str, Any] | None = None, namespace: str | None = None
) -> Recording:
    """Read a bag.

    Args:
        path: The bag.
        rig: What it was recorded on, where the bag does not tell: a name of `rigs.catalogue`.
        options: How that rig was set, where the bag does not tell; what is missing keeps its default.
        namespace: Of the ankle; None takes the only one that is there.

    Raises:
        BadRecordingError: it cannot be used; the message says why and what to record instead.

    """
    return recording_of(read_bag(path, namespace), rig, options or {})


def recording_of(bag: Bag, rig: str | None = None, options: Mapping[str, Any] | None = None) -> Recording:
    """Return the recording that a bag holds; see `load_recording`.

    Raises:
        BadRecordingError: it cannot be used.

    """
    bag = _with_acknowledgements(_on_one_clock(bag))
    notes: list[str] = []
    name, settings = _rig_of(bag, rig, options or {}, notes)
    checks.check_commands(bag)
    topics: dict[str, Samples] = {}
    for topic, samples in bag.topics.items():
        if topic in _COMMANDS:
            checks.check_command_values(bag.name, topic, samples)
            topics[topic] = samples
            continue
        topics[topic] = checks.in_order(bag.name, topic, samples)
        checks.check_clocks(bag.name, topic, samples)
    if not set(topics) - set(_COMMANDS):
        msg = f"bag {bag.name} holds commands alone"
        msg += f"; record pressures, {names.JOINT_STATES.name} and {names.IMU.name} too"
        raise BadRecordingError(msg)
    inputs = AnkleInputs(name, settings, CommandTrack(_nothing(), {}))
    built = nominal_rig(inputs)
    start = rig_start(bag, topics, built, lambda guess_s: _commands(topics, guess_s), notes)
    start_s = start.stamp_s
    commands = _commands(topics, start_s)
    noise, steps = declared_noise(built, timestep_s(built)), RESOLUTION
    signals = {
        each.name: dataclasses.replace(
            each, noise=noise[quantity_of(each.name)], resolution=steps.get(quantity_of(each.name), 0.0)
        )
        for each in _signals(bag.name, topics, start_s)
    }
    checks.check_numbers(bag.name, signals.values())
    checks.check_alive(bag.name, signals, commands.solenoids)
    checks.check_length(bag.name, signals)
    checks.check_pauses(bag.name, signals.values())
    checks.check_commands_from_start(bag.name, signals, commands)
    parts = assembled(built)
    start_m = float(parts.data.joint(names.CARRIAGE_JOINT).qpos[0])
    checks.check_rig(bag.name, built, signals, parts.joints, start_m)
    inputs = dataclasses.replace(inputs, commands=commands, starts_by_motion=start.by_motion)
    inputs = _with_air(inputs, bag, signals, built.pneumatics.ambient_pa, notes)
    missing = [topic for topic in _EXPECTED if topic not in topics or not topics[topic].columns]
    strange = _strange_joints(topics)
    if strange:
        notes.append(f"joints that are not an ankle's, and left out: {', '.join(strange)}")
    if missing:
        notes.append(f"not recorded: {', '.join(missing)}")
    phases = recording_phases(name, signals, commands)
    fewest = _FALL_SAMPLES if name in FALLING_RIGS else 0
    thin = tuple(_thinned(signal, fewest) for signal in signals.values())
    return Recording(bag.name, thin, inputs, phases, _regime(inputs), tuple(notes))


_COMMANDS = (names.PUMP_DUTY.name, *(topic.name for topic in names.SOLENOIDS.values()))
_EXPECTED = (
    names.MANIFOLD_PRESSURE.name,
    *(topic.name for topic in names.PRESSURES.values()),
    names.JOINT_STATES.name,
    names.IMU.name,
    names.LOAD_CELL.name,
    names.TENDON_STATES.name,
)


def _rig_of(bag: Bag, rig: str | None, options: Mapping[str, Any], notes: list[str]) -> tuple[str, Options]:
    try:
        described: Any = yaml.safe_load(bag.description) if bag.description else {}
    except yaml.YAMLError as error:
        msg = f"bag {bag.name} has {names.SIM_PARAMETERS.name} that are not YAML: {' '.join(str(error).split())}"
        raise BadRecordingError(msg) from error
    described = described if isinstance(described, dict) else {}
    told = str(described.get("rig", ""))
    if rig is None and not told:
        msg = f"bag {bag.name} does not tell what it was recorded on"
        msg += f"; name it with --rig, one of: {', '.join(RIGS)}"
        raise BadRecordingError(msg)
    if rig is not None and told and rig != told:
        msg = f"bag {bag.name} was recorded on rig '{told}', not '{rig}'"
        msg += "; leave --rig out, or give the right bag"
        raise BadRecordingError(msg)
    given = {**dict(described.get("options") or {}), **options}
    if not given:
        notes.append(f"how rig '{rig}' was set is not known: its defaults are taken")
    given.pop("seed", None)
    return told or str(rig), known_options(told or str(rig), given)


def _on_one_clock(bag: Bag) -> Bag:
    """Put log times on the clock of the stamps, where the bag holds /clock and was logged by another."""
    if bag.clock is None:
        return bag
    ticks = bag.clock
    if abs(float(np.median(ticks.log_s - ticks.columns["clock_s"]))) < 1.0:
        return bag
    topics = {}
    for name, samples in bag.topics.items():
        log_s = np.interp(samples.log_s, ticks.log_s, ticks.columns["clock_s"])
        topics[name] = dataclasses.replace(
            samples, log_s=log_s, stamp_s=log_s if name in _COMMANDS else samples.stamp_s
        )
    return dataclasses.replace(bag, topics=topics)


def _with_acknowledgements(bag: Bag) -> Bag:
    """Take the commands as the hardware acknowledged them, where it did."""
    topics = dict(bag.topics)
    told = topics.pop(names.ACTUATOR_STATES.name, None)
    if told is None:
        return bag
    order = np.argsort(told.stamp_s, kind="stable")
    for topic, column in told.columns.items():
        values = column[order]
        changed = np.concatenate(([True], values[1:] != values[:-1]))
        time_s = told.stamp_s[order][changed]
        topics[topic] = Samples(time_s, time_s, {"data": values[changed]})
    return dataclasses.replace(bag, topics=topics)


def _nothing() -> Timeline:
    return Timeline(np.zeros(1), np.zeros(1))


def _commands(topics: Mapping[str, Samples], start_s: float) -> CommandTrack:
    def timeline(topic: str) -> Timeline:
        samples = topics[topic]
        order = np.argsort(samples.log_s, kind="stable")
        return Timeline(samples.log_s[order] - start_s, samples.columns["data"][order])

    solenoids = {channel: timeline(topic.name) for channel, topic in names.SOLENOIDS.items() if topic.name in topics}
    return CommandTrack(timeline(names.PUMP_DUTY.name), solenoids)


def _signals(bag: str, topics: Mapping[str, Samples], start_s: float) -> Iterator[Signal]:
    for topic, samples in topics.items():
        time_s = samples.stamp_s - start_s
        inside = time_s >= -_ROUNDING_S
        for column, values in samples.columns.items():
            name = _signal_name(topic, column)
            if name is None or topic in _COMMANDS or not inside.any():
                continue
            _check_finite(bag, name, time_s, values)
            yield Signal(name, UNITS[quantity_of(name)], time_s[inside], values[inside])


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


_JOINTS = (*names.ANKLE_JOINTS, names.CARRIAGE_JOINT)


def _strange_joints(topics: Mapping[str, Samples]) -> list[str]:
    samples = topics.get(names.JOINT_STATES.name)
    joints = {column.partition("/")[0] for column in samples.columns} if samples is not None else set()
    return sorted(joints - set(_JOINTS))


def _check_finite(bag: str, name: str, time_s: NDArray[np.float64], values: NDArray[np.float64]) -> None:
    bad = ~np.isfinite(values)
    if bad.any():
        when_s = float(time_s[int(np.argmax(bad))])
        msg = (
            f"{name} in bag {bag} is not a number at {int(bad.sum())} of {len(values)} samples, first at {when_s:.3f} s"
        )
        msg += "; leave such samples out when recording, and check the sensor"
        raise BadRecordingError(msg)


def _thinned(signal: Signal, fewest: int) -> Signal:
    """Return every n-th sample of a signal, so that neither `fewest` samples nor _SLOW_HZ are fallen below."""
    length_s = float(signal.time_s[-1] - signal.time_s[0])
    every = max(int((len(signal.time_s) - 1) / max(length_s * _SLOW_HZ, fewest, 1.0) + _ON_THE_GRID), 1)
    return dataclasses.replace(signal, time_s=signal.time_s[::every].copy(), values=signal.values[::every].copy())


def _with_air(
    inputs: AnkleInputs, bag: Bag, signals: Mapping[str, Signal], ambient_pa: float, notes: list[str]
) -> AnkleInputs:
    """Take atmosphere and start from the pressures, where the bag does not tell or they differ from vented."""
    found = pressure_signals(signals)
    if not found:
        return inputs
    first = {where: float(np.median(signals[name].values[:5])) for where, name in found.items()}
    highest_pa = float(np.median([np.percentile(signals[name].values, 99) for name in found.values()]))
    if bag.description is None and abs(highest_pa - STANDARD_ATMOSPHERE_PA) > _WEATHER_PA:
        ambient_pa = highest_pa
        inputs = dataclasses.replace(inputs, ambient_pa=ambient_pa)
        notes.append(f"atmosphere taken from the vented pressures: {ambient_pa:.0f} Pa")
    evacuated = [where for where, value in first.items() if value < ambient_pa - _NOT_VENTED_PA]
    if not evacuated:
        return inputs
    notes.append(f"not vented at the start, and begun from the pressures measured then: {', '.join(evacuated)}")
    volumes = ("manifold", *names.CHANNELS)
    return dataclasses.replace(inputs, start_pa=np.array([first.get(where, ambient_pa) for where in volumes]))


def _regime(inputs: AnkleInputs) -> str:
    options = dict(inputs.options)
    parts = [f"{name} {options[name]:g}" if isinstance(options[name], float) else str(options[name])
             for name in _REGIME if name in options]  # fmt: skip
    return ", ".join((inputs.rig, *parts))
