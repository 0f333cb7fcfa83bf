"""From recordings, a simulator and a library to a diagnosis."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_gap.november.closing import Closing, RegimeClosing, SignalClosing, ceiling, closings, held_out_regimes
from jammkle_gap.november.compared import compare
from jammkle_gap.november.described import Candidate, FittedEffect, Overlay, beside_best, fitted_effects, overlays_of
from jammkle_gap.november.experiments import NextExperiment, next_experiment
from jammkle_gap.november.fitting import calibrate, uncalibrated
from jammkle_gap.november.limits import limits_of
from jammkle_gap.november.probability import probabilities
from jammkle_gap.november.recording import BadRecordingError
from jammkle_gap.november.runs import Spent, StoppedError
from jammkle_gap.november.search import Search
from jammkle_gap.november.sensitivity import probe
from jammkle_gap.november.signatures import Signature, signatures
from jammkle_gap.november.unexplained import Formula, sparse_formula
from jammkle_gap.november.verdict import Criteria, Verdict, judge
from jammkle_gap.november.where import HORIZONS_S, Where, horizons, isolate, shares, subsystem_of_signals

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from jammkle_gap.november.effect import Library
    from jammkle_gap.november.experiments import Experiment
    from jammkle_gap.november.noise import NoiseSource
    from jammkle_gap.november.recording import Recording
    from jammkle_gap.november.simulator import Simulator

_FITTED = 0.8


@dataclass(frozen=True)
class Diagnosis:
    """What was found."""

    verdict: Verdict
    reasons: tuple[str, ...]
    effects: tuple[FittedEffect, ...]
    """Of the best candidate; with UNKNOWN: of what explains a part, as a lead."""
    candidates: tuple[Candidate, ...]
    """The set, best first."""
    probabilities: Mapping[str, float]
    where: Where
    signatures: tuple[Signature, ...]
    noise: tuple[NoiseSource, ...]
    gap: Closing
    """Over all signals; held-out blocks."""
    signals: tuple[SignalClosing, ...]
    regimes: tuple[RegimeClosing, ...]
    ceiling: float
    """Gap that a flexible black box leaves, held out, noise units."""
    formula: Formula | None
    """Of what is left of the worst signal, with UNKNOWN."""
    next_experiment: NextExperiment | None
    dropped: Mapping[str, str]
    """Effects that move no signal, and so cannot be seen in these recordings: name and what was found."""
    ranking: tuple[tuple[tuple[str, ...], float], ...]
    """Every candidate fitted, with its score above the nominal simulator's, nats."""
    overlays: tuple[Overlay, ...]
    notes: tuple[str, ...]
    spent: Spent
    finished: bool
    """False if it was stopped on the way."""


def _no_progress(_: str, __: float, ___: float) -> None:
    pass


class _Progress:
    """Says how far it is, never less than before, and how long it will take at this speed."""

    def __init__(self, on_progress: Callable[[str, float, float], None]) -> None:
        self._tell = on_progress
        self._started = time.perf_counter()
        self._furthest = 0.0

    def __call__(self, stage: str, share: float) -> None:
        self._furthest = max(share, self._furthest)
        passed_s = time.perf_counter() - self._started
        self._tell(stage, self._furthest, passed_s * (1.0 - self._furthest) / max(self._furthest, 0.02))


