"""Runs a robot's recordings again: in windows that start at its measured state, or backwards from motion to effort."""

from __future__ import annotations

import copy
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from mujoco import rollout  # type: ignore[import-untyped]  # carries no types
from scipy.signal import lfilter  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.core.simulate import InfeasibleError
from jammkle_gap.mujoco.carried import COORDINATES, carrying, coordinates_of, drive_of, state_of
from jammkle_gap.mujoco.coupled import Equalities
from jammkle_gap.mujoco.robot import EFFORT_SENSOR, sensor_name
from jammkle_gap.mujoco.runs import AXES, BASE_COLUMNS, Base, Quantity
from jammkle_gap.mujoco.unsaid import Unsaid, lost, rub
from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.data import Recording, Signal
    from jammkle_gap.mujoco.robot import Robot

    Array = NDArray[np.float64]
    Change = Callable[["Machine", Sequence[float]], None]
    """Makes an effect, or a constant of the machine, of the values of its parameters, in order."""

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
    leading: Array
    """Commanded velocities, 0 where none are fed forward, shape (n, drives)."""
    feeding: Array
    """Commanded efforts that are fed forward, 0 where none are, shape (n, drives), N m or N."""
    starts_s: tuple[float, ...]
    """When each window that is compared begins, s."""
    window_s: float
    """How long it is, s."""
    carried: Array | None = None
    """Position, velocity and acceleration of the joints that move as measured, on the grid, shape (3, n, carried)."""
    base: Array | None = None
    """Coordinates of a free base that was measured, and their rates, on the grid, shape (2, n, 6)."""
    wandering: tuple[str, ...] = ()
    """Joints that no drive holds at a position, and the coordinates of a free base: errors of their start last."""
    start_shift: Array | None = None
    """Of their positions and then velocities at the start of each window, shape (windows, 2 wandering)."""
    sensitivity: Mapping[str, Array] = field(default_factory=dict)
    """By signal, what one standard deviation of each such error makes of it, shape (samples, 2 wandering)."""

    @property
    def end_s(self) -> float:
        """Time of the last sample of the grid, s."""
        return self.step_s * (len(self.position) - 1)


@dataclass
class Machine(Unsaid):
    """A robot as it may be: its model, and what of drives, sensors and clocks no model says."""

    robot: Robot
    model: mujoco.MjModel

    @cached_property
    def data(self) -> mujoco.MjData:
        """Room to run the model in; what it holds is of the run before."""
        return mujoco.MjData(self.model)

    def needs_steps(self) -> bool:
        """Return whether something changes within a run that a model cannot say."""
        return bool(self.stribeck or self.load_friction or self.slack)


@dataclass(frozen=True)
class RobotSimulator:
    """Runs recordings of a robot again, with effects and constants."""

    robot: Robot
    changes: Mapping[str, tuple[tuple[str, ...], tuple[float, ...], Change]]
    """By constant or effect: keys of its values, at which values it does nothing, and what it does, in turn: a machine
    is within its tolerances before anything is wrong with it."""

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
        """Return what would have been read, by signal at its times.

        Raises:
            InfeasibleError: it blows up.

        """
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
    found = {}
    shares = np.zeros((count, 2 * len(motion.wandering)))
    places = {
        each.name: np.minimum((each.time_s / motion.window_s).astype(int), count - 1) for each in recording.signals
    }
    for window in range(count):
        rows = [motion.sensitivity[name][places[name] == window] / scale_of(recording.signal(name)) for name in left]
        table, rest = np.concatenate(rows), np.concatenate([left[name][places[name] == window] for name in left])
        shares[window] = np.linalg.solve(table.T @ table + np.eye(table.shape[1]), table.T @ rest)
    for name, values in made.items():
        found[name] = values + (motion.sensitivity[name] * shares[places[name]]).sum(axis=1)
    return found


def scale_of(signal: Signal) -> float:
    """Return the standard deviation of one reading: declared, or estimated."""
    return signal.deviation or deviation_of(signal.values)


def deviation_of(values: Array) -> float:
    """Return the standard deviation of one reading, by second differences (Gasser et al. 1986, Biometrika 73:625)."""
    second = values[1:-1] - 0.5 * (values[:-2] + values[2:])
    blocks = [float(np.square(each).mean()) for each in np.array_split(second, _BLOCKS) if each.size]
    steps = np.diff(np.unique(values))
    rounding = float(steps.min()) / np.sqrt(12.0) if steps.size else 0.0
    return float(np.hypot(np.sqrt(np.median(blocks) / 1.5), rounding))


