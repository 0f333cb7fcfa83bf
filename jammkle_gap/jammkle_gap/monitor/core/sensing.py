"""What the IMU must read where nothing moves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_gap.ankle.instruments import ACCELERATION, RATE, declared_noise
from jammkle_gap.monitor.core.followed import Residual, Stretch
from jammkle_gap.monitor.core.motion import phase_of_motion
from jammkle_gap.monitor.core.subsystem import Subsystem
from jammkle_sim.rigs.replay import timestep_s
from jammkle_sim.rigs.rig import imu_at_rest, laws_of

if TYPE_CHECKING:
    from jammkle_gap.monitor.core.tracks import Tracks
    from jammkle_sim.rigs.rig import Rig

_SETTLE_S = 0.1
"""How long after a motion nothing is said of the IMU. Assumed: twice as long as anything rings."""
_AXES = tuple(f"specific_force_{axis}" for axis in "xyz") + tuple(f"angular_velocity_{axis}" for axis in "xyz")


class SensingFollower:
    """Compares the IMU with gravity while the slide, which carries it, stands still."""

    subsystem = Subsystem.SENSING
    inputs = (names.IMU.name, names.JOINT_STATES.name)

    def __init__(self, rig: Rig) -> None:
        """Take a rig."""
        raw = np.array([0.0, 0.0, -float(rig.model.opt.gravity[2]), 0.0, 0.0, 0.0])
        self._at_rest = imu_at_rest(laws_of(rig).imu, raw)["second"][0]
        noise = declared_noise(rig, timestep_s(rig))
        self._noise = [noise[ACCELERATION]] * 3 + [noise[RATE]] * 3
        self._still_since_s = float("inf")

    def begin(self, tracks: Tracks, time_s: float) -> None:
        """Begin; nothing is remembered."""
        del tracks
        self._still_since_s = time_s

    def follow(self, tracks: Tracks, stretch: Stretch) -> list[Residual]:
        """Compare a stretch; one in motion, or soon after, says nothing of the sensor."""
        if phase_of_motion(tracks, stretch) != "still":
            self._still_since_s = stretch.end_s
            return []
        if stretch.begin_s < self._still_since_s + _SETTLE_S:
            return []
        track = tracks.of(names.IMU.name)
        residuals: list[Residual] = []
        for axis, expected, noise in zip(_AXES, self._at_rest.tolist(), self._noise, strict=True):
            _, measured = track.within(axis, stretch.begin_s, stretch.end_s)
            if len(measured):
                signal = f"{names.IMU.name.split('/')[0]}/{axis}"
                residuals.append(Residual(signal, "still", (measured - expected) / noise))
        return residuals
