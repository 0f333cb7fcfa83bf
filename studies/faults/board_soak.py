"""Jam a real driver on the board's firmware, through line and pins, with something going wrong every few seconds.

`make soak` does so for half an hour. What is unsafe is reported: an output that stays on where it had to be off, or a
channel that does not come back once all is repaired.
"""

from __future__ import annotations

import os
import random
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import psutil
import typer
from faulty_plant import FaultyPlant

from board_scene import EVENTS, Scene, all_off, repair
from boards import board_command
from domains import own_domain
from fault_bench import PLACED
from jammkle_common.names import CHANNELS, JAM_ALL, JAM_STATE, UNJAM_ALL
from jammkle_msgs.msg import Fault
from studies.faults.trial import drawn_fault

if TYPE_CHECKING:
    from collections.abc import Sequence

    from board_scene import Event

_BETWEEN_S = (1.0, 5.0)
"""How long the ankle is jammed and vented before something goes wrong, and with a fault of the plant, s."""
_OF_THE_PLANT = 0.5
"""Share of the mishaps that befall pump, valves, air and sensors; the rest befalls board, line, driver, controller."""
_ACTION_S = (0.3, 1.5)
_MOST_GROWN_KIB = 4096.0
"""Memory that a driver may come to hold after the first tenth, KiB. Chosen, as of the soak in process."""
_ENDING = ("SIGTERM of the driver", "kill -9 of the driver")
"""Mishaps that would hide whether the driver's memory grows: another driver follows."""


@dataclass(frozen=True)
class BoardSoak:
    """What came of it.

    Attributes:
        duration_s: Time that passed, s.
        faults: Things that went wrong in the plant, of which `reported` were reported before their repair.
        reported: See `faults`.
        events: Things that befell board, line, driver and controller; after each all outputs went off.
        late: Those of them after which that took longer than the bound in docs/hardware.md, with how long, s.
        missed: What was unsafe.
        grown_kib: How much more memory the driver has come to hold after the first tenth, KiB.

    """

    duration_s: float
    faults: int
    reported: int
    events: int
    late: tuple[str, ...]
    missed: tuple[str, ...]
    grown_kib: float


def soak(command: Sequence[str], duration_s: float, seed: int) -> BoardSoak:
    """Let things go wrong on one driver for `duration_s` s; what and when is drawn from `seed`."""
    plant = FaultyPlant()
    with tempfile.TemporaryDirectory(prefix="jammkle_soak") as folder, own_domain() as domain_id:
        scene = Scene(command, Path(folder, "board"), domain_id, plant)
        try:
            return _Soak(scene, plant, random.Random(seed)).run(duration_s)  # noqa: S311 - a simulation and no secret
        finally:
            scene.close()


class _Soak:
    def __init__(self, scene: Scene, plant: FaultyPlant, draw: random.Random) -> None:
        self._scene, self._plant, self._draw = scene, plant, draw
        self._faults = self._reported = self._events = 0
        self._late: list[str] = []
        self._missed: list[str] = []

    def run(self, duration_s: float) -> BoardSoak:
        began_s, base_kib = time.monotonic(), None
        self._scene.know_atmosphere()
        self._come_back("the start")
        while not self._missed and time.monotonic() - began_s < duration_s:
            self._wander(self._draw.uniform(*_BETWEEN_S))
            if self._draw.random() < _OF_THE_PLANT:
                self._break()
            else:
                names = [name for name in EVENTS if name not in _ENDING]
                self._befall(self._draw.choice(names))
            if base_kib is None and time.monotonic() - began_s > duration_s / 10.0:
                base_kib = self._held_kib()
        grown_kib = self._held_kib() - (base_kib or 0.0)
        duration_s = time.monotonic() - began_s
        late, missed = tuple(self._late), tuple(self._missed)
        return BoardSoak(duration_s, self._faults, self._reported, self._events, late, missed, grown_kib)

    def _break(self) -> None:
        """Let something fail in the plant; what is reported as a FAULT must end at the pins."""
        fault, size = drawn_fault(self._draw.choice(list(PLACED)), self._draw)
        place = self._draw.choice(CHANNELS)
        self._faults += 1
        self._plant.inject(fault, place, size)
        self._wander(self._draw.uniform(*_BETWEEN_S))
        what = f"{fault.value} {place} {size:.3g}"
        if self._fault().reason not in {Fault.UNKNOWN, Fault.LINE_NOISE, Fault.EXECUTOR_OVERLOADED}:
            self._reported += 1
            if self._scene.in_fault():
                self._off(what, time.monotonic())
        self._plant.heal()
        self._come_back(what)

    def _befall(self, name: str) -> None:
        """Let something befall what is jammed; all outputs must go off, whoever is left to see to it."""
        event: Event = EVENTS[name]
        self._events += 1
        event.jam(self._scene)
        took_s = self._off(name, event.happen(self._scene))
        if took_s < 0.0:
            self._missed.append(f"{name}: the outputs were off {-took_s:.3f} s before it")
        if took_s > event.bound_s:
            self._late.append(f"{name}: {took_s:.3f} s, and {event.bound_s:g} s is its bound")
        repair(self._scene)
        self._come_back(name)

    def _off(self, what: str, since_s: float) -> float:
        try:
            return float(self._scene.delay_s(since_s, all_off))
        except AssertionError:
            self._missed.append(f"{what}: {self._scene.bench.edges[-1]} goes on")
            return 0.0

    def _come_back(self, after: str) -> None:
        try:
            self._scene.jam()
        except AssertionError:
            self._missed.append(f"not jammed after {after}: {self._fault().text}")

    def _wander(self, duration_s: float) -> None:
        """Jam and vent at random."""
        end_s = time.monotonic() + duration_s
        while (now_s := time.monotonic()) < end_s:
            wait_s = min(now_s + self._draw.uniform(*_ACTION_S), end_s)
            self._scene.probe.call(self._draw.choice((JAM_ALL, UNJAM_ALL)))
            self._scene.probe.spin_until(lambda until_s=wait_s: time.monotonic() >= until_s, "a while has passed")

    def _fault(self) -> Fault:
        return self._scene.probe.last(JAM_STATE).fault

    def _held_kib(self) -> float:
        return psutil.Process(self._scene.driver.pid).memory_info().rss / 1024.0


def main(
    minutes: Annotated[float, typer.Option(min=0.1, help="Time, min; the firmware runs in real time.")] = 30.0,
    seed: Annotated[int, typer.Option(min=0, help="Start of all that is random.")] = 0,
) -> None:
    """Let things go wrong on the firmware for long; exits 1 where anything was unsafe, or memory has grown."""
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    with tempfile.TemporaryDirectory(prefix="jammkle_firmware") as folder:
        result = soak(board_command(Path(folder)), minutes * 60.0, seed)
    typer.echo(
        f"{result.duration_s / 60.0:.1f} min on the firmware, {result.faults} faults of the plant, "
        f"{result.reported} reported, "
        f"{result.events} of board, line, driver and controller, {len(result.late)} later than their bound, "
        f"{len(result.missed)} missed safe states or stuck channels, memory {result.grown_kib:+.0f} KiB"
    )
    for line in (*result.missed, *result.late):
        typer.echo(line)
    sys.exit(1 if result.missed or result.grown_kib > _MOST_GROWN_KIB else 0)


if __name__ == "__main__":
    typer.run(main)
