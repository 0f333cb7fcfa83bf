"""CPU share and memory of each node while one simulated ankle runs in real time, beside a bare IMU subscriber."""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import psutil

from echo import ECHO
from graph import Probe, Up, cpu_s, running
from jammkle_common.names import JAM_STATE

MEASURED_S = 10.0
PACKAGES = ("jammkle_driver", "jammkle_controller", "jammkle_sim")


@dataclass(frozen=True)
class Load:
    """One process at one IMU rate. `cpu_over_bare` is its CPU over that of a subscriber that only counts samples."""

    node: str
    imu_rate_hz: int
    cpu_percent_of_one_core: float
    cpu_over_bare: float
    memory_mib: float


def measure_load(domain_id: int, imu_rate_hz: int) -> list[Load]:
    """Bring up one ankle at this IMU rate and watch its processes for ten seconds."""
    with tempfile.TemporaryDirectory() as folder, running(domain_id, ECHO) as (echo,):
        parameters = Path(folder) / "rate.yaml"
        parameters.write_text(f"/**/sim:\n  ros__parameters:\n    imu_rate_hz: {imu_rate_hz}\n")
        up = Up(domain_id, Path(folder), "up", "--params", str(parameters))
        probe = Probe(domain_id)
        try:
            probe.listen(JAM_STATE)
            probe.wait_until_up()
            probe.close()
            processes = {package: up.child(package) for package in PACKAGES} | {"bare": psutil.Process(echo.pid)}
            before = {name: cpu_s(process) for name, process in processes.items()}
            begin_s = time.perf_counter()
            time.sleep(MEASURED_S)
            elapsed_s = time.perf_counter() - begin_s
            share = {name: (cpu_s(process) - before[name]) / elapsed_s for name, process in processes.items()}
            return [
                Load(
                    name.removeprefix("jammkle_"),
                    imu_rate_hz,
                    share[name] * 100.0,
                    share[name] / share["bare"],
                    process.memory_info().rss / 2**20,
                )
                for name, process in processes.items()
            ]
        finally:
            up.stop()
