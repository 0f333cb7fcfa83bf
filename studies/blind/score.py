"""How good the diagnosis is: one answer beside one truth, and figures over many cases."""

from __future__ import annotations

import enum
import itertools
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy.stats import binomtest  # type: ignore[import-untyped]  # carries no types

from studies.blind.cases import SIZES, Kind, main_rungs

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from jammkle_gap import EffectParameter
    from studies.blind.cases import Truth

NO_GAP: Final = "no_gap"
UNKNOWN: Final = "unknown"
"""What probabilities are stated for, beside candidates."""
_BINS = 10
_CLEARLY = 2.0
"""From this size on a case is asked where it lies, and enters the figures that end in `_from_2`."""
_WORTH_CLOSING = 0.1
"""Share of the gap that the oracle, or the ceiling, must close for a case to be asked how much of that was closed."""


class Verdict(enum.Enum):
    """The verdicts of a diagnosis, and one where it gave none."""

    NO_GAP = "NO_GAP"
    EFFECTS = "EFFECTS"
    AMBIGUOUS = "AMBIGUOUS"
    UNKNOWN = "UNKNOWN"
    REFUSED = "REFUSED"


class Outcome(enum.Enum):
    """What became of a case."""

    RIGHT = "right"
    """`EFFECTS` with exactly what is true; `NO_GAP` where nothing is wrong; `UNKNOWN` where the library has no name."""
    IN_SET = "in the set"
    """`AMBIGUOUS`, and the truth is one of the set."""
    PART = "part of it"
    """`EFFECTS` with one of two true ones and nothing else."""
    WRONG_SET = "wrong set"
    """`AMBIGUOUS` without the truth."""
    WRONG_NAME = "wrong name"
    """`EFFECTS` with one that is not true: the worst."""
    NOT_SEEN = "not seen"
    """`NO_GAP` where something is wrong."""
    NOT_EXPLAINED = "not explained"
    """`UNKNOWN` where the library has a name, or where nothing is wrong."""
    REFUSED = "refused"


@dataclass(frozen=True)
class Answer:
    """One diagnosis, as far as the score needs it."""

    verdict: Verdict
    candidates: tuple[frozenset[str], ...] = ()
    """The credible set without "none of them", best first; empty unless effects are named, as leads are no answer."""
    ranking: tuple[frozenset[str], ...] = ()
    """All candidates, most probable first, whether or not a gap was found."""
    probabilities: Mapping[str, float] = field(default_factory=dict)
    """Of NO_GAP, of UNKNOWN, and of candidates, as names with " + " between them; they add up to 1."""
    classes: tuple[frozenset[str], ...] = ()
    """Effects that these recordings cannot separate at all: naming one is naming all."""
    located: str = ""
    """The subsystem that most likely holds the cause."""
    closed: float | None = None
    """Share of the gap that the best candidate closes on held-out settings."""
    estimates: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    """Value and ends of the 90 % interval by `effect.parameter`, of the first candidate."""
    p_value: float | None = None
    spent: Mapping[str, float] = field(default_factory=dict)
    """Wall and processor time, s, and simulator runs."""
    problem: str = ""
    """Why it was refused."""
    commit: str = ""

    @property
    def names(self) -> frozenset[str]:
        """The first candidate."""
        return self.candidates[0] if self.candidates else frozenset()

    @property
    def is_alarm(self) -> bool:
        """Whether it says that something is wrong."""
        return self.verdict in {Verdict.EFFECTS, Verdict.AMBIGUOUS, Verdict.UNKNOWN}

    def is_same(self, names: Iterable[str], other: Iterable[str]) -> bool:
        """Whether two combinations are the same up to equivalence classes."""
        one, two = list(names), list(other)
        return len(one) == len(two) and any(
            all(a == b or any({a, b} <= members for members in self.classes) for a, b in zip(one, order, strict=True))
            for order in itertools.permutations(two)
        )

    @property
    def label(self) -> str:
        """A column of the confusion matrix: a set goes by its first candidate."""
        if self.verdict not in {Verdict.EFFECTS, Verdict.AMBIGUOUS}:
            return str(self.verdict.value)
        return (" + ".join(sorted(self.names)) or "no effect") + (
            ", or others" if self.verdict is Verdict.AMBIGUOUS else ""
        )


