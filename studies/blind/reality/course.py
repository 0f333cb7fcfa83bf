"""A leg on its way: bodies and tendons advanced together, and what could be seen of them at every tendon step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from studies.blind.reality.bodies import TENDONS, ankle_angles_rad, ankle_rates_rad_s
from studies.blind.reality.compiled import compiled
from studies.blind.reality.motion import advance, lengths_and_rates
from studies.blind.reality.tendon import tendon_tension_n

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

_FORCE, _CELL, _HEIGHT, _RISE, _LEG, _FOOT, _SPIN, _LENGTH, _RATE, _PULL, _TORN = 0, 1, 4, 5, 6, 15, 24, 30, 34, 38, 42
"""Where things begin in a row."""
_WIDTH = 46
_PIN_N = 0.5
"""Tension below which a pin in a worn hole does not slide. Assumed: its dry friction."""
_PIN_N_S_M = 100.0
"""Tension beyond that per speed of sliding. Assumed: greased plastic."""
_PIN_BACK_S = 0.03
"""Time in which the pin of a slack tendon slides back. Assumed."""


@dataclass(frozen=True)
class Truth:
    """What happened, at even times. Row i stands for the time from time_s[i] - step to time_s[i]."""

    time_s: Floats
    """Shape (n,)."""
    specific_force_m_s2: Floats
    """Of the carriage along the world's axes, mean over the row, shape (n, 3)."""
    cell_n: Floats
    """Load cell in its own axes, mean over the row; pulled is positive on z, shape (n, 3)."""
    height_m: Floats
    height_m_s: Floats
    angle_rad: Floats
    """Roll, pitch, yaw of the ankle, shape (n, 3)."""
    angle_rad_s: Floats
    leg_pitch_rad: Floats
    """Of the leg in the world."""
    extension_m: Floats
    """Of the tendons between their seats, shape (n, TENDONS)."""
    extension_m_s: Floats
    tension_n: Floats
    torn: Floats
    """1 where a tendon is torn."""


def truth(rows: Floats, free_m: Floats, time_s: Floats) -> Truth:
    """Return the rows that `go` wrote, sorted.

    Args:
        rows: Shape (n, columns).
        free_m: Lengths at which the tendons begin to pull, shape (TENDONS,).
        time_s: At the end of each row, shape (n,).

    """
    count = len(rows)
    leg, foot = rows[:, _LEG:_FOOT].reshape(count, 3, 3), rows[:, _FOOT:_SPIN].reshape(count, 3, 3)
    angle_rad = ankle_angles_rad(leg, foot)
    spin_rad_s = rows[:, _SPIN + 3 : _LENGTH] - rows[:, _SPIN : _SPIN + 3]
    force = np.zeros((count, 3))
    force[:, 2] = rows[:, _FORCE]
    return Truth(
        time_s=time_s,
        specific_force_m_s2=force,
        cell_n=rows[:, _CELL:_HEIGHT],
        height_m=rows[:, _HEIGHT],
        height_m_s=rows[:, _RISE],
        angle_rad=angle_rad,
        angle_rad_s=ankle_rates_rad_s(angle_rad, leg, spin_rad_s),
        leg_pitch_rad=np.arctan2(leg[:, 0, 2], leg[:, 2, 2]),
        extension_m=rows[:, _LENGTH:_RATE] - free_m,
        extension_m_s=rows[:, _RATE:_PULL],
        tension_n=rows[:, _PULL:_TORN],
        torn=rows[:, _TORN:],
    )


def new_rows(count: int) -> Floats:
    """Return room for what `go` writes."""
    return np.zeros((count, _WIDTH))


@compiled
def go(  # noqa: PLR0913, PLR0917  # plain numbers keep the door to compiled code cheap
    laws: Any,
    states: Any,
    tendon_laws: Any,
    tendon_states: Any,
    free_m: Any,
    pin_play_m: Any,
    pin_m: Any,
    vacuum_pa: Any,
    inner_steps: int,
    step_s: float,
    is_held: bool,  # noqa: FBT001  # numba takes no keyword
    drive_m: Any,
    has_tendons: bool,  # noqa: FBT001  # as above
    rows: Any,
) -> None:
    """Advance a leg by as many tendon steps as there are rows.

    Args:
        laws: `Law.packed`.
        states: Changed, shape (1,) of STATE.
        tendon_laws: One per tendon, for this step; a tuple.
        tendon_states: One per tendon, changed; a tuple.
        free_m: Lengths at which the tendons begin to pull, shape (TENDONS,).
        pin_play_m: How far the pin of each tendon can slide, shape (TENDONS,).
        pin_m: How far it has, changed, shape (TENDONS,).
        vacuum_pa: In each tendon at each row, shape (n, TENDONS).
        inner_steps: Of the bodies, per step of the tendons.
        step_s: Of the tendons.
        is_held: The carriage does not move.
        drive_m: Where the spindle is at each row, and one more, shape (n + 1,).
        has_tendons: Whether the tendons are there.
        rows: Written, from `new_rows`.

    """
    state = states[0]
    pull_n, length_m, rate_m_s = np.zeros(TENDONS), np.zeros(TENDONS), np.zeros(TENDONS)
    gravity = laws[0].gravity_m_s2
    for row in range(rows.shape[0]):
        lengths_and_rates(laws, states, length_m, rate_m_s)
        if has_tendons:
            for i in range(TENDONS):
                pin_m[i] = _pinned_m(pin_m[i], pin_play_m[i], pull_n[i], step_s)
                extension_m = length_m[i] - free_m[i] - pin_m[i]
                pull_n[i] = tendon_tension_n(tendon_laws[i], tendon_states[i], extension_m, vacuum_pa[row, i])
        before_m_s = state.speed[0]
        speed_m_s = (drive_m[row + 1] - drive_m[row]) / step_s
        advance(laws, states, pull_n, inner_steps, step_s / inner_steps, is_held, drive_m[row], speed_m_s)
        lengths_and_rates(laws, states, length_m, rate_m_s)
        rows[row, _FORCE] = (state.speed[0] - before_m_s) / step_s + gravity
        _note(state, length_m, rate_m_s, pull_n, rows[row])
        for i in range(TENDONS):
            rows[row, _TORN + i] = tendon_states[i].more[1]


@compiled
def _pinned_m(pin_m: float, play_m: float, pull_n: float, step_s: float) -> float:
    """Return how far a pin has slid in its worn hole: pulled along, and back when its tendon is slack."""
    if play_m <= 0.0:
        return 0.0
    if pull_n > _PIN_N:
        return min(pin_m + (pull_n - _PIN_N) / _PIN_N_S_M * step_s, play_m)
    if pull_n <= 0.0:
        return pin_m * (1.0 - step_s / _PIN_BACK_S)
    return pin_m


@compiled
def _note(state: Any, length_m: Any, rate_m_s: Any, pull_n: Any, out: Any) -> None:
    """Write what is seen of a state into a row."""
    out[_HEIGHT] = state.height_m
    out[_RISE] = state.speed[0]
    for i in range(3):
        out[_CELL + i] = state.cell_n[i]
        for j in range(3):
            out[_LEG + 3 * i + j] = state.leg_turn[i, j]
            out[_FOOT + 3 * i + j] = state.foot_turn[i, j]
    for i in range(6):
        out[_SPIN + i] = state.speed[1 + i]
    for i in range(TENDONS):
        out[_LENGTH + i] = length_m[i]
        out[_RATE + i] = rate_m_s[i]
        out[_PULL + i] = pull_n[i]
