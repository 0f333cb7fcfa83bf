"""Many simulations at once: the same bytes as one after the other, trouble in one, and memory that does not grow."""

from __future__ import annotations

import dataclasses
import gc
import sys
from typing import TYPE_CHECKING

import pytest

from jammkle_sim.rigs.landing import LandingOptions, landing_parts, landing_simulation
from jammkle_sim.rigs.side_by_side import advance_together
from jammkle_sim.rigs.simulation import Simulation, UnstableSimulationError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

SEEDS = range(6)
SHORT = LandingOptions(release_time_s=0.0)
CALLS = 10_000
GROWTH_LIMIT_BLOCKS = CALLS // 20
"""A leak leaves a block of memory or more behind in every call, or in every few. Without one, 20 to 130 blocks more or
less are in use after so many calls, as Python's caches fill and empty."""


def landings() -> list[Simulation]:
    """Make landings of one model with different noise, and jam each a little differently."""
    rig = landing_parts(SHORT)
    made = [Simulation(dataclasses.replace(rig, sensors=dataclasses.replace(rig.sensors, seed=seed))) for seed in SEEDS]
    for seed, simulation in zip(SEEDS, made, strict=True):
        simulation.set_pump_duty(seed / len(SEEDS))
        simulation.set_solenoid("achilles", energised=True)
    return made


def bytes_of(simulation: Simulation) -> bytes:
    """All that a simulation can tell about the next 20 rows."""
    rows: NDArray[np.float64] = simulation.record(20, 2)
    return rows.tobytes()


@pytest.mark.parametrize("workers", [1, 3, None])
def test_together_is_the_same_as_one_after_the_other(workers: int | None) -> None:
    """Whatever the number of threads, each simulation ends with the same bytes, and they differ among themselves."""
    alone, together = landings(), landings()
    for simulation in alone:
        simulation.advance(600)
    advance_together(together, 600, workers)
    expected = [bytes_of(simulation) for simulation in alone]
    assert [bytes_of(simulation) for simulation in together] == expected
    assert len(set(expected)) == len(SEEDS)


def test_one_that_blows_up_stops_no_other() -> None:
    """The others are advanced all the same; the error counts and says what was simulated."""
    simulations = landings()
    simulations[2]._data.qvel[:] = 1e9
    with pytest.raises(UnstableSimulationError, match=r"1 of 6 simulations became unstable; the first: .*landing"):
        advance_together(simulations, 100)
    steps = [round(simulation.time_s / simulation.timestep_s) for simulation in simulations]
    assert steps == [100, 100, 0, 100, 100, 100]


def test_bad_input_is_named() -> None:
    """No workers, negative steps, one simulation twice."""
    simulations = landings()
    with pytest.raises(ValueError, match="workers is 0; it must be 1 or more"):
        advance_together(simulations, 1, 0)
    with pytest.raises(ValueError, match="steps is -1"):
        advance_together(simulations, -1)
    with pytest.raises(ValueError, match="twice"):
        advance_together([simulations[0], simulations[0]], 1)


def test_memory_does_not_grow() -> None:
    """Once Python's caches are filled, 20 simulated seconds as the sim node takes them leave nothing behind."""
    simulation = landing_simulation(SHORT)

    def live() -> int:
        for _ in range(CALLS):
            simulation.advance(4)
            simulation.imu()
            simulation.tendons()
            simulation.joint_positions()
            simulation.load_cell_force_n()
            simulation.channel_pressures_pa()
        gc.collect()
        return sys.getallocatedblocks()

    assert abs(live() - live()) < GROWTH_LIMIT_BLOCKS
