"""Simulation steps per second, beside bare `mj_step` of the same model with its motors untouched."""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass

import mujoco

from jammkle_sim.rigs.landing import LandingOptions, landing_simulation

ROUNDS = 9
SIMULATED_S = 2.0
RELEASE_S = 0.2


@dataclass(frozen=True)
class StepRates:
    """Steps per second of both, and their ratio as the median over rounds taken in turn."""

    full_steps_per_s: float
    bare_steps_per_s: float
    ratio: float
    ratio_lowest: float
    ratio_highest: float


def measure_steps() -> StepRates:
    """Time one landing (fall, impact, rest) in both ways, in turn, so that a busy machine hits both alike."""
    simulation = landing_simulation(LandingOptions(release_time_s=RELEASE_S))
    simulation.set_pump_duty(1.0)
    simulation.set_solenoid("achilles", energised=True)
    steps = round(SIMULATED_S / simulation.timestep_s)
    model = simulation.model
    data = mujoco.MjData(model)
    start = (simulation.data.qpos.copy(), simulation.data.qvel.copy())
    simulation.advance(10)  # compiles

    full, bare = [], []
    for _ in range(ROUNDS):
        simulation.reset()
        begin_s = time.perf_counter()
        simulation.advance(steps)
        full.append(steps / (time.perf_counter() - begin_s))

        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = start
        begin_s = time.perf_counter()
        for _ in range(steps):
            mujoco.mj_step(model, data)
        bare.append(steps / (time.perf_counter() - begin_s))
    ratios = [one / other for one, other in zip(full, bare, strict=True)]
    return StepRates(
        statistics.median(full), statistics.median(bare), statistics.median(ratios), min(ratios), max(ratios)
    )
