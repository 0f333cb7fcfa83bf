"""The link to the board: a thread that writes outputs, reads sensors and reconnects, so that nobody else ever waits."""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from jammkle_driver.board.line import Line, LineError, RefusedError
from jammkle_driver.board.protocol import make_protocol
from jammkle_driver.core.hardware import LinkState, LinkStatus, SafeCause

if TYPE_CHECKING:
    from collections.abc import Callable

    from jammkle_driver.board.protocol import BoardProtocol, Exchange
    from jammkle_driver.board.wiring import Wiring
    from jammkle_driver.core.hardware import ActuatorCommand

HOST_SILENCE_S = 0.2
"""A command that was not repeated for so long is not passed on any more, s: four ticks of the driver. Its silence then
lets the board's own watchdog run out; to a board without one the safe state is written."""

_FIRST_PAUSE_S = 0.1
_LONGEST_PAUSE_S = 1.0
_LOST_AFTER = 3
"""Requests in a row without a good reply after which the board counts as lost; one alone is noise on the line. Where
this end or a reply was late they are counted anew: a machine that is busy is no board that is gone."""

_CLOSE_TIMEOUT_S = 1.0
_RATE_SHARE = 0.05
"""Weight of the latest cycle in the smoothed rate."""

_CLOCK_SLACK_S, _CLOCK_SLACK = 1.0, 0.01
"""By how much the board's clock may be behind, s, and as a share of the time: a ceramic resonator has 0.5 %."""
_COUNTER_SIZE = 0x10000
_UPTIME_SIZE_S = 2**32 / 1000.0


