"""Delays on the real line: from a service call, and from the IMU sample of an impact, to the coils' bytes on the line.

The firmware runs as a process behind a pseudo terminal that it reads and writes at the pace of 115200 baud. The last
byte of the coils' request is on the line 3.5 characters of silence before its pin moves, which is what is seen here.
Beside it, in the same run: the round trip to a bare subscriber, and that of one cycle's bytes on the line.
"""

from __future__ import annotations

import random
import statistics
import tempfile
import time
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import serial
from pymodbus.framer.rtu import FramerRTU
from std_srvs.srv import SetBool

from board_bench import BoardBench
from boards import RELEASED, Host, board_command
from delay import GROUND_S, Stimulus
from echo import ECHO, MARK
from graph import running
from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_common.names import ACHILLES, CHANNEL_JAMS, CHANNELS
from jammkle_driver.board.line import silence_s
from jammkle_driver.board.wiring import load_wiring, register_list
from jammkle_msgs.msg import ChannelJamState
from landing_imu import IMPACT_M_S2

if TYPE_CHECKING:
    from collections.abc import Sequence

BAUD = 115200
SERVICE_TRIALS = 300
IMPACT_TRIALS = 300
SERIAL_TRIALS = 300
RATE_S = 3.0
LONGEST_FALL_SAMPLES = 250
RECOVERY_SAMPLES = 1000
LONGEST_PAUSE_S = 0.02
"""Before a call: two cycles, so that it does not follow the last one's pin at the same moment of a cycle each time."""
ACHILLES_BIT = 1 << CHANNELS.index(ACHILLES)


@dataclass(frozen=True)
class Ratio:
    """Of medians, and of 99th percentiles, 1."""

    median: float
    p99: float


@dataclass(frozen=True)
class Percentiles:
    """Median and 99th percentile, ms."""

    median_ms: float
    p99_ms: float

    @classmethod
    def of(cls, delays_s: Sequence[float]) -> Percentiles:
        """Return those of some delays, s."""
        return cls(1e3 * statistics.median(delays_s), 1e3 * statistics.quantiles(delays_s, n=100)[98])

    def over(self, *others: Percentiles) -> Ratio:
        """Return both over the sums of the others': median over medians, percentile over percentiles."""
        return Ratio(
            self.median_ms / sum(each.median_ms for each in others), self.p99_ms / sum(each.p99_ms for each in others)
        )


@dataclass(frozen=True)
class LineDelays:
    """Delays to the coils' bytes, bare round trips in the same run, ratios, and the rate of a whole cycle, 1/s."""

    service: Percentiles
    impact: Percentiles
    graph: Percentiles
    serial: Percentiles
    service_over_bare: Ratio
    impact_over_bare: Ratio
    cycle_rate_hz: float
    impacts_lost: int


class BoardStimulus(Stimulus):
    """Plays the IMU, and calls services; what comes of it is seen at the board's pins."""

    def __init__(self, domain_id: int, bench: BoardBench) -> None:
        super().__init__(domain_id)
        self._bench = bench
        self._random = random.Random(2)  # noqa: S311 - when somebody calls
        self._client = self.node.create_client(SetBool, CHANNEL_JAMS[ACHILLES].path)

    def rose_s(self, since_s: float) -> float:
        """Return when the solenoid was energised after a moment; 0: not yet."""
        return next((e.at_s for e in self._bench.edges if e.at_s > since_s and e.solenoids & ACHILLES_BIT), 0.0)

    def fell_s(self, since_s: float) -> float:
        """Return when the solenoid was released after a moment; 0: not yet."""
        return next((e.at_s for e in self._bench.edges if e.at_s > since_s and not e.solenoids & ACHILLES_BIT), 0.0)

    def impact(self) -> tuple[float, float]:
        """Rest, fall, hit, rest: return the delay to the coils' bytes and the bare round trip, s."""
        self.rest_and_fall()
        fallen = 0
        while self._bench.edges[-1].solenoids & ACHILLES_BIT:
            self.send(0.0)
            fallen += 1
            if fallen > LONGEST_FALL_SAMPLES:  # an IMU without gravity for so long is believed no more
                for _ in range(RECOVERY_SAMPLES):
                    self.send(STANDARD_GRAVITY_M_S2)
                return 0.0, 0.0
        self.echo_at_s = 0.0
        sent_s = self.send(IMPACT_M_S2, MARK)
        self.feel(STANDARD_GRAVITY_M_S2, GROUND_S)
        return self.rose_s(sent_s) - silence_s(BAUD) - sent_s, self.echo_at_s - sent_s

    def service(self, *, on: bool) -> float:
        """Call the service of one channel at any moment of a cycle; return the delay to the coils' bytes, s."""
        self.spin_until(self._client.service_is_ready, "the service is offered")
        time.sleep(self._random.uniform(0.0, LONGEST_PAUSE_S))
        at_s = time.monotonic()
        self._client.call_async(SetBool.Request(data=on))
        seen = self.rose_s if on else self.fell_s
        self.spin_until(lambda: seen(at_s) > 0.0, "the pin follows")
        return seen(at_s) - silence_s(BAUD) - at_s


