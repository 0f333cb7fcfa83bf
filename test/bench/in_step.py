"""What lockstep costs: simulated seconds per second as fast as it goes, in step and running freely, in one run.

Beside each graph stands a bare relay on the same machine, in the same minutes: a tick that one process sends, and an
answer that another gives, with nothing done in between.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from sensor_msgs.msg import Imu
from std_msgs.msg import Bool

from domains import own_domain
from echo import ECHO, ECHO_TOPIC, MARK
from graph import Probe, Up, cpu_s, running
from jammkle_common.names import ACTUATOR_STATES, CLOCK, IMU, JAM_COMMAND, SET_PAUSED
from jammkle_common.qos import publisher_qos

MEASURED_S = 8.0
RELAYS = 1000
STEERING = ("jammkle_driver", "jammkle_controller")
ROBOTS = ("ankle", "quadruped")


@dataclass(frozen=True)
class InStep:
    """One robot's graph, alone on the machine but for what else runs there.

    Attributes:
        robot: Of the graph.
        in_step: Simulated seconds per second in lockstep.
        free: The same running freely.
        steering_core_s: Processor time of all drivers and controllers per simulated second in lockstep, s.
        free_steering_core_s: The same running freely.
        relay_ms: Median round trip of a bare relay, ms of real time.
        tick_ms: Real time per tick of /clock in lockstep, ms.
        sample_to_solenoid_ms: Simulated time from the first command that asks for a channel's vacuum, stamped as the
            sample that led to it, to the first acknowledgement of that channel's solenoid, ms.

    """

    robot: str
    in_step: float
    free: float
    steering_core_s: float
    free_steering_core_s: float
    relay_ms: float
    tick_ms: float
    sample_to_solenoid_ms: float

    @property
    def ratio(self) -> float:
        """Speed in lockstep over that of running freely."""
        return self.in_step / self.free


def measure_in_step() -> list[InStep]:
    """Measure both robots."""
    return [_measured(robot) for robot in ROBOTS]


def _measured(robot: str) -> InStep:
    free = _run(robot, lockstep=False)
    stepped = _run(robot, lockstep=True)
    return InStep(robot, stepped[0], free[0], stepped[1], free[1], _relay_ms(), stepped[2], stepped[3])


def _run(robot: str, *, lockstep: bool) -> tuple[float, float, float, float]:
    """Return speed, core seconds of those that steer, real ms per tick, and the way from sample to solenoid, ms."""
    with tempfile.TemporaryDirectory() as folder, own_domain() as domain_id:
        step = f"sim:lockstep:={str(lockstep).lower()}"
        options = ("--robot", robot, "--speed", "0", "-p", step, "-p", "sim:start_paused:=true")
        up = Up(domain_id, Path(folder), "up", *options)
        whole = Probe(domain_id)
        probe = whole if robot == "ankle" else Probe(domain_id, "/lf_ankle")
        try:
            probe.listen(CLOCK, JAM_COMMAND, ACTUATOR_STATES)
            # before time begins: a first command that was missed is repeated up to 50 ms later
            probe.spin_until(lambda: _is_complete(probe), "command and acknowledgement are received")
            probe.spin_until(lambda: "jammkle: up; paused" in up.text(), "the graph is up")
            whole.call(SET_PAUSED, data=False)
            probe.spin_until(lambda: probe.clock_s() > 2.0 and _has_jammed(probe), "it has landed and is being jammed")
            steering = [each for each in up.children() if any(name in each.cmdline() for name in STEERING)]
            before_s, begin_s, core_s = probe.clock_s(), time.perf_counter(), sum(map(cpu_s, steering))
            ticks = len(probe.received[CLOCK.name])
            end_s = begin_s + MEASURED_S
            probe.spin_until(lambda: time.perf_counter() > end_s, "it was measured", timeout_s=100.0 * MEASURED_S)
            passed_s, simulated_s = time.perf_counter() - begin_s, probe.clock_s() - before_s
            used_s = sum(map(cpu_s, steering)) - core_s
            received = max(len(probe.received[CLOCK.name]) - ticks, 1)
            return simulated_s / passed_s, used_s / simulated_s, 1e3 * passed_s / received, _way_ms(probe)
        finally:
            for each in {whole, probe}:
                each.close()
            up.stop()


def _is_complete(probe: Probe) -> bool:
    return all(each.get_publisher_count() > 0 for each in probe.node.subscriptions)


def _has_jammed(probe: Probe) -> bool:
    return any(any(each.energised) for each in probe.received[ACTUATOR_STATES.name])


def _way_ms(probe: Probe) -> float:
    """Return the simulated time from the sample on which it was first decided to jam, to that channel's solenoid, ms.

    A command that asks for something new has the stamp of the sample that led to it: the controller is in step. The
    solenoid's time is that of the step from which on the hardware drives it.

    Raises:
        RuntimeError: the solenoid was energised before it was asked for, so the command was missed.

    """
    asked_s, channel = next(
        (_stamp_s(command), each.channel)
        for command in probe.received[JAM_COMMAND.name]
        for each in command.channels
        if each.vacuum_pa > 0.0
    )
    done_s = next(
        _stamp_s(states)
        for states in probe.received[ACTUATOR_STATES.name]
        if dict(zip(states.channels, states.energised, strict=True))[channel]
    )
    if done_s < asked_s:
        msg = f"{channel} was energised at {done_s:.3f} s, and first seen to be asked for at {asked_s:.3f} s"
        raise RuntimeError(msg)
    return 1e3 * (done_s - asked_s)


def _relay_ms() -> float:
    """Return the median round trip of a bare relay."""
    with own_domain() as domain_id, running(domain_id, ECHO):
        probe = Probe(domain_id)
        try:
            answers: list[float] = []
            probe.node.create_subscription(Bool, ECHO_TOPIC, lambda _: answers.append(time.perf_counter()), 10)
            samples = probe.node.create_publisher(Imu, IMU.name, publisher_qos(IMU))
            probe.spin_until(lambda: samples.get_subscription_count() > 0, "the relay listens")
            sample, ways_ms = Imu(), []
            sample.header.frame_id = MARK

            def answers_at_all() -> bool:
                samples.publish(sample)
                return bool(answers)

            probe.spin_until(answers_at_all, "both ways are matched")
            for _ in range(RELAYS):
                known, sent_s = len(answers), time.perf_counter()
                samples.publish(sample)
                probe.spin_until(lambda known=known: len(answers) > known, "it answers")
                ways_ms.append(1e3 * (answers[-1] - sent_s))
            return sorted(ways_ms)[len(ways_ms) // 2]
        finally:
            probe.close()


def _stamp_s(message: object) -> float:
    stamp = message.header.stamp  # type: ignore[attr-defined]
    return float(stamp.sec + 1e-9 * stamp.nanosec)
