"""The changes that effects make to a rig or its inputs: pure functions of either, values by parameter, and a place."""

from __future__ import annotations

import copy
import dataclasses
import functools
import math
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]  # carries no types

from jammkle_common.names import ANKLE_JOINTS, CHANNELS, TENDONS_OF_CHANNEL
from jammkle_gap.ankle.inputs import nominal_rig
from jammkle_sim.physics import pneumatics, records
from jammkle_sim.physics.ankle import joint_law
from jammkle_sim.physics.contact import Softening
from jammkle_sim.physics.contact import soften as soften_contact
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.physics.pneumatics import REFERENCE_DENSITY_KG_M3, conductance_kg_s_pa, stable_substeps
from jammkle_sim.physics.tendon import slip_elements
from jammkle_sim.rigs.catalogue import rig_kind
from jammkle_sim.rigs.replay import is_driven
from jammkle_sim.rigs.rig import ACCELEROMETER, laws_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from jammkle_gap.ankle.inputs import AnkleInputs
    from jammkle_sim.rigs.rig import Rig

    InPlace = Callable[[Any, Mapping[str, float], str], None]
    OfRig = Callable[[Rig, Mapping[str, float], str], Rig]

VOLUMES = ("manifold", *CHANNELS)
"""Places of the laws' volumes, in order."""


_GROUPS = {
    "achilles_pair": TENDONS_OF_CHANNEL["achilles"],
    "peroneal_pair": (*TENDONS_OF_CHANNEL["peroneal_left"], *TENDONS_OF_CHANNEL["peroneal_right"]),
}
"""Places that are more than one tendon."""


def with_tendons(rig: Rig, place: str, change: Callable[[Any], None]) -> Rig:
    """Return the rig with other laws of some tendons.

    Args:
        rig: Not touched.
        place: A tendon, or a pair; empty: all.
        change: Changes a record of TENDON_LAW in place.

    """
    laws = rig.tendon_laws.copy()
    chosen = _GROUPS.get(place, (place,)) if place else rig.tendon_names
    for i, name in enumerate(rig.tendon_names):
        if name in chosen:
            change(laws[i])
    return dataclasses.replace(rig, tendon_laws=laws)


def _of_air(change: InPlace) -> OfRig:
    """Make a change of a record of PNEUMATIC_LAW one of a rig."""

    @functools.wraps(change)
    def changed(rig: Rig, values: Mapping[str, float], place: str) -> Rig:
        law = laws_of(rig).pneumatics.copy()
        change(law[0], values, place)
        law["substeps"] = stable_substeps(law)
        return dataclasses.replace(rig, pneumatic_law=law)

    return changed


def _of_tendons(change: InPlace) -> OfRig:
    """Make a change of a record of TENDON_LAW one of a rig: of a tendon, of a pair, or without a place of all."""

    @functools.wraps(change)
    def changed(rig: Rig, values: Mapping[str, float], place: str) -> Rig:
        return with_tendons(rig, place, lambda law: change(law, values, place))

    return changed


def _of_imu(change: InPlace) -> OfRig:
    """Make a change of a record of IMU_LAW one of a rig; MuJoCo's own limit, before turn and offset, is taken away."""

    @functools.wraps(change)
    def changed(rig: Rig, values: Mapping[str, float], place: str) -> Rig:
        law = laws_of(rig).imu.copy()
        change(law[0], values, place)
        model, sensor = rig.model, rig.model.sensor(ACCELEROMETER).id
        if model.sensor_cutoff[sensor] != 0.0:
            model = copy.copy(model)
            model.sensor_cutoff[sensor] = 0.0
        return dataclasses.replace(rig, imu_law=law, model=model)

    return changed


def _of_model(change: InPlace) -> OfRig:
    """Make a change of a mujoco.MjModel one of a rig."""

    @functools.wraps(change)
    def changed(rig: Rig, values: Mapping[str, float], place: str) -> Rig:
        model = copy.copy(rig.model)
        change(model, values, place)
        return dataclasses.replace(rig, model=model)

    return changed


