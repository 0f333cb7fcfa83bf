"""Run a rig again from what was commanded: air, then bodies, then sensors, each from the one before, without noise."""

from __future__ import annotations

import dataclasses
import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common.names import CARRIAGE_JOINT, CHANNELS
from jammkle_sim.physics import kernels, records
from jammkle_sim.physics.pneumatics import state_at, vented_state
from jammkle_sim.rigs.model import DRIVE, release
from jammkle_sim.rigs.rig import GROUND, Event, Rig, assembled, laws_of
from jammkle_sim.rigs.simulation import UnstableSimulationError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from jammkle_sim.rigs.rig import Rig


_ON_THE_GRID = 1e-6
"""Share of a time step within which a time counts as the step's own, so that rounded stamps make no shares."""


@dataclass(frozen=True)
class Timeline:
    """A value that stays until the next one; 0 before the first."""

    time_s: NDArray[np.float64]
    """When each value begins, since the start of the rig, rising, shape (n,), s."""
    values: NDArray[np.float64]
    """Shape (n,)."""

    def at(self, time_s: float) -> float:
        """Return the value at a time."""
        place = int(np.searchsorted(self.time_s, time_s, side="right"))
        return float(self.values[place - 1]) if place else 0.0

    def later(self, delay_s: float) -> Timeline:
        """Return the same, delayed."""
        return Timeline(self.time_s + delay_s, self.values)

    def changes(self) -> Timeline:
        """Return the same without values that only repeat the one before."""
        changed = np.diff(np.concatenate(([0.0], self.values))) != 0.0
        return Timeline(self.time_s[changed], self.values[changed])

    def means(self, timestep_s: float, steps: int) -> NDArray[np.float64]:
        """Return the mean value within each of the first steps, shape (steps,)."""
        place = self.time_s / timestep_s
        place = np.where(np.abs(place - np.round(place)) < _ON_THE_GRID, np.round(place), place)
        values = np.concatenate(([0.0], self.values))
        means: NDArray[np.float64] = values[np.searchsorted(place, np.arange(steps), side="right")]
        for i in np.flatnonzero((place != np.floor(place)) & (place > 0.0) & (place < steps)).tolist():
            change = values[i + 1] - values[i]
            step = int(place[i])
            means[step] += (step + 1 - place[i]) * change
        return means


def valve_timeline(command: Timeline, dead_time_s: float, timestep_s: float) -> Timeline:
    """Return when a solenoid moves, 1 for energised, from its commands.

    It follows its command after the dead time, counted as the simulation's steps count it; a command taken back before
    that has no effect. Without steps it would be: after `dead_time_s` less one time step.

    Args:
        command: 0 or 1.
        dead_time_s: From command to movement, s.
        timestep_s: Time step, s.

    """
    command = command.changes()  # a repeated command is none: it does not begin the dead time anew
    wait_s = max(dead_time_s - timestep_s, 0.0)
    ends_s = np.append(command.time_s[1:], np.inf)
    obeyed = ends_s > command.time_s + wait_s + _ON_THE_GRID * timestep_s
    return Timeline(command.time_s[obeyed] + wait_s, command.values[obeyed]).changes()


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


def is_guided(rig: Rig) -> bool:
    """Tell whether a rig's shank is guided, whatever hangs on it."""
    return len(rig.guide) > 0


def has_ground(rig: Rig) -> bool:
    """Tell whether a rig has ground to stand on."""
    return any(rig.model.geom(i).name == GROUND for i in range(rig.model.ngeom))


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


@dataclass(frozen=True)
class CommandTrack:
    """What pump and solenoids were commanded, since the start of the rig."""

    duty: Timeline
    """0 to 1."""
    solenoids: Mapping[str, Timeline]
    """By channel, 0 or 1; a channel that is missing stays vented."""


@dataclass(frozen=True)
class BodyTrack:
    """What bodies and tendons did, after every time step; the first row is after the first step."""

    joints: tuple[str, ...]
    tendons: tuple[str, ...]
    rows: NDArray[np.float64]
    """Shape (n, records.row_width(joints, tendons)); the IMU's columns are raw."""

    @property
    def raw_imu(self) -> NDArray[np.float64]:
        """Specific force, m/s^2, and angular velocity, rad/s, shape (n, 6)."""
        return self.rows[:, : records.IMU_AXES]

    @property
    def load_cell_n(self) -> NDArray[np.float64]:
        """Force, N, shape (n, 3)."""
        return self.rows[:, records.IMU_AXES : records.IMU_AXES + records.LOAD_CELL_AXES]

    def position(self, joint: str) -> NDArray[np.float64]:
        """Angle, rad, or slide, m, shape (n,)."""
        return self.rows[:, records.IMU_AXES + records.LOAD_CELL_AXES + self.joints.index(joint)]

    def velocity(self, joint: str) -> NDArray[np.float64]:
        """Rate of the same, shape (n,)."""
        first = records.IMU_AXES + records.LOAD_CELL_AXES + len(self.joints)
        return self.rows[:, first + self.joints.index(joint)]

    def extension_m(self, tendon: str) -> NDArray[np.float64]:
        """Length beyond the free length, shape (n,), m."""
        return self.rows[:, self._tendon(tendon)]

    def tension_n(self, tendon: str) -> NDArray[np.float64]:
        """Pull, shape (n,), N."""
        return self.rows[:, self._tendon(tendon) + 2]

    def _tendon(self, tendon: str) -> int:
        first = records.IMU_AXES + records.LOAD_CELL_AXES + 2 * len(self.joints)
        return first + records.TENDON_COLUMNS * self.tendons.index(tendon)


