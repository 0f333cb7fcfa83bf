"""The ledger: how much of the gap closes by the machine's constants, by each effect, and what is left.

Every figure is of stretches of time that it was not fitted to (`predict`). What overlaps is shared by Shapley's value:
the mean of what a part closes over all orders in which the parts may be added (Shapley 1953, Contributions to the
Theory of Games II:307).
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from math import factorial
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.core.joint import begun, fit_jointly
from jammkle_gap.core.predict import by_time, predicted
from jammkle_gap.core.result import LedgerEntry

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.discrepancy import Discrepancy
    from jammkle_gap.core.fit import Fit
    from jammkle_gap.core.joint import Machine
    from jammkle_gap.core.scatter import Difference
    from jammkle_gap.core.simulate import Made, Runner

CONSTANTS = "constants of the machine"
LEFT = "left"
_SMALLEST = 0.05
"""Gap above scatter below which there is nothing to share."""


def ledger_of(
    machine: Machine,
    error: Discrepancy,
    difference: Difference,
    best: Fit | None,
    fits: Mapping[tuple[str, ...], Fit],
    runner: Runner,
    constants: Constants,
) -> tuple[LedgerEntry, ...]:
    """Return the shares of the gap: the constants first, then every effect of the best candidate, then what is left.

    Args:
        machine: What is explained.
        error: Of the simulator.
        difference: Whitens by scatter.
        best: The candidate; None: none of the effects.
        fits: All candidates fitted with the constants; none of them, (), is one.
        runner: Makes the runs of those that are missing.
        constants: Of the model.

    """
    fit = fits[()] if best is None else best
    known = {frozenset({CONSTANTS, *names}): each for names, each in fits.items()}
    parts = (CONSTANTS, *fit.names) if machine.problem.constants else fit.names
    known[frozenset({CONSTANTS, *fit.names})] = fit
    whitens, folds = error.difference_with(fit), by_time(machine.settings)
    some = [frozenset(chosen) for count in range(1, len(parts) + 1) for chosen in combinations(parts, count)]
    missing = [each for each in some if each not in known]
    coarse = machine.coarse()
    work = [
        (
            coarse if CONSTANTS in each else coarse.held(),
            whitens,
            fit,
            tuple(name for name in fit.names if name in each),
            constants,
        )
        for each in missing
    ]
    answers = runner.map(_fit_part, work, "shares of the gap")
    runner.count(made for _, made in answers)
    known.update(zip(missing, (own for own, _ in answers), strict=True))
    gaps = {each: _gap(predicted(machine, error, difference, known[each], folds), difference.healthy) for each in some}
    gaps[frozenset()] = _gap(difference.by_scatter(machine.raw), difference.healthy)
    whole, least = gaps[frozenset()], gaps[frozenset(parts)]
    above = whole - 1.0 if whole - 1.0 > _SMALLEST else np.nan
    closed = closed_by(parts, gaps)
    found = [LedgerEntry(part, closed[part] / above, gaps[frozenset({part})]) for part in parts]
    return (*found, LedgerEntry(LEFT, max(least - 1.0, 0.0) / above, least))


def _fit_part(
    machine: Machine,
    whitens: Difference,
    best: Fit,
    names: tuple[str, ...],
    constants: Constants,
) -> tuple[Fit, Made]:
    """Return a fit of some of the effects of a candidate, begun where the candidate has come to, and its runs.

    Args:
        machine: What is to be explained; that of `held` has its constants nominal.
        whitens: The difference beside the discrepancy that the candidate leaves.
        best: The candidate.
        names: Effects of it, or none.
        constants: Of the model.

    """
    if not machine.problem.constants:
        nominal = tuple(replace(each, shared=each.shared[:, :0]) for each in whitens.settings)
        whitens = replace(whitens, settings=nominal, shared=whitens.shared[:, :0])
    signatures = machine.signatures()
    return fit_jointly(machine, whitens, begun(names, best.values), signatures, constants), signatures.made


def _gap(left: NDArray[np.float64], healthy: float) -> float:
    return float(np.sqrt(np.square(left).mean() / healthy))


def closed_by(parts: Sequence[str], gaps: Mapping[frozenset[str], float]) -> dict[str, float]:
    """Return what each part closes of a gap, by Shapley's value; together they close what all of them do.

    Fewer parts than all may leave more than none does, such as constants that stand for an effect which is not there.
    They close nothing then, as nobody would take them by themselves. Below scatter nothing is left to close.

    Args:
        parts: Constants and effects.
        gaps: What is left with every choice of them, with none as well.

    """
    most = gaps[frozenset()]
    left = {each: max(gap if len(each) == len(parts) else min(gap, most), 1.0) for each, gap in gaps.items()}
    return {part: _shapley(part, parts, left) for part in parts}


def _shapley(part: str, parts: Sequence[str], gaps: Mapping[frozenset[str], float]) -> float:
    others = [each for each in parts if each != part]
    total = 0.0
    for count in range(len(parts)):
        weight = factorial(count) * factorial(len(others) - count) / factorial(len(parts))
        for chosen in combinations(others, count):
            total += weight * (gaps[frozenset(chosen)] - gaps[frozenset({*chosen, part})])
    return total
