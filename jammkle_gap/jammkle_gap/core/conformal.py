"""Conformal p-values: how often a true cause leaves as much, on machines whose cause was known.

Split conformal prediction (Vovk, Gammerman and Shafer 2005, Algorithmic Learning in a Random World, ch. 4): the
nonconformity of an effect is what it leaves of the difference beyond scatter, in the scale that the posterior expects
of a gap as large. Whether that scale is right does not matter here, only that machines are like those that were known.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.core.posterior import error_scale

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_gap.core.compare import Difference
    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.fit import Fit


def nonconformity(difference: Difference, fit: Fit, constants: Constants) -> float:
    """Return what an effect leaves beyond scatter, in the scale that the posterior expects; 0 if it explains all.

    Args:
        difference: That was explained.
        fit: Of the effect.
        constants: Of that scale.

    """
    length, features = float(difference.whitened @ difference.whitened), difference.whitened.size
    noise = difference.healthy * features
    return max(fit.left - noise, 0.0) / error_scale(length, noise, constants)


def p_values(
    difference: Difference, singles: Sequence[Fit], known: Sequence[float], constants: Constants
) -> Mapping[str, float]:
    """Return the p-value of each single effect as the cause; empty where nothing was calibrated.

    Args:
        difference: That was explained.
        singles: Fitted.
        known: Nonconformity of true causes, infinite where one was not even fitted.
        constants: Of the model.

    """
    if not known:
        return {}
    ordered = np.sort(np.asarray(known))
    found = {}
    for fit in singles:
        at_least = len(ordered) - int(np.searchsorted(ordered, nonconformity(difference, fit, constants), side="left"))
        found[fit.names[0]] = (at_least + 1) / (len(ordered) + 1)
    return dict(sorted(found.items(), key=lambda item: -item[1]))