def timestep_s(rig: Rig) -> float:
    """Time step of a rig, s."""
    return float(rig.model.opt.timestep)


def air(
    rig: Rig, commands: CommandTrack, steps: int, start_pa: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Run the air alone.

    Args:
        rig: Whose air.
        commands: Of pump and solenoids.
        steps: Time steps.
        start_pa: Absolute pressures at the start, shape (VOLUMES,), Pa; without, all are vented.

    Returns:
        Absolute pressures, Pa, shape (steps + 1, VOLUMES): at the start, then after each step.

    """
    law = laws_of(rig).pneumatics
    state = vented_state(law) if start_pa is None else state_at(law, start_pa)
    duty, drawing = actuation(rig, law, commands, steps)
    pressure_pa = np.zeros((steps + 1, records.VOLUMES))
    pressure_pa[0] = state["pressure_pa"][0]
    kernels.air_history(law, state, duty, drawing, pressure_pa[1:])
    return pressure_pa


def actuation(
    rig: Rig, law: NDArray[Any], commands: CommandTrack, steps: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the pump's duty, shape (steps,), and each valve's share of drawing, shape (steps, VALVES), per step."""
    step_s, delay_s = timestep_s(rig), rig.wiring.command_delay_s
    duty = commands.duty.later(delay_s).means(step_s, steps)
    drawing = np.zeros((steps, records.VALVES))
    for i, channel in enumerate(CHANNELS):
        if channel in commands.solenoids:
            command = commands.solenoids[channel].later(delay_s)
            dead_time_s = float(law["valve_dead_time_s"][0, i])
            drawing[:, i] = valve_timeline(command, dead_time_s, step_s).means(step_s, steps)
    return duty, drawing


class Bodies:
    """Bodies and tendons of one rig, from its start on, at pressures or tensions that are given."""

    def __init__(self, rig: Rig) -> None:
        """Put the rig together, in its pose.

        Args:
            rig: What is run.

        """
        self._rig = rig
        self.parts = assembled(rig)
        """What is advanced; its data may be changed."""
        self.states = records.States(*(part.copy() for part in self.parts.ankle.states))
        """Memory of the laws, which may be changed."""
        self.raw_imu_at_start = self.parts.ankle.body.raw_imu.copy()
        """Raw sample of the IMU before the first step, shape (6,)."""
        self._step = 0

    def follow(self, pressure_pa: NDArray[np.float64]) -> BodyTrack:
        """Take one step per row of pressures, those within each step, shape (n, VOLUMES), Pa.

        Raises:
            UnstableSimulationError: the simulation blew up.

        """
        parts, probe = self.parts.ankle, self.parts.probe
        return self._run(
            pressure_pa,
            lambda given, rows: kernels.body_history(parts.laws, self.states, parts.body, probe, given, rows),
        )

    def driven(self, tension_n: NDArray[np.float64]) -> BodyTrack:
        """Take one step per row of tensions, shape (n, tendons), N, the tendons' own laws being left out.

        Raises:
            UnstableSimulationError: the simulation blew up.

        """
        parts, probe = self.parts.ankle, self.parts.probe
        return self._run(
            tension_n,
            lambda given, rows: kernels.driven_history(parts.laws, self.states, parts.body, probe, given, rows),
        )

    def jump(self, step: int) -> None:
        """Go on as if at a later step: what the rig does before it is done, but no time passes."""
        for event in self._rig.events:
            if self._step <= event.step < step:
                event.act(self.parts.data)
        self._step = step

    def _run(self, given: NDArray[np.float64], advance: Callable[[Any, Any], int]) -> BodyTrack:
        if not self.parts.ankle.body.addresses.all():
            msg = "a recording cannot be run again here: MuJoCo's library cannot be called directly"
            raise UnstableSimulationError(msg)
        rows = np.zeros((len(given), records.row_width(len(self.parts.joints), len(self._rig.tendon_names))))
        begin, end = self._step, self._step + len(given)
        due: dict[int, list[Event]] = {begin: [], end: []}
        for event in self._rig.events:
            if begin <= event.step < end:
                due.setdefault(event.step, []).append(event)
        for first, last in itertools.pairwise(sorted(due)):
            for event in due[first]:
                event.act(self.parts.data)
            part = slice(first - begin, last - begin)
            self._step = first + advance(given[part], rows[part])
            if self._step != last:
                time_s = self._step * timestep_s(self._rig)
                msg = f"simulation of rig '{self._rig.name}' became unstable {time_s:g} s after its start"
                raise UnstableSimulationError(msg)
        return BodyTrack(self.parts.joints, self._rig.tendon_names, rows)
