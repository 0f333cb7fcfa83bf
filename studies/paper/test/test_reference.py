"""The law that runs every step against the reference model, on load and return at 10, 20, 30 and 50 kPa."""

from __future__ import annotations

import numpy as np
import pytest

from jammkle_sim.physics.constants import TENDON_SETS, Fibre, tendon_parameters
from studies.paper.reference import VACUUMS_PA, Tendon, compare, cycle_m, fast_tension_n, rms_n, with_fitted_friction


@pytest.mark.parametrize(("name", "rms", "worst"), [("fitted", 0.4, 1.5), ("as_printed", 0.8, 2.5)])
def test_two_elements_follow_the_reference(name: str, rms: float, worst: float) -> None:
    """Load and return at four vacuums: within a few tenths of a newton rms, and nowhere far off."""
    comparisons = compare(TENDON_SETS[name])
    assert tuple(comparison.vacuum_pa for comparison in comparisons) == VACUUMS_PA
    assert rms_n(comparisons) < rms
    assert max(np.abs(comparison.deviation_n).max() for comparison in comparisons) < worst


def test_one_element_would_be_too_few() -> None:
    """The best single element is at least twice as far from the reference as the two that are used."""
    fitted = TENDON_SETS["fitted"]
    assert rms_n(compare(with_fitted_friction(fitted, elements=1))) > 2.0 * rms_n(compare(fitted))


def test_printed_elements_come_from_the_printed_friction() -> None:
    """Fitting the elements to the reference with the printed constants gives the set `as_printed`."""
    printed = TENDON_SETS["as_printed"]
    again = with_fitted_friction(printed)
    assert again.friction_stiffness_n_m == pytest.approx(printed.friction_stiffness_n_m, rel=0.005)
    assert again.friction_yield_n_per_pa == pytest.approx(printed.friction_yield_n_per_pa, rel=0.005)


def test_both_lose_energy_alike() -> None:
    """Over a cycle the fast law dissipates what the reference does, within a tenth."""
    for comparison in compare(TENDON_SETS["fitted"])[1:]:
        growth_m = np.diff(comparison.extension_m)
        fast_j, reference_j = (
            (growth_m * (force_n[1:] + force_n[:-1]) / 2.0).sum()
            for force_n in (comparison.fast_n, comparison.reference_n)
        )
        assert fast_j == pytest.approx(reference_j, rel=0.1)


def test_the_comparison_takes_the_law_that_runs() -> None:
    """Seen without relaxation, the fast side of the comparison is the tendon of the rigs: same friction at 20 mm."""
    parameters = tendon_parameters("fitted", Fibre.MULTI_MATERIAL)
    path_m = cycle_m()
    gained_n = (fast_tension_n(parameters, 30e3, path_m) - fast_tension_n(parameters, 0.0, path_m)).max()
    vacuum_pa = np.full(len(path_m), 30e3)
    slow_n = Tendon(parameters, 1e4).follow(path_m, vacuum_pa)
    without_n = Tendon(parameters, 1e4).follow(path_m, 0.0 * vacuum_pa)
    stiffening_n = parameters.pressure_stiffening * 0.6 * without_n.max()
    grip_n = parameters.grip_n_per_pa * 30e3
    assert (slow_n - without_n).max() == pytest.approx(gained_n + stiffening_n + grip_n, abs=0.05)
