"""The demo's secrets: drawn within their ranges, loadable, and judged honestly."""

from __future__ import annotations

import random

import pytest

from jammkle_gap.ankle.effects import ankle_library
from jammkle_gap.landing_effects import EFFECTS, DemoEffect, Outcome, Secret, draw, outcome
from jammkle_gap.november.verdict import Verdict
from jammkle_graph.command.errors import InputError

SECRET = Secret({"tendon_stiffness.scale": 1.3})


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_every_effect_is_of_the_library_and_within_its_bounds(effect: DemoEffect) -> None:
    """Whatever is drawn can be loaded by the sim node, and is not its null value."""
    known = ankle_library().effect(effect.name)
    parameter = next(each for each in known.parameters if each.name == effect.parameter)
    assert parameter.minimum <= effect.smallest < effect.largest <= parameter.maximum
    assert not effect.smallest <= parameter.null <= effect.largest
    (value,) = draw(random.Random(1), effect.name).values.values()  # noqa: S311 - a repeatable draw
    assert effect.smallest <= value <= effect.largest


def test_without_a_name_any_may_be_drawn() -> None:
    """Over many draws each of them comes up."""
    generator = random.Random(0)  # noqa: S311 - a repeatable draw
    assert {draw(generator, None).name for _ in range(200)} == {effect.name for effect in EFFECTS}


def test_an_effect_that_a_landing_cannot_show_is_refused() -> None:
    """One line that names what was given and what there is."""
    with pytest.raises(InputError, match=r"--effect 'payload' .* tendon_stiffness"):
        draw(random.Random(0), "payload")  # noqa: S311 - a repeatable draw


@pytest.mark.parametrize(
    ("secret", "verdict", "candidates", "expected"),
    [
        (SECRET, Verdict.EFFECTS, [("tendon_stiffness",)], Outcome.RIGHT),
        (SECRET, Verdict.EFFECTS, [("jamming_friction",)], Outcome.WRONG),
        (SECRET, Verdict.EFFECTS, [("jamming_friction", "tendon_stiffness")], Outcome.WRONG),
        (SECRET, Verdict.AMBIGUOUS, [("jamming_friction",), ("tendon_stiffness",)], Outcome.AMONG_SEVERAL),
        (SECRET, Verdict.AMBIGUOUS, [("jamming_friction",), ("imu_offset",)], Outcome.WRONG),
        (SECRET, Verdict.NO_GAP, [()], Outcome.MISSED),
        (SECRET, Verdict.UNKNOWN, [()], Outcome.MISSED),
        (Secret({}), Verdict.NO_GAP, [()], Outcome.RIGHT),
        (Secret({}), Verdict.UNKNOWN, [()], Outcome.WRONG),
        (Secret({}), Verdict.EFFECTS, [("imu_offset",)], Outcome.WRONG),
    ],
)
def test_the_outcome_is_told_as_it_is(
    secret: Secret, verdict: Verdict, candidates: list[tuple[str, ...]], expected: Outcome
) -> None:
    """Only the one right name counts as right; a name where nothing was is as wrong as a wrong name."""
    assert outcome(secret, verdict, candidates) is expected


def test_the_truth_is_told_with_value_and_unit() -> None:
    """Name, parameter, value, and where it would be off."""
    assert Secret({"imu_offset.z_m_s2": 0.3}).text(ankle_library()) == "imu_offset, z_m_s2 0.3 m/s2 (off at 0)"
    assert Secret({}).text(ankle_library()).startswith("nothing")
