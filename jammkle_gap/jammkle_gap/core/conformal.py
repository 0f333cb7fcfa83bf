"""Conformal p-values: how often a true cause leaves as much, on machines that were simulated beforehand.

Split conformal prediction (Vovk, Gammerman and Shafer 2005, Algorithmic Learning in a Random World, ch. 4): the
nonconformity of an effect is what it leaves of the difference per feature, in what healthy runs leave. Beside the
posterior this needs no model of the simulator's own error, only machines like those that it was calibrated on.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_gap.core.compare import Difference
    from jammkle_gap.core.fit import Fit


def nonconformity(difference: Difference, fit: Fit) -> float:
    """Return what an effect leaves per feature, in what healthy runs leave: 1 if it explains everything."""
    return fit.left / difference.whitened.size / difference.healthy


def p_values(difference: Difference, singles: Sequence[Fit], known: Sequence[float]) -> Mapping[str, float]:
    """Return the p-value of each single effect as the cause; empty where nothing was calibrated.

    Args:
        difference: That was explained.
        singles: Fitted.
        known: Nonconformity of true causes on simulated machines.

    """
    if not known:
        return {}
    ordered = np.sort(np.asarray(known))
    found = {}
    for fit in singles:
        at_least = len(ordered) - int(np.searchsorted(ordered, nonconformity(difference, fit), side="left"))
        found[fit.names[0]] = (at_least + 1) / (len(ordered) + 1)
    return dict(sorted(found.items(), key=lambda item: -item[1]))
