"""A driver process on a board with a plant behind its pins, and everything that may befall them, timed at the pins."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from std_msgs.msg import Bool

from board_bench import BoardBench
from graph import TIMEOUT_S, Probe, environment
from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_common.names import (
    ACHILLES,
    CHANNELS,
    CLEAR_FAULT,
    DIAGNOSTICS,
    EMERGENCY_STOP,
    JAM_ALL,
    JAM_COMMAND,
    JAM_STATE,
    MANIFOLD_PRESSURE,
)
from jammkle_msgs.msg import ChannelJamCommand, ChannelJamState, Fault, JamCommand
from landing_imu import IMPACT_M_S2, PlayedImu

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from diagnostic_msgs.msg import DiagnosticStatus

    from board_bench import BoardPlant

EVERYTHING = 0b111
SUPPLY_PIN = 4
SENSOR_PIN = CHANNELS.index(ACHILLES)
SAGGED_UV = 2_000_000
"""8 V of 12 V at the divider of the supply."""
STREAM_PERIOD_S = 0.02
IMU_PERIOD_S = 0.01
REST_SAMPLES, FLIGHT_SAMPLES = 100, 30
HELD_VACUUM_PA = 50e3
OF_THE_PLANT = frozenset(range(Fault.LEAK, Fault.SENSOR_DRIFTING + 1))
"""What only pump, air, valves or sensors give reason to report."""


class Scene:
    """One driver, one board, one probe."""

    def __init__(
        self,
        command: Sequence[str],
        port: Path,
        domain_id: int,
        plant: BoardPlant | None = None,
        *,
        board_is_there: bool = True,
        **parameters: str,
    ) -> None:
        self.port = port
        self.domain_id = domain_id
        self._command, self._plant = list(command), plant
        if board_is_there:
            self.plug_in()
        self.probe = Probe(domain_id)
        self.probe.listen(JAM_STATE, DIAGNOSTICS, MANIFOLD_PRESSURE)
        self.stream = self.probe.publisher(JAM_COMMAND)
        self.stop = self.probe.publisher(EMERGENCY_STOP)
        self.controller: subprocess.Popen[bytes] | None = None
        self.cleared: list[int] = []
        """Reasons of what was cleared to come to a jam."""
        self._imu = PlayedImu(self.probe.node)
        self._imu_samples = 0
        self.probe.node.create_timer(IMU_PERIOD_S, self._land)
        self._parameters = {"hardware": "modbus", "port": str(port), **parameters}
        self.driver = self.start_driver()

    def plug_in(self) -> None:
        """Let the board be there."""
        self.bench = BoardBench(self._command, self.port, self._plant)

    def start_driver(self) -> subprocess.Popen[bytes]:
        """Start a driver process; what it was before does not matter."""
        given = [word for name, value in self._parameters.items() for word in ("-p", f"{name}:={value}")]
        arguments = [sys.executable, str(Path(__file__).with_name("hanging_driver.py")), "--ros-args", *given]
        self.ended = False
        self.driver = subprocess.Popen(arguments, env=environment(self.domain_id))
        return self.driver

    def close(self) -> None:
        """End everything."""
        self.end_controller()
        if self.driver.poll() is None:
            os.kill(self.driver.pid, signal.SIGCONT)
            self.driver.kill()
        self.driver.wait()
        self.probe.close()
        if hasattr(self, "bench"):
            self.bench.close()

    def link(self) -> DiagnosticStatus:
        """Return the driver's latest line on the link."""
        return self.probe.line("driver: link")

    def know_atmosphere(self) -> None:
        """Wait until vented channels have shown the atmosphere, before which faults are found by time-outs alone."""

        def known() -> bool:
            values = {each.key: each.value for each in self.probe.line("driver: atmosphere").values}
            return values.get("measured by vented channels") == "yes"

        self.probe.spin_until(known, "the atmosphere is known")

    def jam(self) -> None:
        """Jam everything, until the pins and the driver say so; clear whatever comes between."""

        def jammed() -> bool:
            if self.all_on():
                return self.channels_in(ChannelJamState.JAMMED)
            if not self.probe.call(JAM_ALL).success:
                self.clear()
            return False

        self.probe.spin_until(jammed, "everything is jammed")

    def jam_by_controller(self) -> None:
        """Let a controller feel a landing, and jam; it holds everything by its stream of commands."""
        vacuum = f"hold_vacuum_pa:={HELD_VACUUM_PA}"
        arguments = [sys.executable, "-m", "jammkle_controller", "--ros-args", "-p", vacuum]
        self.controller = subprocess.Popen(arguments, env=environment(self.domain_id))

        def held() -> bool:
            if self.in_fault():
                self.clear()
            reasons = {channel.reason for channel in self.probe.last(JAM_STATE).channels}
            # What a service had jammed before is jammed, too, and stays so when the controller dies.
            by_stream = reasons == {f"asked by {JAM_COMMAND.name}"}
            return by_stream and self.all_on() and self.channels_in(ChannelJamState.JAMMED)

        self.probe.spin_until(held, "a controller holds everything")

    def end_controller(self) -> None:
        """End the controller, if there is one."""
        if self.controller is not None:
            self.controller.kill()
            self.controller.wait()
            self.controller = None

    def in_fault(self) -> bool:
        """Whether a channel is: a busy machine may run the board so late that it counts as lost."""
        return ChannelJamState.FAULT in self.probe.channel_states().values()

    def clear(self) -> None:
        """Clear what is in FAULT, and note why it was."""
        self.cleared += sorted(self.faults() - {Fault.UNKNOWN})
        self.probe.call(CLEAR_FAULT)

    def _land(self) -> None:
        """Play the IMU of a robot that rests, falls, hits the ground, and rests; it falls as long as nothing jams."""
        at = self._imu_samples % (REST_SAMPLES + FLIGHT_SAMPLES)
        self._imu_samples += not (at == 1 and self.channels_in(ChannelJamState.JAMMED))
        force_m_s2 = IMPACT_M_S2 if at == 0 else STANDARD_GRAVITY_M_S2 if at < REST_SAMPLES else 0.0
        self._imu.publisher.publish(self._imu.sample(force_m_s2))

    def stream_jam(self) -> float:
        """Jam everything by a stream of commands; return when its last message left, s."""
        command = JamCommand(channels=[ChannelJamCommand(channel=name, vacuum_pa=HELD_VACUUM_PA) for name in CHANNELS])
        end_s = time.monotonic() + TIMEOUT_S
        sent_s = 0.0
        while not (self.channels_in(ChannelJamState.JAMMED) and self.all_on()):
            assert time.monotonic() < end_s, self.probe.channel_states()
            if self.in_fault():
                self.clear()
            self.stream.publish(command)
            sent_s = time.monotonic()
            self.probe.executor.spin_once(timeout_sec=STREAM_PERIOD_S)
        return sent_s

    def all_on(self) -> bool:
        """Whether every solenoid is energised at the pins."""
        return bool(self.bench.edges) and self.bench.edges[-1].solenoids == EVERYTHING

    def manifold_pa(self) -> float:
        """Return the latest pressure of the manifold, Pa absolute."""
        return float(self.probe.last(MANIFOLD_PRESSURE).fluid_pressure)

    def wait_for_fault(self, fault: int) -> None:
        """Wait until a channel is in FAULT for this reason."""
        self.probe.spin_until(lambda: fault in self.faults(), f"fault {fault} is reported")

    def faults(self) -> set[int]:
        """Return what the channels report as their faults."""
        return {channel.fault for channel in self.probe.last(JAM_STATE).channels}

    def channels_in(self, state: int) -> bool:
        """Whether every channel reports a state."""
        states = self.probe.channel_states()
        return bool(states) and set(states.values()) == {state}

    def delay_s(self, happened_s: float, holds: Callable[[int, float], bool]) -> float:
        """Return how long after a moment the pins (solenoids, duty) became so, and are."""
        first = [0.0]

        def so() -> bool:
            edges = self.bench.edges
            if not edges or not holds(edges[-1].solenoids, edges[-1].duty):
                return False
            late = len(edges) - 1
            while late > 0 and holds(edges[late - 1].solenoids, edges[late - 1].duty):
                late -= 1
            first[0] = edges[late].at_s
            return True

        self.probe.spin_until(so, "the pins are as they must be")
        return first[0] - happened_s


