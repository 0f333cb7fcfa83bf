"""Recordings from bags: of `jammkle rig`, of the live graph, and of anybody else's recorder.

What a machine was made to do is taken from its bag: commands, the course of a driven carriage, when another was let go
and how far it fell, the channel that a pulled tendon hangs on, the weather. What neither bag nor user tell is the rig's
default, and said to be.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common import names
from jammkle_gap.ankle import checks
from jammkle_gap.ankle.acknowledged import is_exact, with_acknowledgements
from jammkle_gap.ankle.atmosphere import begins_vented, weather_pa, with_air
from jammkle_gap.ankle.bag import read_bag
from jammkle_gap.ankle.bag_checks import check_commands, checked_clocks, checked_topics
from jammkle_gap.ankle.course import course_of
from jammkle_gap.ankle.inputs import AnkleInputs, nominal_rig
from jammkle_gap.ankle.instruments import RESOLUTION, declared_noise, quantity_of
from jammkle_gap.ankle.measured_options import with_channel, with_fall
from jammkle_gap.ankle.phases import FALLING_RIGS, recording_phases
from jammkle_gap.ankle.setting import setting_text
from jammkle_gap.ankle.signals import CARRIAGE, COMMANDS, commands_of, signals_of, strange_joints, thinned
from jammkle_gap.ankle.spans import (
    Span,
    commanded_span,
    driven_span,
    falling_spans,
    not_before,
    seen_release_s,
    span_of_simulation,
    whole_span,
)
from jammkle_gap.ankle.told import told_by
from jammkle_gap.core.data import BadRecordingError, Recording
from jammkle_sim.rigs.replay import CommandTrack, Timeline, is_driven, timestep_s
from jammkle_sim.rigs.rig import assembled

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from jammkle_gap.ankle.bag import Bag, Samples
    from jammkle_gap.ankle.told import Told
    from jammkle_gap.core.data import Signal
    from jammkle_sim.rigs.rig import Rig

_FALL_SAMPLES = 2500
"""Samples per signal that a fall is thinned to at most: at 1 kHz all of the 2.5 s of a drop."""
_STRETCHED_M = 0.001
"""Extension at the start from which on it is said that nobody knows what a tendon went through before. Assumed."""
_WORTH_SAYING_S = 0.01
"""Time from the first stamp to the start of a run from which on it is said."""
_EXPECTED = (
    names.MANIFOLD_PRESSURE.name,
    *(topic.name for topic in names.PRESSURES.values()),
    names.JOINT_STATES.name,
    names.IMU.name,
    names.LOAD_CELL.name,
)
"""Topics of a rig with all its sensors; instrumented tendons are an extra."""


def load_recordings(
    path: Path, rig: str | None = None, *, options: Mapping[str, Any] | None = None, namespace: str | None = None
) -> tuple[Recording, ...]:
    """Read a bag: one recording of a machine that was driven or jammed, one per release of a machine that was let go.

    Args:
        path: The bag.
        rig: What it was recorded on, where the bag does not tell: a name of `rigs.catalogue`.
        options: How that rig was set, where the bag does not tell; what nobody tells is measured or keeps its default.
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
    bag = with_acknowledgements(_on_one_clock(bag))
    told = told_by(bag, rig, options or {})
    check_commands(bag)
    topics = checked_topics(bag)
    of_recorder = checked_clocks(bag, topics)
    first_s = whole_span(topics).start_s
    whole = {each.name: each for each in signals_of(bag.name, topics, first_s, np.inf)}
    checks.check_commands_from_start(bag.name, whole, commands_of(topics, first_s))
    spans = _spans(bag, topics, told, whole)
    found, errors = [], []
    for place, span in enumerate(spans):
        name = bag.name if len(spans) == 1 else f"{bag.name}#{place + 1}"
        try:
            found.append(_recording(name, bag, topics, told, span, first_s))
        except checks.TooShortError as error:
            errors.append(error)
    if not found:
        raise errors[0]
    left_out = (f"{len(errors)} of {len(spans)} runs left out as too short",) if errors else ()
    return tuple(dataclasses.replace(each, notes=(*each.notes, *left_out, *of_recorder)) for each in found)


def _spans(bag: Bag, topics: Mapping[str, Samples], told: Told, whole: Mapping[str, Signal]) -> tuple[Span, ...]:
    """Return the runs of a bag, of which `whole` holds all signals."""
    built = nominal_rig(_unmoved(told))
    joints = topics.get(names.JOINT_STATES.name)
    is_described = bag.description is not None
    first_s = whole_span(topics).start_s
    if told.rig in FALLING_RIGS:
        spans = falling_spans(topics, built)
        if not spans and not is_described:
            checks.check_rig(bag.name, built, whole, assembled(built).joints, _start_m(built))
            checks.refuse_no_release(bag.name, told.rig)
    elif is_driven(built):
        has_carriage = joints is not None and CARRIAGE in joints.columns
        if not has_carriage and not is_described:
            checks.check_course_is_known(bag.name, told)
        spans = (driven_span(topics, built),) if has_carriage else ()
    else:
        spans = (commanded_span(topics),)
    if is_described:
        spans = tuple(span_of_simulation(span, first_s) for span in spans or (whole_span(topics),))
    if not begins_vented(topics):
        spans = tuple(not_before(span, first_s) for span in spans)
    return spans or (whole_span(topics),)


