"""What the sensors of a rig make of what really happens, at the times of a recording, without noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_graph import names
from jammkle_sim.gap.ankle.instruments import ACCELERATION, ANGLE, EXTENSION, FORCE, PRESSURE, RATE, SLIDE, quantity_of
from jammkle_sim.physics import kernels
from jammkle_sim.rigs.assembly import imu_at_rest, laws_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from jammkle_sim.gap.recording import Recording, Signal
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
        self._imu: NDArray[np.float64] | None = None
        self._start_s = truth.step_s * np.arange(len(truth.pressure_pa))
        self._after_s = self._start_s[1:]
        self._pressures = (names.MANIFOLD_PRESSURE.name, *(names.PRESSURES[each].name for each in names.CHANNELS))

    def reading(self, signal: Signal) -> NDArray[np.float64] | None:
        """Return one signal; None where the rig has no such sensor."""
        wiring, quantity = self._rig.wiring, quantity_of(signal.name)
        if quantity == PRESSURE:
            if signal.name not in self._pressures:
                return None
            i = self._pressures.index(signal.name)
            values = self._at(signal, self._start_s, self._truth.pressure_pa[:, i], wiring.pressure_delay_s)
            return values + wiring.pressure_offset_pa[i]
        bodies = self._truth.bodies
        if bodies is None:
            return None
        owner, _, column = signal.name.rpartition("/")
        if quantity in (ACCELERATION, RATE):
            if column not in _AXES:
                return None
            return self._at(signal, self._after_s, self._filtered()[:, _AXES.index(column)], wiring.imu_delay_s)
        if quantity == FORCE:
            limit_n = self._rig.sensors.load_cell_limit_n
            force_n = bodies.load_cell_n[:, "xyz".index(column[-1])]
            cell_n = self._at(signal, self._after_s, force_n, wiring.load_cell_delay_s)
            clipped: NDArray[np.float64] = np.clip(wiring.load_cell_gain * cell_n, -limit_n, limit_n)
            return clipped
        columns: Callable[[str], NDArray[np.float64]]
        if quantity in (ANGLE, SLIDE):
            columns, known = bodies.position, bodies.joints
        else:
            columns = bodies.extension_m if quantity == EXTENSION else bodies.tension_n
            known = bodies.tendons
        return self._at(signal, self._after_s, columns(owner), wiring.joint_delay_s) if owner in known else None

    def _at(
        self, signal: Signal, time_s: NDArray[np.float64], values: NDArray[np.float64], delay_s: float
    ) -> NDArray[np.float64]:
        """Return values at the true times of a signal's samples."""
        true_s = signal.time_s / (1.0 + self._rig.wiring.clock_skew) - delay_s
        found: NDArray[np.float64] = np.interp(true_s, time_s, values)
        return found

    def _filtered(self) -> NDArray[np.float64]:
        if self._imu is None and self._truth.bodies is not None:
            raw = np.ascontiguousarray(self._truth.bodies.raw_imu)
            law, at_start = laws_of(self._rig).imu, self._truth.raw_imu_at_start
            state = imu_at_rest(law, raw[0] if at_start is None else at_start)
            self._imu = np.zeros(raw.shape)
            kernels.imu_history(law, state, raw, self._imu)
        assert self._imu is not None  # the bodies were asked for before
        return self._imu