def answer_of(content: Mapping[str, Any]) -> Answer:
    """Return the answer that a diagnosis's JSON holds."""
    if "refused" in content:
        return Answer(Verdict.REFUSED, problem=str(content["refused"]))
    if "rms" in content:
        ranking = tuple(frozenset({name}) for name in content["rms"])
        return Answer(Verdict.EFFECTS if ranking else Verdict.NO_GAP, ranking, ranking)
    verdict = Verdict(content["verdict"])
    named = [each for each in content.get("set") or [] if each["names"]]
    listed = named if verdict in {Verdict.EFFECTS, Verdict.AMBIGUOUS} else []
    posterior = content.get("posterior") or []
    gap, subsystems = float(content.get("gap_probability") or 0.0), content.get("subsystems") or {"": 0.0}
    stated = {" + ".join(sorted(each["names"])) or UNKNOWN: float(each["probability"] or 0.0) for each in posterior}
    held = [each["closed"] for each in content["gap"].get("held_out") or [] if each["closed"] is not None]
    closed = [content["gap"]["closed"]] if not held and content["gap"].get("closed") is not None else held
    return Answer(
        verdict,
        tuple(frozenset(each["names"]) for each in listed),
        tuple(frozenset(each["names"]) for each in posterior if each["names"]),
        {NO_GAP: 1.0 - gap, **{label: gap * value for label, value in stated.items()}},
        tuple(map(frozenset, content.get("classes") or ())),
        max(subsystems, key=subsystems.__getitem__),
        float(np.mean(np.clip(closed, 0.0, 1.0))) if closed else None,
        {
            f"{effect['name']}.{name}": (value["value"], *value["interval"])
            for effect in (listed[0]["effects"] if listed else [])
            for name, value in effect["parameters"].items()
            if None not in (value["value"], *value["interval"])
        },
        content.get("p_value"),
        {name: float(content["runtime"].get(name) or 0.0) for name in ("wall_s", "cpu_s", "simulator_runs")},
        commit=str(content.get("commit") or ""),
    )


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
    """What is said with the second simulator in the place of the first."""

    def is_true(self, names: Iterable[str]) -> bool:
        """Whether a combination is the truth, or an equivalent of it."""
        return bool(self.truth.names) and self.answer.is_same(names, self.truth.names)

    @property
    def is_first(self) -> bool:
        """Whether the truth is what is named first, alone or before others."""
        return self.is_in_set(1)

    @property
    def is_ranked_first(self) -> bool:
        """Whether the truth is the most probable candidate, whether or not it was named."""
        return any(map(self.is_true, self.answer.ranking[:1]))

    def is_in_set(self, most: int | None = None) -> bool:
        """Whether the truth is one of the set, or of its first members."""
        return any(map(self.is_true, self.answer.candidates[:most]))

    @property
    def is_exact(self) -> bool:
        """Whether the set is complete and has no false member."""
        members = {name for names in self.answer.candidates for name in names}
        return self.is_in_set() and all(
            any(self.answer.is_same({name}, {true}) for true in self.truth.names) for name in members
        )

    @property
    def outcome(self) -> Outcome:
        """What became of it."""
        kind, verdict = self.truth.kind, self.answer.verdict
        if verdict is Verdict.REFUSED:
            return Outcome.REFUSED
        if verdict is Verdict.NO_GAP:
            return Outcome.RIGHT if kind is Kind.NONE else Outcome.NOT_SEEN
        if verdict is Verdict.UNKNOWN:
            return Outcome.RIGHT if kind is Kind.OUTSIDE else Outcome.NOT_EXPLAINED
        if verdict is Verdict.AMBIGUOUS:
            return Outcome.IN_SET if self.is_in_set() else Outcome.WRONG_SET
        if self.is_first:
            return Outcome.RIGHT
        part = kind is Kind.PAIR and any(self.answer.is_same(self.answer.names, {name}) for name in self.truth.names)
        return Outcome.PART if part else Outcome.WRONG_NAME

    def means(self, label: str) -> bool:
        """Whether a label of the answer's probabilities is the truth."""
        if label in {NO_GAP, UNKNOWN}:
            return self.truth.kind is (Kind.NONE if label == NO_GAP else Kind.OUTSIDE)
        return self.is_true(label.split(" + "))

    @property
    def probability(self) -> float:
        """The probability that the answer puts on the truth; members of its class count."""
        return sum(value for label, value in self.answer.probabilities.items() if self.means(label))

    @property
    def likeliest(self) -> tuple[str, float]:
        """What the answer holds most likely, and how likely; members of a class add up."""
        totals: dict[str, float] = {}
        for label, value in self.answer.probabilities.items():
            names = label.split(" + ")
            first = next((each for each in totals if self.answer.is_same(each.split(" + "), names)), label)
            totals[first] = totals.get(first, 0.0) + value
        return max(totals.items(), key=lambda one: one[1], default=("", 0.0))

    @property
    def label(self) -> str:
        """The truth as a row of the confusion matrix."""
        special = {Kind.NONE: Verdict.NO_GAP.value, Kind.OUTSIDE: "outside the library"}
        name = " + ".join(sorted(self.truth.names)) + (", in mid-run" if self.truth.kind is Kind.MIDRUN else "")
        return special.get(self.truth.kind, name)

    @property
    def row(self) -> str:
        """The row of the table of outcomes."""
        level, kind = self.truth.level, self.truth.kind
        if kind is Kind.OUTSIDE:
            return "outside the library, below 1" if level == 0.0 else "outside the library"
        if kind is not Kind.SINGLE:
            return {Kind.NONE: "healthy", Kind.PAIR: "pair", Kind.MIDRUN: "change in mid-run"}[kind]
        return "single effect" if level is None else f"single, size {level:g}" if level else "single, below 1"


