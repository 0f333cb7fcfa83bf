"""`jammkle hardware check`: one question after the other, from a board just connected to calibrated sensors."""

from __future__ import annotations

import asyncio
import math
import os
import select
import statistics
import sys
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import typer
import yaml

from jammkle_common.command.errors import InputError, Interrupted
from jammkle_common.constants import HELD_VACUUM_PA
from jammkle_common.names import CHANNELS
from jammkle_driver.board.check import PERIOD_S, RELEASED, CheckRow, Probe, check, command, row_of
from jammkle_driver.board.line import Line, LineError, RefusedError
from jammkle_driver.board.protocol import make_protocol
from jammkle_driver.board.wiring import SENSORS, Firmware, register_list, standard_board_file
from jammkle_driver.core.hardware import MANIFOLD, BoardFault

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from jammkle_driver.board.protocol import BoardProtocol
    from jammkle_driver.board.wiring import Wiring
    from jammkle_driver.core.hardware import ActuatorCommand


_LOOK_S = 0.02
"""How often is looked for what was typed, s. Assumed: nobody notices it."""

_MOST_BYTES = 4096
"""Longest line of a terminal (N_TTY in Linux)."""

_ANSWERS = {"": True, "y": True, "yes": True, "n": False, "no": False}


class Prompt:
    """Who sits at the terminal.

    A line is read when it is there: a thread that waited for it would hold up the end, and that end stops a pump.
    """

    def __init__(self) -> None:
        """Begin with nothing typed."""
        self._typed = b""

    def reported(self, row: CheckRow) -> None:
        """Show a row as soon as it is known."""
        typer.echo(f"{'ok  ' if row.passed else 'FAIL'} {row.what}: {row.measured}", err=True)

    async def agrees(self, question: str) -> bool:
        """Ask until yes or no is typed; nothing is yes.

        Raises:
            Interrupted: nobody is there to answer.

        """
        while (answer := (await self._answer(f"{question} [Y/n]: ")).lower()) not in _ANSWERS:
            typer.echo(f"'{answer}' is neither y nor n", err=True)
        return _ANSWERS[answer]

    async def number(self, question: str, least: float, most: float) -> float | None:
        """Ask until a number that can be right, or nothing (None), is typed. Takes its time, and never blocks.

        Raises:
            Interrupted: nobody is there to answer.

        """
        while answer := await self._answer(f"{question}; nothing: skip: "):
            try:
                number = float(answer.replace(",", "."))
            except ValueError:
                number = math.nan
            if least <= number <= most:
                return number
            if math.isfinite(number):
                typer.echo(f"{answer} cannot be: {least:g} to {most:g} is asked for", err=True)
            else:
                typer.echo(f"'{answer}' is not a number", err=True)
        return None

    async def _answer(self, question: str) -> str:
        typer.echo(question, nl=False, err=True)
        try:
            return await self._line()
        except (Interrupted, asyncio.CancelledError):
            typer.echo(err=True)  # what is said next gets a line of its own
            raise

    async def _line(self) -> str:
        if sys.stdin is None:
            raise Interrupted
        while b"\n" not in self._typed:
            if not select.select([sys.stdin], [], [], 0.0)[0]:
                await asyncio.sleep(_LOOK_S)
                continue
            try:
                came = os.read(sys.stdin.fileno(), _MOST_BYTES)
            except OSError:  # the terminal was closed
                came = b""
            if not came and not self._typed:
                raise Interrupted
            self._typed += came or b"\n"
        line, _, self._typed = self._typed.partition(b"\n")
        return line.decode(errors="replace").strip()


_AVERAGED_S = 0.5
_BOOT_S = 3.0
"""An Arduino's bootloader waits for up to 2 s."""
_EVACUATION_S = 10.0
_REPLY_TIMEOUT_S = 0.08
"""Commissioning has time: a computer that is busy so long has lost nothing, and the board's watchdog still waits."""
_TRIES = 10
_CALIBRATION = "calibration"
_NOT_CALIBRATED = "run this again with barometer and gauge"
_LOW_SUPPLY = "supply of pump and valves: is it on? divider at its pin, `supply_minimum`"


@dataclass(frozen=True)
class CommissioningOptions:
    """What is walked, at the board at `port`.

    `board_file` says how it is wired (None: the shipped one), a new one goes to `output` (None: beside the old one),
    and `pace` is a factor on how long is waited for pump, valves and leaks.
    """

    port: str
    wiring: Wiring
    board_file: Path | None
    output: Path | None
    calibrates: bool
    pace: float = 1.0


