"""Delay from the IMU sample that carries an impact to the solenoid topic, through controller and driver over DDS.

Beside it, in the same run and on the same samples: the round trip to a bare subscriber, so that the delay can be
said in units of what DDS and Python take anyway.
"""

from __future__ import annotations

import random
import statistics
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sensor_msgs.msg import FluidPressure, Imu
from std_msgs.msg import Bool

from echo import ECHO_TOPIC, MARK
from graph import Probe, environment
from jammkle_graph.constants import STANDARD_ATMOSPHERE_PA, STANDARD_GRAVITY_M_S2
from jammkle_graph.names import CHANNELS, IMU, IMU_FRAME, JAM_STATE, MANIFOLD_PRESSURE, PRESSURES, SOLENOIDS
from jammkle_graph.qos import publisher_qos, subscriber_qos
from jammkle_msgs.msg import ChannelJamState

if TYPE_CHECKING:
    from collections.abc import Sequence

TRIALS = 150
IMU_PERIOD_S = 0.002
PRESSURE_EVERY = 5
REST_SAMPLES = 100
"""Long enough for the mean specific force to stay above half of g: below it an IMU counts as one without gravity."""
FLIGHT_SAMPLES = 60
GROUND_SAMPLES = 40
IMPACT_M_S2 = 40.0
NOISE_M_S2 = 0.02
"""Of the IMU: one whose readings never change counts as frozen."""
ROUND_TRIP_HOPS = 2
PATH_HOPS = 3
IMU_SUBSCRIBERS = 2


@dataclass(frozen=True)
class Delays:
    """Delays over all trials, and the median per hop as a multiple of a bare hop's."""

    trials: int
    median_ms: float
    p99_ms: float
    round_trip_median_ms: float
    round_trip_p99_ms: float
    per_hop_ratio: float


class Stimulus(Probe):
    """Plays the hardware: IMU at 500 Hz, pressures at 100 Hz, and a clock that watches for the answers."""

    def __init__(self, domain_id: int) -> None:
        super().__init__(domain_id)
        self._imu = self.node.create_publisher(Imu, IMU.name, publisher_qos(IMU))
        self._pressures = [
            self.node.create_publisher(FluidPressure, topic.name, publisher_qos(topic))
            for topic in (*PRESSURES.values(), MANIFOLD_PRESSURE)
        ]
        self.solenoid_at_s = 0.0
        self.echo_at_s = 0.0
        self.energised = False
        achilles = SOLENOIDS["achilles"]
        self.node.create_subscription(Bool, achilles.name, self._on_solenoid, subscriber_qos(achilles))
        self.node.create_subscription(Bool, ECHO_TOPIC, self._on_echo, publisher_qos(IMU))
        self.listen(JAM_STATE)
        self._samples = 0
        self._random = random.Random(1)  # noqa: S311 - noise of a sensor
        self._next_s = time.perf_counter()

    def _on_solenoid(self, message: Bool) -> None:
        if message.data and not self.energised:
            self.solenoid_at_s = time.perf_counter()
        self.energised = message.data

    def _on_echo(self, _: Bool) -> None:
        self.echo_at_s = time.perf_counter()

    def send(self, specific_force_m_s2: float, frame: str = IMU_FRAME) -> float:
        """Send one sample in its turn, pressures when they are due, and return when it left."""
        while (left_s := self._next_s - time.perf_counter()) > 0.0:
            self.executor.spin_once(timeout_sec=left_s)
        self._next_s += IMU_PERIOD_S
        sample = Imu()
        sample.header.stamp = self.node.get_clock().now().to_msg()
        sample.header.frame_id = frame
        sample.linear_acceleration.z = specific_force_m_s2 + self._random.gauss(0.0, NOISE_M_S2)
        sample.orientation_covariance[0] = -1.0
        sent_s = time.perf_counter()
        self._imu.publish(sample)
        if self._samples % PRESSURE_EVERY == 0:
            pressure = FluidPressure(header=sample.header, fluid_pressure=STANDARD_ATMOSPHERE_PA)
            for publisher in self._pressures:
                publisher.publish(pressure)
        self._samples += 1
        self.executor.spin_once(timeout_sec=0.0)
        return sent_s

    def ready(self) -> bool:
        """Whether driver, controller and echo are there and hear each other."""
        states = self.channel_states()
        known = len(states) == len(CHANNELS) and set(states.values()) == {ChannelJamState.UNJAMMED}
        return known and self.echo_at_s > 0.0 and self.node.count_subscribers(IMU.name) >= IMU_SUBSCRIBERS

    def trial(self) -> tuple[float, float]:
        """Rest, fall, hit, rest: return the delay to the solenoid and the bare round trip, s."""
        for force_m_s2, count in ((STANDARD_GRAVITY_M_S2, REST_SAMPLES), (0.0, FLIGHT_SAMPLES)):
            for _ in range(count):
                self.send(force_m_s2)
        while self.energised:
            self.send(0.0)
        self.solenoid_at_s = self.echo_at_s = 0.0
        sent_s = self.send(IMPACT_M_S2, MARK)
        for _ in range(GROUND_SAMPLES):
            self.send(STANDARD_GRAVITY_M_S2)
        return self.solenoid_at_s - sent_s, self.echo_at_s - sent_s


def measure_delays(domain_id: int) -> Delays:
    """Run controller, driver and echo as processes and land on them again and again."""
    commands: Sequence[Sequence[str]] = (
        ("-m", "jammkle_driver"),
        ("-m", "jammkle_controller", "--ros-args", "-p", "jam_delay_s:=0.0"),
        (str(Path(__file__).with_name("echo.py")),),
    )
    processes = [subprocess.Popen([sys.executable, *command], env=environment(domain_id)) for command in commands]
    stimulus = Stimulus(domain_id)
    try:
        deadline_s = time.monotonic() + 30.0
        while not stimulus.ready():
            stimulus.send(STANDARD_GRAVITY_M_S2, MARK)
            if time.monotonic() > deadline_s:
                msg = f"the graph did not come up; jam_state: {stimulus.last(JAM_STATE)}"
                raise TimeoutError(msg)
        trials = [stimulus.trial() for _ in range(TRIALS)]
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.wait()
        stimulus.close()
    path = [solenoid for solenoid, _ in trials if solenoid > 0.0]
    round_trip = [echo for _, echo in trials if echo > 0.0]
    if len(path) < TRIALS or len(round_trip) < TRIALS:
        sys.stderr.write(f"{TRIALS - len(path)} of {TRIALS} impacts never reached the solenoid\n")
    per_hop = statistics.median(path) / PATH_HOPS
    bare_hop = statistics.median(round_trip) / ROUND_TRIP_HOPS
    return Delays(
        len(path),
        statistics.median(path) * 1e3,
        _p99(path) * 1e3,
        statistics.median(round_trip) * 1e3,
        _p99(round_trip) * 1e3,
        per_hop / bare_hop,
    )


def _p99(values: Sequence[float]) -> float:
    return statistics.quantiles(values, n=100)[98]
