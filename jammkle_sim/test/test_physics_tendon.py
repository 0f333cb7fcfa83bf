"""The tendon against the paper's tensile tests, and properties that hold for any input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jammkle_sim.physics.constants import Fibre, tendon_parameters
from jammkle_sim.physics.tendon import slip_elements
from studies.paper.reference import Tendon
from studies.paper.tables import is_reproduced

DT_S = 0.0005
MULTI, A30, A85 = Fibre.MULTI_MATERIAL, Fibre.SHORE_A30, Fibre.SHORE_A85

vacuums_pa = st.floats(0.0, 101_325.0)
fibres = st.sampled_from(Fibre)
sets = st.sampled_from(["fitted", "as_printed"])
early_slips = st.sampled_from([0.0, 0.4, 1.0])
paths_m = st.lists(st.floats(-0.01, 0.054), min_size=2, max_size=8)


def ramp(to_m: float, speed_m_s: float = 0.005, dt_s: float = DT_S) -> np.ndarray:
    """Extensions from 0 to `to_m` at a speed."""
    return np.linspace(0.0, to_m, round(to_m / speed_m_s / dt_s) + 1)[1:]


def pull(
    x_m: np.ndarray,
    vacuum_pa: float,
    fibre: Fibre = MULTI,
    name: str = "fitted",
    dt_s: float = DT_S,
    early_slip: float = 0.0,
) -> np.ndarray:
    """Tension of a fresh tendon along extensions, at a constant vacuum."""
    parameters = replace(tendon_parameters(name, fibre), early_slip=early_slip)
    return Tendon(parameters, dt_s).follow(x_m, np.full(len(x_m), vacuum_pa))


def work_j(x_m: np.ndarray, tension_n: np.ndarray) -> np.ndarray:
    """Work done on the tendon up to each entry."""
    return np.cumsum(np.diff(x_m) * (tension_n[1:] + tension_n[:-1]) / 2.0)


# Mean peak force and standard error of five pulls to 20 mm at 5 mm/s: the paper's table of characterisation tests.
@pytest.mark.parametrize(
    ("fibre", "vacuum_pa", "mean_n", "error_n"),
    [
        (MULTI, 0.0, 23.330, 0.406),
        (MULTI, 10e3, 25.415, 0.488),
        (MULTI, 30e3, 39.852, 0.466),
        (MULTI, 50e3, 50.214, 0.864),
        (A30, 0.0, 8.997, 0.038),
        (A30, 50e3, 11.501, 0.032),
        (A85, 0.0, 84.294, 1.993),
        (A85, 50e3, 96.492, 3.535),
    ],
)
def test_fitted_set_reproduces_tensile_rows(fibre: Fibre, vacuum_pa: float, mean_n: float, error_n: float) -> None:
    """Each row of the paper comes out within 2 standard errors or 3 %."""
    peak_n = pull(ramp(0.020), vacuum_pa, fibre).max()
    assert is_reproduced(peak_n, mean_n, error_n)


def test_without_vacuum_the_membrane_adds_nothing() -> None:
    """The row without a membrane (23.634 +- 0.663 N) is the unjammed tendon within its own error."""
    assert pull(ramp(0.020), 0.0).max() == pytest.approx(23.634, abs=0.663)


def test_printed_constants_miss_the_paper_where_it_is_known_to() -> None:
    """As printed: A-30 a tenth, the unjammed tendon a fifth of what was measured, A-85 a fifth too stiff."""
    assert pull(ramp(0.020), 0.0, A30, "as_printed").max() == pytest.approx(0.86, abs=0.02)
    assert pull(ramp(0.020), 0.0, MULTI, "as_printed").max() == pytest.approx(4.1, abs=0.1)
    assert pull(ramp(0.020), 0.0, A85, "as_printed").max() == pytest.approx(103.8, abs=0.2)
    assert pull(ramp(0.020), 50e3, MULTI, "as_printed").max() == pytest.approx(50.2, rel=0.1)


def test_little_is_gained_below_ten_kilopascal() -> None:
    """From 0 to -10 kPa the peak grows by less than 3 N, as in the paper."""
    assert 0.0 < pull(ramp(0.020), 10e3).max() - pull(ramp(0.020), 0.0).max() < 3.0


def test_energy_lost_is_largest_where_the_fibres_slip_fully() -> None:
    """Every cycle loses energy, and the share lost at -20 and -30 kPa exceeds that at 0 and -50 kPa."""
    up_m = ramp(0.020)
    cycle_m = np.concatenate([up_m, up_m[::-1]])
    lost = {}
    for vacuum_kpa in (0, 10, 20, 30, 40, 50):
        work = work_j(cycle_m, pull(cycle_m, vacuum_kpa * 1e3))
        lost[vacuum_kpa] = work[-1] / work.max()
    assert min(lost.values()) > 0.1
    assert min(lost[20], lost[30]) > max(lost[0], lost[50])


def test_faster_is_stiffer() -> None:
    """Relaxation: the faster the pull, the larger the force, from 0.5 mm/s to 1 m/s."""
    peaks_n = [pull(ramp(0.020, speed), 0.0).max() for speed in (0.0005, 0.005, 0.05, 1.0)]
    assert peaks_n == sorted(peaks_n)
    assert peaks_n[-1] > 2.0 * peaks_n[0]


def test_breaks_for_good_at_55_mm() -> None:
    """The force grows up to the break, drops to zero at 55 mm and stays there on the way back and again."""
    up_m = ramp(0.0549, 0.05)
    tendon = Tendon(tendon_parameters("fitted"), DT_S)
    before_n = tendon.follow(up_m, np.zeros(len(up_m)))
    assert not tendon.broken
    assert before_n[-1] == before_n.max() > 100.0
    after_m = np.array([0.055, 0.054, 0.02, 0.0, 0.02])
    assert not tendon.follow(after_m, np.full(5, 50e3)).any()
    assert tendon.broken


def test_relaxes_while_held() -> None:
    """Held at 20 mm the force falls all the time, and stays well above nothing."""
    held_m = np.concatenate([ramp(0.020, 0.5), np.full(8000, 0.020)])
    held_n = pull(held_m, 0.0)[-8000:]
    assert (np.diff(held_n) < 0.0).all()
    assert 0.2 * held_n[0] < held_n[-1] < 0.6 * held_n[0]


@pytest.mark.parametrize("vacuum_pa", [0.0, 50e3])
def test_time_step_does_not_matter(vacuum_pa: float) -> None:
    """Half the time step changes the peak of a fast pull by less than 1 %."""
    coarse_n = pull(ramp(0.020, 0.5), vacuum_pa).max()
    fine_n = pull(ramp(0.020, 0.5, DT_S / 2.0), vacuum_pa, dt_s=DT_S / 2.0).max()
    assert fine_n == pytest.approx(coarse_n, rel=0.01)


def along(path_m: list[float], steps: int) -> np.ndarray:
    """Extensions from 0 through the corners of a path, so many steps from one to the next."""
    corners = np.arange(len(path_m) + 1) * steps
    return np.interp(np.arange(corners[-1] + 1), corners, [0.0, *path_m])


@settings(max_examples=60)
@given(path_m=paths_m, vacuum_pa=vacuums_pa, steps=st.integers(50, 2000), fibre=fibres, name=sets, early=early_slips)
def test_gives_back_no_more_than_it_got(
    path_m: list[float], vacuum_pa: float, steps: int, fibre: Fibre, name: str, early: float
) -> None:
    """Passivity: along any path at constant vacuum the work done on a fresh tendon is never negative."""
    x_m = along(path_m, steps)
    work = work_j(x_m, pull(x_m, vacuum_pa, fibre, name, early_slip=early))
    assert work.min() >= -1e-6 - 1e-3 * np.abs(work).max()


@settings(max_examples=30)
@given(
    cycle_m=st.lists(st.floats(0.0, 0.054), min_size=1, max_size=5),
    vacuum_pa=vacuums_pa,
    steps=st.integers(50, 500),
    fibre=fibres,
    name=sets,
    early=early_slips,
)
def test_every_turn_of_a_cycle_costs_work(
    cycle_m: list[float], vacuum_pa: float, steps: int, fibre: Fibre, name: str, early: float
) -> None:
    """Passivity: three turns of any cycle from slack to slack each take work, none gives any."""
    turn_m = along([*cycle_m, 0.0], steps)[1:]
    x_m = np.concatenate([[0.0], turn_m, turn_m, turn_m])
    work = work_j(x_m, pull(x_m, vacuum_pa, fibre, name, early_slip=early))
    spent_j = np.diff(work[[0, len(turn_m) - 1, 2 * len(turn_m) - 1, 3 * len(turn_m) - 1]])
    assert (spent_j >= -1e-6 - 1e-3 * np.abs(work).max()).all()


@settings(max_examples=30)
@given(path_m=paths_m, vacuum_pa=vacuums_pa, steps=st.integers(20, 1000), fibre=fibres, name=sets)
def test_half_the_step_draws_the_same_curve(
    path_m: list[float], vacuum_pa: float, steps: int, fibre: Fibre, name: str
) -> None:
    """Along any path half the time step moves the force nowhere by more than 0.1 % of its largest value."""
    coarse_n = pull(along(path_m, steps)[1:], vacuum_pa, fibre, name)
    fine_n = pull(along(path_m, 2 * steps)[1:], vacuum_pa, fibre, name, DT_S / 2.0)[1::2]
    assert np.abs(coarse_n - fine_n).max() <= 1e-6 + 1e-3 * fine_n.max()


@settings(max_examples=60)
@given(
    x_m=st.lists(st.floats(-1.0, 1.0) | st.floats(-0.005, 0.055), min_size=1, max_size=50),
    vacuum_pa=st.lists(vacuums_pa, min_size=50, max_size=50),
    fibre=fibres,
    name=sets,
)
def test_pulls_and_never_pushes(x_m: list[float], vacuum_pa: list[float], fibre: Fibre, name: str) -> None:
    """Whatever the history, jumps and overstretching included, the force is finite and not negative."""
    tendon = Tendon(tendon_parameters(name, fibre), DT_S)
    tension_n = tendon.follow(np.array(x_m), np.array(vacuum_pa[: len(x_m)]))
    assert np.isfinite(tension_n).all()
    assert (tension_n >= 0.0).all()
    assert not tension_n[np.array(x_m) <= 0.0].any()


@settings(max_examples=30)
@given(low_pa=vacuums_pa, high_pa=vacuums_pa, fibre=fibres)
def test_more_vacuum_never_pulls_less(low_pa: float, high_pa: float, fibre: Fibre) -> None:
    """While it is stretched, the force grows with vacuum at every extension."""
    low_pa, high_pa = sorted((low_pa, high_pa))
    x_m = ramp(0.020, 0.1)
    assert (pull(x_m, high_pa, fibre) >= pull(x_m, low_pa, fibre) - 1e-9).all()


def test_fibres_that_slide_one_after_the_other_hold_sooner_and_no_more() -> None:
    """Stiffer at once, a wider loop at a millimetre, and once all of them slide the same force."""
    there_m = ramp(0.040, 0.1)
    together_n, after_n = (pull(there_m, 50e3, early_slip=share) for share in (0.0, 1.0))
    assert after_n[-1] == pytest.approx(together_n[-1], abs=1e-6)
    first = there_m < 0.001
    assert (after_n[first] > together_n[first]).all()
    to_and_fro_m = np.concatenate([ramp(0.005), 0.005 + 0.001 * np.sin(np.linspace(0.0, 4.0 * np.pi, 4000))])
    lost_j = []
    for share in (0.0, 0.5, 1.0):
        rubbed_n = pull(to_and_fro_m, 20e3, early_slip=share) - pull(to_and_fro_m, 0.0)
        lost_j.append(float(np.diff(work_j(to_and_fro_m, rubbed_n)[[-2001, -1]])[0]))
    assert lost_j[0] < 0.2 * lost_j[1] < 0.2 * lost_j[2]


def test_elements_of_early_slip_follow_the_root() -> None:
    """Chords of Q sqrt(x / X) lie below it, by a sixth at most from a tenth of X on; no friction, no slip."""
    parameters = tendon_parameters("fitted")
    two = np.array(parameters.friction_stiffness_n_m), np.array(parameters.friction_yield_n_per_pa)
    stiffness, yields = slip_elements(*two, 1.0)
    last = float(np.max(two[1] / two[0]))
    extension = np.linspace(0.1, 1.0, 200) * last
    force = np.minimum(stiffness[:, None] * extension, yields[:, None]).sum(axis=0)
    root = two[1].sum() * np.sqrt(extension / last)
    assert ((force <= root + 1e-12) & (force >= root * 5.0 / 6.0)).all()
    assert not slip_elements(two[0], np.zeros(2), 1.0)[1].any()


def test_unknown_set_is_refused_by_name() -> None:
    """A set that does not exist is named, and so are those that do."""
    with pytest.raises(ValueError, match=r"'best'.*fitted, as_printed"):
        tendon_parameters("best")
