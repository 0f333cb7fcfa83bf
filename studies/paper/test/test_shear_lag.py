"""The reference tendon: what any bundle of rubbing fibres must do, whatever its mesh."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jammkle_sim.physics.constants import TENDON_SETS, Fibre, tendon_parameters
from jammkle_sim.physics.tendon import force_table_n, yeoh_nominal_stress_pa
from studies.paper import shear_lag
from studies.paper.shear_lag import (
    PRINTED_FRICTION,
    Friction,
    NoConvergenceError,
    ShearLagOptions,
    ShearLagTendon,
    hexagonal_packing,
    line_force_n_m,
    yeoh_tangent_pa,
)

FIBRES = TENDON_SETS["fitted"].fibres
PRINTED = TENDON_SETS["as_printed"].fibres
OVERLAP_M = 0.020
UP_M = np.linspace(0.0, 0.020, 21)
CYCLE_M = np.concatenate([UP_M, UP_M[-2::-1]])
ALL_RUB = ShearLagOptions(friction=PRINTED_FRICTION)
OVERLAP_RUBS = ShearLagOptions(friction=Friction())


def pull(
    x_m: np.ndarray, pressure_pa: float, options: ShearLagOptions = ALL_RUB, fibres: object = FIBRES
) -> np.ndarray:
    """Tension of a fresh reference tendon along extensions, at constant pressure."""
    return ShearLagTendon(fibres, options).follow(x_m, np.full(len(x_m), pressure_pa))


def work_j(x_m: np.ndarray, tension_n: np.ndarray) -> np.ndarray:
    """Work done on the tendon up to each entry."""
    return np.cumsum(np.diff(x_m) * (tension_n[1:] + tension_n[:-1]) / 2.0)


def test_eighteen_fibres_have_thirty_six_contacts_of_which_twenty_seven_slide() -> None:
    """The packing read from the paper: nine mirrored fibres, 27 of 36 contacts between unlike neighbours."""
    packing = hexagonal_packing()
    first, second = packing.contacts.T
    assert packing.mirrored.sum() == 9
    assert len(packing.contacts) == 36
    assert (packing.mirrored[first] != packing.mirrored[second]).sum() == 27


def test_tangent_is_the_slope_of_the_stress() -> None:
    """Yeoh's tangent against differences of its stress, squeezed and stretched."""
    stretch, apart = np.linspace(0.7, 3.0, 24), 1e-6
    constants = (FIBRES.c1_pa, FIBRES.c2_pa, FIBRES.c3_pa)
    rise_pa = yeoh_nominal_stress_pa(stretch + apart, *constants) - yeoh_nominal_stress_pa(stretch - apart, *constants)
    assert yeoh_tangent_pa(stretch, *constants) == pytest.approx(rise_pa / (2.0 * apart), rel=1e-6)


def test_capacity_of_the_overlap_is_what_the_geometry_gives() -> None:
    """At 50 kPa 27 contacts hold 1543 N per metre of stiff overlap."""
    assert 27 * 0.99 * line_force_n_m(50e3) == pytest.approx(1543.0, abs=1.0)


@pytest.mark.parametrize("options", [ALL_RUB, ShearLagOptions(friction=Friction(stiff_stiff=0.0))])
def test_without_pressure_or_without_friction_it_is_the_elastic_series(options: ShearLagOptions) -> None:
    """Soft and stiff section in series, as the fast law has it tabulated, on load and return."""
    pressure_pa = 0.0 if options is ALL_RUB else 50e3
    expected_n = np.interp(CYCLE_M, np.arange(401) * 5e-5, force_table_n(FIBRES, 5e-5, 401))
    assert pull(CYCLE_M, pressure_pa, options) == pytest.approx(expected_n, abs=1e-3)


@pytest.mark.parametrize("fibres", [FIBRES, PRINTED])
@pytest.mark.parametrize("pressure_pa", [1.0, 100.0, 1e3, 5e3, 10e3, 20e3, 50e3, 101_325.0])
@pytest.mark.parametrize("step", [1, 20])
def test_it_is_solved_at_every_pressure(fibres: object, pressure_pa: float, step: int) -> None:
    """In small steps and in one stride, with soft and with printed fibres, load and return are solved and finite."""
    assert np.isfinite(pull(CYCLE_M[::step], pressure_pa, fibres=fibres)).all()


@pytest.mark.parametrize("pressure_pa", [5e3, 30e3])
def test_finer_meshes_close_in_on_one_force(pressure_pa: float) -> None:
    """Each halving of the elements changes the force less, and the last by less than 0.5 %."""
    meshes_m = (0.010, 0.005, 0.0025, 0.00125)
    forces_n = [
        pull(CYCLE_M, pressure_pa, ShearLagOptions(friction=PRINTED_FRICTION, element_m=element_m))
        for element_m in meshes_m
    ]
    changes_n = [np.abs(after - before).max() for before, after in itertools.pairwise(forces_n)]
    assert changes_n[-1] < 0.005 * forces_n[-1].max()
    assert changes_n[-1] < changes_n[0]


