"""The events at which runs of an ankle are laid over each other; fulfils `core.features.Registrar`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.ankle.events import FAST_S, falls_of_imu, falls_of_slide, jolt_s, onset_s
from jammkle_gap.ankle.instruments import PRESSURE, quantity_of
from jammkle_gap.ankle.phases import FALLING_RIGS
from jammkle_gap.ankle.signals import CARRIAGE
from jammkle_graph import names

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.data import Recording

    Values = Mapping[str, NDArray[np.float64]]

TOUCH_DOWN, SLIDE_ONSET = "touch_down", "slide_onset"
"""Events: the foot meets the ground; it lands on its heel and begins to slide, or loses its grip."""
_IMU = tuple(f"imu/specific_force_{axis}" for axis in "xyz")
_CELL = tuple(f"load_cell/force_{axis}" for axis in "xyz")
_ANGLES = tuple(f"{joint}/position" for joint in names.ANKLE_JOINTS)


class AnkleRegistrar:
    """Finds the events of a run from its signals, measured or simulated: the same sensor tells them in both."""

    def events(self, recording: Recording, values: Values) -> dict[str, float]:
        """Return the times of events by name, s; those that did not happen are left out.

        Touch-down of a drop or landing: by the IMU, else the carriage, else the ankle's angles. First contact and onset
        of the slide on the slip rig: by the load cell, else the ankle's angles; the IMU is on the driven carriage and
        feels neither. The tensile and the pressure rig have none.

        Args:
            recording: Times of the samples, and which rig was run.
            values: By signal, at the recording's times.

        """
        rig = recording.inputs.rig
        found: dict[str, float | None] = {}
        if rig in FALLING_RIGS:
            found[TOUCH_DOWN] = _touch_down_s(recording, values)
        elif rig == "slip":
            table = _table(recording, values, _CELL) or _table(recording, values, _ANGLES)
            if table is not None:
                found = {TOUCH_DOWN: onset_s(*table), SLIDE_ONSET: jolt_s(*table)}
        return {name: time_s for name, time_s in found.items() if time_s is not None}

    def event_of(self, recording: Recording, signal: str) -> str:
        """Return the event that a signal is registered at: what moves at the touch-down, pressures at the commands."""
        if quantity_of(signal) == PRESSURE or recording.inputs.rig not in {*FALLING_RIGS, "slip"}:
            return ""
        return TOUCH_DOWN


def _touch_down_s(recording: Recording, values: Values) -> float | None:
    imu = _table(recording, values, _IMU)
    if imu is not None:
        falls = falls_of_imu(*imu)
        return falls[0].touch_down_s if falls else None
    slide = _table(recording, values, (CARRIAGE,))
    if slide is not None:
        falls = falls_of_slide(slide[0], slide[1][:, 0])
        return falls[0].touch_down_s if falls else None
    angles = _table(recording, values, _ANGLES)
    return None if angles is None else onset_s(*angles, over_s=FAST_S)


def _table(
    recording: Recording, values: Values, wanted: Sequence[str]
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return times and values, shape (n, columns), of those of some signals that there are; None without any."""
    times = {signal.name: signal.time_s for signal in recording.signals}
    there = [name for name in wanted if name in times and name in values]
    if not there or any(len(times[name]) != len(times[there[0]]) for name in there):
        return None
    return times[there[0]], np.column_stack([np.asarray(values[name]) for name in there])