@_of_air
def leak(law: Any, values: Mapping[str, float], place: str) -> None:
    """Let air of the atmosphere into one volume, by `conductance_dm3_s_bar`."""
    law["leak_kg_s_pa"][VOLUMES.index(place)] += conductance_kg_s_pa(values["conductance_dm3_s_bar"])


@_of_air
def wear_pump(law: Any, values: Mapping[str, float], _place: str) -> None:
    """Scale free flow by `flow_scale`, and the vacuum at which the pump stops by `vacuum_scale`."""
    law["pump_free_flow_m3_s"] *= values["flow_scale"]
    law["pump_ultimate_vacuum_pa"] *= values["vacuum_scale"]


@_of_air
def dead_time(law: Any, values: Mapping[str, float], place: str) -> None:
    """Make a channel's solenoid, or without a place all, slower by `extra_s`, though never quicker than at once."""
    chosen = [CHANNELS.index(place)] if place else list(range(len(CHANNELS)))
    dead_times_s = law["valve_dead_time_s"]
    dead_times_s[chosen] = np.maximum(dead_times_s[chosen] + values["extra_s"], 0.0)


@_of_air
def kink(law: Any, values: Mapping[str, float], place: str) -> None:
    """Scale the conductance of one channel's valve and tube by `conductance_scale`."""
    law["valve_kg_s_pa"][CHANNELS.index(place)] *= values["conductance_scale"]


@_of_air
def lengthen_hose(law: Any, values: Mapping[str, float], place: str) -> None:
    """Put `length_m` more hose between one channel's valve and its tendons: more air, less flow, and later."""
    length_m, i, density_kg_m3 = values["length_m"], CHANNELS.index(place), REFERENCE_DENSITY_KG_M3
    law["volume_m3"][i + 1] += pneumatics.hose_volume_m3(length_m)
    before_m3_s_pa = law["valve_kg_s_pa"][i] / density_kg_m3
    law["valve_kg_s_pa"][i] = density_kg_m3 * pneumatics.conductance_behind_hose(before_m3_s_pa, length_m)
    law["valve_dead_time_s"][i] += pneumatics.hose_travel_s(length_m)


@_of_air
def trap_volume(law: Any, values: Mapping[str, float], place: str) -> None:
    """Add `volume_m3` to one volume."""
    law["volume_m3"][VOLUMES.index(place)] += values["volume_m3"]


def offset_pressure(rig: Rig, values: Mapping[str, float], place: str) -> Rig:
    """Let one sensor read `offset_pa` too much."""
    offsets = list(rig.wiring.pressure_offset_pa)
    offsets[VOLUMES.index(place)] += values["offset_pa"]
    return _rewired(rig, pressure_offset_pa=tuple(offsets))


