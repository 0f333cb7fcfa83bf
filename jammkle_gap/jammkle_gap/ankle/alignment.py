"""The events at which runs of an ankle are aligned: release, touch-down, onset of a slide, by the signals of the run.

Pure functions of times and values, the same for what was measured and what was simulated, so that both can be laid over
each other at the event. Shifting the times shifts what they return; where nothing happens they return None. No sensor
needs to be calibrated: levels are those of the run itself, at rest and in free fall, so that offsets, a turned sensor
and a small range do no harm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import savgol_filter  # type: ignore[import-untyped]  # carries no types

from jammkle_common import names
from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_gap.ankle.bag import CARRIAGE
from jammkle_gap.ankle.inputs import FALLING_RIGS
from jammkle_gap.ankle.sensors import ACCELERATION, PRESSURE, RATE, quantity_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.data import Recording

    Floats = NDArray[np.float64]
    Flags = NDArray[np.bool_]
    Values = Mapping[str, NDArray[np.float64]]

_LIGHT_M_S2 = 0.5 * STANDARD_GRAVITY_M_S2
"""How much lighter than at rest a body is that counts as falling: half way to free fall. An offset of 3 m/s^2 with a
range of 1 g leaves 6.8 of the 9.8 m/s^2 between the two."""
_STEADY_M_S2 = 0.25 * STANDARD_GRAVITY_M_S2
"""How far from rest a held body may read. Assumed: above a hand's tremor, below what a flight after a bounce begins
with."""
_STEADY_S = 0.15
"""How long before its release a body was held still. Assumed: a bounce is over sooner, a hand waits longer."""
_STEADY_M = 0.003
"""How far a held slide may move in that time. Assumed: a hand that holds a latch."""
_MOSTLY = 0.9
"""Share of the readings that this has to hold for."""
_SHORTEST_FALL_S = 0.03
"""Shortest fall that counts: 4.4 mm. Assumed: less is a knock."""
FAST_S = 0.003
"""Time that specific forces are averaged over. Chosen: half the rise of an impact behind a filter of 225 Hz."""
_SHORTEST_FLIGHT_S = 0.02
"""Shortest flight after a bounce that counts: half a millimetre. Assumed: less is chatter of the contact."""
_BEND_S = 0.03
"""Time that a slide's acceleration is taken over: 2e-5 m of noise at 500 Hz leave 0.15 m/s^2 of it."""
_APART_M = 0.001
"""How far a slide is off its free fall when it has certainly touched down. Chosen: fifty times the noise of a slide,
and 5 ms after a touch that stops with 80 m/s^2."""
_EARLY, _LATE = 0.001, 0.6
"""Where a slide's free fall is fitted: from this way on, m, to this share of the whole."""
_FEWEST = 3
"""Readings that a line is fitted to."""
SLOW_S = 0.02
"""Time that slow signals are averaged over before their onset is looked for. Chosen: ten readings at 500 Hz."""
_CLEAR = 6.0
"""Standard deviations from which on a change is not noise: once in 1e9 readings of normal noise."""
_SMALL = 0.02
"""Share of its largest change at which a signal has certainly begun to change. Chosen: 1 N of a slip test's 50."""
_SUDDEN_SHARE = 0.5
"""Share of the largest sudden change that the first one has at least. Assumed: jolts before it are stick-slip."""
_JOLT = 0.1
"""Share of a signal's range that a sudden change is at least. Assumed."""
_ON_THE_GRID = 1e-6
"""Rounding of a number of readings."""
_NOISE_OF_MEDIAN = 1.4826
"""Standard deviation over median absolute deviation of normal numbers."""


@dataclass(frozen=True)
class Fall:
    """From release to touch-down."""

    release_s: float | None
    """None: it was falling when the readings began."""
    touch_down_s: float | None
    """None: it was still falling when they ended."""

    @property
    def lasts_s(self) -> float | None:
        """How long it lasted, s; None where an end was not seen."""
        return None if self.release_s is None or self.touch_down_s is None else self.touch_down_s - self.release_s