_BLOCKS = 8
"""Stretches of which the median is taken, so that fast motion in some does not count."""


def run_forward(machine: Machine, motion: Motion, recording: Recording) -> dict[str, Array]:
    """Run every window and read its sensors.

    Raises:
        InfeasibleError: it blows up.

    """
    robot, model = machine.robot, machine.model
    step_s = float(model.opt.timestep)
    length = motion.window_s + LEAD_S
    if robot.given.base is Base.FREE and motion.base is None:
        length = motion.end_s
    count = int(np.ceil(length * (1.0 + max(machine.clock_rate, 0.0)) / step_s)) + 1
    begins = np.array(motion.starts_s) * (1.0 + machine.clock_rate) - LEAD_S
    asked = _asked(machine, motion)
    controls = _controls(machine, motion, asked, begins, count)
    starts = _starts(machine, motion, begins)
    joints = [int(model.joint(name).qposadr[0]) for name in robot.joints]
    if robot.floating:
        first = int(model.joint(robot.floating).qposadr[0])
        joints += range(first, first + len(BASE_COLUMNS))
    sensed = list(dict.fromkeys((*robot.efforts, *(each.joint for each in robot.drives))))
    sensors = [int(model.sensor(f"{EFFORT_SENSOR}{name}").adr[0]) for name in sensed]
    sensors += _addresses(machine)
    if machine.needs_steps():
        position, efforts = _stepped(machine, starts, controls, joints, sensors)
    else:
        states, read = rollout.rollout(model, machine.data, starts, controls)
        position = np.concatenate([starts[:, np.newaxis, 1:][:, :, joints], states[:, :-1, 1:][:, :, joints]], axis=1)
        efforts = read[:, :, sensors]
    if not np.isfinite(position).all() or np.abs(position).max() > _WILD:
        msg = "the simulation blows up"
        raise InfeasibleError(msg)
    ticks = step_s * np.arange(count, dtype=np.float64)
    as_they_are = _felt(machine, efforts[:, :, len(sensed) :])
    if robot.floating:
        poses = np.array([coordinates_of(each) for each in position[:, :, len(robot.joints) :]])
        as_they_are.update({f"{BASE}/{name}": poses[:, :, column] for column, name in enumerate(COORDINATES)})
    # A controller reads before it writes: an effort is that of the step before.
    efforts = np.concatenate([efforts[:, :1], efforts[:, :-1]], axis=1)
    found = {}
    for signal in recording.signals:
        joint, _, quantity = signal.name.rpartition("/")
        if signal.name in as_they_are:
            found[signal.name] = _read(machine, motion, begins, ticks, as_they_are[signal.name], signal.time_s)
            continue
        if quantity == Quantity.POSITION.value:
            effort = efforts[:, :, sensed.index(joint)] if joint in machine.compliance else 0.0
            values = machine.read_position(joint, position[:, :, robot.joints.index(joint)], effort)
            found[signal.name] = _read(machine, motion, begins, ticks, values, signal.time_s)
            continue
        values = efforts[:, :, sensed.index(joint)]
        read = _read(machine, motion, begins, ticks + machine.effort_delay_s, values, signal.time_s)
        read += _between_ticks(machine, motion, asked, controls, joint, begins, signal.time_s, read)
        found[signal.name] = machine.effort_scale.get(joint, 1.0) * read
    return found


def _read(machine: Machine, motion: Motion, begins: Array, ticks: Array, values: Array, time_s: Array) -> Array:
    """Return the readings of one quantity at the times of its signal, by when they were really taken.

    `values`, shape (windows, count), are there to be read at `ticks` after `begins`.
    """
    real_s, window = _taken_at(machine, motion, time_s)
    found = np.empty_like(time_s)
    for k, begin_s in enumerate(begins):
        own = window == k
        found[own] = np.interp(real_s[own] - begin_s, ticks, values[k])
    return found


def _taken_at(machine: Machine, motion: Motion, time_s: Array) -> tuple[Array, NDArray[np.intp]]:
    """Return when readings were really taken, s since the start of the recording, and the window of each."""
    window = np.minimum((time_s / motion.window_s).astype(np.intp), len(motion.starts_s) - 1)
    stamp_s = np.array(motion.starts_s)[window] + time_s - window * motion.window_s
    return stamp_s * (1.0 + machine.clock_rate), window


