"""256 rigs side by side on all cores, beside MuJoCo's own rollout of the same model with its motors untouched."""

from __future__ import annotations

import dataclasses
import os
import statistics
import time
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import rollout

from jammkle_sim.rigs.landing import LandingOptions, landing_parts
from jammkle_sim.rigs.side_by_side import advance_together
from jammkle_sim.rigs.simulation import Simulation

RIGS = 256
STEPS = 800
"""Per rig and round: fall, impact and rest, 0.4 s."""
ROUNDS = 5


@dataclass(frozen=True)
class SideBySide:
    """Steps per second of all rigs together, both ways, and their ratio as the median over rounds taken in turn."""

    rigs: int
    workers: int
    full_steps_per_s: float
    bare_steps_per_s: float
    ratio: float
    ratio_lowest: float
    ratio_highest: float


def measure_side_by_side() -> SideBySide:
    """Time the same landings both ways, in turn, with the same number of threads.

    The bare run is `mujoco.rollout`: threads in C that never return to Python, as fast as threads of `mj_step`. It
    writes the states that it went through, as it always does, into memory that stands ready; ours draws the IMU's
    noise.
    """
    workers = len(os.sched_getaffinity(0))
    rig = landing_parts(LandingOptions(release_time_s=0.0))
    simulations = [
        Simulation(dataclasses.replace(rig, sensors=dataclasses.replace(rig.sensors, seed=seed)))
        for seed in range(RIGS)
    ]
    model = rig.spec.compile()
    model.opt.disableflags = rig.model.opt.disableflags
    model.eq_active0[:] = False  # lets the carriage go, as the rig does
    start = mujoco.MjData(model)
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, start, state, kind)
    states = np.tile(state, (RIGS, 1))
    states_out, sensors_out = np.empty((RIGS, STEPS, len(state))), np.empty((RIGS, STEPS, model.nsensordata))
    data = [mujoco.MjData(model) for _ in range(workers)]
    full, bare = [], []
    with rollout.Rollout(nthread=workers) as pool:
        pool.rollout(model, data, states, nstep=STEPS, state=states_out, sensordata=sensors_out)
        advance_together(simulations, 10, workers)  # compiles
        for _ in range(ROUNDS):
            for simulation in simulations:
                simulation.reset()
                simulation.set_pump_duty(1.0)
                simulation.set_solenoid("achilles", energised=True)
            begin_s = time.perf_counter()
            advance_together(simulations, STEPS, workers)
            full.append(RIGS * STEPS / (time.perf_counter() - begin_s))
            begin_s = time.perf_counter()
            pool.rollout(model, data, states, nstep=STEPS, state=states_out, sensordata=sensors_out)
            bare.append(RIGS * STEPS / (time.perf_counter() - begin_s))
    ratios = [one / other for one, other in zip(full, bare, strict=True)]
    return SideBySide(
        RIGS,
        workers,
        statistics.median(full),
        statistics.median(bare),
        statistics.median(ratios),
        min(ratios),
        max(ratios),
    )
