"""The driver's link to a board: unplugged, rebooted, noisy, silent or somebody else's, it says so and comes back."""

from __future__ import annotations

import asyncio
import math
import os
import signal
import struct
import time
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import pytest
from nonsense import UNIT, Terminal, code_of, frame, is_whole, right_reply

from board_bench import BoardBench
from boards import AVR, JAMMED, RELEASED, Host
from bought_board import OtherBoard
from jammkle_common.command.errors import InputError
from jammkle_common.names import ACHILLES, CHANNELS, PERONEAL_LEFT, PERONEAL_RIGHT
from jammkle_driver.board.line import Line, LineError, check_port, silence_s
from jammkle_driver.board.link import BoardLink
from jammkle_driver.board.protocol import make_protocol
from jammkle_driver.board.wiring import (
    Firmware,
    Pump,
    Sensor,
    Solenoid,
    Wiring,
    load_wiring,
    standard_board_file,
)
from jammkle_driver.core.hardware import ActuatorCommand, BoardFault, LinkState, ResetCause, SafeCause
from test_board_check import OTHER_FIRMWARE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from jammkle_driver.board.protocol import BoardProtocol

HOST_SILENT = frozenset({SafeCause.HOST_SILENT})
WATCHDOG_S = 0.2
"""Silence of the host after which the board lets go, s."""
RATED_EXCHANGES = 30
"""After which the mean rate is known."""


@pytest.fixture
def host(bench: BoardBench, tmp_path: Path) -> Iterator[Host]:  # noqa: ARG001 - to be there first
    made = Host(tmp_path / "board")
    yield made
    made.link.close()


def wait_until(holds: Callable[[], bool], timeout_s: float = 10.0) -> None:
    deadline_s = time.monotonic() + timeout_s
    while not holds():
        assert time.monotonic() < deadline_s
        time.sleep(0.002)


def test_a_jam_reaches_the_pins_and_pressures_come_back(bench: BoardBench, host: Host) -> None:
    """Outputs, pressures, supply, reset cause and faults, all in the exchange, at the rate that the file says."""
    host.jam(bench)

    def evacuated() -> bool:
        # A board that a busy machine ran late has let go meanwhile, and evacuates again.
        pressures_pa = host.exchanges[-1].sensors_pa
        return pressures_pa["manifold"] < 60e3 and all(each < 75e3 for each in pressures_pa.values())

    host.tick_until(evacuated, JAMMED)
    exchange, status = host.exchanges[-1], host.link.status
    assert exchange.taken == ActuatorCommand(JAMMED.solenoids, pytest.approx(0.5, abs=0.01))
    assert status.supply_v == pytest.approx(12.0, abs=0.1)
    assert status.reset_cause is ResetCause.POWER_ON
    assert status.faults == {BoardFault.CALIBRATION_LOST}
    assert (status.starts, status.connects) == (1, 1)


@pytest.mark.skipif(AVR, reason="a simulator that is slower than real time keeps no rate")
def test_the_rate_is_what_the_file_says(bench: BoardBench, tmp_path: Path) -> None:  # noqa: ARG001 - to be there first
    """A quarter of the rate gives less than half of the exchanges; how many there can be is for `make bench`."""
    told_hz = 0.0
    for rate_hz in (25.0, 100.0):
        host = Host(tmp_path / "board", wired=replace(load_wiring(None), rate_hz=rate_hz))
        try:
            host.tick_until(lambda host=host: len(host.exchanges) > RATED_EXCHANGES)
            host.tick_until(lambda host=host, other_hz=told_hz: (host.link.status.rate_hz or 0.0) > 2.0 * other_hz)
            told_hz = host.link.status.rate_hz or 0.0
        finally:
            host.link.close()


def test_a_driver_that_does_not_tick_looks_dead(bench: BoardBench, host: Host) -> None:
    """A command that is not repeated is not passed on: the watchdog ends it, and what it latched is reported."""
    host.jam(bench)
    last_s = time.monotonic()
    wait_until(lambda: bench.released)
    assert bench.edges[-1].at_s - last_s > 0.2  # in the link; then as much in the board
    wait_until(lambda: host.link.status.latched == HOST_SILENT)
    host.tick_until(lambda: host.link.status.refusals > 0, JAMMED)
    assert bench.released
    host.jam(bench)  # acknowledges


