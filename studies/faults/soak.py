"""Half an hour of jamming with something going wrong every few seconds, watched at the board's outputs."""

from __future__ import annotations

import resource
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from fault_bench import PLACED, FaultBench
from jammkle_common.names import CHANNELS
from jammkle_driver.core.channel import ChannelState
from jammkle_driver.core.faults import Reason
from jammkle_driver.core.hardware import LinkState, ResetCause, released
from jammkle_driver.core.requests import RequestError
from jammkle_driver.fake import WATCHDOG_S, LinkFault
from jammkle_driver.parameters import TICK_PERIOD_S, DriverParameters
from studies.faults.trial import drawn_fault

if TYPE_CHECKING:
    from collections.abc import Callable

_BETWEEN_S = (2.0, 8.0)
_RECOVERY_S = 4.0
_SETTLE_S = 1.5
_MOST_GROWN_KIB = 4096.0
"""Memory that a soak may come to hold after its first tenth, KiB: half an hour grew by 0 to 128 KiB. Chosen."""
_OF_THE_PLANT = 0.6
"""Share of the mishaps that befall pump, valves, air and sensors; the rest befalls board, line, and driver."""
_STALL_S = 1.5
_WATCHDOG_BOUND_S = WATCHDOG_S
"""What the firmware promises, s; the board of the bench is held to it."""
_FROM_STEP_TO_STEP_S = 0.02
"""What is due now may take two steps of the bench."""


@dataclass(frozen=True)
class SoakResult:
    """What came of a soak.

    Attributes:
        simulated_s: Time that passed, s.
        faults: Mishaps.
        reported: Those that were reported.
        missed: Moments at which an output was on that had to be off, or a channel that did not recover.
        grown_kib: How much more memory the process has come to hold after the first tenth, KiB.

    """

    simulated_s: float
    faults: int
    reported: int
    missed: tuple[str, ...]
    grown_kib: float


def soak(duration_s: float, seed: int) -> SoakResult:
    """Jam and vent while something fails every few seconds, is reported or not, and is repaired."""
    bench = FaultBench(DriverParameters(), seed)
    draw, missed = bench.draw, []
    faults = reported = 0
    base_kib = None
    while bench.plant.time_s < duration_s:
        watch = _Watch(bench)
        _run(bench, draw.uniform(*_BETWEEN_S), watch)
        _break_something(bench, watch)
        faults += 1
        _run(bench, draw.uniform(*_BETWEEN_S), watch)
        reported += bench.reported()[0] is not Reason.NONE
        missed += watch.missed
        missed += _recover(bench)
        if base_kib is None and bench.plant.time_s > duration_s / 10.0:
            base_kib = _most_held_kib()
    grown_kib = _most_held_kib() - (base_kib or 0.0)
    return SoakResult(bench.plant.time_s, faults, reported, tuple(missed), grown_kib)


class _Watch:
    """Looks at the outputs of the board: off by when they must be, whatever the driver says of them."""

    def __init__(self, bench: FaultBench) -> None:
        self._bench = bench
        self._due: list[tuple[float, str]] = []
        self._reported = False
        self.missed: list[str] = []

    def must_be_off(self, within_s: float, because: str) -> None:
        """Expect all outputs off from then on."""
        self._due.append((self._bench.plant.time_s + within_s + _FROM_STEP_TO_STEP_S, because))

    def look(self) -> None:
        """Compare with what the outputs do now; what is reported as a FAULT has a tick to get there."""
        faulty = self._bench.driver.ankle.faulty
        if faulty and not self._reported:
            self._reported = True
            # Where the cable is pulled, the board has its watchdog's time.
            connected = self._bench.link.state is LinkState.CONNECTED
            self.must_be_off(TICK_PERIOD_S if connected else _WATCHDOG_BOUND_S, f"{faulty[0].name} is in FAULT")
        time_s, driven = self._bench.plant.time_s, self._bench.board.driven
        if driven != released(CHANNELS):
            late = [each for each in self._due if time_s > each[0]]
            self.missed += [f"{time_s:.2f} s: {because}, and {driven} goes on" for _, because in late]
            self._due = [each for each in self._due if each not in late]


def _run(bench: FaultBench, duration_s: float, watch: _Watch) -> None:
    end_s = bench.plant.time_s + duration_s
    while bench.plant.time_s < end_s:
        bench.wander()
        bench.step()
        watch.look()


