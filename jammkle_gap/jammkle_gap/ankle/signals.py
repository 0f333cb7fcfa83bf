"""Commands and signals of a stretch of a bag, on the clock of its run."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_gap.ankle.instruments import UNITS, quantity_of
from jammkle_gap.core.data import BadRecordingError, Signal
from jammkle_sim.rigs.replay import CommandTrack, Timeline

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray

    from jammkle_gap.ankle.bag import Samples

COMMANDS = (names.PUMP_DUTY.name, *(topic.name for topic in names.SOLENOIDS.values()))
"""Topics that tell the hardware what to do."""
CARRIAGE = f"{names.CARRIAGE_JOINT}/position"
"""Signal and column of a rig's slide."""
_JOINTS = (*names.ANKLE_JOINTS, names.CARRIAGE_JOINT)
_ROUNDING_S = 1e-9
"""What stamps of the same time may differ by, s."""
_ON_THE_GRID = 1e-6
"""Rounding of a number of samples."""
_SLOW_HZ = 200.0
"""Rate that signals of slow rigs are thinned to. Assumed: nothing there is faster than 50 Hz, and a diagnosis keeps
hundreds of runs."""


def commands_of(topics: Mapping[str, Samples], start_s: float) -> CommandTrack:
    """Return what was commanded, since a start; what was commanded before it has negative times.

    Args:
        topics: With commands among them.
        start_s: By the clock of the stamps.

    """

    def timeline(topic: str) -> Timeline:
        samples = topics[topic]
        order = np.argsort(samples.log_s, kind="stable")
        return Timeline(samples.log_s[order] - start_s, samples.columns["data"][order])

    solenoids = {channel: timeline(topic.name) for channel, topic in names.SOLENOIDS.items() if topic.name in topics}
    return CommandTrack(timeline(names.PUMP_DUTY.name), solenoids)


def signals_of(bag: str, topics: Mapping[str, Samples], start_s: float, end_s: float) -> Iterator[Signal]:
    """Give the signals between a start and an end, by the clock of the stamps, times since the start, without noise.

    Args:
        bag: Name of the bag.
        topics: Measured ones; commands among them are left out.
        start_s: First time that is taken.
        end_s: Last time that is taken.

    Raises:
        BadRecordingError: a reading is not a number.

    """
    for topic, samples in topics.items():
        if topic in COMMANDS:
            continue
        for column in samples.columns:
            name = _signal_name(topic, column)
            if name is None:
                continue
            stamp_s, values = samples.readings(column)
            _check_finite(bag, name, stamp_s - start_s, values)
            inside = (stamp_s >= start_s - _ROUNDING_S) & (stamp_s <= end_s + _ROUNDING_S)
            if inside.any():
                yield Signal(name, UNITS[quantity_of(name)], stamp_s[inside] - start_s, values[inside])


def strange_joints(topics: Mapping[str, Samples]) -> list[str]:
    """Return the names of joints that no rig with an ankle has, sorted."""
    samples = topics.get(names.JOINT_STATES.name)
    joints = {column.partition("/")[0] for column in samples.columns} if samples is not None else set()
    return sorted(joints - set(_JOINTS))


def thinned(signal: Signal, fewest: int) -> Signal:
    """Return every n-th sample of a signal, so that neither `fewest` samples nor 200 Hz are fallen below."""
    length_s = float(signal.time_s[-1] - signal.time_s[0])
    every = max(int((len(signal.time_s) - 1) / max(length_s * _SLOW_HZ, fewest, 1.0) + _ON_THE_GRID), 1)
    return dataclasses.replace(signal, time_s=signal.time_s[::every].copy(), values=signal.values[::every].copy())


def _signal_name(topic: str, column: str) -> str | None:
    """Return the name of a signal: a pressure's topic, a tendon's or joint's column, else topic and column."""
    if column == "pressure":
        return topic
    owner, _, what = column.rpartition("/")
    if what == "velocity" or (topic == names.JOINT_STATES.name and owner not in _JOINTS):
        return None
    if "/" in column:
        return column
    return f"{topic.split('/', maxsplit=1)[0]}/{column}"


def _check_finite(bag: str, name: str, time_s: NDArray[np.float64], values: NDArray[np.float64]) -> None:
    bad = ~np.isfinite(values)
    if bad.any():
        when_s = float(time_s[int(np.argmax(bad))])
        msg = (
            f"{name} in bag {bag} is not a number at {int(bad.sum())} of {len(values)} samples, first at {when_s:.3f} s"
        )
        msg += "; leave such samples out when recording, and check the sensor"
        raise BadRecordingError(msg)
