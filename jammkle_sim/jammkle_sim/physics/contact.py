"""Give and damping of floor and sole, in newtons and metres, whatever the mass of the foot.

MuJoCo's contact is `a + R f = a_ref` while it pushes, with `a_ref = -B v - K d r` and `R = w (1 - d) / d` for an
impedance `d` that may grow with the depth `r`, and the model's own estimate `w` of the inverse mass at the contact
(its manual, "Computation", "Solver parameters"). So it sinks by `R / (K d)` per newton, and has a damping of `B / R`.
A spring with a damper (Kelvin-Voigt) that is taken at the end of a time step `h` (implicit Euler) has
`R = give / (h (h + time))`, `time` being its damping over its stiffness, and never blows up.

What lies between floor and sole is in series with the contact that is there: gives add up. A contact that comes in
softly has no give of its own but one at each load; that at LOAD_N is taken. So the sum is exact at that load, and at
any other where the contact is linear or what lies between gives much more.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import brentq  # type: ignore[import-untyped]  # carries no types

from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from numpy.typing import NDArray

LOAD_N = 10.0
"""Load of one corner of the foot at which gives are compared: half of a leg of 1.8 kg on each of two, rounded."""
_DEEPEST_M = 0.1
"""No foot sinks deeper at that load."""


@dataclass(frozen=True)
class Softening:
    """What is otherwise about the contact of every corner of the foot."""

    give_m_n: float = 0.0
    """How much deeper it sinks per force, m/N: something elastic lies between floor and sole."""
    loss_s: float = 0.003
    """Time in which that comes back: its damping over its stiffness, s. Assumed: a loss factor of 0.3 at 15 Hz, as of
    rubber; means nothing without give."""
    damping: float = 1.0
    """Damping of the contact itself over what it was, 1; below 1 a blow bounces more."""


@dataclass(frozen=True)
class _Contact:
    """What a contact is like in MuJoCo's terms."""

    inverse_kg: float
    """`w`."""
    impedance: NDArray[np.float64]
    """`d`: at the surface, deep in, the depth of that, m, and the two numbers of the curve between; shape (5,)."""
    stiffness: float
    """`K d` over the share of `d` that is there, times the deepest `d`: the first of MuJoCo's direct format."""
    damping: float
    """`B` times the deepest `d`: the second of it."""

    def impedance_at(self, depth_m: float) -> float:
        """Return `d` at a depth, by MuJoCo's curve."""
        surface, deep, width_m, middle, power = self.impedance.tolist()
        way = min(depth_m / width_m, 1.0)
        if way <= middle:
            share = way**power / middle ** (power - 1.0)
        else:
            share = 1.0 - (1.0 - way) ** power / (1.0 - middle) ** (power - 1.0)
        return float(surface + share * (deep - surface))

    def resistance_kg(self, depth_m: float) -> float:
        """Return `R` at a depth, 1/kg."""
        impedance = self.impedance_at(depth_m)
        return self.inverse_kg * (1.0 - impedance) / impedance

    def force_n(self, depth_m: float) -> float:
        """Return the force at rest at a depth."""
        deep = float(self.impedance[1])
        return self.impedance_at(depth_m) * self.stiffness / deep**2 * depth_m / self.resistance_kg(depth_m)


def soften(model: Any, softening: Softening) -> None:
    """Change every contact of a model's feet.

    MuJoCo lets a foot that sticks creep, by more the more the contact gives and the less it is damped; the model's
    `impratio` is raised by as much, so that it creeps no more than before.

    Args:
        model: The mujoco.MjModel, changed in place; its feet are the geoms that rank above the floor.
        softening: What is otherwise.

    """
    feet = np.flatnonzero(model.geom_priority > 0)
    creeps = [_soften(model, int(geom), softening) for geom in feet]
    model.opt.impratio *= max([1.0, *creeps])


def _soften(model: Any, geom: int, softening: Softening) -> float:
    """Change one geom's contacts, and return by which factor it would creep more when it sticks."""
    step_s = float(model.opt.timestep)
    before = _contact(model, geom)
    depth_m = float(brentq(lambda each: before.force_n(each) - LOAD_N, 0.0, _DEEPEST_M, xtol=1e-15, rtol=1e-12))
    own_m_n, more_m_n = depth_m / LOAD_N, softening.give_m_n
    own_s = before.damping / float(before.impedance[1]) / before.resistance_kg(depth_m) * own_m_n
    # In series each gives its share of the way, so that times count by gives.
    give_m_n, damped_s = own_m_n + more_m_n, own_s * softening.damping
    time_s = (damped_s * own_m_n + (softening.loss_s + step_s) * more_m_n) / give_m_n
    # From the curve that it has to the one resistance of a spring and damper, by the share of what lies between.
    linear_kg, share = give_m_n / (step_s * (step_s + time_s)), more_m_n / give_m_n
    edges = before.impedance[:2]
    resistance_kg = (before.inverse_kg * (1.0 - edges) / edges) ** (1.0 - share) * linear_kg**share
    resistance_kg += max(1.0 - softening.damping, 0.0) * own_m_n / (step_s * (step_s + damped_s))
    impedance = before.impedance.copy()
    impedance[:2] = before.inverse_kg / (before.inverse_kg + resistance_kg)
    after = _Contact(before.inverse_kg, impedance, 1.0, 1.0)
    deep = float(impedance[1])
    model.geom_solimp[geom] = impedance
    model.geom_solref[geom] = (
        -LOAD_N / after.force_n(give_m_n * LOAD_N),
        -deep * after.resistance_kg(give_m_n * LOAD_N) * time_s / give_m_n,
    )
    return (give_m_n / time_s) / (own_m_n / own_s)


def _contact(model: Any, geom: int) -> _Contact:
    impedance = model.geom_solimp[geom].copy()
    impedance[:2] = np.clip(impedance[:2], mujoco.mjMINIMP, mujoco.mjMAXIMP)
    inverse_kg = float(model.body_invweight0[model.geom_bodyid[geom], 0])
    first, second = model.geom_solref[geom].tolist()
    if first > 0.0:
        time_s = max(first, 2.0 * float(model.opt.timestep))  # MuJoCo takes no shorter one
        return _Contact(inverse_kg, impedance, 1.0 / (time_s * second) ** 2, 2.0 / time_s)
    return _Contact(inverse_kg, impedance, -first, -second)
