"""The diagnosis itself, for all who ask for one: with a progress bar, and failures as the command tells them."""

from __future__ import annotations

import contextlib
import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_gap.ankle.experiments import experiments
from jammkle_gap.ankle.parts import PartsSimulator, prepared_for_parts
from jammkle_gap.ankle.simulator import AnkleSimulator
from jammkle_gap.ankle.specimen import WithTendons, tendons_told_by
from jammkle_gap.ankle.subsystems import subsystem_simulators
from jammkle_gap.november.diagnosis import diagnose as diagnose_recordings
from jammkle_gap.core.effects import BadEffectError
from jammkle_gap.core.data import BadRecordingError
from jammkle_gap.november.runs import StoppedError
from jammkle_gap.november.where import HORIZONS_S
from jammkle_graph.command.errors import GraphError, InputError
from jammkle_graph.command.progress import progress_bar
from jammkle_graph.command.signals import Interrupted
from jammkle_sim.rigs.simulation import UnstableSimulationError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from jammkle_gap.november.diagnosis import Diagnosis
    from jammkle_gap.core.effects import Library
    from jammkle_gap.core.data import Recording
    from jammkle_gap.november.simulator import RestartingSimulator, Simulator


@dataclass(frozen=True)
class Question:
    """What is asked about: recordings, references and a simulator that go together."""

    recordings: Sequence[Recording]
    references: Sequence[Recording]
    simulator: Simulator


def asked_whole(recordings: Sequence[Recording], references: Sequence[Recording], library: Library) -> Question:
    """Ask by the commands alone."""
    return Question(recordings, references, AnkleSimulator(library))


def asked_in_parts(
    recordings: Sequence[Recording],
    references: Sequence[Recording],
    library: Library,
    parts: RestartingSimulator | None = None,
) -> Question:
    """Ask in parts, of tendons as references tell them to be.

    Args:
        recordings: To be diagnosed.
        references: Of the same machine in good order.
        library: Effects offered.
        parts: The simulator in parts, if there is one already.

    Raises:
        InputError: a recording or an effect cannot be used.
        GraphError: the simulator fails.

    """
    simulator = parts or PartsSimulator(library)
    with failures_told():
        own, others = prepared_for_parts(recordings, references, library)
        told = tendons_told_by(others)
    if not told:
        return Question(own, others, simulator)
    values = ", ".join(f"{name} {value:.3g}" for name, value in told.items())
    note = f"effects come on top of tendons as the references tell them to be: {values}"
    own = [dataclasses.replace(own[0], notes=(*own[0].notes, note)), *own[1:]]
    return Question(own, others, WithTendons(simulator, library, tuple(told.items())))


def diagnosis_of(
    question: Question,
    library: Library,
    jobs: int | None,
    stop: Callable[[], bool],
    horizons_s: Sequence[float] = HORIZONS_S,
) -> Diagnosis:
    """Diagnose recordings; one that was stopped on the way says so.

    Raises:
        InputError: a recording or an effect cannot be used.
        GraphError: the simulator fails.
        Interrupted: stopped before anything was known.

    """
    with progress_bar("diagnosing") as update:
        furthest = 0.0

        def on_progress(stage: str, share: float, _left_s: float) -> None:
            nonlocal furthest
            furthest = max(furthest, share)
            update(furthest, stage)

        with failures_told():
            return diagnose_recordings(
                question.recordings,
                question.simulator,
                library,
                references=question.references,
                subsystems=subsystem_simulators(library),
                experiments=experiments(),
                horizons_s=horizons_s,
                jobs=jobs,
                on_progress=on_progress,
                stop=stop,
            )


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
    except UnstableSimulationError as error:
        raise GraphError(str(error)) from error
    except StoppedError as error:
        raise Interrupted from error
