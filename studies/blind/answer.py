"""`python -m studies.blind answer`: what `run` starts for a case; it reads the bags once for all ways."""

from __future__ import annotations

import dataclasses
import time
from typing import TYPE_CHECKING, Any

from jammkle_common.command.errors import Interrupted, StopRequest
from jammkle_common.command.results import commit
from jammkle_gap.ankle.effects import ankle_library
from jammkle_gap.ankle.problem import ankle_problem
from jammkle_gap.ankle.sensors import SensorSet, headline_set, selected
from jammkle_gap.backend import backend
from jammkle_gap.core.conclude import conclude
from jammkle_gap.core.constants import Constants
from jammkle_gap.core.diagnose import evidence_of
from jammkle_gap.core.result import as_dict
from jammkle_gap.core.signatures import cache_folder
from jammkle_gap.core.simulate import Runner
from jammkle_gap.diagnosing import command_errors, in_settings, library_of, recordings_of
from studies.blind import files
from studies.blind.baselines import baselines
from studies.blind.ceiling import CEILING_CONSTANTS, ceiling_problem
from studies.blind.questions import Run, Way, read_questions, said_file
from studies.blind.remembering import Remembering

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from jammkle_gap.core.conclude import Evidence
    from jammkle_gap.core.data import Recording
    from jammkle_gap.core.simulate import Problem
    from studies.blind.questions import Questions

_RANKED = 5
"""How many effects are kept of each ranking."""


@dataclasses.dataclass(frozen=True)
class AnswerRequest:
    """One call of `python -m studies.blind answer`."""

    questions: Path
    """Answers are written beside it."""
    jobs: int | None
    scheduler: str | None


def answer(request: AnswerRequest) -> int:
    """Answer one way after the other, write each answer as soon as it is made, and return the exit code.

    Raises:
        InputError: the questions, or the bags in the way that comes next, cannot be used.
        GraphError: the simulator fails.
        Interrupted: asked to stop; what is known by then is no answer.

    """
    asked, program = read_questions(request.questions), commit()
    case = _Case(asked)
    with backend(request.jobs, request.scheduler) as jobs:
        for way in asked.ways:
            with command_errors():
                content = case.said(way, -1 if jobs is None else jobs)
            if case.stop():
                raise Interrupted
            files.write_json(said_file(request.questions.parent, way.run), {**content, "commit": program})
    return 0


class _Case:
    """The recordings of one case, read when a way first asks for them, and what was found of them."""

    def __init__(self, asked: Questions) -> None:
        self._asked = asked
        self._read: dict[tuple[Path, ...], list[Recording]] = {}
        self._known: dict[object, dict[str, Any]] = {}
        self._headline: Evidence | None = None
        self._remembering = Remembering(ankle_problem(ankle_library()).simulator)
        self.stop = StopRequest()

    def said(self, way: Way, jobs: int) -> dict[str, Any]:
        """Return the answer to one way of asking."""
        runs, references = in_settings(*self._recordings(way))
        if way.references is not None:
            references = first_of_each(references, way.references)
        runs, references = ([_seen(run, way.sensors) for run in group] for group in (runs, references))
        if way.run is Run.CEILING:
            return _diagnosed(runs, references, ceiling_problem(), CEILING_CONSTANTS, jobs)[0]
        if way.run is Run.BASELINES:
            return self._ranked(runs, references, jobs)
        asked = (way.only, way.without, *((run.name, *(each.name for each in run.signals)) for run in runs),
                 *(run.name for run in references))  # fmt: skip
        if asked not in self._known:
            # Where other sensors are not there, their answer is one that was given.
            self._known[asked], evidence = _diagnosed(runs, references, self._problem(way), Constants(), jobs)
            if way.run is Run.WITH:
                self._headline = evidence
        return self._known[asked]

    def _problem(self, way: Way) -> Problem:
        problem = ankle_problem(library_of(None, way.only, way.without))
        return dataclasses.replace(problem, simulator=self._remembering)

    def _recordings(self, way: Way) -> tuple[list[Recording], list[Recording]]:
        """Return runs and references with all of their signals."""
        bags, given = self._asked.bags, self._asked.references if way.takes_references else ()
        for paths in (bags, given):
            if paths not in self._read:
                found = recordings_of(paths, self._asked.rig, self.stop, sensors=SensorSet.INSTRUMENTED)
                self._read[paths] = found
                self._remembering.know(found)
        return self._read[bags], self._read[given]

    def _ranked(self, runs: Sequence[Recording], references: Sequence[Recording], jobs: int) -> dict[str, Any]:
        """Return what simpler methods say of what the headline gathered."""
        # Takes a second to import, and is wanted here alone.
        from studies.blind.learned import learned  # noqa: PLC0415

        started = time.perf_counter()
        problem = self._problem(Way(Run.BASELINES))
        runner = Runner(problem, jobs)
        evidence = self._headline or evidence_of(runs, references, problem, runner, Constants(), cache_folder())
        found, classified = baselines(evidence), learned(evidence)
        ranked = {"rmse": found.rmse, "bic": found.bic, "free": found.free, "learned": tuple(classified)}
        return {
            "baselines": {name: list(names[:_RANKED]) for name, names in ranked.items()},
            "classes": [list(each) for each in evidence.classes],
            "runtime": {"wall_s": time.perf_counter() - started, "simulator_runs": runner.runs},
        }


def _seen(recording: Recording, sensors: SensorSet | None) -> Recording:
    return selected(recording, sensors or headline_set(recording))


def first_of_each(references: Sequence[Recording], count: int) -> list[Recording]:
    """Return so many references of every setting."""
    seen: dict[str, int] = {}
    kept = []
    for each in references:
        seen[each.setting] = seen.get(each.setting, 0) + 1
        if seen[each.setting] <= count:
            kept.append(each)
    return kept


def _diagnosed(
    runs: Sequence[Recording], references: Sequence[Recording], problem: Problem, constants: Constants, jobs: int
) -> tuple[dict[str, Any], Evidence]:
    """Return what `diagnose` says, and the evidence behind it; no experiment is planned."""
    started, begun = time.perf_counter(), time.process_time()
    runner = Runner(problem, jobs)
    evidence = evidence_of(runs, references, problem, runner, constants, cache_folder())
    found = conclude(evidence, (), runner, constants)
    spent = dataclasses.replace(found.spent, wall_s=time.perf_counter() - started)
    said = as_dict(dataclasses.replace(found, spent=spent))
    said["runtime"]["cpu_s"] = time.process_time() - begun
    return said, evidence
