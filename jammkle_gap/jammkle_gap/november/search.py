"""Which effects to fit: all singles, the pairs that promise most, and more where pairs earn it.

Pairs are ranked by what the derivatives of all probes promise together, not by how their halves do alone: two effects
may each be worth little and explain most together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING

from jammkle_gap.november.explanations import material_ones
from jammkle_gap.november.fitting import CALIBRATED_RUNS, POLISHING_RUNS, Fit, jacobians_at, polish, uncalibrated
from jammkle_gap.november.ledger import Ledger
from jammkle_gap.november.promise import Promises
from jammkle_gap.november.prospects import Prospects
from jammkle_gap.november.refining import fit_contenders, fit_side_by_side, linear_step
from jammkle_gap.november.runs import StoppedError
from jammkle_gap.november.scoring import CLEAR_NATS, Score, best_set, difference
from jammkle_gap.november.starts import Starts, promise

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from jammkle_gap.november.fitting import Loss
    from jammkle_gap.november.limits import Limits
    from jammkle_gap.november.residual import Layout, Weighting
    from jammkle_gap.november.runs import Runs
    from jammkle_gap.november.sensitivity import Probe
    from jammkle_gap.november.verdict import Criteria

RUNS_PER_SINGLE = 5
RUNS_PER_PAIR = 5
MOST_PAIRS = 14
"""Pairs fitted in full: those that promise most over all, and those with one of the best singles."""
FEWEST_PAIRS = 5
"""Pairs fitted in any case where the best single leaves a gap: a promise is only a linear one."""
_AT_FLOOR = 1.2
_WIDE = 1.5
SCANNED = 10
"""Where no single effect comes nearer to the floor than `_WIDE`, so many of them are tried over their ranges."""
BEST_SINGLES = 2
MOST_RENEWED = 5
"""Of them, fitted once more with derivatives of their own."""
MOST_EFFECTS = 4
LOOKED_AT = 5
"""Pairs whose promise decides whether more than a few are fitted."""
_ROUNDS = 3
MOST_ALIKE = 4
MOST_FINALISTS = 5
"""Candidates that are fitted again with derivatives of their own."""
FEWEST_FINALISTS = 3
"""The same, where they can only be leads."""
_ALIKE = 0.02
"""Candidates that gain as much as the best but for this share are fitted again, too."""
_ROOM_NATS = 6.0
"""Candidates this far behind what is told apart are still fitted again."""


@dataclass(frozen=True)
class Found:
    """What a search came up with."""

    scores: tuple[Score, ...]
    """Every candidate fitted in full, best first; the nominal simulator among them."""
    chosen: tuple[Score, ...]
    """The set: what cannot be told apart from the best, best first."""
    weighting: Weighting
    finished: bool
    """False if it was stopped on the way: then the scores are of what had been done."""


class Search:
    """One search over a library."""

    def __init__(
        self,
        layout: Layout,
        runs: Runs,
        probes: Sequence[Probe],
        nominal: NDArray[np.float64],
        limits: Limits,
        criteria: Criteria,
        on_progress: Callable[[str, float], None],
        calibrated: Fit | None = None,
    ) -> None:
        """Prepare.

        Args:
            layout: Of the residual.
            runs: Of the simulator.
            probes: Of the effects that move something.
            nominal: Residual without any effect.
            limits: Largest gaps that count as none.
            criteria: What a candidate has to close to be looked at.
            on_progress: Called with what is being done and the share that is done.
            calibrated: Fit of the calibration alone, from where it goes along with every candidate.

        """
        self._layout = layout
        self._runs = runs
        self._criteria = criteria
        self._limits = limits
        self._probes = {probe.effect.name: probe for probe in probes}
        self._nominal = calibrated or uncalibrated(nominal)
        self._calibration = self._nominal.calibration
        self._polishing = CALIBRATED_RUNS if self._calibration else POLISHING_RUNS
        self._ledger = Ledger(layout, self._nominal)
        self._prospects = Prospects(layout, self._nominal, limits)
        self._progress = on_progress
        self._starts = Starts(layout, runs, self._probes, self._nominal)

    @property
    def _tried(self) -> int:
        return len(self._probes)

    @property
    def _fits(self) -> list[Fit]:
        return list(self._ledger.fits.values())

    def run(self) -> Found:
        """Search; an interruption or a stop keeps what is done."""
        finished = True
        try:
            self._singles()
            if self._prospects.least(self._fits) > _WIDE:
                self._scan()
            for size in range(2, MOST_EFFECTS + 1):
                if self._prospects.settled(self._fits):
                    break
                if size > 2 and not (len(self._best().names) == size - 1 and self._prospects.worthwhile(self._fits)):  # noqa: PLR2004  # pairs always
                    break
                self._more(size)
            self._finish()
        except (StoppedError, KeyboardInterrupt):
            finished = False
        self._ledger.judge()
        scores = self._ledger.scores()
        return Found(tuple(scores), tuple(self._set()), self._ledger.weighting, finished)

    def without_runs(self) -> Found:
        """Return what the probes alone say of single effects: enough where there is nothing to explain."""
        loss = self._ledger.loss()
        for name in sorted(self._probes):
            start = self._starts.of([name], self._ledger.fits, loss)
            step = linear_step(start.residual, start.jacobian, loss, -start.point, 1.0 - start.point)
            after = start.residual + start.jacobian @ step
            self._ledger.fits[name,] = replace(start, point=start.point + step, residual=after, cost=loss.cost(after))
        scores = self._ledger.scores()
        nominal = tuple(each for each in scores if not each.names)
        return Found(tuple(scores), nominal, self._ledger.weighting, finished=True)

    def _set(self) -> list[Score]:
        return best_set(material_ones(self._layout, self._ledger.scores(), self._criteria, self._limits), self._tried)

    def _best(self) -> Score:
        return self._set()[0]

    def _promising(self, pairs: Sequence[tuple[str, ...]], loss: Loss) -> bool:
        """Whether any of these pairs would, by a linear step, close enough to end in an explanation."""
        promised = []
        for names in pairs:
            start = self._starts.of(names, self._ledger.fits, loss)
            step = linear_step(start.residual, start.jacobian, loss, -start.point, 1.0 - start.point)
            promised.append(self._layout.gap_above_floor(start.residual + start.jacobian @ step))
        return self._prospects.enough(min(promised))

    def _fit(self, candidates: Sequence[tuple[str, ...]], loss: Loss, most_runs: int, share: float) -> None:
        starts = [self._starts.of(names, self._ledger.fits, loss) for names in candidates]
        self._ledger.add(fit_contenders(starts, loss, self._runs, self._layout, most_runs))
        self._progress("fitting effects", share)

    def _singles(self) -> None:
        self._progress("fitting single effects", 0.0)
        self._fit([(name,) for name in sorted(self._probes)], self._ledger.loss(), RUNS_PER_SINGLE, 0.2)
        loss = self._ledger.loss()
        away = [probe for probe in self._probes.values() if probe.residual is not self._nominal.residual]
        nulls = [self._starts.at_null(probe.effect.name, self._ledger.fits, loss) for probe in away]
        for fit in fit_contenders(nulls, loss, self._runs, self._layout, RUNS_PER_SINGLE):
            if fit.cost < loss.cost(self._ledger.fits[fit.names].residual):
                self._ledger.fits[fit.names] = fit
        self._ledger.judge()
        if self._calibration:
            self._again([(name,) for name in sorted(self._probes)])
        elif away:
            self._again([(probe.effect.name,) for probe in away])
        # Once more with signals judged by the best, for those that gained something.
        loss = self._ledger.loss()
        again = [
            fit for names, fit in self._ledger.fits.items() if names and loss.cost(fit.residual) < self._ledger.cost(())
        ]
        renewed = [replace(fit, cost=loss.cost(fit.residual), polished=False) for fit in again]
        self._ledger.add(fit_contenders(renewed, loss, self._runs, self._layout, 2))
        self._ledger.judge()

    def _scan(self) -> None:
        """Fit effects of one parameter again from the best of some values all over its range."""
        loss = self._ledger.loss()
        singles = [fit for names, fit in self._ledger.fits.items() if len(names) == 1 and len(fit.point) == 1]
        singles = sorted(singles, key=lambda fit: promise(fit, loss))[:SCANNED]
        starts = self._starts.over_range(singles, loss)
        self._ledger.add(fit_side_by_side(starts, loss, self._runs, self._layout, RUNS_PER_SINGLE))
        self._ledger.judge()

    def _more(self, size: int) -> None:
        """Fit the combinations of one more effect that promise most."""
        loss = self._ledger.loss()
        best = [each.names for each in self._ledger.scores() if len(each.names) == size - 1]
        tops = [set(names) for names in best[:BEST_SINGLES]]
        if size == 2:  # noqa: PLR2004  # all pairs
            offered = list(combinations(sorted(self._probes), size))
        else:
            offered = sorted({tuple(sorted(top | {name})) for top in tops for name in self._probes if name not in top})
        offered = [names for names in offered if names not in self._ledger.fits]
        if not offered:
            return
        promises = Promises(self._probes, self._ledger.fits, self._nominal, loss)
        least = promises.least()
        promised: list[tuple[float, tuple[str, ...]]] = []
        for place, names in enumerate(offered):
            promised.append((promises.of(names), names))
            if place % 200 == 0:
                self._progress(f"weighing combinations of {size}", 0.3 + 0.2 * place / len(offered))
        promised.sort()
        worthwhile = self._prospects.worthwhile(self._fits) or self._promising(
            [names for _, names in promised[:LOOKED_AT]], loss
        )
        worth = [names for cost, names in promised if cost < least - CLEAR_NATS]
        if len(worth) < FEWEST_PAIRS and self._prospects.least(self._fits) > _AT_FLOOR:
            worth = [names for _, names in promised[:FEWEST_PAIRS]]
        with_top = [names for names in worth if any(top < set(names) for top in tops)]
        half = MOST_PAIRS // 2
        chosen = list(dict.fromkeys(worth[:half] + with_top[:half]))
        chosen += [names for names in worth if names not in chosen][: MOST_PAIRS - len(chosen)]
        chosen = chosen if worthwhile else chosen[:FEWEST_PAIRS]
        if chosen:
            self._fit(chosen, loss, RUNS_PER_PAIR, 0.55)
            self._ledger.judge()
            self._again(chosen)

    def _again(self, candidates: Sequence[tuple[str, ...]]) -> None:
        """Fit the most promising combinations once more, with derivatives of their own and signals judged anew.

        Two effects that nearly make up for each other lie in a narrow valley, which the probes' derivatives miss.
        """
        loss = self._ledger.loss()
        starts = [self._starts.of(names, self._ledger.fits, loss) for names in candidates]
        ranked = sorted(zip([promise(start, loss) for start in starts], candidates, strict=True))
        places = dict(zip(candidates, starts, strict=True))
        best = [places[names] for _, names in ranked[:MOST_RENEWED]]
        fresh = jacobians_at(best, self._runs, self._layout)
        renewed = [replace(start, jacobian=jacobian) for start, jacobian in zip(best, fresh, strict=True)]
        self._ledger.add(fit_side_by_side(renewed, loss, self._runs, self._layout, RUNS_PER_PAIR))
        self._ledger.judge()
        self._progress("fitting effects", 0.7)

    def _finish(self) -> None:
        """Fit what may end in the set again, with derivatives of its own."""
        for _ in range(_ROUNDS if self._prospects.worthwhile(self._fits) else 1):
            scores = self._ledger.scores()
            chosen = self._set()
            leader = chosen[0]
            near = [
                each
                for each in scores
                if each.names
                and (len(each.names) <= len(leader.names) or each.total > leader.total)
                and difference(leader, each).nats < 2.0 * difference(leader, each).error + _ROOM_NATS
            ]
            # One step may foretell wrongly what a new fit without a block would: what fits as well gets its own.
            least = self._ledger.cost(leader.names)
            utmost = least + _ROOM_NATS + _ALIKE * max(self._ledger.cost(()) - least, 0.0)
            alike = [
                each
                for each in sorted(scores, key=lambda one: self._ledger.cost(one.names))
                if each.names and len(each.names) <= len(leader.names) and self._ledger.cost(each.names) < utmost
            ]
            finalists = list(dict.fromkeys([each.names for each in chosen + alike[:MOST_ALIKE] + near if each.names]))
            finalists = finalists[: MOST_FINALISTS if self._prospects.worthwhile(self._fits) else FEWEST_FINALISTS]
            rough = [names for names in finalists if not self._ledger.fits[names].polished]
            if not rough:
                return
            for place, names in enumerate(rough):
                self._ledger.fits[names] = polish(
                    self._ledger.fits[names], self._ledger.loss(), self._runs, self._layout, self._polishing
                )
                self._progress("fitting the best once more", 0.7 + 0.3 * (place + 1) / len(rough))
            loss = self._ledger.loss()
            # Alone, a part may have been stuck elsewhere than where the whole has ended.
            parts = self._starts.of_parts([self._ledger.fits[names] for names in rough], self._ledger.fits, loss)
            self._ledger.add(fit_side_by_side(parts, loss, self._runs, self._layout, RUNS_PER_PAIR))
            self._ledger.judge()
            self._ledger.hold_out(finalists, self._runs)
            self._progress("holding out stretches", 1.0)
