"""From evidence to a diagnosis: verdict, probabilities, where the gap lies, and how far it closes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.core.decide import (
    NONE_OF_THEM,
    Seen,
    beyond_tolerance,
    by_class,
    class_names,
    class_of,
    is_as_drawn,
    posterior_of,
    without_directions,
)
from jammkle_gap.core.design import DETECTABLE, next_experiment
from jammkle_gap.core.explain import detect_beside_error
from jammkle_gap.core.features import stuck_in
from jammkle_gap.core.ledger import ledger_of
from jammkle_gap.core.locate import closing_of, places_of, signal_gaps
from jammkle_gap.core.predict import by_setting, by_time, predicted
from jammkle_gap.core.result import (
    Candidate,
    Diagnosis,
    FittedConstant,
    FittedEffect,
    FittedParameter,
    HeldOutSetting,
    Spent,
    Trace,
    Verdict,
    beyond,
)
from jammkle_gap.core.simulate import StoppedError, on_one_thread

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.calibrate import Calibration
    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.decide import Detection, Names, Posterior
    from jammkle_gap.core.design import Experiment
    from jammkle_gap.core.discrepancy import Discrepancy
    from jammkle_gap.core.effects import EffectParameter, Nuisance
    from jammkle_gap.core.explain import Explained
    from jammkle_gap.core.fit import Fit, GridFeatures
    from jammkle_gap.core.joint import Machine
    from jammkle_gap.core.result import LedgerEntry, NextExperiment
    from jammkle_gap.core.scatter import Difference, Residuals, Setting
    from jammkle_gap.core.simulate import Problem, Runner


@dataclass(frozen=True)
class Evidence:
    """All that a diagnosis is concluded from."""

    problem: Problem
    settings: tuple[Setting, ...]
    calibration: Calibration
    machine: Machine
    """What was explained; its constants are held where there are references in every setting."""
    residuals: tuple[Residuals, ...]
    """With the constants that are known beforehand."""
    error: Discrepancy
    explained: Explained
    classes: tuple[tuple[str, ...], ...]
    grids: GridFeatures

    @property
    def difference(self) -> Difference:
        """Whitened by scatter and the priors of the constants."""
        return self.error.difference


_Z90 = 1.645
"""Half of a 90 % interval, in standard deviations."""
_IDLE = 0.01
"""Share of what the constants leave below which an effect is as good as none of them. Chosen: a parameter that is
fitted to the noise of a hundred features explains as much."""
_AT_BOUND = 0.01
"""Share of a parameter's range from a bound within which it counts as at it."""


def candidate_of(
    evidence: Evidence,
    fit: Fit | None,
    names: tuple[str, ...],
    probability: float,
) -> Candidate:
    """Return what is said of a candidate.

    Args:
        evidence: What was gathered.
        fit: Of the candidate; None: none of the effects on offer.
        names: Of its effects.
        probability: Of the candidate.

    """
    if fit is None:
        return Candidate(names, probability, 0.0, ())
    others = {
        other for members in evidence.classes for other in members if set(members) & set(names) and other not in names
    }
    return Candidate(
        names,
        probability,
        explained_by(evidence, fit),
        _fitted(evidence, fit),
        tuple(sorted(others)),
    )


def explained_by(evidence: Evidence, fit: Fit) -> float:
    """Return the share that a candidate explains of what the constants of the machine leave, squared and whitened."""
    whole = evidence.difference
    squares = [
        float(np.square(whole.whitened - whole.whiten(each.features)).sum())
        for each in (fit, evidence.explained.nothing)
    ]
    return 1.0 - squares[0] / squares[1]


def _fitted(evidence: Evidence, fit: Fit) -> tuple[FittedEffect, ...]:
    library = evidence.problem.library
    half = _half_widths(evidence, fit)
    found = []
    for name in fit.names:
        effect = library.effect(name)
        parameters = []
        for each in effect.parameters:
            key = effect.key(each)
            value, index = fit.values[key], list(fit.values).index(key)
            span = each.maximum - each.minimum
            interval, is_cut = _within(value, float(half[index]), each)
            beyond = [end for end in (each.minimum, each.maximum) if end != each.null]  # where it is off is no bound
            bound = any(abs(value - end) < _AT_BOUND * span for end in beyond) and value != each.null
            seen = float(np.linalg.norm(fit.jacobian[:, index]))
            step = np.sqrt(DETECTABLE) / seen if seen > 0.0 else np.nan
            detectable = each.null + np.sign(value - each.null) * step
            inside = each.minimum <= detectable <= each.maximum
            parameters.append(
                FittedParameter(
                    each.name, each.unit, value, interval, bool(bound), float(detectable) if inside else np.nan, is_cut
                )
            )
        found.append(FittedEffect(name, effect.subsystem, effect.sentence, tuple(parameters)))
    return tuple(found)


