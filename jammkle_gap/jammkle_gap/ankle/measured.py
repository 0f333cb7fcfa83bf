"""What a recording measured, on the time steps of the simulation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.ankle.instruments import PRESSURE, quantity_of
from jammkle_graph import names
from jammkle_sim.rigs.replay import timestep_s

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jammkle_gap.november.recording import Recording
    from jammkle_sim.rigs.rig import Rig


class Measured:
    """A recording as functions of the simulation's steps. What was not measured is None."""

    def __init__(self, recording: Recording, rig: Rig, steps: int) -> None:
        """Look at a recording.

        Args:
            recording: What was measured.
            rig: What it was measured on.
            steps: How many steps it takes.

        """
        self._signals = {signal.name: signal for signal in recording.signals}
        self._rig = rig
        self._time_s = timestep_s(rig) * np.arange(1, steps + 1)

    def after_each_step(self, name: str) -> NDArray[np.float64] | None:
        """Return a signal after each step, shape (steps,): what was stamped later, or by another clock, as it was."""
        signal = self._signals.get(name)
        return None if signal is None else np.interp(self._stamped_s(name), signal.time_s, signal.values)

    def _stamped_s(self, name: str) -> NDArray[np.float64]:
        """Return the stamps that a signal has at the end of each step; `readings` does the reverse."""
        wiring = self._rig.wiring
        delay_s = wiring.pressure_delay_s if quantity_of(name) == PRESSURE else wiring.joint_delay_s
        return np.asarray((self._time_s + delay_s) * (1.0 + wiring.clock_skew), dtype=np.float64)

    def extension_m(self, tendon: str) -> NDArray[np.float64] | None:
        """Return a tendon's extension, shape (steps,), m."""
        return self.after_each_step(f"{tendon}/extension")

    def tensions_n(self) -> NDArray[np.float64] | None:
        """Return the tensions of all tendons of the rig, shape (steps, tendons), N, never negative."""
        found = [self.after_each_step(f"{tendon}/tension") for tendon in self._rig.tendon_names]
        columns = [each for each in found if each is not None]
        if not columns or len(columns) < len(found):
            return None
        return np.maximum(np.column_stack(columns), 0.0)

    def pressures_pa(self) -> NDArray[np.float64] | None:
        """Return manifold and channels, shape (steps, 4), Pa."""
        topics = (names.MANIFOLD_PRESSURE, *(names.PRESSURES[channel] for channel in names.CHANNELS))
        found = [self.after_each_step(topic.name) for topic in topics]
        columns = [each for each in found if each is not None]
        return np.column_stack(columns) if len(columns) == len(found) else None

    def channel_pa(self, channel: int) -> NDArray[np.float64] | None:
        """Return one channel's pressure, shape (steps,), Pa: as measured, less what the sensor reads too much."""
        measured_pa = self.after_each_step(names.PRESSURES[names.CHANNELS[channel]].name)
        return None if measured_pa is None else measured_pa - self._rig.wiring.pressure_offset_pa[1 + channel]

    def joint(self, name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Return position and rate of a joint, each of shape (steps,), rad or m; a joint that stood still is 0."""
        position = self.after_each_step(f"{name}/position")
        if position is None:
            return None
        signal = self._signals[f"{name}/position"]
        rate = np.gradient(signal.values, signal.time_s)
        return position, np.interp(self._stamped_s(signal.name), signal.time_s, rate)
