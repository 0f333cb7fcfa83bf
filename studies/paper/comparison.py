"""Paper and simulation side by side: means, standard errors, differences in standard errors, claims."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from studies.paper.runs import (
    ENERGY,
    HANGING,
    PARAMETER_SETS,
    PEAK_OF_DESCENT,
    PEAK_OF_TEST,
    SLIP_EXPERIMENTS,
)
from studies.paper.tables import (
    ROWS,
    SIGNIFICANT,
    SIMILAR,
    SLIP_CLAIMS,
    SLIP_TEST,
    are_similar,
    is_reproduced,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from studies.paper.runs import Curve, Experiment, HangingSlip, Outcome
    from studies.paper.tables import PaperClaim, PaperRow

_FEWEST_FOR_SCATTER = 2


@dataclass(frozen=True)
class Statistic:
    """Mean, largest and standard error of the mean over repeats; the error is NaN for a single one."""

    mean: float
    largest: float
    standard_error: float

    @classmethod
    def of(cls, values: Sequence[float]) -> Statistic:
        """Return the statistic of at least one value."""
        count = len(values)
        error = float(np.std(values, ddof=1)) / math.sqrt(count) if count >= _FEWEST_FOR_SCATTER else math.nan
        return cls(float(np.mean(values)), float(np.max(values)), error)


@dataclass(frozen=True)
class RowComparison:
    """One row with one parameter set."""

    row: PaperRow
    parameter_set: str
    simulated: Statistic

    @property
    def z(self) -> float:
        """Simulated mean minus the paper's, in standard errors of the paper's mean."""
        return (self.simulated.mean - self.row.mean) / self.row.standard_error

    @property
    def reproduced(self) -> bool:
        """True within 2 standard errors or 3 %."""
        return is_reproduced(self.simulated.mean, self.row.mean, self.row.standard_error)

    def as_json(self) -> dict[str, Any]:
        """Return the row for machines."""
        return {
            "id": self.row.identifier,
            "test": self.row.test,
            "parameter_set": self.parameter_set,
            "paper_mean": self.row.mean,
            "paper_se": self.row.standard_error,
            "simulated": self.simulated.mean,
            "z": self.z,
        }


@dataclass(frozen=True)
class ClaimComparison:
    """One claim of the slip test with one parameter set."""

    claim: PaperClaim
    parameter_set: str
    holds: bool
    evidence: str
    """The numbers behind it, and from which on it counts as holding."""

    def as_json(self) -> dict[str, Any]:
        """Return the claim for machines."""
        return {
            "id": self.claim.identifier,
            "test": SLIP_TEST,
            "parameter_set": self.parameter_set,
            "claim": self.claim.text,
            "holds": self.holds,
            "evidence": self.evidence,
        }


class Outcomes:
    """Finished runs, by experiment and parameter set."""

    def __init__(self, outcomes: Sequence[Outcome]) -> None:
        """Sort the outcomes."""
        self._sorted: dict[tuple[str, str], list[Outcome]] = {}
        for outcome in outcomes:
            key = (outcome.task.experiment.identifier, outcome.task.parameter_set)
            self._sorted.setdefault(key, []).append(outcome)

    def repeats(self, identifier: str, parameter_set: str) -> Sequence[Outcome]:
        """Return the repeats of an experiment."""
        return self._sorted[identifier, parameter_set]

    def curves(self, identifier: str, parameter_set: str) -> list[Curve]:
        """Return the curves of the repeats of an experiment."""
        return [outcome.curve for outcome in self.repeats(identifier, parameter_set)]

    def statistic(self, identifier: str, parameter_set: str, result: str) -> Statistic:
        """Return the statistic of one result over the repeats of an experiment."""
        return Statistic.of([outcome.results[result] for outcome in self.repeats(identifier, parameter_set)])

    def broken(self) -> list[str]:
        """Say in which runs tendons tore."""
        return [
            f"{outcome.task.experiment.title} ({parameter_set}): {', '.join(outcome.broken)}"
            for (_, parameter_set), repeats in self._sorted.items()
            for outcome in repeats
            if outcome.broken
        ]


@dataclass(frozen=True)
class SlipStatistic:
    """Peaks and energy of one foot in the slip test with one parameter set."""

    title: str
    parameter_set: str
    before_heel_n: Statistic
    """Peak before the heel lands and the foot starts to slide; over all of the descent if it never lands."""
    peak_n: Statistic
    """Over all of the descent."""
    energy_j: Statistic

    def as_json(self) -> dict[str, Any]:
        """Return the foot for machines."""
        return {
            "foot": self.title,
            "parameter_set": self.parameter_set,
            "peak_before_heel_n": self.before_heel_n.mean,
            "peak_force_n": self.peak_n.mean,
            "energy_j": self.energy_j.mean,
        }


def compare_rows(outcomes: Outcomes) -> tuple[RowComparison, ...]:
    """Compare every row of both tables with both parameter sets."""
    return tuple(
        RowComparison(row, parameter_set, outcomes.statistic(row.identifier, parameter_set, PEAK_OF_TEST[row.test]))
        for row in ROWS
        for parameter_set in PARAMETER_SETS
    )


def slip_statistics(outcomes: Outcomes) -> tuple[SlipStatistic, ...]:
    """Return peaks and energy of every foot of the slip test with both parameter sets."""
    return tuple(
        SlipStatistic(
            experiment.title,
            parameter_set,
            outcomes.statistic(experiment.identifier, parameter_set, PEAK_OF_TEST[SLIP_TEST]),
            outcomes.statistic(experiment.identifier, parameter_set, PEAK_OF_DESCENT),
            outcomes.statistic(experiment.identifier, parameter_set, ENERGY),
        )
        for experiment in SLIP_EXPERIMENTS
        for parameter_set in PARAMETER_SETS
    )


def compare_claims(outcomes: Outcomes) -> tuple[ClaimComparison, ...]:
    """Look at every claim of the slip test with both parameter sets."""
    return tuple(
        ClaimComparison(claim, parameter_set, *_judged(claim.identifier, outcomes, parameter_set))
        for claim in SLIP_CLAIMS
        for parameter_set in PARAMETER_SETS
    )


@dataclass(frozen=True)
class HangingComparison:
    """The claims of the slip test on feet that hang."""

    slip: HangingSlip
    figures: Mapping[str, tuple[float, float] | None]
    """Peak before the heel lands, N, and work of the descent, J, by the title of the foot; None: it wedges."""
    claims: Mapping[str, tuple[bool, str]]
    """Whether each claim holds, and the evidence, by identifier; none where the rigid foot wedges."""

    @property
    def holds(self) -> bool:
        """Whether all claims do."""
        return bool(self.claims) and all(holds for holds, _ in self.claims.values())

    def as_json(self) -> dict[str, Any]:
        """Return it for machines."""
        return {
            "hang_pitch_deg": self.slip.pitch_deg,
            "friction": self.slip.friction,
            "feet": {
                title: None if found is None else {"peak_before_heel_n": found[0], "energy_j": found[1]}
                for title, found in self.figures.items()
            },
            "claims": {claim: holds for claim, (holds, _) in self.claims.items()},
            "all_claims_hold": self.holds,
        }


def compare_hanging(outcomes: Outcomes) -> tuple[HangingComparison, ...]:
    """Look at every claim of the slip test on feet that hang, with the fitted constants."""
    fitted, results = PARAMETER_SETS[0], (PEAK_OF_TEST[SLIP_TEST], ENERGY)
    compared = []
    for slip in HANGING:
        figures: dict[str, tuple[float, float] | None] = {}
        for experiment in slip.experiments:
            ran = experiment in slip.runs
            values = [outcomes.statistic(experiment.identifier, fitted, each).mean for each in results if ran]
            figures[experiment.title] = (values[0], values[1]) if ran else None
        claims = {
            each.identifier: _judged(each.identifier, outcomes, fitted, slip.experiments)
            for each in SLIP_CLAIMS
            if not slip.wedges
        }
        compared.append(HangingComparison(slip, figures, claims))
    return tuple(compared)


def _judged(
    claim: str, outcomes: Outcomes, parameter_set: str, feet: Sequence[Experiment] = SLIP_EXPERIMENTS
) -> tuple[bool, str]:
    """Judge a claim by the rigid, the unjammed and the jammed foot."""
    rigid, unjammed, jammed = (
        outcomes.statistic(experiment.identifier, parameter_set, PEAK_OF_TEST[SLIP_TEST]).mean for experiment in feet
    )
    if claim == "largest_peak_jammed":
        return jammed > max(rigid, unjammed), f"jammed {jammed:.1f} N, unjammed {unjammed:.1f} N, rigid {rigid:.1f} N"
    if claim == "peak_unjammed_like_rigid":
        evidence = (
            f"unjammed {unjammed:.1f} N, rigid {rigid:.1f} N: {unjammed / rigid:.2f} times; similar is "
            f"{1.0 - SIMILAR:g} to {1.0 + SIMILAR:g} times"
        )
        return are_similar(unjammed, rigid), evidence
    rigid_j, jammed_j = (
        outcomes.statistic(experiment.identifier, parameter_set, ENERGY).mean for experiment in (feet[0], feet[-1])
    )
    ratio = jammed_j / rigid_j
    evidence = (
        f"jammed {jammed_j:.2f} J, rigid {rigid_j:.2f} J: {ratio:.1f} times; significant is {SIGNIFICANT:g} times"
    )
    return ratio >= SIGNIFICANT, evidence
