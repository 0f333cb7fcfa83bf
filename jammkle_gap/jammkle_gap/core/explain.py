"""The search: which effects explain the difference beside the machine's constants and the simulator's own error."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_gap.core.decide import NONE_OF_THEM, by_likelihood, by_signals, detect
from jammkle_gap.core.fit import Fit, Profiles, grid_signatures
from jammkle_gap.core.joint import CENTRAL, FORWARD, begun, blank_of, derivatives_of, fit_jointly, slopes_in
from jammkle_gap.core.predict import predicting
from jammkle_gap.core.signatures import grids_of
from jammkle_gap.core.simulate import Made, StoppedError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.decide import Detection, Names
    from jammkle_gap.core.discrepancy import Discrepancy
    from jammkle_gap.core.fit import GridFeatures, Place
    from jammkle_gap.core.joint import Machine
    from jammkle_gap.core.scatter import Difference
    from jammkle_gap.core.simulate import Runner

    Provisional = Callable[[Sequence[tuple[str, float]]], None]
    """Reports which effects explain which share of the squared difference before any is fitted, best first."""

_FAR = 0.5
"""Standard deviations that the constants move alone, from which on effects are looked for there as well."""
_BEYOND = 2.5
"""Standard deviations from nominal from which on a constant may stand for an effect. Chosen: one of 70 constants of a
machine as drawn lies beyond."""
_WORTH_GOING_ON = 1.0
"""Nats that derivatives taken anew must be expected to gain, for the constants alone to be fitted on."""
_CONTENDS = 8.0
"""Nats below the likeliest candidate within which others are simulated again as the machine is, where a search takes
longer steps. Chosen: twice what fitting them so gains, and ten times what steps of 2 ms changed on an ankle."""
_HOPELESS = 16.0
"""Nats that a candidate may be behind the best of those that begin where it does, when all were fitted once, to be
fitted on where that is dear. Chosen: further rounds gained 45 to 52 nats each on a development specimen with a leak."""
_OVERTAKEN = 60.0
"""Nats that a candidate may be behind the best fit of the same effects from other constants, or of the constants alone,
to be fitted on. Chosen: on a healthy development specimen those that were 88 to 97 behind gained 77 to 79, and never
caught up."""
_SETTLED = 0.25
"""Nats that a further fit gains, from 0 to this, for none to follow it. Chosen: a quarter of `_WORTH_GOING_ON`."""
_AT_BOUND, _WITHIN, _AS_LIKELY = 0.1, (1.0, 2.0), 1.0
"""A constant this near to its bound, in standard deviations, is tried so far within it, and is begun there again where
that costs less than so many nats. Chosen: a third of half a normal prior lies beyond one, and a twentieth beyond two
deviations; a nat is no evidence. The reach was chosen on the one ankle of `_from_bounds`."""
_SAME = 0.1
"""Nats that a fit may cost more than the one it began at, and still be kept for its later derivatives. Chosen: no
candidate is more likely than another for less."""
_NESTED = 2
"""Candidates from whose constants those alone are fitted once more, and pairs from which each half is."""


@dataclass(frozen=True)
class Explained:
    """Everything that was fitted."""

    nothing: Fit
    """None of the effects: the constants alone, beside scatter."""
    noticed: tuple[Fit, ...]
    """Single effects beside scatter alone: whether there is a gap."""
    within: Fit
    """None of the effects, beside model discrepancy."""
    fits: Mapping[Names, Fit]
    """Effects and pairs beside model discrepancy: which it is."""
    likelihoods: Mapping[Names, float]
    """Logarithms, up to the same constant: of each candidate, and of none of them."""
    silent: tuple[str, ...]
    """Effects that move no feature here."""
    finished: bool
    """False if it was stopped before all that promised something were fitted."""


def explain(
    machine: Machine,
    error: Discrepancy,
    grids: GridFeatures,
    runner: Runner,
    constants: Constants,
    provisional: Provisional | None = None,
) -> Explained:
    """Look for the effects that explain the difference beside the constants of the machine.

    Effects are looked for on their grids, beside constants that are linear about the nominal machine and about where
    they explain most alone. Those that promise most are fitted with the simulator, pairs of them too where there is a
    gap, and the most likely again with derivatives of their own.

    Args:
        machine: What is to be explained.
        error: Of its simulator; holds the difference, whitened by scatter and the priors of the constants.
        grids: What grid points make of the features.
        runner: Makes the runs.
        constants: Of the model.
        provisional: Reports the first answer.

    Raises:
        StoppedError: asked to stop before anything was fitted.

    """
    return _Search(machine, error, grids, runner, constants).explained(provisional)


def least_left(
    machine: Machine, error: Discrepancy, grids: GridFeatures, runner: Runner, constants: Constants
) -> float:
    """Return the squared length of what the best of the most promising effects leaves, with the constants held."""
    search = _Search(machine, error, grids, runner, constants)
    base = search.base(error.difference)
    fits = search.fitted(search.begun_at(base.singles[: constants.tried_on_machines], search.blank), "")
    return min((fit.left for fit in fits), default=base.length)


@dataclass(frozen=True)
class _Base:
    """Effects on their grids, beside constants that are taken as linear about one place."""

    length: float
    """Square of the difference, whitened about this base."""
    profiles: Profiles
    singles: Sequence[Place]
    """Effects, the most promising first."""
    fit: Fit | None
    """The constants that a candidate begins with; None: these were nominal where it was looked for."""


@dataclass(frozen=True)
class _Start:
    """A candidate to be fitted."""

    place: Place
    scores: NDArray[np.float64]
    """Of the constants that it begins with."""
    weighs: Fit
    """Its discrepancy weighs the features first."""
    slopes: Sequence[NDArray[np.float64]] | None
    """Derivatives by the constants; None: those at the nominal machine."""
    evenly: bool
    """Whether that discrepancy is spread evenly over each signal at first."""


class _Search:
    """One search: what is explained, and with what."""

    def __init__(
        self, machine: Machine, error: Discrepancy, grids: GridFeatures, runner: Runner, constants: Constants
    ) -> None:
        self._machine, self._error, self._grids, self._runner = machine, error, grids, runner
        self._settings = range(len(machine.settings))
        derivatives, recorded_s = (
            len(machine.problem.constants),
            sum(each.faulty[0].duration_s for each in machine.settings),
        )
        self._affordable = derivatives * len(machine.settings) <= constants.affordable_derivatives
        """Whether derivatives by all constants may be taken as often as they help."""
        self._dear = derivatives * recorded_s > constants.derivatives_s
        """Whether they take too long for every candidate to have its own."""
        if not error.without_references:
            # No error is found that would weigh the features anew.
            constants = replace(constants, joint_evaluations=constants.fit_evaluations, reweighings=1)
        elif self._dear:
            constants = replace(constants, refined=constants.refined_beside, refined_pairs=constants.refined_beside)
        self._constants = constants
        rough = machine.coarse() if self._dear else machine
        signatures = rough.signatures()
        self._rough = replace(rough, nominal=signatures.nominal())
        """What the search simulates; what it leaves of those that are likely is that of the machine itself."""
        self._is_rough = rough is not machine
        runner.count([signatures.made])
        self.blank = blank_of(error.difference)
        self.finished = True
        """False once it was asked to stop."""

    def explained(self, provisional: Provisional | None) -> Explained:
        """Return everything that was fitted."""
        machine, error, constants, blank = self._machine, self._error, self._constants, self.blank
        nothing = self._constants_alone()
        by_scores = nothing.slopes or [each.shared for each in error.difference.settings]
        slopes = [each @ np.linalg.inv(machine.root) for each in by_scores]
        bases = self._bases(nothing, slopes)
        if provisional is not None:
            length = max(bases[0].length, 1.0)
            provisional([(each.names[0], min(max(each.gain / length, 0.0), 1.0)) for each in bases[0].singles])
        promising = self._promising_singles(bases, nothing, slopes)
        singles = self._best_of(nothing, self.fitted(promising, "fitting", error.cost(nothing)))
        if machine.problem.constants:
            # Nats decide: constants that a candidate has found may explain more alone, too.
            work = [
                (self._rough, error, replace(blank, scores=each.scores), each, constants, slopes)
                for each in singles[:_NESTED]
            ]
            nothing = min([nothing, *self._until_stopped(fit_beside_error, work, "fitting")], key=error.cost)
        noticed = tuple(_whitened_by(error.difference, fit) for fit in singles)
        alone = _whitened_by(error.difference, nothing)
        pairs: list[Fit] = []
        gap = detect_beside_error(machine, error, alone, noticed, constants).gap
        if self.finished and singles and gap:
            if error.left_per_feature(singles[0]) > constants.doubtful and self._affordable:
                # What it leaves is searched for a second effect, and shall be as little as can be.
                settled = self._sharpened([singles[0]], (True, False), "fitting")
                singles = self._best_of(nothing, [*settled, *singles])
            promising = self._promising_pairs(singles, bases[min(1, len(bases) - 1)], nothing, slopes)
            pairs = self._best_of(nothing, self.fitted(promising, "fitting pairs", error.cost(nothing)))
            singles = self._best_of(nothing, [*singles, *self.halves(pairs[:_NESTED])])
        fits, likelihoods = self._weighed({fit.names: fit for fit in (nothing, *singles, *pairs)}, gap=gap)
        moving = {place.names[0] for place in bases[0].singles}
        silent = tuple(effect.name for effect in machine.problem.library if effect.name not in moving)
        return Explained(alone, noticed, fits.pop(NONE_OF_THEM), fits, likelihoods, silent, self.finished)

    def base(self, difference: Difference, fit: Fit | None = None) -> _Base:
        """Look effects up on their grids; arguments as the fields of `_Base`."""
        profiles = Profiles(
            grids_of(self._machine.problem), grid_signatures(self._grids, difference), difference.whitened
        )
        singles = sorted(map(profiles.single, profiles.names), key=lambda place: -place.gain)
        return _Base(float(difference.whitened @ difference.whitened), profiles, singles, fit)

    def responding(self, places: Sequence[Place], beside: Fit) -> list[_Start]:
        """Return candidates that begin where a fit's constants come to, to first order, once the effect is there.

        A constant that stands for the effect moves back, and others stay where they explain what it does not. At the
        optimum of the fit nothing is left to gain by the constants, so that the step of generalised least squares is
        that to the effect's signature alone.

        Args:
            places: Effects on their meshes; those that the fit has already stay as they are.
            beside: The fit.

        """
        weights, free = self._error.difference_with(beside), len(beside.values)
        slopes, columns = None, weights.shared
        if beside.slopes:
            slopes = [each[:, free:] for each in derivatives_of(self._rough, beside)]
            columns = weights.by_scatter([each[:, free:].T for each in beside.slopes]).T
        normal = np.eye(columns.shape[1]) + columns.T @ columns
        scores = beside.scores if len(beside.scores) else np.zeros(columns.shape[1])
        found = []
        for place in places:
            signature = [
                np.sum([own @ self._grids[name][k] for name, own in place.weights.items()], axis=0)
                for k in self._settings
            ]
            response = np.linalg.solve(normal, columns.T @ weights.by_scatter(signature))
            found.append(_Start(place, scores - response, beside, slopes, evenly=False))
        return found

    def fitted(self, starts: Sequence[_Start], what: str, alone: float = np.inf) -> list[Fit]:
        """Return candidates fitted beside the discrepancy that each leaves, those that can be simulated.

        Args:
            starts: Where they begin.
            what: Of the progress.
            alone: Cost of the constants alone; a candidate costs no more where it is well begun.

        """
        machine, error, constants = self._rough, self._error, self._constants
        once = replace(constants, reweighings=1) if self._dear else constants
        groups: dict[tuple[int, bool], list[tuple[Any, ...]]] = {}
        for start in starts:
            keys = [key for key, _ in machine.problem.library.parameters(start.place.names)]
            values = dict(zip(keys, np.concatenate(start.place.values).tolist(), strict=True))
            begin = replace(begun(start.place.names, values), scores=start.scores)
            begins = (machine, error, begin, start.weighs, once, start.slopes)
            groups.setdefault((id(start.weighs), start.evenly), []).append(begins)
        rest = replace(constants, reweighings=constants.reweighings - once.reweighings)
        found: list[Fit] = []
        begun_by = [
            (work, self._until_stopped(partial(fit_beside_error, evenly=evenly), work, what))
            for (_, evenly), work in groups.items()
        ]
        if not rest.reweighings:
            return [fit for _, fits in begun_by for fit in fits]
        least: dict[frozenset[str], float] = {}
        for fit in (fit for _, fits in begun_by for fit in fits):
            least[frozenset(fit.names)] = min(error.cost(fit), least.get(frozenset(fit.names), alone))
        for work, fits in begun_by:
            limit = min(map(error.cost, fits), default=0.0) + _HOPELESS
            near = [fit for fit in fits if error.cost(fit) < min(limit, least[frozenset(fit.names)] + _OVERTAKEN)]
            further = [(machine, error, fit, fit, rest, work[0][-1]) for fit in near]
            again = self._until_stopped(partial(fit_beside_error, evenly=False), further, what)
            found += [*fits, *again]
        return found

    def _until_stopped(
        self, function: Callable[..., tuple[Fit, Made]], work: Sequence[tuple[Any, ...]], what: str
    ) -> list[Fit]:
        """Return candidates fitted with several arguments, as far as they can be simulated, before a stop."""
        if not self.finished:
            return []
        try:
            answers = self._runner.map(function, work, what)
        except StoppedError as stopped:
            answers, self.finished = list(stopped.done), False
        self._runner.count(made for _, made in answers)
        return [fit for fit, _ in answers if fit.features]

    def _sharpened(self, fits: Sequence[Fit], evenly: Sequence[bool], what: str) -> list[Fit]:
        work = [(self._rough, self._error, fit, self._constants) for fit in fits]
        return self._until_stopped(partial(sharpen, evenly=evenly), work, what)

    def _best_of(self, nothing: Fit, fits: Sequence[Fit]) -> list[Fit]:
        """Return the likeliest fit of each candidate, the likeliest first."""
        own = self._error.scores(nothing, fits, len(self._machine.problem.library.effects))[1:]
        kept: dict[frozenset[str], Fit] = {}
        for fit, _ in sorted(zip(fits, own, strict=True), key=lambda each: -each[1]):
            kept.setdefault(frozenset(fit.names), fit)
        return list(kept.values())

    def _promising_singles(
        self, bases: Sequence[_Base], nothing: Fit, slopes: Sequence[NDArray[np.float64]]
    ) -> list[_Start]:
        """Return single effects to be fitted.

        Those are among them that explain most of a signal on the whole: block by block, a large gap counts as the error
        of the simulator, and what explains nearly all of it gains less than what moves blocks that agree already.
        """
        constants = self._constants
        starts: list[_Start] = []
        for base in bases:
            starts += self._begun_beside(base, base.singles[: constants.refined], nothing, slopes)
        if len(bases) == 1:
            evenly = self.base(self._error.evenly_with(self.blank))
        else:
            there = self._about(self._error.evenly_with(nothing), nothing, slopes, np.zeros(len(nothing.scores), bool))
            evenly = self.base(there, nothing)
        same = bases[min(1, len(bases) - 1)]
        known = {place.names for place in same.singles[: constants.refined]}
        others = [place for place in evenly.singles[: constants.paired] if place.names not in known]
        return [*starts, *self._begun_beside(evenly, others, nothing, slopes)]

    def _begun_beside(
        self, base: _Base, places: Sequence[Place], nothing: Fit, slopes: Sequence[NDArray[np.float64]]
    ) -> list[_Start]:
        if base.fit is not None:
            return self.begun_at(places, base.fit, nothing, slopes)
        # Where runs are cheap a fit is made in one go, and finds more from the nominal machine, weighed evenly first.
        return self.responding(places, nothing) if self._dear else self.begun_at(places, self.blank)

    def begun_at(
        self,
        places: Sequence[Place],
        fit: Fit,
        weighs: Fit | None = None,
        slopes: Sequence[NDArray[np.float64]] | None = None,
    ) -> list[_Start]:
        """Return candidates that begin with a fit's constants; by default its discrepancy weighs them, too."""
        return [_Start(place, fit.scores, weighs or fit, slopes, evenly=True) for place in places]

    def _promising_pairs(
        self, singles: Sequence[Fit], about: _Base, nothing: Fit, slopes: Sequence[NDArray[np.float64]]
    ) -> list[_Start]:
        """Return pairs to be fitted: from fitted effects on, and by grids alone.

        A second effect shows where the first leaves most, and is looked for by what that leaves of a signal on the
        whole: block by block, it would count as the error of the simulator.
        """
        weighed, constants = self._error.evenly_with(singles[0]), self._constants
        profiles = self.base(weighed).profiles
        most, tried = constants.refined_pairs // 2, constants.refined_pairs // 2
        if self._affordable and not self._dear and self._error.without_references:
            # A pair that is missed lets another be certain: where runs are cheap more of them are fitted.
            tried = 2 * constants.refined_pairs
        first = singles[: constants.paired]
        seconds = [(i, place) for i, fit in enumerate(first) for place in profiles.seconds(_whitened_by(weighed, fit))]
        kept = sorted(seconds, key=lambda each: -each[1].gain)[:tried]
        starts: list[_Start] = []
        for i, fit in enumerate(first):
            places = [place for k, place in kept if k == i]
            if self._dear:
                starts += self.responding(places, fit)
            elif about.fit is None:
                starts += self.begun_at(places, fit, self.blank)
            else:
                starts += self.begun_at(places, fit, nothing, slopes)
        names = [place.names[0] for place in about.singles[: constants.paired]]
        return [*starts, *self._begun_beside(about, about.profiles.pairs(names, most), nothing, slopes)]

    def halves(self, pairs: Sequence[Fit]) -> list[Fit]:
        """Return the effects of pairs by themselves, fitted from where the pair has come to.

        Else one half that was begun elsewhere, and is not fitted to its end, lets the other seem to be there.
        """
        work = []
        for pair in pairs:
            slopes = [each[:, len(pair.values) :] for each in derivatives_of(self._rough, pair)]
            for name in pair.names:
                values = {key: pair.values[key] for key, _ in self._machine.problem.library.parameters((name,))}
                start = replace(begun((name,), values), scores=pair.scores)
                work.append((self._rough, self._error, start, pair, self._constants, slopes))
        return self._until_stopped(partial(fit_beside_error, evenly=False), work, "fitting")

    def _slopes(
        self, difference: Difference, fit: Fit, ends_at: tuple[float, float], what: str
    ) -> list[NDArray[np.float64]]:
        """Return derivatives of the features where a candidate has come to, a setting at a time."""
        work = [(k, self._machine, difference, fit, ends_at) for k in self._settings]
        answers = self._runner.map(slopes_in, work, what)
        self._runner.count(made for _, made in answers)
        return [slopes for slopes, _ in answers]

    def _constants_alone(self) -> Fit:
        """Return the constants fitted alone, as well as they can be, with their derivatives there.

        What they leave is what is asked about.
        """
        machine, error, constants = self._rough, self._error, self._constants
        fit, made = fit_beside_error(machine, error, self.blank, self.blank, constants, None)
        self._runner.count([made])
        if not fit.features:
            return self.blank
        fit = self._settled(fit)
        if self._affordable and error.without_references and error.left_per_feature(fit) > constants.doubtful:
            fit = min(fit, self._settled(self._beside_scatter(fit)), key=error.cost)
        beyond = self._from_bounds(fit)
        return fit if beyond is None else min(fit, self._settled(beyond), key=error.cost)

    def _beside_scatter(self, fit: Fit) -> Fit:
        """Return the constants fitted by least squares beside scatter and their tolerances, from a fit on.

        A gap that is large counts as the simulator's own error, and tolerances then hold the constants back. With a
        servo's stiffness off by 8 standard deviations, the fit beside that error ended at 2, with a cost of 55 nats; at
        8 it is 32.
        """
        machine, difference, signatures = self._rough, self._error.difference, self._rough.signatures()
        for _ in range(self._constants.calibration_steps):
            slopes = self._slopes(difference, fit, CENTRAL, "constants of the machine")
            found = fit_jointly(machine, difference, fit, signatures, self._constants, slopes)
            gained = (
                _squares(machine, difference, fit) - _squares(machine, difference, found) if found.features else 0.0
            )
            fit = found if gained > 0.0 else fit
            if gained < _WORTH_GOING_ON:
                break
        self._runner.count([signatures.made])
        return fit

    def _from_bounds(self, fit: Fit) -> Fit | None:
        """Return a fit with those constants within their bounds that are as likely there; None where there is none.

        A floor that gives is felt once it gives by some tenths of a millimetre, and to first order nothing leads there
        from one that is hard. On an ankle whose floor gave, the constants alone ended at 142 nats, and with this at 73.
        """
        machine, error, what = self._rough, self._error, "constants of the machine"
        place = machine.mean + machine.root @ fit.scores
        if not np.array_equal(machine.root, np.eye(len(place))):
            return None  # what references know mixes the constants

        def moved(scores: NDArray[np.float64]) -> tuple[Machine, Discrepancy, Fit]:
            return machine, error, replace(fit, scores=scores, machine=machine.values(scores))

        steps = [
            inward * far * np.eye(len(place))[i]
            for inward, bound in zip((1.0, -1.0), machine.bounds, strict=True)
            for i in np.flatnonzero(inward * (place - bound) < _AT_BOUND)
            for far in _WITHIN
        ]
        tried = self._until_stopped(exactly, [moved(fit.scores + step) for step in steps], what)
        likely = [each for each in tried if error.cost(each) < error.cost(fit) + _AS_LIKELY]
        if not likely:
            return None
        scores = fit.scores.copy()
        for each in sorted(likely, key=error.cost, reverse=True):
            changed = each.scores != fit.scores
            scores[changed] = each.scores[changed]
        return next(iter(self._until_stopped(exactly, [moved(scores)], what)), None)

    def _settled(self, fit: Fit) -> Fit:
        """Return constants that are fitted alone with derivatives where they have come to, again and again."""
        machine, error, constants = self._rough, self._error, self._constants
        before = 0.0
        for _ in range(constants.calibration_steps if machine.problem.constants else 0):
            ends_at = CENTRAL if self._affordable else FORWARD
            slopes = self._slopes(error.difference_with(fit), fit, ends_at, "constants of the machine")
            found, made = fit_beside_error(machine, error, fit, fit, constants, slopes, evenly=False)
            self._runner.count([made])
            gained = error.cost(fit) - error.cost(found) if found.features else 0.0
            fit = found if gained > 0.0 else fit
            # Gauss-Newton steps gain in geometric series: the next would gain gained^2 / before.
            if gained < _WORTH_GOING_ON or gained * gained < _WORTH_GOING_ON * before:
                break
            before = gained
        return fit

    def _bases(self, nothing: Fit, slopes: Sequence[NDArray[np.float64]]) -> list[_Base]:
        """Return where effects are looked for: beside constants about nominal, where they explain most, and between.

        A worn pump is an effect, and constants of its curve as well. Beside constants that have taken an effect up it
        explains nothing more: it is looked for with those that lie beyond their tolerance held at nominal.
        """
        found = [self.base(self._error.difference_with(self.blank))]
        away = np.abs(nothing.scores)
        if away.max(initial=0.0) > _FAR:
            weighed, beyond = self._error.difference_with(nothing), away > _BEYOND
            there = self._about(weighed, nothing, slopes, np.zeros_like(beyond))
            found.append(self.base(there, nothing))
            if beyond.any():
                kept = replace(nothing, scores=np.where(beyond, 0.0, nothing.scores))
                between = self._about(weighed, nothing, slopes, beyond)
                found.append(self.base(between, kept))
        return found

    def _about(
        self, whitens: Difference, nothing: Fit, slopes: Sequence[NDArray[np.float64]], held: NDArray[np.bool_]
    ) -> Difference:
        """Return the difference with constants that are linear about where they explain most alone.

        They keep their priors: a place to linearise at is no knowledge (as in an iterated Kalman filter; Bell and
        Cathey 1993, IEEE Trans. Autom. Control 38:294). Scores that are held stay at 0.
        """
        columns = [each @ self._machine.root for each in slopes]
        moved = [
            raw - part + (each - own.shared) @ nothing.scores
            for raw, part, own, each in zip(self._machine.raw, nothing.features, whitens.settings, columns, strict=True)
        ]
        columns = [np.where(held, 0.0, each) for each in columns]
        settings = tuple(replace(own, shared=each) for own, each in zip(whitens.settings, columns, strict=True))
        found = replace(whitens, settings=settings, shared=whitens.by_scatter([each.T for each in columns]).T)
        return replace(found, whitened=found.whiten(moved))

    def _weighed(self, fits: Mapping[Names, Fit], *, gap: bool) -> tuple[dict[Names, Fit], dict[Names, float]]:
        """Return candidates beside the discrepancy that each leaves, and their log-likelihoods.

        The likeliest are fitted again, with derivatives of their own, or where these are dear with those of the best.
        """
        constants, what = self._constants, "likely causes"
        known, own = dict(fits), self._scored(fits)
        rounds = [(False, most) for most in constants.sharpened] if self._machine.problem.constants else []
        doubtful = self._error.left_per_feature(known[max(own, key=lambda names: own[names])]) > constants.doubtful
        if not gap:
            rounds = [(False, 0)]  # no candidate will be named, and none needs derivatives of its own
        elif doubtful and self._affordable:
            rounds = [*((evenly, most) for evenly in (True, False) for most in constants.sharpened_in_doubt), *rounds]
        if self._dear:
            best = max(own.values())
            near = {names: score for names, score in own.items() if score > best - _CONTENDS or not names}
            most = constants.refined_beside if gap else 0  # else none will be named
            if most:
                chosen = self._likeliest(near, most)
                likely = [known[names] for names in sorted(chosen, key=lambda names: -own[names])]
                known.update({fit.names: fit for fit in self._sharpened_together(likely, what)})
            if self._is_rough and self.finished:
                found = self._as_machine_itself([known[names] for names in near if known[names].slopes], most, what)
                known.update({fit.names: fit for fit in found})
                if self.finished:  # what the machine itself cannot be run with is none of its causes
                    kept = {NONE_OF_THEM, *(fit.names for fit in found)}
                    known = {names: fit for names, fit in known.items() if names in kept or names not in near}
            return known, self._scored(known)
        for evenly, most in rounds:
            again = self._sharpened([known[names] for names in self._likeliest(own, most)], (evenly,), what)
            known.update({fit.names: fit for fit in again})
            own = self._scored(known)
        return known, own

    def _scored(self, fits: Mapping[Names, Fit]) -> dict[Names, float]:
        others = [names for names in fits if names != NONE_OF_THEM]
        count = len(self._machine.problem.library.effects)
        # Each setting as the others predict it (Geisser and Eddy 1979, J. Am. Stat. Assoc. 74:153): on a real servo a
        # limit of torque with another constant fits three runs best by 17 nats, and predicts none the better.
        tried = {names: predicting(self._machine, self._error, fit) for names, fit in fits.items()}
        scores = self._error.scores(tried[NONE_OF_THEM], [tried[names] for names in others], count)
        return dict(zip((NONE_OF_THEM, *others), scores, strict=True))

    def _likeliest(self, own: Mapping[Names, float], most: int) -> set[Names]:
        def odds(names: Names) -> float:
            return own[names] - self._constants.pair_penalty * (len(names) - 1)

        chosen = sorted((names for names in own if names != NONE_OF_THEM), key=odds, reverse=True)[:most]
        # A pair is compared with its halves, and so these are fitted as well as it is.
        return {NONE_OF_THEM, *chosen, *((name,) for names in chosen for name in names if (name,) in own)}

    def _sharpened_together(self, fits: Sequence[Fit], what: str) -> list[Fit]:
        """Return candidates fitted again, with derivatives by the constants where the first effect has come to."""
        about = next((fit for fit in fits if fit.names), None)
        if about is None or not self.finished:
            return []
        try:
            slopes = self._slopes(self._error.difference_with(about), about, FORWARD, what)
        except StoppedError:
            self.finished = False
            return []
        slopes = [each[:, each.shape[1] - len(self._machine.problem.constants) :] for each in slopes]
        work = [(self._rough, self._error, fit, fit, self._constants, slopes) for fit in fits]
        return self._until_stopped(partial(fit_beside_error, evenly=False), work, what)

    def _as_machine_itself(self, fits: Sequence[Fit], most: int, what: str) -> list[Fit]:
        """Return what a search has found as the machine itself has it.

        Those that are likely then are fitted so once, by the derivatives that they have come to.
        """
        signatures = self._machine.signatures()
        itself = replace(self._machine, nominal=signatures.nominal())
        self._runner.count([signatures.made])
        found = self._until_stopped(exactly, [(itself, self._error, fit) for fit in fits], what)
        by_names = {fit.names: fit for fit in found}
        if not self.finished or NONE_OF_THEM not in by_names:
            return found
        chosen = self._likeliest(self._scored(by_names), most)
        once = replace(self._constants, reweighings=1)
        work = [
            (itself, self._error, fit, fit, once, derivatives_of(itself, fit)) for fit in found if fit.names in chosen
        ]
        return [*found, *self._until_stopped(partial(fit_beside_error, evenly=False), work, what)]


