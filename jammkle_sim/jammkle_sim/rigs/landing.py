"""The landing rig: a leg on a vertical slide, held above a slope, let go, caught by its ankle."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from jammkle_sim.physics.ankle import AnkleParameters, add_ankle
from jammkle_sim.physics.constants import AMBIENT_PA, TENDON_SETS, tendon_parameters
from jammkle_sim.physics.pneumatics import PneumaticParameters
from jammkle_sim.physics.sensors import SensorParameters
from jammkle_sim.rigs.model import (
    add_carriage,
    add_hold,
    add_imu_sensors,
    add_load_cell,
    add_slope,
    ankle_laws,
    new_spec,
    release,
    touch_down_height_m,
    weigh,
)
from jammkle_sim.rigs.rig import Event, Rig
from jammkle_sim.rigs.simulation import Simulation


@dataclass(frozen=True)
class LandingOptions:
    """What can be chosen about a landing."""

    slope_deg: float = 40.0
    """Angle of the slope, degrees, toe uphill. The paper's slip test has 40."""
    drop_height_m: float = 0.05
    """Height of fall of the foot's lowest point, m. The paper's drop test has 50 mm."""
    mass_kg: float = 1.8
    """All that falls, ankle included, kg. Paper."""
    friction: float = 0.55
    """Coefficient of sliding friction between foot and slope. Assumed, as in the slip rig. It matters: near 0.55 the
    toe almost locks at first touch, which gives the first peak; at 0.3 and below
    the heel strikes the slope in the end."""
    release_time_s: float = 1.0
    """Time after each start at which the carriage is let go, s."""
    seed: int = 0
    """Start of all sensor noise."""
    parameter_set: str = "fitted"
    """Constants of the tendons: `fitted` or `as_printed`."""
    ambient_pa: float = AMBIENT_PA
    """Pressure of the atmosphere, Pa."""
    timestep_s: float = 0.0005
    """Time step, s. At twice that a drop's peak reads 1 to 1.5 m/s^2 high."""

    def __post_init__(self) -> None:
        """Check every value.

        Raises:
            ValueError: one is out of range; the message names it and the range.

        """
        for name, low, high in (
            ("slope_deg", 0.0, 50.0),
            ("drop_height_m", 0.0, 0.5),
            ("mass_kg", 0.5, 20.0),
            ("friction", 0.0, 2.0),
            ("release_time_s", 0.0, 3600.0),
            ("seed", 0, 2**63 - 1),
            ("ambient_pa", 50e3, 120e3),
            ("timestep_s", 1e-5, 2e-3),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                msg = f"{name} is {value}; it must be {low:g} to {high:g}"
                raise ValueError(msg)
        if not isinstance(self.seed, int):
            msg = f"seed is {self.seed}; it must be a whole number"
            raise ValueError(msg)  # noqa: TRY004  # one kind of error for all options
        if self.parameter_set not in TENDON_SETS:
            msg = f"parameter_set is '{self.parameter_set}'; it must be one of: {', '.join(TENDON_SETS)}"
            raise ValueError(msg)


def landing_simulation(options: LandingOptions) -> Simulation:
    """Build the landing rig, ready to run.

    Args:
        options: What to land on, with what, from where.

    """
    return Simulation(landing_parts(options))


def landing_parts(options: LandingOptions) -> Rig:
    """Build the landing rig, for a simulation.

    Args:
        options: What to land on, with what, from where.

    """
    ankle = AnkleParameters()
    tendon = tendon_parameters(options.parameter_set)
    pneumatics = PneumaticParameters(ambient_pa=options.ambient_pa)
    sensors = SensorParameters(seed=options.seed)
    spec = _spec(options, ankle, sensors)
    return Rig(
        name="landing",
        spec=spec,
        model=spec.compile(),
        tendon_laws=ankle_laws(tendon, ankle, options.timestep_s),
        pneumatics=pneumatics,
        sensors=sensors,
        events=(Event(round(options.release_time_s / options.timestep_s), release),),
        description={
            "options": dataclasses.asdict(options),
            "ankle": dataclasses.asdict(ankle),
            "tendon": dataclasses.asdict(tendon),
            "pneumatics": dataclasses.asdict(pneumatics),
            "sensors": dataclasses.asdict(sensors),
        },
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