class BoardLink:
    """Talks to one board from a thread of its own; `status` is what is known of the link now."""

    def __init__(self, port: str, wiring: Wiring, safe_state: str, on_exchange: Callable[[Exchange], None]) -> None:
        """Start to look for the board, whose `safe_state` is to be `vent` or `hold`.

        `on_exchange` is called from the link's own thread after every good cycle; it must not block.
        """
        self._line = Line(port, wiring)
        self._protocol: BoardProtocol = make_protocol(self._line, wiring, safe_state)
        self._period_s = 1.0 / wiring.rate_hz
        self._on_exchange = on_exchange
        self._command: ActuatorCommand | None = None
        self._applied_s = 0.0
        self._acknowledges = False
        self._stops = False
        self._failed_in_a_row = 0
        self._late_replies = 0
        self._unanswered_s: float | None = None
        self._board_crc_errors: int | None = None
        self._crc_at_board = 0
        self._last: tuple[float, float] | None = None
        self._latched: frozenset[SafeCause] = frozenset()
        self._cycled_s: float | None = None
        self._cycle_s: float | None = None
        self.status = LinkStatus(LinkState.SEARCHING, f"looking for a board at {port}")
        self._lock = threading.Lock()
        self._loop = asyncio.new_event_loop()
        self._wake = asyncio.Event()
        self._thread = threading.Thread(target=self._run, name="board link", daemon=True)
        self._thread.start()

    def apply(self, command: ActuatorCommand) -> None:
        """Pass on a command from now on, for as long as it is repeated; a change goes out at once."""
        changed = command != self._command
        self._command = command
        self._applied_s = time.monotonic()
        if changed:
            self._nudge()

    def acknowledge(self) -> None:
        """Acknowledge what the board has latched, before the next command goes out.

        From now on it counts as not latched, so that a jam that is asked for at once is not taken for one that the
        board refuses. What the board latches anew, or does not let be acknowledged, comes with the next exchange.
        """
        with self._lock:
            self._acknowledges = True
            self.status = replace(self.status, latched=frozenset())
        self._nudge()

    def close(self) -> None:
        """Send the last command, then let go; waits for at most a second."""
        self._stops = True
        self._nudge()
        self._thread.join(_CLOSE_TIMEOUT_S)

    def _update(self, **changes: Any) -> None:
        with self._lock:
            if self._acknowledges and "latched" in changes:
                changes["latched"] = frozenset()  # read before the acknowledgement went out
            self.status = replace(self.status, **changes)

    def _nudge(self) -> None:
        with contextlib.suppress(RuntimeError):  # the thread has ended
            self._loop.call_soon_threadsafe(self._wake.set)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._talk())
        except BaseException as error:
            self._lost(f"the link has ended: {error!r}; a defect of the driver, start it anew")
            raise
        finally:
            self._line.close()
            self._loop.run_until_complete(asyncio.sleep(0.0))
            self._loop.close()

    async def _talk(self) -> None:
        pause_s = _FIRST_PAUSE_S
        while not self._stops:
            connects = self.status.connects
            why = await self._talk_once()
            if self._stops:
                return
            if self.status.connects > connects:
                pause_s = _FIRST_PAUSE_S
            self._line.let_go()
            self._lost(f"{why}; trying again every {pause_s:g} s")
            await self._pause(pause_s)
            pause_s = min(2.0 * pause_s, _LONGEST_PAUSE_S)

    async def _talk_once(self) -> str:
        """Connect and exchange for as long as it lasts; return why it ended."""
        try:
            if not self._line.is_open:
                await self._line.open()
            said = await self._protocol.open()
            self._take(await self._protocol.exchange(None))  # what it has latched is known before it counts as there
            self._connected(said)
            await self._cycles()
        except (LineError, RefusedError) as error:
            return str(error)
        return "closed"

    async def _pause(self, pause_s: float) -> None:
        """Wait; a command that changes is no reason to try earlier, the end is."""
        until_s = self._loop.time() + pause_s
        while not self._stops and (left_s := until_s - self._loop.time()) > 0.0:
            await self._wait(left_s)

    async def _wait(self, timeout_s: float) -> None:
        try:
            await asyncio.wait_for(self._wake.wait(), timeout_s)
        except asyncio.TimeoutError:
            return
        self._wake.clear()

    async def _cycles(self) -> None:
        """Exchange again and again until the board is lost (LineError) or the link is closed."""
        due_s = self._loop.time()
        while True:
            if (left_s := due_s - self._loop.time()) > 0.0:
                await self._wait(left_s)
            due_s = max(due_s + self._period_s, self._loop.time())
            last = self._stops
            await self._cycle()
            if last:
                return

    async def _cycle(self) -> None:
        # A board that is asked for a last time gets its command however old it is.
        # A reply carries no number: it may be a late one to the first request that was not answered.
        sent_s = time.monotonic() if self._unanswered_s is None else self._unanswered_s
        fresh = self._stops or time.monotonic() - self._applied_s < HOST_SILENCE_S
        try:
            if self._acknowledges:
                await self._acknowledge()
                self._acknowledges = False  # a line that lost it is asked again
            last = self._command
            exchange = await (self._protocol.exchange(last) if fresh else self._protocol.exchange_stale(last))
        except LineError as error:
            busy = error.host_was_late or self._line.late > self._late_replies
            self._late_replies = self._line.late
            self._failed_in_a_row = 0 if busy else self._failed_in_a_row + 1
            self._unanswered_s = sent_s
            self._count()
            if self._failed_in_a_row >= _LOST_AFTER or not self._line.is_open:
                raise
            return
        self._failed_in_a_row = 0
        self._unanswered_s = None
        exchange = replace(exchange, sent_s=sent_s, received_s=time.monotonic())
        self._take(exchange)
        self._on_exchange(exchange)

    async def _acknowledge(self) -> None:
        """Acknowledge. A refusal means that something else was latched meanwhile, which the next cycle reads."""
        try:
            await self._protocol.acknowledge()
        except RefusedError:
            return
        self._latched = frozenset()  # a start that is latched from now on is a new one

    def _connected(self, said: str) -> None:
        self._failed_in_a_row = 0
        self._acknowledges = False  # of what was latched before; what is latched now nobody has seen yet
        self._update(state=LinkState.CONNECTED, detail=said, connects=self.status.connects + 1)

    def _lost(self, why: str) -> None:
        found = self.status.connects > 0
        self._update(state=LinkState.LOST if found else LinkState.SEARCHING, detail=why)
        self._cycled_s = self._cycle_s = self._unanswered_s = None
        self._count()

    def _take(self, exchange: Exchange) -> None:
        now_s = time.monotonic()
        self._measure_rate(now_s)
        state, before, self._latched = exchange.state, self._latched, exchange.latched
        if state is None:
            self._update(latched=exchange.latched)
            self._count()
            return
        # A board that starts anew soon after it had started may have the same uptime when it is asked again.
        latched_start = SafeCause.RESET in exchange.latched and SafeCause.RESET not in before
        started = int(latched_start or self._has_started(state.uptime_s, now_s))
        self._last = (now_s, state.uptime_s)
        at_board = 0
        if self._board_crc_errors is not None and not started:
            at_board = (state.crc_errors - self._board_crc_errors) % _COUNTER_SIZE
        self._board_crc_errors = state.crc_errors
        self._update(
            starts=self.status.starts + started,
            reset_cause=state.reset_cause,
            latched=exchange.latched,
            faults=state.faults,
            supply_v=state.supply_v,
        )
        self._count(at_board)

    def _has_started(self, uptime_s: float, now_s: float) -> bool:
        """Whether the board has started since its last answer; its uptime turns over after 50 days."""
        if self._last is None:
            return True
        answered_s, last_uptime_s = self._last
        missing_s = (last_uptime_s + now_s - answered_s - uptime_s) % _UPTIME_SIZE_S
        back_s = (last_uptime_s - uptime_s) % _UPTIME_SIZE_S
        slack_s = _CLOCK_SLACK_S + _CLOCK_SLACK * (now_s - answered_s)
        return any(low_s < each_s < _UPTIME_SIZE_S / 2 for each_s, low_s in ((missing_s, slack_s), (back_s, 0.0)))

    def _measure_rate(self, now_s: float) -> None:
        last_s, self._cycled_s = self._cycled_s, now_s
        if last_s is not None:
            cycle_s = now_s - last_s
            self._cycle_s = (
                cycle_s if self._cycle_s is None else self._cycle_s + _RATE_SHARE * (cycle_s - self._cycle_s)
            )

    def _count(self, at_board: int = 0) -> None:
        self._crc_at_board += at_board
        self._update(
            exchanges=self._line.answered,
            crc_errors=self._line.damaged + self._crc_at_board,
            timeouts=self._line.timeouts,
            refusals=self._line.refusals,
            rate_hz=None if not self._cycle_s else 1.0 / self._cycle_s,
        )
