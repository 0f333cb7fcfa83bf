"""What is said to a board in one cycle: outputs out, all sensors in. One class per kind of firmware."""

from __future__ import annotations

import contextlib
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from jammkle_driver.board.line import LineError, RefusedError
from jammkle_driver.board.wiring import Firmware, register_list
from jammkle_driver.core.hardware import ActuatorCommand, BoardFault, ResetCause, SafeCause, released

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from jammkle_driver.board.line import Line
    from jammkle_driver.board.wiring import Wiring


_NEAR = 16
"""Registers that lie so close together are read in one request: a request costs more than these."""

_STATE_EVERY = 10
"""Cycles from one reading of what the board says of itself to the next: ten times a second at 100 Hz."""

_HAS_REGISTER = frozenset({3, 4})
"""Exceptions of a board that has the register and does not take the number now: illegal value, device failure."""

_RESET_CAUSES = ("power_on", "brown_out", "watchdog", "external")
"""First what counts: a rising supply sets the bit of the brown-out, too."""


@dataclass(frozen=True)
class BoardState:
    """What the board says of itself: `crc_errors` are the frames that it threw away since it started."""

    faults: frozenset[BoardFault]
    reset_cause: ResetCause
    uptime_s: float
    supply_v: float
    crc_errors: int


@dataclass(frozen=True)
class Exchange:
    """What one cycle brought.

    Attributes:
        sensors_pa: What each sensor measures, by place, Pa, absolute or vacuum as its wiring says; NaN where broken.
        numbers: What each sensor's register holds, by place.
        taken: What the board drives now, as far as it says; None where it does not and nothing was written.
        latched: Why the board is in its safe state.
        state: What the board says of itself; None where it was not asked in this cycle, or has no such register.
        sent_s: When the cycle began, s of the steady clock; what the board read and did was after that,
        received_s: and before this, when the last reply was in.
    """

    sensors_pa: Mapping[str, float]
    numbers: Mapping[str, int]
    taken: ActuatorCommand | None
    latched: frozenset[SafeCause] = frozenset()
    state: BoardState | None = None
    sent_s: float = 0.0
    received_s: float = 0.0

    @property
    def took_s(self) -> float:
        """How long the cycle took, s: what happened in it is known no better than to that."""
        return self.received_s - self.sent_s

    @property
    def at_s(self) -> float:
        """Its middle, s of the steady clock."""
        return 0.5 * (self.sent_s + self.received_s)


class BoardProtocol(ABC):
    """How to talk to one kind of board. Every method may raise LineError."""

    def __init__(self, line: Line, wiring: Wiring, safe_state: str) -> None:
        """Talk over a line; `safe_state` is `vent` or `hold`."""
        self._line = line
        self._wiring = wiring
        self._holds = safe_state == "hold"

    @abstractmethod
    async def open(self) -> str:
        """Prepare a board that has just been connected; return one line that says what it is."""

    @abstractmethod
    async def exchange(self, command: ActuatorCommand | None) -> Exchange:
        """Write the outputs (None: leave them, and give no sign of life) and read all sensors."""

    @abstractmethod
    async def exchange_stale(self, last: ActuatorCommand | None) -> Exchange:
        """Exchange where nobody has repeated the last command (None: there never was one) for a while."""

    @abstractmethod
    async def acknowledge(self) -> None:
        """Let a board that has latched its safe state take jams again.

        Raises:
            RefusedError: it has latched something else meanwhile.

        """


def make_protocol(line: Line, wiring: Wiring, safe_state: str) -> BoardProtocol:
    """Return what talks to the board that the wiring names; `safe_state` is `vent` or `hold`."""
    kind = JammkleProtocol if wiring.firmware is Firmware.JAMMKLE else ModbusProtocol
    return kind(line, wiring, safe_state)


