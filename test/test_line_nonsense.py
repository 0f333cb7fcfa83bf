"""The driver's end of the line: whatever answers, nothing is taken for what it is not, and the link comes back."""

from __future__ import annotations

import asyncio
import logging
import random
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nonsense import Answer, NonsenseBoard, Terminal, fits, is_whole, nonsense, reads, right_reply

from boards import TIMEOUT_S, Host
from jammkle_driver.board.line import Line, LineError, RefusedError
from jammkle_driver.board.wiring import load_wiring
from jammkle_driver.core.hardware import LinkState

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Iterator

    from jammkle_driver.board.protocol import Exchange

LINE = replace(load_wiring(None), reply_timeout_s=0.01)
"""Little patience, so that many requests without a reply are soon over."""

LINK = replace(load_wiring(None), reply_timeout_s=0.05)
NOW_AND_THEN = 0.15
"""Share of nonsense with which a link is lost now and then, and found again: three of it in a row lose it."""

ENOUGH = 40
"""Of the fourteen kinds almost three each."""

HANGS_S = 60.0

ADDRESS = st.integers(0, 3)
NUMBERS = st.lists(st.integers(0, 3), min_size=1, max_size=3)
REQUEST = st.one_of(
    st.tuples(st.just("read"), st.tuples(st.sampled_from(("input", "holding")), ADDRESS, st.integers(1, 30))),
    st.tuples(st.just("write_register"), st.tuples(ADDRESS, st.integers(0, 3))),
    st.tuples(st.just("write"), st.tuples(ADDRESS, NUMBERS)),
    st.tuples(st.just("write_coils"), st.tuples(ADDRESS, st.lists(st.booleans(), min_size=1, max_size=9))),
    st.tuples(st.just("write_and_read"), st.tuples(ADDRESS, NUMBERS, ADDRESS, st.integers(1, 30))),
)
EACH_REQUEST: tuple[tuple[str, tuple[Any, ...]], ...] = (
    ("read", ("input", 0, 4)),
    ("read", ("holding", 0, 4)),
    ("write_register", (2, 500)),
    ("write_register", (2, 501)),
    ("write", (0, [1, 2])),
    ("write_coils", (0, [True, False, True])),
    ("write_and_read", (0, [7, 500], 256, 9)),
    ("write_and_read", (0, [7, 500], 256, 13)),
)


@dataclass(frozen=True)
class Step:
    """A request, what is said to it, and whether a late reply to an earlier one lies in the line before it is sent."""

    request: tuple[str, tuple[Any, ...]]
    answer: Answer
    seed: int
    lies_there: bool = False


STEPS = st.lists(
    st.builds(Step, REQUEST, st.sampled_from(Answer), st.integers(0, 2**32 - 1), st.booleans()),
    min_size=1,
    max_size=8,
)


class Peer:
    """The other end of a line, in the same loop: what it says to the next request is decided before that is sent."""

    def __init__(self, terminal: Terminal) -> None:
        self.terminal = terminal
        self.step = Step(EACH_REQUEST[0], Answer.RIGHT, 0)
        self.numbers: list[int] = []
        self.said = b""
        self._held: list[bytes] = []
        self._heard = b""
        asyncio.get_running_loop().add_reader(terminal.mine, self._listen)

    def begin(self, step: Step) -> None:
        """Say that to the next request. Half of an earlier one is forgotten, as by a board after a silence."""
        self.terminal.take()
        self.step, self.numbers, self.said, self._heard = step, [], b"", b""

    def leave_in_the_line(self) -> None:
        """Say the latest reply that was held back; return when it lies before the reader."""
        if self._held:
            self.terminal.say(self._held[-1])
            wait_until(lambda: self.terminal.lies_there() > 0)

    def _listen(self) -> None:
        self._heard += self.terminal.take()
        if is_whole(self._heard):
            request, self._heard = self._heard, b""
            self._answer(request)

    def _answer(self, request: bytes) -> None:
        chance = random.Random(self.step.seed)  # noqa: S311 - no secret
        self.numbers = [chance.randrange(0x10000) for _ in range(reads(request))]
        right = right_reply(request, self.numbers)
        if self.step.answer is Answer.RIGHT:
            self.said = right
        elif self.step.answer is Answer.LATE:
            self.said = next((each for each in self._held if not fits(each, request)), b"")
        else:
            self.said = nonsense(self.step.answer, request, right, chance)
            self._held.append(right)
        self.terminal.say(self.said)


class Unseen(logging.Handler):
    """Keeps what asyncio says of that which was raised where nobody waits for it."""

    def __init__(self) -> None:
        super().__init__()
        self.said: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.said.append(record.getMessage())


