"""A board on a bench: its firmware as a process, and behind its pins, over a socket, the simulated plant in real time.

    .venv/bin/python test/board_bench.py --firmware jammkle_driver/firmware/build/board --port /tmp/jammkle_board

makes a serial device that behaves like a board with pump, valves and sensors. The messages on the socket are described
in jammkle_driver/firmware/host/wires.h.
"""

from __future__ import annotations

import queue
import select
import socket
import subprocess
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from jammkle_common.names import CHANNELS
from jammkle_common.runner import StopFlag
from jammkle_sim.physics.pneumatics import MANIFOLD, PneumaticParameters
from jammkle_sim.physics.sensors import SensorParameters
from pump_bench import Pneumatics

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType


TIMESTEP_S = 0.0005
REFERENCE_V = 5.0
"""Supply of sensors and converter, V: the sensors are ratiometric, so that it cancels."""
SUPPLY_V = 12.0
SUPPLY_DIVIDER = 0.25
"""Share of the supply at its analogue pin: 20 V give the reference."""

_SENSOR_PER_PA = 0.009e-3
_SENSOR_AT_VACUUM = -0.095
"""Transfer function of the MPX4115A class, as a share of its supply: 0.009 p/kPa - 0.095 (NXP data sheet MPX4115A)."""
_MICROVOLTS = 1e6


class BoardPlant:
    """The air of one ankle between a board's outputs and its analogue pins.

    Attributes:
        air: The air, whose lines can be pinched and punctured.
        supply_v: Voltage of the supply, V.

    """

    def __init__(self, parameters: PneumaticParameters | None = None, seed: int = 0) -> None:
        """Start vented, the supply on, with constants and sensor noise of the simulation unless others are given."""
        built = parameters or PneumaticParameters()
        self.air = Pneumatics(built, TIMESTEP_S)
        self._noise = np.random.default_rng(seed)
        self._noise_pa = SensorParameters().pressure_noise_pa
        self._ahead_s = 0.0
        self._pressure_pa = np.full(1 + len(CHANNELS), built.ambient_pa)
        self.supply_v = SUPPLY_V

    @property
    def pressures_pa(self) -> dict[str, float]:
        """Absolute pressure of each channel and the manifold, Pa, without noise."""
        manifold, *channels = self._pressure_pa
        return {**dict(zip(CHANNELS, channels, strict=True)), MANIFOLD: float(manifold)}

    def sensed_pa(self) -> dict[str, float]:
        """Return what the sensors make of the pressures now, with their noise, Pa absolute."""
        noise_pa = self._noise_pa * self._noise.standard_normal(1 + len(CHANNELS))
        return {place: true + off for (place, true), off in zip(self.pressures_pa.items(), noise_pa, strict=True)}

    def drive(self, solenoids: int, duty: float) -> None:
        """Set what the pins do: solenoids in bits, in the order of the channels; duty 0 to 1."""
        first, second, third = (bool(solenoids >> bit & 1) for bit in range(len(CHANNELS)))
        self.air.command(duty, (first, second, third))

    def advance(self, elapsed_s: float) -> None:
        """Let time pass; what is less than a step is kept for the next call."""
        self._ahead_s += elapsed_s
        steps = int(self._ahead_s / TIMESTEP_S)
        if steps > 0:
            self._ahead_s -= steps * TIMESTEP_S
            self._pressure_pa = self.air.advance(steps)[-1]

    def pins_uv(self) -> list[int]:
        """Voltages at the analogue pins, uV: three channels, the manifold, the supply's divider."""
        sensed_pa = self.sensed_pa()
        supply_uv = round(self.supply_v * SUPPLY_DIVIDER * _MICROVOLTS)
        return [*(sensor_uv(sensed_pa[place]) for place in (*CHANNELS, MANIFOLD)), supply_uv]


def sensor_uv(pressure_pa: float) -> int:
    """Return a sensor's voltage at an absolute pressure, uV; it ends at its rails."""
    share = min(max(_SENSOR_PER_PA * pressure_pa + _SENSOR_AT_VACUUM, 0.0), 1.0)
    return round(share * REFERENCE_V * _MICROVOLTS)


_PERIOD_S = 0.002
_START_TIMEOUT_S = 20.0
_LARGEST_LAG_S = 0.1
"""Most time that the plant makes up for at once, s; a machine that stood still must not find another ankle."""
_MICROSECONDS = 1e6
_FULL_DUTY = 1000.0


@dataclass(frozen=True)
class Edge:
    """The outputs from one moment on."""

    at_s: float
    """The moment, s of the machine's monotonic clock."""
    solenoids: int
    """As bits."""
    duty: float
    """0 to 1."""
    board_s: float
    """The moment on the board's own clock, s, which stands still where the machine does not run the board."""