async def commission(
    options: CommissioningOptions, person: Prompt, stops: Callable[[], bool] = lambda: False
) -> list[CheckRow]:
    """Check pump, valves, sensors and leaks, and return every row; `stops` says whether somebody wants an end.

    Whatever happens, the outputs are released at the end.

    Raises:
        LineError: the board is not there, or has gone.
        Interrupted: somebody wanted an end.
    """
    patient = replace(options.wiring, reply_timeout_s=max(options.wiring.reply_timeout_s, _REPLY_TIMEOUT_S))
    line = Line(options.port, patient, tries=_TRIES)
    rows: list[CheckRow] = []

    def tell(row: CheckRow) -> None:
        rows.append(row)
        person.reported(row)

    try:
        await line.open()
        talk = make_protocol(line, options.wiring, "vent")
        said = await _patiently(talk, stops)
        probe = Probe(talk, options.wiring, options.pace, stops)
        try:
            tell(await _link_row(probe, said))
            async for row in check(probe, options.wiring):
                tell(row)
            if options.calibrates:  # also where the pump has failed: a bad calibration looks just like that
                tell(await _Calibration(options, line, probe, person).row())
        finally:
            await _release(talk, options.wiring)
    except RefusedError as error:
        msg = f"{error}: the board does not do what its file says"
        raise LineError(msg) from error
    finally:
        line.close()
    return rows


async def _release(talk: BoardProtocol, wiring: Wiring) -> None:
    try:
        await talk.exchange(RELEASED)
    except LineError as error:
        if wiring.firmware is Firmware.JAMMKLE:  # its watchdog lets go
            raise
        msg = f"{error}; pump and valves may still be on: switch off their supply"
        raise LineError(msg) from error


async def _patiently(talk: BoardProtocol, stops: Callable[[], bool]) -> str:
    """Open a board that may just have been reset by the opening of its port, until its bootloader must be through."""
    end_s = time.monotonic() + _BOOT_S
    while True:
        if stops():
            raise Interrupted
        try:
            return await talk.open()
        except LineError:
            if time.monotonic() > end_s:
                raise
        await asyncio.sleep(_AVERAGED_S)


async def _link_row(probe: Probe, said: str) -> CheckRow:
    came = await probe.exchanges(RELEASED, _AVERAGED_S)
    states = [exchange.state for _, exchange in came if exchange.state is not None]
    supply = f", supply {states[-1].supply_v:.1f} V" if states else ""
    low = bool(states) and BoardFault.SUPPLY_LOW in states[-1].faults  # by the board's own `supply_minimum`
    return row_of("board", f"{said}{supply}", _LOW_SUPPLY if low else "")


class _Calibration:
    """Asks for the air's pressure and for a vacuum, and keeps each sensor's line through both."""

    def __init__(self, options: CommissioningOptions, line: Line, probe: Probe, person: Prompt) -> None:
        self._wiring = options.wiring
        self._source = options.board_file or standard_board_file()
        self._target = options.output or self._source.with_suffix(".calibrated.yaml")
        self._line = line
        self._probe = probe
        self._person = person
        self._own = options.wiring.firmware is Firmware.JAMMKLE

    async def row(self) -> CheckRow:
        probe, (low_kpa, high_kpa) = self._probe, (pa / 1e3 for pa in AIR_PA)
        await probe.vent()
        barometer = "Pressure of the air now, kPa, absolute, as a barometer reads it"
        ambient_kpa, first = await self._asked(RELEASED, barometer, low_kpa, high_kpa)
        if ambient_kpa is None:
            return self._left
        place = MANIFOLD if MANIFOLD in self._wiring.sensors else CHANNELS[0]
        await probe.drive(command(CHANNELS, 1.0), _EVACUATION_S, lambda m: m.vacuum_pa[place] >= HELD_VACUUM_PA)
        held = command(CHANNELS, 0.0)
        await probe.exchanges(held, _AVERAGED_S)
        gauge = "Vacuum that a gauge at the manifold reads now, kPa below ambient"
        gauge_kpa, second = await self._asked(held, gauge, -ambient_kpa, ambient_kpa)
        await probe.exchanges(RELEASED, _AVERAGED_S)
        if gauge_kpa is None:
            return self._left
        ambient_pa = 1e3 * ambient_kpa
        try:
            lines = sensor_lines(first, ambient_pa, second, ambient_pa - 1e3 * abs(gauge_kpa))
        except InputError as error:
            return row_of(_CALIBRATION, "not written", str(error))
        if self._own:
            await self._store(lines)
            return row_of(_CALIBRATION, "two points, stored on the board")
        write_board_file(self._source, self._target, lines)
        return row_of(_CALIBRATION, f"two points, written to {self._target}")

    @property
    def _left(self) -> CheckRow:
        return CheckRow(_CALIBRATION, passed=True, measured="left as it is", to_do=_NOT_CALIBRATED)

    async def _asked(
        self, held: ActuatorCommand, question: str, least: float, most: float
    ) -> tuple[float | None, Mapping[str, float]]:
        """Ask for a number while a command is kept; return it with the sensors' numbers from just before the answer."""
        answer = asyncio.ensure_future(self._person.number(question, least, most))
        numbers: list[Mapping[str, int]] = []
        kept = int(_AVERAGED_S / PERIOD_S)
        try:
            while not answer.done() or len(numbers) < kept:
                exchange = await self._probe.exchange(held)
                numbers.append(await self._raw_numbers() if self._own else self._values(exchange.numbers))
                del numbers[:-kept]
                await asyncio.sleep(PERIOD_S)
        finally:
            answer.cancel()
        return await answer, {place: statistics.fmean(each[place] for each in numbers) for place in numbers[0]}

    def _values(self, numbers: Mapping[str, int]) -> dict[str, int]:
        return {place: self._wiring.sensors[place].value(number) for place, number in numbers.items()}

    async def _raw_numbers(self) -> dict[str, int]:
        """Return what the converter of the project's firmware reads for each sensor, before any calibration."""
        registers = register_list()
        numbers = await self._line.read("input", registers.input("raw_1").address, SENSORS)
        return {place: numbers[self._index(place)] for place in self._wiring.sensors}

    async def _store(self, lines: Mapping[str, SensorLine]) -> None:
        """Write the points to a board with the project's firmware, which keeps them over a reset."""
        registers = register_list()
        for place, found in lines.items():
            sensor = self._index(place) + 1
            first = registers.holding(f"sensor_{sensor}_raw_low")
            pressure = registers.holding(f"sensor_{sensor}_pressure_low")
            points = [first.steps(found.low[0]), pressure.steps(found.low[1])]
            points += [first.steps(found.high[0]), pressure.steps(found.high[1])]
            await self._line.write(first.address, points)
        await self._line.write_register(registers.holding("store").address, 1)

    def _index(self, place: str) -> int:
        return self._wiring.sensors[place].register - register_list().input("pressure_1").address


