"""`make soak`, its busy part: demos, graph tests and the whole suite beside four busy loops of plain Python.

    PYTHONPATH=test python -m studies.faults.busy --demos 20 --graph-tests 10 --suite

Every demo of one seed must end with 0 and with the same verdict; every test must pass.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from domains import own_domain

if TYPE_CHECKING:
    from collections.abc import Iterator

LOOPS = 4
SEED = 7
COMMAND = Path(sys.executable).with_name("jammkle")
GRAPH_TESTS = (
    "test/test_graph_life.py",
    "test/test_graph_requests.py",
    "test/test_graph_wiring.py",
    "test/test_graph_deaths.py",
    "test/test_landing.py",
    "test/test_lockstep.py",
    "test/test_robot_graph.py",
    "test/test_one_clock.py",
    "test/test_composed.py",
)


@contextmanager
def busy_loops(count: int = LOOPS) -> Iterator[None]:
    """Keep the machine busy while the block runs."""
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for each in loops:
            each.kill()
            each.wait()


def demo(folder: Path, domain_id: int) -> tuple[int, dict[str, Any], str]:
    """Run the demo once; return its exit code, its results and what it said."""
    results = folder / "demo.json"
    arguments = [str(COMMAND), "demo", "--seed", str(SEED), "-o", str(folder / "runs"), "--json", str(results)]
    environment = {"ROS_DOMAIN_ID": str(domain_id), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    done = subprocess.run(arguments, env={**os.environ, **environment}, capture_output=True, text=True, check=False)  # noqa: S603 - our own command
    return done.returncode, json.loads(results.read_text()) if results.exists() else {}, done.stdout + done.stderr


def run_demos(count: int) -> bool:
    """Run demos; return whether all of them ended well, and agree."""
    verdicts, well = set(), True
    for number in range(count):
        with tempfile.TemporaryDirectory() as folder, own_domain() as domain_id:
            begun_s = time.monotonic()
            code, results, said = demo(Path(folder), domain_id)
            diagnosis = results.get("diagnosis", {})
            verdict = json.dumps(
                {key: diagnosis.get(key) for key in ("verdict", "set", "effects", "gap")}, sort_keys=True
            )
            verdicts.add(verdict)
            well = well and code == 0
            typer.echo(f"demo {number + 1}: exit code {code} after {time.monotonic() - begun_s:.0f} s, {verdict[:100]}")
            if code != 0:
                typer.echo(said)
    typer.echo(f"{count} demos, {len(verdicts)} different verdicts")
    return well and len(verdicts) <= 1


def run_tests(paths: tuple[str, ...], times: int) -> bool:
    """Run tests again and again; return whether all of them passed."""
    command = [sys.executable, "-m", "pytest", "-q", "-n", "2", "--dist", "loadfile", "--no-loadscope-reorder", *paths]
    return all(subprocess.run(command, check=False).returncode == 0 for _ in range(times))  # noqa: S603 - our tests


def main(
    demos: Annotated[int, typer.Option(help="How often the demo is run.")] = 20,
    graph_tests: Annotated[int, typer.Option(help="How often the tests of the whole graph are run.")] = 10,
    suite: Annotated[bool, typer.Option("--suite", help="Run the whole suite once, too.")] = False,  # noqa: FBT002
) -> None:
    """Run all of it; exit with 1 if anything failed."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # else the loops would go on for ever
    with busy_loops():
        well = run_demos(demos)
        well = run_tests(GRAPH_TESTS, graph_tests) and well
        if suite:
            well = run_tests((), 1) and well
    raise typer.Exit(0 if well else 1)


if __name__ == "__main__":
    typer.run(main)
