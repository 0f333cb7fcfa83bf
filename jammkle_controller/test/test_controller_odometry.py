"""How fast the sole goes, from odometry and joints; slips detected from it, and what is done when it is missing."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from controller_bench import LEG
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]  # carries no types

from jammkle_controller.core.controller import AnkleController
from jammkle_controller.core.events import ContactEvent, ContactKind, Source
from jammkle_controller.core.imu import ImuSample
from jammkle_controller.core.inputs import Input
from jammkle_controller.core.reading import Received
from jammkle_controller.core.slip import FALSE_ALARM_S, BodyTwist, LegPose, SoleSlip, sole_velocity_m_s
from jammkle_controller.parameters import ControllerParameters

if TYPE_CHECKING:
    from jammkle_controller.core.leg import Leg

STEP_NS = 10_000_000
PLACE = dataclasses.replace(
    LEG, hip_m=(0.19, 0.06, -0.01), offset_m=0.05, thigh_m=0.16, shank_m=0.14, lean_rad=0.5, abduction="abduction"
)
ODOMETRY = ControllerParameters(use_odometry=True)
STILL = LegPose(0.0, 0.52, -1.05, 0.0, 0.0, 0.0, *(0.0,) * 6)
GRAVITY_M_S2 = 9.80665


def foot_in_body(leg: Leg, angles: np.ndarray) -> tuple[Rotation, np.ndarray]:
    """Return how the foot is turned in the body, and where its joint is, by rotations one after the other."""
    abduction, hip, knee, pitch, roll, yaw = angles
    hinge = Rotation.from_euler("x", abduction)
    thigh = hinge * Rotation.from_euler("y", hip)
    shank = thigh * Rotation.from_euler("y", knee)
    place = np.array(leg.hip_m) + hinge.apply([0.0, leg.offset_m, 0.0])
    place = place + thigh.apply([0.0, 0.0, -leg.thigh_m]) + shank.apply([0.0, 0.0, -leg.shank_m])
    return shank * Rotation.from_euler("y", leg.lean_rad) * Rotation.from_euler("YXZ", [pitch, roll, yaw]), place


@settings(max_examples=40, deadline=None)
@given(
    angles=st.lists(st.floats(-0.8, 0.8), min_size=6, max_size=6),
    rates=st.lists(st.floats(-5.0, 5.0), min_size=6, max_size=6),
)
def test_the_sole_of_a_foot_that_stands_is_still_however_the_body_moves_over_it(
    angles: list[float], rates: list[float]
) -> None:
    """The body is moved by its joints over a foot that is fixed in the world, and its twist is differentiated there."""

    def body(time_s: float) -> tuple[Rotation, np.ndarray]:
        turned, place = foot_in_body(PLACE, np.array(angles) + time_s * np.array(rates))
        return turned.inv(), -turned.inv().apply(place)

    small_s = 1e-5
    (before, place_before), (now, _), (after, place_after) = body(-small_s), body(0.0), body(small_s)
    linear = now.inv().apply((place_after - place_before) / (2.0 * small_s))
    angular = now.inv().apply((after * before.inv()).as_rotvec() / (2.0 * small_s))
    twist = BodyTwist(0, tuple(linear), tuple(angular))
    assert np.abs(sole_velocity_m_s(PLACE, LegPose(*angles, *rates), twist)).max() < 1e-6
    gone = sole_velocity_m_s(PLACE, LegPose(*angles, *rates), twist._replace(linear_m_s=tuple(linear + 0.1)))
    assert gone == pytest.approx((0.1, 0.1, 0.1), abs=1e-6)


def test_a_foot_that_rolls_over_its_toe_does_not_slide() -> None:
    """A foot pitched toe-down turns about the toe's edge: the joint above it moves, and the sole stands still there."""
    pitch_rad, rate_rad_s = 0.4, 3.0
    sine, cosine = math.sin(pitch_rad), math.cos(pitch_rad)
    toe = np.array([PLACE.toe_m * cosine - PLACE.sole_m * sine, 0.0, -PLACE.toe_m * sine - PLACE.sole_m * cosine])
    leg = STILL._replace(hip_rad=0.2, knee_rad=-PLACE.lean_rad - 0.2, pitch_rad=pitch_rad, pitch_rad_s=rate_rad_s)
    ankle = -np.cross([0.0, rate_rad_s, 0.0], toe)  # the body does not turn, and carries the joint about the toe
    twist = BodyTwist(0, tuple(ankle), (0.0, 0.0, 0.0))
    assert np.linalg.norm(ankle) > 0.1
    assert np.abs(sole_velocity_m_s(PLACE, leg, twist)).max() < 1e-5  # the heel counts a little
    unread = leg._replace(pitch_rad=math.nan)
    assert sole_velocity_m_s(PLACE, unread, twist) == pytest.approx(tuple(ankle))


