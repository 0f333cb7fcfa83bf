"""Parameters of the controller. Ranges are chosen so that no two thresholds can contradict each other."""

from __future__ import annotations

from dataclasses import dataclass

from jammkle_controller.core.detector import DetectorSettings
from jammkle_controller.core.impact import ImpactSettings
from jammkle_controller.core.liftoff import LiftoffSettings
from jammkle_controller.core.policy import PolicySettings
from jammkle_controller.core.settled import SettledSettings
from jammkle_controller.core.slip import SlipSettings
from jammkle_graph.constants import HELD_VACUUM_PA
from jammkle_graph.parameters import parameter


@dataclass(frozen=True)
class ControllerParameters:
    """Everything that can be set on the controller."""

    auto_at_start: bool = parameter(
        default=True, description="Whether jamming is automatic from the start; ~/set_auto changes it later"
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
    hold_vacuum_pa: float = parameter(
        HELD_VACUUM_PA, "Vacuum of a stance; at most the driver's max_vacuum_pa", "Pa", 5e3, 80e3, dynamic=True
    )
    full_vacuum_pa: float = parameter(
        HELD_VACUUM_PA,
        "Vacuum after a slip; at most the driver's max_vacuum_pa. The paper's pump is known to hold 50 kPa",
        "Pa",
        5e3,
        80e3,
        dynamic=True,
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
    impact_jump_m_s2: float = parameter(
        12.0,
        "Jump of |specific force| that is an IMPACT on the ground; vibration of up to half of it raises none",
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
        0.06,
        "Speed gained from rest that is a SLIP; below an acceleration of 20 /s times it none is reported",
        "m/s",
        0.01,
        1.0,
        dynamic=True,
    )


def detector_settings(values: ControllerParameters) -> DetectorSettings:
    """Pick what the detectors need."""
    return DetectorSettings(
        impact=ImpactSettings(values.touchdown_threshold_m_s2, values.impact_jump_m_s2, values.refractory_s),
        liftoff=LiftoffSettings(values.flight_threshold_m_s2, values.flight_confirm_s),
        settled=SettledSettings(values.settle_window_s, values.settle_rms_m_s2, values.settle_rms_rad_s),
        slip=SlipSettings(values.slip_speed_m_s),
        max_gap_s=values.max_gap_s,
    )


def policy_settings(values: ControllerParameters) -> PolicySettings:
    """Pick what the policy needs."""
    return PolicySettings(values.jam_delay_s, values.hold_vacuum_pa, values.full_vacuum_pa)