def _within(value: float, half: float, of: EffectParameter | Nuisance) -> tuple[tuple[float, float], bool]:
    """Return an interval within bounds, and whether one of them cuts it; where it is off is no bound."""
    low, high = max(value - half, of.minimum), min(value + half, of.maximum)
    cut = (low > value - half and low != of.null) or (high < value + half and high != of.null)
    return (low, high), bool(cut)


def _half_widths(evidence: Evidence, fit: Fit) -> NDArray[np.float64]:
    """Return half of each parameter's 90 % interval: curvature, times what the fit leaves beyond healthy scatter.

    What is left is model discrepancy, which hangs together over time. Without references it already weighs the
    features, and the constants widen the interval.
    """
    error, inflation = evidence.error, 1.0
    if not error.without_references:
        size, healthy = evidence.difference.whitened.size, evidence.difference.healthy
        inflation += max(fit.left / size / healthy - 1.0, 0.0) * size / error.freedom
    half: NDArray[np.float64] = _Z90 * np.sqrt(np.diag(error.covariance(fit))[: len(fit.values)] * inflation)
    return half


def held_out(evidence: Evidence, best: Fit | None, constants: Constants) -> tuple[HeldOutSetting, ...]:
    """Return how far the gap closes in each setting with parameters fitted to the others."""
    fitted = best is not None or evidence.error.without_references
    if not fitted or len(evidence.settings) < 2:  # noqa: PLR2004 - one alone cannot be held out
        return ()
    whole = evidence.difference
    nominal = whole.split(whole.by_scatter(evidence.machine.raw))
    corrected = whole.split(_predicted(evidence, best, by_setting(evidence.settings)))
    return tuple(
        HeldOutSetting(setting.name, closing_of(before, after, whole.healthy, [setting], constants.blocks))
        for setting, before, after in zip(evidence.settings, nominal, corrected, strict=True)
    )


def _predicted(evidence: Evidence, best: Fit | None, folds: Sequence[NDArray[np.intp]]) -> NDArray[np.float64]:
    fit = best or evidence.explained.within
    return predicted(evidence.machine, evidence.error, evidence.difference, fit, folds)


_ENOUGH = 5
"""References that are asked for: their mean is then known to half of one run's scatter."""


@on_one_thread
def conclude(evidence: Evidence, experiments: Sequence[Experiment], runner: Runner, constants: Constants) -> Diagnosis:
    """Return the diagnosis.

    Args:
        evidence: What was gathered.
        experiments: Runs that could be made.
        runner: Makes the runs that planning the next experiment takes.
        constants: Of the model.

    """
    difference, error, explained = evidence.difference, evidence.error, evidence.explained
    fits, finished = explained.fits, explained.finished
    detection = detect_beside_error(evidence.machine, error, explained.nothing, explained.noticed, constants)
    classes = class_names(evidence.classes)
    posterior = posterior_of(explained.likelihoods, fits, classes, constants)
    likeliest = _likeliest(posterior, classes)
    if error.without_references and likeliest == NONE_OF_THEM:
        detection = without_directions(detection, constants)
    if error.without_references:
        detection, likeliest = _by_constants(evidence, detection, likeliest, constants)
    verdict = _verdict(detection, posterior, likeliest)
    # What no data can tell apart is one answer, with the probability of all its members.
    shared = by_class(posterior.probabilities, classes)
    likely = {names: shared[class_of(names, classes)] for names in posterior.credible}
    # None of the effects comes first where it is the verdict.
    first = NONE_OF_THEM if verdict is Verdict.UNKNOWN else None
    if verdict is Verdict.UNKNOWN:
        likely[NONE_OF_THEM] = shared[NONE_OF_THEM]
        if detection.seen is Seen.IN_CONSTANTS:
            idle = [names for names in likely if names in fits and explained_by(evidence, fits[names]) < _IDLE]
            likely[NONE_OF_THEM] += sum(likely.pop(names) for names in idle)
    credible = sorted(likely, key=lambda names: (names != first, -likely[names]))
    if verdict is Verdict.NO_GAP:
        credible = []
    named = [names for names in credible if names != NONE_OF_THEM]
    # What is not named as the cause corrects nothing.
    best = fits[named[0]] if named and verdict is not Verdict.UNKNOWN else None
    left_with = best or explained.within
    traces = _traces(evidence, left_with)
    following: NextExperiment | None = None
    ledger: tuple[LedgerEntry, ...] = ()
    try:
        if verdict is Verdict.AMBIGUOUS and finished:
            chosen, known = [fits[names] for names in named], evidence.machine.values(evidence.machine.mean)
            following = next_experiment(chosen, experiments, evidence.problem, runner, known, constants.blocks)
        if error.without_references and finished:
            every = {(): explained.within, **fits}
            ledger = ledger_of(evidence.machine, error, difference, best, every, runner, constants)
    except StoppedError:
        finished = False
    spread = {name: x for name, x in evidence.calibration.deviations.items() if abs(x) > 1.0}
    nominal = where = difference.by_scatter(evidence.machine.raw)
    if verdict is Verdict.UNKNOWN and detection.seen is not Seen.IN_CONSTANTS:
        where = nominal - difference.by_scatter(explained.within.changes(difference))
    return Diagnosis(
        verdict=verdict,
        reasons=_reasons(verdict, detection, posterior, evidence),
        candidates=tuple(candidate_of(evidence, fits.get(names), names, likely[names]) for names in credible),
        posterior=posterior.probabilities,
        gap_probability=detection.probability,
        p_value=detection.p_value,
        false_alarm_rate=constants.false_alarm_rate,
        where=places_of(evidence.settings, where, difference.healthy, evidence.problem.alignment, constants.blocks),
        subsystems=_subsystems(evidence, posterior),
        gap=closing_of(
            nominal,
            _predicted(evidence, best, by_time(evidence.settings)),
            difference.healthy,
            evidence.settings,
            constants.blocks,
        ),
        signals=signal_gaps(traces),
        held_out=held_out(evidence, best, constants),
        classes=evidence.classes,
        silent=explained.silent,
        calibration=dict(sorted(spread.items(), key=lambda item: -abs(item[1]))),
        references_left=evidence.calibration.after,
        constants=_constants(evidence, left_with),
        ledger=ledger,
        traces=traces,
        next_experiment=following,
        notes=_notes(evidence),
        spent=Spent(0.0, runner.runs, runner.simulated_s),
        finished=finished,
    )


