"""The board's firmware over its serial line, in real bytes: functions, exceptions, safe state, and any nonsense."""

from __future__ import annotations

import subprocess
import time
from typing import TYPE_CHECKING

import pytest
import serial
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymodbus.framer.rtu import FramerRTU

from board_bench import BoardBench
from board_client import (
    ACKNOWLEDGE,
    FIRST_SENSOR,
    HOST_SILENT,
    LATCHED,
    REGISTERS,
    RESET,
    SAFE_STATE,
    STORE,
    wait_for_pins,
)
from boards import AVR, board_command, build
from jammkle_driver.board.wiring import default_watchdog_s
from jammkle_sim.topics import WATCHDOG_S

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from board_client import Client

JAMMED_OUTPUTS, JAMMED_DUTY = 7, 500


@pytest.fixture(scope="module")
def command(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Build the board with the compiler's address and undefined-behaviour sanitisers; what runs it."""
    folder = tmp_path_factory.mktemp("sanitised")
    if AVR:
        return board_command(folder)
    build(folder, "sanitised")
    return [str(folder / "board_sanitised")]


@pytest.fixture
def bench(command: list[str], tmp_path: Path) -> Iterator[BoardBench]:
    """Run that board with a plant behind its pins. A byte out of place ends it, and a leak its exit code tells."""
    with BoardBench(command, tmp_path / "board", store=tmp_path / "store") as made:
        yield made
        assert made.process.poll() is None
    assert AVR or made.process.returncode == 0


class Raw:
    """A client that says exactly the bytes it is given."""

    def __init__(self, port: Path) -> None:
        self.port = serial.Serial(str(port), 115200, timeout=0.5)

    def say(self, frame: bytes) -> bytes:
        self.port.reset_input_buffer()
        self.port.write(frame)
        return bytes(self.port.read(256)) if len(frame) == 0 else bytes(self._reply())

    def _reply(self) -> bytes:
        reply = self.port.read(1)
        self.port.timeout = 0.02
        reply += self.port.read(256)
        self.port.timeout = 0.5
        return bytes(reply)


def frame(*data: int, unit: int = 1) -> bytes:
    """Return a frame with its check sum."""
    body = bytes((unit, *data))
    return body + FramerRTU.compute_CRC(body).to_bytes(2, "big")


def test_every_function_of_the_standard_does_its_work(bench: BoardBench, client: Client) -> None:
    """Functions 1 to 6, 15, 16, 23 and 8/0 over real bytes reach the pins and read them back."""
    client.patient()
    modbus = client.modbus
    assert not modbus.write_coil(1, value=True).isError()
    wait_for_pins(bench, 0b010)
    assert modbus.read_coils(0, count=3).bits[:3] == [False, True, False]
    assert modbus.read_discrete_inputs(0, count=5).bits[:5] == [False, True, False, False, False]
    assert not modbus.write_coils(0, [True, False, True]).isError()
    wait_for_pins(bench, 0b101)
    assert not modbus.write_register(1, 400).isError()
    assert modbus.read_holding_registers(0, count=3).registers == [0b101, 400, 5000]
    assert client.write(0, 0b111, 250) == 0
    wait_for_pins(bench, 0b111)
    reply = modbus.readwrite_registers(
        read_address=REGISTERS.mirror, read_count=9, write_address=0, values=[0b001, 100]
    )
    assert reply.registers[6:8] == [0b001, 100]
    assert reply.registers[8] == pytest.approx(12000, abs=50)
    wait_for_pins(bench, 0b001)
    assert modbus.diag_query_data(b"\xca\xfe").message == b"\xca\xfe"
    deadline_s = time.monotonic() + 5.0
    while abs(bench.edges[-1].duty - 0.1) > 0.005:
        assert time.monotonic() < deadline_s
    pressures = [2 * number for number in client.inputs(0, 4)]
    assert all(60e3 < pressure_pa < 110e3 for pressure_pa in pressures)


@pytest.mark.parametrize(
    ("request_data", "exception"),
    [
        ((7,), 1),  # read exception status: not there
        ((8, 0, 1, 0, 0), 1),  # sub-function 1
        ((1, 0, 0, 0, 4), 2),  # one coil too many
        ((3, 0, 20, 0, 5), 2),
        ((4, 0xFF, 0xFF, 0, 2), 2),  # past the end of all addresses
        ((6, 0, 200, 0, 0), 2),
        ((15, 0, 1, 0, 3, 1, 7), 2),
        ((16, 0, 23, 0, 2, 4, 0, 0, 0, 0), 2),
        ((23, 2, 0, 0, 1, 0, 0, 0, 1, 2, 0, 7), 2),  # reads what is not there, and so writes nothing
        ((1, 0, 0, 0, 0), 3),
        ((3, 0, 0, 0, 126), 3),
        ((5, 0, 0, 0x12, 0x34), 3),
        ((6, 0, 1, 0x03, 0xE9), 3),  # duty of 1001 thousandths
        ((6, 0, 3, 0, 1), 3),  # acknowledges what is not latched
        ((15, 0, 0, 0, 3, 2, 7, 0), 3),  # byte count does not fit
        ((16, 0, 0, 0, 2, 4, 0, 0), 3),  # shorter than it says
        ((16, 0, 8, 0, 1, 2, 0x3F, 0xF0), 3),  # first point of a sensor above its second
    ],
)
def test_what_cannot_be_done_is_answered_with_its_exception(
    bench: BoardBench, client: Client, tmp_path: Path, request_data: tuple[int, ...], exception: int
) -> None:
    """Illegal function, address and value get their codes, and nothing is driven."""
    client.patient()
    client.modbus.close()
    raw = Raw(tmp_path / "board")
    assert raw.say(frame(*request_data)) == frame(request_data[0] | 0x80, exception)
    assert bench.released


def test_frames_for_others_and_damaged_ones_stay_unanswered(bench: BoardBench, client: Client, tmp_path: Path) -> None:
    """Another unit, a wrong check sum, two frames without a silence: no reply, counted. A broadcast is carried out."""
    client.patient()
    errors = REGISTERS.input("check_sum_errors").address
    before = client.inputs(errors)[0]
    raw = Raw(tmp_path / "board")
    assert raw.say(frame(4, 0, 0, 0, 1, unit=2)) == b""
    damaged = bytearray(frame(4, 0, 0, 0, 1))
    damaged[3] ^= 0x10
    assert raw.say(bytes(damaged)) == b""
    assert raw.say(frame(4, 0, 0, 0, 1) * 2) == b""
    assert raw.say(frame(5, 0, 0, 0xFF, 0, unit=0)) == b""
    raw.port.close()
    wait_for_pins(bench, 1)
    assert client.inputs(errors)[0] == before + 2


def test_a_jam_needs_the_acknowledgement_of_what_is_latched(bench: BoardBench, client: Client) -> None:
    """Until then a jam is refused and a release is taken; another cause acknowledges nothing."""
    client.acknowledge()
    assert client.write(0, 7, 500, 200) == 0
    wait_for_pins(bench, 7)
    wait_for_pins(bench, 0)
    assert client.latched() == HOST_SILENT
    assert client.write(0, 7, 500) == 4  # device failure: not without an acknowledgement
    assert client.write(ACKNOWLEDGE, RESET) == 3  # of something else
    assert client.write(0, 0, 0) == 0  # releasing is always allowed
    assert client.write(ACKNOWLEDGE, HOST_SILENT) == 0
    assert client.write(0, 7, 500) == 0
    wait_for_pins(bench, 7)


def test_reading_is_no_sign_of_life(bench: BoardBench, client: Client) -> None:
    """Who only reads, and who writes what is refused, does not keep a jam alive."""
    client.acknowledge()
    client.write(0, 7, 500)
    wait_for_pins(bench, 7)
    deadline_s = time.monotonic() + 5.0
    while not bench.released:
        assert time.monotonic() < deadline_s
        client.inputs(0, 4)
        assert client.write(1, 2000) == 3
    assert client.latched() == HOST_SILENT


def test_hold_keeps_the_solenoids_and_stops_the_pump(bench: BoardBench, client: Client) -> None:
    """With safe_state 1 a silent host leaves the tendons connected; a reset vents all the same."""
    client.acknowledge()
    client.write(SAFE_STATE, 1)
    client.write(0, 7, 500, 200)
    wait_for_pins(bench, 7)
    deadline_s = time.monotonic() + 5.0
    while bench.edges[-1].duty > 0.0:
        assert time.monotonic() < deadline_s
        time.sleep(0.001)
    assert bench.edges[-1].solenoids == 7
    assert client.latched() == HOST_SILENT
    bench.tell("reset 2 20")
    wait_for_pins(bench, 0)


def test_a_calibration_is_kept_over_a_reset(bench: BoardBench, client: Client) -> None:
    """Two points turn raw numbers into pressure; once stored they outlast a reset, unless something was driven."""
    client.patient()
    faults = LATCHED + 1
    assert client.inputs(faults)[0] & 2
    assert client.write(0, 1) == 0
    assert client.write(STORE, 1) == 6  # busy: a jam would wait for the memory
    assert client.write(0, 0) == 0
    assert client.write(FIRST_SENSOR, 0, 0, 16368, 65535) == 0
    assert client.write(STORE, 1) == 0
    bench.tell("reset 2 20")
    latched, fault_bits = client.patient_inputs(LATCHED, 2)
    assert latched & RESET
    assert not fault_bits & 2
    raw, pressure = client.inputs(REGISTERS.input("raw_1").address)[0], client.inputs(0)[0]
    assert pressure == pytest.approx(raw * 65535 / 16368, abs=200)


def test_more_bytes_than_a_frame_may_have_stay_unanswered(bench: BoardBench, client: Client, tmp_path: Path) -> None:
    """Of a frame of 300 bytes nothing is kept past the 256 that there is room for, and the next one is understood."""
    client.patient()
    raw = Raw(tmp_path / "board")
    assert raw.say(frame(4, *bytes(297))) == b""
    raw.port.close()
    assert client.latched() == 0
    assert bench.released


NEARLY_WRITES = (
    (5, 0, 3, 0xFF, 0),  # a coil that is not there
    (6, 0, 0, 0, 8),  # a solenoid that is not there
    (6, 0, 1, 0x03, 0xE9),  # a duty of 1001 thousandths
    (15, 0, 0, 0, 3, 2, 0, 0),  # byte count does not fit
    (16, 0, 0, 0, 2, 4, 0, 0, 0x03, 0xE9),  # a release, with a duty that cannot be
    (16, 0, 0, 0, 2, 4, 0, 1),  # shorter than it says
    (23, 2, 0, 0, 1, 0, 0, 0, 1, 2, 0, 1),  # reads what is not there
)
"""Requests that would change an output if they were taken; each must be refused as a whole."""

WRITES = (5, 6, 15, 16, 23)
READS_AND_UNKNOWN = (1, 2, 3, 4, 7, 8, 43, 0x83)
NONSENSE = st.one_of(
    st.binary(min_size=1, max_size=280),
    st.sampled_from(NEARLY_WRITES).map(lambda data: frame(*data)),
    st.sampled_from(NEARLY_WRITES).map(lambda data: frame(*data, unit=0)),
    st.tuples(st.sampled_from(READS_AND_UNKNOWN), st.binary(max_size=30)).map(lambda pair: frame(pair[0], *pair[1])),
    st.tuples(st.sampled_from(WRITES), st.integers(2, 255), st.binary(max_size=30)).map(
        lambda one: frame(one[0], one[1], *one[2])  # past the end of all addresses
    ),
)
"""Bytes of any kind, and frames with the right check sum of which none may be carried out."""


@given(frames=st.lists(NONSENSE, min_size=1, max_size=8))
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_no_nonsense_on_the_line_drives_anything(
    bench: BoardBench, client: Client, tmp_path: Path, frames: list[bytes]
) -> None:
    """Of a jammed board nonsense changes no output, and does not keep it jammed: it is off once its watchdog expires.

    Then it stays off whatever it receives, and answers the next good request.
    """
    client.acknowledge()
    began = len(bench.edges)
    assert client.write(0, JAMMED_OUTPUTS, JAMMED_DUTY) == 0
    raw = serial.Serial(str(tmp_path / "board"), 115200, timeout=0.0, exclusive=False)
    deadline_s = time.monotonic() + 10.0
    heard_after = 0
    while heard_after < len(frames):
        assert time.monotonic() < deadline_s, bench.edges[began:]
        for nonsense in frames:
            raw.write(nonsense)
            time.sleep(0.004 + len(nonsense) * 1e-4)
            heard_after += bench.released and len(bench.edges) > began
    raw.close()
    time.sleep(0.03)
    assert client.patient_inputs(LATCHED, 1)[0] == HOST_SILENT
    driven = [(edge.solenoids, round(edge.duty, 2)) for edge in bench.edges[began:]]
    assert (JAMMED_OUTPUTS, JAMMED_DUTY / 1000.0) in driven
    assert set(driven) <= {
        (JAMMED_OUTPUTS, 0.0),
        (0, JAMMED_DUTY / 1000.0),
        (JAMMED_OUTPUTS, JAMMED_DUTY / 1000.0),
        (0, 0.0),
    }
    off = driven.index((0, 0.0))
    assert driven[off:] == [(0, 0.0)]


def test_every_board_lets_go_after_the_same_silence() -> None:
    """The simulated ankle's, which knows nothing of registers, is the firmware's default."""
    assert default_watchdog_s() == WATCHDOG_S


@pytest.fixture(scope="module")
def fuzzer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the fuzzer once for all seeds."""
    folder = tmp_path_factory.mktemp("fuzzer")
    build(folder, "fuzz")
    return folder / "fuzz"


@pytest.mark.skipif(AVR, reason="the fuzzer runs the core on this machine")
@pytest.mark.parametrize("seed", range(5))
def test_a_hundred_thousand_frames_do_no_harm(fuzzer: Path, seed: int) -> None:
    """The fuzzer, with the compiler's sanitisers: no crash, no hang, no output while the safe state is latched."""
    result = subprocess.run(
        [str(fuzzer), "100000", str(seed)], capture_output=True, text=True, check=False, timeout=120
    )
    assert result.returncode == 0, result.stderr
    assert "100000 frames" in result.stdout
