"""`make bench`: measure, print a table, and write JSON. Compare ratios, not times: machines differ and are shared."""

from __future__ import annotations

import json
import os
import platform
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import typer
from in_step import InStep, measure_in_step
from rich.console import Console
from rich.table import Table
from start_up import StartUp, measure_start_up

from delay import Delays, measure_delays
from diagnosis import GapDiagnosis, measure_diagnosis
from domains import own_domain
from line import LineDelays, measure_line
from load import Load, measure_load
from memory import Memory, measure_memory
from safe_states import SafeState, measure_safe_states
from steps import StepRates, measure_steps
from watched import Watched, measure_watched

MOST_OVER_BARE = 1.5
"""Aim for delays on the line, over the sum of bare round trips in the same run."""
LEAST_CYCLE_RATE_HZ = 100.0
"""Aim for outputs and all sensors at 115200 baud."""
LONGEST_START_UP_S = 4.0
LEAST_FRAMES_PER_S = 30.0
LEAST_OF_FACTOR = 0.9
"""Aims for the graph's start, and for the page of a walking quadruped and what it leaves of the real-time factor."""
LEAST_IN_STEP, MOST_STEERING_CORE_S = 3.0, 0.6
"""Aims in lockstep: simulated seconds per second of the ankle, and core seconds a second of what steers four."""
IMU_RATES_HZ = (500, 1000)


@dataclass(frozen=True)
class Results:
    """Everything that one run has measured."""

    machine: str
    cores: int
    steps: StepRates
    memory: Memory
    start_up: StartUp
    delays: Delays
    line: LineDelays
    safe_states: list[SafeState]
    loads: list[Load]
    watched: Watched
    in_step: list[InStep]
    diagnosis: GapDiagnosis


def measure(console: Console) -> Results:
    """Run every benchmark, one after the other."""
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    # First, as memory that others have freed would hide a growth.
    with console.status("memory over ten simulated minutes"):
        memory = measure_memory()
    with console.status("simulation steps per second"):
        steps = measure_steps()
    with own_domain() as domain_id, console.status("until the graph is up"):
        start_up = measure_start_up(domain_id)
    with own_domain() as domain_id, console.status("from impact to solenoid"):
        delays = measure_delays(domain_id)
    with own_domain() as domain_id, console.status("from service and impact to the board's coils"):
        line = measure_line(domain_id)
    with console.status("from every mishap to a board that has let go"):
        safe_states = measure_safe_states()
    loads = []
    for rate_hz in IMU_RATES_HZ:
        with own_domain() as domain_id, console.status(f"load at {rate_hz} Hz"):
            loads += measure_load(domain_id, rate_hz)
    with console.status("a quadruped with and without a page"):
        watched = measure_watched()
    with console.status("graphs in step, and running freely"):
        in_step = measure_in_step()
    with console.status("diagnosing the gap of four recordings"):
        diagnosis = measure_diagnosis()
    return Results(
        platform.machine(),
        os.cpu_count() or 1,
        steps,
        memory,
        start_up,
        delays,
        line,
        safe_states,
        loads,
        watched,
        in_step,
        diagnosis,
    )


