"""Runs of the simulator: side by side, each only once, and counted."""

from __future__ import annotations

import pickle
import time
from collections import OrderedDict
from concurrent.futures import BrokenExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import cloudpickle  # type: ignore[import-untyped]  # carries no types
import numpy as np
from joblib import Parallel, cpu_count, delayed, effective_n_jobs  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.november.recording import BadRecordingError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.november.recording import Recording
    from jammkle_gap.november.simulator import Simulator

WORTH_SPREADING_S = 2.0
"""A batch that takes less than this on one core is not worth starting other processes for."""
_WORTH_SENDING_S = 0.2
"""The same, where they have been started."""
_PORTION = 8
"""Runs that each process is given at a time."""
_KEPT_BYTES = 60_000_000
"""What results kept for being asked for again may take; that of the nominal simulator is always kept."""

Signals = dict[str, "NDArray[np.float64]"]
_Result = TypeVar("_Result")
_Key = tuple[int, frozenset[tuple[str, float]]]


class StoppedError(Exception):
    """The user asked to stop; what is done so far stays."""


@dataclass(frozen=True)
class Spent:
    """What a diagnosis has cost."""

    runs: int
    """Of the simulator, one recording each."""
    simulated_s: float
    """Of recorded time that they covered."""
    wall_s: float


def run_or_none(simulator: Simulator, recording: Recording, values: Mapping[str, float]) -> Signals | None:
    """Run a recording again; None where the simulator fails, as by numbers that grow beyond all bounds."""
    try:
        return {name: np.asarray(each, dtype=np.float64) for name, each in simulator(recording, values).items()}
    except (ArithmeticError, ValueError, RuntimeError):
        return None


def _timed(simulator: Simulator, recording: Recording, values: Mapping[str, float]) -> tuple[Signals | None, float]:
    start = time.perf_counter()
    return run_or_none(simulator, recording, values), time.perf_counter() - start


def _bytes(signals: Signals | None) -> int:
    return sum(values.nbytes for values in (signals or {}).values())


def duration_s(recording: Recording) -> float:
    """Return how long a recording lasts, s."""
    return max(float(signal.time_s[-1]) for signal in recording.signals)


