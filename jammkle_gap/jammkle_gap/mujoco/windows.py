"""What is compared of a robot's runs: windows, the motion that they start from, and the noise of what was read.

Multiple shooting (Bock and Plitt 1984, IFAC Proceedings 17:1603): a recording is cut into windows, so that what drifts
within a second does not hide what happens within ten milliseconds. Each window begins a little before what is compared
of it, so that readings that come late are known and errors of its start have died away. The state that it starts from
is the measured one, smoothed and differentiated once (Savitzky and Golay 1964, Anal. Chem. 36:1627).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import savgol_coeffs, savgol_filter  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.core.data import BadRecordingError, Recording, Signal
from jammkle_gap.mujoco.prescribed import BASE_JOINTS, COORDINATES, coordinates_of
from jammkle_gap.mujoco.runs import AXES, BASE_COLUMNS, LONGEST_STEP_S, BadRobotError, Base, Quantity, Track
from jammkle_gap.mujoco.simulator import (
    BASE,
    FORWARD_FROM_S,
    LEAD_S,
    Machine,
    Motion,
    deviation_of,
    run_forward,
    scale_of,
)
from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from jammkle_gap.mujoco.robot import Robot
    from jammkle_gap.mujoco.runs import Run

    Array = NDArray[np.float64]

_SMOOTHED_S = 0.08
"""Stretch of readings that a cubic is laid through, s. Chosen: it passes motion of up to 5 Hz within a per cent."""
_FEWEST_SMOOTHED = 7
_MOVED_STEPS = 5.0
"""Twice the standard deviation of a reading, so often, a joint must travel to have moved. Chosen: five steps."""


_STILL = 1e-3
"""Travel, rad or m, up to which a joint stands, however finely it is read. Chosen: a step of an encoder of 12 bits."""


def recordings_of(
    robot: Robot, runs: Sequence[Run], window_s: float, search_s: float
) -> tuple[list[Recording], list[Recording]]:
    """Return what is compared of runs, and what is kept to try the answer on.

    Args:
        robot: That was recorded.
        runs: In the model's terms.
        window_s: Length of a window, s.
        search_s: How much of all runs together is compared, s. The windows with the largest travel are taken, evenly
            over each run.

    Raises:
        BadRecordingError: too short, nothing moves, or efforts of other units than the model's.

    """
    compared: list[Recording] = []
    kept: list[Recording] = []
    for run in runs:
        motion = _motion_of(robot, run)
        if not robot.drives:
            _check_whole(robot, run, motion)
            chosen, others = [0.0], []
            length = motion.end_s
        else:
            length, every = _windows(robot, motion, run, window_s)
            most = max(int(min(search_s / len(runs) / length, len(every))), 1)
            chosen = [
                max(part.tolist(), key=lambda start: _travel(motion, start, length))
                for part in np.array_split(np.array(every), most)
            ]
            others = [start for start in every if start not in chosen]
        for starts, where in ((chosen, compared), (others, kept)):
            if starts:
                where.append(_recording(robot, run, replace(motion, starts_s=tuple(starts), window_s=length)))
    return compared, kept


def repeats_of(robot: Robot, compared: Sequence[Recording], runs: Sequence[Run]) -> list[Recording]:
    """Return runs in the windows and settings of recordings that were commanded in the same way.

    Settings are written into the recordings' own names: a recording's setting is its name.

    Raises:
        BadRecordingError: a run was commanded as no recording.

    """
    found = []
    for own in runs:
        motion = _motion_of(robot, own)
        apart = {each.name: _apart(robot, each.inputs, motion) for each in compared}
        best = min(apart, key=lambda name: apart[name])
        if apart[best] > _SAME_SHARE:
            msg = f"recording {own.name} was not commanded as any of {', '.join(apart)}"
            msg += f" (it is {100.0 * apart[best]:.0f} % of the motion off {best}, more than {100.0 * _SAME_SHARE:g} %)"
            msg += "; record the same commands, from the same start"
            raise BadRecordingError(msg)
        like = next(each for each in compared if each.name == best)
        if like.inputs.starts_s[-1] + like.inputs.window_s > motion.end_s:
            msg = f"recording {own.name} is shorter than {best}; record the same commands to their end"
            raise BadRecordingError(msg)
        motion = replace(motion, starts_s=like.inputs.starts_s, window_s=like.inputs.window_s)
        found.append(replace(_recording(robot, own, motion), setting=like.setting))
    return found


_SAME_SHARE = 0.02
"""Root mean square by which set points of repeats may differ, as a share of their range. Chosen: arrival within a
tenth of a period."""


def _apart(robot: Robot, first: Motion, second: Motion) -> float:
    one, other = (each.set_points if robot.drives else each.position for each in (first, second))
    length = min(len(one), len(other))
    spans = np.maximum(np.ptp(one, axis=0), 1e-9)
    return float(np.sqrt(np.square((one[:length] - other[:length]) / spans).mean()))


def _motion_of(robot: Robot, run: Run) -> Motion:
    """Return the motion of a run, in one window."""
    tracks = [run.measured[name, Quantity.POSITION] for name in robot.joints]
    posed = run.base if robot.given.base is Base.MEASURED or robot.floating else ()
    led = [run.measured[name, Quantity.POSITION] for name in robot.prescribed if name not in BASE_JOINTS]
    asked = [run.commands[drive.joint, drive.quantity] for drive in robot.drives]
    begin_s = max(float(each.time_s[0]) for each in (*tracks, *led, *posed, *asked))
    end_s = min(float(each.time_s[-1]) for each in (*tracks, *led, *posed))
    step_s = float(np.median(np.diff(tracks[0].time_s)))
    count = int((end_s - begin_s) / step_s) + 1
    wide = _width(step_s)
    if count <= 2 * wide:
        msg = f"recording {run.name} holds {max(end_s - begin_s, 0.0):.2f} s of joint states with commands"
        msg += f", less than {2 * wide * step_s:.2f} s; record longer"
        raise BadRecordingError(msg)
    times = begin_s + step_s * np.arange(count, dtype=np.float64)
    readings = np.column_stack([each.at(times) for each in tracks])
    _check_moves(robot, run, readings)
    # Set points are stepped through with the model, efforts are taken where they were read.
    fine = min(step_s, max(0.25 * float(robot.model.opt.timestep), 0.0005)) if robot.drives else step_s
    grid = begin_s + fine * np.arange(int((end_s - begin_s) / fine) + 1, dtype=np.float64)

    def smoothed(table: Array) -> list[Array]:
        """Return a table of readings and its derivatives on the grid."""
        orders = [savgol_filter(table, wide, 3, deriv=k, delta=step_s, axis=0, mode="interp") for k in range(3)]
        return [np.column_stack([np.interp(grid, times, column) for column in each.T]) for each in orders]

    columns = [each.at(times)[:, np.newaxis] for each in led]
    base = None
    if posed:
        poses = np.column_stack([each.at(times) for each in posed])
        if (np.linalg.norm(poses[:, 3:], axis=1) < _LEAST_NORM).any():
            msg = f"the orientation of the base in recording {run.name} is no quaternion"
            msg += "; its norm is 0 where it should be 1"
            raise BadRecordingError(msg)
        if robot.floating:
            base = np.array(smoothed(coordinates_of(poses))[:2])
        else:
            columns.append(coordinates_of(poses))
    set_points = np.column_stack([each.mean_about(grid, fine) for each in asked]) if asked else np.zeros((len(grid), 0))
    fed_velocity, fed_effort = np.zeros_like(set_points), np.zeros_like(set_points)
    for column, drive in enumerate(robot.drives):
        if drive.feeds_velocity:
            fed_velocity[:, column] = run.commands[drive.joint, Quantity.VELOCITY].mean_about(grid, fine)
        if drive.feeds_effort:
            fed_effort[:, column] = run.commands[drive.joint, Quantity.EFFORT].mean_about(grid, fine)
    position, velocity, acceleration = smoothed(readings)
    return Motion(
        begin_s=begin_s,
        step_s=fine,
        position=position,
        velocity=velocity,
        acceleration=acceleration,
        set_points=set_points,
        fed_velocity=fed_velocity,
        fed_effort=fed_effort,
        starts_s=(0.0,),
        window_s=end_s - begin_s,
        prescribed=np.array(smoothed(np.hstack(columns))) if columns else None,
        base=base,
    )


_LEAST_NORM = 0.1
"""Of a quaternion. Chosen: between two that are 1 a straight line has less only where they are opposite."""


def _check_moves(robot: Robot, run: Run, readings: Array) -> None:
    travels = np.ptp(readings, axis=0)
    for column, name in enumerate(robot.joints):
        track = run.measured[name, Quantity.POSITION]
        if travels[column] > max(_MOVED_STEPS * 2.0 * deviation_of(track.values), _STILL):
            return
    msg = f"nothing moves in recording {run.name}: no joint travels more than {travels.max():.2g}"
    msg += "; record a motion of every joint"
    raise BadRecordingError(msg)


def _windows(robot: Robot, motion: Motion, run: Run, window_s: float) -> tuple[float, list[float]]:
    """Return the length of a run's windows and when each begins, s."""
    if robot.given.base is Base.FREE and not robot.floating:
        _check_whole(robot, run, motion)
        return motion.end_s - LEAD_S, [LEAD_S]
    room = motion.end_s - LEAD_S
    if room <= LEAD_S:
        msg = f"recording {run.name} holds {motion.end_s:.2f} s, too short; record {2.0 * LEAD_S + window_s:g} s"
        raise BadRecordingError(msg)
    length = min(window_s, room)
    starts = (LEAD_S + length * np.arange(int(room / length + 1e-9))).tolist()
    holes = _holes(robot, run, motion)
    whole = [each for each in starts if all(each + length < begin or each - LEAD_S > end for begin, end in holes)]
    if not whole:
        begin, end = holes[0]
        msg = f"readings of recording {run.name} stop for {end - begin:.2g} s at {begin:.4g} s"
        msg += f", and no window is without such a hole; record {length:g} s and more in one piece"
        raise BadRecordingError(msg)
    return length, whole