def table_of(results: Results) -> Table:
    """Lay the results out for people."""
    table = Table("what", "value", "beside it, in the same run", "ratio", title="Benchmark")
    steps, delays = results.steps, results.delays
    table.add_row(
        "simulation steps per second",
        f"{steps.full_steps_per_s:,.0f}",
        f"bare mj_step, in C {steps.bare_steps_per_s:,.0f}",
        f"{steps.ratio:.2f} ({steps.ratio_lowest:.2f} to {steps.ratio_highest:.2f}); "
        f"{steps.ratio_sample_by_sample:.2f} sample by sample",
    )
    memory = results.memory
    table.add_row(
        f"memory over {memory.simulated_minutes} simulated minutes",
        f"{memory.resident_growth_kib_per_minute:+.1f} KiB per minute",
        f"Python's own {memory.traced_growth_kib_per_minute:+.1f} KiB per minute",
        f"of {memory.resident_mib:.0f} MiB",
    )
    start_up = results.start_up
    table.add_row(
        f"`jammkle up` until it is up, {start_up.trials} times",
        f"median {start_up.up_s:.1f} s, longest {start_up.longest_s:.1f} s",
        f"loading the simulation alone {start_up.load_s:.1f} s",
        f"{start_up.ratio:.1f}",
    )
    table.add_row(
        f"impact to solenoid, {delays.trials} landings",
        f"median {delays.median_ms:.2f} ms, p99 {delays.p99_ms:.2f} ms",
        f"two bare relays {delays.relays_median_ms:.2f} ms, p99 {delays.relays_p99_ms:.2f} ms",
        f"{delays.ratio:.2f}",
    )
    _add_line(table, results.line)
    for state in results.safe_states:
        table.add_row(
            f"{state.event}: all off at the pins",
            f"median {1e3 * state.median_s:.0f} ms",
            f"longest of {state.rounds}: {1e3 * state.longest_s:.0f} ms, bound {1e3 * state.bound_s:.0f} ms",
            "" if state.longest_s <= state.bound_s else "over",
        )
    for load in results.loads:
        table.add_row(
            f"{load.node}, IMU at {load.imu_rate_hz} Hz",
            f"{load.cpu_percent_of_one_core:.0f} % of a core, {load.memory_mib:.0f} MiB",
            "a subscriber that only counts",
            f"{load.cpu_over_bare:.1f}",
        )
    page = results.watched
    table.add_row(
        "page of a walking quadruped: frames per second",
        f"{page.frames_per_s:.0f} (lowest {page.frames_per_s_lowest:.0f})",
        f"real-time factor {page.factor_watched:.2f}, without a page {page.factor_alone:.2f}; "
        f"load before {page.load_before:.1f}",
        f"{page.ratio:.2f} (lowest {page.ratio_lowest:.2f}); viewer {page.viewer_percent_of_one_core:.0f} % of a core",
    )
    for each in results.in_step:
        table.add_row(
            f"{each.robot}, simulated seconds per second at speed 0, in lockstep",
            f"{each.in_step:.2f}; {each.tick_ms:.2f} ms a tick, a bare relay {each.relay_ms:.2f} ms",
            f"running freely {each.free:.2f}",
            f"{each.ratio:.2f}",
        )
        table.add_row(
            f"{each.robot}, processor time of drivers and controllers per simulated second, in lockstep",
            f"{each.steering_core_s:.2f} s; sample to solenoid {each.sample_to_solenoid_ms:.0f} ms of simulated time",
            f"running freely {each.free_steering_core_s:.2f} s",
            f"{each.steering_core_s / each.free_steering_core_s:.2f}",
        )
    _add_diagnosis(table, results.diagnosis)
    return table


def _add_line(table: Table, line: LineDelays) -> None:
    """Lay out the delays on the line to the board."""
    graph, serial = line.graph, line.serial
    bare = (
        f"bare round trips: graph {graph.median_ms:.2f} ms, p99 {graph.p99_ms:.2f} ms; "
        f"line {serial.median_ms:.2f} ms, p99 {serial.p99_ms:.2f} ms"
    )
    for what, delay, ratio in (
        ("service call to coil bytes, 115200 baud", line.service, line.service_over_bare),
        ("impact to coil bytes, 115200 baud", line.impact, line.impact_over_bare),
    ):
        table.add_row(
            what,
            f"median {delay.median_ms:.2f} ms, p99 {delay.p99_ms:.2f} ms",
            bare,
            f"{ratio.median:.2f} of their sum, p99 {ratio.p99:.2f}",
        )
    lost = f"{line.impacts_lost} impacts never reached the pins" if line.impacts_lost else ""
    table.add_row("outputs and all sensors, 115200 baud", f"{line.cycle_rate_hz:.0f} cycles per second", "", lost)


