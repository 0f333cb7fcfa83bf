"""All that a trial comes to: every rung diagnosed in both ways, the baselines, and every case, as plain numbers."""

from __future__ import annotations

import collections
import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from jammkle_gap.trial.aims import AIMS
from jammkle_gap.trial.answers import Answer, Said, answer_of
from jammkle_gap.trial.files import answer_file, case_names, read_json
from jammkle_gap.trial.key import Kind, Rung, main_rungs
from jammkle_gap.trial.outcomes import Outcome, answer_label, label, level, likeliest, probability
from jammkle_gap.trial.questions import Run
from jammkle_gap.trial.scoring import Case, Figure, calibration, figures
from jammkle_gap.trial.tasks import BLIND
from jammkle_graph.command.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from jammkle_gap.core.effects import EffectParameter
    from jammkle_gap.trial.files import TrialFacts
    from jammkle_gap.trial.key import Key
    from jammkle_gap.trial.statistics import Bin

WAYS = (Run.WITH, Run.WITHOUT)
BASELINES = {
    "rmse": "single effects by RMSE",
    "bic": "BIC on raw samples",
    "free": "everything free, largest named",
    "majority": "majority guess",
}
_OF_SETS = {"coverage", "set_size"}
"""Figures that mean nothing for a ranking."""


@dataclass(frozen=True)
class Way:
    """One way of diagnosing: with references, or without."""

    run: Run
    cases: tuple[Case, ...]
    figures: Mapping[str, Figure]
    """Over the withheld cases; where there are none, over all."""
    rungs: Mapping[Rung, Mapping[str, Figure]]
    counts: Mapping[Rung, int]
    bins: tuple[Bin, ...]


@dataclass(frozen=True)
class Result:
    """Everything."""

    facts: TrialFacts
    answers_sha256: str
    """Of the blind answers as they were when the key was opened."""
    ways: tuple[Way, ...]
    baselines: Mapping[str, Mapping[str, Figure]]
    """By the words for each."""


def result_of(
    trial: Path, facts: TrialFacts, key: Key, answers_sha256: str, parameters: Mapping[str, EffectParameter]
) -> Result:
    """Compare answers with the key.

    Args:
        trial: Folder with the answers.
        facts: What is published of it.
        key: Opened.
        answers_sha256: Of the sealed answers.
        parameters: Of the library by `effect.parameter`.

    Raises:
        InputError: the key has other cases than the trial.

    """
    apart = sorted(set(key.cases) ^ set(case_names(trial)))
    if apart:
        msg = f"case {apart[0]} is in the key or in trial {trial}, and not in both; give the key of this trial"
        raise InputError(msg)
    answers = {run: _answers(trial, run, key) for run in (*WAYS, Run.ORACLE, Run.LEFT_OUT)}
    ways = []
    for run in WAYS:
        cases = tuple(
            Case(
                name,
                truth,
                answers[run][name],
                answers[Run.ORACLE].get(name),
                answers[Run.LEFT_OUT].get(name) if run is Run.WITH else None,
            )
            for name, truth in sorted(key.cases.items())
        )
        ways.append(_way(run, cases, parameters))
    return Result(facts, answers_sha256, tuple(ways), _baselines(trial, ways[0].cases, parameters))


def _answers(trial: Path, run: Run, key: Key) -> dict[str, Answer]:
    found = {}
    for name in key.cases:
        file = answer_file(trial, run.value, name)
        if run in BLIND or file.exists():
            found[name] = answer_of(read_json(file, "answer", "make it with `jammkle gap blind run`"))
    return found


def main_cases(cases: tuple[Case, ...]) -> tuple[Case, ...]:
    """Return the cases that the figures are of: those of the independent model, or all where there are none."""
    main = main_rungs(case.truth for case in cases)
    return tuple(case for case in cases if case.truth.rung in main)


def _way(run: Run, cases: tuple[Case, ...], parameters: Mapping[str, EffectParameter]) -> Way:
    by_rung = {rung: [case for case in cases if case.truth.rung is rung] for rung in Rung}
    main = main_cases(cases)
    return Way(
        run,
        cases,
        figures(main, parameters),
        {rung: figures(some, parameters) for rung, some in by_rung.items() if some},
        {rung: len(some) for rung, some in by_rung.items() if some},
        calibration(main),
    )


def _baselines(
    trial: Path, cases: tuple[Case, ...], parameters: Mapping[str, EffectParameter]
) -> dict[str, Mapping[str, Figure]]:
    main = main_cases(cases)
    most = collections.Counter(case.truth.names for case in main if case.truth.kind is not Kind.OUTSIDE)
    majority = most.most_common(1)[0][0] if most else frozenset()
    found: dict[str, Mapping[str, Figure]] = {}
    for name, words in BASELINES.items():
        guessed = []
        for case in main:
            if name == "majority":
                answer = Answer(Said.EFFECTS, (majority,)) if majority else Answer(Said.NO_GAP)
            else:
                file = answer_file(trial, Run.BASELINES.value, case.name)
                answer = _ranked(read_json(file, "answer", "make it with `jammkle gap blind run`"), name)
            guessed.append(dataclasses.replace(case, answer=answer, oracle=None, left_out=None))
        # They rank effects; sets are no answer of theirs.
        found[words] = {key: each for key, each in figures(guessed, parameters).items() if key not in _OF_SETS}
    return found