class BoardBench:
    """Runs a board's firmware and the plant behind its pins until closed."""

    def __init__(
        self,
        command: list[str],
        port: Path,
        plant: BoardPlant | None = None,
        *,
        store: Path | None = None,
        baud: int = 115200,
    ) -> None:
        """Start the firmware and the plant, and wait until the serial device is there.

        Args:
            command: The firmware's program, and what it needs before its own options.
            port: Where the serial device shall appear.
            plant: What is behind the pins; None: an ankle as the simulation has it.
            store: File in which the firmware keeps its calibration; None: it forgets.
            baud: Rate of the line.

        Raises:
            TimeoutError: the firmware did not come up.

        """
        self.plant = plant or BoardPlant()
        self.edges: list[Edge] = []
        self.resets_s: list[float] = []
        """When the chip was reset, s of the board's own clock."""
        self.longest_gap_s = 0.0
        """Longest time for which a busy machine let the plant stand still, s; whoever asks may set it back to 0."""
        self._marks_s: queue.SimpleQueue[float] = queue.SimpleQueue()
        self.override_uv: dict[int, int] = {}
        """Voltage at analogue pins whose sensor is not asked, uV, by pin: a broken wire, a stuck sensor."""
        self.plant.advance(_PERIOD_S)  # compiles what it needs
        self._folder = tempfile.TemporaryDirectory(prefix="jammkle_board")
        self._stop = threading.Event()
        path = Path(self._folder.name, "pins")
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as server:
            server.bind(str(path))
            server.listen(1)
            options = ["-l", str(port), "-p", str(path), "-b", str(baud)]
            options += [] if store is None else ["-s", str(store)]
            self.process = subprocess.Popen([*command, *options])
            self._await(lambda: bool(select.select([server], [], [], _PERIOD_S)[0]), "connected to no pins")
            self._pins, _ = server.accept()
        self._tell_pins()  # before the first request can ask for them
        self._thread = threading.Thread(target=self._run, name="plant", daemon=True)
        self._thread.start()
        self._await(port.exists, f"made no serial device {port}")

    @property
    def released(self) -> bool:
        """Whether every output is off now."""
        return not self.edges or (self.edges[-1].solenoids == 0 and self.edges[-1].duty == 0.0)

    def tell(self, message: str) -> None:
        """Do something to the board: `reset CAUSE MS`, `hang`, `unplug`, `plug`, `noise_in N`, `noise_out N`."""
        self._pins.sendall(f"{message}\n".encode())

    def put(self, pin: int, voltage_uv: int) -> float:
        """Put a voltage, uV, onto an analogue pin, whatever its sensor says; return when, s of the board's clock."""
        self.override_uv[pin] = voltage_uv
        self._tell_pins()
        return self.mark("mark")

    def mark(self, message: str) -> float:
        """Tell the board `mark` or `hang`; return when it took it, s of the board's clock.

        Raises:
            queue.Empty: it did not answer.

        """
        self.tell(message)
        return self._marks_s.get(timeout=_START_TIMEOUT_S)

    def close(self) -> None:
        """End the firmware and the plant."""
        self._stop.set()
        self.process.terminate()
        self.process.wait()
        if self._thread.is_alive():
            self._thread.join()
        self._pins.close()
        self._folder.cleanup()

    def __enter__(self) -> BoardBench:  # noqa: PYI034 - Self is not in Python 3.10
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()

    def _await(self, holds: Callable[[], bool], failed: str) -> None:
        deadline_s = time.monotonic() + _START_TIMEOUT_S
        while not holds():
            if time.monotonic() > deadline_s or self.process.poll() is not None:
                self.process.kill()
                self.process.wait()
                msg = f"the firmware {self.process.args!r} {failed}"
                raise TimeoutError(msg)
            time.sleep(_PERIOD_S)

    def _run(self) -> None:
        last_s = before_s = time.monotonic()
        pending = b""
        try:
            while not self._stop.is_set():
                readable, _, _ = select.select([self._pins], [], [], _PERIOD_S)
                if readable:
                    came = self._pins.recv(4096)
                    if not came:
                        return
                    *lines, pending = (pending + came).split(b"\n")
                    for line in lines:
                        last_s = self._take(line.decode(), last_s)
                last_s = self._advance(last_s, time.monotonic())
                self._tell_pins()
                told_s = time.monotonic()
                self.longest_gap_s = max(self.longest_gap_s, told_s - before_s)
                before_s = told_s
        except OSError:  # the firmware has ended
            return

    def _tell_pins(self) -> None:
        pins = self.plant.pins_uv()
        for pin, voltage_uv in tuple(self.override_uv.items()):
            pins[pin] = voltage_uv
        self.tell(f"adc {' '.join(map(str, pins))}")

    def _advance(self, last_s: float, to_s: float) -> float:
        """Take the plant on to a moment, and return the latest that it has come to."""
        if to_s > last_s:
            self.plant.advance(min(to_s - last_s, _LARGEST_LAG_S))
        return max(to_s, last_s)

    def _take(self, line: str, last_s: float) -> float:
        """Let outputs act from when they changed, however late that is known; return the time of the plant."""
        kind, *numbers = line.split()
        board_s = float(numbers[-1]) / _MICROSECONDS
        if kind != "out":
            take = {"mark": self._marks_s.put, "reset": self.resets_s.append}
            take[kind](board_s)
            return last_s
        solenoids, duty, at_us, _ = numbers
        edge = Edge(float(at_us) / _MICROSECONDS, int(solenoids), float(duty) / _FULL_DUTY, board_s)
        last_s = self._advance(last_s, edge.at_s)
        self.edges.append(edge)
        self.plant.drive(edge.solenoids, edge.duty)
        return last_s


def main(
    firmware: Annotated[Path, typer.Option(help="The firmware for the host: `make firmware` builds it.")],
    port: Annotated[Path, typer.Option(help="Where the serial device shall appear.")] = Path("/tmp/jammkle_board"),  # noqa: S108 - a device's link
    store: Annotated[Path | None, typer.Option(help="File in which the board keeps its calibration.")] = None,
    baud: Annotated[int, typer.Option(help="Rate of the line.")] = 115200,
) -> None:
    """Run a board with a simulated plant behind its pins until Ctrl-C."""
    import signal  # noqa: PLC0415 - here alone

    stop = StopFlag()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop.stop)
    with BoardBench([str(firmware)], port, store=store, baud=baud) as bench:
        typer.echo(f"a board is at {port}; Ctrl-C stops")
        while not stop and bench.process.poll() is None:
            time.sleep(_LARGEST_LAG_S)


if __name__ == "__main__":
    typer.run(main)