def test_an_unplugged_board_is_found_again(bench: BoardBench, host: Host) -> None:
    """Lost within a fraction of a second, safe at the pins, and back by itself with what it has latched."""
    host.jam(bench)
    bench.tell("unplug")
    host.tick_until(lambda: host.link.status.state is LinkState.LOST, JAMMED)
    assert "no device" in host.link.status.detail or "gone" in host.link.status.detail
    wait_until(lambda: bench.released)
    bench.tell("plug")
    host.tick_until(lambda: host.link.status.state is LinkState.CONNECTED, JAMMED)
    host.tick_until(lambda: host.link.status.latched == HOST_SILENT, JAMMED)
    assert bench.released
    assert (host.link.status.starts, host.link.status.connects) == (1, 2)
    host.jam(bench)


def test_a_rebooted_board_is_told_from_a_silent_one(bench: BoardBench, host: Host) -> None:
    """A brown-out: off at once, one start more, its cause, and no jam until acknowledged."""
    host.jam(bench)
    bench.tell("reset 4 30")
    host.tick_until(lambda: host.link.status.starts == 2, JAMMED)
    assert host.link.status.reset_cause is ResetCause.BROWN_OUT
    assert SafeCause.RESET in host.link.status.latched
    assert bench.released
    host.jam(bench)


def test_noise_is_counted_and_lived_with(bench: BoardBench, host: Host) -> None:
    """Some spoiled frames, in either direction, are counted; nothing is latched and nothing let go.

    Unless the machine kept the host waiting for as long as the board's watchdog: then it is tried again.
    """
    for _ in range(10):
        host.jam(bench)
        edges, exchanges = len(bench.edges), len(host.exchanges) - 1
        for direction in ("noise_in", "noise_out"):
            spoiled = host.link.status.crc_errors
            bench.tell(f"{direction} 20")
            host.tick_until(lambda spoiled=spoiled: host.link.status.crc_errors > spoiled, JAMMED)
        host.tick_until(lambda: host.link.status.state is LinkState.CONNECTED, JAMMED)
        own = host.exchanges[exchanges:]
        if max(after.received_s - before.sent_s for before, after in pairwise(own)) < WATCHDOG_S:
            break
    assert not host.link.status.latched
    assert len(bench.edges) == edges


def test_the_link_waits_for_a_board_that_is_not_there_yet(command: list[str], tmp_path: Path) -> None:
    """Started before the board: it says what it is looking for, and takes the board when it comes."""
    host = Host(tmp_path / "board")
    host.tick_until(lambda: "no device" in host.link.status.detail)
    assert host.link.status.state is LinkState.SEARCHING
    with BoardBench(command, tmp_path / "board") as bench:
        host.jam(bench)
        host.link.apply(RELEASED)
        host.link.close()
        wait_until(lambda: bench.released)


