"""What can be chosen about a robot, its ground and what it does."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from jammkle_common.parameters import ParameterError, parameter
from jammkle_sim.rigs.options import drop_height_option, parameter_set_option, seed_option, timestep_option

ROBOTS = ("leg", "quadruped")
"""Our robots by name."""


class ImuPlace(str, enum.Enum):
    """Where the IMU of an ankle is mounted."""

    FOOT = "foot"
    SHANK = "shank"
    BODY = "body"
    """On the robot's body, one for all ankles."""


class Behaviour(str, enum.Enum):
    """What a robot does."""

    STAND = "stand"
    WALK = "walk"
    """A leg steps, a quadruped trots."""
    DROP = "drop"
    HANG = "hang"
    """Its body is held in the air, as by a crane, and its legs stand in it; for exercises."""
    SLIP = "slip"
    """Stands, until the ground turns slippery."""


class AnkleKind(str, enum.Enum):
    """What the robot stands on."""

    JAMMABLE = "jammable"
    RIGID = "rigid"
    """The same foot on a locked joint: the baseline."""


@dataclass(frozen=True)
class RobotOptions:
    """What can be chosen about a robot."""

    behaviour: str = parameter("stand", "What it does", choices=tuple(each.value for each in Behaviour))
    ankle: str = parameter(
        "jammable",
        "Ankles as they are, or locked for comparison",
        choices=tuple(each.value for each in AnkleKind),
        flag=False,
    )
    hang_pitch_deg: float = parameter(
        30.0,
        "Pitch at which the feet hang, toe-down: the way by which the ankles give; 0: flat",
        "deg",
        0.0,
        45.0,
        flag=False,
    )
    imu: str = parameter(
        "shank",
        "Where each ankle's IMU is; body: one for all",
        choices=tuple(each.value for each in ImuPlace),
        flag=False,
    )
    slope_deg: float = parameter(0.0, "Inclination of the ground, rising toward the toes", "deg", 0.0, 40.0)
    roughness_m: float = parameter(
        0.0, "Height from the lowest to the highest point of the ground", "m", 0.0, 0.04, flag=False
    )
    friction: float = parameter(0.8, "Coulomb friction between feet and ground", "", 0.02, 1.5)
    slip_friction: float = parameter(0.1, "What the friction becomes, where it slips", "", 0.0, 1.5, flag=False)
    slip_time_s: float = parameter(1.0, "Time after each start at which that happens", "s", 0.0, 3600.0, flag=False)
    drop_height_m: float = drop_height_option("ground")
    release_time_s: float = parameter(1.0, "Time after each start at which it is dropped", "s", 0.0, 3600.0, flag=False)
    speed_m_s: float = parameter(0.15, "Speed of walking, along the ground", "m/s", -0.3, 0.4, flag=False)
    step_period_s: float = parameter(0.5, "From one step of a foot to its next", "s", 0.3, 2.0, flag=False)
    step_height_m: float = parameter(0.03, "How high a foot is lifted", "m", 0.005, 0.08, flag=False)
    touch_down_m_s: float = parameter(0.1, "Speed at which a foot is put down", "m/s", 0.0, 0.5, flag=False)
    payload_kg: float = parameter(0.0, "What it carries", "kg", 0.0, 4.0, flag=False)
    reservoir_volume_m3: float = parameter(
        1e-4, "Reservoir of each ankle, which stores vacuum between two jams; 0: none", "m^3", 0.0, 1e-3, flag=False
    )
    parameter_set: str = parameter_set_option()
    seed: int = seed_option()
    timestep_s: float = timestep_option("a whole number of nanoseconds")


IMU_RATES_HZ = (100, 200, 500, 1000)
"""Rates at which a robot that is run by itself can be recorded: the pressures' rate divides them."""


@dataclass(frozen=True)
class RobotRunOptions(RobotOptions):
    """What can be chosen about a robot that is run by itself."""

    duration_s: float = parameter(5.0, "Simulated time", "s", 0.1, 3600.0)
    vacuum_pa: float = parameter(0.0, "Vacuum of all ankles from the start on; 0: soft", "Pa", 0.0, 75e3)
    imu_rate_hz: int = parameter(
        500, "Rate of IMU, joints, tendons and true contact: 100, 200, 500 or 1000", "Hz", 100, 1000, flag=False
    )

    def __post_init__(self) -> None:
        """Refuse a rate that does not fit.

        Raises:
            ParameterError: it is none of IMU_RATES_HZ.

        """
        if self.imu_rate_hz not in IMU_RATES_HZ:
            problem = f"it must be one of {', '.join(map(str, IMU_RATES_HZ))} Hz"
            raise ParameterError(problem, "imu_rate_hz", self.imu_rate_hz)
