"""Parameters of the sim node, one table per kind: declared, bounded, validated and documented from here."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from jammkle_common.parameters import parameter
from jammkle_sim.core.engine import steps_per_output, timestep_ns
from jammkle_sim.rigs.options import (
    FROM_RESET,
    drop_height_option,
    mass_option,
    parameter_set_option,
    release_time_option,
    seed_option,
    slope_friction_option,
    slope_option,
    timestep_option,
)
from jammkle_sim.robots.options import ROBOTS, RobotOptions

MAX_RATE_HZ = 1000
"""Highest rate of an output: what the IMU of the paper's robot gives."""

PRESSURE_RATE_HZ = 100
"""Rate of every pressure topic, Hz, as agreed for the graph; the regulator counts on it."""
GAIT_RATE_HZ = 100
"""Rate of gait/phase and gait/contact of a robot that walks, Hz."""
MACHINE_RATE_HZ = 100
"""Rate of odom, and of the joint_states of several ankles together, Hz: three for each frame of a viewer."""


@dataclass(frozen=True)
class RunParameters:
    """What can be set on every sim node, whatever it simulates: its pace, its clock, its rates."""

    speed: float = parameter(
        1.0, "Simulated time per real time; 0 is as fast as possible", "s/s", 0.0, 100.0, dynamic=True
    )
    start_paused: bool = parameter(default=False, description="Wait for ~/set_paused or ~/step after the start")
    start_time_s: float = parameter(
        0.0,
        "Simulated time at the start; `jammkle up` sets it to the /clock it finds when another ankle makes the clock",
        "s",
        0.0,
        1e9,
        dynamic=True,
    )
    publish_clock: bool = parameter(
        default=True, description="Publish /clock; false for all but one of several simulated ankles"
    )
    lockstep: bool = parameter(
        default=True,
        description="Take the next step when all nodes that take part are done with the one before; false: run freely",
    )
    lockstep_timeout_s: float = parameter(
        1.0,
        "Real time for which a silent node is waited for; then it is named on /diagnostics and not waited for until "
        "it answers; 0 waits for ever",
        "s",
        0.0,
        3600.0,
        dynamic=True,
    )
    clock_rate_hz: int = parameter(
        MAX_RATE_HZ,
        "Most ticks of /clock per second while time runs; one comes after an output, so 1000 is one after every output",
        "Hz",
        50,
        MAX_RATE_HZ,
    )
    imu_rate_hz: int = parameter(500, "Rate of imu/data; must divide the step rate", "Hz", 50, MAX_RATE_HZ)
    state_rate_hz: int = parameter(
        500,
        "Rate of joint_states, tendon_states and load_cell/wrench; must divide the step rate",
        "Hz",
        50,
        MAX_RATE_HZ,
    )


def check_rates(parameters: RunParameters, timestep_s: float) -> None:
    """Check that rates and time step fit each other.

    Raises:
        ParameterError: a rate does not divide the step rate, or the step is not a whole number of nanoseconds.

    """
    timestep_ns(timestep_s)
    fixed_hz = (PRESSURE_RATE_HZ, GAIT_RATE_HZ, MACHINE_RATE_HZ)
    for rate_hz in (parameters.imu_rate_hz, parameters.state_rate_hz, *fixed_hz):
        steps_per_output(rate_hz, timestep_s, MAX_RATE_HZ)


def _effects_option() -> Any:
    about = "File of effects that the simulation is corrected by, as a gap diagnosis writes it; empty: none"
    return parameter("", about)


@dataclass(frozen=True)
class SimParameters(RunParameters):
    """What can be set on the sim node that simulates an ankle on its rig."""

    timestep_s: float = timestep_option("every rate must divide the step rate")
    seed: int = seed_option()
    parameter_set: str = parameter_set_option()
    slope_deg: float = slope_option(dynamic=True)
    drop_height_m: float = drop_height_option("slope", dynamic=True)
    release_time_s: float = release_time_option("the start or a reset")
    mass_kg: float = mass_option()
    friction: float = slope_friction_option()
    effects_file: str = _effects_option()

    def __post_init__(self) -> None:
        """Check that rates and time step fit each other; errors as in `check_rates`."""
        check_rates(self, self.timestep_s)


@dataclass(frozen=True)
class RobotParameters(RobotOptions, RunParameters):
    """What can be set on the sim node that simulates a robot."""

    clock_rate_hz: int = parameter(
        250,
        "Most ticks of /clock per second while time runs; each goes to every node of every ankle",
        "Hz",
        50,
        MAX_RATE_HZ,
    )
    state_rate_hz: int = parameter(
        100,
        "Rate of joint_states, tendon_states and true_contact of each ankle; must divide the step rate",
        "Hz",
        50,
        MAX_RATE_HZ,
    )
    slope_deg: float = parameter(
        0.0,
        f"Inclination of the ground, rising toward the toes{FROM_RESET}",
        "deg",
        0.0,
        40.0,
        dynamic=True,
    )
    drop_height_m: float = drop_height_option("ground", dynamic=True)
    robot: str = parameter("leg", "What is simulated", choices=ROBOTS)
    effects_file: str = _effects_option()
    effects_ankle: str = parameter("", "Name of the ankle that the effects are put into; empty: every one")

    def __post_init__(self) -> None:
        """Check that rates and time step fit each other; errors as in `check_rates`."""
        check_rates(self, self.timestep_s)
