"""Parameters of the sim node: one table that is declared, bounded, validated and documented from here."""

from __future__ import annotations

from dataclasses import dataclass

from jammkle_graph.parameters import parameter

MAX_RATE_HZ = 1000
"""Highest rate of an output: what the IMU of the paper's robot gives."""


@dataclass(frozen=True)
class SimParameters:
    """What can be set on the sim node."""

    speed: float = parameter(
        1.0, "Simulated time per real time; 0 is as fast as possible", "s/s", 0.0, 100.0, dynamic=True
    )
    start_paused: bool = parameter(default=False, description="Wait for ~/set_paused or ~/step after the start")
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
