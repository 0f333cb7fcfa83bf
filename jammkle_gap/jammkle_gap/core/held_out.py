"""How far the gap closes in a setting with parameters fitted to the others."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.core.locate import closing_of
from jammkle_gap.core.result import HeldOutSetting

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jammkle_gap.core.compare import Difference
    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.evidence import Evidence
    from jammkle_gap.core.fit import Fit


def _parts(evidence: Evidence, whole: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Cut what holds all settings into one part per setting."""
    return np.split(whole, np.cumsum(evidence.difference.sizes)[:-1])


def held_out(evidence: Evidence, best: Fit | None, constants: Constants) -> tuple[HeldOutSetting, ...]:
    """Return how far the gap closes in each setting with parameters fitted to the others, by one Gauss-Newton step."""
    if best is None or len(evidence.settings) < 2:  # noqa: PLR2004 - one alone cannot be held out
        return ()
    left = best.whitened - best.signature
    parts, slopes = _parts(evidence, left), _parts(evidence, best.jacobian)
    wholes = _parts(evidence, best.whitened)
    found = []
    for k, setting in enumerate(evidence.settings):
        others = [i for i in range(len(parts)) if i != k]
        jacobian = np.concatenate([slopes[i] for i in others])
        rest = np.concatenate([parts[i] for i in others])
        scale = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-12)
        step = np.linalg.lstsq(jacobian / scale, rest, rcond=1e-6)[0] / scale
        single = _alone(evidence, k, wholes[k])
        closing = closing_of(single, parts[k] - slopes[k] @ step, [setting], constants.blocks)
        found.append(HeldOutSetting(setting.name, closing))
    return tuple(found)


def _alone(evidence: Evidence, k: int, whitened: NDArray[np.float64]) -> Difference:
    """Return the difference of one setting."""
    whole = evidence.difference
    return replace(
        whole,
        whitened=whitened,
        factors=(whole.factors[k],),
        sizes=(whole.sizes[k],),
        deviations=(whole.deviations[k],),
        freedom=(whole.freedom[k],),
        scatter=(whole.scatter[k],),
        columns=(whole.columns[k],),
        shared=(whole.shared[k],),
    )
