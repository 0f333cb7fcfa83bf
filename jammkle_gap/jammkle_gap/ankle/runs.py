"""A run of a rig as the recording that its bag would give: for trials, benchmarks and experiments not yet made."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import yaml

from jammkle_common import names
from jammkle_gap.ankle.bag import Bag, Samples
from jammkle_gap.ankle.loading import recording_of

if TYPE_CHECKING:
    from jammkle_gap.core.data import Recording
    from jammkle_sim.rigs.run import RigRun, Series

_COLUMNS = (
    (re.compile(r"fluid_pressure_pa"), "pressure"),
    (re.compile(r"linear_acceleration_([xyz])_m_s2"), r"specific_force_\1"),
    (re.compile(r"angular_velocity_([xyz])_rad_s"), r"angular_velocity_\1"),
    (re.compile(r"force_([xyz])_n"), r"force_\1"),
    (re.compile(r"(\w+)\.(position|velocity)"), r"\1/\2"),
    (re.compile(r"(\w+)\.(extension)_m"), r"\1/\2"),
    (re.compile(r"(\w+)\.(tension)_n"), r"\1/\2"),
    (re.compile(r"data"), "data"),
)
"""Columns of a run, and those of a bag."""


def recording_of_run(run: RigRun, name: str = "") -> Recording:
    """Return what a bag of this run would be read as.

    Args:
        run: Finished.
        name: Of the recording; by default that of the rig.

    Raises:
        BadRecordingError: it cannot be used, as where it is too short.

    """
    return recording_of(bag_of_run(run, name))


def bag_of_run(run: RigRun, name: str = "") -> Bag:
    """Return what a bag of this run would hold.

    Args:
        run: Finished.
        name: Of the bag; by default that of the rig.

    """
    topics = {topic: _samples(series) for topic, series in run.topics.items() if topic in _KNOWN}
    return Bag(name or run.rig, topics, yaml.safe_dump(dict(run.description)), None)


_KNOWN = {topic.name for topic in names.TOPICS}


def _samples(series: Series) -> Samples:
    columns = {}
    for name in series.columns:
        for pattern, template in _COLUMNS:
            match = pattern.fullmatch(name)
            if match is not None:
                columns[match.expand(template)] = series.column(name)
    return Samples(series.time_s, series.time_s, columns)
