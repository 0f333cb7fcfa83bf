"""A board for the tests: the firmware as this machine's process, or the AVR image in simavr, with a plant behind it."""

from __future__ import annotations

import os
import subprocess
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from jammkle_common.names import CHANNELS
from jammkle_driver.board.link import BoardLink
from jammkle_driver.board.wiring import load_wiring
from jammkle_driver.core.hardware import ActuatorCommand, LinkState, released

if TYPE_CHECKING:
    from collections.abc import Callable

    from board_bench import BoardBench
    from jammkle_driver.board.protocol import Exchange
    from jammkle_driver.board.wiring import Wiring

FIRMWARE = Path(__file__).parents[1] / "jammkle_driver" / "firmware"
AVR = os.environ.get("JAMMKLE_BOARD") == "avr"
"""Whether the tests run with the AVR image in simavr, as `make firmware` has them."""

JAMMED = ActuatorCommand(dict.fromkeys(CHANNELS, True), 0.5)
RELEASED = released(CHANNELS)
TICK_S = 0.05
TIMEOUT_S = 20.0


def build(folder: Path, *targets: str) -> None:
    """Build parts of the firmware into a folder."""
    subprocess.run(["make", "-s", "-C", str(FIRMWARE), f"BUILD={folder}", *targets], check=True)  # noqa: S607 - as set-up does


def board_command(folder: Path) -> list[str]:
    """Build the board and return the command that runs it."""
    build(folder, "simavr" if AVR else "host")
    if AVR:
        return [str(folder / "board_simavr"), "-i", str(folder / "board_8mhz.elf")]
    return [str(folder / "board")]


def wiring() -> Wiring:
    """Return the shipped wiring; with more patience for a simulator that may run slower than real time.

    Not for tests of what is lost when: there the patience is part of it.
    """
    standard = load_wiring(None)
    return replace(standard, reply_timeout_s=0.15) if AVR else standard


class Host:
    """The driver's link to a board, with a driver that ticks as the node does."""

    def __init__(
        self,
        port: Path | str,
        *,
        safe_state: str = "vent",
        wired: Wiring | None = None,
        on_exchange: Callable[[Exchange], None] | None = None,
    ) -> None:
        self.exchanges: list[Exchange] = []
        self.link = BoardLink(str(port), wired or load_wiring(None), safe_state, on_exchange or self.exchanges.append)

    def tick_until(
        self, holds: Callable[[], bool], command: ActuatorCommand = RELEASED, timeout_s: float = TIMEOUT_S
    ) -> None:
        """Apply a command several times a second until something holds."""
        deadline_s = time.monotonic() + timeout_s
        while not holds():
            assert time.monotonic() < deadline_s, f"never held; {self.link.status}"
            self.link.apply(command)
            time.sleep(TICK_S / 5)

    def ready(self) -> None:
        """Wait for the board, and acknowledge what it has latched."""
        self.tick_until(lambda: self.link.status.state is LinkState.CONNECTED and bool(self.exchanges))

        def acknowledged() -> bool:
            if self.link.status.latched:
                self.link.acknowledge()
            return not self.link.status.latched

        self.tick_until(acknowledged)

    def jam(self, bench: BoardBench) -> None:
        """Get ready and energise everything, until it is so at the pins."""
        self.ready()
        self.tick_until(lambda: bool(bench.edges) and bench.edges[-1].solenoids == 7, JAMMED)
