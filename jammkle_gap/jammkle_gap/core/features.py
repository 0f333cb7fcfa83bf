"""Features: means over bins of time, registered at the events of a run.

Raw samples have correlated noise and jitter in time; means over bins have neither to a degree that matters. In a run
with contact, a touch-down that comes 2 ms later moves every peak. So signals that follow events are laid over each
other there, in all runs, measured or simulated: time is stretched linearly from one event to the next and shifted
outside (landmark registration: Ramsay and Silverman, Functional Data Analysis, 2nd ed., sec. 7.3). The time of each
event is a feature of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from jammkle_gap.core.data import BadRecordingError
from jammkle_gap.core.noise import noise_of
from jammkle_gap.core.quantisation import mean_error, varying

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.data import Recording, Signal

FEWEST_BINS = 8
"""Bins that the runs of a setting must have in common. Chosen: one per block of smooth scatter."""
EVENT_NOISE_S = 0.001
"""Standard deviation of the time of an event by itself, s. Chosen: a sample of a 1 kHz sensor either way."""


class Registrar(Protocol):
    """Finds the events that signals are registered at."""

    def events(self, recording: Recording, values: Mapping[str, NDArray[np.float64]]) -> Mapping[str, float]:
        """Return the times of events by name, s; an event that did not happen is left out.

        Args:
            recording: Times of the samples, and what was run.
            values: By signal, at the recording's times: measured, or simulated.

        """

    def events_of(self, recording: Recording, signal: str) -> tuple[str, ...]:
        """Return the events that a signal is registered at, as they follow each other; none: the recording's clock."""


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


def layout_of(recordings: Sequence[Recording], bin_s: float, registrar: Registrar | None) -> Layout:
    """Return the features that all runs of a setting have.

    Args:
        recordings: Of one setting.
        bin_s: Length of a bin, s.
        registrar: Finds events; without one every signal is taken by the clock.

    Raises:
        BadRecordingError: they have no signal in common, or hardly overlap.

    """
    first = recordings[0]
    common = set.intersection(*({signal.name for signal in each.signals} for each in recordings))
    # Bags list their topics as they came: by name, runs of one setting share a dictionary whatever came first.
    signals = sorted((each for each in first.signals if each.name in common), key=lambda each: each.name)
    if not signals:
        names = ", ".join(each.name for each in recordings)
        msg = f"the recordings {names} have no signal in common; record the same topics in all runs of a setting"
        raise BadRecordingError(msg)
    found = [{} if registrar is None else dict(registrar.events(each, measured(each))) for each in recordings]
    everywhere = set.intersection(*map(set, found))
    event_s = {name: float(np.median([each[name] for each in found])) for name in sorted(everywhere)}
    end_s = np.inf
    for each, events in zip(recordings, found, strict=True):
        for signal in signals:
            asked = () if registrar is None else registrar.events_of(each, signal.name)
            last_s = each.signal(signal.name).time_s[-1:]
            end_s = min(end_s, float(registered_s(last_s, asked, events, event_s)[0]))
    bins = int(end_s / bin_s)
    if bins < FEWEST_BINS:
        names = ", ".join(each.name for each in recordings)
        msg = f"the recordings {names} overlap for {max(end_s, 0.0):.2f} s, less than {FEWEST_BINS} bins of {bin_s:g} s"
        msg += "; record longer"
        raise BadRecordingError(msg)
    floors = []
    for signal in signals:
        runs = []
        for each, events in zip(recordings, found, strict=True):
            asked = () if registrar is None else registrar.events_of(each, signal.name)
            read = each.signal(signal.name)
            runs.append((registered_s(read.time_s, asked, events, event_s), read))
        floors.append(_floor(runs, bin_s, bins))
    floors.append(np.full(len(event_s), EVENT_NOISE_S))
    shared, units = tuple(each.name for each in signals), tuple(each.unit for each in signals)
    return Layout(shared, units, bin_s, bins, event_s, np.concatenate(floors))


def _floor(runs: Sequence[tuple[NDArray[np.float64], Signal]], bin_s: float, bins: int) -> NDArray[np.float64]:
    """Return the least standard deviation of a signal's bins: noise and rounding of its sensor, shape (bins,).

    Args:
        runs: Registered times, s, and the signal, of each run.
        bin_s: Length of a bin, s.
        bins: How many.

    """
    signal = runs[0][1]
    per_bin = max(len(signal.time_s) / max(signal.time_s[-1] - signal.time_s[0], bin_s) * bin_s, 1.0)
    noise, step = np.mean([noise_of(each) for _, each in runs], axis=0)
    square = np.full(bins, noise**2 / per_bin)
    if step > 0.0:
        spread = varying([(time_s, each.values) for time_s, each in runs], bin_s, bins)
        square += mean_error(spread, step, per_bin)
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
    registrar: Registrar | None,
) -> NDArray[np.float64]:
    """Return the features of one run, measured or simulated.

    Args:
        layout: Of its setting.
        recording: Times of the samples.
        values: By signal, at the recording's times. What a simulator does not give, a signal or an event, stays NaN.
        registrar: As the layout was made with.

    Returns:
        Shape (layout.size,), in the units of the signals and s; bins without a sample are interpolated.

    """
    events = {} if registrar is None else registrar.events(recording, values)
    features = np.full(layout.size, np.nan)
    table = layout.by_signal(features)
    for i, name in enumerate(layout.signals):
        if name not in values:
            continue
        asked = () if registrar is None else registrar.events_of(recording, name)
        time_s = registered_s(recording.signal(name).time_s, asked, events, layout.event_s)
        table[i] = _binned(time_s, np.asarray(values[name]), layout)
    for i, name in enumerate(layout.event_s):
        features[len(layout.signals) * layout.bins + i] = events.get(name, np.nan)
    return features


def registered_s(
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