def _likeliest(posterior: Posterior, classes: Mapping[str, str]) -> Names:
    """Return the most probable member of the most probable equivalence class, which *none of them* is one by itself."""
    best = next(iter(by_class(posterior.probabilities, classes)))
    return next(names for names in posterior.probabilities if class_of(names, classes) == best)


def _by_constants(
    evidence: Evidence, detection: Detection, likeliest: Names, constants: Constants
) -> tuple[Detection, Names]:
    """Return the test with how far constants had to move without any effect, and the likeliest explanation then.

    That is the effect if constants stay within their tolerances beside it, or if there is a gap whatever the constants
    are. If they have to leave their tolerances with the effect too, and nothing else shows a gap, it is none of the
    effects.
    """

    def deviations(fit: Fit) -> list[float]:
        return [each.deviations for each in _constants(evidence, fit)]

    explained = evidence.explained
    found = beyond_tolerance(detection, deviations(explained.within), constants)
    if likeliest == NONE_OF_THEM or is_as_drawn(deviations(explained.fits[likeliest])):
        return found, likeliest
    return (detection, likeliest) if detection.gap or not found.gap else (found, NONE_OF_THEM)


def _verdict(detection: Detection, posterior: Posterior, likeliest: Names) -> Verdict:
    if not detection.gap:
        return Verdict.NO_GAP
    if likeliest == NONE_OF_THEM:
        return Verdict.UNKNOWN
    return Verdict.EFFECTS if len(posterior.credible) == 1 else Verdict.AMBIGUOUS


def _reasons(verdict: Verdict, detection: Detection, posterior: Posterior, evidence: Evidence) -> tuple[str, ...]:
    where = detection.seen.value
    first = (
        f"the difference is {np.sqrt(detection.ratio):.2f} times healthy scatter; a healthy machine shows as much "
        f"{where} with a probability of {detection.p_value:.2g}"
    )
    if evidence.error.without_references:
        accuracy = evidence.problem.accuracy
        beside = f" and the simulator's accuracy of {100.0 * accuracy:g} % of each signal's range" if accuracy else ""
        others = f"{detection.farthest:.2f} times what other machines leave"
        farthest = f", in the signal that is farthest off {others}" if detection.farthest else ""
        first = (
            f"with the constants of the machine fitted, their tolerances as priors, the difference is "
            f"{np.sqrt(detection.ratio):.2f} times scatter{beside}{farthest}; a machine as drawn shows as much {where} "
            f"with a probability of {detection.p_value:.2g}"
        )
    far = beyond(_constants(evidence, evidence.explained.within))
    moved = ", ".join(f"{each.name} by {each.deviations:+.1f}" for each in far)
    alone = (f"without any effect beyond its tolerance, in standard deviations: {moved}",) if far else ()
    if verdict is Verdict.NO_GAP:
        return first, *alone
    best = next((names for names in posterior.probabilities if names != NONE_OF_THEM), None)
    if best is None:
        return first, *alone, "no effect on offer moves these signals"
    share = 100.0 * explained_by(evidence, evidence.explained.fits[best])
    classes = class_names(evidence.classes)
    probability = by_class(posterior.probabilities, classes)[class_of(best, classes)]
    whole = " with all of its equivalence class" if set(best) & set(classes) else ""
    second = f"{' + '.join(best)} explains {share:.0f} % of its square; probability {probability:.2f}{whole}"
    unknown = posterior.probabilities.get(NONE_OF_THEM, 0.0)
    return first, *alone, second, f"none of the effects on offer: probability {unknown:.2f}"


