"""Features: what recordings are compared by. Means over bins of time, aligned at events, and the noise of each.

Means over time bins, not raw samples: timing jitter and correlated noise stay finite. Signals that jump at an event are
aligned there, and when it came is a feature of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from jammkle_gap.core.data import BadRecordingError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.data import Recording, Signal

BLOCKS = 8
"""Stretches of time of which the median is taken: motion faster than the samples in fewer than half does not count."""
_WEIGHTS = np.array([0.5, -1.0, 0.5])
"""A sample less what its neighbours promise: a straight line gives 0, white noise 1.5 times its variance."""


def noise_of(signal: Signal) -> tuple[float, float]:
    """Return standard deviation from sample to sample, and smallest step, in the signal's unit.

    As declared; where neither is, the noise is estimated by differences of neighbouring samples, which cancel whatever
    changes slowly (Rice 1984, Ann. Stat. 12:1215; of second order: Gasser, Sroka and Jennen-Steinmetz 1986, Biometrika
    73:625), and the smallest step that occurs is the resolution.
    """
    if signal.noise > 0.0 or signal.resolution > 0.0:
        return signal.noise, signal.resolution
    values = signal.values[new_readings(signal.values)]
    if values.size < BLOCKS + len(_WEIGHTS) - 1:
        return 0.0, 0.0
    second = np.convolve(values, _WEIGHTS, "valid")
    variances = [np.square(block).mean() for block in np.array_split(second, BLOCKS)]
    return float(np.sqrt(np.median(variances) / np.square(_WEIGHTS).sum())), _smallest_step(signal.values)


def new_readings(values: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return which readings are new, rising; the others say nothing that these do not.

    A driver that publishes more often than its sensor reads repeats what it has, and a table that was put on a finer
    clock is straight between its readings. They show by new ones that come evenly, several steps apart: the rounding of
    a coarse sensor repeats readings and leaves lines, too, but goes on by a step, and where a motion comes back evenly
    it bends for many readings. What is published less than twice as often, or on a clock less than four times as fine,
    does not show in readings.
    """
    step = max(_smallest_step(values), 1e-9 * float(np.abs(values).max(initial=0.0)))
    changes, bends = np.abs(np.diff(values)), np.abs(np.convolve(values, _WEIGHTS, "valid"))
    bent = np.flatnonzero(bends > _ROUNDED * step)
    # A reading that lies between two samples bends the line at both.
    corners = bent[np.diff(bent, prepend=-2) > 1]
    if bent.size > 2 * corners.size:
        corners = corners[:0]
    for off, new, least in ((changes[changes > 0.0], np.flatnonzero(changes), 2.0), (bends[bent], corners, 4.0)):
        between = np.diff(new)
        if between.size < _FEWEST_NEW or float(np.median(off)) < _SEVERAL * step:
            continue
        usual = float(np.median(between))
        if usual >= least and float((np.abs(between - usual) <= 1.0).mean()) > _EVEN:
            return np.concatenate(([0], new + 1))
    return np.arange(values.size)


_ROUNDED = 1.01
"""Steps by which rounding bends a straight line at most: one, and what floats make of it."""
_SEVERAL = 3.0
"""Steps that new readings must be apart. Chosen: a motion that rounding repeats goes on by one or two."""
_FEWEST_NEW = 20
"""New readings that must be there. Chosen: no motion turns so often, so evenly."""
_EVEN = 0.75
"""Share of them that must come evenly, to a sample. Chosen: some are lost, and some lie on a line by chance."""


def _smallest_step(values: NDArray[np.float64]) -> float:
    """Return the smallest difference of two values; 0 for a constant."""
    steps = np.diff(np.unique(values))
    return float(steps.min()) if steps.size else 0.0


_SCATTER = np.linspace(0.0, 1.0, 201)
"""t in steps; beyond the last, S is below the rounding of a number."""
_ORDERS = np.arange(1, 501)[:, np.newaxis]
"""Terms of the sum; those left out are a thousandth of it where all readings stand on one code, and less elsewhere."""
_SHARED = (np.exp(-4.0 * np.square(np.pi * _ORDERS * _SCATTER)) / (2.0 * np.square(np.pi * _ORDERS))).sum(axis=0)
_SHARED *= 1.0 / 12.0 / _SHARED[0]
_VARIANCE = np.square(_SCATTER) + 1.0 / 12.0 - _SHARED
SIDE = 4
"""Bins on either side whose readings tell how much they vary. A slow motion crosses a step in few bins, and errs in all
of them. Chosen: a motion of a quarter of a step in a bin crosses one in them."""


