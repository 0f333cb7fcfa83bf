"""A whole gap diagnosis of four recordings: time, memory, simulated time beside plain scipy, and growth with length."""

from __future__ import annotations

import multiprocessing
import random
import threading
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np
import psutil
from joblib.externals.loky import get_reusable_executor  # type: ignore[import-untyped]  # carries no types
from scipy.optimize import least_squares  # type: ignore[import-untyped]  # carries no types

from jammkle_gap import Constants, ankle_library, ankle_problem, diagnose
from jammkle_gap.ankle.corrected import Correction
from jammkle_gap.ankle.recording import recording_of_run
from jammkle_gap.ankle.repeats import with_settings
from jammkle_gap.core.diagnose import evidence_of
from jammkle_gap.core.simulate import Runner
from jammkle_sim.rigs.catalogue import RIGS, run_rig

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import TracebackType

    from numpy.typing import NDArray
    from typing_extensions import Self

    from jammkle_gap import Diagnosis, Effect, Recording

LIBRARY = ankle_library()
PROBLEM = ankle_problem(LIBRARY)
TRUTH = {"line_leak_manifold.conductance_dm3_s_bar": 0.003}
"""In the machine in question; the references are healthy."""
REFERENCES = 2
"""Of each recording."""
CYCLES = (2, 4, 8)
"""Of the pressure rig, for recordings of about 3, 6 and 12 s."""
SAMPLED = 8
"""Singles, and pairs, that scipy fits; those that are left are taken to cost as much on average."""
MOST_EVALUATIONS = 20
"""Of scipy's fits, beside finite differences."""
_INWARDS = 0.02
_TOLERANCE = 1e-4
"""Of scipy's fits: the one that the diagnosis asks of its own."""
_EVERY_S = 0.1


@dataclass(frozen=True)
class Growth:
    """One length of the recordings of the pressure rig, four at a time."""

    recorded_s: float
    wall_s: float
    simulated_s: float


@dataclass(frozen=True)
class GapDiagnosis:
    """What a diagnosis costs. Simulated seconds are of recorded time, summed over runs."""

    recorded_s: float
    """All four recordings together, without their references."""
    verdict: str
    effects: list[str]
    wall_s: float
    """With no signatures on disk."""
    warm_wall_s: float
    """With those that the first diagnosis left."""
    warm_simulated_s: float
    peak_mib: float
    """Memory of a process that does nothing else and of its workers together, sampled ten times a second; pages that
    they share count once (PSS, where the system tells it, else for each). Resident memory, summed, is about a tenth
    larger."""
    runs: int
    simulated_s: float
    singles: int
    """Effects that move something in these recordings."""
    pairs_fitted: int
    """Pairs fitted with the simulator, at most."""
    pairs_weighed: int
    """All pairs of those singles: the promising are profiled on their grids, without a run."""
    scipy_single_simulated_s: float
    """Mean over a seeded sample of the singles."""
    scipy_pair_simulated_s: float
    """Mean over a seeded sample of all pairs."""
    scipy_sampled: int
    """Of each."""
    ratio_weighed: float
    """Simulated seconds of scipy on every single and every pair, extrapolated from the sample, over the diagnosis'."""
    ratio_fitted: float
    """The same with only as many pairs as the diagnosis fitted in full."""
    growth: list[Growth]
    exponent: float
    """Of the wall time by the length of the recordings; 1 is linear."""
    load_before: float
    """Load average of the machine over the minute before: it was shared."""


class _Peak:
    """Watches the memory of this process and its children."""

    def __init__(self) -> None:
        self.mib = 0.0
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._watch)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._done.set()
        self._thread.join()

    def _watch(self) -> None:
        process = psutil.Process()
        while not self._done.wait(_EVERY_S):
            total = sum(_memory(each) for each in (process, *process.children(recursive=True)))
            self.mib = max(self.mib, total / 2**20)


def _memory(process: psutil.Process) -> int:
    """Return memory in use, bytes; none where the process has ended."""
    try:
        found = process.memory_full_info()
        return int(getattr(found, "pss", found.rss))
    except (psutil.NoSuchProcess, psutil.AccessDenied):
        return 0


def duration_s(recording: Recording) -> float:
    """Return how long a recording is, s."""
    return recording.duration_s


def _recorded(rig: str, seed: int, *, faulty: bool, **options: float) -> Recording:
    chosen = RIGS[rig].options(**{"seed": seed, **options})
    run = run_rig(rig, chosen, lambda _: None, lambda: False, Correction(LIBRARY, TRUTH if faulty else {}))
    return recording_of_run(run, f"{rig}_{seed}")


@dataclass(frozen=True)
class _Asked:
    """What is to be diagnosed."""

    recordings: tuple[Recording, ...]
    references: tuple[Recording, ...]


def _asked(plans: Sequence[tuple[str, dict[str, float]]]) -> _Asked:
    """Record each plan once on the machine in question, and some times on the healthy one."""
    faulty = [_recorded(rig, i, faulty=True, **options) for i, (rig, options) in enumerate(plans, 1)]
    healthy = [
        _recorded(rig, 100 * (1 + again) + i, faulty=False, **options)
        for i, (rig, options) in enumerate(plans, 1)
        for again in range(REFERENCES)
    ]
    named = with_settings([*faulty, *healthy])
    return _Asked(named[: len(faulty)], named[len(faulty) :])