@dataclass(frozen=True)
class Figure:
    """One number of the score."""

    value: float
    count: int
    """Cases that it is of."""
    interval: tuple[float, float] | None = None
    """95 %, Wilson's, for shares."""


@dataclass(frozen=True)
class Bin:
    """Answers of about the same stated probability."""

    stated: float
    """Mean probability that was stated."""
    true: Figure
    """How many came true."""


class _Figures(dict[str, Figure]):
    """Gathers figures; those of no case are left out."""

    def share(self, name: str, hits: Iterable[bool]) -> None:
        found = share(hits)
        if found.count:
            self[name] = found

    def mean(self, name: str, values: Sequence[float], middle: Callable[[Any], Any] = np.mean) -> None:
        if values:
            self[name] = Figure(float(middle(values)), len(values))


def share(hits: Iterable[bool]) -> Figure:
    """Return a share with its interval by Wilson's score."""
    listed = [bool(hit) for hit in hits]
    if not listed:
        return Figure(float("nan"), 0)
    found = binomtest(sum(listed), len(listed)).proportion_ci(0.95, method="wilson")
    return Figure(sum(listed) / len(listed), len(listed), (float(found.low), float(found.high)))


def main_cases(cases: Sequence[Case]) -> list[Case]:
    """Return the cases that figures are of: those of the independent model, or all where there are none."""
    main = main_rungs(case.truth for case in cases)
    return [case for case in cases if case.truth.rung in main]