def test_the_pause_between_tries_grows_up_to_a_second_and_begins_anew(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A board that is away for long is asked for once a second; one that was just there is tried again soon."""
    pauses_s: list[float] = []

    async def pause(_link: BoardLink, pause_s: float) -> None:
        pauses_s.append(pause_s)
        await asyncio.sleep(0.0)

    monkeypatch.setattr(BoardLink, "_pause", pause)
    host = Host(tmp_path / "board")
    try:
        host.tick_until(lambda: len(pauses_s) >= 7)
        assert pauses_s[:7] == pytest.approx([0.1, 0.2, 0.4, 0.8, 1.0, 1.0, 1.0])
        with BoardBench(command, tmp_path / "board") as bench:
            host.jam(bench)
            pauses_s.clear()
            bench.tell("unplug")
            host.tick_until(lambda: len(pauses_s) >= 3)
            assert pauses_s[:3] == pytest.approx([0.1, 0.2, 0.4])
    finally:
        host.link.close()


def test_a_board_that_stands_still_is_lost_and_comes_back(
    bench: BoardBench, host: Host, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A board that answers nothing, although its device is there, is lost after three requests.

    Its port stays open: to open it again would reset an Arduino again, while its bootloader is still waiting.
    """
    host.jam(bench)
    opened: list[Line] = []
    monkeypatch.setattr(Line, "open", opened.append)
    os.kill(bench.process.pid, signal.SIGSTOP)
    try:
        host.tick_until(lambda: host.link.status.state is LinkState.LOST, JAMMED)
        assert "no reply" in host.link.status.detail
    finally:
        os.kill(bench.process.pid, signal.SIGCONT)
    host.tick_until(lambda: host.link.status.state is LinkState.CONNECTED)
    host.jam(bench)
    assert not opened


OTHER = Wiring(
    firmware=Firmware.OTHER,
    pump=Pump(register=7, at_zero=4000, at_full=20000),
    solenoids={PERONEAL_LEFT: Solenoid(0), PERONEAL_RIGHT: Solenoid(1, inverted=True), ACHILLES: Solenoid(5)},
    sensors={
        PERONEAL_LEFT: Sensor(0, scale=10.0),
        PERONEAL_RIGHT: Sensor(1, scale=-10.0, offset_pa=200e3),
        ACHILLES: Sensor(3, table="holding", signed=True, scale=10.0, vacuum=True, minimum=-100, maximum=9000),
    },
    rate_hz=50.0,
    on_connect={9: 1234},
)


def test_a_bought_board_over_tcp_works_without_our_firmware() -> None:
    """Coils, polarity, a pump on 4 to 20 mA, scale, offset, sign and limits come from the board file alone."""
    board = OtherBoard()
    host = Host(f"tcp://127.0.0.1:{board.port}", wired=OTHER)
    try:
        host.tick_until(lambda: bool(host.exchanges), RELEASED)
        host.tick_until(lambda: board.ask(1, 0, 6)[:2] == [False, True])
        assert board.ask(3, 9, 1) == [1234]
        readings = host.exchanges[-1].sensors_pa
        assert readings[PERONEAL_LEFT] == pytest.approx(101320.0)
        assert readings[PERONEAL_RIGHT] == pytest.approx(101320.0)
        assert readings[ACHILLES] == pytest.approx(-20.0)
        host.tick_until(lambda: board.ask(3, 7, 1) == [12000], JAMMED)
        bits = board.ask(1, 0, 6)
        assert [bits[0], bits[1], bits[5]] == [True, False, True]
        assert host.link.status.latched == frozenset()
        assert host.link.status.reset_cause is None
        board.close()
        host.tick_until(lambda: host.link.status.state is LinkState.LOST, JAMMED)
        board = OtherBoard(board.port)
        host.tick_until(lambda: host.link.status.state is LinkState.CONNECTED, JAMMED)
    finally:
        host.link.close()
        board.close()


def driven(board: OtherBoard) -> tuple[list[bool], int]:
    """Return which solenoids the board energises, and what stands in the register of its pump."""
    bits = board.ask(1, 0, 6)
    return [bits[0], not bits[1], bits[5]], board.ask(3, 7, 1)[0]


@pytest.mark.parametrize(("safe_state", "energised"), [("vent", False), ("hold", True)])
def test_a_bought_board_is_let_go_of_when_the_driver_does_not_tick(safe_state: str, *, energised: bool) -> None:
    """It has no watchdog: the link writes the safe state, says so, and drives nothing until that is acknowledged."""
    board = OtherBoard()
    host = Host(f"tcp://127.0.0.1:{board.port}", wired=OTHER, safe_state=safe_state)
    let_go = ([energised] * 3, 4000)
    try:
        host.tick_until(lambda: driven(board) == ([True] * 3, 12000), JAMMED)
        wait_until(lambda: driven(board) == let_go)
        wait_until(lambda: host.link.status.latched == HOST_SILENT)
        assert host.exchanges[-1].taken == ActuatorCommand(dict.fromkeys(CHANNELS, energised), 0.0)
        ticked = len(host.exchanges)
        host.tick_until(lambda: len(host.exchanges) > ticked + 5, JAMMED)
        assert driven(board) == let_go
        host.tick_until(lambda: driven(board) == ([False] * 3, 4000), RELEASED)
        host.link.acknowledge()
        host.tick_until(lambda: driven(board) == ([True] * 3, 12000), JAMMED)
        assert host.link.status.latched == frozenset()
    finally:
        host.link.close()
        board.close()


WRITE_REGISTER = 6
ILLEGAL_VALUE = 3


class OnceBoard:
    """A bought board on a serial line whose registers take a number once; its first reply waits in `unsaid`."""

    def __init__(self, *, takes: bool = True, shows: bool = False) -> None:
        self.terminal = Terminal()
        self.unsaid = b""
        self.asked = asyncio.Event()
        self._takes, self._shows = takes, shows
        self._taken: dict[int, int] = {}
        self._came = b""

    def answer(self) -> None:
        self._came += self.terminal.take()
        if is_whole(self._came):
            request, self._came = self._came, b""
            reply = self._reply(request)
            if self.unsaid:
                self.terminal.say(reply)
            else:
                self.unsaid = reply
                self.asked.set()

    def _reply(self, request: bytes) -> bytes:
        address, number = struct.unpack_from(">HH", request, 2)
        if code_of(request) != WRITE_REGISTER:
            return right_reply(request, [self._taken.get(address, 0) if self._shows else 0])
        if not self._takes or address in self._taken:
            return frame(bytes((UNIT, WRITE_REGISTER | 0x80, ILLEGAL_VALUE)))
        self._taken[address] = number
        return right_reply(request, [])


async def opened_in_the_end(talk: BoardProtocol) -> str:
    """Open a board, anew where the machine was too busy for its reply."""
    try:
        return await talk.open()
    except LineError as error:
        if "no reply" not in str(error):
            raise
    return await opened_in_the_end(talk)


def opened_again(board: OnceBoard, *, late: bool) -> str:
    """Let the first reply come late, or never, and return what the next try says of the board."""

    async def opened() -> str:
        line = Line(board.terminal.path, replace(OTHER, reply_timeout_s=0.1))
        talk = make_protocol(line, OTHER, "vent")
        asyncio.get_running_loop().add_reader(board.terminal.mine, board.answer)
        try:
            await line.open()
            with pytest.raises(LineError, match="no reply"):
                await talk.open()
            await board.asked.wait()
            if late:
                board.terminal.say(board.unsaid)
                line._free_s = 0.0  # as if this end had stood still since
            return await opened_in_the_end(talk)
        finally:
            asyncio.get_running_loop().remove_reader(board.terminal.mine)
            line.close()

    try:
        return asyncio.run(opened())
    finally:
        board.terminal.close()


@pytest.mark.parametrize(("late", "shows"), [(True, False), (False, True)])
def test_a_bought_board_need_not_take_anew_what_it_has_taken(*, late: bool, shows: bool) -> None:
    """A request was carried out although its reply was late or lost: the reply or the register shows it."""
    assert "taken before: register 9" in opened_again(OnceBoard(shows=shows), late=late)


@pytest.mark.parametrize("late", [True, False])
def test_a_number_that_a_bought_board_has_never_taken_is_a_wrong_board_file(*, late: bool) -> None:
    """Also where a reply was late or lost before."""
    with pytest.raises(LineError, match="writing register 9 refused with exception 3: the board_file does not fit"):
        opened_again(OnceBoard(takes=False), late=late)


def test_a_bought_board_that_stood_still_is_found_again(bench: BoardBench, tmp_path: Path) -> None:
    """It runs on as it was, and refuses the acknowledgement that it took when the link came up first."""
    (tmp_path / "bought.yaml").write_text(OTHER_FIRMWARE)
    host = Host(tmp_path / "board", wired=load_wiring(tmp_path / "bought.yaml"))
    try:
        host.tick_until(lambda: host.link.status.state is LinkState.CONNECTED)
        os.kill(bench.process.pid, signal.SIGSTOP)
        try:
            host.tick_until(lambda: host.link.status.state is LinkState.LOST)
        finally:
            os.kill(bench.process.pid, signal.SIGCONT)
        host.tick_until(lambda: host.link.status.state is LinkState.CONNECTED)
    finally:
        host.link.close()


def test_a_number_outside_its_limits_is_no_pressure() -> None:
    """What a broken wire gives is NaN, which the driver takes for no measurement."""
    sensor = OTHER.sensors[ACHILLES]
    assert math.isnan(sensor.pascals(0x8000))
    assert math.isnan(sensor.pascals(9001))
    assert sensor.pascals(0xFFFF) == -10.0


def test_a_gauge_on_a_mountain_is_no_absolute_pressure_at_sea_level() -> None:
    """A sensor of vacuum counts from the atmosphere that is declared; an absolute one needs none."""
    gauge = replace(OTHER.sensors[ACHILLES], vacuum=True)
    assert gauge.absolute_pa(40e3, 79.5e3) == 39.5e3
    assert replace(gauge, vacuum=False).absolute_pa(39.5e3, 101.3e3) == 39.5e3


def test_the_silence_between_frames_is_that_of_the_standard() -> None:
    """3.5 characters of 11 bits up to 19200 baud, 1.75 ms above."""
    assert silence_s(9600) == pytest.approx(3.5 * 11 / 9600)
    assert silence_s(115200) == 1.75e-3


@pytest.mark.parametrize("port", ["", "ttyUSB0", "tcp://", "tcp://host:port"])
def test_a_port_must_be_a_device_or_an_address(port: str) -> None:
    """Anything else is refused before the graph starts."""
    with pytest.raises(ValueError, match="port is"):
        check_port(port)


GOOD = """
pump: {register: 1}
solenoids: {peroneal_left: {coil: 0}, peroneal_right: {coil: 1}, achilles: {coil: 2}}
sensors: {peroneal_left: {register: 0}, peroneal_right: {register: 1}, achilles: {register: 2}}
"""


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("coil: 1", "coil: 0", "coil 0 is used twice"),
        ("coil: 1", "coil: -1", "0 to 65535"),
        ("coil: 1", "coil: yes", "whole number"),
        ("register: 2", "register: 1", "register 1 is used twice"),
        ("register: 2", "register: 2, scale: 0.0", "scale must not be 0"),
        ("register: 2", "register: 2, unit: 3", "'unit', which means nothing"),
        ("achilles: {coil", "soleus: {coil", "soleus"),
        ("achilles: {register", "soleus: {register", "soleus"),
        ("pump: {register: 1}", "pump: {}", "either register"),
        ("pump: {register: 1}", "pump: 1", "list of names"),
        ("pump: {register: 1}", "pump: {register: 1}\nbaud_rate: 12", "1200 to"),
        ("pump: {register: 1}", "pump: {register: 1}\nparity: X", "N, E, O"),
        ("pump: {register: 1}", "pump: {register: 9}\nfirmware: jammkle", "register 1"),
        ("pump: {register: 1}", "pump: {register: 1", "not YAML"),
        ("pump: {register: 1}", "pump: {register: 1, register: 9}", "'register' stands in line"),
        ("pump: {register: 1}", "pump: {register: 1, at_zero: 5, at_full: 5}", "never change"),
        ("pump: {register: 1}", "pump: {register: 1}\non_connect: {1: 900}", "which is the pump's"),
        ("pump: {register: 1}", "pump: {register: 1, at_zero: 1000, at_full: 0}\nfirmware: jammkle", "would run it"),
        ("pump: {register: 1}", "pump: {register: 1}\nfirmware: jammkle\non_connect: {2: 5000}", "see watchdog_ms"),
        ("pump: {register: 1}", "pump: {register: 1}\nfirmware: jammkle\non_connect: {9: 90}", "hardware check"),
        ("pump: {register: 1}", "pump: {register: 1}\nfirmware: jammkle\nrate_hz: 4", "4, a command each 250 ms.*200"),
        ("achilles: {register: 2}}", "achilles: {register: 2, vacuum: true}}\nfirmware: jammkle", "must be false"),
    ],
)
def test_a_bad_board_file_is_refused_with_one_line(tmp_path: Path, old: str, new: str, words: str) -> None:
    """Whatever is wrong: the file, the place, and what would be right."""
    path = tmp_path / "board.yaml"
    path.write_text(GOOD)
    assert set(load_wiring(path).solenoids) == set(CHANNELS)
    path.write_text(GOOD.replace(old, new))
    with pytest.raises(InputError, match=f"(?s)board.yaml.*{words}") as caught:
        load_wiring(path)
    assert "\n" not in str(caught.value)


def test_the_example_of_a_bought_board_is_good() -> None:
    """What the package ships to start from can be read."""
    wiring = load_wiring(standard_board_file().with_name("board_bought.yaml"))
    assert wiring.firmware is Firmware.OTHER
    assert math.isnan(wiring.sensors[PERONEAL_LEFT].pascals(0))


def test_a_board_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    """With the system's own word."""
    with pytest.raises(InputError, match="No such file"):
        load_wiring(tmp_path / "none.yaml")