def mean_error(variance: NDArray[np.float64], step: float, count: float) -> NDArray[np.float64]:
    """Return the mean square error that rounding leaves in the mean of a bin, per bin, in the unit's square.

    Args:
        variance: Of rounded readings about their bin's mean, shape (bins,), in the unit's square.
        step: Of the sensor, above 0.
        count: Readings in a bin, 1 or more.

    """
    shared = np.interp(variance / step**2, _VARIANCE, _SHARED)
    found: NDArray[np.float64] = step**2 * (shared + (1.0 / 12.0 - shared) / count)
    return found


def varying(
    runs: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]], bin_s: float, bins: int
) -> NDArray[np.float64]:
    """Return the variance of all runs' readings about the mean of their bin, shape (bins,), in the unit's square.

    Bins before and bins after are taken by themselves, each with the bin, and the less counts: a machine that stands
    still until it is let go is not said to move before.

    Args:
        runs: Times, s, and values of one signal in each run.
        bin_s: Length of a bin, s.
        bins: How many.

    """
    squares, freedom = np.zeros(bins), np.zeros(bins)
    for time_s, values in runs:
        at = np.floor(time_s / bin_s).astype(int)
        inside = (at >= 0) & (at < bins)
        at, read = at[inside], values[inside]
        count = np.bincount(at, minlength=bins)
        means = np.bincount(at, weights=read, minlength=bins) / np.maximum(count, 1)
        squares += np.bincount(at, weights=np.square(read - means[at]), minlength=bins)
        freedom += np.maximum(count - 1, 0)
    sides = []
    for offset in (0, SIDE):
        sums = [np.convolve(np.pad(each, SIDE), np.ones(SIDE + 1), "valid") for each in (squares, freedom)]
        sides.append((sums[0] / np.maximum(sums[1], 1.0))[offset : offset + bins])
    found: NDArray[np.float64] = np.minimum(*sides)
    return found


FEWEST_BINS = 8
"""Bins that the runs of a setting must have in common. Chosen: one per block of smooth scatter."""
EVENT_NOISE_S = 0.001
"""Standard deviation of the time of an event by itself, s. Chosen: a sample of a 1 kHz sensor either way."""


class Alignment(Protocol):
    """Finds the events that signals are aligned at."""

    def events(self, recording: Recording, values: Mapping[str, NDArray[np.float64]]) -> Mapping[str, float]:
        """Return the times of events by name, s; an event that did not happen is left out.

        Args:
            recording: Times of the samples, and what was run.
            values: By signal, at the recording's times: measured, or simulated.

        """

    def events_of(self, recording: Recording, signal: str) -> tuple[str, ...]:
        """Return the events that a signal is aligned at, as they follow each other; none: the recording's clock."""


