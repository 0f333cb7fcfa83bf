"""The line to the board: requests and replies over pymodbus, with what goes wrong counted."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import termios
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from pymodbus import ModbusException
from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_driver.board.wiring import Wiring

TCP_PORT = 502
_READ_HOLDING, _READ_INPUT, _WRITE_REGISTER, _WRITE_COILS, _WRITE_REGISTERS, _READ_WRITE = 3, 4, 6, 15, 16, 23
_CODE_BITS = 0x7F
"""An exception has the function's code with the bit above these set."""
_FAST_BAUD = 19200
_FAST_SILENCE_S = 1.75e-3
_SILENCE_CHARACTERS = 3.5
_CHARACTER_BITS = 11


_PATIENCE = 8.0
"""How much longer than `reply_timeout_s` is waited at the most where replies come late, as a ratio."""

_CALMS = 0.98
"""What a reply leaves of a longer wait: some hundred, a second at 100 Hz, until it is `reply_timeout_s` again."""

_LATE_S = 0.01
"""How much longer than its time-out a request may take, s, on a host that is on time: ten slices of a scheduler."""


class LineError(Exception):
    """The board did not answer, or not in a way that can be read. One line.

    `host_was_late` says that this end has stood still meanwhile, so that a reply may have come in time.
    """

    def __init__(self, why: str, *, host_was_late: bool = False) -> None:
        """Say why."""
        super().__init__(why)
        self.host_was_late = host_was_late


class RefusedError(Exception):
    """The board answered with an exception, of this code of the standard: it has understood, and does not do it."""

    def __init__(self, what: str, code: int) -> None:
        """Say what was refused, and with which code."""
        super().__init__(f"{what} refused with exception {code}")
        self.code = code


def silence_s(baud_rate: int) -> float:
    """Return how long a line must be silent between two frames, s (MODBUS over Serial Line V1.02, 2.5.1.1)."""
    return _FAST_SILENCE_S if baud_rate > _FAST_BAUD else _SILENCE_CHARACTERS * _CHARACTER_BITS / baud_rate


def check_port(port: str) -> None:
    """Refuse what is neither a device's path nor tcp://HOST[:PORT].

    Raises:
        ValueError: one line that says so.

    """
    if port.startswith("tcp://"):
        try:
            parts = urlsplit(port)
            good = bool(parts.hostname) and (parts.port is None or parts.port > 0)
        except ValueError:
            good = False
        if not good:
            msg = f"port is '{port}'; it must be tcp://HOST or tcp://HOST:PORT"
            raise ValueError(msg)
    elif not port.startswith("/"):
        given = f"'{port}'" if port else "empty"
        msg = f"port is {given}; name a serial device such as /dev/jammkle_board, or tcp://HOST[:PORT]"
        raise ValueError(msg)