def mixed() -> _Asked:
    """Return four recordings of about 10 s from three rigs."""
    return _asked(
        [
            ("pressure", {"cycles": 6}),
            ("pressure", {"cycles": 6, "vacuum_pa": 30e3}),
            ("tensile", {"vacuum_pa": 50e3}),
            ("landing", {"release_time_s": 7.4}),
        ]
    )


def _pressures(cycles: int) -> _Asked:
    return _asked([("pressure", {"cycles": cycles, "vacuum_pa": 20e3 + 10e3 * i}) for i in range(1, 5)])


def _diagnosed(asked: _Asked, folder: Path) -> Diagnosis:
    return diagnose(asked.recordings, PROBLEM, references=asked.references, folder=folder)


class _Scipy:
    """Fits candidates one by one, each from its null values, with scipy's own finite differences.

    To the same whitened difference that the diagnosis explains: the comparison is of the search alone.
    """

    def __init__(self, asked: _Asked, folder: Path) -> None:
        runner = Runner(PROBLEM)
        evidence = evidence_of(asked.recordings, asked.references, PROBLEM, runner, Constants(), folder)
        self._difference = evidence.difference
        self._signatures = evidence.machine.signatures
        self.live = [effect for effect in LIBRARY if effect.name not in evidence.explained.silent]

    def simulated_s(self, effects: Sequence[Effect]) -> float:
        """Fit these effects together; return what that took."""
        parameters = [(effect.key(each), each) for effect in effects for each in effect.parameters]
        low = np.array([each.minimum for _, each in parameters])
        span = np.array([each.maximum - each.minimum for _, each in parameters])
        null = np.array([each.null for _, each in parameters])
        signatures = self._signatures()

        def residual(point: NDArray[np.float64]) -> NDArray[np.float64]:
            values = dict(zip([key for key, _ in parameters], (low + point * span).tolist(), strict=True))
            made = signatures.parts(values)
            return self._difference.whitened - (np.inf if made is None else self._difference.whiten(made))

        least_squares(
            residual,
            np.clip((null - low) / span, _INWARDS, 1.0 - _INWARDS),
            bounds=(0.0, 1.0),
            diff_step=_INWARDS,
            x_scale=1.0,
            ftol=_TOLERANCE,
            xtol=_TOLERANCE,
            max_nfev=MOST_EVALUATIONS,
        )
        return signatures.made.simulated_s


def _growth() -> list[Growth]:
    found = []
    for cycles in CYCLES:
        asked = _pressures(cycles)
        with TemporaryDirectory() as folder:
            begin_s = time.perf_counter()
            spent = _diagnosed(asked, Path(folder)).spent
            wall_s = time.perf_counter() - begin_s
        found.append(Growth(sum(map(duration_s, asked.recordings)), wall_s, spent.simulated_s))
    return found


@dataclass(frozen=True)
class _Whole:
    """One whole diagnosis, cold and warm."""

    asked: _Asked
    cold: Diagnosis
    warm: Diagnosis
    peak_mib: float


def _whole(folder: Path) -> _Whole:
    asked = mixed()
    with _Peak() as peak:
        cold = _diagnosed(asked, folder)
        warm = _diagnosed(asked, folder)
    # The process would wait for its idle workers, which stay for five minutes.
    get_reusable_executor().shutdown(wait=True)
    return _Whole(asked, cold, warm, peak.mib)


def measure_diagnosis() -> GapDiagnosis:
    """Diagnose four recordings, fit the same candidates by scipy, and diagnose shorter and longer ones."""
    load_before = psutil.getloadavg()[0]
    with TemporaryDirectory() as kept:
        folder = Path(kept)
        # In a process of its own, as memory that others have used would count.
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as own:
            whole = own.submit(_whole, folder).result()
        scipy = _Scipy(whole.asked, folder)
    found, spent = whole.cold, whole.cold.spent
    live = scipy.live
    pairs = list(combinations(live, 2))
    fitted = sum(len(names) > 1 for names in found.posterior)
    drawn = random.Random(0)  # noqa: S311 - no secret
    single_s = float(np.mean([scipy.simulated_s([each]) for each in drawn.sample(live, min(SAMPLED, len(live)))]))
    pair_s = float(np.mean([scipy.simulated_s(each) for each in drawn.sample(pairs, min(SAMPLED, len(pairs)))]))
    growth = _growth()
    slope = np.polyfit(np.log([each.recorded_s for each in growth]), np.log([each.wall_s for each in growth]), 1)[0]
    singles_s = len(live) * single_s
    return GapDiagnosis(
        recorded_s=sum(map(duration_s, whole.asked.recordings)),
        verdict=found.verdict.value,
        effects=[effect.name for effect in found.effects],
        wall_s=spent.wall_s,
        warm_wall_s=whole.warm.spent.wall_s,
        warm_simulated_s=whole.warm.spent.simulated_s,
        peak_mib=whole.peak_mib,
        runs=spent.runs,
        simulated_s=spent.simulated_s,
        singles=len(live),
        pairs_fitted=fitted,
        pairs_weighed=len(pairs),
        scipy_single_simulated_s=single_s,
        scipy_pair_simulated_s=pair_s,
        scipy_sampled=SAMPLED,
        ratio_weighed=(singles_s + len(pairs) * pair_s) / spent.simulated_s,
        ratio_fitted=(singles_s + fitted * pair_s) / spent.simulated_s,
        growth=growth,
        exponent=float(slope),
        load_before=load_before,
    )
