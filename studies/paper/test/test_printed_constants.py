"""The paper's own gap: printed constants against the printed table, and what the page says of it."""

from __future__ import annotations

import numpy as np
import pytest

from jammkle_gap import Verdict
from jammkle_sim.physics.constants import TENDON_SETS
from studies.paper import printed_constants as study

PAIR = ("friction_scale", "soft_c1")


def test_without_corrections_it_is_the_printed_set() -> None:
    """Null values give exactly the printed constants."""
    assert study.corrected({}) == TENDON_SETS["as_printed"]


def test_every_correction_moves_a_row() -> None:
    """No correction is silently left out."""
    for effect in study.LIBRARY:
        for each in effect.parameters:
            moved = {effect.key(each): each.maximum}
            runs = [study.load(row) for row in study.ROWS]
            far = [np.ptp([study.simulate(run, values)["peak_force"][0] for values in ({}, moved)]) for run in runs]
            assert max(far) > 1.0, effect.name


def test_all_rows_lead_to_a_larger_c1_with_less_friction() -> None:
    """C1 is in every candidate that counts, some thirteen times the printed; beside it friction, by scale or onset."""
    found = study.run()
    assert found.verdict is Verdict.AMBIGUOUS
    assert sum(share for names, share in found.posterior.items() if "soft_c1" in names) > 0.95
    assert {names for each in found.candidates for names in each.names} <= {*PAIR, "friction_onset"}
    assert 8.0 < study.fitted_values(found)["soft_c1.c1"] / study.NULL["soft_c1.c1"] < 15.0
    assert 0.7 < found.gap.closed < 0.95


def test_more_noise_says_the_same() -> None:
    """With at least 1.5 % of each mean as noise, the answer is the same: C1, or, with little, none of them."""
    found = study.run(least_share=0.015)
    shares = dict(found.posterior)
    none = shares.pop((), 0.0)
    assert sum(share for names, share in shares.items() if "soft_c1" in names) > 0.95 * (1.0 - none)
    assert none < 0.1
    assert found.verdict is Verdict.AMBIGUOUS


def test_without_c1_on_offer_nothing_is_named() -> None:
    """No other correction takes the place of C1, though some mend several of the smaller rows."""
    found = study.run(library=study.LIBRARY.without("soft_c1"))
    assert found.verdict is Verdict.UNKNOWN
    assert found.candidates[0].names == ()


def test_without_vacuum_c1_is_what_hardness_says() -> None:
    """0.13 MPa, with C3 beside it; E, which one row alone decides, is not named."""
    found = study.run(study.UNJAMMED)
    names = {name for each in found.candidates for name in each.names}
    assert names <= {"soft_c1", "soft_c3"}
    assert study.fitted_values(found)["soft_c1.c1"] == pytest.approx(0.13, rel=0.05)
    rows = {row.identifier: row for row in study.UNJAMMED}
    predicted_n = {name: study.predicted_n(row, study.UNJAMMED, sorted(names)) for name, row in rows.items()}
    assert predicted_n["a30_atm"] == pytest.approx(rows["a30_atm"].mean, rel=0.05)
    assert predicted_n["a85_atm"] > 1.2 * rows["a85_atm"].mean