def _addresses(machine: Machine) -> list[int]:
    """Return where the readings of sensors at sites are, three each."""
    starts = [int(machine.model.sensor(sensor_name(*each)).adr[0]) for each in machine.robot.senses]
    return [start + axis for start in starts for axis in range(len(AXES))]


def _felt(machine: Machine, values: Array) -> dict[str, Array]:
    """Return what sensors at sites read, by signal, from what they would without errors, shape (..., 3 sensors)."""
    found = {}
    for number, (site, sense) in enumerate(machine.robot.senses):
        own = machine.feel(site, sense, values[..., 3 * number : 3 * number + 3])
        found.update({f"{site}/{sense.value}.{axis}": own[..., column] for column, axis in enumerate(AXES)})
    return found


def _between_ticks(
    machine: Machine,
    motion: Motion,
    asked: Array,
    controls: Array,
    joint: str,
    begins: Array,
    time_s: Array,
    made: Array,
) -> Array:
    """Return what the effort of a drive differs by between the model's steps, as its set point comes in steps.

    `asked`, shape (n, drives), are set points on the motion's grid, `controls`, (windows, count, actuators), those of
    every step, and `made` efforts at `time_s`, straight from step to step; N m or N.
    """
    columns = [column for column, each in enumerate(machine.robot.drives) if each.joint == joint]
    if not columns:
        return np.zeros_like(time_s)
    actuator = machine.model.actuator(machine.robot.drives[columns[0]].actuator)
    step_s = float(machine.model.opt.timestep)
    grid = motion.step_s * np.arange(len(asked))
    at, window = _taken_at(machine, motion, time_s)
    at -= machine.effort_delay_s
    found = np.empty_like(time_s)
    # An effort is that of the step before: its set point is that of the middle of this step.
    ticks = step_s * np.arange(1, controls.shape[1] + 1)
    late_s = 0.5 * step_s + machine.delay_s + machine.arrival_s
    for k, begin_s in enumerate(begins):
        own = window == k
        exact = np.interp(at[own] - late_s, grid, asked[:, columns[0]])
        found[own] = exact - np.interp(at[own] - begin_s, ticks, controls[k, :, int(actuator.id)])
    found *= float(actuator.gainprm[0])
    if machine.model.actuator_forcelimited[actuator.id]:
        low, high = actuator.forcerange
        found = np.where((made > _NEARLY * low) & (made < _NEARLY * high), found, 0.0)
    return found


_NEARLY = 0.95
"""Share of its limit from which on an effort is taken for limited."""


def _asked(machine: Machine, motion: Motion) -> Array:
    """Return what drives make of their set points, shape (n, drives)."""
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
            rate = motion.leading[:, column] if drive.leading else np.zeros_like(asked)
            if forward != 0.0:
                half = max(int(FORWARD_FROM_S / motion.step_s), 1)
                padded = np.pad(asked, half, mode="edge")
                rate = rate + forward * (padded[2 * half :] - padded[: -2 * half]) / (2.0 * half * motion.step_s)
            asked = asked + kd / kp * rate
        if drive.feeding:
            arriving = machine.fed_share.get(drive.joint, 1.0) * motion.feeding[:, column]
            asked = asked + arriving / float(actuator.gainprm[0])
        # Drives regulate what their encoders read.
        scale, offset = machine.scale.get(drive.joint, 1.0), machine.offset.get(drive.joint, 0.0)
        found[:, column] = (asked - offset if drive.quantity is Quantity.POSITION else asked) / scale
    return found


def _controls(machine: Machine, motion: Motion, asked: Array, begins: Array, count: int) -> Array:
    """Return the controls of every window: what is asked during each step, on the mean; (windows, count, actuators)."""
    model = machine.model
    step_s = float(model.opt.timestep)
    grid = motion.step_s * np.arange(len(asked))
    at = begins[:, np.newaxis] + step_s * np.arange(count) - machine.delay_s - machine.arrival_s
    at = np.clip(at, 0.0, grid[-1] - step_s)
    controls = np.zeros((len(begins), count, model.nu))
    for column, drive in enumerate(machine.robot.drives):
        own = asked[:, column]
        area = np.concatenate(([0.0], np.cumsum(0.5 * motion.step_s * (own[1:] + own[:-1]))))
        taken = np.interp(at + step_s, grid, area) - np.interp(at, grid, area)
        controls[:, :, int(model.actuator(drive.actuator).id)] = taken / step_s
    if motion.carried is not None:
        at = begins[:, np.newaxis] + step_s * np.arange(count)
        for name, own in zip(machine.robot.carried, carrying(motion.carried).T, strict=True):
            controls[:, :, int(model.actuator(drive_of(name)).id)] = np.interp(at, grid, own)
    return controls


