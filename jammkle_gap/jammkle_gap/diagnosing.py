"""The diagnosis itself, for all who ask for one: with a progress bar, and failures as the command tells them."""

from __future__ import annotations

import contextlib
import sys
from typing import TYPE_CHECKING

from jammkle_common.command.errors import GraphError, InputError, Interrupted
from jammkle_common.command.results import progress_bar
from jammkle_gap.ankle.experiments import experiments
from jammkle_gap.core.data import BadRecordingError
from jammkle_gap.core.diagnose import diagnose as diagnose_recordings
from jammkle_gap.core.effects import BadEffectError
from jammkle_gap.core.simulate import SimulatorError, StoppedError
from jammkle_gap.report.words import first_answer
from jammkle_sim.rigs.simulation import UnstableSimulationError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from jammkle_gap.core.data import Recording
    from jammkle_gap.core.result import Diagnosis
    from jammkle_gap.core.simulate import Problem

_ALL_CORES = -1
_STAGES = {
    "signatures": (0.0, 0.6),
    "nominal": (0.6, 0.62),
    "calibrating": (0.62, 0.7),
    "constants of the machine": (0.7, 0.74),
    "screening": (0.74, 0.8),
    "fitting": (0.8, 0.87),
    "fitting pairs": (0.87, 0.94),
    "weighing the simulator's own error": (0.94, 0.97),
    "planning the next run": (0.97, 1.0),
}
"""From which share of a diagnosis to which each of its stages goes. Measured, on a machine that knows no signatures."""


def diagnosis_of(
    recordings: Sequence[Recording],
    references: Sequence[Recording],
    problem: Problem,
    jobs: int | None,
    stop: Callable[[], bool],
) -> Diagnosis:
    """Diagnose recordings, telling a first answer on the way; one that was stopped says so.

    Args:
        recordings: Of the machine in question, with their settings.
        references: Of the same machine while healthy, in the same settings.
        problem: Simulator and effects on offer.
        jobs: Runs at a time; None: one per core.
        stop: True ends the search with what is known by then.

    Raises:
        InputError: a recording or an effect cannot be used.
        GraphError: the simulator fails.
        Interrupted: stopped before anything was known.

    """
    with progress_bar("diagnosing") as update, failures_told():
        furthest = 0.0

        def on_progress(stage: str, share: float) -> None:
            nonlocal furthest
            begin, end = _STAGES.get(stage, (furthest, furthest))
            furthest = max(furthest, begin + share * (end - begin))
            update(furthest, stage)

        return diagnose_recordings(
            recordings,
            problem,
            references=references,
            experiments=experiments(),
            jobs=_ALL_CORES if jobs is None else jobs,
            progress=on_progress,
            provisional=tell_first_answer,
            stop=stop,
        )


def tell_first_answer(shares: Sequence[tuple[str, float]]) -> None:
    """Say on stderr what comes first before any fit; a bar that is there moves down."""
    if shares:
        sys.stderr.write(f"{first_answer(shares)}\n")


@contextlib.contextmanager
def failures_told() -> Iterator[None]:
    """Have what fails in the block told as the command tells it.

    Raises:
        InputError: a recording or an effect cannot be used.
        GraphError: the simulator fails.
        Interrupted: asked to stop.

    """
    try:
        yield
    except (BadRecordingError, BadEffectError) as error:
        raise InputError(str(error)) from error
    except (SimulatorError, UnstableSimulationError) as error:
        raise GraphError(str(error)) from error
    except StoppedError as error:
        raise Interrupted from error
