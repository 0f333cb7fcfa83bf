"""Figures of a blind trial: tables of verdicts made by hand give what a hand counts."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jammkle_gap import EffectParameter
from studies.blind.cases import Kind, TrueEffect, Truth
from studies.blind.score import Answer, Case, Outcome, Verdict, answer_of, figures, reliability, share

PARAMETERS = {
    "a.x": EffectParameter("x", "1", 0.0, -9.0, 9.0, "by hand"),
    "b.x": EffectParameter("x", "1", 1.0, 0.0, 3.2, "by hand"),
}


def truth(kind: Kind, *names: str, size: float | None = None, value: float = 2.0) -> Truth:
    """Return a truth whose effects all have one parameter x."""
    location = ("pneumatics",) if names or kind is Kind.OUTSIDE else ()
    return Truth(kind, tuple(TrueEffect(name, {"x": value}) for name in names), location=location, size=size)


def said(verdict: Verdict, *candidates: str, **rest: object) -> Answer:
    """Return an answer; a candidate is names with + between."""
    split = tuple(frozenset(each.split("+")) if each else frozenset[str]() for each in candidates)
    return Answer(verdict, split, **rest)  # type: ignore[arg-type]


EFFECTS, SET, NONE, UNKNOWN = Verdict.EFFECTS, Verdict.AMBIGUOUS, Verdict.NO_GAP, Verdict.UNKNOWN


@pytest.mark.parametrize(
    ("what", "answer", "expected"),
    [
        (truth(Kind.NONE), said(NONE), Outcome.RIGHT),
        (truth(Kind.NONE), said(UNKNOWN), Outcome.NOT_EXPLAINED),
        (truth(Kind.NONE), said(EFFECTS, "a"), Outcome.WRONG_NAME),
        (truth(Kind.NONE), said(SET, "a", "b"), Outcome.WRONG_SET),
        (truth(Kind.NONE), said(Verdict.REFUSED), Outcome.REFUSED),
        (truth(Kind.SINGLE, "a"), said(EFFECTS, "a"), Outcome.RIGHT),
        (truth(Kind.SINGLE, "a"), said(EFFECTS, "b"), Outcome.WRONG_NAME),
        (truth(Kind.SINGLE, "a"), said(EFFECTS, "a+b"), Outcome.WRONG_NAME),
        (truth(Kind.SINGLE, "a"), said(EFFECTS, "b", "a"), Outcome.WRONG_NAME),  # a ranking names its first
        (truth(Kind.SINGLE, "a"), said(SET, "b", "a"), Outcome.IN_SET),
        (truth(Kind.SINGLE, "a"), said(SET, "b", "a+b"), Outcome.WRONG_SET),
        (truth(Kind.SINGLE, "a"), said(NONE), Outcome.NOT_SEEN),
        (truth(Kind.SINGLE, "a"), said(UNKNOWN), Outcome.NOT_EXPLAINED),
        (truth(Kind.PAIR, "a", "b"), said(EFFECTS, "b+a"), Outcome.RIGHT),
        (truth(Kind.PAIR, "a", "b"), said(EFFECTS, "a"), Outcome.PART),
        (truth(Kind.PAIR, "a", "b"), said(EFFECTS, "a+c"), Outcome.WRONG_NAME),
        (truth(Kind.OUTSIDE), said(UNKNOWN), Outcome.RIGHT),
        (truth(Kind.OUTSIDE), said(EFFECTS, "a"), Outcome.WRONG_NAME),
        (truth(Kind.OUTSIDE), said(SET, "", "a"), Outcome.WRONG_SET),
        (truth(Kind.MIDRUN, "a"), said(EFFECTS, "a"), Outcome.RIGHT),
        (truth(Kind.MIDRUN, "a"), said(UNKNOWN), Outcome.NOT_EXPLAINED),
        (truth(Kind.MIDRUN, "a"), said(EFFECTS, "b"), Outcome.WRONG_NAME),
    ],
)
def test_what_becomes_of_a_case(what: Truth, answer: Answer, expected: Outcome) -> None:
    """Every truth beside every kind of answer; an effect too many is a wrong name."""
    assert Case("1", what, answer).outcome is expected


def scored(*pairs: tuple[Truth, Answer]) -> dict[str, tuple[float, int]]:
    """Return value and count of every figure."""
    cases = [Case(str(k), what, answer) for k, (what, answer) in enumerate(pairs)]
    return {name: (each.value, each.count) for name, each in figures(cases, PARAMETERS).items()}


def test_figures_are_those_counted_by_hand() -> None:
    """Of twelve answers, each figure is the share that a reader counts in the table; what is too small is apart."""
    found = scored(
        (truth(Kind.NONE), said(NONE)),
        (truth(Kind.NONE), said(NONE)),
        (truth(Kind.NONE), said(UNKNOWN)),
        (truth(Kind.SINGLE, "a", size=4.1), said(EFFECTS, "a", located="pneumatics")),
        (truth(Kind.SINGLE, "a", size=8.0), said(SET, "b", "a", "c", located="tendon")),
        (truth(Kind.SINGLE, "a", size=2.0), said(EFFECTS, "b", located="pneumatics")),
        (truth(Kind.SINGLE, "b", size=1.0), said(NONE)),
        (truth(Kind.SINGLE, "b", size=0.5), said(EFFECTS, "b")),
        (truth(Kind.PAIR, "a", "b", size=4.0), said(EFFECTS, "a+b", located="pneumatics")),
        (truth(Kind.OUTSIDE, size=8.0), said(UNKNOWN, located="mechanics")),
        (truth(Kind.OUTSIDE, size=0.3), said(NONE)),
        (truth(Kind.MIDRUN, "a", size=8.0), said(EFFECTS, "c", located="pneumatics")),
    )
    assert found["false_alarms"] == (pytest.approx(1 / 3), 3)
    assert found["wrong_names"] == (pytest.approx(2 / 12), 12)
    assert found["wrong_among_named"] == (pytest.approx(2 / 5), 5)
    assert found["wrong_sets"] == (0.0, 12)
    assert found["unknown_rejected"] == (1.0, 1)
    assert found["unknown_below_1"] == (0.0, 1)
    assert found["top_1_at_0"] == (1.0, 1)
    assert found["top_1"] == (pytest.approx(1 / 4), 4)
    assert found["top_2"] == (pytest.approx(2 / 4), 4)
    assert found["top_1_at_2"] == (0.0, 1)
    assert found["top_1_from_4"] == (pytest.approx(1 / 2), 2)
    assert found["detected_at_1"] == (0.0, 1)
    assert found["detected_at_0"] == (1.0, 1)
    assert found["detected_at_2"] == (1.0, 1)
    assert found["pairs_exact"] == (1.0, 1)
    assert found["coverage"] == (pytest.approx(4 / 5), 5)
    assert found["set_size"] == (pytest.approx((1 + 3 + 1 + 1 + 1) / 5), 5)
    assert found["sets_exact"] == (pytest.approx(3 / 5), 5)
    assert found["midrun_safe"] == (0.0, 1)
    # a, a, a of size 2 and more, the pair, outside, in mid-run: six seen, of which two lie elsewhere
    assert found["located"] == (pytest.approx(4 / 6), 6)


def test_probability_on_the_truth_is_the_mean_over_all_cases() -> None:
    """No gap and unknown are answers like others; half of a pair is not the pair; a change in mid-run is left out."""
    found = scored(
        (truth(Kind.NONE), said(NONE, probabilities={"no_gap": 0.9, "a": 0.1})),
        (truth(Kind.SINGLE, "a"), said(EFFECTS, "a", probabilities={"a": 0.7, "b": 0.3})),
        (truth(Kind.PAIR, "a", "b"), said(EFFECTS, "a+b", probabilities={"a + b": 0.9, "b": 0.05, "unknown": 0.05})),
        (truth(Kind.OUTSIDE), said(UNKNOWN, probabilities={"unknown": 0.6, "a": 0.4})),
        (truth(Kind.MIDRUN, "a"), said(UNKNOWN, probabilities={"unknown": 1.0})),
    )
    assert found["probability_on_truth"] == (pytest.approx((0.9 + 0.7 + 0.9 + 0.6) / 4), 4)


def test_what_is_closed_is_measured_against_the_oracle() -> None:
    """An answer that closes half of what the true effect closes counts a half; one that names nothing, none."""
    single = truth(Kind.SINGLE, "a")
    oracle = said(EFFECTS, "a", closed=0.8)
    cases = [
        Case("1", single, said(EFFECTS, "a", closed=0.4), oracle),
        Case("2", single, said(UNKNOWN, closed=0.7), oracle),
        Case("3", single, said(EFFECTS, "a", closed=0.9), oracle),
        Case("4", single, said(EFFECTS, "a", closed=0.9), said(EFFECTS, "a", closed=0.05)),
    ]
    found = figures(cases, PARAMETERS)["closed_of_oracle"]
    assert (found.value, found.count) == (pytest.approx((0.5 + 0.0 + 1.0) / 3), 3)


def test_errors_are_relative_to_the_size_of_the_effect() -> None:
    """With b off at 1 and truly 3, an estimate of 2.5 is off by a quarter; an interval holds the truth or does not."""
    what = truth(Kind.SINGLE, "b", value=3.0)
    near = Answer(EFFECTS, (frozenset({"b"}),), estimates={"b.x": (2.5, 1.9, 3.1)})
    far = Answer(EFFECTS, (frozenset({"b"}),), estimates={"b.x": (2.5, 2.1, 2.9)})
    wrong = Answer(EFFECTS, (frozenset({"a"}),), estimates={"a.x": (9.0, 8.0, 10.0)})
    found = figures([Case("1", what, near), Case("2", what, far), Case("3", what, wrong)], PARAMETERS)
    assert (found["parameter_error"].value, found["parameter_error"].count) == (pytest.approx(0.25), 2)
    assert (found["intervals_90"].value, found["intervals_90"].count) == (0.5, 2)


def test_members_of_a_class_count_as_one_answer() -> None:
    """Naming what was declared equivalent to the truth is right, alone and in a pair, and its probability counts."""
    same = (frozenset({"a", "c"}),)
    single, pair = truth(Kind.SINGLE, "a"), truth(Kind.PAIR, "a", "b")
    other = said(EFFECTS, "c", classes=same, probabilities={"c": 0.6, "a": 0.3, "b": 0.1})
    assert Case("1", single, other).outcome is Outcome.RIGHT
    assert Case("1", single, said(EFFECTS, "c")).outcome is Outcome.WRONG_NAME
    assert Case("1", pair, said(EFFECTS, "b+c", classes=same)).is_first
    assert not Case("1", pair, said(EFFECTS, "a+c", classes=same)).is_first
    assert Case("1", single, other).probability == pytest.approx(0.9)
    assert Case("1", single, other).likeliest == ("c", pytest.approx(0.9))


def test_a_set_is_exact_without_false_members() -> None:
    """The pair and its halves are exact; one more effect, or the pair missing, is not."""
    pair = truth(Kind.PAIR, "a", "b")
    exact = [Case("1", pair, said(SET, *members)).is_exact for members in (("a+b", "a"), ("a+b", "a+c"), ("a", "b"))]
    assert exact == [True, False, False]


def test_an_effect_left_out_must_not_be_replaced_by_another_name() -> None:
    """Unknown is right, a set is bearable, a name is not."""
    single = truth(Kind.SINGLE, "a", size=8.0)
    right = said(EFFECTS, "a")
    cases = [
        Case("1", single, right, left_out=said(UNKNOWN)),
        Case("2", single, right, left_out=said(SET, "b", "c")),
        Case("3", single, right, left_out=said(EFFECTS, "b")),
        Case("4", single, right, left_out=said(Verdict.REFUSED)),
    ]
    found = figures(cases, PARAMETERS)
    assert found["left_out_unknown"].value == pytest.approx(1 / 4)
    assert found["left_out_unnamed"].value == pytest.approx(2 / 4)


def stated(*answers: tuple[float, bool]) -> list[Case]:
    """Return cases that are healthy or not, with a probability for a healthy machine of 0.5 and more."""
    return [
        Case(str(k), truth(Kind.NONE if true else Kind.OUTSIDE), said(NONE, probabilities={"no_gap": value}))
        for k, (value, true) in enumerate(answers)
    ]


def test_calibration_error_by_hand() -> None:
    """Two answers at 0.95 of which one is right, two at 0.55 of which one is: (0.45 + 0.05) / 2."""
    cases = stated((0.95, True), (0.95, False), (0.55, True), (0.55, False))
    assert [(each.true.count, each.true.value) for each in reliability(cases)] == [(2, 0.5), (2, 0.5)]
    assert figures(cases, PARAMETERS)["calibration_error"].value == pytest.approx(0.25)
    assert reliability([]) == ()


def test_wilson_of_nine_in_ten() -> None:
    """The interval is that of the formula, (p + z2/2n -+ z sqrt(p q/n + z2/4n2)) / (1 + z2/n)."""
    z, n, p = 1.959964, 10, 0.9
    middle, spread = p + z * z / (2 * n), z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    expected = [(middle - spread) / (1 + z * z / n), (middle + spread) / (1 + z * z / n)]
    assert share([True] * 9 + [False]).interval == pytest.approx(expected, abs=1e-6)
    assert share([]).count == 0


@given(st.lists(st.tuples(st.floats(0.0, 1.0), st.booleans()), max_size=50))
def test_no_answer_is_lost_between_bins(answers: list[tuple[float, bool]]) -> None:
    """Every answer lies in one bin, and the error is between 0 and 1."""
    cases = stated(*answers)
    assert sum(each.true.count for each in reliability(cases)) == len(answers)
    assert not answers or 0.0 <= figures(cases, PARAMETERS)["calibration_error"].value <= 1.0


def test_a_size_is_that_of_the_largest_step_reached() -> None:
    """A tenth short still counts, as sizes are a factor of two apart; an unknown size is none."""
    assert [truth(Kind.SINGLE, "a", size=size).level for size in (0.2, 0.91, 1.9, 3.5, 3.7, 30.0)] == [
        0.0, 1.0, 2.0, 2.0, 4.0, 8.0,
    ]  # fmt: skip
    assert truth(Kind.SINGLE, "a").level is None


def test_leads_of_an_unknown_are_no_answer() -> None:
    """What is listed with UNKNOWN names nothing, and a refusal is an answer of its own."""
    content = {
        "verdict": "UNKNOWN",
        "effects": [{"name": "a", "subsystem": "tendon", "parameters": {}}],
        "set": [{"names": ["a"], "effects": []}],
        "posterior": [{"names": [], "probability": 0.8}, {"names": ["a"], "probability": 0.2}],
        "gap_probability": 0.5,
        "subsystems": {"tendon": 0.1, "pneumatics": 0.9},
        "gap": {"closed": 0.5},
        "runtime": {"wall_s": 2.0, "simulator_runs": 7},
    }
    answer = answer_of(content)
    assert (answer.candidates, answer.located, answer.spent["simulator_runs"]) == ((), "pneumatics", 7)
    assert answer.ranking == (frozenset({"a"}),)
    assert answer.probabilities == pytest.approx({"no_gap": 0.5, "unknown": 0.4, "a": 0.1})
    assert answer_of({"refused": "too short"}).verdict is Verdict.REFUSED
