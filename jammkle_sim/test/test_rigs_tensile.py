"""The tensile rig, pulled in MuJoCo, against the paper's table, and what a pull must show."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_common.parameters import ParameterError, from_mapping
from jammkle_sim.physics.constants import TENDON_SETS
from jammkle_sim.physics.tendon import force_table_n
from jammkle_sim.rigs.catalogue import RIGS, run_rig, scattered
from jammkle_sim.rigs.tensile import TensileOptions
from studies.paper.tables import is_reproduced

if TYPE_CHECKING:
    from jammkle_sim.rigs.run import RigRun

REPEATS = 5


def pull(repeat: int | None = None, **values: object) -> RigRun:
    """One pull, scattered if a repeat is given."""
    options = from_mapping(TensileOptions, values)
    if repeat is not None:
        options = scattered("tensile", options, repeat)
    return run_rig("tensile", options, lambda _: None, lambda: False)


def mean_peak_n(**values: object) -> float:
    """Mean peak force of five scattered pulls."""
    return float(np.mean([pull(repeat, **values).results["peak_force_n"] for repeat in range(REPEATS)]))


# Mean peak force and its standard error over five pulls to 20 mm at 5 mm/s: the paper's table.
@pytest.mark.parametrize(
    ("material", "vacuum_pa", "mean_n", "error_n"),
    [
        ("multi", 0.0, 23.330, 0.406),
        ("multi", 10e3, 25.415, 0.488),
        ("multi", 30e3, 39.852, 0.466),
        ("multi", 50e3, 50.214, 0.864),
        ("a30", 0.0, 8.997, 0.038),
        ("a30", 50e3, 11.501, 0.032),
        ("a85", 0.0, 84.294, 1.993),
        ("a85", 50e3, 96.492, 3.535),
    ],
)
def test_rig_reproduces_the_papers_rows(material: str, vacuum_pa: float, mean_n: float, error_n: float) -> None:
    """Each row comes out within 2 standard errors or 3 %, with regulated vacuum, noise and mounting errors."""
    peak_n = mean_peak_n(material=material, vacuum_pa=vacuum_pa)
    assert is_reproduced(peak_n, mean_n, error_n)


def test_row_without_a_membrane_is_the_row_with_one() -> None:
    """Without vacuum the membrane changes nothing: 23.634 +- 0.663 N in the paper, and equal to its row here."""
    without_n = mean_peak_n(membrane="no")
    assert without_n == pytest.approx(23.634, abs=0.663)
    assert without_n == pytest.approx(mean_peak_n(membrane="yes"), abs=0.663)


def test_no_vacuum_without_a_membrane() -> None:
    """Vacuum without a membrane is refused, and the line says what would do."""
    with pytest.raises(ParameterError, match=r"'vacuum_pa' is 50000; without a membrane it must be 0.*membrane to yes"):
        pull(membrane="no", vacuum_pa=50e3)


def test_crosshead_goes_where_and_as_fast_as_it_is_told() -> None:
    """It reaches 20 mm within 20 um at 5 mm/s within 1 %, and is back within 20 um, against 95 N."""
    run = pull(material="a85", vacuum_pa=50e3)
    joints = run.topics["joint_states"]
    extension_m, speed_m_s = joints.column("carriage.position"), joints.column("carriage.velocity")
    assert extension_m.max() == pytest.approx(0.020, abs=2e-5)
    assert extension_m[-1] == pytest.approx(0.0, abs=2e-5)
    rising = (extension_m > 0.002) & (extension_m < 0.018)
    assert np.abs(speed_m_s[rising]) == pytest.approx(0.005, rel=0.01)


def test_every_cycle_loses_energy_most_where_the_fibres_slip() -> None:
    """The loop is open at every vacuum, and wider at -20 and -30 kPa than at 0 and -50."""
    lost = {kpa: pull(vacuum_pa=kpa * 1e3).results["share_lost"] for kpa in (0, 10, 20, 30, 50)}
    assert min(lost.values()) > 0.1
    assert min(lost[20], lost[30]) > max(lost[0], lost[50])


def test_break_is_latched_and_shows_in_the_run() -> None:
    """At 55 mm the force drops to zero and stays there all the way back; the run says which tendon and where."""
    run = pull(extension_m=0.060, speed_m_s=0.05, vacuum_pa=50e3)
    assert run.broken == ("peroneal_left",)
    assert run.results["break_extension_m"] == pytest.approx(0.055, abs=2e-4)
    states = run.topics["tendon_states"]
    torn = states.column("peroneal_left.broken") > 0.0
    first = int(np.argmax(torn))
    assert torn[first:].all()
    assert not states.column("peroneal_left.tension_n")[first:].any()
    assert states.column("peroneal_left.tension_n")[first - 1] > 100.0
    assert np.abs(run.topics["load_cell/wrench"].column("force_z_n")[first:]).max() < 0.5


@pytest.mark.parametrize(
    ("speed_m_s", "error_m", "bound_m"), [(0.05, 0.003, 1e-4), (0.05, -0.003, 1e-4), (1.0, 0.0, 1e-3)]
)
def test_break_is_told_of_the_tendon_where_it_tore(speed_m_s: float, error_m: float, bound_m: float) -> None:
    """However it is clamped it tears at 55 mm of its own, said to half the way between two rows of the recording."""
    run = pull(extension_m=0.07, speed_m_s=speed_m_s, mounting_error_m=error_m)
    assert run.results["break_extension_m"] == pytest.approx(0.055, abs=bound_m)


def test_a_slack_tendon_loses_no_share() -> None:
    """Clamped so loosely that it is never taut there is no share of the work to tell; else there is."""
    assert "share_lost" not in pull(extension_m=0.004, mounting_error_m=-0.005).results
    assert 0.0 < pull(extension_m=0.006, mounting_error_m=-0.005).results["share_lost"] < 1.0


def test_force_at_the_break() -> None:
    """Unjammed, the long-term force at 55 mm is 116 N, and a pull at 5 mm/s tears at 136 N.

    150 +- 8 N were expected of the long-term force; with the constants that fit the eight rows at 20 mm it comes out
    lower, and the paper has no force beyond 20 mm to tell. What the law gives is held here.
    """
    static_n = force_table_n(TENDON_SETS["fitted"].fibres, 0.055, 2)[1]
    assert static_n == pytest.approx(116.0, abs=8.0)
    assert pull(extension_m=0.056).results["peak_force_n"] == pytest.approx(136.0, abs=8.0)


def test_half_the_time_step_moves_no_peak() -> None:
    """Peaks of a slow and of a fast pull move by less than 1 %."""
    for values in ({"vacuum_pa": 50e3}, {"speed_m_s": 0.5}):
        coarse, fine = pull(**values), pull(timestep_s=0.00025, **values)
        assert fine.results["peak_force_n"] == pytest.approx(coarse.results["peak_force_n"], rel=0.01)


def test_load_cell_reads_the_tendon_with_its_noise() -> None:
    """The cell is the tendon's tension, positive, but for 0.05 N of noise."""
    run = pull()
    difference_n = run.topics["load_cell/wrench"].column("force_z_n") - run.topics["tendon_states"].column(
        "peroneal_left.tension_n"
    )
    assert difference_n.std() == pytest.approx(0.05, rel=0.1)
    assert abs(difference_n.mean()) < 0.01
    assert RIGS["tensile"].options is TensileOptions
