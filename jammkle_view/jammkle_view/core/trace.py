"""The last seconds of signals that are measured together, and what of them a plot needs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Window = tuple[NDArray[np.float64], NDArray[np.float64]]
    """Times, shape (n,), s, and values, shape (n, signals)."""


class Trace:
    """A ring of samples in rising time. What comes from before the latest one starts it anew."""

    def __init__(self, signals: int, capacity: int) -> None:
        """Make an empty ring.

        Args:
            signals: Values per sample.
            capacity: Samples that it keeps.

        """
        self._time_s = np.zeros(capacity)
        self._values = np.zeros((capacity, signals))
        self._next = 0
        self._count = 0

    def append(self, time_s: float, values: Sequence[float]) -> None:
        """Add a sample; one of the same time as the latest is left out."""
        if self._count:
            latest_s = self._time_s[self._next - 1]
            if time_s == latest_s:
                return
            if time_s < latest_s:
                self._next = self._count = 0
        self._time_s[self._next] = time_s
        self._values[self._next] = values
        self._next = (self._next + 1) % len(self._time_s)
        self._count = min(self._count + 1, len(self._time_s))

    def window(self, start_s: float, end_s: float) -> Window:
        """Return the samples from one time to another, both included."""
        order = np.arange(self._next - self._count, self._next)
        time_s, values = self._time_s[order], self._values[order]
        first, last = np.searchsorted(time_s, start_s), np.searchsorted(time_s, end_s, side="right")
        return time_s[first:last], values[first:last]


def thinned(time_s: NDArray[np.float64], values: NDArray[np.float64], bins: int) -> Window:
    """Return at most twice as many samples as there are bins; every peak stays.

    Args:
        time_s: Rising, shape (n,), s.
        values: Shape (n, signals).
        bins: Stretches of equally many samples, of each of which the smallest and the largest values are kept.

    """
    per_bin = len(time_s) // bins
    if per_bin <= 2:  # noqa: PLR2004 - nothing would be saved
        return time_s, values
    whole = len(time_s) // per_bin * per_bin
    parts = values[:whole].reshape(-1, per_bin, values.shape[1])
    extremes = np.stack((parts.min(axis=1), parts.max(axis=1)), axis=1).reshape(-1, values.shape[1])
    half = per_bin // 2
    ends_s = np.stack((time_s[:whole:per_bin], time_s[half:whole:per_bin]), axis=1).ravel()
    return np.concatenate((ends_s, time_s[whole:])), np.concatenate((extremes, values[whole:]))
