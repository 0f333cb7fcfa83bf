"""Give and damping of floor and sole: in newtons and metres, passive, and nothing where nothing is given."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_sim.physics.contact import LOAD_N, Softening, soften
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.rigs.model import new_spec

STEP_S = 0.0005
CONTACTS = {"standard": (0.004, 1.0), "direct": (-60000.0, -400.0)}
"""Contacts to begin with, in both of MuJoCo's formats."""
CURVES = {"linear": (0.5, 0.5, 0.001, 0.5, 2.0), "soft": (0.1, 0.95, 0.001, 0.5, 2.0)}
"""Impedances to begin with: the same at any depth, and one that comes in softly."""


def ball(
    mass_kg: float, softening: Softening, height_m: float = 0.0, contact: str = "standard", curve: str = "soft"
) -> Any:
    """A ball that falls onto level ground, its contact softened."""
    spec = new_spec("ball", STEP_S)
    spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(1.0, 1.0, 0.1))
    body = spec.worldbody.add_body(name="ball", pos=(0.0, 0.0, 0.01 + height_m))
    body.mass, body.inertia, body.explicitinertial = mass_kg, (1e-4,) * 3, True
    body.ipos = (0.0, 0.0, 0.0)
    body.add_joint(name="way", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0.0, 0.0, 1.0))
    body.add_geom(
        name="sole", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=(0.01, 0.0, 0.0), mass=0.0, priority=1,
        solref=CONTACTS[contact], solimp=CURVES[curve],
    )  # fmt: skip
    model = spec.compile()
    soften(model, softening)
    return model


def heights_m(model: Any, time_s: float) -> np.ndarray:
    """Height of the ball's lowest point over time, m."""
    data = mujoco.MjData(model)
    found = []
    for _ in range(round(time_s / STEP_S)):
        mujoco.mj_step(model, data)
        found.append(float(data.body("ball").xpos[2]) - 0.01)
    return np.array(found)


def sunk_m(mass_kg: float, give_m_n: float, contact: str, curve: str) -> float:
    """How much deeper a ball comes to rest with something between."""
    bare, soft = (
        heights_m(ball(mass_kg, Softening(give_m_n=each, loss_s=0.005), contact=contact, curve=curve), 3.0)[-1]
        for each in (0.0, give_m_n)
    )
    return float(bare - soft)


@pytest.mark.parametrize("contact", CONTACTS)
@pytest.mark.parametrize("mass_kg", [0.1, 2.0])
@pytest.mark.parametrize("give_m_n", [1e-5, 3e-4])
def test_what_lies_between_gives_by_its_stiffness_whatever_the_mass(
    contact: str, mass_kg: float, give_m_n: float
) -> None:
    """At rest the sole sinks by its load times the give, more than without; MuJoCo's own contact goes by the mass."""
    load_n = mass_kg * STANDARD_GRAVITY_M_S2
    assert sunk_m(mass_kg, give_m_n, contact, "linear") == pytest.approx(load_n * give_m_n, rel=0.01)


@pytest.mark.parametrize("contact", CONTACTS)
@pytest.mark.parametrize("give_m_n", [1e-6, 1e-5, 1e-4, 5e-4])
def test_a_contact_that_comes_in_softly_gives_by_as_much_at_its_load(contact: str, give_m_n: float) -> None:
    """As above, at the load that gives are compared at; at half and twice of it by a half to twice as much."""
    mass_kg = LOAD_N / STANDARD_GRAVITY_M_S2
    assert sunk_m(mass_kg, give_m_n, contact, "soft") == pytest.approx(LOAD_N * give_m_n, rel=0.02)
    for factor in (0.5, 2.0):
        sunk = sunk_m(factor * mass_kg, give_m_n, contact, "soft") / (factor * LOAD_N * give_m_n)
        assert 0.5 < sunk < 2.0


def rebound_m(softening: Softening) -> float:
    """How high a ball comes back that fell from 50 mm."""
    height_m = heights_m(ball(1.0, softening, height_m=0.05), 0.6)
    return float(height_m[int(height_m.argmin()) :].max())


def test_a_soft_contact_is_passive() -> None:
    """Nothing comes back from higher than it fell; the more is lost the less comes back, the less damped the more."""
    losses = [rebound_m(Softening(give_m_n=1e-4, loss_s=loss_s)) for loss_s in (0.0005, 0.002, 0.01)]
    assert 0.05 > losses[0] > losses[1] > losses[2] >= 0.0
    dampings = [rebound_m(Softening(damping=damping)) for damping in (1.0, 0.3, 0.1, 0.03)]
    assert dampings[0] < dampings[1] < dampings[2] < dampings[3] < 0.05


def test_a_little_give_changes_a_blow_a_little() -> None:
    """The way of a falling ball moves in proportion to the give, and to the damping."""
    bare = heights_m(ball(1.0, Softening(), height_m=0.05), 0.2)
    for small, twice in (
        (Softening(give_m_n=1e-8), Softening(give_m_n=2e-8)),
        (Softening(damping=0.999), Softening(damping=0.998)),
    ):
        one, two = (heights_m(ball(1.0, each, height_m=0.05), 0.2) - bare for each in (small, twice))
        assert 0.0 < np.abs(one).max() < 1e-4
        assert np.abs(two - 2.0 * one).max() < 0.1 * np.abs(two).max()


def test_no_give_is_the_contact_itself() -> None:
    """Without anything between, and its own damping, the model behaves as before to the rounding."""
    bare = heights_m(ball(1.0, Softening(), height_m=0.05), 0.2)
    never = heights_m(ball(1.0, Softening(give_m_n=0.0, damping=1.0), height_m=0.05, contact="standard"), 0.2)
    assert np.abs(bare - never).max() < 1e-12
