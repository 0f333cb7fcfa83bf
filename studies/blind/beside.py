"""What stands beside the diagnosis: the ceiling, and simpler methods, on the same cases."""

from __future__ import annotations

import collections
import dataclasses
from typing import TYPE_CHECKING, Any

from studies.blind.answers import NO_GAP, Answer, Said, answer_of
from studies.blind.files import answer_file, read_json
from studies.blind.key import Kind
from studies.blind.questions import Run
from studies.blind.ways import main_cases, way_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from jammkle_gap.core.effects import EffectParameter
    from studies.blind.scoring import Case
    from studies.blind.ways import Way

BASELINES = {
    "rmse": "single effects by RMS error",
    "bic": "BIC on raw samples",
    "free": "everything free, largest named",
    "learned": "classifier learned on simulated signatures",
    "majority": "majority guess",
}
_OF_SETS = {"coverage", "set_size", "sets_exact"}
"""Figures that mean nothing for a ranking."""


def ceiling_way(cases: Sequence[Case], parameters: Mapping[str, EffectParameter]) -> tuple[Way, Way] | None:
    """Return the ceiling, and the headline on the same cases; None where it was not asked."""
    asked = [case for case in cases if case.ceiling is not None]
    if not asked:
        return None
    under = [
        dataclasses.replace(case, answer=case.ceiling, oracle=None, left_out=None, ceiling=None)
        for case in asked
        if case.ceiling is not None
    ]
    return way_of("ceiling", under, {}), way_of("this diagnosis, same cases", asked, parameters)


def baseline_ways(trial: Path, cases: Sequence[Case], parameters: Mapping[str, EffectParameter]) -> tuple[Way, ...]:
    """Return simpler methods; the majority guess is read off the key.

    Args:
        trial: Folder with the answers.
        cases: Of the headline: its classes hold for all.
        parameters: Of the library by `effect.parameter`.

    """
    main = main_cases(cases)
    most = collections.Counter(case.truth.names for case in main if case.truth.kind is not Kind.OUTSIDE)
    majority = most.most_common(1)[0][0] if most else frozenset()
    found = []
    for name, words in BASELINES.items():
        guessed = []
        for case in main:
            if name == "majority":
                answer = Answer(Said.EFFECTS, (majority,)) if majority else Answer(Said.NO_GAP)
            else:
                file = answer_file(trial, Run.BASELINES.value, case.name)
                answer = _ranked(read_json(file, "answer", "make it with `python -m studies.blind run`"), name)
            answer = dataclasses.replace(answer, classes=case.answer.classes)
            guessed.append(dataclasses.replace(case, answer=answer, oracle=None, left_out=None, ceiling=None))
        way = way_of(words, guessed, parameters)
        # They rank effects; sets are no answer of theirs.
        kept = {key: each for key, each in way.figures.items() if key not in _OF_SETS}
        found.append(dataclasses.replace(way, figures=kept))
    return tuple(found)


def _ranked(content: Mapping[str, Any], name: str) -> Answer:
    if "refused" in content:
        return answer_of(content)
    names = content["baselines"].get(name) or []
    if not names or names[0] == NO_GAP:
        return Answer(Said.NO_GAP)
    ranking = tuple(frozenset({each}) for each in names if each != NO_GAP)
    return Answer(Said.EFFECTS, ranking, ranking)
