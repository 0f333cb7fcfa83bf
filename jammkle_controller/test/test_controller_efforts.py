"""The load on a foot from efforts of hip and knee, and what a controller makes of it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from controller_bench import LEG
from hypothesis import given, settings
from hypothesis import strategies as st

from jammkle_controller.core.controller import AnkleController
from jammkle_controller.core.events import ContactKind, Source
from jammkle_controller.core.imu import ImuSample
from jammkle_controller.core.inputs import Input
from jammkle_controller.core.leg_contact import SPREAD_N, LegLoad, LegReading, LoadContact
from jammkle_controller.core.policy import PolicyState
from jammkle_controller.core.reading import Received
from jammkle_controller.parameters import ControllerParameters

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

ARMATURE_KG_M2 = 0.004
GRAVITY_M_S2 = 9.80665
HIP_RAD, KNEE_RAD = 0.52, -1.05  # as it stands

few = settings(max_examples=30, deadline=None)


def foot_m(hip: float, knee: float) -> NDArray[np.float64]:
    """Place of the foot from the hip: backward is negative, down is negative."""
    return -np.array(
        [
            LEG.thigh_m * math.sin(hip) + LEG.shank_m * math.sin(hip + knee),
            LEG.thigh_m * math.cos(hip) + LEG.shank_m * math.cos(hip + knee),
        ]
    )


def potential_j(hip: float, knee: float) -> float:
    """Energy of the leg's weight, from its centres."""
    thigh = -LEG.thigh_m / 2.0 * math.cos(hip)
    shank = -LEG.thigh_m * math.cos(hip) - LEG.shank_centre_m * math.cos(hip + knee)
    return GRAVITY_M_S2 * (LEG.thigh_kg * thigh + LEG.shank_kg * shank)


def kinetic_j(_hip: float, knee: float, hip_rate: float, knee_rate: float) -> float:
    """Energy of motion of both rods and both motors, summed over small pieces of them."""
    pieces = (np.arange(2000) + 0.5) / 2000.0
    both = hip_rate + knee_rate
    thigh = np.mean((pieces * LEG.thigh_m * hip_rate) ** 2)
    along = 2.0 * LEG.shank_centre_m * pieces
    shank = np.mean(
        (LEG.thigh_m * hip_rate) ** 2
        + (along * both) ** 2
        + 2.0 * LEG.thigh_m * hip_rate * along * both * math.cos(knee)
    )
    motors = ARMATURE_KG_M2 * (hip_rate**2 + knee_rate**2)
    return float(LEG.thigh_kg * thigh + LEG.shank_kg * shank + motors) / 2.0


def derivative(of: Callable[[float], float]) -> float:
    """Differentiate at 0."""
    return (of(1e-4) - of(-1e-4)) / 2e-4


def torques(hip: float, knee: float, force_n: tuple[float, float]) -> tuple[float, float]:
    """Efforts that hold a leg still whose foot is pushed, by virtual work."""
    push = np.array(force_n)
    return (
        derivative(lambda d: potential_j(hip + d, knee) - float(push @ foot_m(hip + d, knee))),
        derivative(lambda d: potential_j(hip, knee + d) - float(push @ foot_m(hip, knee + d))),
    )


@few
@given(
    hip=st.floats(-0.6, 1.2),
    knee=st.floats(-2.2, -0.2),
    up_n=st.floats(-20.0, 100.0),
    along_n=st.floats(-30.0, 30.0),
)
def test_the_load_on_a_foot_that_stands_still_is_found_whatever_rubs(
    hip: float, knee: float, up_n: float, along_n: float
) -> None:
    """In any pose the upward force comes out of the torques that hold it, and friction does not count."""
    load, reading = LegLoad(LEG, ARMATURE_KG_M2), LegReading(hip, knee, 0.0, 0.0, *torques(hip, knee, (along_n, up_n)))
    reported = [load.update(reading, 2_000_000 * index) for index in range(50)]
    assert reported[0] is None
    assert reported[-1] == pytest.approx(up_n, abs=0.05)


