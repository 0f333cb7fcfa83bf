"""The landing rig: a leg on a vertical slide, held above a slope, let go, caught by its ankle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from jammkle_sim.physics.ankle import AnkleParameters, add_ankle
from jammkle_sim.physics.constants import tendon_parameters
from jammkle_sim.physics.pneumatics import PneumaticParameters
from jammkle_sim.physics.sensors import SensorParameters
from jammkle_sim.rigs.model import (
    add_carriage,
    add_hold,
    add_imu_sensors,
    add_load_cell,
    add_slope,
    ankle_laws,
    compile_with_start,
    hanging,
    new_spec,
    release,
    touch_down_height_m,
    weigh,
)
from jammkle_sim.rigs.options import (
    checked,
    drop_height_option,
    mass_option,
    parameter_set_option,
    release_time_option,
    seed_option,
    slope_friction_option,
    slope_option,
    timestep_option,
)
from jammkle_sim.rigs.rig import Event, Rig
from jammkle_sim.rigs.simulation import Simulation


@dataclass(frozen=True)
class LandingOptions:
    """What can be chosen about a landing."""

    slope_deg: float = slope_option()
    friction: float = slope_friction_option()
    drop_height_m: float = drop_height_option("slope")
    release_time_s: float = release_time_option("each start", 3600.0)
    mass_kg: float = mass_option()
    parameter_set: str = parameter_set_option()
    seed: int = seed_option()
    timestep_s: float = timestep_option("a whole number of nanoseconds")


def landing_simulation(options: LandingOptions) -> Simulation:
    """Build the landing rig, ready to run.

    Args:
        options: What to land on, with what, from where.

    Raises:
        ParameterError: an option out of range.

    """
    return Simulation(landing_parts(options))


def landing_parts(options: LandingOptions) -> Rig:
    """Build the landing rig, for a simulation.

    Args:
        options: What to land on, with what, from where.

    Raises:
        ParameterError: an option out of range.

    """
    return landing_built(checked(options))


def landing_built(options: LandingOptions, ankle: AnkleParameters | None = None) -> Rig:
    """Build the landing rig, with options as they are: a machine may stand a little beyond what can be asked for.

    Args:
        options: What to land on, with what, from where.
        ankle: Constants of the ankle; None: AnkleParameters as they stand.

    """
    ankle = ankle or AnkleParameters()
    tendon = tendon_parameters(options.parameter_set)
    pneumatics = PneumaticParameters()
    sensors = SensorParameters(seed=options.seed)
    spec = _spec(options, ankle, sensors)
    return Rig(
        name="landing",
        spec=spec,
        model=compile_with_start(spec, hanging(ankle)),
        tendon_laws=ankle_laws(tendon, ankle, options.timestep_s),
        pneumatics=pneumatics,
        sensors=sensors,
        events=(Event(round(options.release_time_s / options.timestep_s), release),),
        options=options,
        parts={"ankle": ankle, "tendon": tendon, "pneumatics": pneumatics, "sensors": sensors},
    )


def _spec(options: LandingOptions, ankle: AnkleParameters, sensors: SensorParameters) -> Any:
    spec = new_spec("landing", options.timestep_s)
    add_slope(spec, options.slope_deg, options.friction, ankle.contact_time_s)
    start_m = touch_down_height_m(options.slope_deg, ankle) + options.drop_height_m
    carriage = add_carriage(spec, start_m, options.mass_kg - ankle.mass_kg)
    leg = carriage.add_body(name="leg")
    weigh(leg, ankle.mass_kg - ankle.foot_mass_kg)
    add_ankle(spec, leg, ankle, options.friction)
    add_hold(spec, ankle.contact_time_s)
    add_imu_sensors(spec, sensors)
    add_load_cell(spec, leg)
    return spec
