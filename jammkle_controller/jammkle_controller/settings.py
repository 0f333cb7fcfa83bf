"""What the cores of the controller are set up with, picked from its parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_controller.core.controller import ControllerSettings
from jammkle_controller.core.detector_settings import DetectorSettings, Mount
from jammkle_controller.core.impact import ImpactSettings
from jammkle_controller.core.inputs import InputSettings
from jammkle_controller.core.leg_load import LegModel
from jammkle_controller.core.liftoff import LiftoffSettings
from jammkle_controller.core.policy import PolicyMode, PolicySettings
from jammkle_controller.core.raised import RaiseSettings
from jammkle_controller.core.settled import SettledSettings
from jammkle_controller.core.slip import SlipSettings
from jammkle_controller.core.sole_slip import SoleSettings
from jammkle_controller.core.sole_speed import LegGeometry
from jammkle_controller.core.swing import SwingSettings
from jammkle_controller.core.watch import WatchSettings

if TYPE_CHECKING:
    from jammkle_controller.parameters import ControllerParameters


def detector_settings(values: ControllerParameters) -> DetectorSettings:
    """Pick what the detectors need."""
    return DetectorSettings(
        impact=ImpactSettings(values.touchdown_threshold_m_s2, values.impact_threshold_m_s2, values.refractory_s),
        liftoff=LiftoffSettings(values.flight_threshold_m_s2, values.flight_confirm_s),
        raised=RaiseSettings(
            values.raised_body_m if values.imu_mount == Mount.BODY.value else values.raised_foot_m,
        ),
        settled=SettledSettings(values.settle_window_s, values.settle_rms_m_s2, values.settle_rms_rad_s),
        slip=SlipSettings(
            values.slip_speed_m_s,
            values.slip_step_m_s2,
            values.landed_slip_speed_m_s,
            values.slip_probability,
            (values.sole_x_m, values.sole_y_m, values.sole_z_m),
        ),
        swing=SwingSettings(values.swing_probability, values.stance_probability),
        watch=WatchSettings(values.imu_rate_hz, values.imu_frozen_s, values.imu_recover_s),
        mount=Mount(values.imu_mount),
        touchdown_probability=values.touchdown_probability,
        max_gap_s=values.max_gap_s,
    )


def policy_settings(values: ControllerParameters) -> PolicySettings:
    """Pick what the policy needs."""
    return PolicySettings(
        mode=PolicyMode(values.policy),
        jam_delay_s=values.jam_delay_s,
        jam_lead_s=values.jam_lead_s,
        hold_vacuum_pa=values.hold_vacuum_pa,
        full_vacuum_pa=values.full_vacuum_pa,
        side_first_s=values.side_first_s,
        slip_hold_s=values.slip_hold_s,
        recover_s=values.recover_s,
    )


def controller_settings(values: ControllerParameters) -> ControllerSettings:
    """Pick what the controller needs."""
    return ControllerSettings(
        detector_settings(values),
        policy_settings(values),
        InputSettings(
            values.stance_share,
            values.use_load,
            leg_model(values) if values.use_efforts else None,
            sole_settings(values) if values.use_odometry else None,
        ),
    )


def leg_model(values: ControllerParameters) -> LegModel:
    """Pick what the leg is."""
    return LegModel(
        values.thigh_m,
        values.shank_m,
        values.thigh_kg,
        values.shank_kg,
        values.shank_centre_m,
        values.armature_kg_m2,
    )


def sole_settings(values: ControllerParameters) -> SoleSettings:
    """Pick what the speed of the sole follows from."""
    return SoleSettings(
        LegGeometry(
            hip_m=(values.hip_x_m, values.hip_y_m, values.hip_z_m),
            offset_m=values.hip_offset_m,
            thigh_m=values.thigh_m,
            shank_m=values.shank_m,
            lean_rad=values.ankle_lean_rad,
            toe_m=values.toe_m,
            heel_m=values.heel_m,
            half_width_m=values.foot_half_width_m,
            sole_m=values.sole_depth_m,
        ),
        values.odometry_spread_m_s,
        values.imu_frozen_s,
    )