class JammkleProtocol(BoardProtocol):
    """The project's firmware: one request per cycle writes the outputs and reads all sensors (function 23).

    What the board says of itself is read every tenth cycle, and as soon as it has latched something else: without it a
    cycle is shorter by a tenth, and so is the wait of a command for the cycle that is on the line.
    """

    def __init__(self, line: Line, wiring: Wiring, safe_state: str) -> None:
        """Talk over a line; `safe_state` is `vent` or `hold`."""
        super().__init__(line, wiring, safe_state)
        self._registers = register_list()
        self._short = self._registers.input("pump_duty_driven").address + 1
        self._whole = self._registers.input("check_sum_errors").address + 1
        self._cycles = 0
        self._latched_bits = 0

    async def open(self) -> str:
        """Check the version of the registers, and set watchdog and safe state.

        Raises:
            LineError: no answer, or a board whose registers are others.

        """
        registers = self._registers
        first = registers.input("firmware_version").address
        try:
            firmware, version = await self._line.read("input", first, 2)
        except RefusedError as error:
            msg = "the board does not have the firmware of this project: give the driver a board_file that fits"
            raise LineError(msg) from error
        if version != registers.version:
            msg = f"the board has registers of version {version}, the driver of {registers.version}: flash the firmware"
            raise LineError(msg)
        await self._line.write_register(registers.holding("safe_state").address, int(self._holds))
        await self._line.write_register(registers.holding("watchdog_ms").address, self._wiring.watchdog_ms)
        for address, number in self._wiring.on_connect.items():
            await self._line.write_register(address, number)
        return f"firmware {firmware >> 8}.{firmware & 0xFF}"

    async def exchange(self, command: ActuatorCommand | None) -> Exchange:
        """Write the outputs and read what is due. Why a board refuses is read after."""
        count = self._whole if self._cycles % _STATE_EVERY == 0 else self._short
        self._cycles += 1
        numbers: Sequence[int] = ()
        if command is not None:
            first, mirror = self._registers.holding("outputs").address, self._registers.mirror
            with contextlib.suppress(RefusedError):
                numbers = await self._line.write_and_read(first, self._outputs(command), mirror, count)
        latched = self._registers.input("latched").address
        if not numbers or (count < self._whole and numbers[latched] != self._latched_bits):
            numbers = await self._line.read("input", 0, self._whole)
        return self._exchange(numbers)

    async def exchange_stale(self, last: ActuatorCommand | None) -> Exchange:  # noqa: ARG002 - the board knows it
        """Give no sign of life: the board's own watchdog lets go, and latches why."""
        return await self.exchange(None)

    async def acknowledge(self) -> None:
        """Write back what the board has latched, as it was last read: what has come since is not acknowledged."""
        await self._line.write_register(self._registers.holding("acknowledge").address, self._latched_bits)
        self._latched_bits = 0

    def _outputs(self, command: ActuatorCommand) -> tuple[int, int]:
        bits = sum(
            1 << solenoid.coil for name, solenoid in self._wiring.solenoids.items() if command.solenoids.get(name)
        )
        return bits, self._wiring.pump.number(command.pump_duty)

    def _exchange(self, numbers: Sequence[int]) -> Exchange:
        names = [register.name for register in self._registers.tables["input_registers"][: len(numbers)]]
        inputs = dict(zip(names, numbers, strict=True))
        self._latched_bits = inputs["latched"]
        places = {name: numbers[sensor.register] for name, sensor in self._wiring.sensors.items()}
        driven = inputs["outputs_driven"]
        solenoids = {name: bool(driven >> each.coil & 1) for name, each in self._wiring.solenoids.items()}
        duty = self._registers.input("pump_duty_driven").value(inputs["pump_duty_driven"])
        return Exchange(
            sensors_pa=_pascals(self._wiring, places),
            numbers=places,
            taken=ActuatorCommand(solenoids, duty),
            latched=frozenset(SafeCause[name.upper()] for name in self._set_bits("latched", inputs["latched"])),
            state=self._state(inputs) if len(numbers) == self._whole else None,
        )

    def _state(self, inputs: Mapping[str, int]) -> BoardState:
        reset = self._set_bits("reset_cause", inputs["reset_cause"])
        causes = [ResetCause[name.upper()] for name in _RESET_CAUSES if name in reset]
        uptime_ms = inputs["uptime_high"] << 16 | inputs["uptime_low"]
        return BoardState(
            faults=frozenset(BoardFault[name.upper()] for name in self._set_bits("faults", inputs["faults"])),
            reset_cause=causes[0] if causes else ResetCause.UNKNOWN,
            uptime_s=uptime_ms / 1000.0,
            supply_v=self._registers.input("supply").value(inputs["supply"]),
            crc_errors=inputs["check_sum_errors"],
        )

    def _set_bits(self, register: str, number: int) -> list[str]:
        return [name for place, name in enumerate(self._registers.bits[register]) if number >> place & 1]


