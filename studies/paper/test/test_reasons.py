"""Why the printed constants miss: the sentences against what the simulation does."""

from __future__ import annotations

import dataclasses

import pytest

from jammkle_sim.physics.constants import TENDON_SETS, TendonParameters
from jammkle_sim.rigs.catalogue import RIGS, run_rig
from studies.paper.reasons import REASONS, Miss
from studies.paper.reference import row_peak_n
from studies.paper.tables import (
    DROP_ROWS,
    ROWS,
    SIGNIFICANT,
    SLIP_CLAIMS,
    TENSILE_ROWS,
    PaperRow,
    are_similar,
    is_reproduced,
    paper_row,
)

FITTED, PRINTED = TENDON_SETS["fitted"], TENDON_SETS["as_printed"]
REASON_OF = {entry.identifier: entry for entry in REASONS}


def miss_of(simulated: float, mean: float, standard_error: float) -> Miss:
    """Judge a number as physics asks it of the fitted ones: two standard errors or 3 %."""
    if is_reproduced(simulated, mean, standard_error):
        return Miss.NONE
    return Miss.TOO_HIGH if simulated > mean else Miss.TOO_LOW


def with_fitted(names: tuple[str, ...]) -> TendonParameters:
    """Make the printed tendon with some constants replaced by the fitted ones."""
    own = {name: getattr(FITTED, name) for name in names if hasattr(FITTED, name)}
    of_fibres = {name: getattr(FITTED.fibres, name) for name in names if name not in own}
    return dataclasses.replace(PRINTED, fibres=dataclasses.replace(PRINTED.fibres, **of_fibres), **own)


def run(rig: str, foot: str, parameter_set: str) -> dict[str, float]:
    """Results of one run of a rig without scatter."""
    options = RIGS[rig].options(foot=foot, parameter_set=parameter_set)
    return run_rig(rig, options, lambda _share: None, lambda: False).results


def test_every_row_and_claim_has_its_sentence() -> None:
    """In the order of the paper, one plain sentence each."""
    assert [entry.identifier for entry in REASONS] == [entry.identifier for entry in (*ROWS, *SLIP_CLAIMS)]
    for entry in REASONS:
        assert entry.sentence.endswith(".")
        assert len(entry.sentence) < 250
        assert bool(entry.culprits) == (entry.miss in {Miss.TOO_LOW, Miss.TOO_HIGH})


@pytest.mark.parametrize("row", TENSILE_ROWS, ids=lambda row: row.identifier)
def test_tensile_rows_miss_as_said_and_for_the_reason_said(row: PaperRow) -> None:
    """Too low or too high as the sentence has it; with the culprits put right, within the bound of the fitted set."""
    entry = REASON_OF[row.identifier]
    printed_n = row_peak_n(PRINTED, row)
    assert miss_of(printed_n, row.mean, row.standard_error) is entry.miss
    cured_n = row_peak_n(with_fitted(entry.culprits), row)
    assert abs(cured_n - row.mean) < 0.5 * abs(printed_n - row.mean)


@pytest.mark.parametrize("row", DROP_ROWS, ids=lambda row: row.identifier)
def test_drop_rows_miss_as_said(row: PaperRow) -> None:
    """Feet without tendons fall alike with any constants; jammed too low, unjammed too high."""
    entry, foot = REASON_OF[row.identifier], str(row.options["foot"])
    printed = run("drop", foot, "as_printed")["peak_deceleration_m_s2"]
    assert miss_of(printed, row.mean, row.standard_error) is entry.miss
    if not entry.culprits:
        assert printed == run("drop", foot, "fitted")["peak_deceleration_m_s2"]


def test_jammed_drop_misses_by_the_soft_sections_more_than_by_relaxation(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fitted fibres alone bring the printed tendon's peak back, the fitted relaxation alone less than half way."""
    mean_m_s2 = paper_row("jammed_ankle").mean
    missed = {}
    for names in ((), ("c1_pa", "c3_pa", "modulus_pa"), ("relaxation_gains",)):
        monkeypatch.setitem(TENDON_SETS, "as_printed", with_fitted(names))
        missed[names] = mean_m_s2 - run("drop", "jammed", "as_printed")["peak_deceleration_m_s2"]
    printed, fibres, relaxation = missed.values()
    assert abs(fibres) < 0.1 * printed
    assert 0.5 * printed < relaxation < printed


def test_claims_on_the_slip_test_fail_as_said() -> None:
    """As printed jammed still peaks highest and takes up most; rigid is not like unjammed with either set."""
    rigid, jammed, unjammed = (run("slip", foot, "as_printed") for foot in ("rigid_ankle", "jammed", "unjammed"))
    fitted, peak = run("slip", "unjammed", "fitted"), "peak_before_heel_n"
    assert jammed[peak] > max(rigid[peak], unjammed[peak])
    assert jammed["energy_n_m"] >= SIGNIFICANT * rigid["energy_n_m"]
    assert not are_similar(unjammed[peak], rigid[peak])
    assert not are_similar(fitted[peak], rigid[peak])
    assert rigid[peak] < unjammed[peak] < 0.5 * fitted[peak]
    assert REASON_OF["largest_peak_jammed"].miss is REASON_OF["dissipates_more_jammed"].miss is Miss.NONE
    assert REASON_OF["peak_unjammed_like_rigid"].miss is Miss.ELSEWHERE
