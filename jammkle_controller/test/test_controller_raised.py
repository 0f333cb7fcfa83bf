"""What is picked up too slowly for a swing or free fall vents, and nothing that stands does."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_common.messages import Level
from jammkle_common.names import CHANNELS
from jammkle_controller.core.controller import AnkleController
from jammkle_controller.core.events import METRE, Contact, ContactKind
from jammkle_controller.node import contact_health
from jammkle_controller.parameters import ControllerParameters

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from conftest import Streams
    from jammkle_controller.core.events import ContactEvent

HZ = 10_000  # of the true motion
CHEAP_BIAS_M_S2 = 0.05 * 9.80665
STOOD_S = 1.0


def moved(rise_s: float, height_m: float, tilt_rad: float, *, sway_rad: float = 0.0, carried_s: float = 0.0) -> Motion:
    """Stand for 1 s, rise, be carried, come back as slowly, and stand for 2 s."""
    times_s = np.arange(0.0, STOOD_S + 2.0 * rise_s + carried_s + 2.0, 1.0 / HZ)
    up = minimum_jerk((times_s - STOOD_S) / rise_s)
    down = minimum_jerk((times_s - STOOD_S - rise_s - carried_s) / rise_s)
    carried = (times_s > STOOD_S + rise_s) & (times_s < STOOD_S + rise_s + carried_s)
    swing = np.where(carried, np.sin(2.0 * math.pi * 1.2 * (times_s - STOOD_S - rise_s)), 0.0)
    return Motion(height_m * (up - down), tilt_rad * (up - down) + sway_rad * swing)


def minimum_jerk(share: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the way of a hand (Flash and Hogan 1985), 0 to 1."""
    u = np.clip(share, 0.0, 1.0)
    return np.asarray(10.0 * u**3 - 15.0 * u**4 + 6.0 * u**5)


class Motion:
    """A height, m, and a tilt about y, rad, over time."""

    def __init__(self, height_m: NDArray[np.float64], tilt_rad: NDArray[np.float64]) -> None:
        self.height_m = height_m
        self.tilt_rad = tilt_rad

    def felt(
        self,
        streams: Streams,
        mount: str,
        bias_m_s2: float = 0.0,
        controller: AnkleController | None = None,
        **parameters: float,
    ) -> list[ContactEvent]:
        """Return what a controller, a new one if none is given, reports whose IMU has a bias along x."""
        carried = streams.gravity_m_s2 + np.gradient(np.gradient(self.height_m, 1.0 / HZ), 1.0 / HZ)
        force = np.stack(
            [bias_m_s2 - carried * np.sin(self.tilt_rad), 0.0 * carried, carried * np.cos(self.tilt_rad)], axis=1
        )
        gyro = np.zeros_like(force)
        gyro[:, 1] = np.gradient(self.tilt_rad, 1.0 / HZ)
        controller = controller or AnkleController(ControllerParameters(imu_mount=mount, **parameters))
        return streams.events_of(streams.sense(force, 500, gyro=gyro), controller)


def lifts(events: list[ContactEvent]) -> Iterator[int]:
    """Return the stamps of lift-offs."""
    return (event.time_ns for event in events if event.kind is ContactKind.LIFTOFF)


@pytest.mark.parametrize("mount", ["foot", "shank", "body"])
def test_what_stands_still_does_not_slide(streams: Streams, mount: str) -> None:
    """A foot at perfect rest, which no posterior has learned from, slips neither at first nor after it was put down."""
    events = moved(1.5, 0.3, 0.2).felt(streams, mount)
    assert not [event for event in events if event.kind is ContactKind.SLIP]


@pytest.mark.parametrize("mount", ["foot", "shank"])
@pytest.mark.parametrize(("rise_s", "height_m", "tilt_rad"), [(0.8, 0.2, 0.2), (1.5, 0.3, 0.2), (1.5, 0.3, 0.05)])
def test_a_foot_that_is_lifted_slowly_has_left_the_ground_until_it_is_put_down(
    streams: Streams, mount: str, rise_s: float, height_m: float, tilt_rad: float
) -> None:
    """It is reported once, with its height, as soon as it tilts; and it stands again only after it was put down."""
    events = moved(rise_s, height_m, tilt_rad, sway_rad=0.03, carried_s=2.0).felt(streams, mount)
    lifted, put_down = (e for e in events if e.kind in (ContactKind.LIFTOFF, ContactKind.IMPACT))
    assert lifted.kind is ContactKind.LIFTOFF
    assert lifted.unit == METRE
    assert 0.08 < lifted.magnitude < height_m
    assert STOOD_S < lifted.time_ns / 1e9 < STOOD_S + rise_s + 0.3
    assert put_down.kind is ContactKind.IMPACT
    assert put_down.time_ns / 1e9 > STOOD_S + rise_s + 2.0


