"""A foot that hangs in the air on its ball joint and four tendons: small angles, no contact."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_graph import names
from jammkle_graph.constants import STANDARD_GRAVITY_M_S2
from jammkle_sim.reality.compiled import compiled
from jammkle_sim.reality.tendon import bristle_n, tendon_law, tendon_state, tendon_tension_n

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from jammkle_sim.reality.faults import Era
    from jammkle_sim.reality.machine import Ankle
    from jammkle_sim.reality.tendon import TendonLaw, TendonState

JOINTS = names.ANKLE_JOINTS
"""Roll, pitch, yaw."""
_SUBSTEPS = 2
"""Steps per row of the vacuum's history."""
_GIVE_RAD = 0.002
"""Angle over which the dry friction of the joint builds up. Assumed."""
_SETTLING = 8
"""How often the foot is let swing and its tendons relax before a run."""
_SETTLING_ROWS = 400


@dataclass(frozen=True)
class Hanging:
    """How the foot moved, a row per row of the vacuum's history."""

    angle_rad: NDArray[np.float64]
    """Roll, pitch, yaw, shape (n, 3)."""
    extension_m: NDArray[np.float64]
    """Beyond the free length as drawn, shape (n, tendons)."""
    tension_n: NDArray[np.float64]
    """Shape (n, tendons)."""


def hang(periods: Sequence[Era], vacuum_pa: NDArray[np.float64], row_s: float) -> Hanging:
    """Let the foot hang, from rest, while the vacuum comes and goes.

    Args:
        periods: The machine over time.
        vacuum_pa: Of each channel, shape (n, channels).
        row_s: Between two rows of it.

    """
    step_s = row_s / _SUBSTEPS
    channel = np.array([names.CHANNELS.index(each) for each in names.CHANNELS for _ in names.TENDONS_OF_CHANNEL[each]])
    first = periods[0].machine
    sites_m, free_m = sites(first.ankle)
    laws = _laws(periods[0], step_s)
    states = tuple(tendon_state(law, _pretension_m(first.ankle, i)) for i, law in enumerate(laws))
    angle, rate, dry = np.zeros(3), np.zeros(3), np.zeros(3)
    still = np.zeros((_SETTLING_ROWS, vacuum_pa.shape[1]))
    rows = np.zeros((_SETTLING_ROWS, 11))
    for _ in range(_SETTLING):
        _swing(laws, states, _constants(first.ankle), sites_m, free_m, channel, still, step_s, angle, rate, dry, rows)
        rate[:] = 0.0
        for state in states:
            state.branch_pa[:] = 0.0
            state.stretched[:] = 0.0
    rows = np.zeros((len(vacuum_pa), 11))
    start = 0
    for i, period in enumerate(periods):
        end_s = periods[i + 1].start_s if i + 1 < len(periods) else math.inf
        end = len(vacuum_pa) if end_s == math.inf else min(len(vacuum_pa), math.ceil(end_s / row_s))
        if end <= start:
            continue
        laws, ankle = _laws(period, step_s), period.machine.ankle
        for state in states:
            state.more[0] = 0.0
        sites_m, free_m = sites(ankle)
        part, out = vacuum_pa[start:end], rows[start:end]
        _swing(laws, states, _constants(ankle), sites_m, free_m, channel, part, step_s, angle, rate, dry, out)
        start = end
    return Hanging(rows[:, :3], rows[:, 3:7], rows[:, 7:])


