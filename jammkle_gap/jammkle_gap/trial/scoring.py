"""How good the diagnosis is over many cases. What each figure counts stands in `docs/blind.md` and here."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.november.probability import NO_GAP, UNKNOWN
from jammkle_gap.trial.answers import Said
from jammkle_gap.trial.key import Kind
from jammkle_gap.trial.outcomes import SIZES, Outcome, is_first, level, likeliest, outcome, probability
from jammkle_gap.trial.statistics import calibration_error, reliability, share

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from jammkle_gap.core.effects import EffectParameter
    from jammkle_gap.trial.answers import Answer, Estimate
    from jammkle_gap.trial.key import Truth
    from jammkle_gap.trial.statistics import Bin, Share

_CLEARLY = 2.0
"""From this size on a case is asked where it lies, and enters the figures that end in `_from_2`."""
_WORTH_CLOSING = 0.1
"""Share of the gap that the oracle must close for a case to be asked how much of that was closed."""
_TO_90 = 1.6449 / 1.9600
"""Half-width of a 90 % interval over that of a 95 % one, of a normal distribution."""
_HARMLESS = {Outcome.NOT_EXPLAINED, Outcome.NOT_SEEN}


@dataclass(frozen=True)
class Case:
    """One case with its answer."""

    name: str
    truth: Truth
    answer: Answer
    oracle: Answer | None = None
    """What is said if the true effects are the only ones on offer."""
    left_out: Answer | None = None
    """What is said if the true effect is not on offer."""

    @property
    def outcome(self) -> Outcome:
        """What became of it."""
        return outcome(self.truth, self.answer)


@dataclass(frozen=True)
class Figure:
    """One number of the score."""

    value: float
    count: int
    """Cases that it is of."""
    interval: tuple[float, float] | None = None
    """95 %, Wilson's, for shares."""


def figures(cases: Sequence[Case], parameters: Mapping[str, EffectParameter]) -> dict[str, Figure]:
    """Return every figure by name; those of no case are left out.

    Args:
        cases: Of one rung, diagnosed in one way.
        parameters: Of the library by `effect.parameter`: errors are relative to how far the truth is from null.

    """
    of = {kind: [case for case in cases if case.truth.kind is kind] for kind in Kind}
    singles, pairs = of[Kind.SINGLE], of[Kind.PAIR]
    judged = [case for case in cases if case.truth.kind is not Kind.MIDRUN]
    clear = [case for case in judged if case.truth.kind is Kind.NONE or (level(case.truth) or 0.0) >= _CLEARLY]
    found: dict[str, Figure] = {}

    def add(name: str, hits: Iterable[bool]) -> None:
        counted = share(hits)
        if counted.of:
            found[name] = _figure(counted)

    def add_mean(name: str, values: Sequence[float], middle: Callable[[Sequence[float]], object] = np.mean) -> None:
        if values:
            found[name] = Figure(float(middle(values)), len(values))  # type: ignore[arg-type]  # a NumPy number

    add("false_alarms", (case.answer.is_alarm for case in of[Kind.NONE]))
    add("wrong_names", (case.outcome is Outcome.WRONG_NAME for case in cases))
    add("wrong_sets", (case.outcome is Outcome.WRONG_SET for case in cases))
    add("unknown_rejected", (case.outcome is Outcome.RIGHT for case in of[Kind.OUTSIDE]))
    add("refused", (case.outcome is Outcome.REFUSED for case in cases))
    add("top_1", map(_is_first, singles))
    add("top_2", (is_among_two(case) for case in singles))
    for size in SIZES:
        there = [case for case in singles if level(case.truth) == size]
        add(f"top_1_at_{size:g}", map(_is_first, there))
        add(f"top_2_at_{size:g}", map(is_among_two, there))
        add(f"detected_at_{size:g}", (case.answer.is_alarm for case in there))
    large = [case for case in singles if (level(case.truth) or 0.0) >= 2.0 * _CLEARLY]
    add("top_1_from_4", map(_is_first, large))
    add("top_2_from_4", map(is_among_two, large))
    add("pairs_exact", (case.outcome is Outcome.RIGHT for case in pairs))
    add("pairs_in_set", (case.outcome in {Outcome.RIGHT, Outcome.IN_SET} for case in pairs))
    add("midrun_safe", (case.outcome in {Outcome.RIGHT, Outcome.IN_SET, *_HARMLESS} for case in of[Kind.MIDRUN]))
    if any(case.answer.probabilities for case in judged):
        add_mean("probability_on_truth", [probability(case.truth, case.answer) for case in judged])
        add_mean("probability_on_truth_from_2", [probability(case.truth, case.answer) for case in clear])
    bins = calibration(cases)
    if bins:
        found["calibration_error"] = Figure(calibration_error(bins), sum(each.count for each in bins))
    given = [case for case in (*singles, *pairs) if case.answer.said in {Said.EFFECTS, Said.AMBIGUOUS}]
    add("coverage", (case.truth.names in case.answer.candidates for case in given))
    add_mean("set_size", [float(len(case.answer.candidates)) for case in given])
    add("located", (case.answer.located in case.truth.location for case in _to_locate(cases)))
    add_mean("closed_of_oracle", _closed_of_oracle(cases))
    errors, covered = _estimates(cases, parameters)
    add_mean("parameter_error", errors, np.median)
    add("intervals_90", covered)
    left_out = [case.left_out for case in cases if case.left_out is not None]
    add("left_out_unnamed", (answer.said not in {Said.EFFECTS, Said.REFUSED} for answer in left_out))
    add("left_out_unknown", (answer.said is Said.UNKNOWN for answer in left_out))
    add_mean("wall_s", [case.answer.wall_s for case in cases if case.answer.said is not Said.REFUSED], np.median)
    add_mean("simulator_runs", [float(case.answer.runs) for case in cases if case.answer.runs], np.median)
    return found


