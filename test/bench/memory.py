"""Memory over ten simulated minutes of one ankle that is dropped, jammed and reset again and again."""

from __future__ import annotations

import gc
import tracemalloc
from dataclasses import dataclass

import psutil

from jammkle_sim.rigs.landing import LandingOptions, landing_built
from jammkle_sim.rigs.simulation import Simulation

MINUTES = 10
STEPS_PER_SAMPLE = 4
"""Steps between two IMU samples at 500 Hz: how far the sim node advances at a time."""
RESET_S = 5.0
_KIB = 1024.0


@dataclass(frozen=True)
class Memory:
    """Growth per simulated minute, KiB: of the process, and of what Python itself has allocated."""

    simulated_minutes: int
    resident_growth_kib_per_minute: float
    traced_growth_kib_per_minute: float
    resident_mib: float


def measure_memory() -> Memory:
    """Simulate a minute to warm up and ten to measure, reading every sensor as the sim node does."""
    simulation = Simulation(landing_built(LandingOptions()))
    process = psutil.Process()

    def minutes(number: int) -> None:
        samples = round(RESET_S / (STEPS_PER_SAMPLE * simulation.timestep_s))
        for _ in range(round(number * 60.0 / RESET_S)):
            simulation.reset()
            simulation.ankle.set_pump_duty(1.0)
            simulation.ankle.set_solenoid("achilles", energised=True)
            for _ in range(samples):
                simulation.advance(STEPS_PER_SAMPLE)
                simulation.ankle.imu()
                simulation.ankle.joint_positions()
                simulation.ankle.joint_velocities()
                simulation.ankle.tendons()
                simulation.ankle.load_cell_force_n()

    def grown(number: int) -> float:
        gc.collect()
        before = process.memory_info().rss
        minutes(number)
        gc.collect()
        return float(process.memory_info().rss - before)

    minutes(1)
    resident = grown(MINUTES)
    tracemalloc.start()
    minutes(1)
    gc.collect()
    before, _ = tracemalloc.get_traced_memory()
    minutes(1)
    gc.collect()
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return Memory(MINUTES, resident / _KIB / MINUTES, (after - before) / _KIB, process.memory_info().rss / _KIB**2)
