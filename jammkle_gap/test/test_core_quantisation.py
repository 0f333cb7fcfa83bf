"""The error of a coarse sensor in the mean of a bin, against sensors that are simulated."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_gap import Recording, Signal
from jammkle_gap.core.features import features_of, layout_of, measured

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Motion = Callable[[NDArray[np.float64], np.random.Generator], NDArray[np.float64]]

STEP, BIN_S, DURATION_S = 0.1, 0.02, 2.0


def still(time_s: NDArray[np.float64], random: np.random.Generator) -> NDArray[np.float64]:
    """Return a machine that stands anywhere between two codes."""
    return np.full(time_s.shape, random.uniform(-STEP, STEP))


def ramp(steps_per_bin: float) -> Motion:
    """Return a steady motion, of so many steps in a bin or a tenth more or less."""

    def motion(time_s: NDArray[np.float64], random: np.random.Generator) -> NDArray[np.float64]:
        speed = steps_per_bin * random.uniform(0.9, 1.1) * STEP / BIN_S
        return speed * time_s + random.uniform(-STEP, STEP)

    return motion


def swing(steps: float) -> Motion:
    """Return an oscillation of 1 Hz, which turns on a code or between two."""

    def motion(time_s: NDArray[np.float64], random: np.random.Generator) -> NDArray[np.float64]:
        phase, middle = random.uniform(0.0, 2.0 * np.pi), random.uniform(-STEP, STEP)
        return steps * STEP * np.sin(2.0 * np.pi * time_s + phase) + middle

    return motion


def release(time_s: NDArray[np.float64], random: np.random.Generator) -> NDArray[np.float64]:
    """Return a machine that stands still and then falls."""
    return random.uniform(-STEP, STEP) - 5.0 * np.square(np.maximum(time_s - 1.0, 0.0))


@pytest.mark.parametrize("rate_hz", [100.0, 500.0])
@pytest.mark.parametrize("noise", [0.0, 0.1, 0.25, 0.5, 2.0])
@pytest.mark.parametrize(
    "motion", [still, ramp(0.1), ramp(0.5), ramp(1.5), ramp(7.3), swing(0.8), swing(30.0), release]
)
@pytest.mark.parametrize("repeats", [1, 7])
def test_the_floor_bounds_the_error_of_a_bin_and_is_at_most_three_times_that(
    motion: Motion, noise: float, rate_hz: float, repeats: int
) -> None:
    """Constant, steady and swinging, with noise of none, a part of, and several steps.

    A tenth is for chance. Without noise the readings of a steady motion are spread more evenly than by chance.
    """
    random = np.random.default_rng(0)
    time_s = np.arange(0.0, DURATION_S, 1.0 / rate_hz)
    errors, floors = [], []
    for _ in range(112 // repeats):
        truths = [motion(time_s, random) for _ in range(repeats)]
        reads = [STEP * np.round((each + random.normal(0.0, noise * STEP, each.shape)) / STEP) for each in truths]
        runs = [
            Recording("run", (Signal("angle", "rad", time_s, read, noise=noise * STEP, resolution=STEP),))
            for read in reads
        ]
        layout = layout_of(runs, BIN_S, None)
        for run, truth in zip(runs, truths, strict=True):
            found, true = (features_of(layout, run, values, None) for values in (measured(run), {"angle": truth}))
            errors.append(np.square(found - true))
        floors.append(np.square(layout.floor))
    assert 0.9 * np.mean(errors) < np.mean(floors) < 3.0 * np.mean(errors)


def test_a_machine_that_stands_until_it_falls_keeps_the_error_of_its_code() -> None:
    """What moves after a release says nothing of the readings before it."""
    random = np.random.default_rng(1)
    time_s = np.arange(0.0, DURATION_S, 0.002)
    read = STEP * np.round(release(time_s, random) / STEP)
    layout = layout_of([Recording("run", (Signal("angle", "rad", time_s, read, resolution=STEP),))], BIN_S, None)
    centre_s = layout.time_s
    assert layout.floor[centre_s < 1.0] == pytest.approx(STEP / np.sqrt(12.0), rel=0.01)
    per_bin = BIN_S / 0.002
    assert layout.floor[centre_s > 1.8] == pytest.approx(STEP / np.sqrt(12.0 * per_bin), rel=0.1)
