"""How long `jammkle up` takes until it is up, beside what loading its slowest node takes by itself."""

from __future__ import annotations

import signal
import statistics
import subprocess
import sys
import time
from dataclasses import dataclass

from graph import COMMAND, environment

TRIALS = 5
LOAD = "import jammkle_sim.kinds, jammkle_sim.node"
UP = "jammkle: up"


@dataclass(frozen=True)
class StartUp:
    """Medians over the trials, s. The time until it is up has a look of a second for other graphs in it."""

    trials: int
    up_s: float
    longest_s: float
    load_s: float
    ratio: float
    """Until it is up, over loading the simulation alone, each in the same trial: the median."""


def measure_start_up(domain_id: int) -> StartUp:
    """Start the graph and end it, and load its simulation alone, in turn; the first of each fills the caches."""
    _up_s(domain_id)
    _load_s()
    pairs = [(_up_s(domain_id), _load_s()) for _ in range(TRIALS)]
    return StartUp(
        trials=TRIALS,
        up_s=statistics.median(up_s for up_s, _ in pairs),
        longest_s=max(up_s for up_s, _ in pairs),
        load_s=statistics.median(load_s for _, load_s in pairs),
        ratio=statistics.median(up_s / load_s for up_s, load_s in pairs),
    )


def _up_s(domain_id: int) -> float:
    start_s = time.monotonic()
    with subprocess.Popen([COMMAND, "up"], stderr=subprocess.PIPE, text=True, env=environment(domain_id)) as process:
        if process.stderr is None or not any(line.startswith(UP) for line in process.stderr):
            msg = "jammkle up ended before it was up"
            raise RuntimeError(msg)
        taken_s = time.monotonic() - start_s
        process.send_signal(signal.SIGINT)
        process.stderr.read()
    return taken_s


def _load_s() -> float:
    start_s = time.monotonic()
    subprocess.run([sys.executable, "-c", LOAD], check=True)
    return time.monotonic() - start_s
