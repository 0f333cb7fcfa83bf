"""The course of a driven carriage from its readings: straight lines, as many as the readings show and no more.

A drive moves at steady speeds and turns at corners. Readings taken as they are would shake the simulated tendon by the
noise of the scale, a filter would round the turns. Straight lines do neither: each stretch is cut where it bends most
until what is left of it is noise, then neighbours meet where their lines cross. Where a course bends all the time the
lines come out short and would cut its bends; there the mean of the readings around is put on top.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_sim.rigs.replay import Course

if TYPE_CHECKING:
    from numpy.typing import NDArray

_LEAST_NOISE_M = 1e-7
"""Noise that is always allowed for. Assumed: no scale of a test machine resolves less."""
_NOISE_OF_MEDIAN = 1.4826
"""Standard deviation over median absolute deviation of normal numbers."""
_IS_NOISE = 2.5
"""Largest sum of what is left in a row, in standard deviations of the sum of all, that noise makes: 1.95 in one of a
thousand stretches of white noise (Kolmogorov); the rest is for noise with some memory."""
_FEWEST = 4
"""Readings of the shortest line."""
_STRAIGHT_S = 0.3
"""Shortest stretch that counts as straight, s. Assumed: a crosshead holds its speed for longer."""
_AVERAGED_S = 0.02
"""Time that readings are averaged over where a course bends, s. Chosen: the bin of the features; a bend of 0.4 m/s^2,
as 10 mm at 1 Hz has, moves the mean by 7 um."""
_SMOOTHED = 5
"""Readings that a bend is looked for by the mean of, so that noise alone does not say where."""


def course_of(time_s: NDArray[np.float64], position_m: NDArray[np.float64]) -> Course:
    """Return the course that readings show.

    Args:
        time_s: Rising, shape (n,), s.
        position_m: Shape (n,), m.

    """
    if len(time_s) < 2 * _FEWEST:
        return Course(time_s, position_m)
    noise_m = reading_noise_m(position_m)
    cuts = _cuts(time_s, position_m, noise_m)
    lines = [_line(time_s[first:last], position_m[first:last]) for first, last in itertools.pairwise(cuts)]
    corners_s, corners_m = [float(time_s[0])], [_on(lines[0], float(time_s[0]))]
    for place, cut in enumerate(cuts[1:-1]):
        one, two = lines[place], lines[place + 1]
        here_s = 0.5 * float(time_s[cut - 1] + time_s[cut])
        reach_s = 0.5 * float(min(time_s[cut] - time_s[cuts[place]], time_s[cuts[place + 2] - 1] - time_s[cut]))
        corner_s = _crossing_s(one, two, here_s, reach_s)
        if corner_s > corners_s[-1]:
            corners_s.append(corner_s)
            corners_m.append(0.5 * (_on(one, corner_s) + _on(two, corner_s)))
    corners_s.append(float(time_s[-1]))
    corners_m.append(_on(lines[-1], float(time_s[-1])))
    return _with_bends(Course(np.array(corners_s), np.array(corners_m)), cuts, time_s, position_m)


def reading_noise_m(position_m: NDArray[np.float64]) -> float:
    """Return the standard deviation from reading to reading, m: by second differences, and by the scale's own steps."""
    bends_m = np.diff(position_m, 2)
    scatter_m = _NOISE_OF_MEDIAN * float(np.median(np.abs(bends_m - np.median(bends_m)))) / np.sqrt(6.0)
    levels_m = np.diff(np.unique(position_m))
    # Rounding to steps of q leaves q / sqrt(12).
    step_m = float(levels_m.min()) if len(levels_m) else 0.0
    return float(max(scatter_m, step_m / np.sqrt(12.0), _LEAST_NOISE_M))


def _cuts(time_s: NDArray[np.float64], position_m: NDArray[np.float64], noise_m: float) -> list[int]:
    """Return where lines begin and end, rising, the number of readings last."""
    found, open_ = [0], [(0, len(time_s))]
    while open_:
        first, last = open_.pop()
        times, values = time_s[first:last], position_m[first:last]
        count = last - first
        if count < 2 * _FEWEST or _is_line(times, values, noise_m):
            found.append(last)
            continue
        cut = first + min(max(_bend(times, values), _FEWEST), count - _FEWEST)
        # The earlier part is looked at first, so that what is found is in order.
        open_ += [(cut, last), (first, cut)]
    return found


def _is_line(time_s: NDArray[np.float64], position_m: NDArray[np.float64], noise_m: float) -> bool:
    left_m = position_m - _on(_line(time_s, position_m), time_s)
    return float(np.abs(np.cumsum(left_m)).max()) <= _IS_NOISE * noise_m * float(np.sqrt(len(left_m)))


def _bend(time_s: NDArray[np.float64], position_m: NDArray[np.float64]) -> int:
    """Return which reading lies furthest from the chord between the ends."""
    padded_m = np.pad(position_m, _SMOOTHED // 2, mode="edge")
    smooth_m = np.convolve(padded_m, np.full(_SMOOTHED, 1.0 / _SMOOTHED), "valid")
    smooth_m[:2], smooth_m[-2:] = smooth_m[2], smooth_m[-3]
    chord_m = np.interp(time_s, time_s[[0, -1]], smooth_m[[0, -1]])
    return int(np.argmax(np.abs(smooth_m - chord_m)))


def _with_bends(
    course: Course, cuts: list[int], time_s: NDArray[np.float64], position_m: NDArray[np.float64]
) -> Course:
    """Return the course with what its lines leave, averaged, put on top where they are short."""
    lengths = np.diff(cuts)
    starts_s, ends_s = time_s[cuts[:-1]], time_s[np.array(cuts[1:]) - 1]
    curved = np.repeat(ends_s - starts_s < _STRAIGHT_S, lengths)
    between_s = float(np.median(np.diff(time_s)))
    around = 2 * round(0.5 * _AVERAGED_S / between_s) + 1
    left_m = np.convolve(np.pad(position_m - course.at(time_s), around // 2, mode="edge"), np.ones(around), "valid")
    every = max(round(0.5 * _AVERAGED_S / between_s), 1)
    corners_s = np.concatenate((course.time_s, time_s[np.flatnonzero(curved)[::every]]))
    on_top_m = np.interp(corners_s, time_s, np.where(curved, left_m / around, 0.0))
    corners_s, place = np.unique(corners_s, return_index=True)
    return Course(corners_s, course.at(corners_s) + on_top_m[place])


Line = tuple[float, float, float]
"""Time about which it is given, s, place there, m, and speed, m/s."""


def _line(time_s: NDArray[np.float64], position_m: NDArray[np.float64]) -> Line:
    """Return the straight line with the least squares."""
    about_s = float(time_s.mean())
    since_s = time_s - about_s
    return about_s, float(position_m.mean()), float(since_s @ position_m) / max(float(since_s @ since_s), 1e-30)


def _on(line: Line, time_s: Any) -> Any:
    about_s, place_m, speed_m_s = line
    return place_m + speed_m_s * (time_s - about_s)


def _crossing_s(one: Line, two: Line, here_s: float, reach_s: float) -> float:
    """Return when two lines cross, s, or `here_s` where that is further than `reach_s` from it."""
    turn_m_s = two[2] - one[2]
    if turn_m_s == 0.0:
        return here_s
    cross_s = here_s + (_on(one, here_s) - _on(two, here_s)) / turn_m_s
    return float(cross_s) if abs(cross_s - here_s) <= reach_s else here_s
