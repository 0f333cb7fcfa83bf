"""`jammkle gap blind answer`: what `jammkle gap blind run` starts for a case; it reads the bags once for all ways."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from jammkle_bringup.core.blind import files
from jammkle_bringup.core.blind.questions import Run, read_questions, said_file
from jammkle_bringup.core.gap.backend import backend
from jammkle_bringup.core.gap.simulated import Simulated
from jammkle_bringup.core.signals import Interrupted, StopRequest
from jammkle_bringup.gap_diagnosing import diagnosis_of, failures_told, prepared_for
from jammkle_bringup.gap_inputs import check_given, library_of, recordings_of, rig_options
from jammkle_sim.gap.ankle.parts import PartsSimulator
from jammkle_sim.gap.baselines import baselines as rank
from jammkle_sim.gap.remembering import Remembering
from jammkle_sim.gap.result import as_dict

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from jammkle_sim.gap.effect import Library
    from jammkle_sim.gap.recording import Recording
    from jammkle_sim.gap.simulator import Simulator

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
    asked = read_questions(request.questions)
    options, stop = rig_options(asked.settings), StopRequest()

    every_effect = library_of(None, (), ())
    # All ways look at the same recordings, and begin with the same small changes to them.
    simulator = Remembering(PartsSimulator(every_effect))

    @functools.cache
    def read(bags: tuple[Path, ...]) -> list[Recording]:
        return recordings_of(bags, asked.rig, options, stop)

    @functools.cache
    def ready(references: tuple[Path, ...]) -> tuple[Sequence[Recording], Sequence[Recording]]:
        return prepared_for(Simulated.PARTS, read(asked.bags), read(references), every_effect)

    with backend(request.jobs, request.scheduler) as jobs:
        for way in asked.ways:
            references = asked.references if way.takes_references else ()
            check_given(asked.bags, references, asked.rig)
            library = library_of(None, way.only, way.without)
            ask = _ranking if way.run is Run.BASELINES else _diagnosis
            content = ask(*ready(references), library, simulator, jobs, stop)
            if stop():
                raise Interrupted
            files.write_json(said_file(request.questions.parent, way.run), content)
    return 0


def _diagnosis(
    recordings: Sequence[Recording],
    references: Sequence[Recording],
    library: Library,
    simulator: Simulator,
    jobs: int | None,
    stop: Callable[[], bool],
) -> dict[str, Any]:
    # Horizons are for whoever reads the page: they decide nothing.
    return as_dict(diagnosis_of(recordings, references, library, simulator, jobs, stop, horizons_s=()))


def _ranking(
    recordings: Sequence[Recording],
    references: Sequence[Recording],
    library: Library,
    simulator: Simulator,
    jobs: int | None,
    stop: Callable[[], bool],
) -> dict[str, Any]:
    with failures_told():
        found = rank(recordings, simulator, library, references=references, jobs=jobs, stop=stop)
    ranked = {"rmse": found.rmse, "bic": found.bic, "free": found.free}
    return {
        "baselines": {name: list(names[:_RANKED]) for name, names in ranked.items()},
        "runtime": {"wall_s": found.spent.wall_s, "simulator_runs": found.spent.runs},
    }
