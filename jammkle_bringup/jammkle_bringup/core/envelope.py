"""A signal for a picture in constant memory: of each stretch of time the extremes, so that no peak is lost.

There are never more stretches than a fixed number: where a signal goes on, two neighbours become one.
"""

from __future__ import annotations

STRETCHES = 2000
"""Most stretches of one signal: more than a screen has columns. A picture shows every extreme of it."""

Point = tuple[float, ...]


class Envelope:
    """Points of which the extremes of every coordinate but the first, the time, are kept, and the first and last."""

    def __init__(self, coordinates: int = 1) -> None:
        """Begin; `coordinates` is how many values a point has beside its time."""
        self._coordinates = coordinates
        self._kept: dict[int, list[Point]] = {}
        self._width_s = 1e-3
        self._first_s = 0.0

    def add(self, time_s: float, *values: float) -> None:
        """Take a point. Times come nearly in order."""
        number = self._number(time_s)
        point = (time_s, *values)
        held = self._kept.get(number)
        if held is None:
            self._kept[number] = [point] * (2 + 2 * self._coordinates)
            return
        held[1] = point
        for axis in range(1, self._coordinates + 1):
            low = 2 * axis
            if point[axis] < held[low][axis]:
                held[low] = point
            elif point[axis] > held[low + 1][axis]:
                held[low + 1] = point

    def points(self) -> list[Point]:
        """Return what is kept, in order of time."""
        return sorted({point for held in self._kept.values() for point in held})

    def __bool__(self) -> bool:
        """Return whether there is a point."""
        return bool(self._kept)

    def _number(self, time_s: float) -> int:
        """Return the stretch of a time, after making room for it."""
        if not self._kept:
            self._first_s = time_s
        number = int((time_s - self._first_s) // self._width_s)
        while len(self._kept) >= STRETCHES and number not in self._kept:
            old, self._kept, self._width_s = self._kept, {}, 2.0 * self._width_s
            for each, value in old.items():
                half = each // 2
                self._kept[half] = self._merged(self._kept[half], value) if half in self._kept else value
            number //= 2
        return number

    def _merged(self, first: list[Point], second: list[Point]) -> list[Point]:
        """Return first, last, and the extremes of two stretches."""
        found = [min(first[0], second[0]), max(first[1], second[1])]
        for axis in range(1, self._coordinates + 1):
            low = 2 * axis
            found.append(min(first[low], second[low], key=lambda point, axis=axis: point[axis]))  # type: ignore[misc]
            found.append(max(first[low + 1], second[low + 1], key=lambda point, axis=axis: point[axis]))  # type: ignore[misc]
        return found
