"""Bags that cannot be used, by their commands and clocks; each error says what to record instead."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import theilslopes  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.ankle.signals import COMMANDS
from jammkle_gap.core.data import BadRecordingError
from jammkle_graph import names

if TYPE_CHECKING:
    from jammkle_gap.ankle.bag import Bag, Samples

_LARGEST_OFFSET_S = 0.5
"""Largest difference between log time and header time. Assumed: no transport takes longer."""
_LARGEST_DRIFT = 0.03
"""Largest relative drift between the two; beyond it one of the clocks does not count seconds."""
_DRIFT_FLOOR_S = 0.05
"""Drift that is never minded, s."""
_DRIFT_POINTS = 200
"""Samples, spread evenly, that a drift is taken from. Chosen: all pairs of them are looked at."""
_REORDERED_S = 0.1
"""How far neighbours may be out of order in the bag and are put back. Assumed: no queue of a recorder holds longer."""
_STEPS_BACK = 0.01
"""Share of samples that may be further out of order, or double."""


def check_commands(bag: Bag) -> None:
    """Refuse a bag without commands.

    Raises:
        BadRecordingError: pump or all solenoids are missing.

    """
    solenoids = [topic.name for topic in names.SOLENOIDS.values()]
    missing = [] if names.PUMP_DUTY.name in bag.topics else [names.PUMP_DUTY.name]
    missing += [] if any(name in bag.topics for name in solenoids) else ["any of " + ", ".join(solenoids)]
    if missing:
        msg = f"bag {bag.name} holds no commands: {' nor '.join(missing)}"
        msg += "; record them too, from before the first one is given"
        raise BadRecordingError(msg)


def checked_topics(bag: Bag) -> dict[str, Samples]:
    """Return the topics of a bag, samples in order.

    Raises:
        BadRecordingError: a command or a clock that cannot be right, or commands alone.

    """
    topics: dict[str, Samples] = {}
    for topic, samples in bag.topics.items():
        if topic in COMMANDS:
            _check_command_values(bag.name, topic, samples)
            topics[topic] = samples
            continue
        topics[topic] = _in_order(bag.name, topic, samples)
        _check_clocks(bag.name, topic, samples)
    if not set(topics) - set(COMMANDS):
        msg = f"bag {bag.name} holds commands alone"
        msg += f"; record pressures, {names.JOINT_STATES.name} and {names.IMU.name} too"
        raise BadRecordingError(msg)
    return topics


def _check_command_values(bag: str, topic: str, samples: Samples) -> None:
    """Refuse commands that are no share from 0 to 1, such as a duty in percent.

    Raises:
        BadRecordingError: as said.

    """
    values = samples.columns["data"]
    wrong = ~((values >= 0.0) & (values <= 1.0))
    if wrong.any():
        msg = (
            f"{topic} in bag {bag} is {values[int(np.argmax(wrong))]:g} at {int(wrong.sum())} of {len(values)} samples"
        )
        msg += "; record the command as applied, a number from 0 to 1"
        raise BadRecordingError(msg)


def _check_clocks(bag: str, topic: str, samples: Samples) -> None:
    """Refuse stamps of another clock than the recorder's, as commands have none but that.

    A drift is the slope of Sen (1968), the median over pairs of samples: a recorder that got no processor time for a
    while has logged some samples late, and no clock drifts by that.

    Raises:
        BadRecordingError: they are far apart, or drift apart.

    """
    behind_s = samples.log_s - samples.stamp_s
    apart_s = float(np.median(behind_s))
    if abs(apart_s) > _LARGEST_OFFSET_S:
        msg = f"clocks disagree in bag {bag}: {topic} is logged {apart_s:.3g} s after its header's stamp"
        msg += f", at most {_LARGEST_OFFSET_S:g} s; record with one clock (or with /clock)"
        raise BadRecordingError(msg)
    duration_s = float(np.ptp(samples.log_s))
    if duration_s == 0.0:
        return
    every = -(-len(behind_s) // _DRIFT_POINTS)
    drift_s = duration_s * float(theilslopes(behind_s[::every], samples.log_s[::every]).slope)
    limit_s = max(_DRIFT_FLOOR_S, _LARGEST_DRIFT * duration_s)
    if abs(drift_s) > limit_s:
        msg = f"clocks drift apart in bag {bag}: {topic}'s log time and header time part by {drift_s:.3g} s"
        msg += f", at most {limit_s:.2g} s; synchronise the clocks and record again"
        raise BadRecordingError(msg)


def _in_order(bag: str, topic: str, samples: Samples) -> Samples:
    """Return the samples by rising stamps. A recorder with several threads may write neighbours in another order.

    Raises:
        BadRecordingError: more than a few are far out of order, or double.

    """
    late = samples.stamp_s < np.maximum.accumulate(samples.stamp_s) - _REORDERED_S
    order = np.flatnonzero(~late)[np.argsort(samples.stamp_s[~late], kind="stable")]
    kept = order[np.concatenate(([True], np.diff(samples.stamp_s[order]) > 0.0))]
    lost = 1.0 - len(kept) / len(samples.stamp_s)
    if not samples.stamp_s.any():
        msg = f"{topic} in bag {bag} carries no time in its headers; record it with header.stamp set"
        raise BadRecordingError(msg)
    if lost > _STEPS_BACK:
        msg = f"stamps of {topic} in bag {bag} run backwards or stand still at {100.0 * lost:.0f} % of its samples"
        msg += "; record one publisher with a steady clock, without a reset of the simulation"
        raise BadRecordingError(msg)
    return samples.chosen(kept)
