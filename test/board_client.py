"""A Modbus client that asks a board on a bench what the tests want to know, and waits for what its pins do."""

from __future__ import annotations

import contextlib
import time
from typing import TYPE_CHECKING

from pymodbus.client import ModbusSerialClient
from pymodbus.exceptions import ModbusIOException

from jammkle_driver.board.wiring import register_list

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from board_bench import BoardBench

REGISTERS = register_list()
LATCHED = REGISTERS.input("latched").address
ACKNOWLEDGE = REGISTERS.holding("acknowledge").address
WATCHDOG = REGISTERS.holding("watchdog_ms").address
STORE = REGISTERS.holding("store").address
SAFE_STATE = REGISTERS.holding("safe_state").address
FIRST_SENSOR = REGISTERS.holding("sensor_1_raw_low").address
HOST_SILENT, SUPPLY_LOW, RESET = 1, 2, 4
SUPPLY_PIN = 4
PATIENT_MS = 5000
"""The longest watchdog: what is off before it was off for another reason."""


class Client:
    """A Modbus client of pymodbus, with a word for what these tests do again and again."""

    def __init__(self, port: Path) -> None:
        self.modbus = ModbusSerialClient(str(port), baudrate=115200, timeout=0.5, retries=0)
        assert self.modbus.connect()

    def inputs(self, first: int, count: int = 1) -> Sequence[int]:
        return list(self.modbus.read_input_registers(first, count=count).registers)

    def patient_inputs(self, first: int, count: int) -> Sequence[int]:
        """Read input registers of a board that is just starting."""
        deadline_s = time.monotonic() + 10.0
        while time.monotonic() < deadline_s:
            with contextlib.suppress(ModbusIOException):
                return self.inputs(first, count)
        raise TimeoutError

    def latched(self) -> int:
        return self.inputs(LATCHED)[0]

    def write(self, first: int, *numbers: int) -> int:
        """Write registers; return the exception code, 0 for none."""
        reply = self.modbus.write_registers(first, list(numbers))
        return int(reply.exception_code) if reply.isError() else 0

    def acknowledge(self) -> None:
        while (latched := self.latched()) != 0:
            self.write(ACKNOWLEDGE, latched)

    def patient(self) -> None:
        """Make the watchdog wait for a test that types slowly."""
        assert self.write(WATCHDOG, PATIENT_MS) == 0
        self.acknowledge()


def wait_for_pins(bench: BoardBench, solenoids: int) -> float:
    """Wait until the solenoids are so at the pins; return when they became so, s."""
    deadline_s = time.monotonic() + 10.0
    while not bench.edges or bench.edges[-1].solenoids != solenoids:
        assert time.monotonic() < deadline_s, bench.edges
        time.sleep(0.001)
    return bench.edges[-1].at_s