def _check_whole(robot: Robot, run: Run, motion: Motion) -> None:
    """Refuse holes in a recording that is compared as a whole."""
    if holes := _holes(robot, run, motion):
        begin, end = holes[0]
        msg = f"readings of recording {run.name} stop for {end - begin:.2g} s at {begin:.4g} s; cut it there"
        raise BadRecordingError(msg)


def _holes(robot: Robot, run: Run, motion: Motion) -> list[tuple[float, float]]:
    """Return when readings of positions stop for longer than they may, from the start of what is compared, s."""
    found: list[tuple[float, float]] = []
    moved = [name for name in robot.prescribed if name not in BASE_JOINTS]
    tracks = [run.measured[name, Quantity.POSITION] for name in (*robot.joints, *moved)]
    tracks += run.base[:1] if motion.base is not None or len(moved) < len(robot.prescribed) else ()
    for track in tracks:
        time_s = track.time_s - motion.begin_s
        longer = np.diff(time_s) > LONGEST_STEP_S
        found += zip(time_s[:-1][longer].tolist(), time_s[1:][longer].tolist(), strict=True)
    return found


def _travel(motion: Motion, start_s: float, length_s: float) -> float:
    own = slice(int(start_s / motion.step_s), int((start_s + length_s) / motion.step_s) + 1)
    spans = np.maximum(np.ptp(motion.position, axis=0), 1e-9)
    return float((np.abs(np.diff(motion.position[own], axis=0)).sum(axis=0) / spans).sum())


