"""Options of a rig that its recording shows: how far a leg fell, how its foot hung, which tendon was pulled."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common import names
from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_gap.ankle.signals import CARRIAGE

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from jammkle_gap.ankle.bag import Samples
    from jammkle_gap.ankle.spans import Span
    from jammkle_gap.ankle.told import Told

_HEIGHT, _PITCH, _CHANNEL = "drop_height_m", "pitch_deg", "channel"
_ANGLE = "ankle_pitch/position"
_FALL_M, _FALL_SHARE = 0.005, 0.1
"""Difference of a told drop height from the measured one up to which it counts as right. Assumed: what geometry and
zero of a carriage leave open; as a share, what a person rounds to."""
_ZERO_M = 0.025
"""Difference of the heights by where the carriage hung and by how far it fell up to which its zero is taken to be the
ground's. Assumed: a bent toe, a tilted floor or a foot that hangs askew touch down within; a carriage zeroed elsewhere
is further off."""
_PITCH_DEG = 8.0
"""Difference of the hanging foot's pitch from the rig's default up to which that is taken. Assumed: twice what a
builder's tolerances and a tendon of wrong length make of it; what a person sets otherwise is more."""
_HELD_S, _STILL_S = 0.15, 0.01
"""From how long before a release to how long before it the carriage is read as it hangs."""


def with_fall(
    told: Told, span: Span, topics: Mapping[str, Samples], start_m: Callable[[Told], float], notes: list[str]
) -> Told:
    """Return the options of a rig that lets go, with pitch and drop height as the run shows them.

    The height is that at which the carriage hung, above where the rig's foot touches: a fault of foot, floor or slide
    does not change it. It is how far the carriage fell, if its zero is not the ground's, and how long, without one.

    Args:
        told: What bag and user tell. What the user gives is kept; a height that the bag gives, if the carriage agrees.
            Whether it does may hang by a hair, so repeats settle it together: `setting.with_settings`.
        span: The run.
        topics: What was measured.
        start_m: Tells where a rig's carriage hangs, m.
        notes: What the reader should know is added.

    """
    told = _with_pitch(told, span, topics, notes)
    if _HEIGHT in told.firm:
        return told
    height_m = float(dict(told.options)[_HEIGHT])
    by_carriage = _by_carriage(span, topics, start_m(told) - height_m)
    if by_carriage is not None:
        measured_m, how = by_carriage
        told = told.with_shown(_HEIGHT, measured_m)
        is_right = abs(measured_m - height_m) <= max(_FALL_M, _FALL_SHARE * height_m)
        if _HEIGHT in told.given and is_right:
            return told
        notes.append(f"drop height by {how}: {1e3 * measured_m:.1f} mm")
        return told.with_measured(_HEIGHT, measured_m)
    if _HEIGHT in told.given or span.fall_s is None:
        return told
    fallen_m = 0.5 * STANDARD_GRAVITY_M_S2 * span.fall_s**2
    notes.append(f"drop height by the time of the fall: {1e3 * fallen_m:.1f} mm in {span.fall_s:.4f} s")
    return told.with_measured(_HEIGHT, fallen_m)


def _with_pitch(told: Told, span: Span, topics: Mapping[str, Samples], notes: list[str]) -> Told:
    options, joints = dict(told.options), topics.get(names.JOINT_STATES.name)
    if joints is None or _ANGLE not in joints.columns or _PITCH not in options or _PITCH in told.given:
        return told
    stamp_s, angle_rad = joints.readings(_ANGLE)
    hanging = (stamp_s >= span.start_s) & (stamp_s < (span.start_s if span.release_s is None else span.release_s))
    if not hanging.any():
        return told
    pitch_deg = math.degrees(float(np.median(angle_rad[hanging])))
    told = told.with_shown(_PITCH, pitch_deg)
    if abs(pitch_deg - float(options[_PITCH])) <= _PITCH_DEG:
        return told
    notes.append(f"pitch of the hanging foot as measured: {pitch_deg:.1f} degrees")
    return told.with_measured(_PITCH, pitch_deg)


def _by_carriage(span: Span, topics: Mapping[str, Samples], touch_m: float) -> tuple[float, str] | None:
    """Return the drop height, m, that the carriage shows, and how; None if there is none.

    Args:
        span: The run.
        topics: What was measured.
        touch_m: Where the rig's carriage is as its foot touches.

    """
    joints = topics.get(names.JOINT_STATES.name)
    if joints is None or CARRIAGE not in joints.columns or span.release_s is None:
        return None
    stamp_s, carriage_m = joints.readings(CARRIAGE)
    held = (stamp_s > span.release_s - _HELD_S) & (stamp_s < span.release_s - _STILL_S)
    if not held.any():
        return None
    hung_m = float(np.median(carriage_m[held]))
    if span.fall_s is None:
        return max(hung_m - touch_m, 0.0), "where the carriage hung"
    way_m = hung_m - float(np.interp(span.release_s + span.fall_s, stamp_s, carriage_m))
    if abs(hung_m - touch_m - way_m) > _ZERO_M or hung_m < touch_m:
        return max(way_m, 0.0), "the way of the carriage, whose zero is not that of the rig"
    return hung_m - touch_m, "where the carriage hung"


def with_channel(told: Told, span: Span, topics: Mapping[str, Samples], notes: list[str]) -> Told:
    """Return the options of the tensile rig with the channel that its tendon hangs on: the one that is evacuated.

    Args:
        told: What bag and user tell; a channel that they name is kept.
        span: The run.
        topics: Commands and what was measured.
        notes: What the reader should know is added.

    """
    if _CHANNEL in told.given:
        return told
    instrumented = topics.get(names.TENDON_STATES.name)
    if instrumented is not None:
        wired = {column.partition("/")[0] for column in instrumented.columns}
        own = [channel for channel, tendons in names.TENDONS_OF_CHANNEL.items() if wired & set(tendons)]
        if len(own) == 1:
            return told.with_measured(_CHANNEL, own[0])
    drawn = [channel for channel in names.CHANNELS if _is_drawn(topics, channel, span)]
    if not drawn:
        return told
    depths_pa = {channel: _depth_pa(topics, channel, span) for channel in drawn}
    chosen = max(drawn, key=lambda channel: depths_pa[channel])
    if len(drawn) > 1:
        note = (
            f"several channels are evacuated ({', '.join(drawn)}): the tendon is taken to hang on {chosen}, the deepest"
        )
        notes.append(note + "; name it with --set channel=")
    return told.with_measured(_CHANNEL, chosen)


def _is_drawn(topics: Mapping[str, Samples], channel: str, span: Span) -> bool:
    solenoid = topics.get(names.SOLENOIDS[channel].name)
    if solenoid is None:
        return False
    within = (solenoid.log_s >= span.start_s) & (solenoid.log_s <= span.end_s)
    before = np.flatnonzero(solenoid.log_s < span.start_s)
    values: Any = solenoid.columns["data"]
    return bool((values[within] > 0.0).any() or (len(before) and values[before[-1]] > 0.0))


def _depth_pa(topics: Mapping[str, Samples], channel: str, span: Span) -> float:
    """Return the mean vacuum of a channel over a run, Pa, but for the atmosphere."""
    pressure = topics.get(names.PRESSURES[channel].name)
    if pressure is None:
        return -math.inf
    within = (pressure.stamp_s >= span.start_s) & (pressure.stamp_s <= span.end_s)
    return -float(pressure.columns["pressure"][within].mean()) if within.any() else -math.inf
