"""Parameters of the sim node: one table that is declared, bounded, validated and documented from here."""

from __future__ import annotations

from dataclasses import dataclass

from jammkle_graph.parameters import ParameterError, parameter
from jammkle_sim.core.schedule import RateError, steps_per_output, timestep_ns

MAX_RATE_HZ = 1000
"""Highest rate of an output: what the IMU of the paper's robot gives."""

PRESSURE_RATE_HZ = 100
"""Rate of every pressure topic, Hz, as agreed for the graph; the regulator counts on it."""


@dataclass(frozen=True)
class SimParameters:
    """What can be set on the sim node."""

    speed: float = parameter(
        1.0, "Simulated time per real time; 0 is as fast as possible", "s/s", 0.0, 100.0, dynamic=True
    )
    start_paused: bool = parameter(default=False, description="Wait for ~/set_paused or ~/step after the start")
    start_time_s: float = parameter(
        0.0,
        "Simulated time at the start; `jammkle up` sets it to the /clock it hears when another ankle makes the clock",
        "s",
        0.0,
        1e9,
        dynamic=True,
    )
    publish_clock: bool = parameter(
        default=True, description="Publish /clock; false for all but one of several simulated ankles"
    )
    imu_rate_hz: int = parameter(500, "Rate of imu/data; must divide the step rate", "Hz", 50, MAX_RATE_HZ)
    state_rate_hz: int = parameter(
        500,
        "Rate of joint_states, tendon_states and load_cell/wrench; must divide the step rate",
        "Hz",
        50,
        MAX_RATE_HZ,
    )
    timestep_s: float = parameter(
        0.0005, "Length of a simulation step; every rate must divide the step rate", "s", 1e-4, 1e-3
    )
    seed: int = parameter(0, "Seed of all sensor noise; the same seed gives the same noise", "", 0, 2**31 - 1)
    parameter_set: str = parameter(
        "fitted",
        "Constants of the tendons: fitted to the paper's measurements, or as printed in it",
        choices=("fitted", "as_printed"),
    )
    slope_deg: float = parameter(40.0, "Inclination of the slope to land on", "deg", 0.0, 50.0)
    drop_height_m: float = parameter(0.05, "Fall of the foot's lowest point onto the slope", "m", 0.0, 0.5)
    release_time_s: float = parameter(
        1.0, "Time after the start or a reset at which the carriage is released", "s", 0.0, 3600.0
    )
    mass_kg: float = parameter(1.8, "Mass of all that falls, ankle included", "kg", 0.5, 20.0)
    friction: float = parameter(0.55, "Coulomb friction between foot and slope", "", 0.0, 2.0)
    effects_file: str = parameter(
        "", "File of effects that the simulation is corrected by, as a gap diagnosis writes it; empty: none"
    )

    def __post_init__(self) -> None:
        """Check what the values say of each other; each alone was checked before.

        Raises:
            ParameterError: a rate does not divide the step rate, or the step is not a whole number of nanoseconds.

        """
        try:
            timestep_ns(self.timestep_s)
            for rate_hz in (self.imu_rate_hz, self.state_rate_hz, PRESSURE_RATE_HZ):
                steps_per_output(rate_hz, self.timestep_s, MAX_RATE_HZ)
        except RateError as error:
            raise ParameterError(str(error)) from error
