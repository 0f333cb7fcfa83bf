"""Which runs are repeats: those whose machine was made to do the same."""

from __future__ import annotations

import dataclasses
import itertools
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common import names
from jammkle_gap.ankle.alike import (
    HEIGHT,
    PITCH,
    PROGRAMME,
    difference,
    driven,
    held_vacuum,
    length_s,
    scatter_of,
    short,
)
from jammkle_gap.ankle.truth import inputs_of
from jammkle_sim.rigs.catalogue import rig_kind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_gap.core.data import Recording


def with_settings(recordings: Sequence[Recording]) -> tuple[Recording, ...]:
    """Return recordings with their settings: the same text for those that are repeats of the first of their kind.

    What a person set once for all runs of a setting, and each recording shows a little otherwise, is then common to
    them: the pitch of the hanging foot, and a drop height that the time of the fall alone tells of. A fault that moves
    these stays visible. Where some of the repeats bear out what was told, it holds for all of them.
    """
    groups: list[list[int]] = []
    for i, recording in enumerate(recordings):
        own = next((group for group in groups if not difference(recordings[group[0]], recording)), None)
        if own is None:
            groups.append([i])
        else:
            own.append(i)
    found = list(recordings)
    texts: list[str] = []
    for group in groups:
        repeats = [recordings[i] for i in group]
        common = [_set_in_common(each, repeats) for each in repeats]
        plain = setting_text(common[0])
        numbered = (f"{plain} ({number})" for number in itertools.count(2))
        texts.append(next(text for text in itertools.chain([plain], numbered) if text not in texts))
        for i, each in zip(group, common, strict=True):
            found[i] = dataclasses.replace(each, setting=texts[-1])
    return tuple(found)


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
        range_m, fast_m_s = driven(inputs.course, length_s(recording))
        parts.append(f"{1e3 * range_m:.1f} mm at {1e3 * fast_m_s:.3g} mm/s")
    if HEIGHT in defaults:
        parts.append(f"{1e3 * float(dict(inputs.options)[HEIGHT]):.0f} mm")
    return ", ".join(parts)


def _set_in_common(recording: Recording, repeats: Sequence[Recording]) -> Recording:
    """Return a recording with what was set once for all of its repeats, and what each of them shows otherwise."""
    inputs = inputs_of(recording)
    by_imu = inputs.release_seen_by == names.IMU.name
    options, measured, notes = dict(inputs.options), inputs.measured, recording.notes
    for name in sorted({PITCH, HEIGHT} & inputs.measured):
        taken = [(dict(inputs_of(each).options)[name], name in inputs_of(each).measured) for each in repeats]
        as_told = [value for value, is_measured in taken if not is_measured]
        if as_told:
            options[name], measured = float(np.median(as_told)), measured - {name}
            borne_out = f"{len(as_told)} of {len(taken)} repeats bear it out"
            notes = (*notes, f"{name} is taken as told, {short(options[name])}: {borne_out}")
        elif name == PITCH or by_imu:
            options[name] = float(np.median([value for value, _ in taken]))
    inputs = dataclasses.replace(inputs, options=tuple(sorted(options.items())), measured=measured)
    return dataclasses.replace(recording, inputs=inputs, notes=notes)
