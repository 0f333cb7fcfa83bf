"""`make live`: four ankles of a quadruped at 500 Hz, then ten minutes of landings at 1 kHz through the live graph."""

from __future__ import annotations

import json
import math
import os
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import psutil
import typer

from delay import measure_delays
from domains import own_domain
from graph import Probe, Up, cpu_s
from watched import ROBOT, real_time_factor

IMU_RATE_HZ = 1000
SETTLE_S = 4.0


@dataclass(frozen=True)
class FourAnkles:
    """A walking quadruped: simulation, four drivers and four controllers, each IMU at 500 Hz."""

    real_time_factor: float
    cores: float
    """Processor time of all processes over the time that went by."""
    load_before: float


def measure_four_ankles() -> FourAnkles:
    """Run a quadruped in real time and watch its processes."""
    load_before = psutil.getloadavg()[0]
    with own_domain() as domain_id, tempfile.TemporaryDirectory() as folder:
        up = Up(domain_id, Path(folder), *ROBOT)
        probe = Probe(domain_id)
        try:
            probe.spin_until(lambda: "jammkle: up\n" in up.text(), "the graph is up")
            time.sleep(SETTLE_S)
            processes = up.children()
            before_s, begin_s = sum(map(cpu_s, processes)), time.monotonic()
            factor = real_time_factor(probe, time.sleep)
            cores = (sum(map(cpu_s, processes)) - before_s) / (time.monotonic() - begin_s)
            return FourAnkles(factor, cores, load_before)
        finally:
            probe.close()
            up.stop()


def main(
    minutes: Annotated[float, typer.Option(help="How long landings go on.")] = 10.0,
    json_file: Annotated[Path, typer.Option("--json", help="Where to write the results.")] = Path("live.json"),
) -> None:
    """Measure and report."""
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    four = measure_four_ankles()
    with own_domain() as domain_id:
        found = measure_delays(domain_id, imu_rate_hz=IMU_RATE_HZ, landings=math.inf, most_s=60.0 * minutes)
    json_file.write_text(json.dumps({"delays": asdict(found), "four_ankles": asdict(four)}, indent=2) + "\n")
    typer.echo(
        f"four ankles: {four.cores:.2f} cores at a real-time factor of {four.real_time_factor:.2f}; "
        f"load before {four.load_before:.1f}\n"
        f"IMU at {found.imu_rate_hz:.0f} Hz for {minutes:g} min: {found.landings} landings, {found.liftoffs_reported} "
        f"lift-offs and {found.impacts_reported} impacts reported, {found.trials} reached the solenoid\n"
        f"sample to solenoid: median {found.median_ms:.2f} ms, p99 {found.p99_ms:.2f} ms; two bare relays: "
        f"{found.relays_median_ms:.2f} ms, p99 {found.relays_p99_ms:.2f} ms; one and back: "
        f"{found.round_trip_median_ms:.2f} ms, p99 {found.round_trip_p99_ms:.2f} ms; "
        f"load before {found.load_before:.1f}"
    )


if __name__ == "__main__":
    typer.run(main)
