"""Figures from recordings: smoothing, work, rebound and net peak, on curves whose figures are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_sim.rigs.recording import peak_deceleration_m_s2, rebound_m, smoothed, work_j
from jammkle_sim.rigs.run import Series

forces_n = st.lists(st.floats(-200.0, 200.0), min_size=5, max_size=60)


def test_a_spike_is_spread_over_ten_milliseconds() -> None:
    """One reading of 100 N among zeros becomes five of 20 N, centred on it: 10 ms of rows of 2 ms."""
    spike_n = np.zeros(21)
    spike_n[10] = 100.0
    expected_n = np.zeros(21)
    expected_n[8:13] = 20.0
    assert smoothed(spike_n) == pytest.approx(expected_n)


def test_noise_is_smoothed_and_the_rest_is_kept() -> None:
    """White noise loses a factor of sqrt(5); a constant and a straight line stay, but for the ends of the line."""
    noise_n = np.random.default_rng(0).standard_normal(20_000)
    assert smoothed(noise_n).std() == pytest.approx(1.0 / np.sqrt(5.0), rel=0.03)
    line_n = np.linspace(-30.0, 70.0, 50)
    assert smoothed(line_n)[2:-2] == pytest.approx(line_n[2:-2])
    assert smoothed(np.full(50, 17.0)) == pytest.approx(17.0)


@given(forces_n)
def test_smoothing_keeps_length_and_stays_within(values_n: list[float]) -> None:
    """As many values as before, none beyond the largest and smallest."""
    values = np.array(values_n)
    result = smoothed(values)
    assert result.shape == values.shape
    assert values.min() - 1e-9 <= result.min()
    assert result.max() <= values.max() + 1e-9


@given(st.floats(10.0, 5e3), st.floats(0.001, 0.1))
def test_work_of_a_spring_is_half_its_force_times_way(stiffness_n_m: float, way_m: float) -> None:
    """K x^2 / 2 on the way out, nothing over the way out and back."""
    out_m = np.linspace(0.0, way_m, 40)
    there_and_back_m = np.concatenate([out_m, out_m[::-1]])
    assert work_j(out_m, stiffness_n_m * out_m) == pytest.approx(stiffness_n_m * way_m**2 / 2.0)
    assert work_j(there_and_back_m, stiffness_n_m * there_and_back_m) == pytest.approx(0.0, abs=1e-12)


def test_rebound_counts_from_the_lowest_point() -> None:
    """What came before the lowest point is no rebound."""
    assert rebound_m(np.array([0.3, 0.05, 0.02, 0.06, 0.04])) == pytest.approx(0.04)
    assert rebound_m(np.array([0.3, 0.2, 0.1])) == 0.0


def test_peak_is_net_upward_and_after_the_release() -> None:
    """Gravity is taken off, and a larger reading before the release does not count."""
    upward = np.array([[99.0], [STANDARD_GRAVITY_M_S2], [40.0], [12.0]])
    imu = Series(("linear_acceleration_z_m_s2",), np.array([0.5, 1.0, 1.5, 2.0]), upward)
    assert peak_deceleration_m_s2(imu, 0.9) == pytest.approx(40.0 - STANDARD_GRAVITY_M_S2)
