"""A driver process on a board with a plant behind its pins, and everything that may befall them, timed at the pins."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus
from std_msgs.msg import Bool

from graph import Probe, environment
from jammkle_graph.names import (
    CHANNELS,
    CLEAR_FAULT,
    DIAGNOSTICS,
    EMERGENCY_STOP,
    JAM_ALL,
    JAM_COMMAND,
    JAM_STATE,
    MANIFOLD_PRESSURE,
)
from jammkle_msgs.msg import ChannelJamCommand, ChannelJamState, JamCommand
from jammkle_sim.board_bench import BoardBench

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

EVERYTHING = 0b111
SUPPLY_PIN = 4
SAGGED_UV = 2_000_000
"""8 V of 12 V at the divider of the supply."""
STREAM_PERIOD_S = 0.02
HELD_VACUUM_PA = 50e3


class Scene:
    """One driver, one board, one probe."""

    def __init__(self, command: Sequence[str], port: Path, domain_id: int, **parameters: str) -> None:
        self.port = port
        self.domain_id = domain_id
        self.bench = BoardBench(list(command), port)
        self.probe = Probe(domain_id)
        self.probe.listen(JAM_STATE, DIAGNOSTICS, MANIFOLD_PRESSURE)
        self.stream = self.probe.publisher(JAM_COMMAND)
        self.stop = self.probe.publisher(EMERGENCY_STOP)
        self._parameters = {"hardware": "modbus", "port": str(port), **parameters}
        self.driver = self.start_driver()

    def start_driver(self) -> subprocess.Popen[bytes]:
        """Start a driver process; what it was before does not matter."""
        given = [word for name, value in self._parameters.items() for word in ("-p", f"{name}:={value}")]
        arguments = [sys.executable, "-m", "jammkle_driver", "--ros-args", *given]
        self.ended = False
        self.driver = subprocess.Popen(arguments, env=environment(self.domain_id))
        return self.driver

    def close(self) -> None:
        """End everything."""
        if self.driver.poll() is None:
            os.kill(self.driver.pid, signal.SIGCONT)
            self.driver.kill()
        self.driver.wait()
        self.probe.close()
        self.bench.close()

    def link(self) -> DiagnosticStatus:
        """Return the driver's latest line on the link."""
        for message in reversed(self.probe.heard[DIAGNOSTICS.name]):
            for status in message.status:
                if status.name.endswith("driver: link"):
                    return status
        return DiagnosticStatus()

    def jam(self) -> None:
        """Clear whatever is to be cleared, and jam everything until it is so at the pins."""

        def jammed() -> bool:
            if self.bench.edges and self.bench.edges[-1].solenoids == EVERYTHING:
                return True
            if not self.probe.call(JAM_ALL).success:
                self.probe.call(CLEAR_FAULT)
            return False

        self.probe.spin_until(jammed, "everything is energised at the pins")
        self.probe.wait_for_channels(ChannelJamState.JAMMED)

    def stream_jam(self) -> float:
        """Jam everything by a stream of commands; return when its last message left, s."""
        wish = JamCommand(channels=[ChannelJamCommand(channel=name, vacuum_pa=HELD_VACUUM_PA) for name in CHANNELS])
        end_s = time.monotonic() + 30.0
        sent_s = 0.0
        while not (self.channels_in(ChannelJamState.JAMMED) and self.bench.edges[-1].solenoids == EVERYTHING):
            assert time.monotonic() < end_s, self.probe.channel_states()
            self.stream.publish(wish)
            sent_s = time.monotonic()
            self.probe.executor.spin_once(timeout_sec=STREAM_PERIOD_S)
        return sent_s

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


def sigterm(scene: Scene) -> float:
    """End the driver as `jammkle up` does."""
    at_s = time.monotonic()
    scene.ended = True
    scene.driver.terminate()
    return at_s


def sigkill(scene: Scene) -> float:
    """Kill the driver."""
    at_s = time.monotonic()
    scene.ended = True
    scene.driver.kill()
    return at_s


def sigstop(scene: Scene) -> float:
    """Let the driver stand still."""
    at_s = time.monotonic()
    os.kill(scene.driver.pid, signal.SIGSTOP)
    return at_s


def cable(scene: Scene) -> float:
    """Pull the cable."""
    at_s = time.monotonic()
    scene.bench.tell("unplug")
    return at_s


def reset(scene: Scene) -> float:
    """Press the board's reset button."""
    at_s = time.monotonic()
    scene.bench.tell("reset 2 30")
    return at_s


def brown_out(scene: Scene) -> float:
    """Let the controller's own supply break down."""
    at_s = time.monotonic()
    scene.bench.tell("reset 4 30")
    return at_s


def supply(scene: Scene) -> float:
    """Let the supply of pump and valves sag to 8 V."""
    at_s = time.monotonic()
    scene.bench.override_uv[SUPPLY_PIN] = SAGGED_UV
    return at_s


def emergency_stop(scene: Scene) -> float:
    """Ask for a stop on the graph."""
    at_s = time.monotonic()
    scene.stop.publish(Bool(data=True))
    return at_s


def repair(scene: Scene) -> None:
    """Undo what was done, so that a jam is possible again."""
    scene.bench.override_uv.clear()
    scene.bench.tell("plug")
    scene.stop.publish(Bool(data=False))
    if scene.ended:
        scene.driver.wait()
        scene.start_driver()
    else:
        os.kill(scene.driver.pid, signal.SIGCONT)


EVENTS: dict[str, tuple[Callable[[Scene], float], float]] = {
    "emergency stop": (emergency_stop, 0.1),
    "cable pulled": (cable, 0.25),
    "board reset": (reset, 0.05),
    "brown-out of the controller": (brown_out, 0.05),
    "supply of pump and valves sags": (supply, 0.05),
    "SIGSTOP of the driver": (sigstop, 0.25),
    "SIGTERM of the driver": (sigterm, 0.25),
    "kill -9 of the driver": (sigkill, 0.25),
}
"""What may happen, and within how long everything must be off at the pins, s."""
