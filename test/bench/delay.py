"""Delay from the IMU sample that carries an impact to the solenoid topic, through controller and driver over DDS.

Beside it, in the same run and on the same samples: the round trip to a bare subscriber, and the way through two bare
relays in a row, processes as controller and driver are, so that the delay can be said in units of what DDS and Python
take anyway.
"""

from __future__ import annotations

import itertools
import math
import statistics
import sys
import time
from contextlib import closing
from dataclasses import dataclass
from typing import TYPE_CHECKING

import psutil
from rclpy.experimental import EventsExecutor
from sensor_msgs.msg import FluidPressure
from std_msgs.msg import Bool

from echo import ECHO, ECHO_TOPIC, MARK, SECOND_ECHO_NODE, SECOND_ECHO_TOPIC
from graph import Probe, running
from jammkle_common.constants import STANDARD_ATMOSPHERE_PA, STANDARD_GRAVITY_M_S2
from jammkle_common.names import (
    CHANNELS,
    CONTACT_EVENTS,
    IMU,
    IMU_FRAME,
    JAM_STATE,
    MANIFOLD_PRESSURE,
    PRESSURES,
    SOLENOIDS,
)
from jammkle_common.qos import publisher_qos, subscriber_qos
from jammkle_msgs.msg import ChannelJamState, ContactEvent
from landing_imu import IMPACT_M_S2, PlayedImu

if TYPE_CHECKING:
    from collections.abc import Sequence

TRIALS = 150
IMU_RATE_HZ = 500
PRESSURE_PERIOD_S = 0.01
JAMMED_PA, FILL_TIME_S = 42e3, 0.05
"""Vacuum of a channel that is jammed, and its time constant: enough for a driver that waits for JAMMED."""
REST_S = 0.2
"""Long enough for the mean specific force to stay above half of g: below it an IMU counts as one without gravity."""
FLIGHTS_S = (0.08, 0.16)
"""In turn: a controller that foresees the end of flights that are alike has jammed before it, and no impact matters."""
GROUND_S = 0.08
TIMEOUT_S = 30.0
IMU_SUBSCRIBERS = 2


@dataclass(frozen=True)
class Delays:
    """Delays over all trials, and the median as a multiple of that through two bare relays."""

    trials: int
    """Landings that reached the solenoid."""
    landings: int
    liftoffs_reported: int
    impacts_reported: int
    imu_rate_hz: float
    """At which samples truly left."""
    median_ms: float
    p99_ms: float
    round_trip_median_ms: float
    round_trip_p99_ms: float
    """To one bare relay and back."""
    relays_median_ms: float
    relays_p99_ms: float
    """Through two bare relays in a row."""
    ratio: float
    """Of the medians: to the solenoid, and through two bare relays."""
    load_before: float
    """Processes that wanted a core in the minute before."""