def _recording(robot: Robot, run: Run, motion: Motion) -> Recording:
    """Return what is compared of a run: the windows of its motion, one after the other."""
    asked = [(joint, Quantity.POSITION) for joint in robot.joints if robot.drives]
    asked += [(joint, Quantity.EFFORT) for joint in robot.efforts]
    signals = [_of_joint(robot, run, motion, joint, quantity) for joint, quantity in asked]
    for site, sense in robot.senses:
        for axis, track in zip(AXES, run.sensed[site, sense], strict=True):
            signals.append(_windowed(f"{site}/{sense.value}.{axis}", sense.unit, track, motion, 0.0))
    if robot.floating:
        times_s, poses = run.base[0].time_s, np.column_stack([each.values for each in run.base])
        for name, column in zip(COORDINATES, coordinates_of(poses).T, strict=True):
            unit = "m" if name in AXES else "rad"
            signals.append(_windowed(f"{BASE}/{name}", unit, Track(times_s, column), motion, _DRIFT))
    known, notes = _with_known_noise(run.name, signals)
    return _with_sensitivity(robot, Recording(run.name, known, motion, setting=run.name, notes=notes))


_DRIFT = 0.005
"""Standard deviation of a base's coordinates, m and rad. Assumed: odometry drifts by some millimetres and milliradians
within a window, however finely it is read."""


