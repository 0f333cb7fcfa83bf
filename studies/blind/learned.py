"""A learned classifier as one more baseline: trained on simulated signatures of the very same settings.

Of every effect signatures at random parameters, of healthy machines none; each with scatter, which is white after
whitening. Features are means over blocks of time. Trained anew for each case, since every case has its own scatter.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from sklearn.ensemble import ExtraTreesClassifier  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.core.fit import grid_signatures
from jammkle_gap.core.signatures import grids_of
from studies.blind.answers import NO_GAP

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.conclude import Evidence
    from jammkle_gap.core.scatter import Setting

_BLOCKS = 8
"""Of time, per signal and setting. Chosen: as the diagnosis's own smooth scatter."""
_DRAWS = 40
"""Examples per effect."""
_TREES = 150
"""Extremely randomised ones (Geurts, Ernst and Wehenkel 2006, Mach. Learn. 63:3). Chosen: on development cases they are
right first as often as a random forest, which tries every split of a feature, in an eighth of its time."""
_SEED = 1


def learned(evidence: Evidence) -> dict[str, float]:
    """Return the probability of every effect and of no gap, largest first, by the evidence of the headline."""
    random = np.random.default_rng(_SEED)
    signatures = grid_signatures(evidence.grids, evidence.difference)
    grids = grids_of(evidence.problem)
    blocks = _blocks(evidence.settings)
    noise = np.sqrt(max(evidence.difference.healthy, 0.1))
    examples = [noise * random.standard_normal((_DRAWS, blocks.shape[1]))]
    labels = [NO_GAP] * _DRAWS
    for name, signature in signatures.items():
        drawn = random.integers(0, len(grids[name].mesh), _DRAWS)
        clean = grids[name].weights[drawn] @ (signature @ blocks)
        examples.append(clean + noise * random.standard_normal(clean.shape))
        labels += [name] * _DRAWS
    forest = ExtraTreesClassifier(_TREES, n_jobs=1, random_state=_SEED).fit(_features(np.vstack(examples)), labels)
    found = forest.predict_proba(_features((evidence.difference.whitened @ blocks)[np.newaxis]))[0]
    pairs = sorted(zip(forest.classes_.tolist(), found.tolist(), strict=True), key=lambda pair: -pair[1])
    return dict(pairs)


def _features(table: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return direction and length apart: an effect shows in the one, a gap by the other."""
    length = np.linalg.norm(table, axis=1, keepdims=True)
    return np.hstack([table / length, np.log(length)])


def _blocks(settings: Sequence[Setting]) -> NDArray[np.float64]:
    """Return the matrix of scaled sums over blocks, so that white features stay white, shape (features, blocks)."""
    parts = []
    for setting in settings:
        layout = setting.layout
        block = np.arange(layout.bins) * _BLOCKS // layout.bins
        member = np.eye(_BLOCKS)[block]
        member = member / np.sqrt(member.sum(axis=0))
        signals, events = len(layout.signals), len(layout.event_s)
        part = np.zeros((layout.size, signals * _BLOCKS + events))
        for i in range(signals):
            part[i * layout.bins : (i + 1) * layout.bins, i * _BLOCKS : (i + 1) * _BLOCKS] = member
        part[signals * layout.bins :, signals * _BLOCKS :] = np.eye(events)
        parts.append(part)
    rows, columns = (sum(part.shape[axis] for part in parts) for axis in (0, 1))
    whole, row, column = np.zeros((rows, columns)), 0, 0
    for part in parts:
        whole[row : row + part.shape[0], column : column + part.shape[1]] = part
        row, column = row + part.shape[0], column + part.shape[1]
    return whole
