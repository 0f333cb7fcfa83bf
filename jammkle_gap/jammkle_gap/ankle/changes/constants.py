"""Changes to the simulator's own constants, as calibration makes them; those that effects change too stand there."""

from __future__ import annotations

import copy
import dataclasses
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common.names import ANKLE_JOINTS
from jammkle_gap.ankle.changes.air import VOLUMES, with_air
from jammkle_gap.ankle.changes.body import present
from jammkle_gap.ankle.changes.sensing import delay_sensors
from jammkle_gap.ankle.changes.tendon import branch_times_s, with_tendons
from jammkle_sim.physics.contact import Softening, soften
from jammkle_sim.rigs.replay import is_driven
from jammkle_sim.rigs.rig import laws_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_sim.rigs.rig import Rig

_DECADES_S = {"3_ms": 0.003, "30_ms": 0.03, "300_ms": 0.3, "3_s": 3.0}
"""Times of the relaxation by place, a decade apart."""


def scale_volume(rig: Rig, values: Mapping[str, float], place: str) -> Rig:
    """Scale the air in one volume by `scale`."""

    def change(law: Any) -> None:
        law["volume_m3"][VOLUMES.index(place)] *= values["scale"]

    return with_air(rig, change)


def fill_pump(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Raise the exponent of the pump's filling by `extra`: 1 makes its mass flow fall in proportion to the vacuum."""

    def change(law: Any) -> None:
        law["pump_filling"] += values["extra"]

    return with_air(rig, change)


def widen_orifices(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Raise the critical pressure ratio of every orifice by `extra`."""

    def change(law: Any) -> None:
        law["critical_ratio"] = min(max(law["critical_ratio"] + values["extra"], 0.0), 0.9 * law["linear_ratio"])

    return with_air(rig, change)


def scale_damping(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Scale the viscous friction of the ankle's joint by `scale`."""
    model = copy.copy(rig.model)
    for name in present(model, ANKLE_JOINTS):
        model.dof_damping[int(model.joint(name).dofadr[0])] *= values["scale"]
    return dataclasses.replace(rig, model=model)


def damp_contact(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Scale the damping of every contact by `scale`."""
    model = copy.copy(rig.model)
    soften(model, Softening(damping=values["scale"]))
    return dataclasses.replace(rig, model=model)


def scale_contact_time(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Scale the time constant of every contact by `scale`."""
    model = copy.copy(rig.model)
    standard = model.geom_solref[:, 0] > 0.0
    model.geom_solref[standard, 0] *= values["scale"]
    model.geom_solref[~standard] /= [values["scale"] ** 2, values["scale"]]
    return dataclasses.replace(rig, model=model)


def scale_relaxation(rig: Rig, values: Mapping[str, float], place: str) -> Rig:
    """Scale the relaxation around one time by `scale`, falling off to the times a decade shorter and longer."""
    step_s = float(rig.model.opt.timestep)
    decades = np.log10(list(_DECADES_S.values()))
    hat = (np.array(list(_DECADES_S)) == place).astype(float)

    def change(law: Any) -> None:
        weight = np.interp(np.log10(branch_times_s(law, step_s)), decades, hat)
        law["gain"] *= values["scale"] ** weight

    return with_tendons(rig, "", change)


def scale_friction_stiffness(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Scale the stiffness with which jammed fibres hold before they slide, by `scale`."""

    def change(law: Any) -> None:
        law["friction_stiffness_n_m"] *= values["scale"]

    return with_tendons(rig, "", change)


def shift_onset(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Raise the vacuum from which on fibres press on each other by `extra_pa`."""

    def change(law: Any) -> None:
        law["friction_onset_pa"] = max(law["friction_onset_pa"] + values["extra_pa"], 0.0)

    return with_tendons(rig, "", change)


def scale_grip(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Scale the pull of the membrane that grips the fibres, by `scale`."""

    def change(law: Any) -> None:
        law["grip_n_per_pa"] *= values["scale"]

    return with_tendons(rig, "", change)


def scale_stiffening(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Scale by how much vacuum stiffens the fibres, by `scale`."""

    def change(law: Any) -> None:
        law["stiffening_per_pa"] *= values["scale"]

    return with_tendons(rig, "", change)


def scale_bandwidth(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Scale the bandwidth of the IMU by `scale`."""
    law = laws_of(rig).imu.copy()
    law["smoothing"] = 1.0 - math.exp(math.log(1.0 - float(law["smoothing"][0])) * values["scale"])
    return dataclasses.replace(rig, imu_law=law)


def move_later(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Let whatever the rig does by itself, such as its release, come `late_s` later.

    The rig's own clock starts with its motion: on it commands come sooner (`hasten_commands`), and every reading is of
    a moment that much earlier. So the motion need not wait for a whole time step. A drive follows what was measured.
    """
    starts_by_itself = rig.events and not is_driven(rig)
    return delay_sensors(rig, {"delay_s": values["late_s"]}, "") if starts_by_itself else rig
