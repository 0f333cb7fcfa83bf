"""What the reader should know of the references: how many there are, and whether they are of one healthy machine."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jammkle_gap.core.compare import Setting
    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.evidence import Evidence

_ENOUGH = 5
"""References that are asked for: their mean is then known to half of one run's scatter."""
_FEWEST_SPLIT = 4
"""References below which no two groups can be seen."""
_DRAWS = 4000


def reference_notes(evidence: Evidence, constants: Constants) -> tuple[str, ...]:
    """Return what few, divided or foreign references cost, one sentence each."""
    notes = [note for setting in evidence.settings if (note := _count_note(setting))]
    notes += _divided(evidence, constants)
    foreign = _foreign(evidence, constants)
    return (*notes, *([foreign] if foreign else []))


def _count_note(setting: Setting) -> str:
    """Return what is lost with fewer than two references; empty with two or more."""
    count = len(setting.references)
    if count == 0:
        return (
            f"setting '{setting.name}' has no reference: an error of the simulator cannot be distinguished from a "
            f"fault, except by the priors of the machine's constants; record {_ENOUGH} runs of the healthy machine"
        )
    if count > 1:
        return ""
    repeats = len(setting.faulty)
    source = f"the {repeats} repeats in question" if repeats > 1 else "priors and declared noise"
    return (
        f"setting '{setting.name}' has one reference: its scatter is known from {source} alone, and the reference's "
        f"own is added in full to the difference; record {_ENOUGH}"
    )


def _divided(evidence: Evidence, constants: Constants) -> list[str]:
    """Return a note for each setting whose references fall into two groups.

    Scores along the first principal component are cut where the variance within the two parts is least; the ratio of
    the variance between to that within is compared with that of normal scores (Engelman and Hartigan 1969, J. Am. Stat.
    Assoc. 64:1647).
    """
    found = []
    tested = [each for each in evidence.settings if len(each.references) >= _FEWEST_SPLIT]
    for setting, each in zip(evidence.settings, evidence.residuals, strict=True):
        count = len(setting.references)
        if count < _FEWEST_SPLIT:
            continue
        # In the sensors' noise: scatter was fitted to these runs, and has taken their difference for its own.
        own = (each.references - each.references.mean(axis=0)) / setting.layout.floor
        scores = np.linalg.svd(own, full_matrices=False)[0][:, 0]
        ratio, cut = _cut(scores)
        order = np.argsort(scores).tolist()
        drawn = np.random.default_rng(0).standard_normal((_DRAWS, count))
        chance = float((_cut(drawn)[0] >= ratio).mean()) * len(tested)
        if chance < constants.divided_rate:
            names = ", ".join(sorted(setting.references[i].name for i in order[: int(cut)]))
            rest = ", ".join(sorted(setting.references[i].name for i in order[int(cut) :]))
            found.append(
                f"the references of setting '{setting.name}' fall into two groups, {names} and {rest}: one of them may "
                "be of another machine, or of a faulty one; their difference counts as scatter"
            )
    return found


def _cut(scores: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return the largest ratio of the variance between two parts to that within, and the size of the first part.

    Args:
        scores: Shape (..., runs); each part has two or more.

    """
    ordered = np.sort(scores - scores.mean(axis=-1, keepdims=True), axis=-1)
    count = ordered.shape[-1]
    first = np.arange(1, count)
    sums = np.cumsum(ordered, axis=-1)[..., :-1]
    between = np.square(sums) * (1.0 / first + 1.0 / (count - first))
    within = np.square(ordered).sum(axis=-1, keepdims=True) - between
    ratio = (between / np.maximum(within, 1e-30))[..., 1:-1]
    return ratio.max(axis=-1), ratio.argmax(axis=-1) + 2


def _foreign(evidence: Evidence, constants: Constants) -> str:
    """Return a note where the simulator agrees with the recordings in question far better than with the references."""
    left = {"faulty": 0.0, "references": 0.0}
    size = 0
    for setting, each, scatter in zip(evidence.settings, evidence.nominal, evidence.difference.scatter, strict=True):
        if not setting.references:
            continue
        variance = scatter.variance + np.square(scatter.columns).sum(axis=1)
        left["faulty"] += float((np.square(each.faulty.mean(axis=0)) / variance).sum())
        left["references"] += float((np.square(each.references.mean(axis=0)) / variance).sum())
        size += len(variance)
    if not size or left["references"] < constants.foreign_ratio * max(left["faulty"], float(size)):
        return ""
    both = [np.sqrt(left[name] / size) for name in ("references", "faulty")]
    return (
        f"the simulator agrees with the recordings in question ({both[1]:.1f} times scatter) far better than with the "
        f"references ({both[0]:.1f} times): these may be of another machine, or of a faulty one"
    )
