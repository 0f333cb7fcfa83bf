"""The course of a driven carriage from its readings."""

from __future__ import annotations

import numpy as np
import pytest

from jammkle_gap.ankle.inputs import course_of, reading_noise_m

TIME_S = np.arange(0.0, 8.0, 0.002)
PULLS_M = np.interp(TIME_S, [1.0, 2.0004, 3.0, 4.0, 5.0, 5.5, 6.0], [0.0, 0.02, 0.0, 0.01, 0.0, 0.02, 0.0])
"""Three pulls, of which two are as long and one is twice as fast."""
BIN = 10
"""Readings in 20 ms."""


def read(course_m: np.ndarray, noise_m: float, step_m: float, seed: int = 0) -> np.ndarray:
    """Return what a scale reads."""
    noisy = course_m + noise_m * np.random.default_rng(seed).standard_normal(len(course_m))
    return np.round(noisy / step_m) * step_m if step_m else noisy


def binned(values: np.ndarray) -> np.ndarray:
    """Return means over bins."""
    return values[: len(values) // BIN * BIN].reshape(-1, BIN).mean(axis=1)


@pytest.mark.parametrize(("noise_m", "step_m"), [(0.0, 0.0), (3e-6, 2.5e-6), (2e-5, 0.0), (0.0, 5e-5), (2e-5, 5e-5)])
def test_steady_pulls_come_out_far_below_the_noise_of_a_reading(noise_m: float, step_m: float) -> None:
    """Whatever scale: lines of a second know a place a hundred readings better, and turns stay sharp."""
    course = course_of(TIME_S, read(PULLS_M, noise_m, step_m))
    off_m = course.at(TIME_S) - PULLS_M
    assert np.sqrt(np.mean(off_m**2)) < max(0.2 * np.hypot(noise_m, step_m / np.sqrt(12.0)), 3e-6)
    assert np.abs(off_m).max() < 1e-4
    assert len(course.time_s) < 30


@pytest.mark.parametrize("noise_m", [3e-6, 2e-5])
def test_a_course_that_bends_all_the_time_is_no_worse_than_its_readings(noise_m: float) -> None:
    """A sine has no straight stretch: over 20 ms its course is about as good as the mean of the readings."""
    sine_m = 0.01 * np.sin(2.0 * np.pi * np.clip(TIME_S - 1.0, 0.0, 5.0))
    readings_m = read(sine_m, noise_m, 0.0)
    course = course_of(TIME_S, readings_m)
    off_m = binned(course.at(TIME_S) - sine_m)
    assert off_m.std() < 1.5 * binned(readings_m - sine_m).std() + 2e-6


def test_a_later_course_is_the_same_course_later() -> None:
    """Shifting the times shifts the corners; raising the readings raises them."""
    readings_m = read(PULLS_M, 2e-5, 0.0)
    course, later = course_of(TIME_S, readings_m), course_of(TIME_S + 3.0, readings_m + 0.1)
    assert later.time_s == pytest.approx(course.time_s + 3.0, abs=1e-6)
    assert later.position_m == pytest.approx(course.position_m + 0.1, abs=1e-8)


def test_the_noise_of_a_scale_is_told_from_its_readings() -> None:
    """Motion does not count, neither does a scale that only ever reads whole steps."""
    assert reading_noise_m(read(PULLS_M, 2e-5, 0.0)) == pytest.approx(2e-5, rel=0.1)
    assert reading_noise_m(read(PULLS_M, 0.0, 5e-5)) == pytest.approx(5e-5 / np.sqrt(12.0))


def test_a_carriage_that_stands_still_has_no_corners() -> None:
    """Noise makes none."""
    for seed in range(20):
        course = course_of(TIME_S, read(np.full(len(TIME_S), 0.3), 2e-5, 0.0, seed))
        assert np.ptp(course.position_m) < 1e-5


@pytest.mark.parametrize("count", [1, 2, 5, 9])
def test_a_few_readings_are_a_course(count: int) -> None:
    """However few there are."""
    course = course_of(TIME_S[:count], PULLS_M[500 : 500 + count])
    assert np.abs(course.at(TIME_S[:count]) - PULLS_M[500 : 500 + count]).max() < 1e-4
