"""Runs of the simulator: side by side, each only once, and counted."""

from __future__ import annotations

import pickle
import time
from concurrent.futures import BrokenExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cloudpickle  # type: ignore[import-untyped]  # carries no types
import numpy as np
from joblib import Parallel, cpu_count, delayed  # type: ignore[import-untyped]  # carries no types

from jammkle_sim.gap.recording import BadRecordingError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_sim.gap.recording import Recording
    from jammkle_sim.gap.simulator import Simulator

WORTH_SPREADING_S = 2.0
"""A batch that takes less than this on one core is not worth starting other processes for."""

Signals = dict[str, "NDArray[np.float64]"]


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


def _run(simulator: Simulator, recording: Recording, values: Mapping[str, float]) -> tuple[Signals | None, float]:
    start = time.perf_counter()
    try:
        signals = {name: np.asarray(each, dtype=np.float64) for name, each in simulator(recording, values).items()}
    except (ArithmeticError, ValueError, RuntimeError):
        return None, time.perf_counter() - start
    return signals, time.perf_counter() - start


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
        self._cache: dict[tuple[int, frozenset[tuple[str, float]]], Signals | None] = {}
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
        keys = [[(i, frozenset(point.items())) for i in range(len(self.recordings))] for point in points]
        missing = list(dict.fromkeys(key for row in keys for key in row if key not in self._cache))
        if missing and self._stop():
            raise StoppedError
        for key, (signals, seconds) in zip(missing, self._run_all(missing), strict=True):
            self._cache[key] = signals
            self._runs += 1
            self._run_s += seconds
            self._simulated_s += duration_s(self.recordings[key[0]])
        return [[self._cache[key] for key in row] for row in keys]

    def _run_all(self, keys: Sequence[tuple[int, frozenset[tuple[str, float]]]]) -> list[tuple[Signals | None, float]]:
        tasks: list[tuple[Simulator, Recording, dict[str, float]]] = [
            (self._simulator, self.recordings[index], dict(values)) for index, values in keys
        ]
        expected_s = len(tasks) * (self._run_s / self._runs if self._runs else 0.0)
        spread = self._jobs is not None or (cpu_count() > 1 and expected_s > WORTH_SPREADING_S)
        if len(tasks) < 2 or not self._picklable or self._jobs == 1 or not spread:  # noqa: PLR2004  # one needs no help
            return self._one_by_one(tasks)
        parallel: Any = Parallel(n_jobs=self._jobs if self._jobs is not None else -1)
        try:
            done: list[tuple[Signals | None, float]] = parallel(delayed(_run)(*task) for task in tasks)
        except BrokenExecutor:
            # A process died, or could not import what the simulator is made of: here it is at hand.
            self._picklable = False
            done = self._one_by_one(tasks)
        return done

    def _one_by_one(
        self, tasks: Sequence[tuple[Simulator, Recording, dict[str, float]]]
    ) -> list[tuple[Signals | None, float]]:
        done = []
        for task in tasks:
            if self._stop():
                raise StoppedError
            done.append(_run(*task))
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