def test_a_leg_that_swings_freely_bears_nothing() -> None:
    """Efforts by Lagrange's equations of a fast swing, 8 rad/s, leave less than half of SPREAD_N at 500 Hz.

    Without the terms of motion the same efforts would be a load of five times as much.
    """

    def way(time_s: float) -> tuple[float, float]:
        return 0.5 + 0.4 * math.sin(15.0 * time_s), -1.1 + 0.5 * math.sin(15.0 * time_s + 1.0)

    def rates(time_s: float) -> tuple[float, float]:
        return derivative(lambda d: way(time_s + d)[0]), derivative(lambda d: way(time_s + d)[1])

    def momentum(time_s: float, which: int) -> float:
        place, rate = way(time_s), np.array(rates(time_s))
        step = np.eye(2)[which]
        return derivative(lambda d: kinetic_j(*place, *(rate + d * step).tolist()))

    def effort(time_s: float, which: int) -> float:
        rate, step = rates(time_s), np.eye(2)[which]

        def energy(d: float) -> float:
            place = (np.array(way(time_s)) + d * step).tolist()
            return kinetic_j(*place, *rate) - potential_j(*place)

        return derivative(lambda d: momentum(time_s + d, which)) - derivative(energy)

    load = LegLoad(LEG, ARMATURE_KG_M2)
    times_s = np.arange(0.0, 0.3, 0.002).tolist()
    reported, still = [], []
    for at_s in times_s:
        efforts = effort(at_s, 0), effort(at_s, 1)
        reported.append(load.update(LegReading(*way(at_s), *rates(at_s), *efforts), round(at_s * 1e9)))
        held = LegLoad(LEG, ARMATURE_KG_M2)
        at_rest = [held.update(LegReading(*way(at_s), 0.0, 0.0, *efforts), 2_000_000 * index) for index in range(20)]
        still.append(abs(at_rest[-1] or 0.0))
    assert max(abs(each or 0.0) for each in reported[10:]) < 0.5 * SPREAD_N
    assert max(still) > 5.0 * SPREAD_N


def test_what_a_leg_cannot_report_is_not_reported() -> None:
    """A straight leg, a NaN, and readings that are far apart or come late report no load."""
    load = LegLoad(LEG, ARMATURE_KG_M2)
    bent, straight = LegReading(HIP_RAD, KNEE_RAD, 0, 0, 0, 0), LegReading(0.0, -0.05, 0, 0, 0, 0)
    assert load.update(bent, 0) is None
    assert load.update(bent, 2_000_000) is not None
    assert load.update(straight, 4_000_000) is None
    assert load.update(bent._replace(knee_n_m=math.nan), 6_000_000) is None
    assert load.update(bent, 6_000_000_000) is None
    assert load.update(bent, 5_000_000_000) is None


def test_a_swing_is_noise_and_a_stance_is_none() -> None:
    """Steps of 0.5 s of 20 N and of nothing, with the spread that a swing has, are reported once each, within 20 ms."""
    chance, contact = np.random.default_rng(4), LoadContact()
    changes = []
    for index in range(2000):
        stands = index % 100 < 50
        change = contact.update(20.0 * stands + chance.normal(0.0, 0.8 * SPREAD_N), 10_000_000 * index)
        if change is not None:
            changes.append((index % 100, change.kind))
            assert change.probability > 0.7
    late = [index % 50 for index, _ in changes]
    assert len(changes) == pytest.approx(39, abs=2)
    assert sum(each <= 1 for each in late) >= 0.9 * len(late)


def loaded(up_n: float) -> LegReading:
    """Return what a leg reports that stands and bears so much, N."""
    return LegReading(HIP_RAD, KNEE_RAD, 0.0, 0.0, *torques(HIP_RAD, KNEE_RAD, (0.0, up_n)))


