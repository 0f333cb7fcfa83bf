"""How well the parameters of a fit are known."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.november.fitting import PRIOR, Loss

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jammkle_gap.november.fitting import Fit
    from jammkle_gap.november.residual import Layout, Weighting

_Z95 = 1.96


def covariance(fit: Fit, loss: Loss, layout: Layout) -> NDArray[np.float64]:
    """Return the covariance of the parameters, in shares of their ranges, shape (p, p).

    The larger of two, per parameter: from the curvature, where only independent samples count; and from how the blocks
    disagree (sandwich), which also holds where the model is not quite true.
    """
    if not fit.space.keys:
        return np.zeros((0, 0))
    weights = loss.weights(fit.residual)
    size = fit.point.size
    normal = fit.jacobian.T @ (fit.jacobian * weights[:, None]) + PRIOR * np.eye(size)
    inverse = np.linalg.inv(normal)
    blocks = len(layout.blocks)
    slopes = np.array(
        [np.bincount(layout.block_of, fit.jacobian[:, k] * weights * fit.residual, blocks) for k in range(size)]
    )
    slopes -= slopes.mean(axis=1, keepdims=True)
    sandwich = inverse @ (slopes @ slopes.T) @ inverse * blocks / max(blocks - size, 1)
    grow = np.sqrt(np.maximum(np.diag(sandwich) / np.diag(inverse), 1.0))
    result: NDArray[np.float64] = inverse * np.outer(grow, grow)
    return result


def half_widths(fit: Fit, layout: Layout, weighting: Weighting, limit: float) -> NDArray[np.float64]:
    """Return half the width of each parameter's 95 % interval, in shares of the ranges, shape (p,).

    Beside the scatter, a parameter is not known better than by what moves the signals as far as a gap that counts as
    none: a simulator that is off by that much anyway shifts it.

    Args:
        fit: With a Jacobian.
        layout: Of the residual.
        weighting: Of the signals.
        limit: Largest gap that counts as none, noise units.

    """
    if not fit.space.keys:
        return np.zeros(0)
    # Of the parameters, unlike of the fit itself, no more is known than the simulator is trusted.
    doubted = Loss(weighting.scale_of(layout), weighting.factor[layout.signal_of])
    scatter = _Z95 * np.sqrt(np.diag(covariance(fit, doubted, layout)))
    counts = np.bincount(layout.signal_of, minlength=len(layout.names)) * len(layout.names)
    each = fit.jacobian / np.sqrt(counts[layout.signal_of])[:, None]
    curvature = np.linalg.inv(each.T @ each + 1e-9 * np.eye(fit.point.size))
    shift = np.sqrt(max(limit**2 - 1.0, 0.0) * np.diag(curvature))
    return np.minimum(np.hypot(scatter, shift), 1.0)