def detect_beside_error(
    machine: Machine, error: Discrepancy, nothing: Fit, singles: Sequence[Fit], constants: Constants
) -> Detection:
    """Test for a gap beyond scatter, and without references beyond tolerances and the accuracy of the simulator.

    There no healthy runs show how much they scatter along a signature: data sheets, tolerances and the stated accuracy
    say it, in as many degrees of freedom as the simulator's discrepancy has. An effect must explain more than an error
    of that size that lasts for a block; what nothing explains must be larger than it.

    Args:
        machine: Whose simulator has an accuracy.
        error: Of the simulator.
        nothing: The constants alone.
        singles: Effects, each with the constants.
        constants: Of the model.

    """
    if not error.without_references:
        return detect(error.difference, nothing.left, singles, constants)
    given = replace(constants, direction_prior_freedom=constants.discrepancy_freedom)
    by_bin, by_block, healthy = error.accurate_to(machine.problem.accuracy)
    alone, whole = _whitened_by(by_block, nothing).left, (by_bin, _whitened_by(by_bin, nothing).left, healthy)
    found = detect(by_block, alone, [_whitened_by(by_block, fit) for fit in singles], given, whole)
    # How far a simulator is off in an impact was not learned: its shape differs from run to run.
    smooth = [not setting.layout.event_s for setting in machine.settings]
    if machine.problem.accuracy and any(smooth):
        by_signal, _, healthy = error.accurate_to(constants.signal_accuracy * machine.problem.accuracy)
        fit = _whitened_by(by_signal, nothing)
        parts = zip(machine.settings, by_signal.split(fit.whitened - fit.signature), smooth, strict=True)
        squares = [np.square(own.layout.by_signal(part)).mean(axis=1).max() for own, part, used in parts if used]
        found = by_signals(found, float(max(squares)) / healthy, constants)
    gains = [(error.cost(nothing) - error.cost(fit), len(fit.values)) for fit in singles]
    return by_likelihood(found, gains, constants)


