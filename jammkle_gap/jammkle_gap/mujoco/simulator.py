"""Runs a robot's recordings again: in windows that start at its measured state, or backwards from motion to effort."""

from __future__ import annotations

import copy
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from mujoco import rollout  # type: ignore[import-untyped]  # carries no types
from scipy.signal import lfilter  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.core.features import new_readings
from jammkle_gap.core.simulate import InfeasibleError
from jammkle_gap.mujoco.coupled import Equalities
from jammkle_gap.mujoco.nonideal import Nonidealities, backlash_offset, update_friction
from jammkle_gap.mujoco.prescribed import COORDINATES, controls_of, coordinates_of, drive_of, state_of
from jammkle_gap.mujoco.robot import EFFORT_SENSOR, sensor_name
from jammkle_gap.mujoco.runs import AXES, BASE_COLUMNS, Base, Quantity
from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.data import Recording, Signal
    from jammkle_gap.mujoco.robot import Robot

    Array = NDArray[np.float64]
    Change = Callable[["Machine", Sequence[float]], None]
    """Makes an effect, or a constant of the machine, of the values of its parameters, in order."""
    Changes = Mapping[str, tuple[tuple[str, ...], tuple[float, ...], Change]]
    """By constant or effect: keys of its values, at which values it does nothing, and its change."""

BASE = "base"
"""Of signals of a free base that was measured: `base/x` and so on."""
LEAD_S = 0.2
"""How long a window runs before it is compared, s. Chosen: a drive of 3 Hz forgets its start to a fortieth."""
_WILD = 1e4
"""Position, rad or m, or speed at which a run has blown up."""
FORWARD_FROM_S = 0.02
"""Stretch over which the rate of a set point is taken, s. Chosen: set points come at 50 Hz or more often."""


@dataclass(frozen=True)
class Motion:
    """What is needed to run one recording again; the `inputs` of its `Recording`."""

    begin_s: float
    """When the grid below begins, on the recording's clock, s."""
    step_s: float
    """Of the grid of times below, s."""
    position: Array
    """Measured and smoothed on the grid, shape (n, joints), rad or m."""
    velocity: Array
    """Shape (n, joints)."""
    acceleration: Array
    """Shape (n, joints)."""
    set_points: Array
    """Commanded on the grid, shape (n, drives)."""
    fed_velocity: Array
    """Commanded velocities, 0 where none are fed forward, shape (n, drives)."""
    fed_effort: Array
    """Commanded efforts that are fed forward, 0 where none are, shape (n, drives), N m or N."""
    starts_s: tuple[float, ...]
    """When each window that is compared begins, s."""
    window_s: float
    """How long it is, s."""
    prescribed: Array | None = None
    """Position, velocity and acceleration of the joints that move as measured, on the grid, shape (3, n, joints)."""
    base: Array | None = None
    """Coordinates of a free base that was measured, and their rates, on the grid, shape (2, n, 6)."""
    unheld: tuple[str, ...] = ()
    """Joints that no drive holds at a position, and the coordinates of a free base: errors of their start last."""
    start_shift: Array | None = None
    """Of their positions and then velocities at the start of each window, shape (windows, 2 unheld)."""
    sensitivity: Mapping[str, Array] = field(default_factory=dict)
    """By signal, what one standard deviation of each such error makes of it, shape (samples, 2 unheld)."""

    @property
    def end_s(self) -> float:
        """Time of the last sample of the grid, s."""
        return self.step_s * (len(self.position) - 1)


@dataclass
class Machine(Nonidealities):
    """A robot as it may be: its model, and the nonidealities beside it."""

    robot: Robot
    model: mujoco.MjModel

    @cached_property
    def data(self) -> mujoco.MjData:
        """Room to run the model in; what it holds is of the run before."""
        return mujoco.MjData(self.model)


