"""Synthetic IMU streams for the controller's tests, and controllers as real processes."""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from controller_bench import GRAVITY_M_S2, Bench

from domains import own_domain
from jammkle_controller.core.controller import AnkleController
from jammkle_controller.core.imu import ImuSample
from jammkle_controller.parameters import ControllerParameters

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from jammkle_controller.core.events import ContactEvent, ContactKind

FINE_HZ = 10_000
ACCELEROMETER_NOISE = 80e-6 * GRAVITY_M_S2  # m/s^2/sqrt(Hz), density of the paper's class of IMU
GYRO_NOISE = 9e-5  # rad/s/sqrt(Hz), 0.005 deg/s/sqrt(Hz)
CUTOFF_HZ = 225.0
CLIP_M_S2 = 80.83
MASS_KG = 1.8


class Streams:
    """Makes lists of IMU samples."""

    gravity_m_s2 = GRAVITY_M_S2

    def sense(
        self,
        force: NDArray[np.float64],
        rate_hz: int = 1000,
        *,
        turn: NDArray[np.float64] | None = None,
        gyro: NDArray[np.float64] | None = None,
        seed: int = 1,
    ) -> list[ImuSample]:
        """Read true specific force (n x 3, m/s^2, at 10 kHz) with a noisy, filtered, clipped IMU.

        `turn` is the rotation (3 x 3) in which the IMU is mounted, `gyro` the true angular velocity (n x 3, rad/s).
        """
        noise = np.random.default_rng(seed)
        spread = math.sqrt(FINE_HZ / 2)
        rate = np.zeros_like(force) if gyro is None else gyro
        if turn is not None:
            force, rate = force @ turn.T, rate @ turn.T
        force = self._low_pass(force + noise.normal(0.0, ACCELEROMETER_NOISE * spread, force.shape))
        rate = self._low_pass(rate + noise.normal(0.0, GYRO_NOISE * spread, rate.shape))
        force = np.clip(force, -CLIP_M_S2, CLIP_M_S2)
        step = FINE_HZ // rate_hz
        interval_ns = 1_000_000_000 // rate_hz
        rows = np.hstack([force, rate])[::step].tolist()
        return [ImuSample(index * interval_ns, *row) for index, row in enumerate(rows)]

    @staticmethod
    def _low_pass(values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Apply a two-pole Butterworth low-pass, starting from rest at the first value."""
        pad = np.repeat(values[:1], FINE_HZ // 10, axis=0)
        spectrum = np.fft.rfft(np.concatenate([pad, values]), axis=0)
        ratio = np.fft.rfftfreq(len(pad) + len(values), 1.0 / FINE_HZ) / CUTOFF_HZ
        response = 1.0 / (1.0 - ratio**2 + 1j * math.sqrt(2.0) * ratio)
        filtered = np.fft.irfft(spectrum * response[:, None], len(pad) + len(values), axis=0)
        return np.asarray(filtered[len(pad) :])

    @staticmethod
    def upright(magnitude: Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
        """Put a specific force along z."""
        force = np.zeros((len(magnitude), 3))
        force[:, 2] = magnitude
        return force

    def rest(self, duration_s: float) -> NDArray[np.float64]:
        """Stand still."""
        return self.upright(np.full(round(duration_s * FINE_HZ), GRAVITY_M_S2))

    @staticmethod
    def time_s(force: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the times of a true stream."""
        return np.arange(len(force)) / FINE_HZ

    def kick(self, at_s: float, peak_m_s2: float, lasts_s: float) -> NDArray[np.float64]:
        """Stand for a second and get a half-sine push from below."""
        force = self.rest(1.0)
        phase = (self.time_s(force) - at_s) / lasts_s
        force[:, 2] += np.where((phase > 0.0) & (phase < 1.0), peak_m_s2 * np.sin(math.pi * phase), 0.0)
        return force

    @functools.cache  # noqa: B019  one instance lives as long as the session
    def drop(self, natural_rad_s: float, damping: float, height_m: float = 0.05) -> tuple[NDArray[np.float64], float]:
        """Hold 1.8 kg for 0.3 s, drop it on a spring and damper, watch until 1.5 s.

        Returns:
            True specific force and the time of the first contact, s.

        """
        stiffness = MASS_KG * natural_rad_s**2
        damper = 2.0 * damping * natural_rad_s * MASS_KG
        held = round(0.3 * FINE_HZ)
        magnitude = [GRAVITY_M_S2] * held
        height, speed, contact_s = height_m, 0.0, 0.0
        for index in range(held, round(1.5 * FINE_HZ)):
            push = max(0.0, -stiffness * height - damper * speed) / MASS_KG if height < 0.0 else 0.0
            if height < 0.0 and contact_s == 0.0:
                contact_s = index / FINE_HZ
            magnitude.append(push)
            speed += (push - GRAVITY_M_S2) / FINE_HZ
            height += speed / FINE_HZ
        return self.upright(magnitude), contact_s

    @staticmethod
    def any_rotation(seed: int) -> NDArray[np.float64]:
        """Return a rotation matrix, uniform over all rotations (QR of a Gaussian matrix)."""
        turn, upper = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
        turn = turn * np.sign(np.diag(upper))
        return np.asarray(turn * np.linalg.det(turn))

    @staticmethod
    def any_direction(seed: int) -> NDArray[np.float64]:
        """Return a unit vector, uniform over the sphere."""
        direction = np.random.default_rng(seed).normal(size=3)
        return np.asarray(direction / np.linalg.norm(direction))

    @staticmethod
    def new_controller() -> AnkleController:
        """Return a controller with default parameters."""
        return AnkleController(ControllerParameters())

    def events_of(self, samples: list[ImuSample], controller: AnkleController | None = None) -> list[ContactEvent]:
        """Return what a controller, a new one if none is given, reports of these samples."""
        controller = controller or self.new_controller()
        return [event for sample in samples for event in controller.update(sample).events]

    def kinds_of(self, samples: list[ImuSample]) -> list[ContactKind]:
        """Return the kinds of what a new controller reports of these samples."""
        return [event.kind for event in self.events_of(samples)]


@pytest.fixture(scope="session")
def streams() -> Streams:
    """Return the maker of IMU streams."""
    return Streams()


@pytest.fixture
def make_bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Bench]]:
    """Make a bench in a ROS domain of its own, whose controller is up unless `is_up` is false: it says nothing then."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    benches: list[Bench] = []
    with own_domain() as number:

        def make(*arguments: str, is_up: bool = True) -> Bench:
            benches.append(Bench(number, tmp_path, *arguments))
            if is_up:
                benches[-1].wait_until_up()
            return benches[-1]

        yield make
        for bench in benches:
            bench.close()
