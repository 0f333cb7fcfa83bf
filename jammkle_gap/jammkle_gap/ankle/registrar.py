"""The events at which runs of an ankle are laid over each other; fulfils `core.features.Registrar`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_gap.ankle.events import FAST_S, falls_of_slide, jolt_s, onset_s, touch_downs_s
from jammkle_gap.ankle.instruments import ACCELERATION, PRESSURE, RATE, quantity_of
from jammkle_gap.ankle.phases import FALLING_RIGS
from jammkle_gap.ankle.signals import CARRIAGE

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.data import Recording

    Values = Mapping[str, NDArray[np.float64]]

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


class AnkleRegistrar:
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
        """Return the events that a signal is registered at: pressures at none, as they follow the commands.

        What falls, at its touch-down, and a drop at the end of its first bounce: over drops of the reality the nominal
        simulator then leaves half of the acceleration's residual, 1.1 for 2.3 m/s^2. A landing hardly bounces, and the
        simulator's may not: with it a payload leaves 9.1 per feature, without it 6.7.

        What is pushed down a slope, at contact and breakaway: friction scatters, and with it when the grip is lost.
        Over repeats on the reality the pitch then scatters by 4 to 6 mrad, registered at the breakaway alone by 9 to
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
