"""How repeats differ: by the widths that are stated, evenly, and as far apart as in the paper where it tells."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jammkle_common.parameters import from_mapping
from jammkle_sim.physics.feet import JAMMED, SQUASH_BALL, UNJAMMED
from jammkle_sim.rigs.catalogue import RIGS, run_rig, scatter_numbers, scatter_seed, scattered

PAPER_REPEATS = 5
SEEDS = range(4)
MANY = 200


def repeats_of(name: str, repeats: int, **values: object) -> list[Any]:
    """Options of so many repeats."""
    options = from_mapping(RIGS[name].options, values)
    return [scattered(name, options, repeat) for repeat in range(repeats)]


# The standard deviations that each rig states; the rigid ankle's edge is never rougher than it was set.
@pytest.mark.parametrize(
    ("name", "values", "option", "width"),
    [
        ("tensile", {}, "mounting_error_m", 0.19e-3),
        ("pressure", {}, "valve_dead_time_s", 1e-3),
        ("drop", {}, "drop_height_m", 0.6e-3),
        ("drop", {}, "pretension_m", 0.7e-3),
        ("slip", {}, "friction", 0.01),
        ("slip", {}, "slope_deg", 0.2),
        ("slip", {"foot": "rigid_ankle"}, "slope_deg", 0.2),
        ("slip", {"foot": "rigid_ankle"}, "edge_friction", 0.01),
        ("landing", {}, "drop_height_m", 0.5e-3),
        ("landing", {}, "friction", 0.01),
    ],
)
def test_an_option_scatters_as_widely_as_is_said(
    name: str, values: dict[str, object], option: str, width: float
) -> None:
    """Over many repeats the mean is what was set, and the standard deviation what the rig states."""
    chosen = np.array([getattr(options, option) for options in repeats_of(name, MANY, **values)])
    meant = getattr(from_mapping(RIGS[name].options, values), option)
    assert chosen.mean() == pytest.approx(meant, abs=0.1 * width + 1e-12)
    assert chosen.std() == pytest.approx(width, rel=0.1)


# Standard deviation over the paper's five repeats: sqrt(5) times the standard error that it prints.
@pytest.mark.parametrize(
    ("name", "values", "result", "paper_deviation"),
    [
        ("tensile", {"material": "a30"}, "peak_force_n", 0.038 * 5**0.5),
        ("drop", {"foot": SQUASH_BALL}, "peak_deceleration_m_s2", 0.230 * 5**0.5),
        ("drop", {"foot": JAMMED}, "peak_deceleration_m_s2", 0.314 * 5**0.5),
        ("drop", {"foot": UNJAMMED}, "peak_deceleration_m_s2", 0.451 * 5**0.5),
    ],
)
def test_what_is_measured_scatters_as_in_the_paper(
    name: str, values: dict[str, object], result: str, paper_deviation: float
) -> None:
    """Five repeats lie as far apart as the paper's, by 0.6 to 1.5 times, in the mean over a few seeds."""
    deviations = []
    for seed in SEEDS:
        runs = [
            run_rig(name, options, lambda _: None, lambda: False)
            for options in repeats_of(name, PAPER_REPEATS, seed=seed, **values)
        ]
        deviations.append(np.std([run.results[result] for run in runs], ddof=1))
    assert 0.6 < np.mean(deviations) / paper_deviation < 1.5


def test_numbers_are_standard_normal_and_even_within_five() -> None:
    """Mean 0, deviation 1 over many repeats; over seeds the mean of five scatters by 0.35 and 0.31, as is said."""
    numbers = np.array([scatter_numbers("drop", 0, repeat) for repeat in range(2000)])
    assert numbers.mean(axis=0) == pytest.approx([0.0, 0.0], abs=0.02)
    assert numbers.std(axis=0) == pytest.approx([1.0, 1.0], rel=0.02)
    means = np.array(
        [
            np.mean([scatter_numbers("drop", seed, repeat) for repeat in range(PAPER_REPEATS)], axis=0)
            for seed in range(1500)
        ]
    )
    assert means.std(axis=0) == pytest.approx([0.35, 0.31], abs=0.02)


@given(st.integers(0, 2**31 - 1), st.integers(0, 999))
def test_seed_and_repeat_decide(seed: int, repeat: int) -> None:
    """The same again for the same, other numbers for another seed, repeat or rig, and a seed within range."""
    assert scatter_numbers("slip", seed, repeat) == scatter_numbers("slip", seed, repeat)
    others = {
        scatter_numbers("slip", seed, repeat),
        scatter_numbers("slip", seed + 1, repeat),
        scatter_numbers("slip", seed, repeat + 1),
        scatter_numbers("drop", seed, repeat),
    }
    assert len(others) == 4
    assert 0 <= scatter_seed(seed, repeat) < 2**31
    assert scatter_seed(seed, repeat) != scatter_seed(seed, repeat + 1)