@pytest.mark.parametrize("mount", ["foot", "shank", "body"])
def test_a_foot_that_is_unloaded_vents_and_one_that_bears_lands(mount: str) -> None:
    """Detected from efforts alone, on any mount, beside an IMU at rest; a blow on a leg in the air is no touch-down."""
    controller = AnkleController(ControllerParameters(imu_mount=mount, use_efforts=True), leg=LEG)
    chance, reported = np.random.default_rng(2), []
    for index in range(2000):
        time_ns = 2_000_000 * index
        if index % 5 == 0:
            up_n = 0.0 if 1000 <= index < 1400 else 20.0
            reported += controller.take(Received(time_ns, loaded(up_n))).events
        blow = 30.0 if 1200 <= index < 1205 else 0.0
        force = (chance.normal(0.0, 0.02), chance.normal(0.0, 0.02), GRAVITY_M_S2 + blow + chance.normal(0.0, 0.02))
        reported += controller.update(ImuSample(time_ns, *force, 0.0, 0.0, 0.0)).events
        if index == 1300:
            assert controller.policy.state is PolicyState.SWING
    kinds = [(each.kind, each.source, each.time_ns) for each in reported if each.kind is not ContactKind.SETTLED]
    lifted, landed = (event for event in kinds if event[0] is not ContactKind.SWING)
    assert lifted[:2] == (ContactKind.LIFTOFF, Source.EFFORTS)
    assert landed[:2] == (ContactKind.IMPACT, Source.EFFORTS)
    assert 2_000_000_000 <= lifted[2] <= 2_030_000_000
    assert 2_800_000_000 <= landed[2] <= 2_830_000_000
    assert Input.EFFORTS in controller.inputs.received(time_ns)
    assert controller.policy.state is PolicyState.STANCE


def test_a_foot_that_the_gait_has_put_down_in_vain_is_in_the_air() -> None:
    """Above a hole a plan of contact reports no touch-down where the efforts are known, and the foot stays soft."""
    controller = AnkleController(ControllerParameters(imu_mount="body", use_efforts=True), leg=LEG)
    chance, reported = np.random.default_rng(2), []
    for index in range(1000):
        time_ns = 2_000_000 * index
        if index % 5 == 0:
            reported += controller.take(Received(time_ns, loaded(20.0 if index < 500 else 0.0))).events
            reported += controller.take(Received(time_ns, Input.PLANNED_CONTACT, not 500 <= index < 700)).events
        force = chance.normal((0.0, 0.0, GRAVITY_M_S2), 0.02).tolist()
        reported += controller.update(ImuSample(time_ns, *force, 0.0, 0.0, 0.0)).events
    assert [each.kind for each in reported] == [ContactKind.LIFTOFF]
    assert controller.policy.state is PolicyState.SWING


def test_efforts_are_not_received_unless_asked_for() -> None:
    """Without use_efforts no leg is believed, whatever it reports."""
    controller = AnkleController(ControllerParameters(imu_mount="shank"), leg=LEG)
    for index in range(100):
        assert controller.take(Received(10_000_000 * index, loaded(20.0 * (index < 50)))).events == ()
    assert controller.inputs.received(990_000_000) == ()


def test_a_body_that_falls_and_lands_is_reported_once_by_the_imu() -> None:
    """Held up it has left the ground by its efforts; let go it falls, and lands at the first sample that shows it.

    The efforts know of the landing 10 ms later, and say nothing new; in free fall what holds the leg up is no load.
    """
    controller = AnkleController(ControllerParameters(imu_mount="body", use_efforts=True), leg=LEG)
    chance, reported = np.random.default_rng(2), []
    for index in range(1500):
        time_ns, falls, light = 2_000_000 * index, 600 <= index < 650, 300 <= index < 605
        if index % 5 == 0:
            reported += controller.take(Received(time_ns, loaded(0.0 if light or index == 650 else 20.0))).events
        up = 0.0 if falls else GRAVITY_M_S2 + (30.0 if 650 <= index < 655 else 0.0)
        force = chance.normal((0.0, 0.0, up), 0.02).tolist()
        reported += controller.update(ImuSample(time_ns, *force, 0.0, 0.0, 0.0)).events
    changes = [(each.kind, each.source) for each in reported if each.kind in (ContactKind.LIFTOFF, ContactKind.IMPACT)]
    assert changes == [(ContactKind.LIFTOFF, Source.EFFORTS), (ContactKind.IMPACT, Source.IMU)]
    landed = next(each for each in reported if each.kind is ContactKind.IMPACT)
    assert landed.time_ns == 2_000_000 * 650