def diagnose(  # noqa: PLR0913  # every one is a choice of the user's
    recordings: Sequence[Recording],
    simulator: Simulator,
    library: Library,
    *,
    references: Sequence[Recording] = (),
    calibration: Library | None = None,
    subsystems: Mapping[str, Simulator] | None = None,
    experiments: Sequence[Experiment] = (),
    criteria: Criteria | None = None,
    horizons_s: Sequence[float] = HORIZONS_S,
    jobs: int | None = None,
    on_progress: Callable[[str, float, float], None] = _no_progress,
    stop: Callable[[], bool] = lambda: False,
) -> Diagnosis:
    """Say where simulation and recordings disagree, which effect explains it, and how far the gap shrinks.

    Args:
        recordings: What was measured.
        simulator: Runs a recording again; see `Simulator`.
        library: Effects offered.
        references: Recordings of the same machine in good order: the question is then what has changed.
        calibration: Parameters of the simulator itself that nobody knows, as effects: they are fitted along with every
            candidate, also with none, so that no effect is named for a simulator that was tuned without it. Their null
            values are where the simulator stands, inside their bounds.
        subsystems: By name, simulators of parts that are fed with measured inputs.
        experiments: Runs that could be made, if the recordings cannot split a set.
        criteria: What counts as a gap, and as an explanation.
        horizons_s: Times between restarts from the measured state at which the gap is measured, s, where the simulator
            can be restarted.
        jobs: Processes; by default one per core where that pays.
        on_progress: Called with what is being done, the share that is done, and the seconds left.
        stop: Asked now and then; True ends the search and keeps what is done. So does Ctrl-C.

    Raises:
        BadRecordingError: the recordings cannot be used.
        StoppedError: stopped before anything was done.

    """
    if not recordings:
        msg = "no recordings; give at least one"
        raise BadRecordingError(msg)
    criteria = criteria or Criteria()
    progress = _Progress(on_progress)
    progress("simulating the recordings", 0.0)
    compared = compare(recordings, simulator, references, jobs, stop)
    runs, nominal, baseline, layout = compared.runs, compared.nominal, compared.baseline, compared.layout
    limit = criteria.worth_gap_with_references if references else criteria.worth_gap
    limits = limits_of(layout, baseline.noise, limit)
    residual = layout.residual(nominal)
    calibrated = uncalibrated(residual)
    if calibration is not None:
        progress("calibrating the simulator", 0.02)
        calibrated = calibrate(calibration.effects, runs, layout, residual)
        residual = calibrated.residual
        ready = runs.evaluate([calibrated.space.values(calibrated.point)])[0]
        nominal = [signals for signals in ready if signals is not None]
    progress("trying every effect", 0.05)
    probes = probe(library, runs, layout, residual, calibrated.space.values(calibrated.point))
    search = Search(
        layout,
        runs,
        [each for each in probes if each.alive],
        residual,
        limits,
        criteria,
        lambda stage, share: progress(stage, 0.1 + (_FITTED - 0.1) * share),
        calibrated,
    )
    found = search.without_runs() if limits.holds(layout, residual) else search.run()
    judgement = judge(layout, found.chosen, found.scores, criteria, limits)
    best = judgement.chosen[0]
    progress("measuring how far the gap closes", _FITTED)
    without = next(score for score in found.scores if not score.names)
    overall, signals = closings(layout, without.held_out, best.held_out, limits.of_signal)
    regimes: tuple[RegimeClosing, ...] = ()
    finished = found.finished
    try:
        regimes = held_out_regimes(best.fit, layout, found.weighting, runs, residual)
    except (StoppedError, KeyboardInterrupt):
        finished = False
    progress("finding where the gap lies", 0.9)
    fed = {name: compared.beside(_at_null(part)) for name, part in (subsystems or {}).items()}
    where = Where(
        shares(layout, recordings, residual, subsystem_of_signals(fed)),
        isolate(layout, fed, limits),
        horizons(compared, simulator, residual, horizons_s if finished else ()),
    )
    left_over = (
        sparse_formula(layout, nominal, best.fit.residual, limits.worst(layout, best.fit.residual)[0])
        if judgement.verdict is Verdict.UNKNOWN
        else None
    )
    ambiguous = judgement.chosen if judgement.verdict is Verdict.AMBIGUOUS else ()
    following = next_experiment(ambiguous, experiments, recordings, simulator, compared.noise)
    described = [fitted_effects(each, found.weighting, layout, limit) for each in judgement.chosen]
    progress("done", 1.0)
    return Diagnosis(
        verdict=judgement.verdict,
        reasons=judgement.reasons,
        effects=described[0],
        candidates=tuple(
            beside_best(each, best, without, effects) for each, effects in zip(judgement.chosen, described, strict=True)
        ),
        probabilities=probabilities(judgement, found.scores, [effect.name for effect in library], criteria),
        where=where,
        signatures=signatures(layout, recordings, nominal, residual),
        noise=tuple(baseline.noise[name] for name in layout.names),
        gap=overall,
        signals=signals,
        regimes=regimes,
        ceiling=layout.gap(ceiling(layout, nominal, residual)),
        formula=left_over,
        next_experiment=following,
        dropped={each.effect.name: _moves(each.moves) for each in probes if not each.alive},
        ranking=tuple((each.names, each.total - without.total) for each in found.scores),
        overlays=overlays_of(layout, recordings, residual, best.fit.residual),
        notes=(*baseline.notes, *(note for recording in recordings for note in recording.notes)),
        spent=runs.spent,
        finished=finished,
    )


def _at_null(simulator: Simulator) -> Callable[[Recording], Mapping[str, NDArray[np.float64]]]:
    return lambda recording: simulator(recording, {})


def _moves(moves: Mapping[str, float]) -> str:
    name = max(moves, key=lambda each: moves[each])
    return f"moves no signal: {name} most, by {moves[name]:.2g} of its noise"
