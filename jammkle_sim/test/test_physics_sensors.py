"""The IMU filter, its noise and its range; noise of the slow sensors."""

from __future__ import annotations

import numpy as np
import pytest

from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_sim.physics import kernels, records
from jammkle_sim.physics.sensors import Noise, SensorParameters, imu_law

DT_S = 0.0005
LIMIT_M_S2 = 71.02 + STANDARD_GRAVITY_M_S2


def filtered(raw: np.ndarray, parameters: SensorParameters, white: np.ndarray) -> np.ndarray:
    """Output of the IMU along raw samples, shape (n, 6), starting from rest."""
    law, state = imu_law(parameters, DT_S), np.zeros(1, dtype=records.IMU_STATE)
    output = np.zeros_like(raw)
    for i, sample in enumerate(raw):
        kernels.filter_imu(law[0], state[0], sample, white[i])
        output[i] = state["second"][0]
    return output


def test_clips_at_the_papers_limit_without_overshoot() -> None:
    """However hard the shock, the reading settles at 71.02 m/s^2 and gravity and never goes beyond."""
    raw = np.full((100, 6), 1e4)
    output = filtered(raw, SensorParameters(), np.zeros((100, 6)))
    assert output[-1, 0] == pytest.approx(LIMIT_M_S2)
    assert output[:, :3].max() <= LIMIT_M_S2


def test_loses_three_decibel_at_its_bandwidth() -> None:
    """A sine at 225 Hz comes out at 0.71 of its size, within what the step allows; one at 20 Hz passes."""
    for frequency_hz, low, high in ((225.0, 0.6, 0.8), (20.0, 0.97, 1.0)):
        wave = np.sin(2.0 * np.pi * frequency_hz * DT_S * np.arange(4000))
        output = filtered(np.repeat(wave[:, None], 6, axis=1), SensorParameters(), np.zeros((4000, 6)))
        assert low < output[2000:, 2].max() < high


def test_noise_has_the_density_of_the_data_sheet() -> None:
    """80 ug/rtHz through two poles at 225 Hz is 10 to 14 mm/s^2 rms."""
    steps = 20_000
    output = filtered(np.zeros((steps, 6)), SensorParameters(seed=3), Noise(SensorParameters(seed=3)).imu_white(steps))
    assert 0.010 < output[:, 0].std() < 0.014


def test_noise_does_not_depend_on_who_asks_how_often() -> None:
    """Numbers in one piece or in many, asked once or twice: the same; another seed gives others."""
    one, many, other = (Noise(SensorParameters(seed=seed)) for seed in (7, 7, 8))
    whole = one.imu_white(100)
    assert (whole == np.concatenate([many.imu_white(1), many.imu_white(70), many.imu_white(29)])).all()
    assert (one.pressure_pa(5) == one.pressure_pa(5)).all()
    assert (one.pressure_pa(5) == many.pressure_pa(5)).all()
    assert not (one.pressure_pa(5) == one.pressure_pa(6)).any()
    assert not (one.load_cell_n(5) == other.load_cell_n(5)).any()
    assert (one.load_cell_n(5) == many.load_cell_n(5)).all()
    one.reset()
    assert (one.imu_white(100) == whole).all()
