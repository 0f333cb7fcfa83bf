"""What can be chosen about a robot, its ground and what it does."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from jammkle_common.parameters import parameter
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
        "jammable", "Ankles as they are, or locked for comparison", choices=tuple(each.value for each in AnkleKind)
    )
    hang_pitch_deg: float = parameter(
        30.0, "Pitch at which the feet hang, toe-down: the way by which the ankles give; 0: flat", "deg", 0.0, 45.0
    )
    imu: str = parameter(
        "shank", "Where each ankle's IMU is; body: one for all", choices=tuple(each.value for each in ImuPlace)
    )
    slope_deg: float = parameter(0.0, "Inclination of the ground, rising toward the toes", "deg", 0.0, 40.0)
    roughness_m: float = parameter(0.0, "Height from the lowest to the highest point of the ground", "m", 0.0, 0.04)
    friction: float = parameter(0.8, "Coulomb friction between feet and ground", "", 0.02, 1.5)
    slip_friction: float = parameter(0.1, "What the friction becomes, where it slips", "", 0.0, 1.5)
    slip_time_s: float = parameter(1.0, "Time after each start at which that happens", "s", 0.0, 3600.0)
    drop_height_m: float = drop_height_option("ground")
    release_time_s: float = parameter(1.0, "Time after each start at which it is dropped", "s", 0.0, 3600.0)
    speed_m_s: float = parameter(0.15, "Speed of walking, along the ground", "m/s", -0.3, 0.4)
    step_period_s: float = parameter(0.5, "From one step of a foot to its next", "s", 0.3, 2.0)
    step_height_m: float = parameter(0.03, "How high a foot is lifted", "m", 0.005, 0.08)
    touch_down_m_s: float = parameter(0.1, "Speed at which a foot is put down", "m/s", 0.0, 0.5)
    payload_kg: float = parameter(0.0, "What it carries", "kg", 0.0, 4.0)
    reservoir_volume_m3: float = parameter(
        1e-4, "Reservoir of each ankle, which stores vacuum between two jams; 0: none", "m^3", 0.0, 1e-3
    )
    parameter_set: str = parameter_set_option()
    seed: int = seed_option()
    timestep_s: float = timestep_option("a whole number of nanoseconds")
