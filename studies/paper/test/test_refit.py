"""The refit: it gives the committed constants, from where it starts and from elsewhere, and says what it did."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from jammkle_sim.physics.constants import TENDON_SETS, Fibre
from studies.paper.reference import (
    FITTED_ROWS,
    NO_MEMBRANE_ROW,
    peak_force_n,
    rate_ratio,
    row_peak_n,
    static_force_n,
)
from studies.paper.refit import (
    HELD_FIXED,
    TOLERANCE,
    UNKNOWNS,
    FitResult,
    Objective,
    refit,
    row_results,
    values_of,
    with_values,
)

FITTED = TENDON_SETS["fitted"]
BREAK_M = FITTED.break_extension_m


@pytest.fixture(scope="module")
def result() -> FitResult:
    """One refit for all tests, with its progress checked on the way."""
    shares: list[float] = []
    fit = refit(shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert max(shares[:-1]) < 1.0
    return fit


def test_it_reproduces_the_committed_constants(result: FitResult) -> None:
    """From the start values, every constant comes out as committed, within the stated tolerance."""
    assert result.reproduces_committed, {
        constant.unknown.name: constant.deviation
        for constant in result.constants
        if abs(constant.deviation) > TOLERANCE
    }
    assert [constant.unknown for constant in result.constants] == list(UNKNOWNS)


def test_its_rows_are_the_papers(result: FitResult) -> None:
    """Every row within 1 % and 0.7 standard errors."""
    assert [row.row for row in result.rows] == list(FITTED_ROWS)
    for row in result.rows:
        assert abs(row.residual) < 0.7, row
        assert row.simulated_n == pytest.approx(row.row.mean, rel=0.01), row


def test_its_friction_is_the_references(result: FitResult) -> None:
    """The fast law stays within half a newton rms of the reference."""
    assert result.reference_rms_n < 0.5


def test_committed_constants_are_a_minimum() -> None:
    """Two per cent more or less of any constant makes the sum of squares larger."""
    objective = Objective()
    committed = values_of(FITTED)
    least = (objective(committed) ** 2).sum()
    for index in range(len(committed)):
        for factor in (0.98, 1.02):
            values = committed.copy()
            values[index] *= factor
            assert (objective(values) ** 2).sum() > least, UNKNOWNS[index].name


def test_the_objective_sees_a_wrong_constant() -> None:
    """The row that a constant was fitted to feels it: a tenth more modulus lifts the A-85 row by far."""
    stiffer = dataclasses.replace(
        FITTED, fibres=dataclasses.replace(FITTED.fibres, modulus_pa=1.1 * FITTED.fibres.modulus_pa)
    )
    changes = {
        after.row.identifier: after.residual - before.residual
        for before, after in zip(row_results(FITTED), row_results(stiffer), strict=True)
    }
    assert changes["a85_atm"] > 2.0
    assert changes["a30_atm"] == 0.0


def test_values_go_there_and_back() -> None:
    """Unknowns and tendon are two ways to write the same."""
    assert with_values(values_of(FITTED)) == FITTED
    assert len(values_of(FITTED)) == len(UNKNOWNS)


def test_every_constant_is_fitted_or_held_fixed_with_a_reason() -> None:
    """No constant of the tendon is forgotten, none stands in both lists."""
    unknowns = {unknown.name.partition("[")[0] for unknown in UNKNOWNS}
    fields = {
        field.name for kind in (FITTED, FITTED.fibres) for field in dataclasses.fields(kind) if field.name != "fibres"
    }
    assert unknowns | set(HELD_FIXED) == fields
    assert not unknowns & set(HELD_FIXED)
    assert all(HELD_FIXED.values())
    assert all(unknown.fitted_to and unknown.unit for unknown in UNKNOWNS)


def test_the_row_without_membrane_is_met_though_it_is_not_fitted() -> None:
    """Unjammed, the law has no membrane: it comes out within the error of the row without one."""
    peak_n = row_peak_n(FITTED, NO_MEMBRANE_ROW)
    assert peak_n == pytest.approx(NO_MEMBRANE_ROW.mean, abs=NO_MEMBRANE_ROW.standard_error)


def test_elastic_force_at_the_break_is_150_n_at_the_rate_of_the_tensile_test() -> None:
    """F0 at 55 mm, with the fibres as stiff as the tensile test finds them, is 150 +- 8 N."""
    assert static_force_n(FITTED, BREAK_M) * rate_ratio(FITTED) == pytest.approx(150.0, abs=8.0)


def test_force_at_the_break_depends_on_the_rate_as_relaxation_says() -> None:
    """Pulled to just before the break: the long-term force from below at a creep, more and more the faster."""
    before_m = BREAK_M - 1e-4
    long_term_n = static_force_n(FITTED, before_m)
    peaks_n = [
        peak_force_n(FITTED, Fibre.MULTI_MATERIAL, 0.0, before_m, speed) for speed in (5e-6, 0.0005, 0.005, 0.05)
    ]
    assert peaks_n[0] == pytest.approx(long_term_n, rel=0.01)
    assert np.all(np.diff(peaks_n) > 0.0)
    assert peaks_n[2] == pytest.approx(136.0, abs=3.0)