def measure_line(domain_id: int) -> LineDelays:
    """Measure everything, one after the other, on one board."""
    with tempfile.TemporaryDirectory() as folder:
        command = board_command(Path(folder))
        with BoardBench(command, Path(folder, "bare"), baud=BAUD) as bench:
            serial_s = _bare_serial(Path(folder, "bare"))
            rate_hz = _cycle_rate(Path(folder, "bare"))
        with BoardBench(command, Path(folder, "board"), baud=BAUD) as bench:
            service_s, impacts = _graph(domain_id, bench, Path(folder, "board"))
    path = [delay for delay, _ in impacts if delay > 0.0]
    graph = [echo for _, echo in impacts if echo > 0.0]
    service, impact, round_trip, bare = (Percentiles.of(delays_s) for delays_s in (service_s, path, graph, serial_s))
    return LineDelays(
        service,
        impact,
        round_trip,
        bare,
        service.over(round_trip, bare),
        impact.over(round_trip, bare),
        rate_hz,
        IMPACT_TRIALS - len(path),
    )


def _bare_serial(port: Path) -> list[float]:
    """Send one cycle's request and await its reply, without any library between."""
    registers = register_list()
    count = registers.input("check_sum_errors").address + 1
    numbers = (registers.mirror, count, 0, 2)
    body = bytes((1, 23)) + b"".join(number.to_bytes(2, "big") for number in numbers) + bytes((4, 0, 0, 0, 0))
    request = body + FramerRTU.compute_CRC(body).to_bytes(2, "big")
    found = []
    with serial.Serial(str(port), BAUD, timeout=0.5) as line:
        for _ in range(SERIAL_TRIALS):
            start_s = time.perf_counter()
            line.write(request)
            reply = line.read(5 + 2 * count)
            found.append(time.perf_counter() - start_s)
            if len(reply) != 5 + 2 * count:
                msg = f"the board answered {reply!r}"
                raise TimeoutError(msg)
            time.sleep(0.002)
    return found


def _cycle_rate(port: Path) -> float:
    host = Host(port, wired=replace(load_wiring(None), rate_hz=1000.0))
    try:
        host.ready()
        before, start_s = len(host.exchanges), time.monotonic()
        host.tick_until(lambda: time.monotonic() - start_s > RATE_S, RELEASED)
        return (len(host.exchanges) - before) / (time.monotonic() - start_s)
    finally:
        host.link.close()


def _graph(domain_id: int, bench: BoardBench, port: Path) -> tuple[list[float], list[tuple[float, float]]]:
    driver = ("-m", "jammkle_driver", "--ros-args", "-p", "hardware:=modbus", "-p", f"port:={port}")
    controller = ("-m", "jammkle_controller", "--ros-args", "-p", "jam_delay_s:=0.0")
    with (
        running(domain_id, driver, controller, ECHO) as processes,
        closing(BoardStimulus(domain_id, bench)) as stimulus,
    ):
        stimulus.wait_until_ready()
        impacts = [stimulus.impact() for _ in range(IMPACT_TRIALS)]
        processes[1].terminate()  # whose stream would take back what the services ask
        processes[1].wait()
        stimulus.wait_for_channels(ChannelJamState.UNJAMMED)
        services = [stimulus.service(on=trial % 2 == 0) for trial in range(SERVICE_TRIALS)]
    return services, impacts