def touch_downs_s(time_s: Floats, specific_force_m_s2: Floats) -> tuple[float, ...]:
    """Return when a body that was let go touched down, and again after each flight of a bounce, s; see `falls_of_imu`.

    In flight it is as light as in its fall, and an impact ends it: levels and sharpness are those of the first.
    """
    falls = falls_of_imu(time_s, specific_force_m_s2)
    if not falls or falls[0].touch_down_s is None:
        return ()
    weight = float(np.linalg.norm(np.median(specific_force_m_s2, axis=0)))
    upward = specific_force_m_s2 @ np.median(specific_force_m_s2, axis=0) / weight
    smooth = _averaged(time_s, upward[:, None], FAST_S)[:, 0]
    light = weight - smooth > _LIGHT_M_S2
    light[time_s <= falls[0].touch_down_s + FAST_S] = False
    found = [falls[0].touch_down_s]
    for _, last in _stretches(time_s, light, _SHORTEST_FLIGHT_S):
        if last < len(time_s):
            again_s = _first_crossing_s(time_s, upward - weight + _LIGHT_M_S2, max(last - 1, 0))
            found += [] if again_s is None else [again_s]
    return tuple(found)


def falls_of_imu(time_s: Floats, specific_force_m_s2: Floats) -> tuple[Fall, ...]:
    """Return every fall from rest that an accelerometer shows; flights after a bounce are none.

    In free fall it reads its offset alone, at rest that and gravity: the difference of the two says where up is in its
    frame, and half of it is the level at which release and touch-down are taken.

    Args:
        time_s: Rising, shape (n,), s.
        specific_force_m_s2: In the frame of the sensor, which is at rest most of the time, shape (n, 3), m/s^2.

    """
    rest = np.median(specific_force_m_s2, axis=0)
    weight = float(np.linalg.norm(rest))
    if len(time_s) < _FEWEST or weight < _STEADY_M_S2:
        return ()
    smooth = _averaged(time_s, specific_force_m_s2, FAST_S)
    lighter = (rest - smooth) @ (rest / weight)
    found = []
    for first, last in _stretches(time_s, lighter > _LIGHT_M_S2):
        if not _was_held(time_s, np.abs(lighter) < _STEADY_M_S2, first):
            continue
        quarter = max((last - first) // 4, 0)
        falling = np.median(smooth[first + quarter : max(last - quarter, first + quarter + 1)], axis=0)
        up = rest - falling
        level = (smooth - falling) @ up / float(up @ up) - 0.5
        middle = (first + last) // 2
        touched = np.flatnonzero(level[middle:] >= 0.0)
        # An impact is much more than a weight: averaging brings it forward, so the readings themselves say when.
        sharp = (specific_force_m_s2 - falling) @ up / float(up @ up) - 0.5
        start = middle + max(int(touched[0]) - 1, 0) if len(touched) else len(level)
        found.append(Fall(_last_crossing_s(time_s, -level, middle), _first_crossing_s(time_s, sharp, start)))
    return tuple(found)


def falls_of_slide(time_s: Floats, height_m: Floats) -> tuple[Fall, ...]:
    """Return every fall from rest that a slide shows; flights after a bounce are none.

    The release is where the parabola of its fall begins, the touch-down where it leaves that: two ways off it, one four
    times the other, are twice as long after the touch, as it stops with a steady force.

    Args:
        time_s: Rising, shape (n,), s.
        height_m: Up positive, shape (n,), m.

    """
    if len(time_s) < 2 * _FEWEST:
        return ()
    between_s = float(np.median(np.diff(time_s)))
    window = min(2 * max(int(0.5 * _BEND_S / between_s + _ON_THE_GRID), 2) + 1, 2 * ((len(time_s) - 1) // 2) + 1)
    bend_m_s2 = savgol_filter(height_m, window, 2, deriv=2, delta=between_s)
    found = []
    for first, last in _stretches(time_s, bend_m_s2 < -_LIGHT_M_S2):
        if not _was_held(time_s, np.abs(height_m - height_m[max(first - window // 2, 0)]) < _STEADY_M, first):
            continue
        before = (time_s >= time_s[first] - _STEADY_S) & (time_s < time_s[first] - 0.5 * _BEND_S)
        from_m = float(np.median(height_m[before])) if before.any() else float(height_m[0])
        fall = _parabola(time_s[first:last], from_m - height_m[first:last])
        if fall is None:
            continue
        begun_s, rate = fall
        off_m = height_m - from_m + (rate * np.maximum(time_s - begun_s, 0.0)) ** 2
        middle = (first + last) // 2
        near_s = _first_crossing_s(time_s, off_m - 0.25 * _APART_M, middle)
        far_s = _first_crossing_s(time_s, off_m - _APART_M, middle)
        touched_s = None if near_s is None or far_s is None else 2.0 * near_s - far_s
        found.append(Fall(begun_s if before.any() else None, touched_s))
    return tuple(found)


def onset_s(time_s: Floats, values: Floats, over_s: float = SLOW_S) -> float | None:
    """Return when a signal that stood still begins to change for good, s; None if it never does.

    It is taken where the line through two small changes, one twice the other, comes from.

    Args:
        time_s: Rising, shape (n,), s.
        values: One column per axis, shape (n, axes); still at first.
        over_s: Time that they are averaged over before, s; what happens within it is not sharp.

    """
    if len(time_s) < 2 * _FEWEST:
        return None
    smooth = _averaged(time_s, values, over_s)
    noise = _noise(time_s, values, over_s)
    still = time_s < time_s[0] + 5.0 * SLOW_S
    change = np.linalg.norm(smooth - np.median(smooth[still], axis=0), axis=1)
    small = max(_CLEAR * noise, _SMALL * float(change.max()))
    clear = np.flatnonzero(change > 4.0 * small)
    if not len(clear):
        return None
    near_s = _last_crossing_s(time_s, change - small, int(clear[0]))
    far_s = _last_crossing_s(time_s, change - 2.0 * small, int(clear[0]))
    return None if near_s is None or far_s is None else max(2.0 * near_s - far_s, float(time_s[0]))


def jolt_s(time_s: Floats, values: Floats) -> float | None:
    """Return when a signal first changes suddenly and much, s, as a heel lands or a foot begins to slide; or None.

    Args:
        time_s: Rising, shape (n,), s.
        values: One column per axis, shape (n, axes).

    """
    between_s = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 1.0
    half = max(int(0.5 * SLOW_S / between_s + _ON_THE_GRID), 1)
    if len(time_s) < 4 * half + 1:
        return None
    before, after = values[: -2 * half], values[2 * half :]
    sudden = np.linalg.norm(after - before, axis=1)
    range_ = float(np.linalg.norm(np.ptp(values, axis=0)))
    largest = float(sudden.max())
    if largest <= max(_JOLT * range_, _CLEAR * _noise(time_s, values, SLOW_S) * np.sqrt(2.0 * half)):
        return None
    first = int(np.argmax(sudden >= _SUDDEN_SHARE * largest))
    end = first + int(np.argmax(sudden[first : first + 2 * half]))
    return float(time_s[end + half])


def _averaged(time_s: Floats, values: Floats, over_s: float) -> Floats:
    """Return values averaged along time over about `over_s` around each, an odd number of readings."""
    between_s = float(np.median(np.diff(time_s)))
    around = min(2 * int(0.5 * over_s / between_s + _ON_THE_GRID) + 1, 2 * ((len(time_s) - 1) // 2) + 1)
    if around <= 1:
        return values
    padded = np.pad(values, ((around // 2, around // 2), (0, 0)), mode="edge")
    sums = np.cumsum(np.concatenate((np.zeros((1, values.shape[1])), padded)), axis=0)
    averaged: Floats = (sums[around:] - sums[:-around]) / around
    return averaged


def _noise(time_s: Floats, values: Floats, over_s: float) -> float:
    """Return the standard deviation, over all axes, of what is left of noise after averaging over a time, s."""
    bends = np.diff(values, 2, axis=0)
    scatter = _NOISE_OF_MEDIAN * np.median(np.abs(bends), axis=0) / np.sqrt(6.0)
    count = max(over_s / float(np.median(np.diff(time_s))), 1.0)
    return float(np.linalg.norm(scatter) / np.sqrt(count))


def _stretches(time_s: Floats, falling: Flags, shortest_s: float = _SHORTEST_FALL_S) -> Iterator[tuple[int, int]]:
    """Give first reading and the one after the last of every stretch that is long enough for a fall."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], falling.astype(np.int8), [0]))))
    for first, last in edges.reshape(-1, 2).tolist():
        if time_s[last - 1] - time_s[first] >= shortest_s:
            yield first, last


def _was_held(time_s: Floats, steady: Flags, first: int) -> bool:
    """Tell whether a body was still before a reading; it was if nothing is known of that."""
    before = (time_s >= time_s[first] - _STEADY_S) & (time_s < time_s[first] - FAST_S)
    return not before.any() or float(steady[before].mean()) >= _MOSTLY


def _parabola(time_s: Floats, fallen_m: Floats) -> tuple[float, float] | None:
    """Return when a free fall began, s, and the root of half its acceleration: its way's root grows steadily."""
    used = (fallen_m > _EARLY) & (fallen_m < max(_LATE * float(fallen_m.max()), 2.0 * _EARLY))
    if used.sum() < _FEWEST:
        return None
    rate, offset = np.polyfit(time_s[used] - time_s[0], np.sqrt(fallen_m[used]), 1)
    return (float(time_s[0] - offset / rate), float(rate)) if rate > 0.0 else None


def _first_crossing_s(time_s: Floats, level: Floats, start: int) -> float | None:
    """Return when a level first comes to 0 or above from a reading on, between two readings by a line."""
    above = np.flatnonzero(level[start:] >= 0.0)
    if not len(above):
        return None
    at = start + int(above[0])
    return _zero_s(time_s, level, at) if at > 0 and level[at - 1] < 0.0 else float(time_s[at])


def _last_crossing_s(time_s: Floats, level: Floats, end: int) -> float | None:
    """Return when a level came to 0 or above for the last time before a reading at which it is; None: it always was."""
    below = np.flatnonzero(level[:end] < 0.0)
    return _zero_s(time_s, level, int(below[-1]) + 1) if len(below) else None


def _zero_s(time_s: Floats, level: Floats, at: int) -> float:
    share = float(level[at - 1] / (level[at - 1] - level[at]))
    return float(time_s[at - 1] + share * (time_s[at] - time_s[at - 1]))


TOUCH_DOWN, REBOUND, SLIDE_ONSET, BREAKAWAY = "touch_down", "rebound", "slide_onset", "breakaway"
"""Events: the foot meets the ground, and again after its first bounce; its load jumps, as it lands on its heel and
begins to slide; it slips away."""
_CONTACTS = {"drop": (TOUCH_DOWN, REBOUND), "landing": (TOUCH_DOWN,)}
"""Contacts of rigs whose carriage falls, as they follow each other."""
_COARSE_S = 0.0025
"""Time between two samples of an IMU from which on a carriage that is sampled more often tells of a touch-down. Chosen:
the carriage tells it to 1 ms, an IMU to a third of that time between samples, or to half of it."""
_IMU = tuple(f"imu/specific_force_{axis}" for axis in "xyz")
_CELL = tuple(f"load_cell/force_{axis}" for axis in "xyz")
_ANGLES = tuple(f"{joint}/position" for joint in names.ANKLE_JOINTS)


class AnkleAlignment:
    """Finds the events of a run from its signals, measured or simulated: the same sensor tells them in both."""

    def events(self, recording: Recording, values: Values) -> dict[str, float]:
        """Return the times of events by name, s; those that did not happen are left out.

        Touch-down of a drop or landing: by the IMU, else the carriage, else the ankle's angles; the end of a drop's
        first bounce by the IMU alone. On the slip rig first contact and onset of the slide by the load cell, without
        one the contact by the ankle's angles, and by these the breakaway; the IMU is on the driven carriage and feels
        none of it. The tensile and the pressure rig have none.

        Args:
            recording: Times of the samples, and which rig was run.
            values: By signal, at the recording's times.

        """
        rig = recording.inputs.rig
        found: dict[str, float | None] = {}
        if rig in FALLING_RIGS:
            touched = _touch_downs_s(recording, values)
            found = dict(zip(_CONTACTS[rig], touched, strict=False))
        elif rig == "slip":
            cell, angles = _table(recording, values, _CELL), _table(recording, values, _ANGLES)
            contact = cell or angles
            found = {
                TOUCH_DOWN: None if contact is None else onset_s(*contact),
                SLIDE_ONSET: None if cell is None else jolt_s(*cell),
                BREAKAWAY: None if angles is None else jolt_s(*angles),
            }
        return {name: time_s for name, time_s in found.items() if time_s is not None}

    def events_of(self, recording: Recording, signal: str) -> tuple[str, ...]:
        """Return the events that a signal is aligned at: pressures at none, as they follow the commands.

        What falls, at its touch-down, and a drop at the end of its first bounce: over drops of the reality the nominal
        simulator then leaves half of the acceleration's residual, 1.1 for 2.3 m/s^2. A landing hardly bounces, and the
        simulator's may not: with it a payload leaves 9.1 per feature, without it 6.7.

        What is pushed down a slope, at contact and breakaway: friction scatters, and with it when the grip is lost.
        Over repeats on the reality the pitch then scatters by 4 to 6 mrad, aligned at the breakaway alone by 9 to
        14. The IMU of that rig follows the carriage.
        """
        rig, quantity = recording.inputs.rig, quantity_of(signal)
        if rig in FALLING_RIGS and quantity != PRESSURE:
            return _CONTACTS[rig]
        return (TOUCH_DOWN, BREAKAWAY) if rig == "slip" and quantity not in {PRESSURE, ACCELERATION, RATE} else ()


def _touch_downs_s(recording: Recording, values: Values) -> tuple[float, ...]:
    """Return the first touch-down, and by the IMU those that end a bounce, s."""
    imu, slide = _table(recording, values, _IMU), _table(recording, values, (CARRIAGE,))
    if imu is not None and not (slide is not None and _between_s(imu[0]) > max(_COARSE_S, _between_s(slide[0]))):
        return touch_downs_s(*imu)
    first_s = None
    if slide is not None:
        falls = falls_of_slide(slide[0], slide[1][:, 0])
        first_s = falls[0].touch_down_s if falls else None
    else:
        angles = _table(recording, values, _ANGLES)
        first_s = None if angles is None else onset_s(*angles, over_s=FAST_S)
    return () if first_s is None else (first_s,)


def _between_s(time_s: NDArray[np.float64]) -> float:
    return float(np.median(np.diff(time_s))) if len(time_s) > 1 else np.inf


def _table(
    recording: Recording, values: Values, wanted: Sequence[str]
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return times and values, shape (n, columns), of those of some signals that there are; None without any."""
    times = {signal.name: signal.time_s for signal in recording.signals}
    there = [name for name in wanted if name in times and name in values]
    if not there or any(len(times[name]) != len(times[there[0]]) for name in there):
        return None
    return times[there[0]], np.column_stack([np.asarray(values[name]) for name in there])