def _subsystems(evidence: Evidence, posterior: Posterior) -> dict[str, float]:
    found: dict[str, float] = {}
    for names, probability in posterior.probabilities.items():
        for name in names:
            subsystem = evidence.problem.library.effect(name).subsystem
            found[subsystem] = found.get(subsystem, 0.0) + probability / len(names)
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def _constants(evidence: Evidence, fit: Fit) -> tuple[FittedConstant, ...]:
    """Return the constants of the machine beside a candidate, with their posterior's intervals."""
    constants = evidence.machine.problem.constants
    if not constants:
        return ()
    root, count = evidence.machine.root, len(fit.scores)
    covariance = root @ evidence.error.covariance(fit)[-count:, -count:] @ root.T
    found = []
    for each, variance in zip(constants, np.diag(covariance).tolist(), strict=True):
        value, half = fit.machine.get(each.name, each.null), _Z90 * np.sqrt(variance) * each.sigma
        found.append(
            FittedConstant(
                each.name, each.unit, value, each.null, (value - each.null) / each.sigma, *_within(value, half, each)
            )
        )
    return tuple(sorted(found, key=lambda each: -abs(each.deviations)))


def _traces(evidence: Evidence, fit: Fit) -> tuple[Trace, ...]:
    found = []
    for setting, each, own, signature in zip(
        evidence.settings,
        evidence.residuals,
        evidence.difference.settings,
        fit.changes(evidence.difference),
        strict=True,
    ):
        layout = setting.layout
        deviation = np.sqrt(own.variance)
        tables = [
            layout.by_signal(row)
            for row in (each.difference, deviation, signature, setting.faulty_features.mean(axis=0), each.simulated)
        ]
        for i, (name, unit) in enumerate(zip(layout.signals, layout.units, strict=True)):
            found.append(Trace(setting.name, name, unit, layout.time_s, *(table[i] for table in tables)))
    return tuple(found)


def _notes(evidence: Evidence) -> tuple[str, ...]:
    notes = [
        f"setting '{setting.name}' has no reference: an error of the simulator cannot be distinguished from a fault, "
        f"except by the priors of the machine's constants; record {_ENOUGH} runs of the healthy machine"
        for setting in evidence.settings
        if not setting.references and any(each.references for each in evidence.settings)
    ]
    moved = {name: x for name, x in evidence.calibration.deviations.items() if abs(x) > 1.0}
    if moved:
        found = ", ".join(f"{name} {x:+.1f}" for name, x in sorted(moved.items(), key=lambda item: -abs(item[1])))
        notes.append(f"calibrated to the references, in standard deviations of their priors: {found}")
    runs = [run for setting in evidence.settings for run in (*setting.faulty, *setting.references)]
    notes += [text for setting in evidence.settings if (text := _cut_short(setting))]
    notes += [
        f"setting '{setting.name}': {name} never changes; its noise is taken for the largest in its unit: declare it"
        for setting in evidence.settings
        for name in stuck_in([*setting.faulty, *setting.references])
    ]
    notes += [f"{run.name}: {note}" for run in runs for note in run.notes]
    return tuple(dict.fromkeys(notes))


_MUCH = 0.9
"""Share of the longest signal of a setting below which it is said that less is compared."""


def _cut_short(setting: Setting) -> str:
    """Return that less of a setting is compared than was recorded, and which signal ends there; empty: it is not so."""
    ends = [
        (float(run.signal(name).time_s[-1]), name, run.name)
        for run in (*setting.faulty, *setting.references)
        for name in setting.layout.signals
    ]
    (first_s, signal, name), (last_s, *_) = min(ends), max(ends)
    if first_s >= _MUCH * last_s:
        return ""
    return f"setting '{setting.name}': {first_s:.3g} of {last_s:.3g} s are compared, as {signal} of {name} ends there"