def _ranked(content: Mapping[str, Any], name: str) -> Answer:
    if "refused" in content:
        return answer_of(content)
    names = content["baselines"][name]
    if not names:
        return Answer(Said.NO_GAP)
    return Answer(Said.EFFECTS, tuple(frozenset({each}) for each in names))


def diagnosed_by(result: Result) -> tuple[str, ...]:
    """Return the commits of the programs that diagnosed, each once; an empty one is not known."""
    said = [case.answer for way in result.ways for case in way.cases if case.answer.said is not Said.REFUSED]
    return tuple(sorted({answer.commit for answer in said}))


def as_dict(result: Result) -> dict[str, Any]:
    """Return what JSON can hold."""
    return {
        "trial": {
            "key_sha256": result.facts.key_sha256,
            "answers_sha256": result.answers_sha256,
            "seed": result.facts.seed,
            "commit": result.facts.commit,
            "diagnosed_by": list(diagnosed_by(result)),
            "regimes": result.facts.regimes,
        },
        **{way.run.value: _way_as_dict(way) for way in result.ways},
        "baselines": {name: _figures_as_dict(found) for name, found in result.baselines.items()},
    }


def _way_as_dict(way: Way) -> dict[str, Any]:
    return {
        "figures": _figures_as_dict(way.figures),
        "aims_met": {
            aim.figure: aim.is_met(way.figures[aim.figure].value) for aim in AIMS if aim.figure in way.figures
        },
        "rungs": {rung.value: _figures_as_dict(found) for rung, found in way.rungs.items()},
        "calibration": [
            {"low": each.low, "high": each.high, "count": each.count, "stated": each.stated, "true": each.true.value}
            for each in way.bins
        ],
        "outcomes": {kind: dict(row) for kind, row in outcomes_by_kind(main_cases(way.cases)).items()},
        "cases": [case_as_dict(case) for case in way.cases],
    }


def _figures_as_dict(found: Mapping[str, Figure]) -> dict[str, Any]:
    return {
        name: {"value": each.value, "count": each.count, "interval": each.interval and list(each.interval)}
        for name, each in found.items()
    }


def case_as_dict(case: Case) -> dict[str, Any]:
    """Return one line of the table of cases."""
    name, value = likeliest(case.answer)
    return {
        "case": case.name,
        "rung": case.truth.rung.value,
        "kind": case.truth.kind.value,
        "rig": ", ".join(case.truth.rigs),
        "truth": label(case.truth),
        "what": case.truth.what,
        "size": case.truth.size,
        "said": case.answer.said.value,
        "named": answer_label(case.answer),
        "set": [sorted(names) for names in case.answer.candidates],
        "probability_on_truth": probability(case.truth, case.answer),
        "likeliest": name,
        "likeliest_probability": value,
        "located": case.answer.located,
        "outcome": case.outcome.value,
        "problem": case.answer.problem,
    }


def kind_label(case: Case) -> str:
    """Return the row of the short confusion matrix."""
    if case.truth.kind is not Kind.SINGLE:
        return {
            Kind.NONE: "no gap",
            Kind.PAIR: "pair",
            Kind.OUTSIDE: "outside the library",
            Kind.MIDRUN: "change in mid-run",
        }[case.truth.kind]
    reached = level(case.truth)
    return "single effect" if reached is None else f"single, size {reached:g}" if reached else "single, below 0.5"


def outcomes_by_kind(cases: tuple[Case, ...]) -> dict[str, collections.Counter[str]]:
    """Count outcomes by what was true."""
    table: dict[str, collections.Counter[str]] = {}
    for case in sorted(cases, key=lambda each: (list(Kind).index(each.truth.kind), level(each.truth) or 0.0)):
        table.setdefault(kind_label(case), collections.Counter())[case.outcome.value] += 1
    return table


def outcome_names() -> tuple[str, ...]:
    """Return the columns of the short confusion matrix."""
    return tuple(each.value for each in Outcome)


def confusion(cases: tuple[Case, ...]) -> tuple[list[str], list[str], dict[tuple[str, str], int]]:
    """Return rows (what is true), columns (what was said) and counts of the whole confusion matrix."""
    counts = collections.Counter((label(case.truth), answer_label(case.answer)) for case in cases)
    rows = sorted({row for row, _ in counts})
    columns = sorted({column for _, column in counts})
    last = [each.value for each in (Said.NO_GAP, Said.UNKNOWN, Said.REFUSED) if each.value in columns]
    return rows, [each for each in columns if each not in last] + last, dict(counts)
