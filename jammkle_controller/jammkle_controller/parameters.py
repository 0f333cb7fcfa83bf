"""Parameters of the controller. Ranges are chosen so that no two thresholds can contradict each other."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

from jammkle_common.constants import HELD_VACUUM_PA
from jammkle_common.parameters import ParameterError, parameter
from jammkle_controller.core.landing import LEAST_TRAVEL_M, RATED_KG, travel_m


class Mount(enum.Enum):
    """Where the IMU is mounted."""

    FOOT = "foot"
    """On the foot, or at the end of a shank that ends in a ball."""
    SHANK = "shank"
    """On the lower leg, nearer to the knee."""
    BODY = "body"
    """On the trunk, or on what stands for it in a rig."""


class PolicyMode(enum.Enum):
    """What automatic jamming does. Manual is without it (`~/set_auto`)."""

    AUTO = "auto"
    """By what is felt."""
    ALWAYS_SOFT = "always_soft"
    """Vented, whatever is felt: a baseline."""
    ALWAYS_JAMMED = "always_jammed"
    """Held, whatever is felt: a baseline."""
    FIXED = "fixed"
    """As auto, but every landing is met with one vacuum: a baseline."""


@dataclass(frozen=True)
class ControllerParameters:
    """Everything that can be set on the controller, as every part of it takes it."""

    auto_at_start: bool = parameter(
        default=True, description="Whether jamming is automatic from the start; ~/set_auto changes it later"
    )
    policy: str = parameter(
        "auto",
        "What automatic jamming does: by what is felt, or one of the baselines. Manual: ~/set_auto with false",
        choices=tuple(mode.value for mode in PolicyMode),
        dynamic=True,
    )
    imu_mount: str = parameter(
        "body",
        "Where the IMU is: on the foot, or the end of a shank that ends in a ball; on the shank; on the trunk",
        choices=tuple(mount.value for mount in Mount),
    )
    imu_rate_hz: float = parameter(
        0.0, "Rate that the IMU is configured to; twice or half of it is an error; 0: any from 50 Hz", "Hz", 0.0, 10e3
    )
    imu_link: str = parameter(
        "", "Link of the IMU in robot_description, from which the lever to the sole counts in slips; empty: no lever"
    )
    hang_pitch_deg: float = parameter(
        0.0,
        "Pitch at which the soft foot hangs, toe-down: the way that a landing has, from which an angle at rest counts",
        "deg",
        0.0,
        45.0,
    )
    stance_share: float = parameter(
        0.5, "Share of the stride that the foot stands, if only gait/phase is received", "1", 0.05, 0.95, dynamic=True
    )
    use_load: bool = parameter(
        default=False,
        description="Whether load_cell/wrench is the load on the foot, and shows contact; in a rig it is not",
        dynamic=True,
    )
    use_efforts: bool = parameter(
        default=False,
        description="Whether efforts of hip and knee in joint_states show contact; needs robot_description",
    )
    use_odometry: bool = parameter(
        default=False,
        description="Whether odom and the leg's joints show slips, by the speed of the sole; needs robot_description",
    )
    robot_description: str = parameter(
        "", "URDF of the robot, as robot_state_publisher takes it; empty: from the topic robot_description"
    )
    robot_namespace: str = parameter(
        "", "Namespace of odom and robot_description: / where several ankles share them; empty: that of this node"
    )
    joint_prefix: str = parameter(
        "", "What robot_description puts before the names of this leg's joints in joint_states, as lf_"
    )
    hip_joint: str = parameter("hip", "Joint of the thigh in joint_states: pitch, counted from straight down")
    knee_joint: str = parameter("knee", "Joint of the shank, counted from the thigh")
    armature_kg_m2: float = parameter(
        0.004,
        "Inertia of the motors of hip and knee behind their gears, for which URDF has no word; of our simulated legs",
        "kg m^2",
        0.0,
        1.0,
    )
    odometry_spread_m_s: float = parameter(
        0.04,
        "Standard deviation of the odometry's velocity, per axis, where its covariance is zero: noise of 0.03 and "
        "drift of 0.025 m/s, assumed",
        "m/s",
        0.001,
        1.0,
    )
    command_rate_hz: float = parameter(
        20.0,
        "How often jam_command is repeated, by a steady clock; must be well above the inverse of the driver's "
        "command_timeout_s",
        "Hz",
        5.0,
        100.0,
    )
    imu_timeout_s: float = parameter(0.2, "Silence of the IMU that is reported as an error", "s", 0.02, 10.0)
    imu_frozen_s: float = parameter(
        0.3, "Time over which an IMU may repeat one reading before it is frozen", "s", 0.05, 5.0, dynamic=True
    )
    jam_delay_s: float = parameter(
        0.02,
        "Time from IMPACT to jamming, by the stamps of the IMU; longer than the shock, which takes about 10 ms",
        "s",
        0.0,
        1.0,
        dynamic=True,
    )
    landing_vacuum_pa: float = parameter(
        40e3, "Vacuum in the air and at the landing, with policy fixed alone", "Pa", 5e3, 80e3, dynamic=True
    )
    load_kg: float = parameter(
        RATED_KG, "What falls on this ankle in a landing; more counts where load or efforts show it", "kg", 0.1, 100.0
    )
    slope_deg: float = parameter(
        0.0,
        "Slope of the ground that is landed on, rising toward the toes, where it is known: more way, so less vacuum",
        "deg",
        0.0,
        40.0,
        dynamic=True,
    )
    hold_vacuum_pa: float = parameter(
        40e3,
        "Vacuum of a stance; at most the driver's max_vacuum_pa. Less than full_vacuum_pa, so that a slip finds more",
        "Pa",
        5e3,
        80e3,
        dynamic=True,
    )
    full_vacuum_pa: float = parameter(
        HELD_VACUUM_PA,
        "Vacuum after a slip; at most the driver's max_vacuum_pa. The paper's pump is known to hold 50 kPa",
        "Pa",
        5e3,
        80e3,
        dynamic=True,
    )
    side_first_s: float = parameter(
        0.1,
        "How long the channels of the side that slips are jammed alone, where nothing is jammed yet; 0: all at once",
        "s",
        0.0,
        1.0,
        dynamic=True,
    )
    recover_s: float = parameter(
        2.0, "Time in the state recovering, before the vacuum of a stance is enough again", "s", 0.0, 60.0, dynamic=True
    )
    flight_threshold_m_s2: float = parameter(
        3.0,
        "|specific force| below which nothing carries the body; leaves 3 m/s^2 for friction of a rig and for spin",
        "m/s^2",
        0.5,
        3.5,
        dynamic=True,
    )
    impact_threshold_m_s2: float = parameter(
        6.0,
        "Rise of |specific force| above g that is an IMPACT on a body that stands; vibration of as much raises none",
        "m/s^2",
        2.0,
        60.0,
        dynamic=True,
    )
    slip_speed_m_s: float = parameter(
        0.025,
        "Least speed of the sole that is a SLIP, on a body gained after a step of the acceleration; what shakes by "
        "0.55 m/s^2 at 10 Hz reaches 0.018 m/s",
        "m/s",
        0.01,
        1.0,
        dynamic=True,
    )
    slip_probability: float = parameter(
        0.8, "Probability from which on the sole of a foot or shank slides", "1", 0.5, 0.999, dynamic=True
    )
    swing_probability: float = parameter(
        0.85, "Probability of swing above which a foot or shank has left the ground", "1", 0.5, 0.999, dynamic=True
    )
    raised_foot_m: float = parameter(
        0.08,
        "Height above its last rest at which a foot or shank has left the ground, however slowly; a leg of 0.3 m that "
        "straightens by 40 degrees raises an IMU whose sole is not given by 0.07 m",
        "m",
        0.03,
        1.0,
        dynamic=True,
    )
    raised_body_m: float = parameter(
        0.45,
        "Height above its last rest at which a body has been picked up: more than its legs raise it",
        "m",
        0.05,
        3.0,
        dynamic=True,
    )

    def __post_init__(self) -> None:
        """Check what two parameters say together.

        Raises:
            ParameterError: a stance is held with more vacuum than a slip, which would then find less.

        """
        if self.hold_vacuum_pa > self.full_vacuum_pa:
            msg = (
                f"parameter 'hold_vacuum_pa' is {self.hold_vacuum_pa:g} Pa; it must be at most full_vacuum_pa, "
                f"{self.full_vacuum_pa:g} Pa: raise that first, or lower this"
            )
            raise ParameterError(msg)

    @property
    def mount(self) -> Mount:
        """Where the IMU is."""
        return Mount(self.imu_mount)

    @property
    def mode(self) -> PolicyMode:
        """What automatic jamming does."""
        return PolicyMode(self.policy)

    @property
    def hang_pitch_rad(self) -> float:
        """Pitch at which the soft foot hangs, rad."""
        return math.radians(self.hang_pitch_deg)

    @property
    def takes_blows(self) -> bool:
        """Whether the foot hangs so that the ankle can give in a landing."""
        return travel_m(self.hang_pitch_rad) >= LEAST_TRAVEL_M

    @property
    def landing_travel_m(self) -> float:
        """By how much the Achilles pair is stretched until the sole is flat, on the slope that is known, m."""
        return travel_m(self.hang_pitch_rad, math.radians(self.slope_deg))

    @property
    def raised_m(self) -> float:
        """Height, m, at which what the IMU is on does not stand any more."""
        return self.raised_body_m if self.mount is Mount.BODY else self.raised_foot_m

    @property
    def needs_leg(self) -> bool:
        """Whether the leg must be known from robot_description."""
        return self.use_efforts or self.use_odometry or bool(self.imu_link)
