"""How repeats of a run differ: numbers that spread evenly over their distribution, however few repeats there are."""

from __future__ import annotations

import statistics
import zlib

import numpy as np

_STEPS = (0.7548776662466927, 0.5698402909980532)
"""Steps of the two-dimensional golden-ratio sequence (Roberts' R2): 1/p and 1/p^2 with p^3 = p + 1."""
_EDGE = 1e-3
"""Numbers stay within 3.1 standard deviations."""


def scatter_numbers(name: str, seed: int, repeat: int) -> tuple[float, float]:
    """Return two standard normal numbers for one repeat.

    They walk along a sequence of low discrepancy from a start that the seed draws, so they are not independent: over
    seeds the mean of five scatters by 0.35 (first number) and 0.31 (second) of a standard deviation, where that of
    independent numbers would by 0.45. The spread within five is that of the distribution, so a standard error computed
    from them as if they were independent (0.46) does not tell how far their mean is off.

    Args:
        name: Rig; rigs scatter independently.
        seed: 0 or more.
        repeat: 0 or more.

    """
    start = np.random.default_rng([seed, zlib.crc32(name.encode())]).random(2).tolist()
    shares = [(first + repeat * step) % 1.0 for first, step in zip(start, _STEPS, strict=True)]
    normal = statistics.NormalDist()
    one, other = (normal.inv_cdf(min(max(share, _EDGE), 1.0 - _EDGE)) for share in shares)
    return one, other


def scatter_seed(seed: int, repeat: int) -> int:
    """Return the seed of the sensors' noise in one repeat."""
    return int(np.random.default_rng([seed, repeat]).integers(2**31))