@dataclass(frozen=True)
class Layout:
    """Which features the runs of one setting have: signals by bins, then the times of events."""

    signals: tuple[str, ...]
    units: tuple[str, ...]
    bin_s: float
    bins: int
    event_s: Mapping[str, float]
    """Where each event is put, s."""
    floor: NDArray[np.float64]
    """Least standard deviation of each feature by data sheets, shape (n,), in the signal's unit."""

    @property
    def size(self) -> int:
        """Number of features."""
        return len(self.signals) * self.bins + len(self.event_s)

    @property
    def time_s(self) -> NDArray[np.float64]:
        """Centres of the bins, shape (bins,), s."""
        centres: NDArray[np.float64] = self.bin_s * (np.arange(self.bins, dtype=np.float64) + 0.5)
        return centres

    def by_signal(self, features: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the features without the events, shape (..., signals, bins)."""
        count = len(self.signals) * self.bins
        return features[..., :count].reshape(*features.shape[:-1], len(self.signals), self.bins)


def layout_of(recordings: Sequence[Recording], bin_s: float, alignment: Alignment | None) -> Layout:
    """Return the features that all runs of a setting have.

    Args:
        recordings: Of one setting.
        bin_s: Length of a bin, s.
        alignment: Finds events; without one every signal is taken by the clock.

    Raises:
        BadRecordingError: they have no signal in common, or hardly overlap.

    """
    signals = _shared_signals(recordings)
    found = [{} if alignment is None else dict(alignment.events(each, measured(each))) for each in recordings]
    everywhere = set.intersection(*map(set, found))
    event_s = {name: float(np.median([each[name] for each in found])) for name in sorted(everywhere)}
    end_s = np.inf
    for each, events in zip(recordings, found, strict=True):
        for signal in signals:
            asked = () if alignment is None else alignment.events_of(each, signal.name)
            last_s = each.signal(signal.name).time_s[-1:]
            end_s = min(end_s, float(aligned_s(last_s, asked, events, event_s)[0]))
    start_s = min(float(each.signal(signal.name).time_s[0]) for each in recordings for signal in signals)
    if start_s > 0.5 * end_s:
        msg = f"the recordings {', '.join(each.name for each in recordings)} begin at {start_s:g} s of {end_s:g} s; "
        msg += "times count from the start of a recording"
        raise BadRecordingError(msg)
    bins = int(end_s / bin_s)
    if bins < FEWEST_BINS:
        names = ", ".join(each.name for each in recordings)
        msg = f"the recordings {names} overlap for {max(end_s, 0.0):.2f} s, less than {FEWEST_BINS} bins of {bin_s:g} s"
        msg += "; record longer"
        raise BadRecordingError(msg)
    floors: dict[str, NDArray[np.float64]] = {}
    for signal in signals:
        runs = []
        for each, events in zip(recordings, found, strict=True):
            asked = () if alignment is None else alignment.events_of(each, signal.name)
            read = each.signal(signal.name)
            runs.append((aligned_s(read.time_s, asked, events, event_s), read))
        floors[signal.name] = _floor(runs, bin_s, bins)
    units, stuck = {each.name: each.unit for each in signals}, stuck_in(recordings)
    for name in stuck:
        others = [floors[other] for other in units if units[other] == units[name] and other not in stuck]
        floors[name] = np.max([floors[name], *others], axis=0)
    floor = np.concatenate([*floors.values(), np.full(len(event_s), EVENT_NOISE_S)])
    return Layout(tuple(units), tuple(units.values()), bin_s, bins, event_s, floor)


def _shared_signals(recordings: Sequence[Recording]) -> list[Signal]:
    """Return the signals of the first run that all runs have, by name."""
    names = ", ".join(each.name for each in recordings)
    common = _common(recordings)
    if not common:
        msg = f"the recordings {names} have no signal in common; record the same topics in all runs of a setting"
        raise BadRecordingError(msg)
    # Bags list their topics as they came: by name, runs of one setting share a dictionary whatever came first.
    signals = [recordings[0].signal(name) for name in common]
    for signal in signals:
        given = sorted({each.signal(signal.name).unit for each in recordings})
        if len(given) > 1:
            msg = f"the recordings {names} give '{signal.name}' in {' and '.join(given)}; convert one of them"
            raise BadRecordingError(msg)
    return signals


def _common(recordings: Sequence[Recording]) -> list[str]:
    return sorted(set.intersection(*({signal.name for signal in each.signals} for each in recordings)))


def stuck_in(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Return signals that never change, and of which neither noise nor resolution is declared.

    How accurate such a reading is nobody knows, and without any noise it would decide everything. It is taken to be as
    noisy as the noisiest signal in its unit; `refuse_unknown_noise` refuses it where there is none.
    """

    def says(signal: Signal) -> bool:
        return signal.noise > 0.0 or signal.resolution > 0.0 or bool(np.ptp(signal.values) > 0.0)

    return tuple(name for name in _common(recordings) if not any(says(each.signal(name)) for each in recordings))


def refuse_unknown_noise(recordings: Sequence[Recording]) -> None:
    """Refuse runs of a setting with a signal of which nothing says how noisy it is.

    Raises:
        BadRecordingError: as said.

    """
    stuck = stuck_in(recordings)
    units = {each.unit for each in recordings[0].signals if each.name not in stuck}
    for name in stuck:
        unit = recordings[0].signal(name).unit
        if unit not in units:
            msg = (
                f"{name} never changes in {', '.join(each.name for each in recordings)}, and no other signal in {unit} "
            )
            msg += "does, so that its noise is unknown; declare its noise or its resolution"
            raise BadRecordingError(msg)


def _floor(runs: Sequence[tuple[NDArray[np.float64], Signal]], bin_s: float, bins: int) -> NDArray[np.float64]:
    """Return the least standard deviation of a signal's bins: noise and rounding of its sensor, shape (bins,).

    Bins that share a reading, as of a sensor slower than they are, count for no more than it: their variance is larger
    by as many.

    Args:
        runs: Registered times, s, and the signal, of each run.
        bin_s: Length of a bin, s.
        bins: How many.

    """
    signal = runs[0][1]
    new = [new_readings(each.values) for _, each in runs]
    # Runs may have been recorded at other rates: variances are averaged.
    counts = [
        len(own) / max(float(np.ptp(each.time_s)), bin_s) * bin_s for own, (_, each) in zip(new, runs, strict=True)
    ]
    per_bin = 1.0 / float(np.mean([1.0 / count for count in counts]))
    noise, step = np.mean([noise_of(each) for _, each in runs], axis=0)
    square = np.full(bins, noise**2 / per_bin)
    if step > 0.0:
        read = [(time_s[own], each.values[own]) for own, (time_s, each) in zip(new, runs, strict=True)]
        square += mean_error(varying(read, bin_s, bins), step, max(per_bin, 1.0)) / min(per_bin, 1.0)
    rounding = 1e-9 * max(float(np.abs(signal.values).max()), 1e-9)
    floor: NDArray[np.float64] = np.maximum(np.sqrt(square), rounding)
    return floor


def measured(recording: Recording) -> dict[str, NDArray[np.float64]]:
    """Return what was measured by signal, as a simulator would say it."""
    return {signal.name: signal.values for signal in recording.signals}


def features_of(
    layout: Layout,
    recording: Recording,
    values: Mapping[str, NDArray[np.float64]],
    alignment: Alignment | None,
) -> NDArray[np.float64]:
    """Return the features of one run, measured or simulated.

    Args:
        layout: Of its setting.
        recording: Times of the samples.
        values: By signal, at the recording's times. What a simulator does not give, a signal or an event, stays NaN.
        alignment: As the layout was made with.

    Returns:
        Shape (layout.size,), in the units of the signals and s; bins without a sample are interpolated.

    """
    events = {} if alignment is None else alignment.events(recording, values)
    features = np.full(layout.size, np.nan)
    table = layout.by_signal(features)
    for i, name in enumerate(layout.signals):
        if name not in values:
            continue
        asked = () if alignment is None else alignment.events_of(recording, name)
        time_s = aligned_s(recording.signal(name).time_s, asked, events, layout.event_s)
        table[i] = _binned(time_s, np.asarray(values[name]), layout)
    for i, name in enumerate(layout.event_s):
        features[len(layout.signals) * layout.bins + i] = events.get(name, np.nan)
    return features


def aligned_s(
    time_s: NDArray[np.float64], asked: Sequence[str], own_s: Mapping[str, float], common_s: Mapping[str, float]
) -> NDArray[np.float64]:
    """Return times of one run on the clock on which events fall together, shape (n,), s.

    Args:
        time_s: Rising, shape (n,), s.
        asked: Events that are laid over each other; those that either clock lacks are passed over, and so is one that
            does not follow the one before it on both.
        own_s: Times of events in the run, s.
        common_s: Where they are put, s.

    """
    own: list[float] = []
    common: list[float] = []
    for name in asked:
        there = name in own_s and name in common_s
        if there and (not own or (own_s[name] > own[-1] and common_s[name] > common[-1])):
            own.append(own_s[name])
            common.append(common_s[name])
    if not own:
        return time_s
    before, after = np.minimum(time_s - own[0], 0.0), np.maximum(time_s - own[-1], 0.0)
    registered: NDArray[np.float64] = np.interp(time_s, own, common) + before + after
    return registered


def _binned(time_s: NDArray[np.float64], values: NDArray[np.float64], layout: Layout) -> NDArray[np.float64]:
    """Return means over bins, shape (bins,)."""
    at = np.floor(time_s / layout.bin_s).astype(int)
    inside = (at >= 0) & (at < layout.bins)
    count = np.bincount(at[inside], minlength=layout.bins)
    total = np.bincount(at[inside], weights=values[inside], minlength=layout.bins)
    has = count > 0
    if not has.any():
        return np.full(layout.bins, np.nan)
    means = total / np.maximum(count, 1)
    if not has.all():
        places = np.arange(layout.bins)
        means = np.interp(places, places[has], means[has])
    return means
