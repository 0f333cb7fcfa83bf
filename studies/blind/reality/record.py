"""What a lab would hand over after a run: what was set up, and what was recorded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from numpy.typing import NDArray

Option = float | str | bool


@dataclass(frozen=True)
class Plan:
    """One run as a person sets it up."""

    rig: str
    """Such as `tensile`: a name that `jammkle rig` knows."""
    options: Mapping[str, Option]
    """Settings of that rig by the names that `jammkle rig` gives them; those not named are at its defaults."""


@dataclass(frozen=True)
class Track:
    """Samples of one topic, as they arrived."""

    columns: tuple[str, ...]
    """Name of each column with its unit, after the tendon or joint it belongs to and a dot, where there are several:
    `fluid_pressure_pa`, `force_z_n`, `achilles_left.tension_n`, `carriage.position`, `data`."""
    stamp_s: NDArray[np.float64]
    """When each was measured by the sensor's own clock, s since the start of the rig, shape (n,)."""
    log_s: NDArray[np.float64]
    """When each was written, s since the start of the rig, shape (n,), rising."""
    values: NDArray[np.float64]
    """SI, shape (n, columns)."""


@dataclass(frozen=True)
class RealRun:
    """One run of the real machine."""

    plan: Plan
    topics: Mapping[str, Track]
    """By relative name, such as `imu/data`; commands (`pump/duty`, `<channel>/solenoid`) as they were issued."""