@dataclass(frozen=True)
class RobotSimulator:
    """Runs recordings of a robot again, with effects and constants."""

    robot: Robot
    changes: Changes
    """Made in turn: a machine is within its tolerances before anything is wrong with it."""

    def machine(self, values: Mapping[str, float]) -> Machine:
        """Return the machine with some values.

        Raises:
            InfeasibleError: no such machine can be.

        """
        machine = Machine(self.robot, copy.copy(self.robot.model))
        asked = {key if key in self.changes else key.rpartition(".")[0] for key in values}
        for name, (keys, nulls, change) in self.changes.items():
            if name not in asked:
                continue
            own = [values.get(key, null) for key, null in zip(keys, nulls, strict=True)]
            if any(value != null for value, null in zip(own, nulls, strict=True)):
                change(machine, own)
        model = machine.model
        if (model.body_mass < 0.0).any() or (model.dof_armature < 0.0).any():
            msg = "a mass or an armature is below 0"
            raise InfeasibleError(msg)
        mujoco.mj_setConst(model, machine.data)
        return machine

    def __call__(self, recording: Recording, values: Mapping[str, float]) -> dict[str, Array]:
        """Return what would have been read, by signal at its times."""
        return run(self.machine(values), recording)


def run(machine: Machine, recording: Recording) -> dict[str, Array]:
    """Return what would have been read of a machine, by signal at its times.

    Raises:
        InfeasibleError: it blows up.

    """
    motion: Motion = recording.inputs
    if not machine.robot.drives:
        return _backward(machine, motion, recording)
    return _from_likely_starts(motion, recording, run_forward(machine, motion, recording))


def _from_likely_starts(motion: Motion, recording: Recording, made: dict[str, Array]) -> dict[str, Array]:
    """Return what would have been read from the most probable starts of the windows.

    Errors of the measured start last in a joint that swings freely. They are linear, have a prior, and are eliminated
    window by window (variable projection: Golub and Pereyra 2003, Inverse Problems 19:R1).
    """
    if not motion.sensitivity:
        return made
    count = len(motion.starts_s)
    left = {each.name: (each.values - made[each.name]) / scale_of(each) for each in recording.signals}
    shares = np.zeros((count, 2 * len(motion.unheld)))
    places = {each.name: np.minimum((each.time_s / motion.window_s).astype(int), count - 1)
              for each in recording.signals}  # fmt: skip
    for window in range(count):
        rows = [motion.sensitivity[name][places[name] == window] / scale_of(recording.signal(name)) for name in left]
        table, rest = np.concatenate(rows), np.concatenate([left[name][places[name] == window] for name in left])
        shares[window] = np.linalg.solve(table.T @ table + np.eye(table.shape[1]), table.T @ rest)
    return {
        name: values + (motion.sensitivity[name] * shares[places[name]]).sum(axis=1) for name, values in made.items()
    }


def scale_of(signal: Signal) -> float:
    """Return the standard deviation of one reading: declared, or estimated."""
    return signal.deviation or deviation_of(signal.values)


def deviation_of(values: Array) -> float:
    """Return the standard deviation of one reading, by second differences (Gasser et al. 1986, Biometrika 73:625)."""
    values = values[new_readings(values)]
    second = values[1:-1] - 0.5 * (values[:-2] + values[2:])
    blocks = [float(np.square(each).mean()) for each in np.array_split(second, _BLOCKS) if each.size]
    steps = np.diff(np.unique(values))
    rounding = float(steps.min()) / np.sqrt(12.0) if steps.size else 0.0
    return float(max(np.sqrt(np.median(blocks) / 1.5), rounding))  # of a moving joint the blocks hold the rounding


_BLOCKS = 8
"""Stretches of which the median is taken, so that fast motion in some does not count."""