def figures(cases: Sequence[Case], parameters: Mapping[str, EffectParameter]) -> dict[str, Figure]:
    """Return every figure by name; those of no case are left out."""
    found = _Figures()
    of = {kind: [case for case in cases if case.truth.kind is kind] for kind in Kind}
    singles, pairs, faults = of[Kind.SINGLE], of[Kind.PAIR], [*of[Kind.SINGLE], *of[Kind.PAIR]]
    answered = [case.answer for case in cases if case.answer.verdict is not Verdict.REFUSED]
    found.share("false_alarms", (case.answer.is_alarm for case in of[Kind.NONE]))
    named = [case for case in cases if case.answer.verdict is Verdict.EFFECTS]
    found.share("wrong_among_named", (case.outcome is Outcome.WRONG_NAME for case in named))
    found.share("wrong_names", (case.outcome is Outcome.WRONG_NAME for case in cases))
    found.share("wrong_sets", (case.outcome is Outcome.WRONG_SET for case in cases))
    found.share("refused", (case.outcome is Outcome.REFUSED for case in cases))
    parts = {f"at_{size:g}": [case for case in singles if case.truth.level == size] for size in (0.0, *SIZES)}
    parts |= {f"from_{least:g}": [case for case in singles if (case.truth.level or 0.0) >= least] for least in (2, 4)}
    for name, some in {"": [case for case in singles if case.truth.is_visible], **parts}.items():
        end = f"_{name}" if name else ""
        found.share(f"top_1{end}", (case.is_first for case in some))
        found.share(f"top_2{end}", (case.is_in_set(2) for case in some))
        found.share(f"ranked{end}", (case.is_ranked_first for case in some))
        found.share(f"detected{end}", (case.answer.is_alarm for case in some))
    found.share("pairs_exact", (case.outcome is Outcome.RIGHT for case in pairs))
    found.share("pairs_first", (case.is_first for case in pairs))
    found.share("pairs_in_set", (case.is_in_set() for case in pairs))
    safe = {Outcome.RIGHT, Outcome.IN_SET, Outcome.NOT_EXPLAINED, Outcome.NOT_SEEN}
    found.share("midrun_safe", (case.outcome in safe for case in of[Kind.MIDRUN]))
    left_out = [case.left_out.verdict for case in cases if case.left_out is not None]
    found.share("left_out_unnamed", (each not in {Verdict.EFFECTS, Verdict.REFUSED} for each in left_out))
    found.share("left_out_unknown", (each is Verdict.UNKNOWN for each in left_out))
    for name, visible in (("unknown_rejected", True), ("unknown_below_1", False)):
        some = [case for case in of[Kind.OUTSIDE] if case.truth.is_visible is visible]
        found.share(name, (case.answer.verdict is Verdict.UNKNOWN for case in some))
        if visible:
            found.share("unknown_unnamed", (case.outcome is not Outcome.WRONG_NAME for case in some))
    given = [case for case in faults if case.answer.verdict in {Verdict.EFFECTS, Verdict.AMBIGUOUS}]
    found.share("coverage", (case.is_in_set() for case in given))
    found.mean("set_size", [float(len(case.answer.candidates)) for case in given])
    found.share("sets_exact", (case.is_exact for case in given))
    _add_probabilities(found, cases)
    _add_closing(found, cases)
    _add_estimates(found, faults, parameters)
    for name in ("wall_s", "cpu_s", "simulator_runs"):
        found.mean(name, [each.spent[name] for each in answered if each.spent.get(name)], np.median)
    return dict(found)


def _add_probabilities(found: _Figures, cases: Sequence[Case]) -> None:
    judged = [case for case in cases if case.truth.kind is not Kind.MIDRUN and case.answer.probabilities]
    clear = [case for case in judged if case.truth.kind is Kind.NONE or (case.truth.level or 0.0) >= _CLEARLY]
    faults = [case for case in clear if case.truth.kind is not Kind.NONE]
    for name, some in (("", judged), ("_from_2", clear), ("_of_faults_from_2", faults)):
        found.mean(f"probability_on_truth{name}", [case.probability for case in some])
    bins = reliability(cases)
    if bins:
        count = sum(each.true.count for each in bins)
        error = sum(each.true.count * abs(each.stated - each.true.value) for each in bins) / count
        found["calibration_error"] = Figure(error, count)
    seen = [case for case in cases if case.answer.is_alarm and (case.truth.level or 0.0) >= _CLEARLY]
    located = [case for case in seen if case.truth.location]
    found.share("located", (case.answer.located in case.truth.location for case in located))