def _recording(name: str, bag: Bag, topics: Mapping[str, Samples], told: Told, span: Span, first_s: float) -> Recording:
    """Return one run of a bag."""
    said = []
    if abs(span.start_s - first_s) > _WORTH_SAYING_S:
        said.append(f"times count from {span.start_s - first_s:.3f} s after the first stamp, by its motion or commands")
    if not told.known:
        said.append(f"how rig '{told.rig}' was set is not known: its defaults are taken but for what is measured")
    if told.rig in FALLING_RIGS:
        told = with_fall(told, span, topics, lambda guess: _start_m(nominal_rig(_unmoved(guess))), said)
    elif "channel" in dict(told.options) and told.rig == "tensile":
        told = with_channel(told, span, topics, said)
    inputs = _unmoved(told)
    commands = commands_of(topics, span.start_s)
    signals = _signals(name, topics, span, nominal_rig(inputs))
    checks.check_signals(name, signals, commands.solenoids)
    inputs = dataclasses.replace(inputs, commands=commands, began_s=span.start_s, exact=is_exact(bag))
    built = nominal_rig(inputs)
    checks.check_rig(name, built, signals, assembled(built).joints, _start_m(built))
    inputs = _with_motion(inputs, topics, span, built)
    weather = weather_pa(topics, described=bag.description is not None)
    inputs = with_air(inputs, weather, signals, built.pneumatics.ambient_pa, said)
    if told.rig == "tensile" and inputs.course is not None and inputs.course.start_m > _STRETCHED_M:
        stretched = f"the tendon is stretched by {1e3 * inputs.course.start_m:.1f} mm as the recording begins"
        said.append(f"{stretched}, and taken to have relaxed there; record from its free length on")
    phases = recording_phases(told.rig, signals, commands)
    if inputs.course is not None:  # what is driven is told, not compared
        signals.pop(CARRIAGE, None)
    strange = strange_joints(topics)
    if strange:
        said.append(f"joints that are not an ankle's, and left out: {', '.join(strange)}")
    missing = [topic for topic in _EXPECTED if topic not in topics or not topics[topic].columns]
    if missing:
        said.append(f"not recorded: {', '.join(missing)}")
    fewest = _FALL_SAMPLES if told.rig in FALLING_RIGS else 0
    thin = tuple(thinned(signal, fewest) for signal in signals.values())
    recording = Recording(name, thin, inputs, phases, notes=tuple(said))
    return dataclasses.replace(recording, setting=setting_text(recording))


def _unmoved(told: Told) -> AnkleInputs:
    """Return inputs of a rig that does what its programme says and is told nothing."""
    nothing = Timeline(np.zeros(1), np.zeros(1))
    track, shown = CommandTrack(nothing, {}), tuple(sorted(told.shown.items()))
    return AnkleInputs(told.rig, told.options, track, known=told.known, measured=told.measured, shown=shown)


def _with_motion(inputs: AnkleInputs, topics: Mapping[str, Samples], span: Span, built: Rig) -> AnkleInputs:
    """Return inputs with how the carriage was driven or when it was let go, as far as that was seen."""
    if inputs.rig in FALLING_RIGS:
        release_s = seen_release_s(span, built)
        seen_by = span.seen_by if release_s is not None else ""
        return dataclasses.replace(inputs, release_s=release_s, release_seen_by=seen_by)
    joints = topics.get(names.JOINT_STATES.name)
    if not is_driven(built) or joints is None or CARRIAGE not in joints.columns:
        return inputs
    stamp_s, position_m = joints.readings(CARRIAGE)
    within = stamp_s <= span.end_s
    return dataclasses.replace(inputs, course=course_of(stamp_s[within] - span.start_s, position_m[within]))


def _signals(name: str, topics: Mapping[str, Samples], span: Span, built: Rig) -> dict[str, Signal]:
    noise = declared_noise(built, timestep_s(built))
    return {
        each.name: dataclasses.replace(
            each, noise=noise[quantity_of(each.name)], resolution=RESOLUTION.get(quantity_of(each.name), 0.0)
        )
        for each in signals_of(name, topics, span.start_s, span.end_s)
    }


def _start_m(built: Rig) -> float:
    return float(assembled(built).data.joint(names.CARRIAGE_JOINT).qpos[0])


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
        topics[name] = dataclasses.replace(samples, log_s=log_s, stamp_s=log_s if name in COMMANDS else samples.stamp_s)
    return dataclasses.replace(bag, topics=topics)
