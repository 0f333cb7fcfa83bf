"""Bags that cannot be used, by their commands and clocks; each error says what to record instead."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import linprog  # type: ignore[import-untyped]  # carries no types

from jammkle_common import names
from jammkle_gap.ankle.signals import COMMANDS
from jammkle_gap.core.data import BadRecordingError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_gap.ankle.bag import Bag, Samples

_LARGEST_OFFSET_S = 0.5
"""Largest offset between the clocks of log and stamps, s, where commands are placed by the log. Assumed: the quickest
of all messages takes no longer."""
_LARGEST_LATENCY_S = 2.0
"""Largest latency of a topic beyond the quickest one's, s. Assumed: what is later has stamps of another clock."""
_LARGEST_DRIFT = 0.03
"""Largest relative drift between the two; beyond it one of the clocks does not count seconds."""
_DRIFT_FLOOR_S = 0.05
"""Drift that is never minded, s."""
_FELL_BEHIND_S = 0.1
"""From which delay on it is noted that a recorder fell behind, s."""
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


def checked_clocks(bag: Bag, topics: Mapping[str, Samples]) -> tuple[str, ...]:
    """Check that commands can be placed among measurements; return what the reader should know of the recorder.

    Only commands without a stamp have nothing but their log time. Where the hardware has acknowledged them with a
    stamp, or a simulation has made /clock, log times say nothing of the machine.

    Args:
        bag: The bag.
        topics: Its topics, samples in order.

    Raises:
        BadRecordingError: commands are placed by the log, and its clock is not that of the stamps.

    """
    measured = {topic: each for topic, each in topics.items() if topic not in COMMANDS}
    if not bag.acknowledged and bag.clock is None:
        _check_one_clock(bag.name, measured)
    behind_s = max(float(np.ptp(each.log_s - each.stamp_s)) for each in measured.values())
    if behind_s <= _FELL_BEHIND_S:
        return ()
    return (f"its recorder fell behind by up to {behind_s:.1f} s; measurements have their stamps, and are not moved",)


def _check_one_clock(bag: str, measured: Mapping[str, Samples]) -> None:
    """Refuse stamps of another clock than the log's.

    Raises:
        BadRecordingError: they are far apart, or drift apart.

    """
    lags = {topic: _least_lag(each) for topic, each in measured.items()}
    quickest_s = min((lag_s for lag_s, _, _ in lags.values()), key=abs)
    for topic, (lag_s, drift_s, duration_s) in lags.items():
        apart_s = lag_s if abs(quickest_s) > _LARGEST_OFFSET_S else lag_s - quickest_s
        largest_s = _LARGEST_OFFSET_S if abs(quickest_s) > _LARGEST_OFFSET_S else _LARGEST_LATENCY_S
        if not -_LARGEST_OFFSET_S <= apart_s <= largest_s:
            msg = f"clocks disagree in bag {bag}: {topic} is logged {apart_s:.3g} s after its header's stamp"
            msg += f", at most {largest_s:g} s; record with one clock (or with /clock)"
            raise BadRecordingError(msg)
        limit_s = max(_DRIFT_FLOOR_S, _LARGEST_DRIFT * duration_s)
        if abs(drift_s) > limit_s:
            msg = f"clocks drift apart in bag {bag}: {topic}'s log time and header time part by {drift_s:.3g} s"
            msg += f", at most {limit_s:.2g} s; synchronise the clocks and record again"
            raise BadRecordingError(msg)


def _least_lag(samples: Samples) -> tuple[float, float, float]:
    """Return offset and drift between log and stamps, s, and the duration, s, by the quickest messages alone.

    A message is only ever late, so that the clocks lie on the line under all points that is nearest to them: the linear
    programme of Moon, Skelly and Towsley, Estimation and removal of clock skew from network delay measurements (1999).
    """
    lag_s = samples.log_s - samples.stamp_s
    time_s = samples.log_s - samples.log_s[0]
    duration_s = float(time_s.max())
    if duration_s == 0.0:
        return float(lag_s.min()), 0.0, 0.0
    line = linprog(
        [-1.0, -float(time_s.mean())],
        A_ub=np.column_stack((np.ones_like(time_s), time_s)),
        b_ub=lag_s,
        bounds=[(None, None), (None, None)],
    )
    offset_s, slope = line.x
    return float(offset_s + slope * time_s.mean()), float(slope * duration_s), duration_s


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
