"""Simulation steps per second, beside bare `mj_step` of the same model with its motors untouched."""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass

import mujoco

from jammkle_sim.rigs.landing import LandingOptions, landing_built
from jammkle_sim.rigs.simulation import Simulation

ROUNDS = 15
SIMULATED_S = 2.0
STEPS_PER_SAMPLE = 4
"""Steps between two IMU samples at 500 Hz: how far the sim node advances at a time."""


@dataclass(frozen=True)
class StepRates:
    """Steps per second of both, and their ratio as the median over rounds taken in turn."""

    full_steps_per_s: float
    bare_steps_per_s: float
    ratio: float
    ratio_lowest: float
    ratio_highest: float
    ratio_sample_by_sample: float
    """As the sim node runs: returning to Python after each IMU sample."""


def measure_steps() -> StepRates:
    """Time one landing (fall, impact, rest) in all ways, in turn, so that a busy machine hits them alike.

    The bare run is `mj_step` with `nstep`: a loop in C that never returns to Python, the fastest there is.
    """
    simulation = Simulation(landing_built(LandingOptions(release_time_s=0.0)))
    simulation.ankle.set_pump_duty(1.0)
    simulation.ankle.set_solenoid("achilles", energised=True)
    steps = round(SIMULATED_S / simulation.timestep_s)
    model = simulation.model
    data = mujoco.MjData(model)
    simulation.advance(10)  # compiles

    def whole() -> None:
        simulation.advance(steps)

    def by_sample() -> None:
        for _ in range(steps // STEPS_PER_SAMPLE):
            simulation.advance(STEPS_PER_SAMPLE)

    full, sampled, bare = [], [], []
    for _ in range(ROUNDS):
        for run, rates in ((whole, full), (by_sample, sampled)):
            simulation.reset()
            begin_s = time.perf_counter()
            run()
            rates.append(steps / (time.perf_counter() - begin_s))
        mujoco.mj_resetData(model, data)
        data.eq_active[:] = False  # lets the carriage go, as the rig does
        begin_s = time.perf_counter()
        mujoco.mj_step(model, data, nstep=steps)
        bare.append(steps / (time.perf_counter() - begin_s))
    ratios = [one / other for one, other in zip(full, bare, strict=True)]
    sampled_ratios = [one / other for one, other in zip(sampled, bare, strict=True)]
    return StepRates(
        statistics.median(full),
        statistics.median(bare),
        statistics.median(ratios),
        min(ratios),
        max(ratios),
        statistics.median(sampled_ratios),
    )
