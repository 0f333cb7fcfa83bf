"""A peer on a pseudo terminal that answers requests of the driver's line: rightly, or with any nonsense."""

from __future__ import annotations

import enum
import fcntl
import os
import pty
import random
import select
import struct
import termios
import threading
import time
import tty
from typing import TYPE_CHECKING

from pymodbus.framer.rtu import FramerRTU

from jammkle_driver.board.wiring import register_list

if TYPE_CHECKING:
    from collections.abc import Callable

UNIT = 1
_REGISTERS = register_list()
_READ_INPUT = 4
_READS = (3, _READ_INPUT, 23)
_HEAD = struct.Struct(">BBHH")
"""Unit, function, first address; then number or count."""

_PLACES = 4
"""Pressures, at the beginning of the input registers."""

_LOOKS_S = 0.002


class Answer(enum.Enum):
    """What the peer says to a request. Of all but the first and the exception nothing may be taken."""

    RIGHT = "right"
    SILENCE = "nothing; the right reply may come late"
    NOISE = "bytes at random"
    DAMAGED = "the right reply with a bit turned over"
    SHORT = "the beginning of the right reply"
    ANOTHER_FUNCTION = "a frame of another function"
    ANOTHER_UNIT = "the right reply, from somebody else on the line"
    WRONG_LENGTH = "a good frame with registers more or fewer"
    ODD_LENGTH = "a good frame with a byte more than the registers have"
    ANOTHER_WRITE = "a good frame that confirms another write"
    LATE = "a good reply to an earlier request, which was another one"
    EXCEPTION = "refused"
    ANOTHER_EXCEPTION = "refused, but something else"
    UNKNOWN_FUNCTION = "a good frame of a function that nobody asked for"
    ENDLESS = "far more bytes than a frame may have"


def frame(body: bytes) -> bytes:
    """Return bytes with their check sum."""
    return body + FramerRTU.compute_CRC(body).to_bytes(2, "big")


def is_whole(request: bytes) -> bool:
    """Whether so many bytes are a frame with a good check sum."""
    return len(request) > _HEAD.size and frame(request[:-2]) == request


def code_of(request: bytes) -> int:
    """Return the function that is asked for."""
    return request[1]


def reads(request: bytes) -> int:
    """Return how many registers are asked for."""
    return int(_HEAD.unpack_from(request)[3]) if code_of(request) in _READS else 0


def right_reply(request: bytes, numbers: list[int]) -> bytes:
    """Return the reply to a request, with these numbers where it reads registers."""
    if code_of(request) in _READS:
        return frame(struct.pack(f">BBB{len(numbers)}H", UNIT, code_of(request), 2 * len(numbers), *numbers))
    return frame(request[: _HEAD.size])  # address, and number or count, come back


def fits(reply: bytes, request: bytes) -> bool:
    """Whether a good reply could be one to this request: a frame carries no number of the request."""
    if code_of(reply) != code_of(request):
        return False
    if code_of(request) in _READS:
        return reply[2] == 2 * reads(request)
    return reply[: _HEAD.size] == request[: _HEAD.size]


def nonsense(answer: Answer, request: bytes, right: bytes, chance: random.Random) -> bytes:
    """Return what is said instead of the right reply; never what could be taken for it."""
    make = _NONSENSE.get(answer)
    return make(request, right, chance) if make else b""


def _turned_over(right: bytes, first: int, end: int, chance: random.Random) -> bytes:
    place = chance.randrange(first, end)
    return right[:place] + bytes((right[place] ^ 1 << chance.randrange(8),)) + right[place + 1 :]


def _another_function(request: bytes, right: bytes, chance: random.Random) -> bytes:
    other = chance.choice([each for each in (1, 3, 4, 6, 16, 23) if each != code_of(request)])
    return frame(bytes((UNIT, other)) + right[2:-2])


def _wrong_length(request: bytes, right: bytes, chance: random.Random) -> bytes:
    if code_of(request) not in _READS:
        return b""
    size = 2 * chance.randrange(60)
    size += 2 * (size == right[2])
    return frame(bytes((UNIT, code_of(request), size)) + chance.randbytes(size))


def _odd_length(request: bytes, right: bytes, chance: random.Random) -> bytes:
    if code_of(request) not in _READS:
        return b""
    return frame(bytes((UNIT, code_of(request), right[2] + 1)) + right[3:-2] + chance.randbytes(1))


def _another_write(request: bytes, right: bytes, chance: random.Random) -> bytes:
    if code_of(request) in _READS:
        return b""
    return frame(_turned_over(right, 2, _HEAD.size, chance)[:-2])