def _is_first(case: Case) -> bool:
    return is_first(case.truth, case.answer)


def is_among_two(case: Case) -> bool:
    """Whether the truth is one of the first two."""
    return case.truth.names in case.answer.candidates[:2]


def calibration(cases: Sequence[Case]) -> tuple[Bin, ...]:
    """Return the reliability of the likeliest label of each answer.

    Labels are effects, `no gap` and `unknown`. Pairs are left out, as two effects share the probability, and changes
    in mid-run, of which no label is true; so are diagnoses that were refused.
    """
    asked = [
        case
        for case in cases
        if case.truth.kind in {Kind.NONE, Kind.SINGLE, Kind.OUTSIDE} and case.answer.probabilities
    ]
    top = [likeliest(case.answer) for case in asked]
    true = [name in _true_labels(case.truth) for case, (name, _) in zip(asked, top, strict=True)]
    return reliability([value for _, value in top], true)


def _true_labels(truth: Truth) -> frozenset[str]:
    if truth.kind is Kind.NONE:
        return frozenset({NO_GAP})
    return frozenset({UNKNOWN}) if truth.kind is Kind.OUTSIDE else truth.names


def _to_locate(cases: Sequence[Case]) -> list[Case]:
    """Return the cases that were seen and are clear enough to say where they lie."""
    return [
        case
        for case in cases
        if case.truth.location and case.answer.is_alarm and (level(case.truth) or 0.0) >= _CLEARLY
    ]


def _closed_of_oracle(cases: Sequence[Case]) -> list[float]:
    """Return how much was closed of what the true effects close; nothing is closed by what names nothing."""
    ratios = []
    for case in cases:
        best = case.oracle.closed if case.oracle is not None else None
        if best is None or best < _WORTH_CLOSING or case.truth.kind not in {Kind.SINGLE, Kind.PAIR}:
            continue
        closed = case.answer.closed if case.answer.candidates else 0.0
        ratios.append(float(np.clip((closed or 0.0) / best, 0.0, 1.0)))
    return ratios


def _estimates(cases: Sequence[Case], parameters: Mapping[str, EffectParameter]) -> tuple[list[float], list[bool]]:
    """Return errors relative to the true size, and whether 90 % intervals hold the truth, where the name is right."""
    errors, covered = [], []
    for case in cases:
        if not _is_first(case) or case.truth.kind not in {Kind.SINGLE, Kind.PAIR}:
            continue
        for effect in case.truth.effects:
            for name, true in effect.parameters.items():
                key = f"{effect.name}.{name}"
                estimate, known = case.answer.estimates.get(key), parameters.get(key)
                if estimate is None or known is None or true == known.null:
                    continue
                errors.append(abs(estimate.value - true) / abs(true - known.null))
                covered.append(_holds_at_90(estimate, known, true))
    return errors, covered


def _holds_at_90(estimate: Estimate, parameter: EffectParameter, true: float) -> bool:
    """Whether the 90 % interval holds a value. An end at which the parameter's range ends was cut there, and stays."""
    low, high = estimate.low, estimate.high
    if low > parameter.minimum:
        low = estimate.value - _TO_90 * (estimate.value - low)
    if high < parameter.maximum:
        high = estimate.value + _TO_90 * (high - estimate.value)
    return low <= true <= high


def _figure(counted: Share) -> Figure:
    return Figure(counted.value, counted.of, counted.interval)