def _pass_on_defects(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Leave out what pymodbus raises while it reads: the request that has got no reply raises, and is counted."""
    if not isinstance(context.get("exception"), ModbusException):
        loop.default_exception_handler(context)


class Line:
    """One client on one line. Not to be used from two tasks at once."""

    def __init__(self, port: str, wiring: Wiring, tries: int = 1) -> None:
        """Make a line that is not open, to a serial device or tcp://HOST[:PORT].

        A request is sent `tries` times until it counts as lost. Who controls a pump says it anew in the next cycle
        instead, with what is true then.
        """
        # Errors are counted here and reported by the driver; pymodbus would log them a hundred times a second.
        logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL + 1)
        self._port = port
        self._wiring = wiring
        self._tries = tries
        self._serial = not port.startswith("tcp://")
        self._client: Any = None
        self._silence_s = silence_s(wiring.baud_rate) if self._serial else 0.0
        self._free_s = 0.0
        self._came_in = b""
        self._patience_s = wiring.reply_timeout_s
        self._unanswered = False
        self._taken: dict[int, int] = {}
        self.answered = 0
        self.late = 0
        self.damaged = 0
        self.timeouts = 0
        self.refusals = 0

    @property
    def is_open(self) -> bool:
        """Whether the device or connection is there."""
        return self._client is not None and bool(self._client.connected)

    async def open(self) -> None:
        """Open the device or connection.

        Raises:
            LineError: why it cannot be opened.

        """
        self.close()
        if self._serial:
            self._check_device()
        options: dict[str, Any] = {
            "timeout": self._wiring.reply_timeout_s,
            "retries": 0,  # of the library; see `tries`
            "reconnect_delay": 0,
            "trace_packet": self._trace,
            "trace_pdu": self._note,
        }
        if self._serial:
            self._client = AsyncModbusSerialClient(
                self._port,
                baudrate=self._wiring.baud_rate,
                parity=self._wiring.parity,
                stopbits=self._wiring.stop_bits,
                **options,
            )
        else:
            parts = urlsplit(self._port)
            self._client = AsyncModbusTcpClient(str(parts.hostname), port=parts.port or TCP_PORT, **options)
        asyncio.get_running_loop().set_exception_handler(_pass_on_defects)
        try:
            connected = await self._client.connect()
        except (OSError, ValueError, termios.error) as error:  # of a device that has been pulled out, or of settings
            self.close()
            wiring = self._wiring
            asked = f"{wiring.baud_rate} baud, parity {wiring.parity}, {wiring.stop_bits} stop bits"
            msg = f"{self._port} cannot be set to {asked}: {error}; look at the board file and the adapter"
            raise LineError(msg) from error
        if not connected:
            self.close()
            why = "in use by another program, or no serial device" if self._serial else "nobody answers there"
            msg = f"{self._port} cannot be opened: {why}"
            raise LineError(msg)

    def close(self) -> None:
        """Let go of the device or connection."""
        if self._client is not None:
            self._client.close()
        self._client = None

    def let_go(self) -> None:
        """Close what is not worth keeping: all but a serial device that is there and whose board is silent.

        Opening a serial port resets an Arduino, whose bootloader then answers nothing for up to 2 s: who closes and
        opens again in that time never gets an answer.
        """
        if not (self._serial and self.is_open):
            self.close()

    async def read(self, table: str, first: int, count: int) -> Sequence[int]:
        """Return `count` registers of the table `input` or `holding`."""
        call = self._client.read_input_registers if table == "input" else self._client.read_holding_registers
        code = _READ_INPUT if table == "input" else _READ_HOLDING
        return await self._ask(
            f"reading {count} registers from {first}", code, partial(call, first, count=count), count
        )

    async def write(self, first: int, numbers: Sequence[int]) -> None:
        """Write holding registers."""
        call = partial(self._client.write_registers, first, list(numbers))
        await self._ask(f"writing registers from {first}", _WRITE_REGISTERS, call, address=first, count=len(numbers))

    async def write_register(self, address: int, number: int) -> None:
        """Write one holding register."""
        call = partial(self._client.write_register, address, number)
        await self._ask(f"writing register {address}", _WRITE_REGISTER, call, address=address, registers=[number])

    def has_taken(self, address: int, number: int) -> bool:
        """Whether the board has replied, in time or late, that this is the last number that a register has taken."""
        return self._taken.get(address) == number

    async def write_coils(self, first: int, bits: Sequence[bool]) -> None:
        """Write coils that follow each other."""
        call = partial(self._client.write_coils, first, list(bits))
        await self._ask(f"writing coils from {first}", _WRITE_COILS, call, address=first, count=len(bits))

    async def write_and_read(self, first: int, numbers: Sequence[int], read_first: int, count: int) -> Sequence[int]:
        """Write holding registers and read others, in one request (function 23)."""
        call = partial(
            self._client.readwrite_registers,
            read_address=read_first,
            read_count=count,
            write_address=first,
            values=list(numbers),
        )
        what = f"writing registers from {first} and reading {count} from {read_first}"
        return await self._ask(what, _READ_WRITE, call, count)

    async def _ask(
        self, what: str, code: int, call: partial[Any], reads: int = 0, **echo: int | list[int]
    ) -> Sequence[int]:
        """Send a request until it is answered, and return the registers of the reply, `reads` in number.

        `what` is said to people; the reply must have the function `code`, and say again what `echo` holds by pymodbus'
        names.
        """
        for _ in range(self._tries - 1):
            with contextlib.suppress(LineError):
                return await self._ask_once(what, code, call, reads, echo)
            if not self.is_open:
                break
        return await self._ask_once(what, code, call, reads, echo)

    async def _ask_once(
        self, what: str, code: int, call: partial[Any], reads: int, echo: Mapping[str, int | list[int]]
    ) -> Sequence[int]:
        """Send one request and return the registers of its reply.

        A frame carries no number, so that a reply that comes late would pass for that to the next request. After a
        request without a reply the line is left alone for as long as was waited for it, and what has come before the
        next is thrown away unread. Only one that comes later still, to the same request as the next, goes unnoticed.

        What comes after its time shows that the board lives, on a busy machine or a slow line: it is counted as late,
        and the next reply is waited for twice as long, up to `_PATIENCE` times `reply_timeout_s`.
        """
        loop = asyncio.get_running_loop()
        left_s = self._free_s - loop.time()
        if self._unanswered:  # who stood still meanwhile has not yet read what came
            left_s = max(left_s, self._silence_s)
        if left_s > 0.0:
            await asyncio.sleep(left_s)
        if self._throw_away() and self._unanswered:
            self.late += 1
            self._patience_s = min(2.0 * self._patience_s, _PATIENCE * self._wiring.reply_timeout_s)
        self._unanswered = False
        self._client.ctx.comm_params.timeout_connect = patience_s = self._patience_s
        pause_s = self._silence_s
        begun_s = loop.time()
        try:
            reply = await call(device_id=self._wiring.unit)
        except (ModbusException, OSError) as error:
            if not self.is_open:
                msg = f"{self._port} is gone"
            elif self._came_in:
                self.damaged += 1
                msg = f"{what}: the reply's check sum is wrong"
            else:
                self.timeouts += 1
                self._unanswered = True
                pause_s = patience_s
                msg = f"no reply within {patience_s:g} s"
            late_s = loop.time() - begun_s - patience_s
            raise LineError(msg, host_was_late=late_s > _LATE_S) from error
        finally:
            self._free_s = loop.time() + pause_s
        if not self._answers(reply, code, reads, echo):
            self.damaged += 1
            self._free_s = loop.time() + self._wiring.reply_timeout_s
            msg = f"{what}: the reply is one to another request"
            raise LineError(msg)
        self.answered += 1
        self._patience_s = max(_CALMS * patience_s, self._wiring.reply_timeout_s)
        if reply.isError():
            self.refusals += 1
            raise RefusedError(what, int(reply.exception_code))
        registers: Sequence[int] = reply.registers if reads else ()
        return registers

    def _answers(self, reply: Any, code: int, reads: int, echo: Mapping[str, int | list[int]]) -> bool:
        """Whether a good frame can be the reply to such a request, an exception among them."""
        if reply.function_code & _CODE_BITS != code:
            return False
        if reply.isError():
            return True
        if reads:  # pymodbus takes a count of bytes that is odd as well
            head = bytes((self._wiring.unit, code, 2 * reads))
            return len(reply.registers) == reads and head in self._came_in
        return all(getattr(reply, name) == value for name, value in echo.items())

    def _throw_away(self) -> bool:
        """Forget what has come, and return whether anything had; over TCP each frame has a number of its own."""
        came, self._came_in = bool(self._came_in), b""
        if self._serial and self.is_open:
            with contextlib.suppress(OSError, termios.error):  # a device that is gone: the request will say so
                device = self._client.ctx.transport.sync_serial
                came = came or device.in_waiting > 0
                device.reset_input_buffer()
        return came

    def _trace(self, sending: bool, data: bytes) -> bytes:  # noqa: FBT001 - as the library calls it
        if not sending:
            self._came_in = data
        return data

    def _note(self, sending: bool, pdu: Any) -> Any:  # noqa: FBT001 - as the library calls it
        """Keep what the board says that it has taken, also where that comes too late for the request."""
        if not sending and pdu.function_code == _WRITE_REGISTER:  # an exception has another code
            self._taken[pdu.address] = pdu.registers[0]
        return pdu

    def _check_device(self) -> None:
        path = Path(self._port)
        if not path.exists():
            msg = f"no device {self._port}: plug the board in"
            raise LineError(msg)
        if not os.access(path, os.R_OK | os.W_OK):
            msg = f"no permission for {self._port}: install the udev rule, or join the group that owns it"
            raise LineError(msg)