def _squares(machine: Machine, difference: Difference, fit: Fit) -> float:
    """Return half the squares of what constants leave beside scatter, and of how far they moved, in nats."""
    left = difference.by_scatter(machine.raw) - difference.by_scatter(fit.changes(difference))
    return 0.5 * float(left @ left + fit.scores @ fit.scores)


def _whitened_by(difference: Difference, fit: Fit) -> Fit:
    """Return a fit as another whitening sees it."""
    signature = difference.whiten(fit.features)
    free = len(fit.values)
    return replace(
        fit,
        signature=signature,
        left=float(np.square(difference.whitened - signature).sum()),
        jacobian=difference.whiten([each[:, :free].T for each in fit.slopes]).T if fit.slopes else fit.jacobian,
        whitened=difference.whitened,
    )


def fit_beside_error(
    machine: Machine,
    error: Discrepancy,
    start: Fit,
    before: Fit,
    constants: Constants,
    slopes: Sequence[NDArray[np.float64]] | None,
    *,
    evenly: bool = True,
) -> tuple[Fit, Made]:
    """Return a candidate fitted beside the model discrepancy that it leaves, and the runs that it took.

    Iteratively reweighted least squares: as the fit closes the gap, the discrepancy that weighs it shrinks.

    Args:
        machine: What is to be explained.
        error: Of the simulator.
        start: The candidate and where to begin.
        before: Fit whose discrepancy weighs the features first.
        constants: Of the model.
        slopes: Derivatives by the constants, or by parameters and constants; None: those at the nominal machine.
        evenly: Whether what that leaves is spread evenly over each signal at first.

    """
    difference = error.evenly_with(before) if evenly else error.difference_with(before)
    signatures, fit, best = machine.signatures(), start, start
    for _ in range(constants.reweighings):
        found = fit_jointly(machine, difference, fit, signatures, constants, slopes)
        if not found.features:
            break
        gained = error.cost(fit) - error.cost(found) if fit.slopes else np.inf
        fit = found
        # Where it begins it has been fitted before if it has derivatives; later ones are nearer to where it ends.
        best = fit if not best.slopes or error.cost(fit) < error.cost(best) + _SAME else best
        if 0.0 <= gained < _SETTLED:
            break
        difference = error.difference_with(fit)
    return best, signatures.made


