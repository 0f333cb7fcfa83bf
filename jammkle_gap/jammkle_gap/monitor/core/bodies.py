"""Measured tension to motion, simulated beside the robot from its measured state again and again."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_gap.ankle.instruments import ANGLE, SLIDE, quantity_of
from jammkle_gap.monitor.core.followed import Residual
from jammkle_gap.monitor.core.motion import phase_of_motion
from jammkle_gap.monitor.core.subsystem import Subsystem
from jammkle_sim.rigs.replay import Bodies, timestep_s

if TYPE_CHECKING:
    from jammkle_gap.monitor.core.followed import Stretch
    from jammkle_gap.monitor.core.tracks import Tracks
    from jammkle_sim.rigs.replay import BodyTrack
    from jammkle_sim.rigs.rig import Rig

_NOISE = {ANGLE: 5e-4, SLIDE: 2e-5}
"""Scatter of single readings, rad and m. Assumed: the rounding of a 12-bit encoder and of a linear scale of 0.05 mm, a
little more than step / sqrt(12); a diagnosis takes the steps themselves, since it averages over many readings."""
_HELD_M = 0.002
"""Distance from the height at which the rig holds its slide, within which a slide counts as held. Assumed."""


class BodyFollower:
    """Puts the bodies where they were measured at the start of every stretch, and pulls as was measured.

    Forces are not compared: in contact they follow the smallest error of a measured height. In an impact the pull
    changes within one interval between two samples; the bodies are then also run by one that comes half an interval
    earlier and later, and what lies between counts as noise.
    """

    subsystem = Subsystem.MECHANICS
    inputs = (names.JOINT_STATES.name, names.TENDON_STATES.name)

    def __init__(self, rig: Rig) -> None:
        """Take a rig whose slide is held and let go."""
        self._rig = rig
        self._step_s = timestep_s(rig)
        # What the rig does by itself, and when, is not the twin's: it sees whether the slide is held.
        self._bodies = Bodies(dataclasses.replace(rig, events=()))
        self._joints = self._bodies.parts.joints
        self._start_m = float(self._bodies.parts.data.joint(names.CARRIAGE_JOINT).qpos[0])
        self._hold = self._bodies.parts.data.eq_active.copy()

    def begin(self, tracks: Tracks, time_s: float) -> None:
        """Begin; every stretch starts from what is measured anyway."""

    def follow(self, tracks: Tracks, stretch: Stretch) -> list[Residual]:
        """Simulate a stretch from its first measured state, and compare the joints."""
        joints, tendons = tracks.of(names.JOINT_STATES.name), tracks.of(names.TENDON_STATES.name)
        wanted = [f"{name}/position" for name in self._joints]
        pulls = [f"{tendon}/tension" for tendon in self._rig.tendon_names]
        if not set(wanted) <= set(joints.columns) or not set(pulls) <= set(tendons.columns):
            return []
        if joints.has_hole(stretch.begin_s, stretch.end_s) or tendons.has_hole(stretch.begin_s, stretch.end_s):
            return []
        begin, steps = np.array([stretch.begin_s]), round((stretch.end_s - stretch.begin_s) / self._step_s)
        phase = phase_of_motion(tracks, stretch)
        height_m = float(joints.at(f"{names.CARRIAGE_JOINT}/position", begin)[0])
        at_hold = abs(height_m - self._start_m) < _HELD_M
        if at_hold and phase != "still":
            return []  # it is let go, and nobody says when
        grid_s = stretch.begin_s + self._step_s * np.arange(1, steps + 1)
        shift_s = 0.5 * tendons.interval_s
        runs: list[BodyTrack] = []
        for late_s in (0.0, -shift_s, shift_s) if phase == "impact" else (0.0,):
            data = self._bodies.parts.data
            for name in self._joints:
                data.joint(name).qpos[0] = joints.at(f"{name}/position", begin)[0]
                data.joint(name).qvel[0] = joints.at(f"{name}/velocity", begin)[0]
            data.eq_active[:] = self._hold if at_hold else 0
            pull_n = np.maximum(np.column_stack([tendons.at(pull, grid_s - late_s) for pull in pulls]), 0.0)
            runs.append(self._bodies.driven(pull_n))
        residuals: list[Residual] = []
        for name, signal in zip(self._joints, wanted, strict=True):
            time_s, measured = joints.within(signal, stretch.begin_s, stretch.end_s)
            if len(time_s):
                made = [np.interp(time_s, grid_s, run.position(name)) for run in runs]
                noise = np.hypot(
                    _NOISE[SLIDE if quantity_of(signal) == SLIDE else ANGLE],
                    np.max([np.abs(each - made[0]) for each in made], axis=0),
                )
                residuals.append(Residual(signal, phase, (measured - made[0]) / noise))
        return residuals