def _add_diagnosis(table: Table, found: GapDiagnosis) -> None:
    """Lay out what a diagnosis of the gap costs."""
    table.add_row(
        f"gap diagnosis of four recordings, {found.recorded_s:.0f} s together",
        f"{found.wall_s:.0f} s, {found.warm_wall_s:.0f} s with signatures, {found.peak_mib:,.0f} MiB with workers",
        f"{found.runs:,} runs, {found.simulated_s:,.0f} simulated s, {found.warm_simulated_s:,.0f} with signatures; "
        f"load before {found.load_before:.1f}",
        f"{found.verdict}: {', '.join(found.effects) or 'nothing'}",
    )
    table.add_row(
        f"simulated seconds: scipy on {found.singles} singles and {found.pairs_weighed} pairs",
        f"{found.scipy_single_simulated_s:,.0f} s a single, {found.scipy_pair_simulated_s:,.0f} s a pair",
        f"from {found.scipy_sampled} of each; the diagnosis profiles pairs and fits {found.pairs_fitted}",
        f"{found.ratio_weighed:.1f} with all pairs; {found.ratio_fitted:.1f} with those fitted",
    )
    table.add_row(
        "gap diagnosis by length, four recordings of the pressure rig",
        ", ".join(f"{each.wall_s:.1f} s" for each in found.growth),
        ", ".join(f"{each.recorded_s:.0f} s recorded" for each in found.growth),
        f"length to the power of {found.exponent:.2f}",
    )


def missed_bounds(results: Results) -> list[str]:
    """Return what is over its bound or short of its aim, a phrase each."""
    line, page = results.line, results.watched
    ankle, quadruped = results.in_step
    ratios = {"service to coils": line.service_over_bare, "impact to coils": line.impact_over_bare}
    held = {
        **{
            f"{each.event}: all off in {each.bound_s:g} s": each.longest_s <= each.bound_s
            for each in results.safe_states
        },
        **{
            f"{name}: {MOST_OVER_BARE:g} times the bare round trips": max(ratio.median, ratio.p99) <= MOST_OVER_BARE
            for name, ratio in ratios.items()
        },
        f"{LEAST_CYCLE_RATE_HZ:g} cycles a second on the line": line.cycle_rate_hz >= LEAST_CYCLE_RATE_HZ,
        "every impact at the pins": line.impacts_lost == 0,
        f"`jammkle up` in {LONGEST_START_UP_S:g} s": results.start_up.up_s <= LONGEST_START_UP_S,
        f"{LEAST_FRAMES_PER_S:g} frames a second": page.frames_per_s >= LEAST_FRAMES_PER_S,
        f"{LEAST_OF_FACTOR:g} of the real-time factor beside the page": page.ratio >= LEAST_OF_FACTOR,
        f"{LEAST_IN_STEP:g} simulated seconds per second of the ankle in lockstep": ankle.in_step >= LEAST_IN_STEP,
        "the quadruped in lockstep no slower than running freely": quadruped.ratio >= 1.0,
        f"{MOST_STEERING_CORE_S:g} core seconds a second for four": quadruped.steering_core_s <= MOST_STEERING_CORE_S,
    }
    return [aim for aim, kept in held.items() if not kept]


def main(
    json_file: Annotated[Path, typer.Option("--json", help="Where to write the results.")] = Path("bench.json"),
) -> None:
    """Measure and report; exit with 1 where a bound or an aim is missed."""
    console = Console()
    results = measure(console)
    json_file.write_text(json.dumps(asdict(results), indent=2) + "\n")
    console.print(table_of(results))
    console.print(f"written to {json_file}")
    missed = missed_bounds(results)
    if missed:
        console.print(f"missed: {'; '.join(missed)}")
        raise typer.Exit(1)


if __name__ == "__main__":
    typer.run(main)