def slips(noise_m_s: float, told_m_s: float, minutes: float, seed: int, drift_m_s: float = 0.0) -> int:
    """Count the slips of a foot that stands still, of an odometry with noise and a drift that lasts 2 s."""
    sole, chance = (
        SoleSlip(PLACE, dataclasses.replace(ODOMETRY, odometry_spread_m_s=told_m_s)),
        np.random.default_rng(seed),
    )
    count, drift = 0, chance.normal(0.0, drift_m_s, 3)
    for index in range(round(minutes * 6000)):
        drift += -0.005 * drift + chance.normal(0.0, 0.1 * drift_m_s, 3)
        sole.on_pose(STILL, index * STEP_NS, stands=True)
        twist = BodyTwist(index * STEP_NS, tuple((drift + chance.normal(0.0, noise_m_s, 3)).tolist()), (0.0, 0.0, 0.0))
        count += sole.on_twist(twist, index * STEP_NS) is not None
    return count


def test_false_alarms_of_noise_are_as_rare_as_asked_for() -> None:
    """White noise of which the odometry reports alarms once a minute at most, and less, where least ways are larger."""
    assert slips(0.25, 0.25, 6.0, 1) <= 2.0 * 6.0 * 60.0 / FALSE_ALARM_S
    assert slips(0.03, 0.04, 2.0, 2, drift_m_s=0.025) <= 2
    assert slips(0.25, 0.04, 0.2, 3) > 10  # one that is ten times as noisy as it says


def feel(controller: AnkleController, index: int) -> list[ContactEvent]:
    """Let a controller feel rest on the body's IMU, and receive its switch closed."""
    chance = np.random.default_rng(index)
    time_ns, reported = index * STEP_NS, []
    reported += controller.take(Received(time_ns, Input.CONTACT_SWITCH, 1.0)).events
    for part in range(5):
        force = chance.normal((0.0, 0.0, GRAVITY_M_S2), 0.02).tolist()
        reported += controller.update(ImuSample(time_ns + part * 2_000_000, *force, 0.0, 0.0, 0.0)).events
    return reported


@pytest.mark.parametrize("mount", ["foot", "shank", "body"])
@pytest.mark.parametrize("latency", [-1, 0, 1, 3])
def test_a_steady_slide_is_reported_with_odometry_and_not_without(mount: str, latency: int) -> None:
    """A foot that slides at 0.2 m/s with its body, which no IMU feels, is reported within 40 ms and the latency, once.

    The odometry may come before the leg of the same time, too.
    """
    chance = np.random.default_rng(5)
    reported = {}
    for received in (True, False):
        controller = AnkleController(ControllerParameters(imu_mount=mount, use_odometry=received), leg=LEG)
        events, late = [], []
        for index in range(400):
            speed = np.array([0.0, -0.2 if 200 <= index < 250 else 0.0, 0.0]) + chance.normal(0.0, 0.03, 3)
            late.append(BodyTwist(index * STEP_NS, tuple(speed.tolist()), (0.0, 0.0, 0.0)))
            if latency < 0:
                events += controller.take(Received(index * STEP_NS, late[index])).events
            events += controller.take(Received(index * STEP_NS, STILL)).events
            if 0 <= latency <= index:
                events += controller.take(Received(index * STEP_NS, late[index - latency])).events
            events += feel(controller, index)
        reported[received] = [event for event in events if event.kind is ContactKind.SLIP]
    (slip,) = reported[True]
    assert reported[False] == []
    assert 0.0 < slip.time_ns / 1e9 - 2.0 <= 0.04 + 0.01 * latency
    assert (slip.source, slip.unit) == (Source.ODOMETRY, "m/s")
    assert slip.magnitude == pytest.approx(0.2, abs=0.06)
    assert slip.direction[1] < -0.9
    assert 0.0 < slip.detection_delay_s <= 0.06 + 0.01 * latency