def _with_known_noise(recording: str, signals: Sequence[Signal]) -> tuple[tuple[Signal, ...], tuple[str, ...]]:
    """Return signals of which all have a noise, and notes on those that never change, as of an encoder that stands."""
    found, still = [], []
    for each in signals:
        if scale_of(each) > 0.0:
            found.append(each)
            continue
        noise = max(scale_of(other) for other in signals if other.unit == each.unit)
        if noise == 0.0:
            msg = f"{each.name} never changes in recording {recording}, and no other signal in {each.unit} does"
            msg += ", so that its noise is unknown; give it in the map (noise: {...}), or leave it out (sensors: none)"
            raise BadRecordingError(msg)
        still.append(each.name)
        found.append(replace(each, noise=noise))
    note = f"{', '.join(still)} never changes: its noise is taken for the largest in its unit, unless the map gives it"
    return tuple(found), (note,) if still else ()


def _of_joint(robot: Robot, run: Run, motion: Motion, joint: str, quantity: Quantity) -> Signal:
    """Return readings of a joint with their noise."""
    track = run.measured.get((joint, quantity))
    if track is None and not robot.drives:
        track = run.commands.get((joint, quantity))
    if track is None:
        msg = f"recording {run.name} holds no {quantity.value} of joint {joint}, as others do; leave one kind out"
        raise BadRobotError(msg)
    turning = robot.is_turning(joint)
    unit = ("rad" if turning else "m") if quantity is Quantity.POSITION else ("N m" if turning else "N")
    noise = robot.given.noise.get(quantity, 0.0)
    signal = _windowed(f"{joint}/{quantity.value}", unit, track, motion, noise)
    if robot.drives:
        return _with_jitter(robot, motion, signal, track, joint, quantity)
    return _with_motion_noise(robot, run, signal, joint)


def _windowed(name: str, unit: str, track: Track, motion: Motion, noise: float) -> Signal:
    """Return a track in the windows of a motion, one after the other."""
    times, values = [], []
    for k, start in enumerate(motion.starts_s):
        own_s = track.time_s - motion.begin_s - start
        inside = (own_s >= 0.0) & (own_s < motion.window_s)
        times.append(own_s[inside] + k * motion.window_s)
        values.append(track.values[inside])
    time_s, read = np.concatenate(times), np.concatenate(values)
    kept = np.concatenate(([True], np.diff(time_s) > 0.0))
    return Signal(name, unit, time_s[kept], read[kept], noise)


def _with_jitter(robot: Robot, motion: Motion, signal: Signal, track: Track, joint: str, quantity: Quantity) -> Signal:
    """Return a signal with the noise that jitter of commands and readings brings into it: the faster, the more."""
    drives = [column for column, each in enumerate(robot.drives) if each.joint == joint]
    off_s, rate = _JITTER_S, np.zeros(1)
    if quantity is Quantity.POSITION:
        rate = motion.velocity[:, robot.joints.index(joint)]
    elif drives:
        # Both count: a set point that comes late is felt at once.
        off_s = float(np.sqrt(2.0)) * _JITTER_S
        half = max(int(FORWARD_FROM_S / motion.step_s), 1)
        asked = motion.set_points[:, drives[0]]
        gain = float(robot.model.actuator(robot.drives[drives[0]].actuator).gainprm[0])
        rate = gain * (asked[2 * half :] - asked[: -2 * half]) / (2.0 * half * motion.step_s)
    jitter = off_s * float(np.sqrt(np.square(rate).mean()))
    steps = np.diff(np.unique(track.values))
    step = float(steps.min()) if steps.size else 0.0
    # What is estimated from readings has their rounding in it, which the resolution says.
    own = signal.noise or float(np.sqrt(max(deviation_of(track.values) ** 2 - step**2 / 12.0, 0.0)))
    return replace(signal, noise=float(np.hypot(own, jitter)), resolution=step)


_JITTER_S = 0.0003
"""Standard deviation of when a command arrives and a reading is taken, beside its stamp, s. Assumed: anywhere within a
cycle of 1 kHz, 1 ms / sqrt(12)."""


