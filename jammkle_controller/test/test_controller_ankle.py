"""Contact that is felt with the ankle's own angles, where a foot hangs toe-down."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from jammkle_common.constants import NANOSECONDS_PER_SECOND, STANDARD_GRAVITY_M_S2
from jammkle_common.names import JOINT_STATES
from jammkle_controller.core.controller import AnkleController
from jammkle_controller.core.events import Contact, ContactEvent, ContactKind, Source
from jammkle_controller.core.imu import ImuSample
from jammkle_controller.core.inputs import AnkleAngles
from jammkle_controller.core.leg_contact import AnkleReading
from jammkle_controller.core.reading import Received, ankle_reading, received_in
from jammkle_controller.parameters import ControllerParameters

HANG_DEG = 30.0
HANGS_RAD, BEARS_RAD = math.radians(26.0), math.radians(12.0)
"""Where a soft foot is in a swing, as friction leaves it, and as it bears."""
READ_S, IMU_S = 0.01, 0.002


LIFTED_S, PUT_DOWN_S = 0.6, 1.6


def pitch_rad(time_s: float) -> float:
    """A foot that stands, is lifted within 40 ms, hangs still, and is put down within 30 ms; nothing jumps."""
    up = min(1.0, max(0.0, (time_s - LIFTED_S) / 0.04))
    down = min(1.0, max(0.0, (time_s - PUT_DOWN_S) / 0.03))
    return BEARS_RAD + (HANGS_RAD - BEARS_RAD) * (up - down)


def felt(parameters: ControllerParameters, until_s: float) -> tuple[AnkleController, list[ContactEvent]]:
    """A controller whose IMU rests and whose ankle moves as `pitch_rad` says, and what it reported."""
    controller, events = AnkleController(parameters), []
    for step in range(round(until_s / IMU_S)):
        time_ns = round(step * IMU_S * NANOSECONDS_PER_SECOND)
        if step % round(READ_S / IMU_S) == 0:
            at_s = step * IMU_S
            rate_rad_s = (pitch_rad(at_s) - pitch_rad(at_s - READ_S)) / READ_S
            events += controller.take(
                Received(time_ns, AnkleReading(pitch_rad(at_s), 0.0, rate_rad_s, 0.0, 0.0, 0.0))
            ).events
        events += controller.update(still(step, time_ns, STANDARD_GRAVITY_M_S2)).events
    return controller, events


def still(step: int, time_ns: int, force_m_s2: float) -> ImuSample:
    """A sample of an IMU that neither turns nor shakes, with some noise."""
    noise = 0.01 * math.sin(1e3 * step)
    return ImuSample(time_ns, 0.0, 0.0, force_m_s2 + noise, 0.0, noise, 0.0)


@pytest.mark.parametrize("mount", ["body", "shank", "foot"])
def test_a_soft_step_is_felt_wherever_the_imu_is(mount: str) -> None:
    """Nothing strikes and nothing shakes: the IMU alone shows none of it, the ankle both, as a sensor of contact.

    A flat foot moves by 2 degrees at a touch-down: nothing to feel it by.
    """
    parameters = ControllerParameters(imu_mount=mount, hang_pitch_deg=HANG_DEG)
    controller, events = felt(parameters, 2.5)
    by_ankle = [event for event in events if event.source is Source.ANKLE]
    assert [event.kind for event in by_ankle] == [ContactKind.LIFTOFF, ContactKind.IMPACT]
    for event, begin_s in zip(by_ankle, (LIFTED_S, PUT_DOWN_S), strict=True):
        assert 0.0 < event.time_ns / NANOSECONDS_PER_SECOND - begin_s < 0.08
        assert event.unit == "rad"
        assert event.probability > 0.8
    assert (controller.contact.contact, controller.contact.shown_by) == (Contact.CONTACT, "ankle angles")
    assert controller.vacuum_pa > 0.0
    _, events = felt(ControllerParameters(imu_mount=mount), 2.5)
    assert not [event for event in events if event.kind in (ContactKind.IMPACT, ContactKind.LIFTOFF)]


def test_free_fall_says_more_than_an_angle() -> None:
    """A jammed ankle keeps the angle of its stance as the robot falls: the IMU's lift-off counts all the same."""
    controller, _ = felt(ControllerParameters(hang_pitch_deg=HANG_DEG), 3.0)
    assert controller.contact.contact is Contact.CONTACT
    begun_ns = controller.gate.last_ns or 0
    kinds = []
    for step in range(1, 51):
        time_ns = begun_ns + round(step * IMU_S * NANOSECONDS_PER_SECOND)
        if step % round(READ_S / IMU_S) == 0:
            kinds += controller.take(Received(time_ns, AnkleReading(BEARS_RAD, 0.0, 0.0, 0.0, 0.0, 0.0))).events
        force_m_s2 = max(0.3, STANDARD_GRAVITY_M_S2 * (1.0 - 0.15 * step))  # let go within 15 ms
        kinds += controller.update(still(step, time_ns, force_m_s2)).events
    assert [event.kind for event in kinds] == [ContactKind.LIFTOFF]
    assert controller.contact.contact is Contact.NO_CONTACT


def test_what_is_no_number_is_left_out() -> None:
    """A broken encoder decides nothing, and what follows it is read again."""
    controller = AnkleController(ControllerParameters(hang_pitch_deg=HANG_DEG))
    for step in range(100):
        time_ns = round(step * READ_S * NANOSECONDS_PER_SECOND)
        broken = AnkleReading(math.nan, 0.0, 0.0, 0.0, 0.0, 0.0)
        assert not controller.take(Received(time_ns, broken)).events
    assert controller.contact.contact is Contact.UNKNOWN


def test_a_message_without_rates_or_leg_is_none() -> None:
    """It takes angles and rates of ankle, hip and knee; roll and pitch alone are received as such."""
    names = ["ankle_roll", "ankle_pitch", "ankle_yaw", "hip", "knee"]
    whole = SimpleNamespace(name=names, position=[0.1, 0.2, 0.0, 1.0, 2.0], velocity=[1.0, 2.0, 0.0, 3.0, 4.0])
    assert ankle_reading(whole, "hip", "knee") == AnkleReading(0.2, 0.1, 2.0, 1.0, 3.0, 4.0)
    assert ankle_reading(SimpleNamespace(name=names, position=whole.position, velocity=[]), "hip", "knee") is None
    stamp = SimpleNamespace(sec=1, nanosec=5)
    bare = SimpleNamespace(name=names[:3], position=[0.1, 0.2, 0.0], velocity=[], header=SimpleNamespace(stamp=stamp))
    received = received_in(bare, JOINT_STATES, 0, ControllerParameters(), None)
    assert received == [Received(1_000_000_005, AnkleAngles(0.1, 0.2))]
