"""When commands were taken: exactly, where the hardware said so or recorder and sensors share a clock."""

from __future__ import annotations

import dataclasses

import numpy as np

from jammkle_common import names
from jammkle_gap.ankle.bag import Bag, Samples

_EXACT_S = 1e-6
"""Difference of log time and stamp up to which a recorder hears everything at once, as one inside a simulation does."""


def with_acknowledgements(bag: Bag) -> Bag:
    """Return the bag with the commands as the hardware acknowledged them, where it did."""
    topics = dict(bag.topics)
    told = topics.pop(names.ACTUATOR_STATES.name, None)
    if told is None:
        return bag
    order = np.argsort(told.stamp_s, kind="stable")
    for topic, column in told.columns.items():
        values = column[order]
        changed = np.concatenate(([True], values[1:] != values[:-1]))
        time_s = told.stamp_s[order][changed]
        topics[topic] = Samples(time_s, time_s, {"data": values[changed]})
    return dataclasses.replace(bag, topics=topics, acknowledged=True)


def is_exact(bag: Bag) -> bool:
    """Tell whether commands have the times of the measurements' clock at which they were taken."""
    if bag.acknowledged:
        return True
    return all(float(np.abs(each.log_s - each.stamp_s).max()) <= _EXACT_S for each in bag.topics.values())