def run_forward(machine: Machine, motion: Motion, recording: Recording) -> dict[str, Array]:
    """Run every window and read its sensors.

    Raises:
        InfeasibleError: it blows up.

    """
    robot, model = machine.robot, machine.model
    windows = _Windows(machine, motion)
    controls, starts = windows.controls(), windows.starts()
    joints = [int(model.joint(name).qposadr[0]) for name in robot.joints]
    if robot.floating:
        first = int(model.joint(robot.floating).qposadr[0])
        joints += range(first, first + len(BASE_COLUMNS))
    sensed = list(dict.fromkeys((*robot.efforts, *(each.joint for each in robot.drives))))
    sensors = [int(model.sensor(f"{EFFORT_SENSOR}{name}").adr[0]) for name in sensed] + _addresses(machine)
    if machine.stribeck or machine.load_friction or machine.slack:
        position, read = _stepped(machine, starts, controls, joints, sensors)
    else:
        states, everything = rollout.rollout(model, machine.data, starts, controls)
        position = np.concatenate([starts[:, np.newaxis, 1:][:, :, joints], states[:, :-1, 1:][:, :, joints]], axis=1)
        read = everything[:, :, sensors]
    if not np.isfinite(position).all() or np.abs(position).max() > _WILD:
        msg = "the simulation blows up"
        raise InfeasibleError(msg)
    ticks_s = windows.step_s * np.arange(windows.count, dtype=np.float64)
    as_they_are = _sensor_readings(machine, read[:, :, len(sensed) :])
    if robot.floating:
        poses = np.array([coordinates_of(each) for each in position[:, :, len(robot.joints) :]])
        poses += windows.full_turns(poses[:, 0])[:, np.newaxis]
        as_they_are.update({f"{BASE}/{name}": poses[:, :, column] for column, name in enumerate(COORDINATES)})
    # A controller reads before it writes: an effort is that of the step before.
    efforts = np.concatenate([read[:, :1], read[:, :-1]], axis=1)
    found = {}
    for signal in recording.signals:
        joint, _, quantity = signal.name.rpartition("/")
        if signal.name in as_they_are:
            found[signal.name] = windows.interpolated(ticks_s, as_they_are[signal.name], signal.time_s)
        elif quantity == Quantity.POSITION.value:
            effort = efforts[:, :, sensed.index(joint)] if joint in machine.compliance else 0.0
            values = machine.read_position(joint, position[:, :, robot.joints.index(joint)], effort)
            found[signal.name] = windows.interpolated(ticks_s, values, signal.time_s)
        else:
            values = efforts[:, :, sensed.index(joint)]
            made = windows.interpolated(ticks_s + machine.effort_delay_s, values, signal.time_s)
            made += windows.between_ticks(controls, joint, signal.time_s, made)
            found[signal.name] = machine.effort_scale.get(joint, 1.0) * made
    return found