class Stimulus(Probe):
    """Plays the hardware: the IMU, pressures at 100 Hz, and a clock that watches for the answers."""

    def __init__(self, domain_id: int, imu_rate_hz: int = IMU_RATE_HZ) -> None:
        super().__init__(domain_id)
        self.executor.remove_node(self.node)
        # At 1 kHz the single-threaded one takes more than its turn: 55 % of a core for 19 %.
        self.executor = EventsExecutor(context=self.context)
        self.executor.add_node(self.node)
        self._imu_rate_hz = imu_rate_hz
        self._pressure_every = round(PRESSURE_PERIOD_S * imu_rate_hz)
        self._imu = PlayedImu(self.node)
        self._pressures = [
            self.node.create_publisher(FluidPressure, topic.name, publisher_qos(topic))
            for topic in (*PRESSURES.values(), MANIFOLD_PRESSURE)
        ]
        self.solenoid_at_s = 0.0
        self.echo_at_s = 0.0
        self.second_echo_at_s = 0.0
        self.energised = False
        achilles = SOLENOIDS["achilles"]
        self.node.create_subscription(Bool, achilles.name, self._on_solenoid, subscriber_qos(achilles))
        self.node.create_subscription(Bool, ECHO_TOPIC, self._on_echo, publisher_qos(IMU))
        self.node.create_subscription(Bool, SECOND_ECHO_TOPIC, self._on_second_echo, publisher_qos(IMU))
        self.listen(JAM_STATE, CONTACT_EVENTS)
        self.samples = 0
        self._vacuum_pa = 0.0
        self._flights_s = itertools.cycle(FLIGHTS_S)
        self._next_s = time.monotonic()

    def _on_solenoid(self, message: Bool) -> None:
        if message.data and not self.energised:
            self.solenoid_at_s = time.monotonic()
        self.energised = message.data

    def _on_echo(self, _: Bool) -> None:
        self.echo_at_s = time.monotonic()

    def _on_second_echo(self, _: Bool) -> None:
        self.second_echo_at_s = time.monotonic()

    def send(self, specific_force_m_s2: float, frame: str = IMU_FRAME) -> float:
        """Send one sample in its turn, pressures when they are due, and return when it left."""
        while (left_s := self._next_s - time.monotonic()) > 0.0:
            self.executor.spin_once(timeout_sec=left_s)
        self._next_s += 1.0 / self._imu_rate_hz
        sample = self._imu.sample(specific_force_m_s2, frame)
        sent_s = time.monotonic()
        self._imu.publisher.publish(sample)
        if self.samples % self._pressure_every == 0:
            wanted_pa = JAMMED_PA if self.energised else 0.0
            self._vacuum_pa += (wanted_pa - self._vacuum_pa) * PRESSURE_PERIOD_S / FILL_TIME_S
            pressure = FluidPressure(header=sample.header, fluid_pressure=STANDARD_ATMOSPHERE_PA - self._vacuum_pa)
            for publisher in self._pressures:
                publisher.publish(pressure)
        self.samples += 1
        self.executor.spin_once(timeout_sec=0.0)
        return sent_s

    def ready(self) -> bool:
        """Whether driver, controller and echo are there and see each other."""
        states = self.channel_states()
        known = len(states) == len(CHANNELS) and set(states.values()) == {ChannelJamState.UNJAMMED}
        return known and self.second_echo_at_s > 0.0 and self.node.count_subscribers(IMU.name) >= IMU_SUBSCRIBERS

    def wait_until_ready(self) -> None:
        """Send samples until all are there.

        Raises:
            TimeoutError: they are not.

        """
        deadline_s = time.monotonic() + TIMEOUT_S
        while not self.ready():
            self.send(STANDARD_GRAVITY_M_S2, MARK)
            if time.monotonic() > deadline_s:
                msg = f"the graph did not come up; jam_state: {self.last(JAM_STATE)}"
                raise TimeoutError(msg)

    def trial(self) -> tuple[float, float, float]:
        """Rest, fall, hit, rest: return the delay to the solenoid, the bare round trip, and that of two relays, s."""
        self.rest_and_fall()
        while self.energised:
            self.send(0.0)
        self.solenoid_at_s = self.echo_at_s = self.second_echo_at_s = 0.0
        sent_s = self.send(IMPACT_M_S2, MARK)
        self.feel(STANDARD_GRAVITY_M_S2, GROUND_S)
        return self.solenoid_at_s - sent_s, self.echo_at_s - sent_s, self.second_echo_at_s - sent_s

    def rest_and_fall(self) -> None:
        """Stand for a while, then fall, each time for another time than the last."""
        self.feel(STANDARD_GRAVITY_M_S2, REST_S)
        self.feel(0.0, next(self._flights_s))

    def reported(self, kind: int) -> int:
        """How many events of a kind were reported."""
        return sum(event.type == kind for event in self.received[CONTACT_EVENTS.name])

    def feel(self, force_m_s2: float, lasts_s: float) -> None:
        """Send samples of one specific force for so long."""
        for _ in range(round(lasts_s * self._imu_rate_hz)):
            self.send(force_m_s2)


def measure_delays(
    domain_id: int, *, imu_rate_hz: int = IMU_RATE_HZ, landings: float = TRIALS, most_s: float = math.inf
) -> Delays:
    """Run controller, driver and echo as processes and land on them again and again.

    Args:
        domain_id: ROS domain.
        imu_rate_hz: Rate of the IMU.
        landings: How many, at most.
        most_s: How long, at most, s.

    """
    load_before = psutil.getloadavg()[0]
    of_controller = ("-p", "jam_delay_s:=0.0", "-p", f"imu_rate_hz:={float(imu_rate_hz)}")
    commands: Sequence[Sequence[str]] = (
        ("-m", "jammkle_driver", "--ros-args", "-p", "diagnose:=false"),  # its air is no real one
        ("-m", "jammkle_controller", "--ros-args", *of_controller),
        ECHO,
        (*ECHO, SECOND_ECHO_NODE),
    )
    with running(domain_id, *commands), closing(Stimulus(domain_id, imu_rate_hz)) as stimulus:
        stimulus.wait_until_ready()
        samples, begin_s = stimulus.samples, time.monotonic()
        trials: list[tuple[float, float, float]] = []
        while len(trials) < landings and time.monotonic() - begin_s < most_s:
            trials.append(stimulus.trial())
        rate_hz = (stimulus.samples - samples) / (time.monotonic() - begin_s)
        liftoffs, impacts = stimulus.reported(ContactEvent.LIFTOFF), stimulus.reported(ContactEvent.IMPACT)
    if not any(solenoid > 0.0 for solenoid, _, _ in trials):
        msg = (
            f"none of {len(trials)} impacts reached the solenoid; "
            f"samples left at {rate_hz:.0f} of {imu_rate_hz} Hz: is the machine idle?"
        )
        raise RuntimeError(msg)
    path, round_trip, relays = ([delay for delay in each if delay > 0.0] for each in zip(*trials, strict=True))
    if len(path) < len(trials) or len(round_trip) < len(trials):
        sys.stderr.write(f"{len(trials) - len(path)} of {len(trials)} impacts never reached the solenoid\n")
    return Delays(
        len(path),
        len(trials),
        liftoffs,
        impacts,
        rate_hz,
        statistics.median(path) * 1e3,
        _p99(path) * 1e3,
        statistics.median(round_trip) * 1e3,
        _p99(round_trip) * 1e3,
        statistics.median(relays) * 1e3,
        _p99(relays) * 1e3,
        statistics.median(path) / statistics.median(relays),
        load_before,
    )


def _p99(values: Sequence[float]) -> float:
    return statistics.quantiles(values, n=100)[98]
