"""`jammkle gap blind answer`: what `jammkle gap blind run` starts for a case; it reads the bags once for all ways."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from jammkle_gap.ankle.parts import PartsSimulator
from jammkle_gap.backend import backend
from jammkle_gap.diagnosing import Question, asked_in_parts, diagnosis_of, failures_told
from jammkle_gap.inputs import asked_of, library_of, recordings_of
from jammkle_gap.november.baselines import baselines as rank
from jammkle_gap.november.remembering import Remembering
from jammkle_gap.november.result import as_dict
from jammkle_gap.trial import files
from jammkle_gap.trial.questions import Run, read_questions, said_file
from jammkle_graph.command.commit import commit
from jammkle_graph.command.signals import Interrupted, StopRequest

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from jammkle_gap.core.data import Recording
    from jammkle_gap.core.effects import Library

_RANKED = 5
"""How many effects are kept of each ranking."""


@dataclass(frozen=True)
class AnswerRequest:
    """One call of `jammkle gap blind answer`."""

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
    stop, rigs = StopRequest(), [] if asked.rig is None else [asked.rig]

    every_effect = library_of(None, (), ())
    # All ways look at the same recordings, and begin with the same small changes to them.
    simulator = Remembering(PartsSimulator(every_effect))

    @functools.cache
    def read(bags: tuple[Path, ...]) -> list[Recording]:
        said, _ = asked_of(bags, (), rigs, asked.settings)
        return recordings_of(bags, said, stop)

    @functools.cache
    def question(references: tuple[Path, ...]) -> Question:
        return asked_in_parts(read(asked.bags), read(references), every_effect, simulator)

    with backend(request.jobs, request.scheduler) as jobs:
        for way in asked.ways:
            references = asked.references if way.takes_references else ()
            asked_of(asked.bags, references, rigs, asked.settings)
            library = library_of(None, way.only, way.without)
            ask = _ranking if way.run is Run.BASELINES else _diagnosis
            content = ask(question(references), library, jobs, stop)
            if stop():
                raise Interrupted
            files.write_json(said_file(request.questions.parent, way.run), {**content, "commit": program})
    return 0


def _diagnosis(
    question: Question,
    library: Library,
    jobs: int | None,
    stop: Callable[[], bool],
) -> dict[str, Any]:
    # Horizons are for whoever reads the page: they decide nothing.
    return as_dict(diagnosis_of(question, library, jobs, stop, horizons_s=()))


def _ranking(
    question: Question,
    library: Library,
    jobs: int | None,
    stop: Callable[[], bool],
) -> dict[str, Any]:
    with failures_told():
        found = rank(
            question.recordings, question.simulator, library, references=question.references, jobs=jobs, stop=stop
        )
    ranked = {"rmse": found.rmse, "bic": found.bic, "free": found.free}
    return {
        "baselines": {name: list(names[:_RANKED]) for name, names in ranked.items()},
        "runtime": {"wall_s": found.spent.wall_s, "simulator_runs": found.spent.runs},
    }
