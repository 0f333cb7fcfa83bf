"""From evidence to a diagnosis: verdict, probabilities, where the gap lies, and how far it closes."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.core.conformal import p_values
from jammkle_gap.core.design import next_experiment
from jammkle_gap.core.detect import detect
from jammkle_gap.core.equivalence import class_names, class_of
from jammkle_gap.core.fitted import candidate_of, explained_by, freedom_of, left_by
from jammkle_gap.core.held_out import held_out
from jammkle_gap.core.locate import closing_of, places_of, signal_gaps
from jammkle_gap.core.posterior import NONE_OF_THEM, by_class, posterior_of
from jammkle_gap.core.reference_notes import reference_notes
from jammkle_gap.core.result import (
    Diagnosis,
    SignalGap,
    Spent,
    Trace,
    Verdict,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.design import Experiment
    from jammkle_gap.core.detect import Detection
    from jammkle_gap.core.evidence import Evidence
    from jammkle_gap.core.fit import Fit
    from jammkle_gap.core.posterior import Posterior
    from jammkle_gap.core.simulate import Runner


def conclude(evidence: Evidence, experiments: Sequence[Experiment], runner: Runner, constants: Constants) -> Diagnosis:
    """Return the diagnosis.

    Args:
        evidence: What was gathered.
        experiments: Runs that could be made.
        runner: Makes the runs that planning the next experiment takes.
        constants: Of the model.

    """
    difference, candidates = evidence.difference, evidence.candidates
    fits = {fit.names: fit for fit in (*candidates.singles, *candidates.pairs)}
    detection = detect(difference, evidence.noticed.singles, constants)
    # Settings without references have a likelihood of their own.
    referenced = np.repeat([bool(setting.references) for setting in evidence.settings], difference.sizes)
    classes = class_names(evidence.classes)
    posterior = posterior_of(
        _squared(difference.whitened, referenced),
        int(referenced.sum()),
        difference.healthy,
        freedom_of(evidence, constants),
        [replace(fit, left=_squared(fit.whitened - fit.signature, referenced)) for fit in fits.values()],
        evidence.own,
        classes,
        constants,
    )
    verdict = _verdict(detection, posterior)
    # What no data can tell apart is one answer, with the probability of all its members.
    shared = by_class(posterior.probabilities, classes)
    likely = {names: shared[class_of(names, classes)] for names in posterior.credible}
    # None of the effects comes first where it is the verdict.
    first = NONE_OF_THEM if verdict is Verdict.UNKNOWN else None
    credible = sorted(likely, key=lambda names: (names != first, -likely[names]))
    if verdict is Verdict.NO_GAP:
        credible = []
    named = [names for names in credible if names != NONE_OF_THEM]
    best = fits[named[0]] if named else None
    following = None
    if verdict is Verdict.AMBIGUOUS and candidates.finished:
        chosen = [fits[names] for names in named]
        following = next_experiment(chosen, experiments, evidence.problem, runner, evidence.machine)
    spread = {name: x for name, x in evidence.calibration.deviations.items() if abs(x) > 1.0}
    # Without references the simulator's own error does not cancel: what was known with them is no measure.
    known = evidence.problem.conformity(evidence.settings[0].faulty[0]) if referenced.all() else ()
    left = left_by(evidence, best)
    return Diagnosis(
        verdict=verdict,
        reasons=_reasons(verdict, detection, posterior, evidence),
        candidates=tuple(
            candidate_of(evidence, fits.get(names), names, likely[names], constants) for names in credible
        ),
        posterior=posterior.probabilities,
        conformal=p_values(difference, candidates.singles, known, constants),
        gap_probability=detection.probability,
        p_value=detection.p_value,
        false_alarm_rate=constants.false_alarm_rate,
        where=places_of(evidence.settings, difference, evidence.problem.registrar, constants.blocks),
        subsystems=_subsystems(evidence, posterior),
        gap=closing_of(difference, left, evidence.settings, constants.blocks),
        signals=_signals(evidence, best),
        held_out=held_out(evidence, best, constants),
        classes=evidence.classes,
        silent=candidates.silent,
        calibration=dict(sorted(spread.items(), key=lambda item: -abs(item[1]))),
        references_left=evidence.calibration.after,
        traces=_traces(evidence, best),
        next_experiment=following,
        notes=_notes(evidence, constants),
        spent=Spent(0.0, runner.runs, runner.simulated_s),
        finished=candidates.finished,
    )


def _verdict(detection: Detection, posterior: Posterior) -> Verdict:
    if not detection.gap:
        return Verdict.NO_GAP
    if posterior.best == NONE_OF_THEM:
        return Verdict.UNKNOWN
    return Verdict.EFFECTS if len(posterior.credible) == 1 else Verdict.AMBIGUOUS


def _reasons(verdict: Verdict, detection: Detection, posterior: Posterior, evidence: Evidence) -> tuple[str, ...]:
    first = (
        f"the difference is {np.sqrt(detection.ratio):.2f} times healthy scatter; a healthy machine shows as much with "
        f"a probability of {detection.p_value:.2g}"
    )
    if verdict is Verdict.NO_GAP:
        return (first,)
    best = next((names for names in posterior.probabilities if names != NONE_OF_THEM), None)
    if best is None:
        return (first, "no effect on offer moves these signals")
    fit = next(f for f in (*evidence.candidates.singles, *evidence.candidates.pairs) if f.names == best)
    share = 100.0 * explained_by(evidence, fit)
    classes = class_names(evidence.classes)
    probability = by_class(posterior.probabilities, classes)[class_of(best, classes)]
    whole = " with all of its equivalence class" if set(best) & set(classes) else ""
    second = f"{' + '.join(best)} explains {share:.0f} % of its square; probability {probability:.2f}{whole}"
    unknown = posterior.probabilities.get(NONE_OF_THEM, 0.0)
    return first, second, f"none of the effects on offer: probability {unknown:.2f}"


def _squared(values: NDArray[np.float64], kept: NDArray[np.bool_]) -> float:
    return float(np.square(values[kept]).sum())


def _subsystems(evidence: Evidence, posterior: Posterior) -> dict[str, float]:
    found: dict[str, float] = {}
    for names, probability in posterior.probabilities.items():
        for name in names:
            subsystem = evidence.problem.library.effect(name).subsystem
            found[subsystem] = found.get(subsystem, 0.0) + probability / len(names)
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def _signatures(evidence: Evidence, best: Fit | None) -> list[NDArray[np.float64]]:
    """Return what the best candidate makes of the features of each setting, in their units."""
    if best is None:
        return [np.zeros(size) for size in evidence.difference.sizes]
    return list(best.features)


def _signals(evidence: Evidence, best: Fit | None) -> tuple[SignalGap, ...]:
    return signal_gaps(evidence.settings, evidence.residuals, evidence.difference, _signatures(evidence, best))


def _traces(evidence: Evidence, best: Fit | None) -> tuple[Trace, ...]:
    found = []
    for setting, each, scatter, signature, factor in zip(
        evidence.settings,
        evidence.residuals,
        evidence.difference.scatter,
        _signatures(evidence, best),
        evidence.difference.factors,
        strict=True,
    ):
        layout = setting.layout
        deviation = np.sqrt(factor * (scatter.variance + np.square(scatter.columns).sum(axis=1)))
        tables = [
            layout.by_signal(row)
            for row in (each.difference, deviation, signature, setting.faulty_features.mean(axis=0), each.simulated)
        ]
        for i, (name, unit) in enumerate(zip(layout.signals, layout.units, strict=True)):
            found.append(Trace(setting.name, name, unit, layout.time_s, *(table[i] for table in tables)))
    return tuple(found)


def _notes(evidence: Evidence, constants: Constants) -> tuple[str, ...]:
    notes = list(reference_notes(evidence, constants))
    moved = {name: x for name, x in evidence.calibration.deviations.items() if abs(x) > 1.0}
    if moved:
        told = ", ".join(f"{name} {x:+.1f}" for name, x in sorted(moved.items(), key=lambda item: -abs(item[1])))
        notes.append(f"calibrated to the references, in standard deviations of their priors: {told}")
    runs = [run for setting in evidence.settings for run in (*setting.faulty, *setting.references)]
    notes += [f"{run.name}: {note}" for run in runs for note in run.notes]
    return tuple(dict.fromkeys(notes))
