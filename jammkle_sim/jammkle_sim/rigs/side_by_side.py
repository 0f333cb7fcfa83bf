"""Many simulations at once, on all cores of one process."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

from jammkle_sim.rigs.simulation import UnstableSimulationError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_sim.rigs.simulation import Simulation


def advance_together(simulations: Sequence[Simulation], steps: int, workers: int | None = None) -> None:
    """Advance every simulation by the same number of steps, in threads.

    The compiled steps run without Python's global lock, so that threads share the cores. Simulations share nothing
    that changes, hence each ends with the same bytes as if they had been advanced one after the other.

    Args:
        simulations: Different ones; they may have been made from the same rig.
        steps: Time steps, 0 or more.
        workers: Threads, 1 or more; None takes as many as this process may use cores.

    Raises:
        ValueError: a number out of range, or the same simulation twice.
        UnstableSimulationError: some became unstable, the others were advanced all the same; the message counts them
            and is that of the first.

    """
    if workers is not None and workers < 1:
        msg = f"workers is {workers}; it must be 1 or more, or None for all cores"
        raise ValueError(msg)
    if len({id(simulation) for simulation in simulations}) != len(simulations):
        msg = "simulations names one of them twice; each must be another"
        raise ValueError(msg)
    with ThreadPoolExecutor(workers or len(os.sched_getaffinity(0))) as pool:
        pending = [pool.submit(simulation.advance, steps) for simulation in simulations]
        errors = [each.exception() for each in pending]
    unstable = [error for error in errors if isinstance(error, UnstableSimulationError)]
    for error in errors:
        if error is not None and not isinstance(error, UnstableSimulationError):
            raise error
    if unstable:
        msg = f"{len(unstable)} of {len(simulations)} simulations became unstable; the first: {unstable[0]}"
        raise UnstableSimulationError(msg) from unstable[0]