def exactly(machine: Machine, error: Discrepancy, fit: Fit) -> tuple[Fit, Made]:
    """Return a candidate as the machine itself has it where a search has come to; no features if it cannot be run."""
    signatures = machine.signatures()
    made = signatures.parts(fit.values, fit.machine)
    if made is None:
        return replace(fit, features=()), signatures.made
    own = zip(made, error.difference.settings, strict=True)
    return replace(fit, features=tuple(part - each.shared @ fit.scores for part, each in own)), signatures.made


def sharpen(
    machine: Machine, error: Discrepancy, fit: Fit, constants: Constants, *, evenly: Sequence[bool]
) -> tuple[Fit, Made]:
    """Return a candidate fitted again with derivatives of its own, and the runs that it took.

    Args:
        machine: What is to be explained.
        error: Of the simulator.
        fit: The candidate.
        constants: Of the model.
        evenly: For each time that it is fitted, whether what it leaves is spread evenly over each signal.

    """
    signatures, best, runs = machine.signatures(), fit, list[Made]()
    for way in evenly:
        difference = error.evenly_with(fit) if way else error.difference_with(fit)
        slopes = [slopes_in(k, machine, difference, fit) for k in range(len(machine.settings))]
        runs += [made for _, made in slopes]
        found = fit_jointly(machine, difference, fit, signatures, constants, [each for each, _ in slopes])
        fit = found if found.features else fit
        best = fit if error.cost(fit) < error.cost(best) + _SAME else best
    runs.append(signatures.made)
    return best, Made(sum(each.runs for each in runs), sum(each.simulated_s for each in runs))