_ALL_NONSENSE = tuple(answer for answer in Answer if answer is not Answer.RIGHT)
_NONSENSE: dict[Answer, Callable[[bytes, bytes, random.Random], bytes]] = {
    Answer.NOISE: lambda _request, _right, chance: chance.randbytes(chance.randrange(1, 60)),
    Answer.DAMAGED: lambda _request, right, chance: _turned_over(right, 0, len(right), chance),
    Answer.SHORT: lambda _request, right, chance: right[: chance.randrange(1, len(right))],
    Answer.ANOTHER_FUNCTION: _another_function,
    Answer.ANOTHER_UNIT: lambda _request, right, chance: frame(bytes((chance.choice((0, 2, 255)),)) + right[1:-2]),
    Answer.WRONG_LENGTH: _wrong_length,
    Answer.ODD_LENGTH: _odd_length,
    Answer.ANOTHER_WRITE: _another_write,
    Answer.EXCEPTION: lambda request, _right, chance: frame(
        bytes((UNIT, code_of(request) | 0x80, chance.randrange(1, 12)))
    ),
    Answer.ANOTHER_EXCEPTION: lambda _request, _right, chance: frame(
        bytes((UNIT, chance.choice((0x80, 0xAB, 0xFF)), chance.randrange(256)))
    ),
    Answer.UNKNOWN_FUNCTION: lambda _request, _right, chance: frame(
        bytes((UNIT, chance.choice((0, 8, 9, 43, 100, 127)))) + chance.randbytes(chance.randrange(30))
    ),
    # below the 4096 bytes that a terminal keeps for who does not read
    Answer.ENDLESS: lambda _request, _right, chance: chance.randbytes(3000),
}


class Terminal:
    """The peer's end of a pseudo terminal, and the path of the other."""

    def __init__(self) -> None:
        self.mine, self._other = pty.openpty()
        tty.setraw(self._other)
        os.set_blocking(self.mine, False)
        self.path = os.ttyname(self._other)

    def say(self, data: bytes) -> None:
        """Write as much as fits: a line that nobody reads loses bytes."""
        try:
            os.write(self.mine, data)
        except BlockingIOError:
            return

    def take(self) -> bytes:
        """Return what has come."""
        try:
            return os.read(self.mine, 4096)
        except BlockingIOError:
            return b""

    def heard_something(self, timeout_s: float = 0.0) -> bool:
        """Whether something is there to be received."""
        return bool(select.select([self.mine], [], [], timeout_s)[0])

    def lies_there(self) -> int:
        """Return how many bytes wait for the reader at the other end."""
        return int(struct.unpack("i", fcntl.ioctl(self._other, termios.FIONREAD, b"\0" * 4))[0])

    def close(self) -> None:
        """Close both ends."""
        os.close(self.mine)
        os.close(self._other)


class NonsenseBoard:
    """A thread that is a board of the project's firmware, or answers nonsense to it all, as it is reported.

    Each right reply that reads pressures has the number of its request in all of them, so that a reading tells which
    request it answers.
    """

    def __init__(self, seed: int, timeouts: Callable[[], int]) -> None:
        """Begin as a good board; `timeouts` tells how many requests the other end has given up."""
        self.terminal = Terminal()
        self.nonsense_share = 0.0
        self.nonsense_said = 0
        self.request_number = 0
        self._timeouts = timeouts
        self._chance = random.Random(seed)  # noqa: S311 - no secret
        self._held: list[bytes] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="nonsense board", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Be gone."""
        self._stop.set()
        self._thread.join()
        self.terminal.close()

    def _run(self) -> None:
        received = b""
        while not self._stop.is_set():
            if not self.terminal.heard_something(_LOOKS_S):
                continue
            received = (received + self.terminal.take())[-300:]
            if is_whole(received):
                request, received = received, b""
                self._answer(request)

    def _answer(self, request: bytes) -> None:
        self.request_number += 1
        right = right_reply(request, self._numbers(request))
        answer = self._chance.choice(_ALL_NONSENSE) if self._chance.random() < self.nonsense_share else Answer.RIGHT
        if answer is Answer.SILENCE:
            self._wait_until_given_up()
        said = right if answer in {Answer.RIGHT, Answer.SILENCE} else nonsense(answer, request, right, self._chance)
        if answer is Answer.LATE:
            said = next((each for each in self._held if not fits(each, request)), b"")
        self._held = [*self._held[-3:], right]
        if not self.terminal.heard_something():  # else it would be said to the request that has come meanwhile
            self.terminal.say(said)
            self.nonsense_said += answer is not Answer.RIGHT

    def _wait_until_given_up(self) -> None:
        before = self._timeouts()
        while self._timeouts() == before and not self._stop.is_set() and not self.terminal.heard_something():
            time.sleep(_LOOKS_S)

    def _numbers(self, request: bytes) -> list[int]:
        """Return what the firmware's registers hold: its version, nothing latched, and pressures as said above."""
        if code_of(request) not in _READS:
            return []
        inputs = dict.fromkeys(range(_PLACES), self.request_number % 0x10000)
        inputs[_REGISTERS.input("register_version").address] = _REGISTERS.version
        first, count = _HEAD.unpack_from(request)[2:]
        first -= 0 if code_of(request) == _READ_INPUT else _REGISTERS.mirror
        return [inputs.get(first + place, 0) for place in range(count)]
