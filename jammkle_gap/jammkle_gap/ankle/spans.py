"""Where runs lie in a bag: one for as long as it was driven, jammed and vented, one per release where it was let go.

Times of a run count from a start that is the same in all its repeats, whenever their recorders were switched on: the
release, the first motion or the first command comes when the rig's own programme has it.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_gap.ankle.course import reading_noise_m
from jammkle_gap.ankle.events import falls_of_imu, falls_of_slide
from jammkle_gap.ankle.instruments import half_rise_s
from jammkle_gap.ankle.signals import CARRIAGE, COMMANDS
from jammkle_sim.rigs.replay import timestep_s

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from jammkle_gap.ankle.bag import Samples
    from jammkle_gap.ankle.events import Fall
    from jammkle_sim.rigs.rig import Rig

_SIMULATED_START_S = 60.0
"""A simulated rig's stamps begin no later than this, s, unless the simulation was reset."""
_TOLERANCE_S = 0.25
"""How far a simulated run may begin from when its stamps say. Assumed: beyond every delay of the library."""
_SAME_S = 0.1
"""How far apart slide and IMU may see a release that is the same. Assumed: the longest delay of either."""
_LANDED_S = 0.5
"""How long after its touch-down a leg bounces no more as high as half its fall, and nobody has taken it up. Assumed."""
_CALM_S = 1.0
"""The same until its IMU is calm. Assumed: no foot of the catalogue bounces for longer."""
_LIFTED, _LEFT = 0.5, 0.1
"""Shares of the way from rest back to where it was let go: a slide that comes that high is lifted for the next run, and
was left alone while it was below the other. Assumed."""
_HANDLED_M_S2 = 2.5
"""Difference of specific force from rest from which on a leg that has landed is handled. Assumed: a quarter of 1 g."""
_PRESSURE_START_S = 0.2
"""When the first command of a pressure run comes: as in the pressure rig."""
_MOVED_M = 2e-4
"""Way after which a driven slide has certainly moved off, at least. Assumed: ten times the noise of a slide."""
_CLEAR = 6.0
"""The same in standard deviations of its readings."""
_FEWEST = 5


@dataclass(frozen=True)
class Span:
    """One run, by the clock of the stamps."""

    start_s: float
    """Where its times count from."""
    end_s: float
    release_s: float | None = None
    """When its carriage was let go, where that was seen and is not when the rig's programme has it."""
    seen_by: str = ""
    """Topic of the sensor that saw it."""
    fall_s: float | None = None
    """From release to touch-down, where both were seen."""


@dataclass(frozen=True)
class _Release:
    """When a carriage was let go, by the clock of the stamps, who saw it, and how long it fell, if that was seen."""

    release_s: float
    seen_by: str
    fall_s: float | None


def span_of_simulation(span: Span, first_s: float) -> Span:
    """Return a run on the simulation's own clock where it begins when that says, within what is seen of it.

    Args:
        span: As its motion or commands show.
        first_s: First stamp.

    """
    if first_s >= _SIMULATED_START_S or abs(span.start_s) > _TOLERANCE_S:
        return span
    return dataclasses.replace(span, start_s=0.0)


def falling_spans(topics: Mapping[str, Samples], rig: Rig) -> tuple[Span, ...]:
    """Return one run per release that carriage or IMU show.

    Args:
        topics: What was measured.
        rig: Lets its carriage go at its first event.

    """
    lead_s = _programme_s(rig)
    _, last_s = _reach(topics)
    seen = _releases(topics, rig)
    found = []
    for place, release in enumerate(seen):
        next_s = seen[place + 1].release_s - lead_s if place + 1 < len(seen) else math.inf
        landed_s = release.release_s + (release.fall_s or 0.0) + _LANDED_S
        end_s = min(last_s, max(next_s, landed_s), _handled_s(topics, release.release_s, landed_s))
        start_s = release.release_s - lead_s
        found.append(Span(start_s, end_s, release.release_s, release.seen_by, release.fall_s))
    return tuple(found)


def not_before(span: Span, first_s: float) -> Span:
    """Return a run that does not begin before a time: what was evacuated then cannot be followed from earlier."""
    return dataclasses.replace(span, start_s=max(span.start_s, first_s))


def seen_release_s(span: Span, rig: Rig) -> float | None:
    """Return when the carriage was let go, s since the start; None where it is when the rig does so anyway.

    A rig that describes itself, and keeps its own time, is taken at its word: a sensor that sees it late is late.
    """
    if span.release_s is None:
        return None
    release_s = span.release_s - span.start_s
    return None if span.start_s == 0.0 and abs(release_s - _programme_s(rig)) <= _TOLERANCE_S else release_s


def driven_span(topics: Mapping[str, Samples], rig: Rig) -> Span:
    """Return the run of a driven carriage: from a while before it moves to the end of the bag."""
    first_s, last_s = _reach(topics)
    moved_s = _moved_off_s(*topics[names.JOINT_STATES.name].readings(CARRIAGE))
    return Span(first_s if moved_s is None else moved_s - _programme_s(rig), last_s)