def wait_until(holds: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + TIMEOUT_S
    while not holds():
        assert time.monotonic() < deadline_s
        time.sleep(0.0005)


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    made = Terminal()
    yield made
    made.close()


def talk_over(terminal: Terminal, talk: Callable[[Line, Peer], Coroutine[Any, Any, None]]) -> None:
    """Open a line to a peer and talk; nothing hangs, and nothing is raised where nobody waits for it."""
    unseen, logger = Unseen(), logging.getLogger("asyncio")

    async def whole() -> None:
        peer, line = Peer(terminal), Line(terminal.path, LINE)
        try:
            await line.open()
            await talk(line, peer)
        finally:
            line.close()

    logger.addHandler(unseen)
    try:
        asyncio.run(asyncio.wait_for(whole(), HANGS_S))
    finally:
        logger.removeHandler(unseen)
    assert unseen.said == []


async def ask(line: Line, peer: Peer, step: Step) -> None:
    """Send a request, and hold what comes of it, and what is counted, to what was said."""
    peer.begin(step)
    if step.lies_there:
        peer.leave_in_the_line()
    name, arguments = step.request
    answered, others, refusals = line.answered, line.damaged + line.timeouts, line.refusals
    refused_with = None
    try:
        numbers = await getattr(line, name)(*arguments)
    except RefusedError as error:
        refused_with = error.code
        answered, refusals = answered + 1, refusals + 1
    except LineError:
        others += 1
    else:
        assert step.answer is Answer.RIGHT, f"{step}: '{peer.said.hex(' ')}' was taken for a reply"
        assert list(numbers or ()) == peer.numbers  # of a write there are none
        answered += 1
    if refused_with is not None:
        assert (step.answer, refused_with) == (Answer.EXCEPTION, peer.said[2])
    assert (line.answered, line.damaged + line.timeouts, line.refusals) == (answered, others, refusals)


@given(steps=STEPS)
@settings(max_examples=60)
def test_nothing_is_taken_for_a_reply_that_is_none(steps: list[Step]) -> None:
    """Only a right reply is one; all else is an error that is counted once. Then a good peer is understood again."""
    terminal = Terminal()

    async def talk(line: Line, peer: Peer) -> None:
        for step in steps:
            await ask(line, peer, step)
        before = line.answered
        deadline_s = time.monotonic() + TIMEOUT_S
        while line.answered == before:  # a busy machine may let a reply come late
            assert time.monotonic() < deadline_s
            await ask(line, peer, Step(EACH_REQUEST[0], Answer.RIGHT, 1))

    try:
        talk_over(terminal, talk)
    finally:
        terminal.close()


@pytest.mark.parametrize("answer", Answer)
def test_each_kind_of_nonsense_is_reported_from_a_reply(terminal: Terminal, answer: Answer) -> None:
    """Every kind to every request: none is left to what is drawn above."""

    async def talk(line: Line, peer: Peer) -> None:
        for seed, request in enumerate(EACH_REQUEST):
            await ask(line, peer, Step(request, Answer.SILENCE, seed))
            await ask(line, peer, Step(request, answer, seed))

    talk_over(terminal, talk)


def test_what_lay_in_the_line_before_is_no_reply(terminal: Terminal) -> None:
    """A reply to an earlier request that is read only after the next was sent, as after a stall, is thrown away."""

    async def talk(line: Line, peer: Peer) -> None:
        for seed in range(5):
            await ask(line, peer, Step(EACH_REQUEST[0], Answer.SILENCE, seed))
            left_alone_s = time.monotonic() + 2.0 * LINE.reply_timeout_s
            wait_until(lambda left_alone_s=left_alone_s: time.monotonic() > left_alone_s)  # a stall of the whole loop
            await ask(line, peer, Step(EACH_REQUEST[0], Answer.SILENCE, seed + 100, lies_there=True))

    talk_over(terminal, talk)


class Readings:
    """What the link hands over, each held to the request that is on the line at that moment."""

    def __init__(self) -> None:
        self.taken = 0
        self.wrong: list[tuple[int, dict[str, int]]] = []
        self.board: NonsenseBoard | None = None

    def take(self, exchange: Exchange) -> None:
        assert self.board is not None
        number = self.board.request_number
        self.taken += 1
        if set(exchange.numbers.values()) != {number % 0x10000}:
            self.wrong.append((number, dict(exchange.numbers)))


@pytest.mark.parametrize("seed", range(2))
def test_the_link_lives_through_nonsense_and_comes_back(seed: int) -> None:
    """No reading of another request, errors counted, and a link as before once a good board answers again."""
    readings = Readings()
    host: Host | None = None
    board = NonsenseBoard(seed, lambda: host.link.status.timeouts if host else 0)
    readings.board = board
    try:
        host = Host(board.terminal.path, wired=LINK, on_exchange=readings.take)
        link = host.link
        host.tick_until(lambda: link.status.state is LinkState.CONNECTED and readings.taken > 10)
        good = link.status
        board.nonsense_share = NOW_AND_THEN
        host.tick_until(lambda: board.nonsense_said > ENOUGH and link.status.refusals > good.refusals, timeout_s=120.0)
        board.nonsense_share = 1.0
        host.tick_until(lambda: link.status.state is LinkState.LOST)
        bad = link.status
        board.nonsense_share = 0.0
        host.tick_until(lambda: link.status.state is LinkState.CONNECTED)
        taken = readings.taken
        host.tick_until(lambda: readings.taken > taken + 10)
    finally:
        if host:
            host.link.close()
        board.close()
    assert readings.wrong == []
    assert bad.crc_errors > good.crc_errors
    assert bad.timeouts > good.timeouts
    assert bad.refusals > good.refusals