class ModbusProtocol(BoardProtocol):
    """Any other Modbus server: coils, a register for the pump, registers for the sensors; several requests a cycle.

    Such a board may have no watchdog. As long as this end lives, it does in its stead what the project's firmware does:
    after a command that went stale while something was driven it writes the safe state, and drives nothing until that
    is acknowledged.
    """

    def __init__(self, line: Line, wiring: Wiring, safe_state: str) -> None:
        """Talk over a line; `safe_state` is `vent` or `hold`."""
        super().__init__(line, wiring, safe_state)
        self._let_go: ActuatorCommand | None = None
        """What was written for a stale command; until it is acknowledged."""
        self._register_ranges = [*_register_ranges(wiring, "input"), *_register_ranges(wiring, "holding")]

    async def open(self) -> str:
        """Write what the wiring says, such as the time of the board's own watchdog.

        Raises:
            LineError: no answer, or a refusal: the wiring does not fit the board.

        """
        numbers = self._wiring.on_connect.items()
        kept = [f"register {address}" for address, number in numbers if not await self._prepare(address, number)]
        said = "a board with other firmware: no latched safe state"
        return f"{said}; not taken anew, as it was taken before: {', '.join(kept)}" if kept else said

    async def exchange(self, command: ActuatorCommand | None) -> Exchange:
        """Write the coils and the pump's register, then read the sensors.

        Raises:
            LineError: no answer, or a refusal: the wiring names what the board does not have.

        """
        if self._let_go is not None and command is not None and _drives(command):
            command = self._let_go
        places: dict[str, int] = {}
        with _fitting():
            if command is not None:
                await self._drive(command)
            for table, first, count in self._register_ranges:
                numbers = await self._line.read(table, first, count)
                places |= {
                    name: numbers[sensor.register - first]
                    for name, sensor in self._wiring.sensors.items()
                    if sensor.table == table and first <= sensor.register < first + count
                }
        latched = frozenset() if self._let_go is None else frozenset({SafeCause.HOST_SILENT})
        return Exchange(_pascals(self._wiring, places), places, command, latched)

    async def exchange_stale(self, last: ActuatorCommand | None) -> Exchange:
        """Write the safe state: everything released, or with `hold` the pump off and the solenoids as they are."""
        if last is None or not _drives(last):
            return await self.exchange(released(tuple(self._wiring.solenoids)))
        if self._let_go is None:
            self._let_go = replace(last, pump_duty=0.0) if self._holds else released(tuple(last.solenoids))
        return await self.exchange(self._let_go)

    async def acknowledge(self) -> None:
        """Drive again what is asked for. What the board itself may have latched, this driver does not know."""
        self._let_go = None

    async def _prepare(self, address: int, number: int) -> bool:
        """Write a register, and return whether the board took it now; False where it took the same before.

        Some boards take a number only once, such as the time of a watchdog that does not run yet. Yet it is written
        again when the link comes up anew on a board that has run on, or after a reply that came late or never.
        """
        with _fitting():
            try:
                await self._line.write_register(address, number)
            except RefusedError as error:
                known = error.code in _HAS_REGISTER
                if known and (self._line.has_taken(address, number) or await self._reads(address, number)):
                    return False
                raise
        return True

    async def _reads(self, address: int, number: int) -> bool:
        try:
            return list(await self._line.read("holding", address, 1)) == [number]
        except RefusedError:
            return False

    async def _drive(self, command: ActuatorCommand) -> None:
        pump = self._wiring.pump
        bits = {
            solenoid.coil: solenoid.bit(energised=command.solenoids[name])
            for name, solenoid in self._wiring.solenoids.items()
        }
        if pump.coil is not None:
            bits[pump.coil] = pump.bit(command.pump_duty)
        if max(bits) - min(bits) == len(bits) - 1:  # without a gap: in one request, and so at one moment
            await self._line.write_coils(min(bits), [bits[coil] for coil in sorted(bits)])
        else:
            for coil, bit in bits.items():
                await self._line.write_coils(coil, [bit])
        if pump.register is not None:
            await self._line.write_register(pump.register, pump.number(command.pump_duty))


@contextlib.contextmanager
def _fitting() -> Iterator[None]:
    """Take a refusal for a wiring that does not fit the board."""
    try:
        yield
    except RefusedError as error:
        msg = f"{error}: the board_file does not fit this board"
        raise LineError(msg) from error


def _drives(command: ActuatorCommand) -> bool:
    return command.pump_duty > 0.0 or any(command.solenoids.values())


def _pascals(wiring: Wiring, numbers: Mapping[str, int]) -> dict[str, float]:
    return {name: wiring.sensors[name].pascals(number) for name, number in numbers.items()}


def _register_ranges(wiring: Wiring, table: str) -> list[tuple[str, int, int]]:
    """Return table, first register and count of each request that reads the sensors of a table."""
    ranges: list[tuple[str, int, int]] = []
    for address in sorted(sensor.register for sensor in wiring.sensors.values() if sensor.table == table):
        if ranges and address - sum(ranges[-1][1:]) < _NEAR:
            ranges[-1] = (table, ranges[-1][1], address - ranges[-1][1] + 1)
        else:
            ranges.append((table, address, 1))
    return ranges
