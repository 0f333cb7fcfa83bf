"""The diagnosis itself, for all who ask for one: with a progress bar, and failures as the command tells them."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

from jammkle_bringup.core.errors import GraphError, InputError
from jammkle_bringup.core.gap.experiments import experiments
from jammkle_bringup.core.gap.simulated import Simulated
from jammkle_bringup.core.signals import Interrupted
from jammkle_bringup.progress import progress_bar
from jammkle_sim.gap.ankle.parts import PartsSimulator, prepared_for_parts
from jammkle_sim.gap.ankle.simulator import AnkleSimulator
from jammkle_sim.gap.ankle.subsystems import subsystem_simulators
from jammkle_sim.gap.diagnosis import diagnose as diagnose_recordings
from jammkle_sim.gap.effect import BadEffectError
from jammkle_sim.gap.recording import BadRecordingError
from jammkle_sim.gap.runs import StoppedError
from jammkle_sim.gap.where import HORIZONS_S
from jammkle_sim.rigs.simulation import UnstableSimulationError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from jammkle_sim.gap.diagnosis import Diagnosis
    from jammkle_sim.gap.effect import Library
    from jammkle_sim.gap.recording import Recording
    from jammkle_sim.gap.simulator import Simulator

_SIMULATORS: Mapping[Simulated, Callable[[Library], Simulator]] = {
    Simulated.WHOLE: AnkleSimulator,
    Simulated.PARTS: PartsSimulator,
}


def simulator_of(simulated: Simulated, library: Library) -> Simulator:
    """Return the simulator of an ankle that is fed so, with effects of a library."""
    return _SIMULATORS[simulated](library)


def prepared_for(
    simulated: Simulated, recordings: Sequence[Recording], references: Sequence[Recording], library: Library
) -> tuple[Sequence[Recording], Sequence[Recording]]:
    """Return recordings and references as a diagnosis with such a simulator needs them.

    Raises:
        InputError: a recording or an effect cannot be used.
        GraphError: the simulator fails.

    """
    if simulated is Simulated.WHOLE:
        return recordings, references
    with failures_told():
        return prepared_for_parts(recordings, references, library)


def diagnosis_of(
    recordings: Sequence[Recording],
    references: Sequence[Recording],
    library: Library,
    simulator: Simulator,
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
                recordings,
                simulator,
                library,
                references=references,
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
