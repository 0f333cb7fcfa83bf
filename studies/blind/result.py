"""All that a trial comes to: every way of diagnosing, the ceiling, the baselines, and every case, as plain numbers."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from jammkle_common.command.errors import InputError
from studies.blind.aims import AIMS
from studies.blind.answers import Answer, Said, answer_of
from studies.blind.beside import baseline_ways, ceiling_way
from studies.blind.files import answer_file, case_names, read_json
from studies.blind.outcomes import answer_label, label, likeliest, probability
from studies.blind.questions import Run
from studies.blind.scoring import Case
from studies.blind.tables import outcomes_by_kind
from studies.blind.tasks import SAMPLED, sample
from studies.blind.ways import Way, main_cases, way_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from jammkle_gap.core.effects import EffectParameter
    from studies.blind.files import TrialFacts
    from studies.blind.key import Key
    from studies.blind.scoring import Figure

WAYS = (Run.WITH, Run.FEWER, Run.WITHOUT, Run.ROBOT, Run.INSTRUMENTED)
WAY_NAMES = {
    Run.WITH: "rig's sensors, five references",
    Run.FEWER: "rig's sensors, three references",
    Run.WITHOUT: "rig's sensors, no reference",
    Run.ROBOT: "robot's sensors, five references",
    Run.INSTRUMENTED: "instrumented tendons, five references",
}


@dataclass(frozen=True)
class Result:
    """Everything."""

    facts: TrialFacts
    answers_sha256: str
    """Of the blind answers as they were when the key was opened."""
    ways: tuple[Way, ...]
    """The headline first; then, of the sample, the headline again and every other way."""
    ceiling: tuple[Way, Way] | None
    """The ceiling, and the headline on the same cases."""
    baselines: tuple[Way, ...]
    """On all withheld cases."""


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
    answers = {run: _answers(trial, run, key) for run in (*WAYS, Run.ORACLE, Run.LEFT_OUT, Run.CEILING)}
    sampled = sample(trial)

    def cases_of(run: Run, names: Sequence[str]) -> tuple[Case, ...]:
        return tuple(
            Case(
                name,
                key.cases[name],
                answers[run][name],
                answers[Run.ORACLE].get(name),
                answers[Run.LEFT_OUT].get(name) if run is Run.WITH else None,
                answers[Run.CEILING].get(name),
            )
            for name in names
            if name in answers[run]
        )

    everything = cases_of(Run.WITH, sorted(key.cases))
    ways = [way_of(WAY_NAMES[Run.WITH], everything, parameters)]
    if len(sampled) < len(key.cases):
        name = f"{WAY_NAMES[Run.WITH]}, sample of {len(sampled)}"
        ways.append(way_of(name, cases_of(Run.WITH, sorted(sampled)), parameters))
    ways += [way_of(WAY_NAMES[run], cases_of(run, sorted(sampled)), parameters) for run in WAYS if run in SAMPLED]
    return Result(
        facts,
        answers_sha256,
        tuple(ways),
        ceiling_way(everything, parameters),
        baseline_ways(trial, everything, parameters),
    )


def _answers(trial: Path, run: Run, key: Key) -> dict[str, Answer]:
    found = {}
    for name in key.cases:
        file = answer_file(trial, run.value, name)
        if run is Run.WITH or file.exists():
            found[name] = answer_of(read_json(file, "answer", "make it with `python -m studies.blind run`"))
    return found


def diagnosed_by(result: Result) -> tuple[str, ...]:
    """Return the commits of the programs that diagnosed, each once; an empty one is not known."""
    said = [case.answer for way in result.ways for case in way.cases if case.answer.said is not Said.REFUSED]
    return tuple(sorted({answer.commit for answer in said}))


def as_dict(result: Result) -> dict[str, Any]:
    """Return what JSON can hold."""
    ceiling = result.ceiling
    return {
        "trial": {
            **dataclasses.asdict(result.facts),
            "answers_sha256": result.answers_sha256,
            "diagnosed_by": list(diagnosed_by(result)),
        },
        "ways": {way.name: _way_as_dict(way) for way in result.ways},
        "ceiling": None if ceiling is None else {way.name: _figures_as_dict(way.figures) for way in ceiling},
        "baselines": {
            way.name: {
                "figures": _figures_as_dict(way.figures),
                "rigs": {rig: _figures_as_dict(found) for rig, found in way.rigs.items()},
            }
            for way in result.baselines
        },
    }


def _way_as_dict(way: Way) -> dict[str, Any]:
    return {
        "figures": _figures_as_dict(way.figures),
        "aims_met": {
            aim.figure: aim.is_met(way.figures[aim.figure].value) for aim in AIMS if aim.figure in way.figures
        },
        "rungs": {rung.value: _figures_as_dict(found) for rung, found in way.rungs.items()},
        "rigs": {rig: _figures_as_dict(found) for rig, found in way.rigs.items()},
        "effects": {name: _figures_as_dict(found) for name, found in way.effects.items()},
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
        "scatter": case.truth.scatter,
        "said": case.answer.said.value,
        "named": answer_label(case.answer),
        "set": [sorted(names) for names in case.answer.candidates],
        "p_value": case.answer.p_value,
        "probability_on_truth": probability(case.truth, case.answer),
        "likeliest": name,
        "likeliest_probability": value,
        "located": case.answer.located,
        "outcome": case.outcome.value,
        "problem": case.answer.problem,
        "wall_s": case.answer.wall_s,
    }