def sites(ankle: Ankle) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where tendons meet the foot, shape (tendons, 3), m, and their free lengths, shape (tendons,), m."""
    back, spread = -ankle.achilles_arm_m, ankle.achilles_spread_m
    front, side = ankle.peroneal_forward_m, ankle.peroneal_spread_m
    places = np.array([(front, side, 0.0), (front, -side, 0.0), (back, spread, 0.0), (back, -spread, 0.0)])
    free_m = np.array([ankle.tendon_length_m - _pretension_m(ankle, i) for i in range(len(names.TENDONS))])
    return places, free_m


def _pretension_m(ankle: Ankle, tendon: int) -> float:
    """Extension at the neutral pose: that of the peroneal tendons balances the Achilles pair by its lever."""
    peroneal_m = ankle.achilles_pretension_m * ankle.achilles_arm_m / ankle.peroneal_forward_m
    return ankle.achilles_pretension_m if names.TENDONS[tendon].startswith(names.ACHILLES) else peroneal_m


def _laws(period: Era, step_s: float) -> tuple[TendonLaw, ...]:
    return tuple(tendon_law(make, step_s) for make in period.machine.tendons)


def _constants(ankle: Ankle) -> NDArray[np.float64]:
    return np.array([*ankle.foot_inertia_kg_m2, *ankle.foot_centre_m, ankle.foot_kg, ankle.joint_viscous_n_m_s,
                     ankle.joint_dry_n_m, ankle.tendon_length_m])  # fmt: skip


@compiled
def turned(angle: Any, point: Any, found: Any) -> None:
    """Write a point of the foot in the frame of the leg: pitch, then roll, then yaw, each about the turned axis."""
    cr, sr = math.cos(angle[0]), math.sin(angle[0])
    cp, sp = math.cos(angle[1]), math.sin(angle[1])
    cy, sy = math.cos(angle[2]), math.sin(angle[2])
    x, y, z = cy * point[0] - sy * point[1], sy * point[0] + cy * point[1], point[2]
    y, z = cr * y - sr * z, sr * y + cr * z
    found[0], found[1], found[2] = cp * x + sp * z, y, cp * z - sp * x


@compiled
def _moment(angle: Any, at: Any, force: Any, torque: Any) -> None:
    """Add what a force at a point, both in the frame of the leg, does about roll, pitch and yaw."""
    mx = at[1] * force[2] - at[2] * force[1]
    my = at[2] * force[0] - at[0] * force[2]
    mz = at[0] * force[1] - at[1] * force[0]
    cr, sr = math.cos(angle[0]), math.sin(angle[0])
    cp, sp = math.cos(angle[1]), math.sin(angle[1])
    torque[0] += cp * mx - sp * mz
    torque[1] += my
    torque[2] += sp * cr * mx - sr * my + cp * cr * mz


@compiled
def _swing(
    laws: Any, states: Any, body: Any, sites_m: Any, free_m: Any, channel: Any, vacuum_pa: Any, step_s: float,
    angle: Any, rate: Any, dry: Any, rows: Any,
) -> None:  # fmt: skip
    """Move the foot by a row of the vacuum at a time: speeds first, then angles (symplectic Euler)."""
    at, force, torque = np.zeros(3), np.zeros(3), np.zeros(3)
    centre = body[3:6]
    for row in range(vacuum_pa.shape[0]):
        for _ in range(_SUBSTEPS):
            torque[:] = 0.0
            for i in range(sites_m.shape[0]):
                turned(angle, sites_m[i], at)
                force[0], force[1] = sites_m[i, 0] - at[0], sites_m[i, 1] - at[1]
                force[2] = body[9] - at[2]
                length_m = math.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2)
                extension_m = length_m - free_m[i]
                tension_n = tendon_tension_n(laws[i], states[i], extension_m, vacuum_pa[row, channel[i]])
                rows[row, 3 + i] = extension_m
                rows[row, 7 + i] = tension_n
                for axis in range(3):
                    force[axis] *= tension_n / length_m
                _moment(angle, at, force, torque)
            turned(angle, centre, at)
            force[0], force[1], force[2] = 0.0, 0.0, -body[6] * STANDARD_GRAVITY_M_S2
            _moment(angle, at, force, torque)
            for axis in range(3):
                dry[axis], _ = bristle_n(dry[axis], rate[axis] * step_s, body[8], body[8] / _GIVE_RAD)
                slowed = 1.0 + step_s * body[7] / body[axis]
                rate[axis] = (rate[axis] + step_s * (torque[axis] - dry[axis]) / body[axis]) / slowed
                angle[axis] += step_s * rate[axis]
        for axis in range(3):
            rows[row, axis] = angle[axis]
