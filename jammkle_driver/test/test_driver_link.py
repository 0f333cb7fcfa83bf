"""What the state of the link means for the driver, and what a line waits for."""

from __future__ import annotations

import asyncio
import os
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from pymodbus import ModbusException

from jammkle_common.names import CHANNELS
from jammkle_driver.board.line import Line, LineError
from jammkle_driver.board.wiring import load_wiring
from jammkle_driver.core.driver import Driver
from jammkle_driver.core.faults import Finding, Reason
from jammkle_driver.core.hardware import LinkState, LinkStatus, ResetCause, SafeCause
from jammkle_driver.core.watch import RESTART_REPORTED_S, LinkWatch
from jammkle_driver.parameters import DriverParameters

if TYPE_CHECKING:
    from collections.abc import Callable

HEALTHY = LinkStatus(LinkState.CONNECTED)
LATCHED = LinkStatus(LinkState.CONNECTED, latched=frozenset({SafeCause.HOST_SILENT}))
LOST = LinkStatus(LinkState.LOST, "no such file")


def test_a_board_that_latched_while_idle_is_acknowledged_at_once() -> None:
    """A board that was just plugged in asks nobody for permission: nothing could go on jamming by itself."""
    guard = LinkWatch()
    assert guard.look(LATCHED, jammed=False).acknowledge
    assert not guard.look(HEALTHY, jammed=False).acknowledge


REBOOTED = LinkStatus(LinkState.CONNECTED, latched=frozenset({SafeCause.RESET}), reset_cause=ResetCause.BROWN_OUT)


@pytest.mark.parametrize("broken", [REBOOTED, LOST])
def test_a_safe_state_while_jammed_waits_for_a_person(broken: LinkStatus) -> None:
    """After a fault the latched board stays as it is, also over an unplug, until it is cleared."""
    guard = LinkWatch()
    fault = guard.look(broken, jammed=True).fault
    assert "~/clear_fault" in fault.text
    for link in (broken, LOST, LATCHED, LATCHED):
        assert not guard.look(link, jammed=False).acknowledge
    guard.clear()
    assert guard.look(LATCHED, jammed=False).acknowledge


def test_a_board_that_is_away_while_it_starts_anew_was_not_unplugged() -> None:
    """The reason is put right once, when it answers again; nothing is acknowledged by that."""
    guard = LinkWatch()
    lost = guard.look(LOST, jammed=True).fault
    assert lost.reason is Reason.BOARD_UNPLUGGED
    assert guard.look(LOST, jammed=False).fault is None
    verdict = guard.look(REBOOTED, jammed=False)
    assert verdict.fault.reason is Reason.BROWN_OUT
    assert not verdict.acknowledge
    assert guard.look(REBOOTED, jammed=False).fault is None


def test_a_board_that_had_not_heard_the_driver_is_no_fault() -> None:
    """A driver that stood still is to blame itself: what is asked for again may jam again, without a person."""
    verdict = LinkWatch().look(LATCHED, jammed=True)
    assert verdict.fault is None
    assert "watchdog_ms" in verdict.let_go.text
    assert verdict.acknowledge


def test_a_noisy_line_is_reported_with_its_share() -> None:
    """Wrong check sums are counted over the last seconds, and reported in percent; a clean line says nothing."""
    watch = LinkWatch()

    def look(at_s: float, exchanges: int, crc_errors: int = 0) -> Finding | None:
        watch.count(LinkStatus(LinkState.CONNECTED, exchanges=exchanges, crc_errors=crc_errors), at_s)
        return watch.noise

    assert look(0.0, 100) is None
    assert look(1.0, 600) is None
    noise = look(2.0, 900, 200)
    assert "20 %" in noise.text
    assert noise.values["wrong check sums (share of telegrams)"] == "0.200"
    assert look(20.0, 9000, 200) is None


