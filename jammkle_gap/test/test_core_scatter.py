"""Scatter: whitening against dense algebra, moderated variances, and amplitudes of nuisances."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_gap import Constants
from jammkle_gap.core.features import Layout
from jammkle_gap.core.scatter import Repeats, Whitener, difference_of, fit_scatter, residuals_of, settings_of
from jammkle_gap.core.simulate import Runner
from pendulums import PROBLEM, machine

if TYPE_CHECKING:
    from numpy.typing import NDArray

BINS = 80
CONSTANTS = Constants()


def layout(floor: float = 0.1, bins: int = BINS) -> Layout:
    """Return one signal by bins of 10 ms."""
    return Layout(("angle",), ("rad",), 0.01, bins, {}, np.full(bins, floor))


def dense(variance: NDArray[np.float64], columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a covariance in full."""
    return np.diag(variance) + columns @ columns.T


@pytest.mark.parametrize("count", [0, 1, 7, 60])
def test_whitening_gives_unit_covariance(count: int) -> None:
    """Rows x become x W, and W' C W is the identity, also with more columns than the data can tell apart."""
    random = np.random.default_rng(count)
    variance = random.uniform(0.1, 4.0, 40)
    columns = random.normal(size=(40, count)) @ np.diag(random.uniform(0.0, 5.0, count))
    matrix = Whitener(variance, columns)(np.eye(40))
    assert matrix.T @ dense(variance, columns) @ matrix == pytest.approx(np.eye(40), abs=1e-8)


def test_whitening_has_the_length_of_mahalanobis() -> None:
    """The squared length is that of dense algebra."""
    random = np.random.default_rng(3)
    variance, columns, rows = random.uniform(0.5, 2.0, 30), random.normal(size=(30, 4)), random.normal(size=(5, 30))
    expected = np.einsum("ij,jk,ik->i", rows, np.linalg.inv(dense(variance, columns)), rows)
    assert np.square(Whitener(variance, columns)(rows)).sum(axis=1) == pytest.approx(expected)


def test_columns_that_settings_share_are_whitened_together() -> None:
    """Without references the constants of a machine are the same in all settings: stacked equals dense."""
    made = machine(4)
    settings = settings_of(made.record(2), (), PROBLEM)
    residuals = residuals_of(settings, Runner(PROBLEM, 1), {})
    random = np.random.default_rng(0)
    sizes = [setting.layout.size for setting in settings]
    own = [random.normal(size=(size, 2)) for size in sizes]
    contact = [random.normal(size=(size, 1)) for size in sizes]
    shared = [random.normal(size=(size, 3)) for size in sizes]
    found = difference_of(settings, residuals, own, contact, shared, CONSTANTS)
    parts = [
        each.factor * (np.diag(own.variance) + own.columns @ own.columns.T + more @ more.T)
        for each, own, more in ((each, each.scatter, more) for each, more in zip(found.settings, contact, strict=True))
    ]
    whole = np.zeros((sum(sizes), sum(sizes)))
    whole[: sizes[0], : sizes[0]], whole[sizes[0] :, sizes[0] :] = parts
    stacked = np.vstack(shared)
    whole += stacked @ stacked.T
    raw = np.concatenate([each.difference for each in residuals])
    assert found.whitened @ found.whitened == pytest.approx(raw @ np.linalg.solve(whole, raw))


@pytest.mark.parametrize("true", [0.5, 3.0])
def test_a_variance_lies_between_what_repeats_show_and_the_mean_of_its_signal(true: float) -> None:
    """Half of the time is noisier: with few repeats it is drawn towards the rest, with many hardly."""
    errors = []
    for repeats in (2, 40):
        random = np.random.default_rng(7)
        noise = np.where(np.arange(BINS) < BINS // 2, 1.0, true)
        runs = random.normal(size=(repeats, BINS)) * noise
        deviations = runs - runs.mean(axis=0)
        (found,) = fit_scatter([Repeats(layout(), deviations, repeats - 1, np.zeros((BINS, 0)))], CONSTANTS)
        mean = (1.0 + true**2) / 2.0
        late = found.variance[-10:].mean()
        assert min(mean, true**2) * 0.6 < late < max(mean, true**2) * 1.4
        errors.append(abs(np.log(late / true**2)))
    assert errors[1] < 0.3


def test_a_variance_is_never_below_the_sensors_noise() -> None:
    """Two repeats that agree by chance do not make a sensor better."""
    (found,) = fit_scatter([Repeats(layout(0.5), np.zeros((2, BINS)), 1, np.zeros((BINS, 0)))], CONSTANTS)
    assert (found.variance >= 0.25).all()


@pytest.mark.parametrize("amplitude", [0.3, 1.0, 4.0])
def test_amplitudes_of_nuisances_are_found(amplitude: float) -> None:
    """What a rig scatters by, within a fifth from 60 runs beside a prior worth four; with 2 the prior has its say."""
    random = np.random.default_rng(11)
    columns = np.stack([np.sin(np.arange(BINS) / 5.0), np.exp(-np.arange(BINS) / 20.0)], axis=1)
    runs = random.normal(size=(60, 2)) * [amplitude, 1.0] @ columns.T + random.normal(0.0, 0.1, (60, BINS))
    (found,) = fit_scatter([Repeats(layout(), runs - runs.mean(axis=0), 59, columns)], CONSTANTS)
    prior = CONSTANTS.nuisance_prior_freedom
    expected = np.sqrt((prior + 59.0 * amplitude**2) / (prior + 59.0))
    assert found.amplitudes == pytest.approx([expected, 1.0], rel=0.2)
    few = runs[:2] - runs[:2].mean(axis=0)
    (drawn,) = fit_scatter([Repeats(layout(), few, 1, columns)], CONSTANTS)
    assert abs(np.log(drawn.amplitudes[0])) <= abs(np.log(amplitude)) + 0.3


def test_amplitudes_belong_to_the_machine_and_variances_to_the_setting() -> None:
    """A setting without repeats has the amplitudes that another shows."""
    random = np.random.default_rng(12)
    columns = np.sin(np.arange(BINS) / 5.0)[:, np.newaxis]
    runs = random.normal(size=(30, 1)) * 3.0 @ columns.T + random.normal(0.0, 0.1, (30, BINS))
    shown = Repeats(layout(), runs - runs.mean(axis=0), 29, columns)
    bare = Repeats(layout(0.7), np.zeros((1, BINS)), 0, columns)
    found = fit_scatter([shown, bare], CONSTANTS)
    assert found[1].amplitudes == pytest.approx(found[0].amplitudes)
    assert found[1].variance == pytest.approx(np.full(BINS, 0.49))
