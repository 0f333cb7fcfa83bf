"""What was heard lately, by signal, on one clock."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray


_HOLE = 4.5
"""Missing time, in typical intervals between samples, from which on samples were lost. Assumed: a clock's jitter makes
less."""


class Track:
    """Samples of one topic, by rising time; of two of the same time the later one counts.

    A sample that is older than the last, or not finite, is left out.
    """

    def __init__(self) -> None:
        """Begin with nothing."""
        self._samples: deque[tuple[float, Mapping[str, float]]] = deque()

    def add(self, time_s: float, values: Mapping[str, float]) -> None:
        """Take a sample."""
        if not np.isfinite([time_s, *values.values()]).all() or time_s < self.last_s:
            return
        if time_s == self.last_s:
            self._samples.pop()
        self._samples.append((time_s, values))

    @property
    def first_s(self) -> float:
        """Time of the oldest sample, s; infinite without any."""
        return self._samples[0][0] if self._samples else float("inf")

    @property
    def last_s(self) -> float:
        """Time of the newest sample, s; minus infinity without any."""
        return self._samples[-1][0] if self._samples else -float("inf")

    @property
    def columns(self) -> tuple[str, ...]:
        """Signals of the newest sample."""
        return tuple(self._samples[-1][1]) if self._samples else ()

    def forget_before(self, time_s: float) -> None:
        """Leave out what is older, but for one sample, from which on a value holds."""
        while len(self._samples) > 1 and self._samples[1][0] <= time_s:
            self._samples.popleft()

    def column(self, name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return times, s, and values of one signal, each of shape (n,)."""
        found = [(time_s, values[name]) for time_s, values in self._samples if name in values]
        table = np.array(found, dtype=np.float64).reshape(-1, 2)
        return table[:, 0], table[:, 1]

    def within(self, name: str, begin_s: float, end_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the samples of one signal after `begin_s` and up to `end_s`."""
        time_s, values = self.column(name)
        inside = (time_s > begin_s) & (time_s <= end_s)
        return time_s[inside], values[inside]

    def has_hole(self, begin_s: float, end_s: float) -> bool:
        """Tell whether samples are missing somewhere between the last one before `begin_s` and the first after `end_s`.

        A busy machine loses some, and what lies between two others far apart is anybody's guess.
        """
        times_s = np.array([time_s for time_s, _ in self._samples])
        touched = (times_s[1:] > begin_s) & (times_s[:-1] < end_s)
        return bool((np.diff(times_s)[touched] > _HOLE * self.interval_s).any())

    @property
    def interval_s(self) -> float:
        """Typical time between two samples, s; infinite with fewer than two."""
        times_s = [time_s for time_s, _ in self._samples]
        return float(np.median(np.diff(times_s))) if len(times_s) > 1 else float("inf")

    def at(self, name: str, time_s: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
        """Return one signal at given times, straight between samples; there must be one."""
        known_s, values = self.column(name)
        found: NDArray[np.float64] = np.interp(time_s, known_s, values)
        return found


class Tracks:
    """Samples of every topic, by its relative name."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self._tracks: dict[str, Track] = {}

    def of(self, topic: str) -> Track:
        """Return the samples of a topic; there may be none."""
        return self._tracks.setdefault(topic, Track())

    def forget_before(self, time_s: float) -> None:
        """Leave out what is older; see `Track.forget_before`."""
        for track in self._tracks.values():
            track.forget_before(time_s)
