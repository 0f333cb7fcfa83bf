"""Changes to bodies, joints and contacts: on a copy of MuJoCo's model."""

from __future__ import annotations

import copy
import dataclasses
from typing import TYPE_CHECKING, Any

from jammkle_common.names import ANKLE_JOINTS
from jammkle_sim.physics.ankle import joint_law
from jammkle_sim.physics.contact import Softening, soften
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.rigs.rig import laws_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_sim.rigs.rig import Rig

_LEAST_KG = 0.01
"""What a body keeps, kg, whatever is taken off it."""


def add_payload(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Add `mass_kg` to the carriage."""
    model = copy.copy(rig.model)
    carriage = model.body("carriage").id
    before_kg = float(model.body_mass[carriage])
    after_kg = max(before_kg + values["mass_kg"], _LEAST_KG)
    model.body_mass[carriage] = after_kg
    model.body_inertia[carriage] *= after_kg / before_kg
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return dataclasses.replace(rig, model=model)


def rub_joint(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Add dry friction `coulomb_n_m`, which takes `breakaway` more to set it moving, and damping `viscous_n_m_s`.

    Friction that a joint has already adds up; its breaking away is the mean of both by their torques.
    """
    model = copy.copy(rig.model)
    for name in present(model, ANKLE_JOINTS):
        at = int(model.joint(name).dofadr[0])
        model.dof_damping[at] = max(model.dof_damping[at] + values.get("viscous_n_m_s", 0.0), 0.0)
    before = laws_of(rig).joint[0]
    more_n_m, friction_n_m = values["coulomb_n_m"], values["coulomb_n_m"] + float(before["friction_n_m"])
    if friction_n_m <= 0.0:
        return dataclasses.replace(rig, model=model)
    held_n_m = float(before["friction_n_m"] * before["breakaway"]) + more_n_m * values.get("breakaway", 0.0)
    law = joint_law(float(model.opt.timestep), friction_n_m, held_n_m / friction_n_m)
    return dataclasses.replace(rig, model=model, joint_law=law)


def rub_floor(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Scale the sliding friction of every contact by `scale`."""
    model = copy.copy(rig.model)
    model.geom_friction[:, 0] *= values["scale"]
    return dataclasses.replace(rig, model=model)


def soften_floor(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Let floor or sole give by `give_m_n` more under each corner of the foot, and come back within `loss_s`."""
    model = copy.copy(rig.model)
    soften(model, Softening(values["give_m_n"], values["loss_s"]))
    return dataclasses.replace(rig, model=model)


def lose_play(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Let every tendon be stretched by `play_m` less: it only pulls, and so draws its pin to the end of the hole.

    Between one tendon and the one that pulls against it the joint then moves freely. Assumed: dry friction of the pin
    is small beside what tendons pull with.
    """
    laws = rig.tendon_laws.copy()
    laws["shorter_m"] -= values["play_m"]
    return dataclasses.replace(rig, tendon_laws=laws)


def present(model: Any, joints: tuple[str, ...]) -> list[str]:
    """Return those of some joints that a model has."""
    known = {model.joint(i).name for i in range(model.njnt)}
    return [name for name in joints if name in known]
