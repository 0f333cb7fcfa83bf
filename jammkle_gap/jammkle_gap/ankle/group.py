"""Which recordings share signatures: those with whose machines the same was done, told coarsely.

Signatures are simulated once for a group of recordings and kept on disk. What a person sets the same every time, each
recording shows a little otherwise; told exactly, every recording would have signatures of its own. So what was measured
is rounded, by what moves a signature by no more than a bin of time or a tenth of its size. Where a setting lies on the
edge between two places of the rounding, its recordings fall into two groups.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from jammkle_common import names
from jammkle_gap.ankle.alike import HEIGHT, PITCH, PROGRAMME, driven, held_vacuum, length_s, scatter_of, switchings
from jammkle_gap.ankle.truth import inputs_of

if TYPE_CHECKING:
    from jammkle_gap.ankle.inputs import AnkleInputs
    from jammkle_gap.core.data import Recording

_SWITCHED_S = 0.1
"""Of the times at which solenoids switch, s. Chosen: programmes differ by tenths of a second, their repeats by ms."""
_VACUUM_PA = 5e3
"""Of pressures, Pa. Chosen: set points are round numbers, and held to 2 kPa."""
_HEIGHT_M, _PITCH_DEG = 0.005, 5.0
"""Of a drop height and of a hanging foot's pitch. Chosen: a tenth of what is usual."""
_DIGITS = 2
"""Of way and speed of a carriage that count. Chosen: what a person sets has no more."""
_LENGTH = math.sqrt(2.0)
"""Ratio of neighbouring lengths of a recording. Chosen: beyond its end a signature is taken to stay as it is."""


def group_of(recording: Recording) -> str:
    """Return text that is the same for recordings that share signatures."""
    inputs, end_s = inputs_of(recording), length_s(recording)
    held_pa, _ = held_vacuum(recording)
    parts = (
        inputs.rig,
        _options(inputs),
        inputs.ankle,
        [(channel, _switched(inputs, channel, end_s)) for channel in names.CHANNELS],
        None if held_pa is None else round(held_pa / _VACUUM_PA),
        None if inputs.start_pa is None else [round(each / _VACUUM_PA) for each in inputs.start_pa.tolist()],
        None if inputs.ambient_pa is None else round(inputs.ambient_pa / _VACUUM_PA),
        None if inputs.course is None else [f"{each:.{_DIGITS}g}" for each in driven(inputs.course, end_s)],
        round(math.log(end_s) / math.log(_LENGTH)),
        (inputs.release_seen_by, inputs.exact),
    )
    return repr(parts)


def _options(inputs: AnkleInputs) -> list[tuple[str, object]]:
    """Return the rig's options, but for its programme, of which the recording has what was done, and for scatter."""
    coarse = {HEIGHT: _HEIGHT_M, PITCH: _PITCH_DEG}
    hidden = (PROGRAMME | {"vacuum_pa"} | set(scatter_of(inputs))) - set(coarse)
    return [
        (name, round(float(value) / coarse[name]) if name in coarse else value)
        for name, value in inputs.options
        if name not in hidden
    ]


def _switched(inputs: AnkleInputs, channel: str, end_s: float) -> list[tuple[int, float]]:
    """Return when a solenoid switches, in tenths of a second, and to what; before the start, how it is then."""
    line = inputs.commands.solenoids.get(channel)
    if line is None:
        return []
    within = [(round(max(time_s, 0.0) / _SWITCHED_S), value) for time_s, value in switchings(line, end_s)]
    return [(0, line.at(0.0)), *within]
