"""Which runs are repeats: those whose machine was made to do the same."""

from __future__ import annotations

import dataclasses
import itertools
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_gap.ankle.alike import (
    COMPARED_S,
    HEIGHT,
    PITCH,
    PROGRAMME,
    STILL_M,
    difference,
    held_vacuum,
    length_s,
    scatter_of,
    short,
)
from jammkle_gap.ankle.truth import inputs_of
from jammkle_graph import names
from jammkle_sim.rigs.catalogue import rig_kind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_gap.core.data import Recording


def with_settings(recordings: Sequence[Recording]) -> tuple[Recording, ...]:
    """Return recordings with their settings: the same text for those that are repeats of the first of their kind.

    What a person set once for all runs of a setting, and each recording shows a little otherwise, is then common to
    them: the pitch of the hanging foot, and a drop height that the time of the fall alone tells of. A fault that moves
    these stays visible.
    """
    firsts: list[Recording] = []
    texts: list[str] = []
    found = []
    for recording in recordings:
        same = [text for first, text in zip(firsts, texts, strict=True) if not difference(first, recording)]
        if not same:
            plain = setting_text(recording)
            numbered = (f"{plain} ({number})" for number in itertools.count(2))
            same = [next(text for text in itertools.chain([plain], numbered) if text not in texts)]
            firsts.append(recording)
            texts.append(same[0])
        found.append(dataclasses.replace(recording, setting=same[0]))
    return tuple(_set_in_common(each, [other for other in found if other.setting == each.setting]) for each in found)


def setting_text(recording: Recording) -> str:
    """Return a short text of what a machine was made to do."""
    inputs = inputs_of(recording)
    kind = rig_kind(inputs.rig)
    defaults: dict[str, Any] = dataclasses.asdict(kind.options())
    hidden = PROGRAMME | set(scatter_of(inputs)) | {"vacuum_pa", HEIGHT, "timestep_s", "parameter_set"}
    parts = [inputs.rig]
    for name, value in inputs.options:
        if name not in hidden and value != defaults[name]:
            is_word = isinstance(value, str) and value not in {"yes", "no"}
            parts.append(str(value) if is_word else f"{name} {short(value)}")
    held_pa, _ = held_vacuum(recording)
    parts.append("not jammed" if held_pa is None else f"{1e-3 * held_pa:.0f} kPa")
    if inputs.course is not None:
        time_s = np.arange(0.0, length_s(recording), COMPARED_S)
        range_m = float(np.ptp(inputs.course.position_m))
        speeds_m_s = np.abs(np.diff(inputs.course.at(time_s))) / COMPARED_S
        fast_m_s = float(np.median(speeds_m_s[speeds_m_s > 0.5 * speeds_m_s.max()])) if range_m > STILL_M else 0.0
        parts.append(f"{1e3 * range_m:.1f} mm at {1e3 * fast_m_s:.3g} mm/s")
    if HEIGHT in defaults:
        parts.append(f"{1e3 * float(dict(inputs.options)[HEIGHT]):.0f} mm")
    return ", ".join(parts)


def _set_in_common(recording: Recording, repeats: Sequence[Recording]) -> Recording:
    """Return a recording with the medians over its repeats of what was set once and measured in each."""
    inputs = inputs_of(recording)
    by_imu = inputs.release_seen_by == names.IMU.name
    common = {PITCH, HEIGHT} if by_imu else {PITCH}
    options = dict(inputs.options)
    for name in common & inputs.measured:
        options[name] = float(np.median([dict(inputs_of(each).options)[name] for each in repeats]))
    return dataclasses.replace(recording, inputs=dataclasses.replace(inputs, options=tuple(sorted(options.items()))))