LEAST_VACUUM_PA = 20e3
"""Two points that lie closer make a line that is wrong at its far end by several times their own error."""

_LEAST_STEPS = 10.0

AIR_PA = (50e3, 110e3)
"""Pressures of the air that can be, Pa absolute: from 5500 m to below the sea, as for the driver's parameter."""


@dataclass(frozen=True)
class SensorLine:
    """A sensor's straight line through two points, each a number of its register and the pressure there, Pa."""

    low: tuple[float, float]
    high: tuple[float, float]

    @property
    def scale(self) -> float:
        """Pa per step."""
        return (self.high[1] - self.low[1]) / (self.high[0] - self.low[0])

    @property
    def offset_pa(self) -> float:
        """Pa at number 0."""
        return self.low[1] - self.scale * self.low[0]


def sensor_lines(
    first: Mapping[str, float], first_pa: float, second: Mapping[str, float], second_pa: float
) -> dict[str, SensorLine]:
    """Return each sensor's line from its numbers at two pressures, Pa.

    Raises:
        InputError: a pressure cannot be, they are too close, or a sensor does not follow.

    """
    if not AIR_PA[0] <= first_pa <= AIR_PA[1]:
        low_kpa, high_kpa = AIR_PA[0] / 1e3, AIR_PA[1] / 1e3
        msg = f"the air is at {first_pa / 1e3:g} kPa; it must be {low_kpa:g} to {high_kpa:g} kPa, absolute"
        raise InputError(msg)
    if not 0.0 <= second_pa <= AIR_PA[1]:
        msg = f"the gauge leaves {second_pa / 1e3:g} kPa of the air; it reads vacuum in kPa, less than the air itself"
        raise InputError(msg)
    if abs(first_pa - second_pa) < LEAST_VACUUM_PA:
        msg = (
            f"the two points are {abs(first_pa - second_pa) / 1e3:.1f} kPa apart; at least {LEAST_VACUUM_PA / 1e3:.0f}"
        )
        raise InputError(msg)
    lines = {}
    for place, number in first.items():
        if abs(number - second[place]) < _LEAST_STEPS:
            msg = f"sensor {place} reads {number:.0f} at both pressures: it does not measure"
            raise InputError(msg)
        low, high = sorted(((number, first_pa), (second[place], second_pa)))
        lines[place] = SensorLine(low, high)
    return lines


def write_board_file(source: Path, target: Path, lines: Mapping[str, SensorLine]) -> None:
    """Write a copy of a board file with new scale and offset of each sensor; comments do not come along.

    Raises:
        OSError: it cannot be written.

    """
    content: dict[str, Any] = yaml.safe_load(source.read_text(encoding="utf-8"))
    for place, found in lines.items():
        content["sensors"][place] |= {"scale": found.scale, "offset_pa": found.offset_pa, "vacuum": False}
    target.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