def _width(step_s: float) -> int:
    """Return the samples that a cubic is laid through, an odd number."""
    return int(max(round(_SMOOTHED_S / step_s), _FEWEST_SMOOTHED) // 2 * 2 + 1)


def _noise_gain(time_s: Array, order: int) -> float:
    """Return the standard deviation of a derivative of smoothed readings, over that of a reading."""
    step_s = float(np.median(np.diff(time_s)))
    return float(np.linalg.norm(savgol_coeffs(_width(step_s), 3, deriv=order, delta=step_s)))


def _with_motion_noise(robot: Robot, run: Run, effort: Signal, joint: str) -> Signal:
    """Return an effort with the noise that differentiated angles bring into what is compared with it."""
    track = run.measured[joint, Quantity.POSITION]
    noise = robot.given.noise.get(Quantity.POSITION, 0.0) or deviation_of(track.values)
    gain = _noise_gain(track.time_s, 2)
    data = mujoco.MjData(robot.model)
    mujoco.mj_forward(robot.model, data)
    mass = np.zeros((robot.model.nv, robot.model.nv))
    mujoco.mj_fullM(robot.model, data, mass)
    inertia = mass[robot.dof(joint), robot.dof(joint)]
    own = effort.noise or deviation_of(effort.values)
    return replace(effort, noise=float(np.hypot(own, inertia * gain * noise)))


def _with_sensitivity(robot: Robot, recording: Recording) -> Recording:
    """Return a recording that knows what errors of its starts do, where they last."""
    held = {drive.joint for drive in robot.drives if drive.quantity is Quantity.POSITION}
    unheld = (*(name for name in robot.joints if name not in held), *(COORDINATES if robot.floating else ()))
    if not unheld or not robot.drives or (robot.given.base is Base.FREE and not robot.floating):
        return recording
    motion: Motion = replace(recording.inputs, unheld=unheld)
    machine = Machine(robot, robot.model)
    nominal = run_forward(machine, motion, recording)
    columns: dict[str, list[Array]] = {name: [] for name in nominal}
    for order in range(2):
        for column, name in enumerate(unheld):
            signal = recording.signal(f"{name}/{Quantity.POSITION.value}" if name in robot.joints else f"{BASE}/{name}")
            gain = _noise_gain(signal.time_s, order)
            shift = np.zeros((len(motion.starts_s), 2 * len(unheld)))
            shift[:, order * len(unheld) + column] = _START_ERRORS * gain * scale_of(signal)
            made = run_forward(machine, replace(motion, start_shift=shift), recording)
            for other in nominal:
                columns[other].append(made[other] - nominal[other])
    sensitivity = {name: np.array(each).T for name, each in columns.items()}
    return replace(recording, inputs=replace(motion, sensitivity=sensitivity))


_START_ERRORS = 3.0
"""Standard deviations of a smoothed reading that a start may be off. Chosen: smoothing bends fast motion, too."""


_SUNK_M = 0.05
"""How deep a robot may stand in what is fixed. Chosen: feet and floors of models give
by up to 2 cm, and odometry that counts from its start is off by the height of the base."""


def lifted(robot: Robot, run: Run) -> Run:
    """Return a run whose free base does not begin in the floor, as odometry does that counts from where it began."""
    if not robot.floating:
        return run
    model = robot.model
    data = mujoco.MjData(model)
    begin_s = max(each.time_s[0] for each in run.base)
    at = np.array([begin_s])
    free = int(model.joint(robot.floating).qposadr[0])
    data.qpos[free : free + len(BASE_COLUMNS)] = [float(each.at(at)[0]) for each in run.base]
    for name in robot.joints:
        data.joint(name).qpos[0] = float(run.measured[name, Quantity.POSITION].at(at)[0])
    mujoco.mj_forward(model, data)
    fixed = model.body_weldid[model.geom_bodyid] == 0
    depths = [-float(each.dist) for each in data.contact if fixed[each.geom1] or fixed[each.geom2]]
    depth = max(depths, default=0.0)
    if depth <= _SUNK_M:
        return run
    base = (*run.base[:2], run.base[2].changed(1.0, depth), *run.base[3:])
    note = f"odometry of {run.name} has the robot {depth:.3g} m in the floor where it begins: it is lifted by that"
    return replace(run, base=base, notes=(*run.notes, note))
