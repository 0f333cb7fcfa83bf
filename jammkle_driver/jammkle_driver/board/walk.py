"""The walk of `jammkle hardware check`: connect, look at everything, calibrate, release."""

from __future__ import annotations

import asyncio
import statistics
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

from jammkle_common.command.errors import Interrupted
from jammkle_common.constants import HELD_VACUUM_PA
from jammkle_common.names import CHANNELS
from jammkle_driver.board import calibration
from jammkle_driver.board.calibration import AIR_PA, CalibrationError
from jammkle_driver.board.check import CheckRow, check
from jammkle_driver.board.dialogue import dialogue
from jammkle_driver.board.line import Line, LineError, RefusedError
from jammkle_driver.board.probe import PERIOD_S, RELEASED, Probe, command
from jammkle_driver.board.wiring import Firmware
from jammkle_driver.board.wiring_file import standard_board_file
from jammkle_driver.core.hardware import MANIFOLD, BoardFault

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from jammkle_driver.board.dialogue import Dialogue
    from jammkle_driver.board.wiring import Wiring
    from jammkle_driver.core.hardware import ActuatorCommand

_AVERAGED_S = 0.5
_BOOT_S = 3.0
"""An Arduino's bootloader waits for up to 2 s."""
_EVACUATION_S = 10.0
_REPLY_TIMEOUT_S = 0.08
"""A walk has time: a computer that is busy for so long has lost nothing, and the board's watchdog still waits."""
_TRIES = 10


class Person(Protocol):
    """Whoever stands beside the board."""

    def told(self, row: CheckRow) -> None:
        """Be shown a row as soon as it is known."""

    async def number(self, question: str, least: float, most: float) -> float | None:
        """Answer with a number between these; None: cannot tell. Takes its time, and never blocks."""


@dataclass(frozen=True)
class Question:
    """What a person is asked: in words, and the numbers between which an answer can be right."""

    text: str
    least: float
    most: float


@dataclass(frozen=True)
class WalkOptions:
    """What is walked.

    Attributes:
        port: Where the board is.
        wiring: How it is wired.
        board_file: The file that says so; None: the shipped one.
        output: Where a new board file goes; None: beside the old one.
        calibrates: Whether the sensors are calibrated.
        pace: Factor on how long is waited for pump, valves and leaks.

    """

    port: str
    wiring: Wiring
    board_file: Path | None
    output: Path | None
    calibrates: bool
    pace: float = 1.0


async def walk(options: WalkOptions, person: Person, stops: Callable[[], bool] = lambda: False) -> list[CheckRow]:
    """Walk through everything; whatever happens, the outputs are released at the end.

    Args:
        options: What is walked.
        person: Who is told, and asked.
        stops: Whether somebody wants an end: the outputs are then released, too.

    Raises:
        LineError: the board is not there, or has gone.
        Interrupted: somebody wanted an end; the outputs are released.

    """
    patient = replace(options.wiring, reply_timeout_s=max(options.wiring.reply_timeout_s, _REPLY_TIMEOUT_S))
    line = Line(options.port, patient, tries=_TRIES)
    rows: list[CheckRow] = []

    def tell(row: CheckRow) -> None:
        rows.append(row)
        person.told(row)

    try:
        await line.open()
        talk = dialogue(line, options.wiring, "vent")
        said = await _patiently(talk, stops)
        probe = Probe(talk, options.wiring, options.pace, stops)
        try:
            tell(await _link_row(probe, said))
            async for row in check(probe, options.wiring):
                tell(row)
            if options.calibrates:  # also where the pump has failed: a bad calibration looks just like that
                tell(await _calibrate(options, line, probe, person))
        finally:
            await _release(talk, options.wiring)
    except RefusedError as error:
        msg = f"{error}: the board does not do what its file says"
        raise LineError(msg) from error
    finally:
        line.close()
    return rows


