"""Measured pressure and extension to tension, simulated beside the robot."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_gap.ankle.instruments import TENSION, declared_noise
from jammkle_gap.monitor.core.followed import Residual
from jammkle_gap.monitor.core.motion import phase_of_motion
from jammkle_gap.monitor.core.subsystem import Subsystem
from jammkle_sim.physics import kernels
from jammkle_sim.physics.tendon import relaxed_state
from jammkle_sim.rigs.replay import timestep_s
from jammkle_sim.rigs.rig import laws_of

if TYPE_CHECKING:
    from jammkle_gap.monitor.core.followed import Stretch
    from jammkle_gap.monitor.core.tracks import Tracks
    from jammkle_sim.rigs.rig import Rig


_VENTED_PA = 2e3
"""Vacuum below which friction between the fibres counts for nothing. Assumed: as for the air."""


class TendonFollower:
    """Takes every tendon's law through what was measured; it remembers from one stretch to the next.

    A jammed tendon pulls by the way that it has come. Where samples of a motion were lost nobody knows that way, and
    nothing is compared until the tendons were vented and still.
    """

    subsystem = Subsystem.TENDON
    inputs = (names.TENDON_STATES.name, *(topic.name for topic in names.PRESSURES.values()))

    def __init__(self, rig: Rig) -> None:
        """Take a rig."""
        self._rig = rig
        self._step_s = timestep_s(rig)
        self._noise_n = declared_noise(rig, self._step_s)[TENSION]
        self._ambient_pa = float(laws_of(rig).pneumatics["ambient_pa"][0])
        self._states = [relaxed_state(rig.tendon_laws[i : i + 1], 0.0) for i in range(len(rig.tendon_names))]
        self._time_s = 0.0
        self._is_lost = False

    def begin(self, tracks: Tracks, time_s: float) -> None:
        """Start as if every tendon had been as long as it is for long."""
        self._time_s, self._is_lost = time_s, False
        track = tracks.of(names.TENDON_STATES.name)
        for i, tendon in enumerate(self._rig.tendon_names):
            if f"{tendon}/extension" in track.columns:
                extension_m = float(track.at(f"{tendon}/extension", np.array([time_s]))[0])
                self._states[i] = relaxed_state(self._rig.tendon_laws[i : i + 1], extension_m)

    def follow(self, tracks: Tracks, stretch: Stretch) -> list[Residual]:
        """Simulate a stretch in whole time steps, and compare it with the samples of every tension."""
        steps = round((stretch.end_s - self._time_s) / self._step_s)
        grid_s = self._time_s + self._step_s * np.arange(1, steps + 1)
        self._time_s = float(grid_s[-1])
        track = tracks.of(names.TENDON_STATES.name)
        residuals: list[Residual] = []
        phase = phase_of_motion(tracks, stretch)
        has_hole = track.has_hole(stretch.begin_s, stretch.end_s)
        self._is_lost |= has_hole and phase != "still"
        for i, tendon in enumerate(self._rig.tendon_names):
            if f"{tendon}/extension" not in track.columns:
                continue
            law = self._rig.tendon_laws[i : i + 1]
            channel = tracks.of(names.PRESSURES[names.CHANNELS[int(law["channel"][0])]].name)
            vacuum_pa = np.maximum(self._ambient_pa - channel.at("pressure", grid_s), 0.0)
            tension_n = np.zeros(steps)
            kernels.tendon_history(law, self._states[i], track.at(f"{tendon}/extension", grid_s), vacuum_pa, tension_n)
            name = f"{tendon}/tension"
            time_s, measured_n = track.within(name, stretch.begin_s, stretch.end_s)
            if len(time_s):
                scaled = (measured_n - np.interp(time_s, grid_s, tension_n)) / self._noise_n
                residuals.append(Residual(name, phase, scaled))
        if not has_hole and not self._is_lost:
            return residuals
        if self._is_lost and phase == "still" and self._is_vented(tracks, self._time_s):
            self.begin(tracks, self._time_s)
        return []

    def _is_vented(self, tracks: Tracks, time_s: float) -> bool:
        readings = [tracks.of(topic.name).at("pressure", np.array([time_s]))[0] for topic in names.PRESSURES.values()]
        return bool(min(readings) > self._ambient_pa - _VENTED_PA)
