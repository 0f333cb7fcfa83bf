"""The effect that the demo hides: drawn within their ranges, loadable, and judged honestly."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import pytest
import yaml

from jammkle_common.command.errors import InputError
from jammkle_gap import HiddenEffect, Verdict, ankle_library
from jammkle_gap.core.result import Candidate
from jammkle_gap.landing import EFFECTS, DemoEffect, Outcome

if TYPE_CHECKING:
    from jammkle_gap import Diagnosis

HIDDEN = HiddenEffect({"tendon_stiffness.scale": 1.3})
STIFFNESS, FRICTION, OFFSET = ("tendon_stiffness",), ("jamming_friction",), ("imu_offset",)


def said(verdict: Verdict, *candidates: Candidate) -> Diagnosis:
    """A diagnosis, as far as it is judged."""
    return cast("Diagnosis", SimpleNamespace(verdict=verdict, candidates=candidates))


def named(*names: str, equivalents: tuple[str, ...] = ()) -> Candidate:
    """A candidate."""
    return Candidate(names, 0.5, 0.9, (), equivalents)


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_every_effect_is_of_the_library_and_within_its_bounds(effect: DemoEffect) -> None:
    """Whatever is drawn can be loaded by the sim node, and is not its null value."""
    known = ankle_library().effect(effect.name)
    parameter = next(each for each in known.parameters if each.name == effect.parameter)
    assert parameter.minimum <= effect.smallest < effect.largest <= parameter.maximum
    assert not effect.smallest <= parameter.null <= effect.largest
    (value,) = HiddenEffect.drawn(effect.name, 1).values.values()
    assert effect.smallest <= value <= effect.largest


def test_without_a_name_any_may_be_drawn() -> None:
    """Over many draws each of them comes up."""
    assert {HiddenEffect.drawn(None, seed).name for seed in range(200)} == {effect.name for effect in EFFECTS}


def test_an_effect_that_a_landing_cannot_show_is_refused() -> None:
    """One line that names what was given and what there is."""
    with pytest.raises(InputError, match=r"--effect 'payload' .* tendon_stiffness"):
        HiddenEffect.drawn("payload")


def test_the_hidden_effect_is_a_file_that_the_simulation_loads() -> None:
    """It holds the effect that was drawn, and nothing where nothing is hidden."""
    table: dict[str, Any] = yaml.safe_load(HIDDEN.effects_file)
    assert table == {"tendon_stiffness": {"scale": 1.3}}
    assert not HiddenEffect.nothing().effects_file


@pytest.mark.parametrize(
    ("hidden", "diagnosis", "expected"),
    [
        (HIDDEN, said(Verdict.EFFECTS, named(*STIFFNESS)), Outcome.RIGHT),
        (HIDDEN, said(Verdict.EFFECTS, named(*STIFFNESS, equivalents=FRICTION)), Outcome.AMONG_SEVERAL),
        (HIDDEN, said(Verdict.EFFECTS, named(*FRICTION, equivalents=STIFFNESS)), Outcome.AMONG_SEVERAL),
        (HIDDEN, said(Verdict.EFFECTS, named(*FRICTION)), Outcome.WRONG),
        (HIDDEN, said(Verdict.EFFECTS, named(*FRICTION, *STIFFNESS)), Outcome.WRONG),
        (HIDDEN, said(Verdict.AMBIGUOUS, named(*FRICTION), named(*STIFFNESS)), Outcome.AMONG_SEVERAL),
        (HIDDEN, said(Verdict.AMBIGUOUS, named(*FRICTION), named(*OFFSET)), Outcome.WRONG),
        (HIDDEN, said(Verdict.NO_GAP), Outcome.MISSED),
        (HIDDEN, said(Verdict.UNKNOWN, named()), Outcome.MISSED),
        (HiddenEffect({}), said(Verdict.NO_GAP), Outcome.RIGHT),
        (HiddenEffect({}), said(Verdict.UNKNOWN, named()), Outcome.WRONG),
        (HiddenEffect({}), said(Verdict.EFFECTS, named(*OFFSET)), Outcome.WRONG),
    ],
)
def test_the_outcome_is_as_it_is(hidden: HiddenEffect, diagnosis: Diagnosis, expected: Outcome) -> None:
    """Only the one right name counts as right; a name where nothing was is as wrong as a wrong name."""
    assert hidden.outcome(diagnosis) is expected


def test_the_truth_has_value_and_unit() -> None:
    """Name, parameter, value, and its null."""
    assert HiddenEffect({"imu_offset.z_m_s2": 0.3}).text(ankle_library()) == "imu_offset, z_m_s2 0.3 m/s2 (null at 0)"
    assert HiddenEffect({}).text(ankle_library()).startswith("nothing")
