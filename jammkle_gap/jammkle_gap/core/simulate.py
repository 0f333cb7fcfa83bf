"""What the diagnosis asks of a simulator, and runs of it side by side."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, ParamSpec, Protocol, TypeVar, cast

import cloudpickle  # type: ignore[import-untyped]  # carries no types
import numpy as np
from joblib import Parallel, delayed  # type: ignore[import-untyped]  # carries no types
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.core.features import features_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.data import Recording
    from jammkle_gap.core.effects import Library, Nuisance
    from jammkle_gap.core.features import Alignment, Layout

    Progress = Callable[[str, float], None]
    """Takes what is being done, and the share of it that is done, 0 to 1."""
    Stop = Callable[[], bool]
    """Asked after every run; True ends the work. One with `at_once` (`StopRequest`) ends a run in its middle, too."""


T = TypeVar("T")
P = ParamSpec("P")


def on_one_thread(function: Callable[P, T]) -> Callable[P, T]:
    """Make a function's linear algebra run on one thread.

    Its matrices are narrow, so that a second thread gains little. Beside other programs the two wait for one another
    through the time slices of these: a product of 6 ms took 5.6 s beside five of them.
    """
    return cast("Callable[P, T]", threadpool_limits.wrap(limits=1, user_api="blas")(function))


class InfeasibleError(ValueError):
    """A simulator cannot run with these values, as where it blows up: they are no explanation."""


class SimulatorError(RuntimeError):
    """A simulator, or a user's effect in it, failed; the message names recording and parameters."""


class UnrunnableError(SimulatorError):
    """A recording cannot be run at all with some constants of the machine; the message names it."""


class StoppedError(RuntimeError):
    """Asked to stop on the way."""

    def __init__(self, done: Sequence[Any] = ()) -> None:
        """Keep what was done until then, in order."""
        super().__init__("asked to stop")
        self.done = tuple(done)


class Simulator(Protocol):
    """Runs a recording again. Must be picklable if runs are to be spread over processes."""

    def __call__(self, recording: Recording, values: Mapping[str, float]) -> Mapping[str, NDArray[np.float64]]:
        """Run again what was commanded, and return what would have been measured, without noise.

        Args:
            recording: What was measured; its `inputs` say what to run.
            values: Parameters of effects by `effect.parameter`, and nuisances by name; those not named are null.

        Returns:
            By signal name, at the times of the recording's signal. A signal that the simulator does not know is left
            out, and so not compared.

        Raises:
            InfeasibleError: it cannot be run with these values.

        """


class Sensing(Protocol):
    """Effects of sensors and clocks, which act on what was measured: exact, however wrong the simulator is.

    So do delays of commands, for signals that follow these alone. The simulator says what they make of the others.
    """

    @property
    def effects(self) -> frozenset[str]:
        """Names of the effects that it knows."""

    def knows(self, effect: str, signal: str) -> bool:
        """Return whether it says what one of its effects makes of a signal; if not, the simulator does."""

    def without_references(self) -> Sensing:
        """Return what is to say it where no healthy run was read, and simulated readings stand in.

        Effects that it does not have are the simulator's there, such as those that change its inputs, too: a motion
        that drives it, measured late.
        """

    def __call__(
        self, recording: Recording, measured: Mapping[str, NDArray[np.float64]], values: Mapping[str, float]
    ) -> Mapping[str, NDArray[np.float64]]:
        """Return what would have been read had the sensors been like this.

        Args:
            recording: Times of the samples.
            measured: By signal, at the recording's times.
            values: By `effect.parameter`, of its effects alone.

        """


@dataclass(frozen=True)
class Problem:
    """A machine to be diagnosed: its simulator, what may differ, and how its runs are looked at."""

    simulator: Simulator
    library: Library
    scatter: tuple[Nuisance, ...] = ()
    """What no two runs have the same."""
    constants: tuple[Nuisance, ...] = ()
    """What no two machines have the same: calibrated to references, or fitted beside every candidate without them."""
    sensing: Sensing | None = None
    alignment: Alignment | None = None
    accuracy: float = 0.0
    """Share of each signal's range that the simulator may be off by though its constants are right. Without references
    a gap is what is larger. 0: its equations are the machine's."""
    bin_s: Callable[[Recording], float] = lambda _: 0.02
    """Length of a bin, s."""
    coarse: Callable[[Recording], Recording] = lambda recording: recording
    """A recording as it is run for signatures, derivatives and a search, of which differences count alone: in longer
    steps of time, where these make the same difference in less time. Of such a one it returns what is the same."""
    version: str = ""
    """What tells this simulator from others and from its other versions; empty: no dictionary is kept on disk."""
    group_of: Callable[[Recording], str] = lambda recording: recording.setting
    """Text that is the same for recordings whose signatures are the same; empty: none is kept on disk."""