def all_off(solenoids: int, duty: float) -> bool:
    """Whether nothing is driven."""
    return solenoids == 0 and duty == 0.0


def pump_off(_solenoids: int, duty: float) -> bool:
    """Whether the pump is off."""
    return duty == 0.0


def repair(scene: Scene) -> None:
    """Undo what was done, so that a jam is possible again."""
    scene.bench.override_uv.clear()
    scene.bench.tell("plug")
    scene.stop.publish(Bool(data=False))
    scene.end_controller()
    if scene.ended:
        scene.driver.wait()
        scene.start_driver()
    else:
        os.kill(scene.driver.pid, signal.SIGCONT)


@dataclass(frozen=True)
class Event:
    """What may happen to a jammed ankle.

    Attributes:
        act: Does it.
        bound_s: Within how long everything is off at the pins: of the watchdogs involved, and one cycle or tick each.
        jam: Jams everything before.
        fault: What a driver that lives says of the channels; UNKNOWN: they are in no FAULT.

    """

    act: Callable[[Scene], None]
    bound_s: float
    jam: Callable[[Scene], None] = Scene.jam
    fault: int = Fault.UNKNOWN

    def happen(self, scene: Scene) -> float:
        """Do it, and return when, s of the monotonic clock."""
        at_s = time.monotonic()
        self.act(scene)
        return at_s


