"""Commands to pressures, simulated beside the robot."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_gap.ankle.instruments import PRESSURE, declared_bias, declared_noise
from jammkle_gap.monitor.core.followed import Residual
from jammkle_gap.monitor.core.subsystem import Subsystem
from jammkle_sim.physics import kernels, records
from jammkle_sim.physics.pneumatics import vented_state
from jammkle_sim.rigs.replay import CommandTrack, Timeline, actuation, timestep_s
from jammkle_sim.rigs.rig import laws_of

if TYPE_CHECKING:
    from typing import Any

    from numpy.typing import NDArray

    from jammkle_gap.monitor.core.followed import Stretch
    from jammkle_gap.monitor.core.tracks import Track, Tracks
    from jammkle_sim.rigs.rig import Rig

_SOURCES = (names.MANIFOLD_PRESSURE, *(names.PRESSURES[channel] for channel in names.CHANNELS))
_DATA = "data"
_PRESSURE = "pressure"
_STEADY_PA_S = 20e3
"""Rate below which a pressure counts as steady. Assumed: a fifth of what the pump makes in the beginning."""
_LARGEST_OFFSET = 3.0
"""Offset of a sensor that is taken off, in standard deviations of what its kind has; what goes beyond is a gap."""
_VENTED_PA = 2e3
"""Vacuum below which a volume counts as vented. Assumed: four times what the sensors' offsets scatter."""


class AirFollower:
    """Runs the air open from the start on: every volume is drawn or vented, so that no error lasts.

    Commands carry no stamp, and reach robot and monitor at times that differ by some milliseconds. As long as the
    hardware does not say when it took them, the air is therefore run by earlier and by later commands as well, and what
    lies between the two counts as noise.

    What a sensor reads too much while it is vented is taken off, as one zeroes a gauge.
    """

    subsystem = Subsystem.PNEUMATICS
    inputs = (
        names.PUMP_DUTY.name,
        *(topic.name for topic in names.SOLENOIDS.values()),
        *(topic.name for topic in _SOURCES),
    )

    def __init__(self, rig: Rig, command_jitter_s: float) -> None:
        """Take a rig.

        Args:
            rig: What is simulated.
            command_jitter_s: How far the times of commands may be off, either way, s.

        """
        self._rig = rig
        self._law = laws_of(rig).pneumatics
        self._noise_pa = declared_noise(rig, timestep_s(rig))[PRESSURE]
        self._largest_offset_pa = _LARGEST_OFFSET * declared_bias(rig)[PRESSURE]
        self._vented_sum_pa = np.zeros(len(_SOURCES))
        self._vented_samples = np.zeros(len(_SOURCES))
        self._shifts_s: tuple[float, ...] = (0.0, -command_jitter_s, command_jitter_s)
        self._states = [vented_state(self._law) for _ in self._shifts_s]
        self._time_s = 0.0

    def trust_commands(self) -> None:
        """Take the times of commands as they are from now on: the hardware has told them."""
        self._shifts_s, self._states = self._shifts_s[:1], self._states[:1]

    def begin(self, tracks: Tracks, time_s: float) -> None:
        """Start from the pressures measured at a time."""
        self._time_s = time_s
        found = [tracks.of(topic.name).at(_PRESSURE, np.array([time_s]))[0] for topic in _SOURCES] - self._offsets_pa()
        for state in self._states:
            state["pressure_pa"][0] = found
            state["mass_kg"] = (
                state["pressure_pa"] * self._law["volume_m3"] / self._law["specific_energy_j_kg"][:, None]
            )

    def follow(self, tracks: Tracks, stretch: Stretch) -> list[Residual]:
        """Simulate a stretch in whole time steps, and compare it with the samples of every pressure."""
        step_s = timestep_s(self._rig)
        steps = round((stretch.end_s - self._time_s) / step_s)
        runs = [self._run(tracks, shift_s, state, steps)
                for shift_s, state in zip(self._shifts_s, self._states, strict=True)]  # fmt: skip
        grid_s = self._time_s + step_s * np.arange(steps + 1)
        self._time_s = float(grid_s[-1])
        residuals: list[Residual] = []
        for i, topic in enumerate(_SOURCES):
            time_s, measured_pa = tracks.of(topic.name).within(_PRESSURE, stretch.begin_s, stretch.end_s)
            if not len(time_s):
                continue
            made = [np.interp(time_s, grid_s, run[:, i]) for run in runs]
            timing_pa = np.max([np.abs(each - made[0]) for each in made], axis=0)
            phase = self._phase(runs[0][:, i], steps * step_s)
            if phase == "still":
                self._vented_sum_pa[i] += float((measured_pa - made[0]).sum())
                self._vented_samples[i] += len(time_s)
            residual_pa = measured_pa - self._offsets_pa()[i] - made[0]
            scaled = residual_pa / np.hypot(self._noise_pa, timing_pa)
            residuals.append(Residual(topic.name, phase, scaled))
        return residuals

    def _offsets_pa(self) -> NDArray[np.float64]:
        """Return what each sensor reads too much, Pa, shape (VOLUMES,)."""
        mean_pa = self._vented_sum_pa / np.maximum(self._vented_samples, 1.0)
        return np.clip(mean_pa, -self._largest_offset_pa, self._largest_offset_pa)

    def _run(self, tracks: Tracks, shift_s: float, state: NDArray[Any], steps: int) -> NDArray[np.float64]:
        """Return absolute pressures at the start and after each step, Pa, shape (steps + 1, VOLUMES)."""
        begin_s = self._time_s - shift_s
        track = CommandTrack(
            _timeline(tracks.of(names.PUMP_DUTY.name), begin_s),
            {channel: _timeline(tracks.of(topic.name), begin_s) for channel, topic in names.SOLENOIDS.items()},
        )
        duty, drawing = actuation(self._rig, self._law, track, steps)
        pressure_pa = np.zeros((steps + 1, records.VOLUMES))
        pressure_pa[0] = state["pressure_pa"][0]
        kernels.air_history(self._law, state, duty, drawing, pressure_pa[1:])
        return pressure_pa

    def _phase(self, pressure_pa: NDArray[np.float64], length_s: float) -> str:
        rate_pa_s = float(pressure_pa[-1] - pressure_pa[0]) / length_s
        if abs(rate_pa_s) > _STEADY_PA_S:
            return "evacuating" if rate_pa_s < 0.0 else "venting"
        ambient_pa = float(self._law["ambient_pa"][0])
        return "holding" if pressure_pa[-1] < ambient_pa - _VENTED_PA else "still"


def _timeline(track: Track, begin_s: float) -> Timeline:
    time_s, values = track.column(_DATA)
    return Timeline(time_s - begin_s, values)