@dataclass(frozen=True)
class Task:
    """One run to be made."""

    recording: Recording
    layout: Layout
    values: Mapping[str, float]


class Made(NamedTuple):
    """Runs that were made elsewhere."""

    runs: int
    simulated_s: float


class Runner:
    """Makes runs, several at a time, and counts them. Joblib's backend is the user's choice (`parallel_config`)."""

    def __init__(
        self, problem: Problem, jobs: int = -1, progress: Progress | None = None, stop: Stop | None = None
    ) -> None:
        """Prepare.

        Args:
            problem: Its simulator and alignment.
            jobs: Runs at a time, as joblib counts; -1: one per core.
            progress: Takes reports of long work.
            stop: Asked after every run.

        """
        self._problem = problem
        self._jobs = jobs if jobs == 1 or _sendable(problem) else 1
        self._progress = progress or (lambda _what, _share: None)
        self._stop = stop or (lambda: False)
        self.runs = 0
        """Made so far."""
        self.simulated_s = 0.0

    def count(self, made: Iterable[Made]) -> None:
        """Add runs that were made in other processes."""
        for each in made:
            self.runs += each.runs
            self.simulated_s += each.simulated_s

    def features(self, tasks: Sequence[Task], what: str = "") -> list[NDArray[np.float64]]:
        """Return the features of every task, in order; NaN throughout where it is infeasible.

        Args:
            tasks: To be run.
            what: Of the progress; empty: none is reported.

        Raises:
            SimulatorError: the simulator failed.
            StoppedError: asked to stop.

        """
        self.count([Made(len(tasks), sum(task.recording.duration_s for task in tasks))])
        return self.map(run_task, [(self._problem.simulator, self._problem.alignment, task) for task in tasks], what)

    def map(self, function: Callable[..., T], arguments: Sequence[tuple[object, ...]], what: str = "") -> list[T]:
        """Return a function's answers to several arguments, in order, side by side.

        Raises:
            StoppedError: asked to stop.

        """
        count = len(arguments)
        found: Iterable[T] = (function(*each) for each in arguments)
        if self._jobs != 1 and count > 1:
            parallel = Parallel(n_jobs=self._jobs, return_as="generator", pre_dispatch="4*n_jobs")
            found = parallel(delayed(function)(*each) for each in arguments)
        collected: list[T] = []
        # A run may take long: who can, ends it in its middle.
        at_once = getattr(self._stop, "at_once", contextlib.nullcontext)
        try:
            with at_once(StoppedError):
                for done, each in enumerate(found, 1):
                    collected.append(each)
                    if what:
                        self._progress(what, done / count)
                    if done < count and self._stop():
                        raise StoppedError  # noqa: TRY301 - as it comes from a run
        except StoppedError as error:
            raise StoppedError(collected) from error
        return collected


def run_task(simulator: Simulator, alignment: Alignment | None, task: Task) -> NDArray[np.float64]:
    """Return the features of one run; NaN throughout where it is infeasible.

    Raises:
        SimulatorError: the simulator failed.

    """
    try:
        values = simulated(simulator, task.recording, task.values)
    except InfeasibleError:
        return np.full(task.layout.size, np.nan)
    return features_of(task.layout, task.recording, values, alignment)


def simulated(
    simulator: Simulator, recording: Recording, values: Mapping[str, float]
) -> Mapping[str, NDArray[np.float64]]:
    """Return what a simulator says of a recording, by signal; one that is NaN throughout is not given.

    Raises:
        InfeasibleError: it cannot be run with these values, or a signal ends in NaN as of one that has blown up.
        SimulatorError: the simulator failed, or a signal has not a sample per time of the recording.

    """
    given = ", ".join(f"{name}={value:g}" for name, value in values.items()) or "no effect"
    try:
        made = {name: np.asarray(row, dtype=np.float64) for name, row in simulator(recording, values).items()}
    except (InfeasibleError, StoppedError):
        raise
    except Exception as error:  # whatever a user's simulator may raise
        msg = f"the simulator failed on recording '{recording.name}' with {given}: {type(error).__name__}: {error}"
        raise SimulatorError(msg) from error
    for signal in recording.signals:
        row = made.get(signal.name, signal.values)
        if row.shape != signal.values.shape:
            msg = f"the simulator's '{signal.name}' of recording '{recording.name}' with {given} has shape "
            msg += f"{row.shape}; it must be a sample per time of the signal: {signal.values.shape}"
            raise SimulatorError(msg)
        finite = np.isfinite(row)
        if finite.any() and not finite.all():
            raise InfeasibleError(signal.name)
    return made


def _sendable(problem: Problem) -> bool:
    """Whether a simulator can be sent to another process."""
    try:
        cloudpickle.dumps((problem.simulator, problem.alignment))
    except Exception:  # noqa: BLE001 - whatever pickling a user's object may raise
        return False
    return True