def tell(text: str) -> Callable[[Scene], None]:
    """Return what tells something to the board's process."""
    return lambda scene: scene.bench.tell(text)


def pin(number: int, voltage_uv: int) -> Callable[[Scene], None]:
    """Return what lets a pin read a voltage."""
    return lambda scene: scene.bench.override_uv.update({number: voltage_uv})


def driver(number: signal.Signals) -> Callable[[Scene], None]:
    """Return what sends a signal to the driver."""
    return lambda scene: os.kill(scene.driver.pid, number)


def driver_ends(number: signal.Signals) -> Callable[[Scene], None]:
    """Return what ends the driver by a signal."""

    def act(scene: Scene) -> None:
        scene.ended = True
        scene.driver.send_signal(number)

    return act


def controller(number: signal.Signals) -> Callable[[Scene], None]:
    """Return what sends a signal to the controller that holds everything, if there is one."""
    return lambda scene: scene.controller and scene.controller.send_signal(number)


EVENTS = {
    "emergency stop": Event(lambda scene: scene.stop.publish(Bool(data=True)), 0.05),
    "sensor of a channel breaks": Event(pin(SENSOR_PIN, 0), 0.1, fault=Fault.SENSOR_OUT_OF_RANGE),
    "cable pulled": Event(tell("unplug"), 0.21, fault=Fault.BOARD_UNPLUGGED),
    "board reset": Event(tell("reset 2 30"), 0.01, fault=Fault.BOARD_REBOOTED),
    "brown-out of the controller": Event(tell("reset 4 30"), 0.01, fault=Fault.BROWN_OUT),
    "supply of pump and valves sags": Event(pin(SUPPLY_PIN, SAGGED_UV), 0.02, fault=Fault.BROWN_OUT),
    "SIGSTOP of the driver": Event(driver(signal.SIGSTOP), 0.21),
    "driver's node hangs, its threads live": Event(driver(signal.SIGUSR1), 0.42),
    "kill -9 of the controller": Event(controller(signal.SIGKILL), 0.6, Scene.jam_by_controller),
    "SIGSTOP of the controller": Event(controller(signal.SIGSTOP), 0.6, Scene.jam_by_controller),
    "SIGTERM of the driver": Event(driver_ends(signal.SIGTERM), 0.05),
    "kill -9 of the driver": Event(driver_ends(signal.SIGKILL), 0.21),
}
"""What may happen."""