def test_steps_need_not_be_small() -> None:
    """Ten times longer steps of the same load and return give the same force where both stop."""
    fine_m = np.interp(np.arange(401) / 400 * 40, np.arange(41), CYCLE_M)
    assert pull(fine_m, 20e3)[::10] == pytest.approx(pull(CYCLE_M, 20e3), abs=0.1)


def test_friction_never_carries_more_than_its_capacity() -> None:
    """Only the overlap rubbing: the force gained stays below its capacity, and half of it is lost inside the bundle."""
    elastic_n = pull(CYCLE_M, 0.0, OVERLAP_RUBS)
    for pressure_pa in (5e3, 20e3, 50e3):
        capacity_n = 27 * 0.99 * line_force_n_m(pressure_pa) * OVERLAP_M
        gained_n = pull(CYCLE_M, pressure_pa, OVERLAP_RUBS) - elastic_n
        assert np.abs(gained_n).max() <= capacity_n
    assert gained_n.max() > 0.5 * capacity_n


def test_each_cycle_dissipates_and_loops_close() -> None:
    """After the first cycle the loop repeats itself; every loop loses energy, the more where friction slips fully."""
    two_m = np.concatenate([CYCLE_M, CYCLE_M[1:]])
    lost_j = {}
    for pressure_pa in (500.0, 2e3, 10e3, 50e3):
        force_n = pull(two_m, pressure_pa)
        first, second = force_n[: len(CYCLE_M)], force_n[len(CYCLE_M) - 1 :]
        assert second[len(UP_M) - 1 :] == pytest.approx(first[len(UP_M) - 1 :], abs=0.05)
        lost_j[pressure_pa] = work_j(CYCLE_M, second)[-1]
    assert min(lost_j.values()) > 0.0
    assert lost_j[2e3] > 2.0 * lost_j[500.0]


@settings(max_examples=15, deadline=None)
@given(low_pa=st.floats(0.0, 80e3), high_pa=st.floats(0.0, 80e3))
def test_more_pressure_never_pulls_less(low_pa: float, high_pa: float) -> None:
    """While it is loaded, the force grows with pressure at every extension."""
    low_pa, high_pa = sorted((low_pa, high_pa))
    assert (pull(UP_M, high_pa) >= pull(UP_M, low_pa) - 1e-6).all()


@settings(max_examples=15, deadline=None)
@given(path_m=st.lists(st.floats(-0.002, 0.03), min_size=1, max_size=6), pressure_pa=st.floats(0.0, 80e3))
def test_gives_back_no_more_than_it_got(path_m: list[float], pressure_pa: float) -> None:
    """Passivity: along any path at constant pressure the work done on a fresh tendon is never negative."""
    corners = np.arange(len(path_m) + 1) * 20
    x_m = np.interp(np.arange(corners[-1] + 1), corners, [0.0, *path_m])
    work = work_j(x_m, pull(x_m, pressure_pa))
    assert work.min() >= -1e-6 - 0.01 * np.abs(work).max()


@pytest.mark.parametrize("fibre", [Fibre.SHORE_A30, Fibre.SHORE_A85])
def test_identical_fibres_do_not_slide(fibre: Fibre) -> None:
    """A tendon of one material gains nothing from pressure: hence the membrane's terms in the fast law."""
    fibres = tendon_parameters("fitted", fibre).fibres
    assert pull(CYCLE_M, 50e3, fibres=fibres) == pytest.approx(pull(CYCLE_M, 0.0, fibres=fibres), abs=1e-6)


def test_stretched_evenly_when_jammed_hard() -> None:
    """As the paper's model shows: jammed hard, the bundle tends to one whose sections stretch alike."""
    together = dataclasses.replace(ALL_RUB, element_m=0.001)
    strain = 0.020 / 0.080
    even_n = FIBRES.area_m2 / 2.0 * (FIBRES.modulus_pa * strain)
    assert pull(UP_M, 500e3, together)[-1] > even_n
    assert pull(UP_M, 500e3, together)[-1] == pytest.approx(pull(UP_M, 1e6, together)[-1], rel=0.01)


def test_a_step_that_is_not_solved_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """No number comes out of a step that did not converge; the message says which."""
    monkeypatch.setattr(shear_lag, "_LARGEST_ITERATIONS", 1)
    with pytest.raises(NoConvergenceError, match=r"20\.00 mm and 30000 Pa.*smaller steps"):
        pull(np.array([0.020]), 30e3)
