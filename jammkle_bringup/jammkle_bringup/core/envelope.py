"""A signal for a picture in constant memory: of each stretch of time the extremes, so that no peak is lost.

There are never more stretches than a fixed number: where a signal goes on, two neighbours become one.
"""

from __future__ import annotations

from typing import Generic, TypeVar

STRETCHES = 2000
"""Most stretches of one signal: more than a screen has columns. A picture shows every extreme of it."""

T = TypeVar("T")


class _Stretches(Generic[T]):
    """What is kept of each stretch of time, by its number; `merged` makes one of two neighbours."""

    def __init__(self) -> None:
        self.kept: dict[int, T] = {}
        self._width_s = 1e-3
        self._first_s = 0.0

    def number(self, time_s: float) -> int:
        """Return the stretch of a time, after making room for it."""
        if not self.kept:
            self._first_s = time_s
        number = int((time_s - self._first_s) // self._width_s)
        while len(self.kept) >= STRETCHES and number not in self.kept:
            old, self.kept, self._width_s = self.kept, {}, 2.0 * self._width_s
            for each, value in old.items():
                half = each // 2
                self.kept[half] = self.merged(self.kept[half], value) if half in self.kept else value
            number //= 2
        return number

    def merged(self, first: T, second: T) -> T:
        """Return what is kept of two stretches together."""
        raise NotImplementedError


Point = tuple[float, ...]


class Envelope(_Stretches[list[Point]]):
    """Points of which the extremes of every coordinate but the first, the time, are kept, and the first and last."""

    def __init__(self, coordinates: int = 1) -> None:
        """Begin; `coordinates` is how many values a point has beside its time."""
        super().__init__()
        self._coordinates = coordinates
        self._new: list[Point] = []

    def add(self, time_s: float, *values: float) -> None:
        """Take a point. Times come nearly in order."""
        number = self.number(time_s)
        point = (time_s, *values)
        held = self.kept.get(number)
        if held is None:
            self.kept[number] = [point] * (2 + 2 * self._coordinates)
            return
        held[1] = point
        for axis in range(1, self._coordinates + 1):
            low = 2 * axis
            if point[axis] < held[low][axis]:
                held[low] = point
            elif point[axis] > held[low + 1][axis]:
                held[low + 1] = point

    def merged(self, first: list[Point], second: list[Point]) -> list[Point]:
        """Return first, last, and the extremes of two stretches."""
        found = [min(first[0], second[0]), max(first[1], second[1])]
        for axis in range(1, self._coordinates + 1):
            low = 2 * axis
            found.append(min(first[low], second[low], key=lambda point, axis=axis: point[axis]))  # type: ignore[misc]
            found.append(max(first[low + 1], second[low + 1], key=lambda point, axis=axis: point[axis]))  # type: ignore[misc]
        return found

    def points(self) -> list[Point]:
        """Return what is kept, in order of time."""
        return sorted({point for held in self.kept.values() for point in held})

    def __bool__(self) -> bool:
        """Return whether there is a point."""
        return bool(self.kept)