def _break_something(bench: FaultBench, watch: _Watch) -> None:
    """Let one thing go wrong; where that must end in the safe state, say by when."""
    draw = bench.draw
    if draw.random() < _OF_THE_PLANT:
        fault, size = drawn_fault(draw.choice(list(PLACED)), draw)
        bench.plant.inject(fault, draw.choice(CHANNELS), size)
        return
    mishaps: tuple[Callable[[FaultBench, _Watch], None], ...] = (_unplug, _reboot, _brown_out, _noise, _stall, _stop)
    draw.choice(mishaps)(bench, watch)


def _unplug(bench: FaultBench, watch: _Watch) -> None:
    bench.board.inject(LinkFault.UNPLUGGED)
    watch.must_be_off(_WATCHDOG_BOUND_S, "the board is unplugged")


def _reboot(bench: FaultBench, watch: _Watch) -> None:
    bench.board.reboot(bench.draw.choice((ResetCause.EXTERNAL, ResetCause.WATCHDOG)))
    _expect_latched(bench, watch, "the board has rebooted")


def _brown_out(bench: FaultBench, watch: _Watch) -> None:
    bench.board.inject(LinkFault.BROWN_OUT)
    _expect_latched(bench, watch, "the supply has sagged")


def _expect_latched(bench: FaultBench, watch: _Watch, because: str) -> None:
    """What was jammed must not go on; where nothing was, the board is acknowledged, and may be jammed."""
    jammed = bench.driver.ankle.jammed
    _pass(bench, TICK_PERIOD_S)  # in which the driver sees it, and nobody asks for anything else
    if jammed:
        watch.must_be_off(0.0, because)


def _noise(bench: FaultBench, _watch: _Watch) -> None:
    bench.noisy = True


def _stall(bench: FaultBench, watch: _Watch) -> None:
    """A driver that stands still, or is killed and started again: the board is on its own meanwhile."""
    bench.stand_still(_STALL_S)
    if bench.board.driven != released(CHANNELS):
        watch.missed.append(f"{bench.plant.time_s:.2f} s: a stall of {_STALL_S} s, and {bench.board.driven} goes on")


def _stop(bench: FaultBench, watch: _Watch) -> None:
    bench.driver.emergency_stop(stop=True, now=bench.now)
    watch.must_be_off(0.0, "an emergency stop")


def _recover(bench: FaultBench) -> list[str]:
    """Repair everything, clear, and jam all; return what did not come back."""
    bench.plant.heal()
    bench.board.plug()
    bench.noisy = False
    bench.driver.unjam((), "soak")
    bench.driver.emergency_stop(stop=False, now=bench.now)
    _pass(bench, _SETTLE_S)
    bench.driver.clear_fault(bench.now)
    _pass(bench, _SETTLE_S)
    try:
        bench.driver.jam((), 40e3, "soak")
    except RequestError as error:
        return [f"{bench.plant.time_s:.2f} s: {error}"]
    for _ in range(round(_RECOVERY_S / 0.01)):
        bench.step()
        if all(channel.state is ChannelState.JAMMED for channel in bench.driver.ankle.channels.values()):
            return []
    return [f"{bench.plant.time_s:.2f} s: not jammed after the repair: {bench.driver.trouble.why.text}"]


def _pass(bench: FaultBench, duration_s: float) -> None:
    for _ in range(round(duration_s / 0.01)):
        bench.step()


def _most_held_kib() -> float:
    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)


def main(
    minutes: Annotated[float, typer.Option(min=0.1, help="Simulated time, min.")] = 30.0,
    seed: Annotated[int, typer.Option(min=0, help="Start of all that is random.")] = 0,
) -> None:
    """Jam with random faults for long; exits 1 where anything was unsafe, or memory has grown."""
    result = soak(minutes * 60.0, seed)
    typer.echo(
        f"{result.simulated_s / 60.0:.1f} min, {result.faults} faults, {result.reported} reported, "
        f"{len(result.missed)} missed safe states or stuck channels, memory {result.grown_kib:+.0f} KiB"
    )
    for line in result.missed[:20]:
        typer.echo(line)
    raise typer.Exit(1 if result.missed or result.grown_kib > _MOST_GROWN_KIB else 0)


if __name__ == "__main__":
    typer.run(main)
