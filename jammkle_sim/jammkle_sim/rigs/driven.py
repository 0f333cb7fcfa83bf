"""A rig made to move as it was seen to: its drive follows a measured course, its carriage is let go when it was."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common.names import CARRIAGE_JOINT
from jammkle_sim.rigs.model import DRIVE, release
from jammkle_sim.rigs.rig import Event, Rig

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Course:
    """Where a driven carriage was over time: straight lines between corners, still before the first and after the last.

    The corners need not be far apart: a course of any shape is made of short lines.
    """

    time_s: NDArray[np.float64]
    """Of the corners, since the start of the rig, rising, shape (n,), s."""
    position_m: NDArray[np.float64]
    """Shape (n,), m, as the carriage's joint reads."""

    def at(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where the carriage is, m, at times, s."""
        position_m: NDArray[np.float64] = np.interp(time_s, self.time_s, self.position_m)
        return position_m

    @property
    def start_m(self) -> float:
        """Where it is at the start of the rig, m."""
        return float(np.interp(0.0, self.time_s, self.position_m))

    def as_read_by(self, delay_s: float, clock_skew: float) -> Course:
        """Return the course that a sensor reads as this one: it is late, by a clock that runs faster.

        Args:
            delay_s: From a motion to its reading, s.
            clock_skew: How much faster the sensor's clock runs, 1.

        """
        return dataclasses.replace(self, time_s=true_time_s(self.time_s, delay_s, clock_skew))


def true_time_s(time_s: Any, delay_s: float, clock_skew: float) -> Any:
    """Return when that happened which a late sensor with a fast clock stamps with these times, s."""
    return time_s / (1.0 + clock_skew) - delay_s


def is_driven(rig: Rig) -> bool:
    """Tell whether a rig's carriage is moved by a drive; others let it go or hold it."""
    return any(rig.model.actuator(i).name == DRIVE for i in range(rig.model.nu))


def started_at(rig: Rig, position_m: float) -> Rig:
    """Return a driven rig whose carriage starts elsewhere, its tendons at rest there; the same where it does so anyway.

    Args:
        rig: With a drive; not touched.
        position_m: As the carriage's joint reads.

    """
    spec = rig.spec.copy()
    start = np.array(spec.keys[0].qpos) if spec.keys else rig.model.qpos0.copy()
    address = rig.model.joint(CARRIAGE_JOINT).qposadr[0]
    if start[address] == position_m:
        return rig
    start[address] = position_m
    key = spec.keys[0] if spec.keys else spec.add_key(name="start")
    key.qpos, key.act = start, np.array([position_m])
    return dataclasses.replace(rig, spec=spec, model=spec.compile())


def following(rig: Rig, course: Course) -> Rig:
    """Return a driven rig whose carriage follows a course from the start on, in place of what it does by itself.

    The drive's servo is critically damped against the speed, not the speed's error: it lags behind a steady motion by
    its damping over its stiffness, which is put in front. What is left at a corner, where the speed changes by v, is
    below v / (e * its natural frequency): 10 um for 20 mm/s.

    Args:
        rig: With a drive; not touched.
        course: Where the carriage is.

    """
    step_s = float(rig.model.opt.timestep)
    drive = rig.model.actuator(DRIVE)
    lead_s, activation = float(drive.biasprm[2] / drive.biasprm[1]), int(drive.actadr[0])
    corners = course.time_s[course.time_s > 0.0] / step_s
    # The steps before and after each corner: at every step between the carriage is then exactly on course.
    steps = np.unique(np.concatenate(([0], np.floor(corners).astype(int), np.ceil(corners).astype(int))))
    position_m = course.at(step_s * steps)
    speed_m_s = np.append(np.diff(position_m) / (step_s * np.diff(steps)), 0.0)
    before_m_s = np.concatenate(([0.0], speed_m_s[:-1]))
    # Where the speed stays, the drive's own integral goes on.
    events = tuple(
        Event(int(step), _SetDrive(activation, drive.id, float(place) + lead_s * float(speed), float(speed)))
        for step, place, speed, before in zip(steps, position_m, speed_m_s, before_m_s, strict=True)
        if step == 0 or speed != before
    )
    return dataclasses.replace(rig, events=events)


def let_go(rig: Rig, at_s: float) -> Rig:
    """Return a rig with a held carriage that lets it go at a time, s, to the nearest step, and does nothing else."""
    step = max(round(at_s / float(rig.model.opt.timestep)), 0)
    return dataclasses.replace(rig, events=(Event(step, release),))


@dataclass(frozen=True)
class _SetDrive:
    """Puts a drive where it must be to have its carriage on course, moving at a speed."""

    activation: int
    """Where the drive's integral stands in MuJoCo's activations."""
    control: int
    """Where its speed stands in MuJoCo's controls."""
    target_m: float
    speed_m_s: float

    def __call__(self, data: Any) -> None:
        """Set both."""
        data.act[self.activation] = self.target_m
        data.ctrl[self.control] = self.speed_m_s