class Runs:
    """A simulator on several recordings."""

    def __init__(
        self,
        simulator: Simulator,
        recordings: Sequence[Recording],
        *,
        jobs: int | None = None,
        stop: Callable[[], bool] = lambda: False,
    ) -> None:
        """Prepare.

        Args:
            simulator: May be of any kind; one that cannot be pickled runs in this process.
            recordings: What to run again.
            jobs: Processes; by default one per core where that pays. Give it to use a backend of your own, chosen by
                `joblib.parallel_config`.
            stop: Asked before every batch; True ends the diagnosis with StoppedError.

        """
        self._simulator = simulator
        self.recordings = tuple(recordings)
        self._jobs = jobs
        self._stop = stop
        self._start = time.perf_counter()
        self._kept: OrderedDict[_Key, Signals | None] = OrderedDict()
        self._kept_bytes = 0
        self._silent: list[set[str]] = [set() for _ in self.recordings]
        self._leaders = tuple(range(len(self.recordings)))
        self._started = False
        self._runs = 0
        self._simulated_s = 0.0
        self._run_s = 0.0
        try:
            cloudpickle.dumps(simulator)
        except (pickle.PicklingError, TypeError, AttributeError, ValueError, RecursionError):
            self._picklable = False
        else:
            self._picklable = True

    @property
    def spent(self) -> Spent:
        """What the runs have cost so far."""
        return Spent(self._runs, self._simulated_s, time.perf_counter() - self._start)

    def nominal(self) -> list[Signals]:
        """Return what the simulator says without any effect.

        Raises:
            BadRecordingError: a nominal run fails or gives something that is not a number.

        """
        done = self.evaluate([{}])[0]
        for recording, signals in zip(self.recordings, done, strict=True):
            if signals is None:
                # Run again here, so that the simulator's own error is seen.
                self._simulator(recording, {})
                msg = f"the simulator fails on recording '{recording.name}'"
                msg = f"{msg} without any effect; check its inputs"
                raise BadRecordingError(msg)
            _check(recording, signals)
        return [signals for signals in done if signals is not None]

    def evaluate(self, points: Sequence[Mapping[str, float]]) -> list[list[Signals | None]]:
        """Run every recording at every point.

        Args:
            points: Values of effect parameters by `effect.parameter`.

        Returns:
            Per point, per recording: the signals, or None where the simulator failed.

        Raises:
            StoppedError: the user asked to stop.

        """
        keys = [[self._key(i, point) for i in range(len(self.recordings))] for point in points]
        wanted = dict.fromkeys(self._led(key) for row in keys for key in row)
        found = {key: self._kept[key] for key in wanted if key in self._kept}
        # Recording by recording, as a simulator may keep what its latest runs had in common.
        missing = sorted((key for key in wanted if key not in found), key=lambda key: key[0])
        if missing and self._stop():
            raise StoppedError
        for key, (signals, seconds) in zip(missing, self._run_all(missing), strict=True):
            found[key] = signals
            self._keep(key, signals)
            self.counted(signals, self.recordings[key[0]])
            self._run_s += seconds
        return [[self._followed(key, found[self._led(key)]) for key in row] for row in keys]

    def lead(self, leaders: Sequence[int]) -> None:
        """Take it that effects change repeats of one run alike, so that one of them is run for all.

        Args:
            leaders: By recording, the index of the one that is run for it, which is its own where it has none. What
                the others are changed by is what it is; without any effect, all have been run.

        """
        self._leaders = tuple(leaders)

    def _led(self, key: _Key) -> _Key:
        index, values = key
        return (self._leaders[index], values) if values else key

    def _followed(self, key: _Key, led: Signals | None) -> Signals | None:
        """Return the signals of a recording, from those of the one that was run for it."""
        index, values = key
        leader = self._leaders[index]
        if leader == index or not values or led is None:
            return led
        own, before = self._kept[index, frozenset()], self._kept[leader, frozenset()]
        if own is None or before is None:
            return None
        first, second = self.recordings[leader], self.recordings[index]
        found = {}
        for name, nominal in own.items():
            change = led[name] - before[name]
            found[name] = nominal + np.interp(second.signal(name).time_s, first.signal(name).time_s, change)
        return found

    def silence(self, index: int, parameters: Iterable[str]) -> None:
        """Take it that parameters change nothing in one recording, so that it is not run again for them.

        Args:
            index: Of the recording.
            parameters: By `effect.parameter`.

        """
        self._silent[index].update(parameters)

    def counted(self, result: _Result, recording: Recording) -> _Result:
        """Count a run of a recording, also one that was made elsewhere, and hand on what it gave."""
        self._runs += 1
        self._simulated_s += duration_s(recording)
        return result

    def _key(self, index: int, point: Mapping[str, float]) -> _Key:
        silent = self._silent[index]
        return index, frozenset(item for item in point.items() if item[0] not in silent)

    def _keep(self, key: _Key, signals: Signals | None) -> None:
        self._kept[key] = signals
        self._kept_bytes += _bytes(signals)
        for old in [key for key in self._kept if key[1]]:
            if self._kept_bytes <= _KEPT_BYTES:
                break
            self._kept_bytes -= _bytes(self._kept.pop(old))

    def _run_all(self, keys: Sequence[tuple[int, frozenset[tuple[str, float]]]]) -> list[tuple[Signals | None, float]]:
        tasks: list[tuple[Simulator, Recording, dict[str, float]]] = [
            (self._simulator, self.recordings[index], dict(values)) for index, values in keys
        ]
        expected_s = len(tasks) * (self._run_s / self._runs if self._runs else 0.0)
        worth_s = _WORTH_SENDING_S if self._started else WORTH_SPREADING_S
        spread = self._jobs is not None or (cpu_count() > 1 and expected_s > worth_s)
        if len(tasks) < 2 or not self._picklable or self._jobs == 1 or not spread:  # noqa: PLR2004  # one needs no help
            return self._one_by_one(tasks)
        workers = self._jobs if self._jobs is not None else -1
        parallel: Any = Parallel(n_jobs=workers)
        # In portions, so that a wish to stop is heard.
        portion = _PORTION * effective_n_jobs(workers)
        done: list[tuple[Signals | None, float]] = []
        try:
            for first in range(0, len(tasks), portion):
                if first and self._stop():
                    raise StoppedError
                done += parallel(delayed(_timed)(*task) for task in tasks[first : first + portion])
        except BrokenExecutor:
            # A process died, or could not import what the simulator is made of: here it is at hand.
            self._picklable = False
            done = self._one_by_one(tasks)
        else:
            self._started = True
        return done

    def _one_by_one(
        self, tasks: Sequence[tuple[Simulator, Recording, dict[str, float]]]
    ) -> list[tuple[Signals | None, float]]:
        done = []
        for task in tasks:
            if self._stop():
                raise StoppedError
            done.append(_timed(*task))
        return done


def _check(recording: Recording, signals: Mapping[str, NDArray[np.float64]]) -> None:
    for name, values in signals.items():
        try:
            expected = recording.signal(name).values.shape
        except KeyError:
            msg = f"the simulator gives '{name}', which recording '{recording.name}' does not have"
            msg = f"{msg}; return only signals of the recording"
            raise BadRecordingError(msg) from None
        if values.shape != expected:
            msg = f"the simulator gives '{name}' with shape {values.shape} for recording '{recording.name}'"
            msg = f"{msg}; it must be {expected}, one value for each measured time"
            raise BadRecordingError(msg)
        if not np.isfinite(values).all():
            msg = f"the simulator gives '{name}' as not a number for recording '{recording.name}' at no effect"
            msg = f"{msg}; check its inputs"
            raise BadRecordingError(msg)
