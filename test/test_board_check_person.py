"""`jammkle hardware check` with somebody at the terminal: who types nonsense, presses Ctrl-C, or goes away."""

from __future__ import annotations

import dataclasses
import re
import signal
from typing import TYPE_CHECKING

import pytest

from board_bench import BoardBench, BoardPlant
from board_client import HOST_SILENT, Client
from boards import AVR
from graph import COMMAND
from jammkle_driver.board.wiring import load_wiring
from jammkle_sim.physics.pneumatics import PneumaticParameters
from terminal import CTRL_C, Terminal
from test_board_check import OTHER_FIRMWARE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

pytestmark = pytest.mark.skipif(AVR, reason="a person waits for a simulator that is slower than real time; said once")

EVERYTHING = 0b111
INTERRUPTED = 130
WEAK = dataclasses.replace(PneumaticParameters(), pump_free_flow_l_min=0.05)
"""A pump that never comes to what the check waits for, and so runs for long."""
AIR, GAUGE = "as a barometer reads it", "that a gauge at the manifold reads"
RELEASED = "jammkle: interrupted: pump and valves are released"


@pytest.fixture
def check(command: list[str], tmp_path: Path) -> Iterator[Callable[..., tuple[BoardBench, Terminal]]]:
    """Walk on a terminal; the board is taken for a bought one, whose watchdog has 5 s: only the command releases."""
    benches: list[BoardBench] = []
    terminals: list[Terminal] = []
    (tmp_path / "bought.yaml").write_text(OTHER_FIRMWARE)

    def start(parameters: PneumaticParameters, *options: str) -> tuple[BoardBench, Terminal]:
        benches.append(BoardBench(command, tmp_path / "board", BoardPlant(parameters)))
        arguments = ["--port", str(tmp_path / "board"), "--board-file", str(tmp_path / "bought.yaml"), *options]
        terminals.append(Terminal([str(COMMAND), "hardware", "check", *arguments]))
        return benches[-1], terminals[-1]

    yield start
    for each in (*terminals, *benches):
        each.__exit__(None, None, None)


def pump_runs(bench: BoardBench) -> bool:
    return bool(bench.edges) and bench.edges[-1].duty > 0.0


def assert_released_by_the_command(bench: BoardBench, terminal: Terminal, port: Path) -> None:
    """Every output is off at the end, and the board has not let go by itself: its watchdog would have latched it."""
    terminal.wait_until(lambda: bench.released)
    client = Client(port)
    assert not client.latched() & HOST_SILENT
    client.modbus.close()


ENDS = {
    "Ctrl-C": lambda terminal: terminal.type(CTRL_C),
    "SIGTERM": lambda terminal: terminal.process.send_signal(signal.SIGTERM),
    "SIGHUP": lambda terminal: terminal.process.send_signal(signal.SIGHUP),
}


@pytest.mark.parametrize("end", ENDS)
def test_a_signal_while_the_pump_runs_releases_everything(
    check: Callable[..., tuple[BoardBench, Terminal]], tmp_path: Path, end: str
) -> None:
    """Off at the pins by the command's own word, one line, 130; a second signal does not break that off."""
    bench, terminal = check(WEAK, "--yes")
    terminal.wait_until(lambda: pump_runs(bench))
    ENDS[end](terminal)
    ENDS[end](terminal)
    assert terminal.ended() == INTERRUPTED
    assert_released_by_the_command(bench, terminal, tmp_path / "board")
    assert terminal.text.splitlines()[-1].endswith(RELEASED)
    assert "Traceback" not in terminal.text


def test_a_signal_at_a_question_releases_everything(
    check: Callable[..., tuple[BoardBench, Terminal]], tmp_path: Path
) -> None:
    """Somebody who is asked for a gauge's reading, with every valve energised, need not answer first."""
    bench, terminal = check(PneumaticParameters())
    terminal.wait_for("Go on?")
    terminal.type("y\n")
    terminal.wait_for(AIR)
    terminal.type("101.325\n")
    terminal.wait_for(GAUGE)
    assert bench.edges[-1].solenoids == EVERYTHING
    terminal.type(CTRL_C)
    assert terminal.ended() == INTERRUPTED
    assert_released_by_the_command(bench, terminal, tmp_path / "board")
    assert terminal.text.splitlines()[-1] == RELEASED


def test_a_terminal_that_is_closed_leaves_nothing_on(
    check: Callable[..., tuple[BoardBench, Terminal]], tmp_path: Path
) -> None:
    """Whatever cannot be said any more: the pump stops."""
    bench, terminal = check(WEAK, "--yes")
    terminal.wait_until(lambda: pump_runs(bench))
    terminal.hang_up()
    terminal.process.wait()
    assert_released_by_the_command(bench, terminal, tmp_path / "board")


def test_who_says_no_runs_nothing(check: Callable[..., tuple[BoardBench, Terminal]]) -> None:
    """What is neither yes nor no is asked again; after no, no output was ever on."""
    bench, terminal = check(WEAK)
    terminal.wait_for("Go on?")
    terminal.type("perhaps\n")
    terminal.wait_for("Go on?", times=2)
    assert "'perhaps' is neither y nor n" in terminal.text
    terminal.type("n\n")
    assert terminal.ended() == INTERRUPTED
    assert terminal.text.splitlines()[-1].endswith("jammkle: interrupted")
    assert not any(edge.solenoids or edge.duty for edge in bench.edges)


def test_a_person_with_barometer_and_gauge_calibrates(
    check: Callable[..., tuple[BoardBench, Terminal]], tmp_path: Path
) -> None:
    """Words, hPa for kPa and a vacuum beyond all air are asked again, in one line each; the right numbers calibrate."""
    bench, terminal = check(PneumaticParameters())
    terminal.wait_for("Go on?")
    terminal.type("\n")
    terminal.wait_for(AIR)
    for times, (wrong, said) in enumerate(
        {"high": "'high' is not a number", "nan": "'nan' is not a number", "1013": "1013 cannot be: 50 to 110"}.items(),
        start=2,
    ):
        terminal.type(f"{wrong}\n")
        terminal.wait_for(AIR, times)
        assert said in terminal.text
    terminal.type("101,325\n")
    terminal.wait_for(GAUGE)
    terminal.type("500\n")
    terminal.wait_for(GAUGE, times=2)
    assert "500 cannot be: -101.325 to 101.325" in terminal.text
    terminal.type(f"{101.325 - bench.plant.pressures_pa['manifold'] / 1e3:.3f}\n")
    terminal.ended()
    assert re.search(r"ok {3}calibration: two points, written to", terminal.text)
    made = load_wiring(tmp_path / "bought.calibrated.yaml").sensors["achilles"]
    share = 0.009 * 101.325 - 0.095  # of the sensor's supply, at this pressure
    assert made.pascals(round(16368 * share)) == pytest.approx(101325.0, abs=400.0)
    assert bench.released