def test_a_board_that_starts_anew_is_reported_though_nothing_was_jammed() -> None:
    """Not its first start; with its cause, for a minute."""
    watch, anew = LinkWatch(), LinkStatus(LinkState.CONNECTED, starts=2, reset_cause=ResetCause.BROWN_OUT)

    def look(at_s: float, link: LinkStatus = anew) -> Finding | None:
        watch.count(link, at_s)
        return watch.restarted

    assert look(0.0, LinkStatus(LinkState.SEARCHING)) is None
    assert look(1.0, LinkStatus(LinkState.CONNECTED, starts=1)) is None
    reported = look(5.0)
    assert reported.reason is Reason.BROWN_OUT
    assert "brown-out" in reported.text
    assert look(5.0 + RESTART_REPORTED_S - 1.0) is not None
    assert look(5.0 + RESTART_REPORTED_S + 1.0) is None


def test_starts_of_the_next_board_are_counted_from_the_beginning() -> None:
    """After cleanup and configure its count is another one, and a brown-out is reported as before."""
    driver = Driver(CHANNELS, DriverParameters())
    for starts in (1, 2, 3):
        driver.link_watch.count(LinkStatus(LinkState.CONNECTED, starts=starts), 10.0 * starts)
    driver.reset()
    driver.link_watch.count(LinkStatus(LinkState.CONNECTED, starts=1), 1000.0)
    assert driver.link_watch.restarted is None
    driver.link_watch.count(LinkStatus(LinkState.CONNECTED, starts=2, reset_cause=ResetCause.BROWN_OUT), 1010.0)
    assert driver.link_watch.restarted is not None


def test_a_link_that_is_well_asks_for_nothing() -> None:
    """Nothing is failed and nothing acknowledged where nothing is wrong."""
    for jammed in (True, False):
        verdict = LinkWatch().look(HEALTHY, jammed=jammed)
        assert verdict.fault is None
        assert not verdict.acknowledge


def test_a_device_that_does_not_take_its_settings_is_named() -> None:
    """A pseudo terminal has no parity: one line with what was asked for, so that the link tries again."""
    _, device = os.openpty()
    line = Line(os.ttyname(device), replace(load_wiring(None), parity="E"))
    with pytest.raises(LineError, match=r"cannot be set to \d+ baud, parity E, \d stop bits"):
        asyncio.run(line.open())


class SlowClient:
    """Stands for the library's client on a line: replies come in time, or raise a time-out."""

    connected = True

    def __init__(self, trace: Callable[[bool, bytes], bytes]) -> None:
        self.ctx = SimpleNamespace(comm_params=SimpleNamespace(timeout_connect=0.0))
        self.in_time = False
        self.waited_s: list[float] = []
        self._trace = trace

    async def read_input_registers(self, _first: int, *, count: int, device_id: int) -> Any:
        self.waited_s.append(self.ctx.comm_params.timeout_connect)
        if not self.in_time:
            msg = "no reply"
            raise ModbusException(msg)
        self._trace(False, bytes((device_id, 4, 2 * count)))  # noqa: FBT003 - as the library calls it
        return SimpleNamespace(function_code=4, isError=lambda: False, registers=[0] * count)


def test_a_reply_that_comes_late_is_waited_for_longer() -> None:
    """It shows a board that lives, and the wait doubles, up to eightfold; one that never comes changes nothing."""
    line = Line("tcp://board", replace(load_wiring(None), reply_timeout_s=0.001))
    client = line._client = SlowClient(line._trace)

    async def talk() -> None:
        for late in (False, True, True, True, True, False):
            with pytest.raises(LineError):
                await line.read("input", 0, 1)
            if late:
                line._trace(False, b"late")  # noqa: FBT003 - as the library calls it
        client.in_time = True
        for _ in range(200):
            await line.read("input", 0, 1)

    asyncio.run(talk())
    assert client.waited_s[:6] == pytest.approx([0.001, 0.001, 0.002, 0.004, 0.008, 0.008])
    assert client.waited_s[-1] == pytest.approx(0.001)
    assert (line.timeouts, line.late) == (6, 4)