def _starts(machine: Machine, motion: Motion, begins: Array) -> Array:
    """Return the states that windows start from, as their sensors would have read them, shape (windows, state)."""
    model = machine.model
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    states = np.zeros((len(begins), size))
    states[:, 1 : 1 + model.nq] = model.qpos0
    grid = motion.step_s * np.arange(len(motion.position))
    read_s = begins / (1.0 + machine.clock_rate)
    for column, name in enumerate(machine.robot.joints):
        joint = model.joint(name)
        scale, offset = machine.scale.get(name, 1.0), machine.offset.get(name, 0.0)
        position = np.interp(read_s, grid, motion.position[:, column])
        states[:, 1 + int(joint.qposadr[0])] = (position - offset) / scale
        velocity = np.interp(read_s, grid, motion.velocity[:, column])
        states[:, 1 + model.nq + int(joint.dofadr[0])] = velocity / scale
    if motion.carried is not None:
        for column, name in enumerate(machine.robot.carried):
            joint = model.joint(name)
            states[:, 1 + int(joint.qposadr[0])] = np.interp(read_s, grid, motion.carried[0, :, column])
            states[:, 1 + model.nq + int(joint.dofadr[0])] = np.interp(read_s, grid, motion.carried[1, :, column])
    none = np.zeros((len(begins), 2 * len(motion.wandering)))
    shift = (none if motion.start_shift is None else motion.start_shift).reshape(len(begins), 2, -1)
    for column, name in enumerate(motion.wandering):
        if name in machine.robot.joints:
            joint = model.joint(name)
            states[:, 1 + int(joint.qposadr[0])] += shift[:, 0, column]
            states[:, 1 + model.nq + int(joint.dofadr[0])] += shift[:, 1, column]
    if motion.base is not None:
        own = shift[:, :, [column for column, name in enumerate(motion.wandering) if name in COORDINATES]]
        _put_bases(machine, states, motion.base, motion.step_s, read_s, own)
    if machine.robot.followers:
        equalities = Equalities(model, machine.robot.following())
        for state in states:
            position, velocity = state[1 : 1 + model.nq], state[1 + model.nq : 1 + model.nq + model.nv]
            position[:] = equalities.placed(position)
            velocity[:] = equalities.moved(position, velocity)
    return states


def _put_bases(machine: Machine, states: Array, base: Array, step_s: float, read_s: Array, shift: Array) -> None:
    """Put where a free base was measured, shape (2, n, 6) on the grid, into the starts of windows.

    `shift` is that of coordinates and rates of each window, shape (windows, 2, 6), or (windows, 2, 0) for none.
    """
    model, grid = machine.model, step_s * np.arange(base.shape[1])
    free = model.joint(machine.robot.floating)
    at, by = 1 + int(free.qposadr[0]), 1 + model.nq + int(free.dofadr[0])
    for state, read_at, own in zip(states, read_s, shift, strict=True):
        table = np.array([[np.interp(read_at, grid, column) for column in each.T] for each in base])
        position, velocity = state_of(*(table + own if own.size else table))
        state[at : at + len(position)], state[by : by + len(velocity)] = position, velocity


