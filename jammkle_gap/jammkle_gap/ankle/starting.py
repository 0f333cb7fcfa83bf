"""Where the start of a rig lies in a recording: told by the simulation's own stamps, or by when its slide moved off."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.ankle.phases import FALLING_RIGS
from jammkle_graph import names
from jammkle_graph.constants import STANDARD_GRAVITY_M_S2
from jammkle_sim.rigs import replay

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from jammkle_gap.ankle.bag import Bag, Samples
    from jammkle_sim.rigs.rig import Rig

_SLIDE = f"{names.CARRIAGE_JOINT}/position"
_MOVED_M = 0.001
"""Way after which a slide has certainly moved off."""
_TOLERANCE_S = 0.25
"""How far the slide may move off from when the rig says it does. Assumed: beyond every delay of the library."""
_COMPARED_M = {True: 0.02, False: 0.005}
"""Way up to which measured and simulated slide are laid over each other, by whether it falls. Assumed: a fall has met
nothing yet, a drive has not shown how far its speed is off."""
_FEWEST = 5
"""Samples within it that are needed."""
_SIMULATED_START_S = 60.0
"""A simulated rig's stamps begin no later than this, s, unless the simulation was reset."""


@dataclass(frozen=True)
class RigStart:
    """Where a rig started."""

    stamp_s: float
    """Of the clock of the measurements."""
    by_motion: bool
    """Told by when the slide was measured to move off: however late that was."""


def rig_start(
    bag: Bag,
    topics: Mapping[str, Samples],
    rig: Rig,
    commands_from: Callable[[float], replay.CommandTrack],
    notes: list[str],
) -> RigStart:
    """Return when the rig started.

    Args:
        bag: Tells whether a simulation was recorded, whose stamps count from its start.
        topics: What was measured.
        rig: What it does when.
        commands_from: Gives what was commanded for a start, s.
        notes: What the reader should know is added.

    """
    first_s = min(float(samples.stamp_s[0]) for samples in topics.values())
    told = 0.0 if bag.description is not None and first_s < _SIMULATED_START_S else first_s
    moved_off_s = _moved_off_s(topics, rig)
    if moved_off_s is None or not rig.events:
        return RigStart(told, by_motion=False)
    by_motion = moved_off_s - rig.events[0].step * replay.timestep_s(rig)
    if abs(by_motion - told) <= _TOLERANCE_S and bag.description is not None:
        return RigStart(told, by_motion=False)
    notes.append(f"the start of the rig is told by when its slide moved off, at {moved_off_s - first_s:.3f} s")
    late_s = _late_s(topics[names.JOINT_STATES.name], rig, commands_from(by_motion), by_motion)
    return RigStart(by_motion + late_s, by_motion=True)


def _late_s(joints: Samples, rig: Rig, commands: replay.CommandTrack, start_s: float) -> float:
    """Return how much later than `start_s` the rig started, s, by laying the simulated slide over the measured one."""
    step_s, furthest_m = replay.timestep_s(rig), _COMPARED_M[rig.name in FALLING_RIGS]
    measured_m = _way_m(joints.columns[_SLIDE])
    first, last = (int(np.argmax(measured_m > way_m)) for way_m in (_MOVED_M, furthest_m))
    time_s = joints.stamp_s[first:last] - start_s
    if len(time_s) < _FEWEST:
        return 0.0
    steps = int((float(time_s[-1]) + _TOLERANCE_S) / step_s)
    simulated_m = _way_m(replay.Bodies(rig).follow(replay.air(rig, commands, steps)[1:]).position(names.CARRIAGE_JOINT))
    rising = np.flatnonzero(simulated_m > np.concatenate(([-1.0], np.maximum.accumulate(simulated_m)[:-1])))
    if simulated_m[rising[-1]] < furthest_m:
        return 0.0
    return float(np.median(time_s - np.interp(measured_m[first:last], simulated_m[rising], step_s * (rising + 1))))


def _way_m(slide_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the way from where the slide rested before it moved off."""
    moved = np.abs(slide_m - np.median(slide_m[:5])) > _MOVED_M
    rested = int(np.argmax(moved)) if moved.any() else len(slide_m)
    way_m: NDArray[np.float64] = np.abs(slide_m - np.median(slide_m[: max(rested, 5)]))
    return way_m


def _moved_off_s(topics: Mapping[str, Samples], rig: Rig) -> float | None:
    """Return the stamp, s, at which the slide began to move; None where it was not measured or never did."""
    joints = topics.get(names.JOINT_STATES.name)
    if joints is None or _SLIDE not in joints.columns:
        return None
    way_m = _way_m(joints.columns[_SLIDE])
    moved = np.flatnonzero(way_m > _MOVED_M)
    if not len(moved):
        return None
    at = int(moved[0])
    time_s, moved_m = float(joints.stamp_s[at]), float(way_m[at])
    if rig.name in FALLING_RIGS:
        return time_s - math.sqrt(2.0 * moved_m / STANDARD_GRAVITY_M_S2)
    ahead = min(at + 50, len(way_m) - 1)
    speed_m_s = (float(way_m[ahead]) - moved_m) / max(float(joints.stamp_s[ahead]) - time_s, 1e-9)
    return time_s - moved_m / speed_m_s if speed_m_s > 0.0 else time_s