def reliability(cases: Sequence[Case]) -> tuple[Bin, ...]:
    """Sort the likeliest label of each answer into bins by the probability that was stated for it.

    Labels are combinations, `no gap` and `unknown`; none is true of a change in mid-run, which is left out.
    """
    asked = [case for case in cases if case.truth.kind is not Kind.MIDRUN and case.answer.probabilities]
    top = [case.likeliest for case in asked]
    edges = np.linspace(0.0, 1.0, _BINS + 1)
    place = np.clip(np.digitize([stated for _, stated in top], edges[1:-1], right=True), 0, _BINS - 1)
    bins = []
    for k in sorted(set(place.tolist())):
        inside = [i for i in range(len(asked)) if place[i] == k]
        true = share(asked[i].means(top[i][0]) for i in inside)
        bins.append(Bin(float(np.mean([top[i][1] for i in inside])), true))
    return tuple(bins)


def _add_closing(found: _Figures, cases: Sequence[Case]) -> None:
    """Add how much was closed of what the true effects close; nothing is closed by what names nothing."""
    for name in ("oracle", "ceiling"):
        ratios = []
        for case in cases:
            best: Answer | None = getattr(case, name)
            reached = None if best is None or not best.candidates else best.closed
            if reached is None or reached < _WORTH_CLOSING or case.truth.kind not in {Kind.SINGLE, Kind.PAIR}:
                continue
            closed = case.answer.closed if case.answer.candidates else 0.0
            ratios.append(float(np.clip((closed or 0.0) / reached, 0.0, 1.0)))
        found.mean(f"closed_of_{name}", ratios)


def _add_estimates(found: _Figures, faults: Sequence[Case], parameters: Mapping[str, EffectParameter]) -> None:
    """Add errors relative to the true size, and whether 90 % intervals hold the truth, where the very name is right."""
    errors, covered = [], []
    for case in faults:
        if case.answer.names == case.truth.names:
            for effect in case.truth.effects:
                for name, true in effect.parameters.items():
                    key = f"{effect.name}.{name}"
                    estimate, known = case.answer.estimates.get(key), parameters.get(key)
                    if estimate is not None and known is not None and true != known.null:
                        errors.append(abs(estimate[0] - true) / abs(true - known.null))
                        covered.append(estimate[1] <= true <= estimate[2])
    found.mean("parameter_error", errors, np.median)
    found.share("intervals_90", covered)


@dataclass(frozen=True)
class WayScore:
    """One way of diagnosing with its figures: over the withheld cases, and over parts of them."""

    name: str
    cases: tuple[Case, ...]
    figures: Mapping[str, Figure]
    parts: Mapping[str, tuple[int, Mapping[str, Figure]]]
    """By rung, rig, single effect and cause outside the library: how many cases, and their figures."""
    bins: tuple[Bin, ...]

    @property
    def outcomes(self) -> dict[str, Counter[str]]:
        """Outcomes of the withheld cases, counted by what was true."""
        table: dict[str, Counter[str]] = {}
        cases = main_cases(self.cases)
        for case in sorted(cases, key=lambda each: (list(Kind).index(each.truth.kind), each.truth.level or 0.0)):
            table.setdefault(case.row, Counter())[case.outcome.value] += 1
        return table


def score_of(name: str, cases: Sequence[Case], parameters: Mapping[str, EffectParameter]) -> WayScore:
    """Return a way of diagnosing with all of its figures."""
    main = main_cases(cases)

    keys: list[tuple[Sequence[Case], Callable[[Case], str]]] = [
        (cases, lambda case: case.truth.rung.value),
        (main, lambda case: ", ".join(case.truth.rigs)),
        (main, _cause),
    ]
    parts = {
        part: [case for case in some if key(case) == part]
        for some, key in keys
        for part in sorted({key(case) for case in some} - {""})
    }
    found = {part: (len(some), figures(some, parameters)) for part, some in parts.items()}
    return WayScore(name, tuple(cases), figures(main, parameters), found, reliability(main))


def _cause(case: Case) -> str:
    """Return the single cause of a case; empty where there is none or several."""
    if len(case.truth.names) == 1:
        return next(iter(case.truth.names))
    return "" if case.truth.names else case.truth.what.partition(" (")[0]
