"""What the sensors of a rig make of what really happens, at the times of a recording, without noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_gap.ankle.instruments import ACCELERATION, ANGLE, EXTENSION, FORCE, PRESSURE, RATE, SLIDE, quantity_of
from jammkle_sim.physics import kernels
from jammkle_sim.rigs.rig import imu_at_rest, laws_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jammkle_gap.core.data import Recording, Signal
    from jammkle_sim.rigs.replay import BodyTrack
    from jammkle_sim.rigs.rig import Rig

_AXES = ("specific_force_x", "specific_force_y", "specific_force_z", "angular_velocity_x", "angular_velocity_y",
         "angular_velocity_z")  # fmt: skip


@dataclass(frozen=True)
class Truth:
    """What really happens in a run, at every time step."""

    step_s: float
    pressure_pa: NDArray[np.float64]
    """Absolute, shape (n + 1, 4), Pa: at the start, then after each step."""
    bodies: BodyTrack | None
    """After each step; None where only the air was run."""
    raw_imu_at_start: NDArray[np.float64] | None = None
    """Raw sample of the IMU before the first step, shape (6,), where its filter begins."""


def readings(recording: Recording, rig: Rig, truth: Truth) -> dict[str, NDArray[np.float64]]:
    """Return what would have been measured, by the names of the recording's signals, at their times.

    Args:
        recording: Which signals, and when; those that the rig does not have are left out.
        rig: Its sensors and wiring.
        truth: What really happens.

    """
    maker = _Readings(rig, truth)
    found: dict[str, NDArray[np.float64]] = {}
    for signal in recording.signals:
        values = maker.reading(signal)
        if values is not None:
            found[signal.name] = values
    return found


class _Readings:
    """Makes readings of one run, the filtered IMU once for all its axes."""

    def __init__(self, rig: Rig, truth: Truth) -> None:
        self._rig = rig
        self._truth = truth
        self._start_s: NDArray[np.float64] = truth.step_s * np.arange(len(truth.pressure_pa), dtype=np.float64)
        self._pressures = (names.MANIFOLD_PRESSURE.name, *(names.PRESSURES[each].name for each in names.CHANNELS))

    def reading(self, signal: Signal) -> NDArray[np.float64] | None:
        """Return one signal; None where the rig has no such sensor."""
        quantity = quantity_of(signal.name)
        if quantity == PRESSURE:
            return self._pressure(signal)
        bodies = self._truth.bodies
        if bodies is None:
            return None
        if quantity in (ACCELERATION, RATE):
            return self._imu(signal)
        if quantity == FORCE:
            return self._force(signal, bodies)
        owner = signal.name.rpartition("/")[0]
        if owner not in (bodies.joints if quantity in (ANGLE, SLIDE) else bodies.tendons):
            return None
        columns = {ANGLE: bodies.position, SLIDE: bodies.position, EXTENSION: bodies.extension_m}
        values = columns.get(quantity, bodies.tension_n)(owner)
        return self._at(signal, self._start_s[1:], values, self._rig.wiring.joint_delay_s)

    def _pressure(self, signal: Signal) -> NDArray[np.float64] | None:
        if signal.name not in self._pressures:
            return None
        i, wiring = self._pressures.index(signal.name), self._rig.wiring
        values = self._at(signal, self._start_s, self._truth.pressure_pa[:, i], wiring.pressure_delay_s)
        return values + wiring.pressure_offset_pa[i]

    def _imu(self, signal: Signal) -> NDArray[np.float64] | None:
        column = signal.name.rpartition("/")[2]
        if column not in _AXES:
            return None
        values = self._filtered[:, _AXES.index(column)]
        return self._at(signal, self._start_s[1:], values, self._rig.wiring.imu_delay_s)

    def _force(self, signal: Signal, bodies: BodyTrack) -> NDArray[np.float64]:
        limit_n, wiring = self._rig.sensors.load_cell_limit_n, self._rig.wiring
        force_n = bodies.load_cell_n[:, "xyz".index(signal.name[-1])]
        cell_n = wiring.load_cell_gain * self._at(signal, self._start_s[1:], force_n, wiring.load_cell_delay_s)
        clipped: NDArray[np.float64] = np.clip(cell_n, -limit_n, limit_n)
        return clipped

    def _at(
        self, signal: Signal, time_s: NDArray[np.float64], values: NDArray[np.float64], delay_s: float
    ) -> NDArray[np.float64]:
        """Return values at the true times of a signal's samples."""
        true_s = signal.time_s / (1.0 + self._rig.wiring.clock_skew) - delay_s
        found: NDArray[np.float64] = np.interp(true_s, time_s, values)
        return found

    @cached_property
    def _filtered(self) -> NDArray[np.float64]:
        """All axes of the IMU after each step, shape (n, 6)."""
        bodies, at_start = self._truth.bodies, self._truth.raw_imu_at_start
        raw = np.zeros((1, 6)) if bodies is None else np.ascontiguousarray(bodies.raw_imu)
        law = laws_of(self._rig).imu
        filtered = np.zeros(raw.shape)
        kernels.imu_history(law, imu_at_rest(law, raw[0] if at_start is None else at_start), raw, filtered)
        return filtered