def relax(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Scale gains and times of the viscoelastic branches, by `gain_scale` and `time_scale`."""
    step_s = float(rig.model.opt.timestep)

    def change(law: Any) -> None:
        times_s = branch_times_s(law, step_s)
        gains = law["gain"] / (times_s / step_s * (1.0 - law["decay"]))
        times_s = times_s * values["time_scale"]
        law["decay"] = np.exp(-step_s / times_s)
        law["gain"] = gains * values["gain_scale"] * times_s / step_s * (1.0 - law["decay"])

    return with_tendons(rig, "", change)


def relax_times(rig: Rig, values: Mapping[str, float], place: str) -> Rig:
    """Scale the times of the viscoelastic branches alone, by `time_scale`."""
    return relax(rig, {"gain_scale": 1.0, **values}, place)


@_of_tendons
def scale_friction(law: Any, values: Mapping[str, float], _place: str) -> None:
    """Scale the force at which jammed fibres slide, by `scale`."""
    law["friction_yield_n_per_pa"] *= values["scale"]


@_of_tendons
def scale_stiffness(law: Any, values: Mapping[str, float], _place: str) -> None:
    """Scale the elastic force by `scale`."""
    law["static_force_n"] *= values["scale"]


@_of_tendons
def stiffen_membrane(law: Any, values: Mapping[str, float], _place: str) -> None:
    """Put a spring of `stiffness_n_m` beside the fibres."""
    places = np.arange(records.TABLE_POINTS)
    law["static_force_n"] += values["stiffness_n_m"] * places * law["table_step_m"]


@_of_tendons
def pretension(law: Any, values: Mapping[str, float], _place: str) -> None:
    """Shorten the tendons by `extension_m`; below 0 they are slack. Their extension is still read from as drawn."""
    law["shorter_m"] += values["extension_m"]


@_of_tendons
def soften(law: Any, values: Mapping[str, float], _place: str) -> None:
    """Let the elastic force fall by up to `loss` as `travel_m` of stretching has been done since the start.

    A tendon that softens already does so further: in the end as one after the other, on the way as one with the mean
    of both travels, by loss. Assumed: the law has one travel.
    """
    loss, before = values["loss"], law["softening"]
    if loss > 0.0:
        travelled_m = before * law["softening_travel_m"] + loss * values["travel_m"]
        law["softening_travel_m"] = travelled_m / (before + loss)
        law["softening"] = 1.0 - (1.0 - before) * (1.0 - loss)


@_of_tendons
def lose_fibres(law: Any, values: Mapping[str, float], _place: str) -> None:
    """Take the share `lost` of the fibres out: elastic force and friction fall, the membrane still grips."""
    _leave_fibres(law, 1.0 - values["lost"])


def scale_tendon(rig: Rig, values: Mapping[str, float], place: str) -> Rig:
    """Scale everything that a tendon pulls with, by `scale`."""
    return fail(rig, {"remaining": values["scale"]}, place)


@_of_tendons
def fail(law: Any, values: Mapping[str, float], _place: str) -> None:
    """Leave the share `remaining` of everything that a tendon pulls with."""
    _leave_fibres(law, values["remaining"])
    law["grip_n_per_pa"] *= values["remaining"]


def _leave_fibres(law: Any, share: float) -> None:
    law["static_force_n"] *= share
    law["friction_yield_n_per_pa"] *= share
    law["friction_stiffness_n_m"] *= max(share, 1e-6)


def branch_times_s(law: Any, step_s: float) -> NDArray[np.float64]:
    """Return the time constants of a tendon's viscoelastic branches, s."""
    times_s: NDArray[np.float64] = -step_s / np.log(law["decay"])
    return times_s


_LEAST_KG = 0.01
"""What a body keeps, kg, whatever is taken off it."""


@_of_model
def add_payload(model: Any, values: Mapping[str, float], _place: str) -> None:
    """Add `mass_kg` to the carriage."""
    carriage = model.body("carriage").id
    before_kg = float(model.body_mass[carriage])
    after_kg = max(before_kg + values["mass_kg"], _LEAST_KG)
    model.body_mass[carriage] = after_kg
    model.body_inertia[carriage] *= after_kg / before_kg
    mujoco.mj_setConst(model, mujoco.MjData(model))


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


@_of_model
def rub_floor(model: Any, values: Mapping[str, float], _place: str) -> None:
    """Scale the sliding friction of every contact by `scale`."""
    model.geom_friction[:, 0] *= values["scale"]


@_of_model
def soften_floor(model: Any, values: Mapping[str, float], _place: str) -> None:
    """Let floor or sole give by `give_m_n` more under each corner of the foot, and come back within `loss_s`."""
    soften_contact(model, Softening(values["give_m_n"], values["loss_s"]))


@_of_tendons
def lose_play(law: Any, values: Mapping[str, float], _place: str) -> None:
    """Let every tendon be stretched by `play_m` less: it only pulls, and so draws its pin to the end of the hole.

    Between one tendon and the one that pulls against it the joint then moves freely. Assumed: dry friction of the pin
    is small beside what tendons pull with.
    """
    law["shorter_m"] -= values["play_m"]


def present(model: Any, joints: tuple[str, ...]) -> list[str]:
    """Return those of some joints that a model has."""
    known = {model.joint(i).name for i in range(model.njnt)}
    return [name for name in joints if name in known]


_ACCELERATION, _RATE = slice(0, 3), slice(3, 6)
"""Axes of the IMU."""


@_of_imu
def offset_imu(law: Any, values: Mapping[str, float], _place: str) -> None:
    """Let the accelerometer read `x_m_s2`, `y_m_s2` and `z_m_s2` too much."""
    law["offset"][_ACCELERATION] += [values[f"{axis}_m_s2"] for axis in "xyz"]


@_of_imu
def offset_gyro(law: Any, values: Mapping[str, float], _place: str) -> None:
    """Let the gyro read `x_rad_s`, `y_rad_s` and `z_rad_s` too much."""
    law["offset"][_RATE] += [values[f"{axis}_rad_s"] for axis in "xyz"]


@_of_imu
def misalign_imu(law: Any, values: Mapping[str, float], _place: str) -> None:
    """Turn the IMU on its mount by `roll_rad`, then `pitch_rad`, then `yaw_rad`, about the mount's axes."""
    angles_rad = [values.get(name, 0.0) for name in ("roll_rad", "pitch_rad", "yaw_rad")]
    law["turn"] = Rotation.from_euler("xyz", angles_rad).as_matrix().T @ law["turn"]


@_of_imu
def saturate_imu(law: Any, values: Mapping[str, float], _place: str) -> None:
    """Scale the range of the accelerometer by `range_scale`."""
    law["limit"][_ACCELERATION] *= values["range_scale"]


def scale_load_cell(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Scale what the load cell reads by `gain`."""
    return _rewired(rig, load_cell_gain=rig.wiring.load_cell_gain * values["gain"])


def skew_clock(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Let the sensors' clock run faster by `skew`."""
    return _rewired(rig, clock_skew=rig.wiring.clock_skew + values["skew"])


def delay_commands(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Let commands arrive `delay_s` later."""
    return _rewired(rig, command_delay_s=rig.wiring.command_delay_s + values["delay_s"])


def delay_pressures(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Let pressures be read `delay_s` late."""
    return _later(rig, values, "pressure_delay_s")


def delay_imu(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Let the IMU be read `delay_s` late."""
    return _later(rig, values, "imu_delay_s")


def delay_joints(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Let joints and tendons be read `delay_s` late."""
    return _later(rig, values, "joint_delay_s")


def delay_load_cell(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Let the load cell be read `delay_s` late."""
    return _later(rig, values, "load_cell_delay_s")


def delay_sensors(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Let every sensor be read `delay_s` late."""
    return _later(rig, values, "pressure_delay_s", "imu_delay_s", "joint_delay_s", "load_cell_delay_s")


def _later(rig: Rig, values: Mapping[str, float], *fields: str) -> Rig:
    return _rewired(rig, **{field: getattr(rig.wiring, field) + values["delay_s"] for field in fields})


def _rewired(rig: Rig, **fields: Any) -> Rig:
    return dataclasses.replace(rig, wiring=dataclasses.replace(rig.wiring, **fields))


_PUMP = "pump"
_CONSTANTS = {
    "toe": "toe_m",
    "heel": "heel_m",
    "achilles": "achilles_arm_m",
    "achilles_side": "achilles_spread_m",
    "peroneal": "peroneal_forward_m",
    "peroneal_side": "peroneal_spread_m",
    "sole": "sole_m",
    "foot": "foot_mass_kg",
}
"""Constants of the ankle by place."""
_PITCH_OPTION = "pitch_deg"
"""Option of a rig that sets the pose; the others let the foot hang level."""


def shift_commands(inputs: AnkleInputs, values: Mapping[str, float], place: str) -> AnkleInputs:
    """Let commands of pump or solenoids come `late_s` later. A place is `pump` or a channel; none is all."""
    commands, late_s = inputs.commands, values["late_s"]
    chosen = (place,) if place else (_PUMP, *CHANNELS)
    solenoids = {
        channel: line.later(late_s) if channel in chosen else line for channel, line in commands.solenoids.items()
    }
    duty = commands.duty.later(late_s) if _PUMP in chosen else commands.duty
    return dataclasses.replace(inputs, commands=dataclasses.replace(commands, duty=duty, solenoids=solenoids))


def hasten_commands(inputs: AnkleInputs, values: Mapping[str, float], _place: str) -> AnkleInputs:
    """Let all commands come `late_s` sooner: on the clock of a rig that moves so much later. See `move_later`.

    A release that was seen is then read so much later. A drive has no start that scatters, as its course is measured.
    """
    rig = nominal_rig(inputs)
    if not rig.events or is_driven(rig):
        return inputs
    if inputs.release_s is not None and inputs.release_seen_by:
        inputs = dataclasses.replace(inputs, release_s=inputs.release_s + values["late_s"])
    return shift_commands(inputs, {"late_s": -values["late_s"]}, "")


def change_weather(inputs: AnkleInputs, values: Mapping[str, float], _place: str) -> AnkleInputs:
    """Raise the pressure of the atmosphere by `extra_pa`."""
    ambient_pa = nominal_rig(inputs).pneumatics.ambient_pa + values["extra_pa"]
    return dataclasses.replace(inputs, ambient_pa=ambient_pa)


def scale_ankle(inputs: AnkleInputs, values: Mapping[str, float], place: str) -> AnkleInputs:
    """Scale one constant of the ankle by `scale`: free lengths and start follow, as on a rig that is set up by them."""
    return _with_ankle(inputs, _CONSTANTS[place], lambda constant: constant * values["scale"])


def pitch_foot(inputs: AnkleInputs, values: Mapping[str, float], _place: str) -> AnkleInputs:
    """Let the foot hang `extra_deg` further toe-down."""
    extra_deg = values["extra_deg"]
    if _PITCH_OPTION in dict(inputs.options):
        return _with_option(inputs, _PITCH_OPTION, lambda pitch_deg: pitch_deg + extra_deg)
    return _with_ankle(inputs, "hang_pitch_rad", lambda pitch_rad: pitch_rad + math.radians(extra_deg))


def tilt_slope(inputs: AnkleInputs, values: Mapping[str, float], _place: str) -> AnkleInputs:
    """Make the slope steeper by `extra_deg`."""
    return _with_option(inputs, "slope_deg", lambda slope_deg: slope_deg + values["extra_deg"])


def raise_drop(inputs: AnkleInputs, values: Mapping[str, float], _place: str) -> AnkleInputs:
    """Let it fall from `extra_m` higher, if it falls at all."""
    return _with_option(inputs, "drop_height_m", lambda height_m: max(height_m + values["extra_m"], 0.0))


def scale_travel(inputs: AnkleInputs, values: Mapping[str, float], _place: str) -> AnkleInputs:
    """Scale the way of a driven carriage by `scale`, from where it starts."""
    course = inputs.course
    if course is None:
        for option in ("extension_m", "descent_m"):
            inputs = _with_option(inputs, option, lambda way_m: way_m * values["scale"])
        return inputs
    scaled_m = course.start_m + values["scale"] * (course.position_m - course.start_m)
    return dataclasses.replace(inputs, course=dataclasses.replace(course, position_m=scaled_m))


def _with_option(inputs: AnkleInputs, option: str, change: Any) -> AnkleInputs:
    """Change an option of the rig; a rig that does not have it stays as it is."""
    options = dict(inputs.options)
    if option not in options:
        return inputs
    options[option] = change(options[option])
    return dataclasses.replace(inputs, options=tuple(sorted(options.items())))


def _with_ankle(inputs: AnkleInputs, constant: str, change: Any) -> AnkleInputs:
    """Change a constant of the ankle; a rig without one stays as it is."""
    ankle = rig_kind(inputs.rig).ankle
    if ankle is None:
        return inputs
    constants = {constant: getattr(ankle, constant), **dict(inputs.ankle)}
    constants[constant] = change(constants[constant])
    return dataclasses.replace(inputs, ankle=tuple(sorted(constants.items())))


_DECADES_S = {"3_ms": 0.003, "30_ms": 0.03, "300_ms": 0.3, "3_s": 3.0}
"""Times of the relaxation by place, a decade apart."""


@_of_air
def scale_volume(law: Any, values: Mapping[str, float], place: str) -> None:
    """Scale the air in one volume by `scale`."""
    law["volume_m3"][VOLUMES.index(place)] *= values["scale"]


@_of_air
def fill_pump(law: Any, values: Mapping[str, float], _place: str) -> None:
    """Raise the exponent of the pump's filling by `extra`: 1 makes its mass flow fall in proportion to the vacuum."""
    law["pump_filling"] += values["extra"]


@_of_air
def cross_over(law: Any, values: Mapping[str, float], _place: str) -> None:
    """Let air past every valve that switches into the manifold for `extra_s` more."""
    law["valve_crossover_s"] += values["extra_s"]


@_of_air
def warm_manifold(law: Any, values: Mapping[str, float], _place: str) -> None:
    """Let the manifold's air reach the temperature of its walls `later_s` later."""
    law["thermal_time_s"][0] += values["later_s"]


@_of_air
def warm_tendons(law: Any, values: Mapping[str, float], _place: str) -> None:
    """Let the air of tendons and tubes reach the temperature of what surrounds it `later_s` later."""
    law["thermal_time_s"][1:] += values["later_s"]


@_of_air
def widen_orifices(law: Any, values: Mapping[str, float], _place: str) -> None:
    """Raise the critical pressure ratio of every orifice by `extra`."""
    law["critical_ratio"] = min(max(law["critical_ratio"] + values["extra"], 0.0), 0.9 * law["linear_ratio"])


@_of_model
def scale_damping(model: Any, values: Mapping[str, float], _place: str) -> None:
    """Scale the viscous friction of the ankle's joint by `scale`."""
    for name in present(model, ANKLE_JOINTS):
        model.dof_damping[int(model.joint(name).dofadr[0])] *= values["scale"]


@_of_model
def damp_contact(model: Any, values: Mapping[str, float], _place: str) -> None:
    """Scale the damping of every contact by `scale`."""
    soften_contact(model, Softening(damping=values["scale"]))


@_of_model
def scale_contact_time(model: Any, values: Mapping[str, float], _place: str) -> None:
    """Scale the time constant of every contact by `scale`."""
    standard = model.geom_solref[:, 0] > 0.0
    model.geom_solref[standard, 0] *= values["scale"]
    model.geom_solref[~standard] /= [values["scale"] ** 2, values["scale"]]


def scale_relaxation(rig: Rig, values: Mapping[str, float], place: str) -> Rig:
    """Scale the relaxation around one time by `scale`, falling off to the times a decade shorter and longer."""
    step_s = float(rig.model.opt.timestep)
    decades = np.log10(list(_DECADES_S.values()))
    hat = (np.array(list(_DECADES_S)) == place).astype(float)

    def change(law: Any) -> None:
        weight = np.interp(np.log10(branch_times_s(law, step_s)), decades, hat)
        weight[-1] = 0.0  # what goes on for minutes is a constant of its own
        law["gain"] *= values["scale"] ** weight

    return with_tendons(rig, "", change)


def creep(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Let the fibres relax further in the slowest branch, by `gain` of their long-term force."""
    step_s = float(rig.model.opt.timestep)

    def change(law: Any) -> None:
        law["gain"][-1] += values["gain"] * branch_times_s(law, step_s)[-1] / step_s * (1.0 - law["decay"][-1])

    return with_tendons(rig, "", change)


@_of_tendons
def scale_friction_stiffness(law: Any, values: Mapping[str, float], _place: str) -> None:
    """Scale the stiffness with which jammed fibres hold before they slide, by `scale`."""
    law["friction_stiffness_n_m"] *= values["scale"]


@_of_tendons
def slip_early(law: Any, values: Mapping[str, float], _place: str) -> None:
    """Let contacts of jammed fibres slide one after the other to a `share`, where they slide together."""
    two = law["friction_stiffness_n_m"][-2:], law["friction_yield_n_per_pa"][-2:]
    law["friction_stiffness_n_m"], law["friction_yield_n_per_pa"] = slip_elements(*two, values["share"])


@_of_tendons
def shift_onset(law: Any, values: Mapping[str, float], _place: str) -> None:
    """Raise the vacuum from which on fibres press on each other by `extra_pa`."""
    law["friction_onset_pa"] = max(law["friction_onset_pa"] + values["extra_pa"], 0.0)


@_of_tendons
def scale_grip(law: Any, values: Mapping[str, float], _place: str) -> None:
    """Scale the pull of the membrane that grips the fibres, by `scale`."""
    law["grip_n_per_pa"] *= values["scale"]


@_of_tendons
def scale_stiffening(law: Any, values: Mapping[str, float], _place: str) -> None:
    """Scale by how much vacuum stiffens the fibres, by `scale`."""
    law["stiffening_per_pa"] *= values["scale"]


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