class _Windows:
    """The windows of a recording in one forward run: starts, controls, and where its readings lie in them."""

    def __init__(self, machine: Machine, motion: Motion) -> None:
        self._machine, self._motion, self._model = machine, motion, machine.model
        self.step_s = float(machine.model.opt.timestep)
        length_s = motion.window_s + LEAD_S
        if machine.robot.given.base is Base.FREE and motion.base is None:
            length_s = motion.end_s
        self.count = int(np.ceil(length_s / (1.0 + min(machine.clock_rate, 0.0)) / self.step_s)) + 1
        """Steps of each."""
        self._clock = 1.0 + machine.clock_rate
        """Time of the readings' clock per time."""
        self._begins_s = np.array(motion.starts_s) / self._clock - LEAD_S
        self._grid_s = motion.step_s * np.arange(len(motion.position))
        self._set_points = _effective_set_points(machine, motion)

    def controls(self) -> Array:
        """Return what is commanded during each step, on the mean, shape (windows, count, actuators)."""
        machine, model, grid_s = self._machine, self._model, self._grid_s
        steps_s = self._begins_s[:, np.newaxis] + self.step_s * np.arange(self.count)
        at_s = np.clip(steps_s - machine.delay_s - machine.arrival_s, 0.0, grid_s[-1] - self.step_s)
        found = np.zeros((*steps_s.shape, model.nu))
        for drive, own in zip(machine.robot.drives, self._set_points.T, strict=True):
            area = np.concatenate(([0.0], np.cumsum(0.5 * self._motion.step_s * (own[1:] + own[:-1]))))
            taken = np.interp(at_s + self.step_s, grid_s, area) - np.interp(at_s, grid_s, area)
            found[:, :, int(model.actuator(drive.actuator).id)] = taken / self.step_s
        if self._motion.prescribed is not None:
            per_time = np.power(self._clock, [0, 1, 2])[:, np.newaxis, np.newaxis]  # of positions and derivatives
            asked = controls_of(self._motion.prescribed * per_time)
            for name, own in zip(machine.robot.prescribed, asked.T, strict=True):
                found[:, :, int(model.actuator(drive_of(name)).id)] = np.interp(steps_s * self._clock, grid_s, own)
        return found

    def starts(self) -> Array:
        """Return the states that windows start from, as their sensors would have read them, shape (windows, state)."""
        machine, motion, model, grid_s = self._machine, self._motion, self._model, self._grid_s
        states = np.zeros((len(self._begins_s), mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
        positions, velocities = states[:, 1 : 1 + model.nq], states[:, 1 + model.nq : 1 + model.nq + model.nv]
        positions[:] = model.qpos0
        read_s = self._begins_s * self._clock
        for column, name in enumerate(machine.robot.joints):
            at, dof = _places(model, name)
            scale, zero = machine.scale.get(name, 1.0), machine.read_position(name, 0.0, 0.0)
            positions[:, at] = (np.interp(read_s, grid_s, motion.position[:, column]) - zero) / scale
            velocities[:, dof] = self._clock * np.interp(read_s, grid_s, motion.velocity[:, column]) / scale
        if motion.prescribed is not None:
            for column, name in enumerate(machine.robot.prescribed):
                at, dof = _places(model, name)
                positions[:, at] = np.interp(read_s, grid_s, motion.prescribed[0, :, column])
                velocities[:, dof] = self._clock * np.interp(read_s, grid_s, motion.prescribed[1, :, column])
        none = np.zeros((len(states), 2 * len(motion.unheld)))
        shifts = (none if motion.start_shift is None else motion.start_shift).reshape(len(states), 2, -1)
        for column, name in enumerate(motion.unheld):
            if name in machine.robot.joints:
                at, dof = _places(model, name)
                positions[:, at] += shifts[:, 0, column]
                velocities[:, dof] += shifts[:, 1, column]
        if motion.base is not None:
            self._put_base(positions, velocities, read_s, shifts)
        if machine.robot.followers:
            equalities = Equalities(model, machine.robot.following())
            for position, velocity in zip(positions, velocities, strict=True):
                position[:] = equalities.placed(position)
                velocity[:] = equalities.moved(position, velocity)
        return states

    def _put_base(self, positions: Array, velocities: Array, read_s: Array, shifts: Array) -> None:
        """Put where a free base was measured at some times into the starts of windows."""
        base = np.array(self._motion.base)
        at, dof = _places(self._model, self._machine.robot.floating)
        of_base = [column for column, name in enumerate(self._motion.unheld) if name in COORDINATES]
        for k, read_at_s in enumerate(read_s):
            table = np.array([[np.interp(read_at_s, self._grid_s, own) for own in each.T] for each in base])
            table[1] *= self._clock
            pose, twist = state_of(*(table + shifts[k][:, of_base] if of_base else table))
            positions[k, at : at + len(pose)], velocities[k, dof : dof + len(twist)] = pose, twist

    def full_turns(self, coordinates: Array) -> Array:
        """Return the full turns by which a base at the start of each window lies off its measurement, (windows, 6)."""
        base, read_s = np.array(self._motion.base), self._begins_s * self._clock
        measured = np.column_stack([np.interp(read_s, self._grid_s, own) for own in base[0].T])
        turns: Array = 2.0 * np.pi * np.round((measured - coordinates) / (2.0 * np.pi))
        turns[:, : len(AXES)] = 0.0
        return turns

    def _taken_at(self, time_s: Array) -> tuple[Array, NDArray[np.intp]]:
        """Return when readings were really taken, s since the start of the recording, and the window of each."""
        motion = self._motion
        window = np.minimum((time_s / motion.window_s).astype(np.intp), len(motion.starts_s) - 1)
        stamp_s = np.array(motion.starts_s)[window] + time_s - window * motion.window_s
        return stamp_s / self._clock, window

    def interpolated(self, ticks_s: Array, values: Array, time_s: Array) -> Array:
        """Return the readings of one quantity at the times of its signal, by when they were really taken.

        `values`, shape (windows, count), are there to be read at `ticks_s` after each window begins.
        """
        real_s, window = self._taken_at(time_s)
        found = np.empty_like(time_s)
        for k, begin_s in enumerate(self._begins_s):
            own = window == k
            found[own] = np.interp(real_s[own] - begin_s, ticks_s, values[k])
        return found

    def between_ticks(self, controls: Array, joint: str, time_s: Array, made: Array) -> Array:
        """Return what the effort of a drive differs by between the model's steps, as its set point comes in steps.

        `controls` are those of every step, and `made` are efforts at `time_s`, straight from step to step, N m or N.
        """
        machine = self._machine
        columns = [column for column, each in enumerate(machine.robot.drives) if each.joint == joint]
        if not columns:
            return np.zeros_like(time_s)
        actuator = self._model.actuator(machine.robot.drives[columns[0]].actuator)
        at_s, window = self._taken_at(time_s)
        at_s -= machine.effort_delay_s
        found = np.empty_like(time_s)
        # An effort is that of the step before: its set point is that of the middle of this step.
        ticks_s = self.step_s * np.arange(1, self.count + 1)
        late_s = 0.5 * self.step_s + machine.delay_s + machine.arrival_s
        for k, begin_s in enumerate(self._begins_s):
            own = window == k
            exact = np.interp(at_s[own] - late_s, self._grid_s, self._set_points[:, columns[0]])
            found[own] = exact - np.interp(at_s[own] - begin_s, ticks_s, controls[k, :, int(actuator.id)])
        found *= float(actuator.gainprm[0])
        number = int(self._model.joint(joint).id)
        for is_limited, (low, high) in (
            (self._model.actuator_forcelimited[actuator.id], actuator.forcerange),
            (self._model.jnt_actfrclimited[number], self._model.jnt_actfrcrange[number]),
        ):
            if is_limited:
                within = (made > _NEARLY * low) & (made < _NEARLY * high)
                found = np.where(within, np.clip(made + found, low, high) - made, 0.0)
        return found


_NEARLY = 0.95
"""Share of its limit from which on an effort is taken for limited."""


def _places(model: mujoco.MjModel, joint: str) -> tuple[int, int]:
    """Return where a joint begins in `qpos` and in `qvel`."""
    own = model.joint(joint)
    return int(own.qposadr[0]), int(own.dofadr[0])


def _effective_set_points(machine: Machine, motion: Motion) -> Array:
    """Return what drives make of their set points and of what is fed forward, shape (n, drives)."""
    model = machine.model
    found = np.empty_like(motion.set_points)
    for column, drive in enumerate(machine.robot.drives):
        asked = motion.set_points[:, column]
        lag_s = machine.set_point_lag_s.get(drive.joint, 0.0)
        if lag_s > 0.0:
            share = 1.0 - np.exp(-motion.step_s / lag_s)
            asked = lfilter([share], [1.0, share - 1.0], asked, zi=[(1.0 - share) * asked[0]])[0]
        actuator = model.actuator(drive.actuator)
        if drive.quantity is Quantity.POSITION:
            kp, kd = float(actuator.gainprm[0]), -float(actuator.biasprm[2])
            forward = machine.forward_share.get(drive.joint, 0.0)
            rate = motion.fed_velocity[:, column] if drive.feeds_velocity else np.zeros_like(asked)
            if forward != 0.0:
                half = max(int(FORWARD_FROM_S / motion.step_s), 1)
                padded = np.pad(asked, half, mode="edge")
                rate = rate + forward * (padded[2 * half :] - padded[: -2 * half]) / (2.0 * half * motion.step_s)
            asked = asked + kd / kp * rate
        if drive.feeds_effort:
            arriving = machine.fed_share.get(drive.joint, 1.0) * motion.fed_effort[:, column]
            asked = asked + arriving / float(actuator.gainprm[0])
        # Drives regulate what their encoders read.
        scale, offset = machine.scale.get(drive.joint, 1.0), machine.offset.get(drive.joint, 0.0)
        found[:, column] = (asked - offset if drive.quantity is Quantity.POSITION else asked) / scale
    return found


def _addresses(machine: Machine) -> list[int]:
    """Return where the readings of sensors at sites are, three each."""
    starts = [int(machine.model.sensor(sensor_name(*each)).adr[0]) for each in machine.robot.senses]
    return [start + axis for start in starts for axis in range(len(AXES))]


def _sensor_readings(machine: Machine, values: Array) -> dict[str, Array]:
    """Return what sensors at sites read, by signal, from what they would without errors, shape (..., 3 sensors)."""
    found = {}
    for number, (site, sense) in enumerate(machine.robot.senses):
        own = machine.read_sensor(site, sense, values[..., 3 * number : 3 * number + 3])
        found.update({f"{site}/{sense.value}.{axis}": own[..., column] for column, axis in enumerate(AXES)})
    return found


def _stepped(
    machine: Machine, starts: Array, controls: Array, joints: list[int], sensors: list[int]
) -> tuple[Array, Array]:
    """Run windows step by step, with friction that changes within them, and backlash."""
    model, robot = machine.model, machine.robot
    data = machine.data
    rows, base = machine.friction_rows(model), model.dof_frictionloss.copy()
    slack = []
    for drive in robot.drives:
        if drive.joint in machine.slack:
            at, _ = _places(model, drive.joint)
            number = int(model.actuator(drive.actuator).id)
            slack.append((number, at, joints.index(at), 0.5 * machine.slack[drive.joint]))
    count = controls.shape[1]
    position = np.empty((len(starts), count, len(joints)))
    efforts = np.empty((len(starts), count, len(sensors)))
    # Views of the model's own memory, and plain numbers: a step takes some microseconds itself.
    angles, rates, control, read = data.qpos, data.qvel, data.ctrl, data.sensordata
    driving, bias, friction = data.qfrc_actuator, data.qfrc_bias, model.dof_frictionloss
    for k, start in enumerate(starts):
        mujoco.mj_setState(model, data, start, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        control[:] = controls[k, 0]
        mujoco.mj_forward(model, data)
        for i in range(count):
            position[k, i] = angles[joints]
            control[:] = controls[k, i]
            for actuator, angle, column, half in slack:
                turned = backlash_offset(control[actuator], angles[angle], half)
                control[actuator] -= turned
                position[k, i, column] += turned
            update_friction(rows, friction, driving, bias, rates)
            mujoco.mj_step(model, data)
            efforts[k, i] = read[sensors]
    model.dof_frictionloss[:] = base
    return position, efforts


def _backward(machine: Machine, motion: Motion, recording: Recording) -> dict[str, Array]:
    """Return the efforts that the measured motion takes, by inverse dynamics."""
    robot, model, data = machine.robot, machine.model, machine.data
    places, dofs = [_places(model, name)[0] for name in robot.joints], [robot.dof(name) for name in robot.joints]
    own_friction = model.dof_frictionloss.copy()
    model.dof_frictionloss[:] = 0.0  # it is added below
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)  # what they hand on is added below
    grid = motion.step_s * np.arange(len(motion.position))
    scales = np.array([machine.scale.get(name, 1.0) for name in robot.joints])
    offsets = np.array([machine.read_position(name, 0.0, 0.0) for name in robot.joints])
    tables = [motion.position - offsets, motion.velocity, motion.acceleration]
    if machine.delay_s > 0.0:
        read_s = np.minimum(grid + machine.delay_s, grid[-1])
        tables = [np.column_stack([np.interp(read_s, grid, column) for column in each.T]) for each in tables]
    angle, rate, acceleration = (each / scales for each in tables)
    poses, rates = np.tile(model.qpos0, (len(angle), 1)), np.zeros((len(angle), model.nv))
    accelerations = np.zeros_like(rates)
    poses[:, places], rates[:, dofs], accelerations[:, dofs] = angle, rate, acceleration
    if motion.prescribed is not None:
        held = [_places(model, name) for name in robot.prescribed]
        at, by = [each for each, _ in held], [each for _, each in held]
        poses[:, at], rates[:, by], accelerations[:, by] = motion.prescribed
    _put_followers(machine, motion, poses, rates, accelerations)
    unmoved = [*robot.following(), *(robot.dof(name) for name in robot.joints if name not in robot.efforts)]
    equalities = Equalities(machine.robot.model, unmoved) if model.neq and unmoved else None
    addresses = _addresses(machine)
    torque, load = np.empty_like(angle), np.empty_like(angle)
    sensed = np.empty((len(angle), len(addresses)))
    for k in range(len(angle)):
        data.qpos[:], data.qvel[:], data.qacc[:] = poses[k], rates[k], accelerations[k]
        mujoco.mj_inverse(model, data)
        effort = data.qfrc_inverse if equalities is None else equalities.handed_on(poses[k], data.qfrc_inverse)
        torque[k], load[k], sensed[k] = effort[dofs], np.abs(data.qfrc_bias[dofs]), data.sensordata[addresses]
    still = np.array([machine.stribeck.get(name, (0.0, 1.0)) for name in robot.joints])
    shares = np.array([machine.load_friction.get(name, 0.0) for name in robot.joints])
    model.dof_frictionloss[:] = own_friction  # the machine may run another recording
    friction = own_friction[dofs] + still[:, 0] * np.exp(-np.square(rate / still[:, 1])) + shares * load
    # Below a fiftieth of the largest speed the sign is not known: angles of encoders differentiate to about that.
    slowest = np.maximum(0.02 * np.abs(motion.velocity).max(axis=0), 1e-6)
    torque += friction * np.tanh(rate / slowest)
    at_sites = _sensor_readings(machine, sensed)
    found = {}
    for signal in recording.signals:
        at_s = signal.time_s + motion.starts_s[0]
        if signal.name in at_sites:
            found[signal.name] = np.interp(at_s, grid, at_sites[signal.name])
            continue
        joint = signal.name.rpartition("/")[0]
        values = machine.effort_scale.get(joint, 1.0) * torque[:, robot.joints.index(joint)]
        found[signal.name] = np.interp(at_s - machine.effort_delay_s, grid, values)
    return found


def _put_followers(machine: Machine, motion: Motion, poses: Array, rates: Array, accelerations: Array) -> None:
    """Put where followers are, and how they move, into the motion of all joints; shapes (n, nq), (n, nv), (n, nv)."""
    following = machine.robot.following()
    if not following:
        return
    equalities = Equalities(machine.robot.model, following)
    last = None
    for k, pose in enumerate(poses):
        pose[:] = last = equalities.placed(pose, last)
        rates[k] = equalities.moved(pose, rates[k])
    accelerations[:, following] = np.gradient(rates[:, following], motion.step_s, axis=0)
