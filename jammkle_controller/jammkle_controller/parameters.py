"""Parameters of the controller. Ranges are chosen so that no two thresholds can contradict each other."""

from __future__ import annotations

from dataclasses import dataclass

from jammkle_common.constants import HELD_VACUUM_PA
from jammkle_common.parameters import ParameterError, parameter
from jammkle_controller.core.detector_settings import Mount
from jammkle_controller.core.policy import PolicyMode


@dataclass(frozen=True)
class ControllerParameters:
    """Everything that can be set on the controller."""

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
    sole_x_m: float = parameter(0.0, "From the IMU to the sole, along x of the IMU; for slip", "m", -2.0, 2.0)
    sole_y_m: float = parameter(0.0, "From the IMU to the sole, along y of the IMU; for slip", "m", -2.0, 2.0)
    sole_z_m: float = parameter(0.0, "From the IMU to the sole, along z of the IMU; for slip", "m", -2.0, 2.0)
    stance_share: float = parameter(
        0.5,
        "Share of the stride that the foot stands, if only gait/phase is heard",
        "1",
        0.05,
        0.95,
        dynamic=True,
    )
    use_load: bool = parameter(
        default=False,
        description="Whether load_cell/wrench is the load on the foot, and shows contact; in a rig it is not",
        dynamic=True,
    )
    use_efforts: bool = parameter(
        default=False,
        description="Whether efforts of hip and knee in joint_states show contact; the leg's constants below must fit",
    )
    hip_joint: str = parameter("hip", "Joint of the thigh in joint_states: pitch, counted from straight down")
    knee_joint: str = parameter("knee", "Joint of the shank, counted from the thigh")
    thigh_m: float = parameter(0.15, "From hip to knee; this and what follows is of our simulated legs", "m", 0.02, 2.0)
    shank_m: float = parameter(0.15, "From knee to ankle", "m", 0.02, 2.0)
    thigh_kg: float = parameter(0.35, "Mass of the thigh, taken for a rod", "kg", 0.0, 50.0)
    shank_kg: float = parameter(0.502, "Mass of the shank with ankle and foot, taken for a rod", "kg", 0.0, 50.0)
    shank_centre_m: float = parameter(0.102, "From the knee to the centre of that mass", "m", 0.0, 2.0)
    armature_kg_m2: float = parameter(
        0.004, "Inertia of the motors of hip and knee behind their gears", "kg m^2", 0.0, 1.0
    )
    use_odometry: bool = parameter(
        default=False,
        description="Whether odom and the leg's joints show slips, by the speed of the sole; geometry below must fit",
    )
    odometry_topic: str = parameter(
        "odom", "Where the odometry of the body is: /odom, for instance, where several ankles share it"
    )
    odometry_spread_m_s: float = parameter(
        0.04,
        "Standard deviation of the odometry's velocity, per axis, where its covariance is zero: noise of 0.03 and "
        "drift of 0.025 m/s, assumed",
        "m/s",
        0.001,
        1.0,
    )
    abduction_joint: str = parameter("abduction", "Joint of the hip in joint_states, about x; absent: there is none")
    hip_x_m: float = parameter(0.0, "Axis of abduction, or the hip without one, forward of base_link", "m", -2.0, 2.0)
    hip_y_m: float = parameter(0.0, "To the left of base_link", "m", -2.0, 2.0)
    hip_z_m: float = parameter(0.0, "Above base_link", "m", -2.0, 2.0)
    hip_offset_m: float = parameter(
        0.0, "From the axis of abduction to the left to the plane of the leg; negative: right", "m", -1.0, 1.0
    )
    ankle_lean_rad: float = parameter(
        0.5223, "Pitch of the ankle's frame against the shank's: the shank's lean as it stands", "rad", -1.6, 1.6
    )
    toe_m: float = parameter(0.06, "From the ankle's joint forward to the toe's corners; as of ours", "m", 0.0, 0.5)
    heel_m: float = parameter(0.045, "From the ankle's joint backward to the heel's corners", "m", 0.0, 0.5)
    foot_half_width_m: float = parameter(0.03, "From the middle of the sole to its corners, sideways", "m", 0.0, 0.5)
    sole_depth_m: float = parameter(0.02, "From the ankle's joint down to the sole", "m", 0.0, 0.5)
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
    imu_recover_s: float = parameter(
        0.5, "Time for which an IMU must be in order before it is believed again", "s", 0.0, 60.0, dynamic=True
    )
    max_gap_s: float = parameter(
        0.1,
        "Longest interval between two IMU samples over which they are still compared",
        "s",
        0.01,
        1.0,
        dynamic=True,
    )
    jam_delay_s: float = parameter(
        0.02,
        "Time from IMPACT to jamming, by the stamps of the IMU; longer than the shock, which takes about 10 ms",
        "s",
        0.0,
        1.0,
        dynamic=True,
    )
    jam_lead_s: float = parameter(
        0.03,
        "How long before a foreseen touch-down jamming begins; below 36 ms the fibres do not grip before the shock",
        "s",
        0.0,
        1.0,
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
    slip_hold_s: float = parameter(
        0.5,
        "From the last slip to the state recovering, at full_vacuum_pa: the pump takes as long",
        "s",
        0.0,
        10.0,
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
    flight_confirm_s: float = parameter(
        0.03,
        "Time of free fall after which LIFTOFF is reported: a hop of 1 mm lasts as long, and is no reason to vent",
        "s",
        0.005,
        0.2,
        dynamic=True,
    )
    touchdown_threshold_m_s2: float = parameter(
        4.0, "|specific force| above which a flight has ended in an IMPACT", "m/s^2", 3.6, 9.0, dynamic=True
    )
    impact_threshold_m_s2: float = parameter(
        6.0,
        "Rise of |specific force| above g that is an IMPACT on a body that stands; vibration of as much raises none",
        "m/s^2",
        2.0,
        60.0,
        dynamic=True,
    )
    refractory_s: float = parameter(
        0.15,
        "Time after an IMPACT in which the ground gives no other; a new flight ends it early",
        "s",
        0.0,
        2.0,
        dynamic=True,
    )
    settle_window_s: float = parameter(
        0.2, "Time for which the body must be quiet to be at rest", "s", 0.05, 5.0, dynamic=True
    )
    settle_rms_m_s2: float = parameter(
        0.5,
        "Largest rms of | |specific force| - g | at rest; leaves 0.05 g for the bias of a cheap accelerometer",
        "m/s^2",
        0.05,
        3.0,
        dynamic=True,
    )
    settle_rms_rad_s: float = parameter(
        0.2, "Largest rms of the angular velocity at rest", "rad/s", 0.01, 3.0, dynamic=True
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
    slip_step_m_s2: float = parameter(
        0.4,
        "Step of the acceleration that may be a SLIP; a body that sways by 10 mm at 3 Hz makes 0.28 m/s^2",
        "m/s^2",
        0.1,
        10.0,
        dynamic=True,
    )
    landed_slip_speed_m_s: float = parameter(
        0.25,
        "Speed along the ground after an impact that is a SLIP of a foot that has not stood",
        "m/s",
        0.05,
        2.0,
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
    stance_probability: float = parameter(
        0.1, "Probability of swing below which it stands, blow or none", "1", 0.001, 0.5, dynamic=True
    )
    touchdown_probability: float = parameter(
        0.5, "Probability from which on a blow in a swing is a touch-down", "1", 0.05, 0.99
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
