"""Options of a rig that its recording shows: how far a leg fell, how its foot hung, which tendon was pulled."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_graph import names
from jammkle_graph.constants import STANDARD_GRAVITY_M_S2

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_gap.ankle.bag import Samples
    from jammkle_gap.ankle.spans import Span
    from jammkle_gap.ankle.told import Told

_HEIGHT, _PITCH, _CHANNEL = "drop_height_m", "pitch_deg", "channel"
_FALL_M = 0.005
"""Difference of a told drop height from what the time of the fall makes of it up to which it counts as right. Assumed:
five times what 1 ms of touch-down is after 0.1 s of fall."""
_FALL_SHARE = 0.1
"""The same as a share: friction of the slide and air make a fall longer."""
_PITCH_DEG = 3.0
"""Difference of the hanging foot's pitch from the rig's default up to which that is taken. Assumed: what a builder sets
by eye, and what a tendon's length makes of it."""


def with_fall(told: Told, span: Span, topics: Mapping[str, Samples], notes: list[str]) -> Told:
    """Return the options of a rig that lets go, with drop height and pitch as the run shows them.

    Args:
        told: What bag and user tell. A height that the user gives is kept; one that the bag gives, if the fall took as
            long as it says.
        span: The run.
        topics: What was measured.
        notes: What the reader should know is added.

    """
    options = dict(told.options)
    if span.fall_s is not None and _HEIGHT not in told.firm:
        fallen_m = 0.5 * STANDARD_GRAVITY_M_S2 * span.fall_s**2
        off_m = abs(fallen_m - float(options[_HEIGHT]))
        if _HEIGHT not in told.given or off_m > max(_FALL_M, _FALL_SHARE * float(options[_HEIGHT])):
            notes.append(f"drop height by the time of the fall: {1e3 * fallen_m:.1f} mm in {span.fall_s:.4f} s")
            told = told.with_option(_HEIGHT, fallen_m)
    pitch_deg = _pitch_deg(span, topics)
    if pitch_deg is None or _PITCH not in options or _PITCH in told.given:
        return told
    if abs(pitch_deg - float(options[_PITCH])) <= _PITCH_DEG:
        return told
    notes.append(f"pitch of the hanging foot as measured: {pitch_deg:.1f} degrees")
    return told.with_option(_PITCH, pitch_deg)


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
            return told.with_option(_CHANNEL, own[0])
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
    return told.with_option(_CHANNEL, chosen)


def _pitch_deg(span: Span, topics: Mapping[str, Samples]) -> float | None:
    joints = topics.get(names.JOINT_STATES.name)
    if joints is None or "ankle_pitch/position" not in joints.columns or span.release_s is None:
        return None
    stamp_s, angle_rad = joints.readings("ankle_pitch/position")
    hanging = (stamp_s >= span.start_s) & (stamp_s < span.release_s)
    return math.degrees(float(np.median(angle_rad[hanging]))) if hanging.any() else None


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