def _stepped(
    machine: Machine, starts: Array, controls: Array, joints: Sequence[int], sensors: Sequence[int]
) -> tuple[Array, Array]:
    """Run windows step by step, with friction that changes within them, and backlash."""
    model, robot = machine.model, machine.robot
    data = machine.data
    rubbing, base = machine.rubbing(model), model.dof_frictionloss.copy()
    slack = [
        (
            int(model.actuator(drive.actuator).id),
            int(model.joint(drive.joint).qposadr[0]),
            list(joints).index(int(model.joint(drive.joint).qposadr[0])),
            0.5 * machine.slack[drive.joint],
        )
        for drive in robot.drives
        if drive.joint in machine.slack
    ]
    count = controls.shape[1]
    position = np.empty((len(starts), count, len(joints)))
    efforts = np.empty((len(starts), count, len(sensors)))
    # Views of the model's own memory, and plain numbers: a step takes some microseconds itself.
    angles, rates, control, read = data.qpos, data.qvel, data.ctrl, data.sensordata
    driving, bias, friction = data.qfrc_actuator, data.qfrc_bias, model.dof_frictionloss
    for k, start in enumerate(starts):
        mujoco.mj_setState(model, data, start, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        mujoco.mj_forward(model, data)
        for i in range(count):
            position[k, i] = angles[joints]
            control[:] = controls[k, i]
            for actuator, angle, column, half in slack:
                turned = lost(control[actuator], angles[angle], half)
                control[actuator] -= turned
                position[k, i, column] += turned
            rub(rubbing, friction, driving, bias, rates)
            mujoco.mj_step(model, data)
            efforts[k, i] = read[sensors]
    model.dof_frictionloss[:] = base
    return position, efforts


def _backward(machine: Machine, motion: Motion, recording: Recording) -> dict[str, Array]:
    """Return the efforts that the measured motion takes, by inverse dynamics."""
    robot, model = machine.robot, machine.model
    data = machine.data
    positions = [int(model.joint(name).qposadr[0]) for name in robot.joints]
    dofs = [robot.dof(name) for name in robot.joints]
    dry = model.dof_frictionloss[dofs].copy()
    model.dof_frictionloss[:] = 0.0
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)  # what they hand on is added below
    grid = motion.step_s * np.arange(len(motion.position))
    read_s = np.minimum(grid + machine.delay_s, grid[-1])
    scales = np.array([machine.scale.get(name, 1.0) for name in robot.joints])
    offsets = np.array([machine.offset.get(name, 0.0) for name in robot.joints])
    tables = [motion.position - offsets, motion.velocity, motion.acceleration]
    if machine.delay_s > 0.0:
        tables = [np.column_stack([np.interp(read_s, grid, column) for column in each.T]) for each in tables]
    angle, rate, acceleration = (each / scales for each in tables)
    torque = np.empty_like(angle)
    carried = np.empty_like(angle)
    held = [model.joint(name) for name in robot.carried]
    carried_at, carried_by = [int(each.qposadr[0]) for each in held], [int(each.dofadr[0]) for each in held]
    addresses = _addresses(machine)
    sensed = np.empty((len(angle), len(addresses)))
    poses, rates = np.tile(model.qpos0, (len(angle), 1)), np.zeros((len(angle), model.nv))
    accelerations = np.zeros_like(rates)
    poses[:, positions], rates[:, dofs], accelerations[:, dofs] = angle, rate, acceleration
    if motion.carried is not None:
        poses[:, carried_at], rates[:, carried_by], accelerations[:, carried_by] = motion.carried
    _put_followers(machine, motion, poses, rates, accelerations)
    unmoved = [*robot.following(), *(robot.dof(name) for name in robot.joints if name not in robot.efforts)]
    equalities = Equalities(machine.robot.model, unmoved) if model.neq and unmoved else None
    for k in range(len(angle)):
        data.qpos[:], data.qvel[:], data.qacc[:] = poses[k], rates[k], accelerations[k]
        mujoco.mj_inverse(model, data)
        effort = data.qfrc_inverse if equalities is None else equalities.handed_on(poses[k], data.qfrc_inverse)
        torque[k] = effort[dofs]
        carried[k] = np.abs(data.qfrc_bias[dofs])
        sensed[k] = data.sensordata[addresses]
    still = np.array([machine.stribeck.get(name, (0.0, 1.0)) for name in robot.joints])
    load = np.array([machine.load_friction.get(name, 0.0) for name in robot.joints])
    rubbing = dry + still[:, 0] * np.exp(-np.square(rate / still[:, 1])) + load * carried
    torque += rubbing * np.tanh(rate / _turning(motion))
    found = {}
    felt = _felt(machine, sensed)
    for signal in recording.signals:
        if signal.name in felt:
            found[signal.name] = np.interp(signal.time_s + motion.starts_s[0], grid, felt[signal.name])
            continue
        joint = signal.name.rpartition("/")[0]
        column = robot.joints.index(joint)
        values = machine.effort_scale.get(joint, 1.0) * torque[:, column]
        at_s = signal.time_s + motion.starts_s[0] - machine.effort_delay_s
        found[signal.name] = np.interp(at_s, grid, values)
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


def _turning(motion: Motion) -> Array:
    """Return the speed below which the sign of the motion is not known, shape (joints,).

    Chosen: a fiftieth of the largest, as angles of encoders differentiate to about that.
    """
    found: Array = np.maximum(0.02 * np.abs(motion.velocity).max(axis=0), 1e-6)
    return found
