"""Within what time the board lets go, on its own clock: at the outputs of the core, or at the chip's port registers.

The board's clock is simulated time, so that these limits hold on a machine of any load.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from typing import TYPE_CHECKING

import pytest

from board_client import ACKNOWLEDGE, HOST_SILENT, LATCHED, PATIENT_MS, REGISTERS, RESET, SUPPLY_LOW, SUPPLY_PIN
from boards import AVR, build
from jammkle_driver.board.wiring import default_watchdog_s

if TYPE_CHECKING:
    from pathlib import Path

    from board_bench import BoardBench, Edge
    from board_client import Client

STEP_S = 0.001
"""A step of the board's clock, and the longest turn of its loop."""
EARLY_S = 2.0 * STEP_S
"""How much sooner a limit may seem reached: its time counts from the step before, and a pin follows a turn later."""
SUPPLY_LOW_S = 0.005
"""How long the supply must be low: SUPPLY_LOW_MS of firmware/core/board.h."""
SAGGED_UV = 2_000_000
"""8 V of 12 V at the divider of the supply."""
ROUND_S = 0.0085 if AVR else 0.0
"""Of the converter: 80 conversions of two turns of the loop each, at 8 MHz. A process reads its inputs at any time."""
REGISTERS_S = 10e-6
"""What lies between a reset and the next look at the port registers: eight instructions."""
HANG_S = 0.128
"""2^14 clocks of 128 kHz: the shortest that the chip's own watchdog is set to, WDTO_120MS (data sheet, table 11-2)."""
REQUIRED_HZ = 100.0


def jam(bench: BoardBench, client: Client, watchdog_ms: int) -> Edge:
    """Acknowledge, and jam everything by one write; return from when it was so at the pins."""
    began, refused = len(bench.edges), True
    while refused:  # a busy machine may be so slow that the board has latched its silence in between
        client.acknowledge()
        refused = bool(client.write(0, 7, 500, watchdog_ms))
    return wait_for(bench, began, on=True)


def wait_for(bench: BoardBench, began: int, *, on: bool) -> Edge:
    """Wait for the first of the edges from `began` on that energises all solenoids, or leaves nothing driven."""
    deadline_s = time.monotonic() + 10.0
    while True:
        for edge in bench.edges[began:]:
            if (edge.solenoids == 7) if on else (edge.solenoids == 0 and edge.duty == 0.0):
                return edge
        assert time.monotonic() < deadline_s, bench.edges[began:]
        time.sleep(0.001)


def off_after(bench: BoardBench, jammed: Edge) -> Edge:
    """Wait until nothing is driven after a jam."""
    return wait_for(bench, bench.edges.index(jammed) + 1, on=False)


def test_silence_is_waited_for_to_the_step(bench: BoardBench, client: Client) -> None:
    """From the last write that was taken to everything off: watchdog_ms and at most one turn of the loop."""
    for watchdog_ms in (50, 200, 1000):
        jammed = jam(bench, client, watchdog_ms)
        took_s = off_after(bench, jammed).board_s - jammed.board_s
        sys.stdout.write(f"watchdog of {watchdog_ms} ms: {took_s * 1e3:.3f} ms\n")
        assert watchdog_ms / 1e3 - EARLY_S <= took_s <= watchdog_ms / 1e3 + STEP_S
        assert client.latched() == HOST_SILENT


def test_a_supply_that_sags_is_seen_to_the_step(bench: BoardBench, client: Client) -> None:
    """From the voltage at the pin to everything off; it stays off when the supply is back."""
    jammed = jam(bench, client, PATIENT_MS)
    sagged_s = bench.put(SUPPLY_PIN, SAGGED_UV)
    took_s = off_after(bench, jammed).board_s - sagged_s
    sys.stdout.write(f"sagged supply: {took_s * 1e3:.3f} ms\n")
    assert SUPPLY_LOW_S - EARLY_S <= took_s <= SUPPLY_LOW_S + 2.0 * ROUND_S + STEP_S
    bench.override_uv.clear()
    time.sleep(0.05)
    assert client.latched() & SUPPLY_LOW
    assert client.write(0, 7, 500) == 4
    assert bench.released


@pytest.mark.parametrize(("cause", "bit"), [("power_on", 1), ("external", 2), ("brown_out", 4), ("watchdog", 8)])
def test_a_reset_lets_go_at_once_and_for_good(bench: BoardBench, client: Client, cause: str, bit: int) -> None:
    """Off at the registers with the reset, and through the start; the cause is latched; a jam must be acknowledged.

    The jam after that is watched over as the first one was.
    """
    assert REGISTERS.bits["reset_cause"][bit.bit_length() - 1] == cause
    jammed = jam(bench, client, PATIENT_MS)
    bench.tell(f"reset {bit} 20")
    off = off_after(bench, jammed)
    assert 0.0 <= off.board_s - bench.resets_s[-1] <= REGISTERS_S
    latched, *_, reset_cause = client.patient_inputs(LATCHED, 6)
    assert latched == RESET
    assert reset_cause == bit
    assert client.write(0, 7, 500) == 4
    assert bench.edges[-1] == off
    assert client.write(ACKNOWLEDGE, RESET) == 0
    assert client.write(0, 7, 500) == 0
    again = wait_for(bench, bench.edges.index(off) + 1, on=True)
    took_s = off_after(bench, again).board_s - again.board_s
    assert default_watchdog_s() - EARLY_S <= took_s <= default_watchdog_s() + STEP_S


@pytest.mark.skipif(not AVR, reason="a process has no chip that could hang")
def test_a_chip_that_hangs_is_reset_by_its_own_watchdog(bench: BoardBench, client: Client) -> None:
    """A program that has lost its way is off at the registers after the chip's own watchdog, which is latched."""
    jammed = jam(bench, client, PATIENT_MS)
    hung_s = bench.mark("hang")
    off = off_after(bench, jammed)
    sys.stdout.write(f"hung chip: {(off.board_s - hung_s) * 1e3:.3f} ms\n")
    assert off.board_s - hung_s <= HANG_S + STEP_S
    assert off.board_s - bench.resets_s[-1] <= REGISTERS_S
    latched, *_, reset_cause = client.patient_inputs(LATCHED, 6)
    assert latched & RESET
    assert REGISTERS.bits["reset_cause"][reset_cause.bit_length() - 1] == "watchdog"
    assert client.write(0, 7, 500) == 4


@pytest.mark.skipif(not AVR, reason="a process has no clocks to count; `make bench` measures its line")
@pytest.mark.parametrize(("image", "mhz"), [("board.elf", 16), ("board_8mhz.elf", 8)])
def test_all_outputs_and_sensors_go_over_the_line_a_hundred_times_a_second(
    tmp_path: Path, image: str, mhz: int
) -> None:
    """At 115200 baud, by the driver's requests: bytes in, the chip's work, bytes out, silence; counted in clocks."""
    build(tmp_path, "simavr", "avr")
    result = subprocess.run(
        [str(tmp_path / "pace"), str(tmp_path / image), str(mhz)], capture_output=True, text=True, check=True
    )
    replies = [tuple(map(int, words)) for words in map(str.split, result.stdout.splitlines()) if words[0].isdigit()]
    assert sorted(length for length, _ in replies) == [21] * 9 + [31]
    mean_s = statistics.mean(cycle_us for _, cycle_us in replies) * 1e-6
    sys.stdout.write(f"{mhz} MHz: {1.0 / mean_s:.1f} cycles a second\n")
    assert 1.0 / mean_s >= REQUIRED_HZ