def test_a_foot_in_the_air_or_that_is_lifted_does_not_slip() -> None:
    """What moves with the foot off the ground, or upward, is no slip, and begins none when it is put down."""
    sole = SoleSlip(PLACE, dataclasses.replace(ODOMETRY, odometry_spread_m_s=0.04))
    chance, reported = np.random.default_rng(1), []
    for index in range(200):
        up = 0.3 if 100 <= index < 150 else 0.0
        speed = np.array([0.4 if index < 50 or up else 0.0, 0.0, up]) + chance.normal(0.0, 0.02, 3)
        sole.on_pose(STILL, index * STEP_NS, stands=index >= 50)
        twist = BodyTwist(index * STEP_NS, tuple(speed.tolist()), (0.0, 0.0, 0.0))
        reported.append(sole.on_twist(twist, index * STEP_NS))
    assert not any(reported)


def test_odometry_that_cannot_be_believed_reports_nothing_and_leaves_slips_to_the_imu() -> None:
    """NaN, repeated or late stamps, one reading for ever, legs that fall silent: all are counted, none is a slip."""
    parameters = ControllerParameters(imu_mount="shank", use_odometry=True)
    moving = BodyTwist(0, (0.5, 0.0, 0.0), (0.0, 0.0, 0.0))
    for spoil, count in (
        (lambda i: moving._replace(time_ns=i * STEP_NS, linear_m_s=(math.nan, 0.0, 0.0)), "not_finite"),
        (lambda i: moving._replace(time_ns=i * STEP_NS, angular_rad_s=(0.0, math.inf, 0.0)), "not_finite"),
        (lambda i: moving._replace(time_ns=500 * STEP_NS - (i % 90) * STEP_NS), "late"),
        (lambda i: moving._replace(time_ns=i * STEP_NS), "frozen"),
        (lambda i: moving._replace(time_ns=(i - 90) * STEP_NS, linear_m_s=(0.5 + 1e-6 * i, 0.0, 0.0)), "unmatched"),
    ):
        sole, reported = SoleSlip(LEG, parameters), []
        for index in range(100, 200):
            reported.append(sole.on_pose(STILL, index * STEP_NS, stands=True))
            reported.append(sole.on_twist(spoil(index), index * STEP_NS))
        assert getattr(sole.counts, count) >= 60
        assert sum(each is not None for each in reported) <= (count == "frozen")  # before it is known to be frozen
    controller = AnkleController(parameters, leg=LEG)
    for index in range(200):
        controller.take(Received(index * STEP_NS, STILL._replace(hip_rad=math.nan if index >= 100 else 0.52)))
        chance = np.random.default_rng(index)
        speed = tuple(chance.normal(0.0, 0.02, 3).tolist())
        controller.take(Received(index * STEP_NS, BodyTwist(index * STEP_NS, speed, (0.0, 0.0, 0.0))))
        feel(controller, index)
        if index < 10:  # an IMU is looked at first
            continue
        assert controller.inputs.shows_slips(index * STEP_NS) == (index < 149)
        assert (Input.ODOMETRY in controller.inputs.received(index * STEP_NS)) == (index < 149)


@pytest.mark.parametrize("frozen_s", [0.1, 1.0])
def test_a_parameter_that_changes_counts_for_the_odometry_too(frozen_s: float) -> None:
    """One reading over and over is frozen after imu_frozen_s as it is set now, not as it was at the start."""
    parameters = ControllerParameters(use_odometry=True)
    controller = AnkleController(parameters, leg=LEG)
    controller.configure(dataclasses.replace(parameters, imu_frozen_s=frozen_s))
    for index in range(200):
        controller.take(Received(index * STEP_NS, STILL))
        controller.take(Received(index * STEP_NS, BodyTwist(index * STEP_NS, (0.01, 0.0, 0.0), (0.0, 0.0, 0.0))))
    assert controller.inputs.sole.counts.frozen == pytest.approx(200 - frozen_s * 1e9 / STEP_NS, abs=2)