def commanded_span(topics: Mapping[str, Samples]) -> Span:
    """Return the run of an ankle that is only told things: from a while before its first command to the end of the bag.

    Args:
        topics: With commands among them.

    """
    first_s, last_s = _reach(topics)
    told_s = [
        float(samples.log_s[int(np.argmax(samples.columns["data"] > 0.0))])
        for name, samples in topics.items()
        if name in COMMANDS and (samples.columns["data"] > 0.0).any()
    ]
    if not told_s or min(told_s) < first_s:
        return Span(first_s, last_s)
    return Span(min(told_s) - _PRESSURE_START_S, last_s)


def whole_span(topics: Mapping[str, Samples]) -> Span:
    """Return the whole bag as one run."""
    return Span(*_reach(topics))


def _programme_s(rig: Rig) -> float:
    """Return when a rig's own programme lets go or moves off, s since its start."""
    return rig.events[0].step * timestep_s(rig) if rig.events else 0.0


def _reach(topics: Mapping[str, Samples]) -> tuple[float, float]:
    """Return first and last stamp of what was measured."""
    stamps = [each.stamp_s for name, each in topics.items() if name not in COMMANDS and len(each.stamp_s)]
    return min(float(each[0]) for each in stamps), max(float(each[-1]) for each in stamps)


def _releases(topics: Mapping[str, Samples], rig: Rig) -> list[_Release]:
    """Return every release: when, by the slide if there is one, as that sees it sharper; how long it fell, by the IMU.

    A sensor's own lag is the same at both ends of a fall, and so is a fault of its delay.
    """
    joints, imu = topics.get(names.JOINT_STATES.name), topics.get(names.IMU.name)
    by_slide: tuple[Fall, ...] = ()
    if joints is not None and CARRIAGE in joints.columns:
        by_slide = falls_of_slide(*joints.readings(CARRIAGE))
    by_imu = () if imu is None else falls_of_imu(imu.stamp_s, _specific_force(imu))
    late_s = half_rise_s(rig)
    found = []
    for fall in by_slide:
        if fall.release_s is not None:
            near = [each.lasts_s for each in by_imu if abs((each.release_s or -math.inf) - fall.release_s) < _SAME_S]
            lasts_s = near[0] if near and near[0] is not None else fall.lasts_s
            found.append(_Release(fall.release_s, names.JOINT_STATES.name, lasts_s))
    if found:
        return found
    return [
        _Release(fall.release_s - late_s, names.IMU.name, fall.lasts_s) for fall in by_imu if fall.release_s is not None
    ]


def _specific_force(imu: Samples) -> NDArray[np.float64]:
    return np.column_stack([imu.columns[f"specific_force_{axis}"] for axis in "xyz"])


def _handled_s(topics: Mapping[str, Samples], release_s: float, landed_s: float) -> float:
    """Return when a leg that has landed is taken up again, s; infinite if it is not."""
    joints, imu = topics.get(names.JOINT_STATES.name), topics.get(names.IMU.name)
    if joints is not None and CARRIAGE in joints.columns:
        stamp_s, height_m = joints.readings(CARRIAGE)
        rest = (stamp_s >= landed_s - 0.2 * _LANDED_S) & (stamp_s < landed_s)
        if not rest.any():
            return math.inf
        rest_m = float(np.median(height_m[rest]))
        share = (height_m - rest_m) / max(float(np.interp(release_s, stamp_s, height_m)) - rest_m, 1e-6)
        lifted = np.flatnonzero((stamp_s >= landed_s) & (share > _LIFTED))
        if not len(lifted):
            return math.inf
        alone = np.flatnonzero(share[: lifted[0]] < _LEFT)
        return float(stamp_s[alone[-1]]) if len(alone) else landed_s
    if imu is not None:
        force = _specific_force(imu)
        apart = np.linalg.norm(force - np.median(force, axis=0), axis=1)
        handled = (imu.stamp_s >= landed_s - _LANDED_S + _CALM_S) & (apart > _HANDLED_M_S2)
        if handled.any():
            return float(imu.stamp_s[int(np.argmax(handled))])
    return math.inf


def _moved_off_s(stamp_s: NDArray[np.float64], position_m: NDArray[np.float64]) -> float | None:
    """Return the stamp, s, at which a driven slide began to move; None where it never did or was moving from the first.

    A line through where it is a little and twice that off its rest leads back to where it left it.
    """
    if len(stamp_s) < 2 * _FEWEST:
        return None
    small_m = max(_MOVED_M, _CLEAR * reading_noise_m(position_m))
    rest_m = float(np.median(position_m[:_FEWEST]))
    way_m = np.abs(position_m - rest_m)
    if way_m.max() < 2.0 * small_m:
        return None
    far = int(np.argmax(way_m >= 2.0 * small_m))
    near = int(np.argmax(way_m >= small_m))
    moved_s = float(2.0 * stamp_s[near] - stamp_s[far])
    return moved_s if moved_s > stamp_s[_FEWEST] else None