async def _release(talk: Dialogue, wiring: Wiring) -> None:
    """Release every output.

    Raises:
        LineError: the board did not take it.

    """
    try:
        await talk.exchange(RELEASED)
    except LineError as error:
        if wiring.firmware is Firmware.JAMMKLE:  # its watchdog lets go
            raise
        msg = f"{error}; pump and valves may still be on: switch off their supply"
        raise LineError(msg) from error


async def _patiently(talk: Dialogue, stops: Callable[[], bool]) -> str:
    """Open the dialogue with a board that may just have been reset by the opening of its port.

    Raises:
        LineError: still no answer after its bootloader must be through.
        Interrupted: somebody wants an end.

    """
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
    if not came:
        msg = "no reply"
        raise LineError(msg)
    states = [exchange.state for _, exchange in came if exchange.state is not None]
    supply = f", supply {states[-1].supply_v:.1f} V" if states else ""
    low = bool(states) and BoardFault.SUPPLY_LOW in states[-1].faults  # by the board's own `supply_minimum`
    to_do = "supply of pump and valves: is it on? divider at its pin, `supply_minimum`" if low else ""
    return CheckRow("board", passed=not low, measured=f"{said}{supply}", to_do=to_do)


async def _calibrate(options: WalkOptions, line: Line, probe: Probe, person: Person) -> CheckRow:
    what = "calibration"
    await probe.vent()
    air_kpa = [pa / 1e3 for pa in AIR_PA]
    barometer = Question("Pressure of the air now, kPa, absolute, as a barometer reads it", *air_kpa)
    ambient_kpa, first = await _asked(options, line, probe, person, RELEASED, barometer)
    if ambient_kpa is None:
        return CheckRow(what, passed=True, measured="left as it is", to_do="run this again with barometer and gauge")
    place = MANIFOLD if MANIFOLD in options.wiring.sensors else CHANNELS[0]
    await probe.drive(command(CHANNELS, 1.0), _EVACUATION_S, lambda m: m.vacuum_pa[place] >= HELD_VACUUM_PA)
    held = command(CHANNELS, 0.0)
    await probe.exchanges(held, _AVERAGED_S)
    gauge = Question("Vacuum that a gauge at the manifold reads now, kPa below ambient", -ambient_kpa, ambient_kpa)
    gauge_kpa, second = await _asked(options, line, probe, person, held, gauge)
    await probe.exchanges(RELEASED, _AVERAGED_S)
    if gauge_kpa is None:
        return CheckRow(what, passed=True, measured="left as it is", to_do="run this again with barometer and gauge")
    ambient_pa = 1e3 * ambient_kpa
    try:
        lines = calibration.sensor_lines(first, ambient_pa, second, ambient_pa - 1e3 * abs(gauge_kpa))
    except CalibrationError as error:
        return CheckRow(what, passed=False, measured="not written", to_do=str(error))
    if options.wiring.firmware is Firmware.JAMMKLE:
        await calibration.store(line, options.wiring, lines)
        where = "stored on the board"
    else:
        target = options.output or (options.board_file or standard_board_file()).with_suffix(".calibrated.yaml")
        calibration.write_board_file(options.board_file or standard_board_file(), target, lines)
        where = f"written to {target}"
    return CheckRow(what, passed=True, measured=f"two points, {where}")


async def _asked(
    options: WalkOptions, line: Line, probe: Probe, person: Person, held: ActuatorCommand, question: Question
) -> tuple[float | None, Mapping[str, float]]:
    """Ask for a number while a command is kept; return it with the sensors' numbers from just before the answer."""
    answer = asyncio.ensure_future(person.number(question.text, question.least, question.most))
    numbers: list[Mapping[str, int]] = []
    kept = int(_AVERAGED_S / PERIOD_S)
    try:
        while not answer.done() or len(numbers) < kept:
            exchange = await probe.exchange(held)
            raw = options.wiring.firmware is Firmware.JAMMKLE
            numbers.append(await calibration.raw_numbers(line, options.wiring) if raw else exchange.numbers)
            del numbers[:-kept]
            await asyncio.sleep(PERIOD_S)
    finally:
        answer.cancel()
    return await answer, {place: statistics.fmean(each[place] for each in numbers) for place in numbers[0]}