def test_a_body_is_picked_up_above_what_its_legs_reach(streams: Streams) -> None:
    """A body that stands up by 0.25 m stands; one that is raised by 0.7 m and swayed does not."""
    assert not moved(1.0, 0.25, 0.1, sway_rad=0.03, carried_s=1.0).felt(streams, "body")
    events = moved(1.5, 0.7, 0.1, sway_rad=0.03, carried_s=1.0).felt(streams, "body")
    assert [e.kind for e in events][:1] == [ContactKind.LIFTOFF]


@pytest.mark.parametrize("mount", ["foot", "shank", "body"])
def test_an_elevator_lifts_no_foot_off_its_floor(streams: Streams, mount: str) -> None:
    """What rises by 2 m in 3 s without a tilt stands."""
    assert not list(lifts(moved(3.0, 2.0, 0.0).felt(streams, mount)))


@pytest.mark.parametrize("bias_m_s2", [-CHEAP_BIAS_M_S2, CHEAP_BIAS_M_S2])
@pytest.mark.parametrize("tilt_rad", [0.1, 0.3, -0.3])
def test_no_bias_raises_what_only_tilts(streams: Streams, bias_m_s2: float, tilt_rad: float) -> None:
    """A foot that is tilted and stays so for 2.5 s has not risen, with 0.05 g of bias."""
    events = moved(1.0, 0.0, tilt_rad, carried_s=2.5).felt(streams, "foot", bias_m_s2)
    assert not [e for e in events if e.unit == METRE]


def test_a_lower_height_is_noticed_sooner(streams: Streams) -> None:
    """`raised_foot_m` is the height at which it is reported."""
    motion = moved(1.5, 0.4, 0.2)
    times = [next(lifts(motion.felt(streams, "foot", raised_foot_m=height_m))) for height_m in (0.05, 0.1, 0.2)]
    assert times == sorted(set(times))


@pytest.mark.parametrize("mount", ["foot", "shank", "body"])
def test_what_moves_and_was_never_felt_is_left_soft_and_is_a_warning(streams: Streams, mount: str) -> None:
    """A robot that is swayed by hand from the start is neither held nor said to stand or hang."""
    time_s = np.arange(0.0, 4.0, 1.0 / HZ)
    motion = Motion(0.0 * time_s, 0.1 * np.sin(2.0 * np.pi * 0.8 * time_s))
    controller = AnkleController(ControllerParameters(imu_mount=mount))
    motion.felt(streams, mount, controller=controller)
    assert not controller.contact.at_rest
    if controller.contact.contact is Contact.UNKNOWN:  # a foot that is swung at times seems to step
        assert contact_health(controller, (), is_soft_in_stance=False).level is Level.WARN
    assert mount != "body" or (controller.contact.contact, controller.set_points_pa) == (
        Contact.UNKNOWN,
        dict.fromkeys(CHANNELS, 0.0),
    )


@pytest.mark.parametrize("mount", ["foot", "shank"])
def test_a_foot_that_is_lifted_and_held_still_in_the_air_is_not_said_to_stand(streams: Streams, mount: str) -> None:
    """Its stillness suggests a touch-down that it might be; contact is unknown, and the ankle is held."""
    motion = moved(1.5, 0.3, 0.2, carried_s=3.0)
    until = round((1.0 + 1.5 + 2.9) * HZ)
    controller = AnkleController(ControllerParameters(imu_mount=mount))
    events = Motion(motion.height_m[:until], motion.tilt_rad[:until]).felt(streams, mount, controller=controller)
    assert ContactKind.LIFTOFF in [event.kind for event in events]
    assert (controller.contact.contact, controller.set_points_pa) == (Contact.UNKNOWN, dict.fromkeys(CHANNELS, 40e3))
