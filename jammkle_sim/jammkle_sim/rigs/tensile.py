"""The tensile rig: one tendon between a fixed clamp and a crosshead that pulls it at constant speed and comes back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common import names
from jammkle_common.parameters import ParameterError, parameter
from jammkle_sim.physics.constants import Fibre, tendon_parameters
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.physics.pneumatics import PneumaticParameters
from jammkle_sim.physics.sensors import SensorParameters
from jammkle_sim.physics.tendon import tendon_law
from jammkle_sim.rigs.model import add_carriage, add_drive, add_imu_sensors, new_spec, set_speed
from jammkle_sim.rigs.options import parameter_set_option, replaced_within_range, run_timestep_option, seed_option
from jammkle_sim.rigs.recording import Series, smoothed, work_j
from jammkle_sim.rigs.rig import LOAD_CELL, Event, Rig
from jammkle_sim.rigs.run import Programme, RigKind
from jammkle_sim.rigs.vacuum import VacuumStep

if TYPE_CHECKING:
    from collections.abc import Mapping

_FIBRES = {"multi": Fibre.MULTI_MATERIAL, "a30": Fibre.SHORE_A30, "a85": Fibre.SHORE_A85}
_JAM_S = 0.1
"""When the vacuum is switched on."""
_PULL_S = 1.5
"""When the crosshead starts: the vacuum stands by then."""
_END_S = 0.1
"""Still time at the end."""
_CROSSHEAD_KG = 20.0
_SERVO_RAD_S = 700.0
"""Stiff enough (10 N/um) that 100 N move the crosshead by 10 um; the time step is short enough for it."""
_LENGTH_M = 0.118
"""End plate to end plate. Paper."""


@dataclass(frozen=True)
class TensileOptions:
    """What can be chosen about a pull."""

    material: str = parameter("multi", "What the fibres are printed of", choices=tuple(_FIBRES))
    membrane: str = parameter("yes", "Whether the membrane is on; without it there is no vacuum", choices=("yes", "no"))
    vacuum_pa: float = parameter(0.0, "Vacuum held in the tendon while it is pulled", "Pa", 0.0, 75e3)
    speed_m_s: float = parameter(0.005, "Speed of the crosshead, up and back", "m/s", 0.0005, 1.0)
    extension_m: float = parameter(
        0.020,
        "Where the crosshead turns; a tendon breaks at 55 mm",
        "m",
        0.001,
        0.08,
    )
    mounting_error_m: float = parameter(
        0.0, "How far the crosshead starts above the tendon's free length", "m", -0.005, 0.005, flag=False
    )
    channel: str = parameter(
        names.PERONEAL_LEFT,
        "Channel that the tendon hangs on; the two others stay vented",
        choices=names.CHANNELS,
        flag=False,
    )
    parameter_set: str = parameter_set_option()
    seed: int = seed_option()
    timestep_s: float = run_timestep_option()


MOUNTING_SCATTER_M = 0.00019
"""Standard deviation over repeats of `mounting_error_m`. Chosen so that five pulls of the soft A-30 tendon scatter as
in the paper (standard error 0.038 N). The stiffer ones scatter more there than this alone explains."""


def scattered(options: TensileOptions, numbers: tuple[float, float]) -> TensileOptions:
    """Return the options of one repeat: the tendon is never clamped twice at the same length."""
    return replaced_within_range(options, mounting_error_m=options.mounting_error_m + MOUNTING_SCATTER_M * numbers[0])


def tensile_rig(options: TensileOptions) -> tuple[Rig, Programme]:
    """Build the rig and what it does.

    Raises:
        ParameterError: vacuum without a membrane.

    """
    if options.membrane == "no" and options.vacuum_pa > 0.0:
        problem = "without a membrane it must be 0, as nothing holds the vacuum (or set membrane to yes)"
        raise ParameterError(problem, "vacuum_pa", options.vacuum_pa)
    tendon = tendon_parameters(options.parameter_set, _FIBRES[options.material])
    sensors, pneumatics = SensorParameters(seed=options.seed), PneumaticParameters()
    travel_s = options.extension_m / options.speed_m_s
    start, turn, stop = (
        round((_PULL_S + part * travel_s) / options.timestep_s) * options.timestep_s for part in (0.0, 1.0, 2.0)
    )
    events = (
        Event(round(start / options.timestep_s), lambda data: set_speed(data, options.speed_m_s)),
        Event(round(turn / options.timestep_s), lambda data: set_speed(data, -options.speed_m_s)),
        Event(round(stop / options.timestep_s), lambda data: set_speed(data, 0.0)),
    )
    tendon_name = names.TENDONS_OF_CHANNEL[options.channel][0]  # of the Achilles pair, the left one
    spec = _spec(options, sensors, tendon_name)
    rig = Rig(
        name="tensile",
        spec=spec,
        model=spec.compile(),
        tendon_laws=tendon_law(
            tendon, options.timestep_s, _LENGTH_M - options.mounting_error_m, names.CHANNELS.index(options.channel)
        ),
        pneumatics=pneumatics,
        sensors=sensors,
        events=events,
        options=options,
        parts={"tendon": tendon, "pneumatics": pneumatics, "sensors": sensors},
        tendon_names=(tendon_name,),
    )
    programme = Programme(
        duration_s=stop + _END_S,
        vacuum=(VacuumStep(_JAM_S, (options.channel,), options.vacuum_pa),),
        evaluate=lambda topics: _results(topics, tendon_name, start, turn),
        topics=(names.JOINT_STATES.name, names.TENDON_STATES.name, names.LOAD_CELL.name),
    )
    return rig, programme


def _spec(options: TensileOptions, sensors: SensorParameters, tendon_name: str) -> Any:
    spec = new_spec("tensile", options.timestep_s)
    spec.option.gravity = (0.0, 0.0, 0.0)  # the cell is tared with the clamp on it
    crosshead = add_carriage(spec, 0.0, _CROSSHEAD_KG)
    crosshead.add_site(name=f"{tendon_name}_crosshead")
    spec.worldbody.add_site(name=f"{tendon_name}_base", pos=(0.0, 0.0, -_LENGTH_M))
    wire = spec.add_tendon(name=tendon_name)
    wire.wrap_site(f"{tendon_name}_base")
    wire.wrap_site(f"{tendon_name}_crosshead")
    pull = spec.add_actuator(name=tendon_name, trntype=mujoco.mjtTrn.mjTRN_TENDON, target=tendon_name)
    pull.gear = (-1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    add_drive(spec, _CROSSHEAD_KG, _SERVO_RAD_S)
    add_imu_sensors(spec, sensors)
    # In line with the tendon the cell carries what the tendon pulls, along z alone.
    spec.add_sensor(
        name=LOAD_CELL,
        type=mujoco.mjtSensor.mjSENS_ACTUATORFRC,
        objtype=mujoco.mjtObj.mjOBJ_ACTUATOR,
        objname=tendon_name,
    )
    return spec


def _results(topics: Mapping[str, Series], tendon_name: str, start_s: float, turn_s: float) -> dict[str, float]:
    """Peak, work and loss from load cell and crosshead, as a test machine reports them.

    The share lost is left out where the tendon was slack all the way, the extension at the break, of the tendon itself,
    where it did not break.
    """
    cell = topics[names.LOAD_CELL.name]
    force_n = smoothed(cell.column("force_z_n"))
    extension_m = topics[names.JOINT_STATES.name].column(f"{names.CARRIAGE_JOINT}.position")
    pulled = cell.time_s >= start_s
    going_up = pulled & (cell.time_s <= turn_s)
    loaded_j = work_j(extension_m[going_up], force_n[going_up])
    lost_j = work_j(extension_m[pulled], force_n[pulled])
    tendon = topics[names.TENDON_STATES.name]
    torn = tendon.column(f"{tendon_name}.broken") > 0.0
    results = {
        "peak_force_n": float(force_n[pulled].max()),
        "largest_extension_m": float(extension_m.max()),
        "energy_in_n_m": loaded_j,
        "energy_lost_n_m": lost_j,
    }
    if tendon.column(f"{tendon_name}.tension_n").max() > 0.0 and loaded_j > 0.0:  # slack, both are noise alone
        results["share_lost"] = lost_j / loaded_j
    if torn.any():
        # It tore between the last row that has it whole and the first that has it torn.
        first = int(np.argmax(torn))
        stretched_m = tendon.column(f"{tendon_name}.extension_m")
        results["break_extension_m"] = float(stretched_m[max(first - 1, 0) : first + 1].mean())
    return results


RIG = RigKind(
    "tensile",
    "pull one tendon at constant speed and come back",
    TensileOptions,
    tensile_rig,
    scattered,
)
