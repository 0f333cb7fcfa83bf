"""How good the diagnosis is over many cases. What each figure counts stands in `README.md` and here."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from studies.blind.answers import Said
from studies.blind.key import Kind
from studies.blind.outcomes import (
    SIZES,
    Outcome,
    is_exact,
    is_first,
    is_in_set,
    is_ranked_first,
    is_visible,
    level,
    likeliest,
    means,
    outcome,
    probability,
)
from studies.blind.statistics import calibration_error, reliability, share

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from jammkle_gap.core.effects import EffectParameter
    from studies.blind.answers import Answer
    from studies.blind.key import Truth
    from studies.blind.statistics import Bin, Share

_CLEARLY = 2.0
"""From this size on a case is asked where it lies, and enters the figures that end in `_from_2`."""
_WORTH_CLOSING = 0.1
"""Share of the gap that the oracle, or the ceiling, must close for a case to be asked how much of that was closed."""
_CONFORMAL = 0.05
"""p-value below which an effect is out of the conformal set: it should hold the truth in 95 %."""
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
    ceiling: Answer | None = None
    """What is said with the reality as the simulator."""

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


class _Figures:
    """Gathers figures; those of no case are left out."""

    def __init__(self) -> None:
        self.found: dict[str, Figure] = {}

    def share(self, name: str, hits: Iterable[bool]) -> None:
        counted = share(hits)
        if counted.of:
            self.found[name] = _figure(counted)

    def mean(self, name: str, values: Sequence[float], middle: Callable[[Sequence[float]], object] = np.mean) -> None:
        if values:
            self.found[name] = Figure(float(middle(values)), len(values))  # type: ignore[arg-type]  # a NumPy number


def figures(cases: Sequence[Case], parameters: Mapping[str, EffectParameter]) -> dict[str, Figure]:
    """Return every figure by name; those of no case are left out.

    Args:
        cases: Of one rung, diagnosed in one way.
        parameters: Of the library by `effect.parameter`: errors are relative to how far the truth is from null.

    """
    gathered = _Figures()
    _add_names(gathered, cases)
    _add_detection(gathered, cases)
    _add_probabilities(gathered, cases)
    _add_sets(gathered, cases)
    _add_closing(gathered, cases)
    _add_estimates(gathered, cases, parameters)
    answered = [case.answer for case in cases if case.answer.said is not Said.REFUSED]
    gathered.share("refused", (case.outcome is Outcome.REFUSED for case in cases))
    gathered.mean("wall_s", [answer.wall_s for answer in answered], np.median)
    gathered.mean("cpu_s", [answer.cpu_s for answer in answered if answer.cpu_s], np.median)
    gathered.mean("simulator_runs", [float(answer.runs) for answer in answered if answer.runs], np.median)
    return gathered.found


def _of(cases: Sequence[Case], kind: Kind) -> list[Case]:
    return [case for case in cases if case.truth.kind is kind]


def _add_names(gathered: _Figures, cases: Sequence[Case]) -> None:
    singles, pairs = _of(cases, Kind.SINGLE), _of(cases, Kind.PAIR)
    visible = [case for case in singles if is_visible(case.truth)]
    named = [case for case in cases if case.answer.said is Said.EFFECTS]
    gathered.share("wrong_among_named", (case.outcome is Outcome.WRONG_NAME for case in named))
    gathered.share("wrong_names", (case.outcome is Outcome.WRONG_NAME for case in cases))
    gathered.share("top_1", (is_first(case.truth, case.answer) for case in visible))
    gathered.share("top_2", (is_in_set(case.truth, case.answer, 2) for case in visible))
    for size in (0.0, *SIZES):
        there = [case for case in singles if level(case.truth) == size]
        gathered.share(f"top_1_at_{size:g}", (is_first(case.truth, case.answer) for case in there))
        gathered.share(f"top_2_at_{size:g}", (is_in_set(case.truth, case.answer, 2) for case in there))
        gathered.share(f"ranked_at_{size:g}", (is_ranked_first(case.truth, case.answer) for case in there))
    for least in (2.0, 4.0):
        large = [case for case in singles if (level(case.truth) or 0.0) >= least]
        gathered.share(f"top_1_from_{least:g}", (is_first(case.truth, case.answer) for case in large))
        gathered.share(f"top_2_from_{least:g}", (is_in_set(case.truth, case.answer, 2) for case in large))
        gathered.share(f"ranked_from_{least:g}", (is_ranked_first(case.truth, case.answer) for case in large))
    gathered.share("pairs_exact", (case.outcome is Outcome.RIGHT for case in pairs))
    gathered.share("pairs_first", (is_first(case.truth, case.answer) for case in pairs))
    gathered.share("pairs_in_set", (is_in_set(case.truth, case.answer) for case in pairs))
    harmless = (case.outcome in {Outcome.RIGHT, Outcome.IN_SET, *_HARMLESS} for case in _of(cases, Kind.MIDRUN))
    gathered.share("midrun_safe", harmless)
    left_out = [case.left_out for case in cases if case.left_out is not None]
    gathered.share("left_out_unnamed", (answer.said not in {Said.EFFECTS, Said.REFUSED} for answer in left_out))
    gathered.share("left_out_unknown", (answer.said is Said.UNKNOWN for answer in left_out))


def _add_detection(gathered: _Figures, cases: Sequence[Case]) -> None:
    outside, singles = _of(cases, Kind.OUTSIDE), _of(cases, Kind.SINGLE)
    gathered.share("false_alarms", (case.answer.is_alarm for case in _of(cases, Kind.NONE)))
    visible = [case for case in outside if is_visible(case.truth)]
    gathered.share("unknown_rejected", (case.outcome is Outcome.RIGHT for case in visible))
    gathered.share("unknown_unnamed", (case.answer.said is not Said.EFFECTS for case in visible))
    hidden = [case for case in outside if not is_visible(case.truth)]
    gathered.share("unknown_below_1", (case.outcome is Outcome.RIGHT for case in hidden))
    for size in (0.0, *SIZES):
        there = [case for case in singles if level(case.truth) == size]
        gathered.share(f"detected_at_{size:g}", (case.answer.is_alarm for case in there))
    located = [
        case
        for case in cases
        if case.truth.location and case.answer.is_alarm and (level(case.truth) or 0.0) >= _CLEARLY
    ]
    gathered.share("located", (case.answer.located in case.truth.location for case in located))


def _add_probabilities(gathered: _Figures, cases: Sequence[Case]) -> None:
    judged = [case for case in cases if case.truth.kind is not Kind.MIDRUN and case.answer.probabilities]
    clear = [case for case in judged if case.truth.kind is Kind.NONE or (level(case.truth) or 0.0) >= _CLEARLY]
    faults = [case for case in clear if case.truth.kind is not Kind.NONE]
    for name, some in (("", judged), ("_from_2", clear), ("_of_faults_from_2", faults)):
        stated = [probability(case.truth, case.answer) for case in some]
        gathered.mean(f"probability_on_truth{name}", stated)
    bins = calibration(cases)
    if bins:
        gathered.found["calibration_error"] = Figure(calibration_error(bins), sum(each.count for each in bins))
    singles = [case for case in _of(cases, Kind.SINGLE) if case.answer.conformal and is_visible(case.truth)]
    kept = [{name for name, value in case.answer.conformal.items() if value > _CONFORMAL} for case in singles]
    gathered.share(
        "conformal_coverage",
        (
            any(case.answer.is_same({name}, case.truth.names) for name in names)
            for case, names in zip(singles, kept, strict=True)
        ),
    )
    gathered.mean("conformal_size", [float(len(names)) for names in kept])
    values = [max(p for name, p in case.answer.conformal.items() if case.answer.is_same({name}, case.truth.names))
              for case in singles
              if any(case.answer.is_same({name}, case.truth.names) for name in case.answer.conformal)]  # fmt: skip
    if values:
        # p-values of true causes are even from 0 to 1; the mean distance of their distribution from that.
        ranks = (np.arange(len(values)) + 0.5) / len(values)
        gathered.found["conformal_error"] = Figure(float(np.mean(np.abs(np.sort(values) - ranks))), len(values))


def _add_sets(gathered: _Figures, cases: Sequence[Case]) -> None:
    faults = [*_of(cases, Kind.SINGLE), *_of(cases, Kind.PAIR)]
    given = [case for case in faults if case.answer.said in {Said.EFFECTS, Said.AMBIGUOUS}]
    gathered.share("coverage", (is_in_set(case.truth, case.answer) for case in given))
    gathered.mean("set_size", [float(len(case.answer.candidates)) for case in given])
    gathered.share("sets_exact", (is_exact(case.truth, case.answer) for case in given))
    gathered.share("wrong_sets", (case.outcome is Outcome.WRONG_SET for case in cases))


def calibration(cases: Sequence[Case]) -> tuple[Bin, ...]:
    """Return the reliability of the likeliest label of each answer; none is true of a change in mid-run, left out.

    Labels are combinations, `no gap` and `unknown`; members of a class count as one.
    """
    asked = [case for case in cases if case.truth.kind is not Kind.MIDRUN and case.answer.probabilities]
    top = [likeliest(case.answer) for case in asked]
    true = [means(name, case.truth, case.answer) for case, (name, _) in zip(asked, top, strict=True)]
    return reliability([value for _, value in top], true)


def _add_closing(gathered: _Figures, cases: Sequence[Case]) -> None:
    """Add how much was closed of what the true effects close; nothing is closed by what names nothing."""
    for figure, bests in (
        ("closed_of_oracle", [case.oracle for case in cases]),
        ("closed_of_ceiling", [case.ceiling for case in cases]),
    ):
        ratios = []
        for case, best in zip(cases, bests, strict=True):
            reached = None if best is None or not best.candidates else best.closed
            if reached is None or reached < _WORTH_CLOSING or case.truth.kind not in {Kind.SINGLE, Kind.PAIR}:
                continue
            closed = case.answer.closed if case.answer.candidates else 0.0
            ratios.append(float(np.clip((closed or 0.0) / reached, 0.0, 1.0)))
        gathered.mean(figure, ratios)


def _add_estimates(gathered: _Figures, cases: Sequence[Case], parameters: Mapping[str, EffectParameter]) -> None:
    """Add errors relative to the true size, and whether 90 % intervals hold the truth, where the very name is right."""
    errors, covered = [], []
    for case in cases:
        if case.truth.kind not in {Kind.SINGLE, Kind.PAIR} or case.answer.names != case.truth.names:
            continue
        for effect in case.truth.effects:
            for name, true in effect.parameters.items():
                key = f"{effect.name}.{name}"
                estimate, known = case.answer.estimates.get(key), parameters.get(key)
                if estimate is None or known is None or true == known.null:
                    continue
                errors.append(abs(estimate.value - true) / abs(true - known.null))
                covered.append(estimate.low <= true <= estimate.high)
    gathered.mean("parameter_error", errors, np.median)
    gathered.share("intervals_90", covered)


def _figure(counted: Share) -> Figure:
    return Figure(counted.value, counted.of, counted.interval)
