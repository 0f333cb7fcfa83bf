"""A whole gap diagnosis of four recordings: time, memory, simulated time beside plain scipy, and growth with length."""

from __future__ import annotations

import multiprocessing
import random
import threading
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
import psutil
from joblib.externals.loky import get_reusable_executor  # type: ignore[import-untyped]  # carries no types
from scipy.optimize import least_squares  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.ankle.corrected import Correction
from jammkle_gap.ankle.effects import ankle_library
from jammkle_gap.ankle.runs import recording_of_run
from jammkle_gap.ankle.simulator import AnkleSimulator
from jammkle_gap.ankle.subsystems import subsystem_simulators
from jammkle_gap.november.diagnosis import diagnose
from jammkle_gap.november.references import without_references
from jammkle_gap.november.residual import Layout, lay_out
from jammkle_gap.november.runs import Runs, duration_s
from jammkle_gap.november.sensitivity import space_of
from jammkle_sim.rigs.catalogue import RIGS, run_rig

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import TracebackType

    from numpy.typing import NDArray
    from typing_extensions import Self

    from jammkle_gap.november.diagnosis import Diagnosis
    from jammkle_gap.november.effect import Effect
    from jammkle_gap.november.recording import Recording

LIBRARY = ankle_library()
SIMULATOR = AnkleSimulator(LIBRARY)
TRUTH = {"line_leak_manifold.conductance_dm3_s_bar": 0.003}
"""In what the recordings were made of; the diagnosis is not told."""
CYCLES = (2, 4, 8)
"""Of the pressure rig, for recordings of about 3, 6 and 12 s."""
SAMPLED = 8
"""Singles, and pairs, that scipy fits; those that are left are taken to cost as much on average."""
MOST_EVALUATIONS = 20
"""Of scipy's fits, beside finite differences."""
_INWARDS = 0.02
_TOLERANCE = 1e-4
"""Of scipy's fits: the one that the diagnosis asks of its own last fits."""
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
    """All four recordings together."""
    verdict: str
    effects: list[str]
    wall_s: float
    peak_mib: float
    """Memory of a process that does nothing else and of its workers together, sampled ten times a second; pages that
    they share count once (PSS, where the system tells it, else for each). Resident memory, summed, is about a tenth
    larger."""
    runs: int
    simulated_s: float
    singles: int
    """Effects that move something in these recordings."""
    pairs_fitted: int
    """Pairs fitted in full."""
    pairs_weighed: int
    """All pairs of those singles: each is weighed by the derivatives, without a run."""
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


def _recorded(rig: str, seed: int, **options: float) -> Recording:
    chosen = RIGS[rig].options(seed=seed, **options)
    run = run_rig(rig, chosen, lambda _: None, lambda: False, Correction(LIBRARY, TRUTH))
    return recording_of_run(run, f"{rig}_{seed}")


def mixed() -> list[Recording]:
    """Return four recordings of about 10 s from three rigs."""
    return [
        _recorded("pressure", 1, cycles=6),
        _recorded("pressure", 2, cycles=6, vacuum_pa=30e3),
        _recorded("tensile", 3, vacuum_pa=50e3),
        _recorded("landing", 4, release_time_s=7.4),
    ]


def _pressures(cycles: int) -> list[Recording]:
    return [_recorded("pressure", seed, cycles=cycles, vacuum_pa=20e3 + 10e3 * seed) for seed in range(1, 5)]


def _diagnosed(recordings: Sequence[Recording]) -> Diagnosis:
    return diagnose(recordings, SIMULATOR, LIBRARY, subsystems=subsystem_simulators(LIBRARY))


class _Scipy:
    """Fits candidates one by one, each from its null values, with scipy's own finite differences."""

    def __init__(self, recordings: Sequence[Recording]) -> None:
        self._recordings = recordings
        self._once_s = sum(map(duration_s, recordings))
        nominal = Runs(SIMULATOR, recordings, jobs=1).nominal()
        baseline = without_references(recordings, nominal)
        noise = {name: source.noise for name, source in baseline.noise.items()}
        hanging = {name: source.factor for name, source in baseline.noise.items()}
        self._layout: Layout = lay_out(recordings, nominal, noise, factors=hanging)

    def simulated_s(self, effects: Sequence[Effect]) -> float:
        """Fit these effects together; return what that took."""
        space, runs = space_of(effects), 0

        def residual(point: NDArray[np.float64]) -> NDArray[np.float64]:
            nonlocal runs
            runs += 1
            values = space.values(point)
            return self._layout.residual(Runs(SIMULATOR, self._recordings, jobs=1).evaluate([values])[0])

        least_squares(
            residual,
            np.clip(space.null, _INWARDS, 1.0 - _INWARDS),
            bounds=(0.0, 1.0),
            diff_step=_INWARDS,
            x_scale=1.0,
            loss="soft_l1",
            ftol=_TOLERANCE,
            xtol=_TOLERANCE,
            max_nfev=MOST_EVALUATIONS,
        )
        return runs * self._once_s


def _growth() -> list[Growth]:
    found = []
    for cycles in CYCLES:
        recordings = _pressures(cycles)
        begin_s = time.perf_counter()
        spent = _diagnosed(recordings).spent
        wall_s = time.perf_counter() - begin_s
        found.append(Growth(sum(map(duration_s, recordings)), wall_s, spent.simulated_s))
    return found


@dataclass(frozen=True)
class _Whole:
    """One whole diagnosis."""

    recordings: list[Recording]
    diagnosis: Diagnosis
    wall_s: float
    peak_mib: float


def _whole() -> _Whole:
    recordings = mixed()
    with _Peak() as peak:
        begin_s = time.perf_counter()
        diagnosis = _diagnosed(recordings)
        wall_s = time.perf_counter() - begin_s
    # The process would wait for its idle workers, which stay for five minutes.
    get_reusable_executor().shutdown(wait=True)
    return _Whole(recordings, diagnosis, wall_s, peak.mib)


def measure_diagnosis() -> GapDiagnosis:
    """Diagnose four recordings, fit the same candidates by scipy, and diagnose shorter and longer ones."""
    load_before = psutil.getloadavg()[0]
    # In a process of its own, as memory that others have used would count.
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as own:
        whole = own.submit(_whole).result()
    found, spent = whole.diagnosis, whole.diagnosis.spent
    live = [effect for effect in LIBRARY if effect.name not in found.dropped]
    pairs = list(combinations(live, 2))
    fitted = sum(len(names) == 2 for names, _ in found.ranking)
    scipy, drawn = _Scipy(whole.recordings), random.Random(0)  # noqa: S311 - no secret
    single_s = float(np.mean([scipy.simulated_s([each]) for each in drawn.sample(live, min(SAMPLED, len(live)))]))
    pair_s = float(np.mean([scipy.simulated_s(each) for each in drawn.sample(pairs, min(SAMPLED, len(pairs)))]))
    growth = _growth()
    slope = np.polyfit(np.log([each.recorded_s for each in growth]), np.log([each.wall_s for each in growth]), 1)[0]
    singles_s = len(live) * single_s
    return GapDiagnosis(
        recorded_s=sum(map(duration_s, whole.recordings)),
        verdict=found.verdict.value,
        effects=[effect.name for effect in found.effects],
        wall_s=whole.wall_s,
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
