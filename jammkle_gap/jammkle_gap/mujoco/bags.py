"""What a bag holds of a robot: joint states, set points as a controller plays them, sensors, and the base's pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.interpolate import BPoly  # type: ignore[import-untyped]  # carries no types

from jammkle_common.bags.reading import name_of, opened
from jammkle_common.bags.times import BagTimes
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_gap.core.data import BadRecordingError
from jammkle_gap.mujoco.runs import FEWEST, Base, Quantity, Run, Sense, Track, checked, held

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from jammkle_common.bags.reading import BagReader
    from jammkle_common.bags.storage import Connection
    from jammkle_gap.mujoco.runs import RobotMap, Tracks

_STATE = "sensor_msgs/msg/JointState"
_TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
_ARRAY = "std_msgs/msg/Float64MultiArray"
_STATES_END = "joint_states"
_IMU, _WRENCH = "sensor_msgs/msg/Imu", "geometry_msgs/msg/WrenchStamped"
_ODOMETRY = "nav_msgs/msg/Odometry"
_Samples = dict[tuple[str, Quantity], list[tuple[float, float]]]
"""By joint and quantity, times and values."""


def run_of_bag(path: Path, given: RobotMap, order: Sequence[str] = ()) -> Run:
    """Read `joint_states` and commands of a bag.

    Args:
        path: The bag.
        given: Which topic commands are on, and what commands without names are.
        order: Joints that commands without names are taken for, where the map does not say.

    Raises:
        BadRecordingError: it has no joint states, or several topics of commands.
        InputError: it cannot be read.

    """
    with opened(path) as reader:
        states = _States(reader, path, given)
        commanding = _commanding(reader, path, given)
        times = BagTimes(reader)
        if times.rewound:
            msg = f"bag {path} cannot be put in order: {times.rewound}; record it anew"
            raise BadRecordingError(msg)
        commands = _Commands(given.order or tuple(order), given.quantity, name_of(path))
        sensing = [each for each in reader.connections if each.msgtype in {_IMU, _WRENCH} and each.msgcount]
        sensed: dict[tuple[str, str, Sense], list[tuple[float, ...]]] = {}
        moving = [each for each in reader.connections if each.msgtype == _ODOMETRY and each.msgcount]
        if given.base is not Base.HELD and len({each.topic for each in moving}) > 1:
            msg = f"bag {path} holds odometry on {', '.join(sorted(each.topic for each in moving))}"
            msg += "; leave all but one topic out of the bag"
            raise BadRecordingError(msg)
        poses: list[tuple[float, ...]] = []
        kept = [*states.connections, *commanding, *sensing, *moving]
        begin_ns: int | None = None
        for connection, time_ns, _, data in times.messages(kept):
            begin_ns = time_ns if begin_ns is None else begin_ns
            time_s = (time_ns - begin_ns) / NANOSECONDS_PER_SECOND
            message = reader.deserialize(data, connection.msgtype)
            if connection in commanding:
                commands.take(connection.msgtype, time_s, message)
                continue
            if connection in sensing:
                for sense, vector in _vectors(connection.msgtype, message):
                    key = connection.topic, message.header.frame_id, sense
                    sensed.setdefault(key, []).append((time_s, vector.x, vector.y, vector.z))
                continue
            if connection in moving:
                at, turn = message.pose.pose.position, message.pose.pose.orientation
                poses.append((time_s, at.x, at.y, at.z, turn.w, turn.x, turn.y, turn.z))
                continue
            states.take(connection, time_s, message)
        measured = states.tracks()
        commanded = commands.tracks(measured)
        named, doubts = _by_name(sensed, given)
        notes = (*commands.notes, *states.notes, *doubts, *times.doubts.values())
    senses = {key: axes for key, rows in named.items() if (axes := _rising(rows))}
    return checked(Run(name_of(path), measured, commanded, notes, senses, _rising(poses)))


def _by_name(
    sensed: Mapping[tuple[str, str, Sense], list[tuple[float, ...]]], given: RobotMap
) -> tuple[dict[tuple[str, Sense], list[tuple[float, ...]]], list[str]]:
    """Return readings of sensors by the topic that the map names, or by their frame, if that is of one topic alone.

    Two topics with one frame are one sensor's raw and filtered readings, or two sensors'.
    """
    found: dict[tuple[str, Sense], list[tuple[float, ...]]] = {}
    notes = []
    for (topic, frame, sense), rows in sensed.items():
        if topic in given.sensors:
            found[topic, sense] = rows
            continue
        topics = sorted(each for each, of, kind in sensed if (of, kind) == (frame, sense))
        if len(topics) == 1:
            found[frame, sense] = rows
        elif not any(each in given.sensors for each in topics):
            note = f"{' and '.join(topics)} have one frame, {frame}, and are left out"
            notes.append(f"{note}; name one in the map (sensors: {{{topics[0]}: SITE}})")
    return found, list(dict.fromkeys(notes))


class _States:
    """Joint states by joint and quantity."""

    def __init__(self, reader: BagReader, path: Path, given: RobotMap) -> None:
        """Find their topics."""
        self._path = path
        found = [each for each in reader.connections if each.msgtype == _STATE and each.topic.endswith(_STATES_END)]
        if not found:
            types = ", ".join(sorted({each.msgtype for each in reader.connections})) or "nothing"
            msg = f"bag {path} holds no {_STATES_END} ({_STATE}), but {types}; record that topic"
            raise BadRecordingError(msg)
        self._topics = ", ".join(sorted({each.topic for each in found}))
        if given.states is not None:
            found = [each for each in found if each.topic == f"/{given.states.strip('/')}"]
            if not found:
                raise BadRecordingError(self._which("joint states"))
        self.connections = found
        self._found_on: dict[str, str] = {}
        self._samples: _Samples = {}
        self.notes: list[str] = []

    def _which(self, what: str) -> str:
        return f"bag {self._path} holds {what} on {self._topics}; name one of these in the map (states: /joint_states)"

    def take(self, connection: Connection, time_s: float, message: Any) -> None:
        """Take a message."""
        for joint in message.name:
            if self._found_on.setdefault(joint, connection.topic) != connection.topic:
                raise BadRecordingError(self._which(f"joint {joint} twice,"))
        _take_joints(self._samples, time_s, message)

    def tracks(self) -> Tracks:
        """Return all readings by rising times."""
        found = {}
        for key, track in _numbers(self._samples, "readings", self.notes).items():
            kept = np.concatenate(([True], np.diff(track.time_s) > 0.0))
            if kept.mean() < _MOSTLY:
                share = f"{100.0 * (1.0 - kept.mean()):.0f} %"
                msg = f"bag {self._path}: {share} of the stamps of joint {key[0]} do not rise"
                msg += "; record one publisher with a steady clock"
                raise BadRecordingError(msg)
            found[key] = Track(track.time_s[kept], track.values[kept])
        return found


_MOSTLY = 0.99
"""Share of a joint's stamps that must rise."""


def _take_joints(samples: _Samples, time_s: float, message: Any) -> None:
    """Take what a JointState says of each joint."""
    for quantity in Quantity:
        _take(samples, time_s, message.name, quantity, getattr(message, quantity.value))


def _take(samples: _Samples, time_s: float, joints: Sequence[str], quantity: Quantity, row: Iterable[float]) -> None:
    for joint, value in zip(joints, row, strict=False):
        samples.setdefault((joint, quantity), []).append((time_s, float(value)))


def _numbers(samples: _Samples, what: str, notes: list[str]) -> dict[tuple[str, Quantity], Track]:
    """Return samples by time, those of the same time in the order in which they came, and note what is no number.

    Of what is never a number nothing is noted: interfaces without a sensor are published as NaN.
    """
    found = {}
    for (joint, quantity), rows in samples.items():
        table = np.array(rows)
        table = table[np.argsort(table[:, 0], kind="stable")]
        kept = np.isfinite(table[:, 1])
        if not kept.any():
            continue
        if not kept.all():
            of_all = f"{(~kept).sum()} of {len(kept)} {what} of {joint} ({quantity.value})"
            notes.append(f"{of_all} are no numbers: left out")
        found[joint, quantity] = Track(table[kept, 0], table[kept, 1])
    return found


def _rising(rows: Sequence[tuple[float, ...]]) -> tuple[Track, ...]:
    """Return the columns of rows that begin with a time; those whose time does not rise, or no numbers, are left out.

    Returns:
        Empty where there are too few.

    """
    table = np.array(sorted(rows))
    table = table[np.isfinite(table).all(axis=1)] if len(table) else table
    table = table[np.concatenate(([True], np.diff(table[:, 0]) > 0.0))] if len(table) else table
    return tuple(Track(table[:, 0], column) for column in table.T[1:]) if len(table) >= FEWEST else ()


def _vectors(message_type: str, message: Any) -> tuple[tuple[Sense, Any], ...]:
    """Return what an IMU, or a sensor of force and torque, has read."""
    if message_type == _IMU:
        return (Sense.ACCELERATION, message.linear_acceleration), (Sense.RATE, message.angular_velocity)
    return (Sense.FORCE, message.wrench.force), (Sense.TORQUE, message.wrench.torque)


def _commanding(reader: BagReader, path: Path, given: RobotMap) -> list[Connection]:
    """Return the topic of the commands, if there is one."""
    found = [
        each
        for each in reader.connections
        if each.msgcount
        and (each.msgtype in {_TRAJECTORY, _ARRAY} or (each.msgtype == _STATE and not each.topic.endswith(_STATES_END)))
    ]
    topics = sorted({each.topic for each in found})
    if given.topic is not None:
        asked = f"/{given.topic.strip('/')}"
        if asked not in topics:
            msg = f"bag {path} holds no commands on {asked}, but on: {', '.join(topics) or 'no topic'}"
            msg += "; name one of these in the map (commands: {topic: ...})"
            raise BadRecordingError(msg)
        return [each for each in found if each.topic == asked]
    if len(topics) > 1:
        msg = f"bag {path} holds commands on {', '.join(topics)}; name one in the map (commands: {{topic: ...}})"
        raise BadRecordingError(msg)
    return found


class _Commands:
    """Set points as a controller plays them: a trajectory from its first point on, anything else until the next."""

    def __init__(self, order: Sequence[str], quantity: Quantity, bag: str) -> None:
        self._order, self._quantity, self._bag = tuple(order), quantity, bag
        self._points: _Samples = {}
        self._trajectories: dict[tuple[str, Quantity], list[_Trajectory]] = {}
        self.notes: list[str] = []

    def take(self, message_type: str, time_s: float, message: Any) -> None:
        """Take a message."""
        if message_type == _TRAJECTORY:
            self._take_trajectory(time_s, message)
        elif message_type == _STATE:
            _take_joints(self._points, time_s, message)
        else:
            if len(message.data) != len(self._order):
                msg = f"bag {self._bag} holds commands of {len(message.data)} numbers without names"
                msg += f", and the map or the model names {len(self._order)} joints"
                msg += "; name the joint of each in the map (commands: {order: [...], quantity: position})"
                raise BadRecordingError(msg)
            note = f"numbers of the commands are taken for the {self._quantity.value} of {', '.join(self._order)}"
            if note not in self.notes:
                self.notes.append(note)
            _take(self._points, time_s, self._order, self._quantity, message.data)

    def _take_trajectory(self, time_s: float, message: Any) -> None:
        lasts = [point.time_from_start for point in message.points]
        at_s = np.array([each.sec + each.nanosec / NANOSECONDS_PER_SECOND for each in lasts])
        for column, joint in enumerate(message.joint_names):
            rows = [
                np.array([getattr(point, name)[column] for point in message.points if len(getattr(point, name))])
                for name in ("positions", "velocities", "accelerations", "effort")
            ]
            if not len(at_s) or len(rows[0]) != len(at_s):
                continue
            if not np.isfinite(rows[0]).all():
                note = f"trajectories of {joint} with positions that are no numbers are left out"
                self.notes += [note] if note not in self.notes else []
                continue
            given = [len(row) == len(at_s) and bool(np.isfinite(row).all()) for row in rows]
            derivatives = rows[: given.index(False) if False in given[:3] else 3]
            played = _Trajectory(time_s, at_s, np.column_stack(derivatives))
            self._trajectories.setdefault((joint, Quantity.POSITION), []).append(played)
            if given[3]:
                fed = _Trajectory(time_s, at_s, rows[3][:, np.newaxis])
                self._trajectories.setdefault((joint, Quantity.EFFORT), []).append(fed)

    def tracks(self, measured: Tracks) -> Tracks:
        """Return all set points; a joint without any before its first trajectory is where it was measured."""
        found = {key: held(track) for key, track in _numbers(self._points, "commands", self.notes).items()}
        for key, trajectories in self._trajectories.items():
            start = measured.get(key) if key[1] is Quantity.POSITION else None
            first = trajectories[0].points[0, 0] if start is None else start.values[0]
            found[key] = _played(trajectories, float(first))
        return found


_SPLINE_S = 0.005
"""Between the points at which a spline is taken, s. Chosen: a controller's own rate is 100 to 1000 Hz."""


@dataclass(frozen=True)
class _Trajectory:
    """What a message asks of a joint."""

    begin_s: float
    at_s: NDArray[np.float64]
    """Since then, shape (points,), s."""
    points: NDArray[np.float64]
    """Value, and its first and second derivative as far as they are given, shape (points, 1 to 3)."""


def _played(trajectories: Sequence[_Trajectory], start: float) -> Track:
    """Return the set point of a joint as joint_trajectory_controller plays trajectories, each until the next.

    Straight from point to point, by cubic splines where velocities are given, and by quintic ones where accelerations
    are, too. A trajectory begins at its own point at time zero, if it has one, or else from where the one before has
    come to by then, as fast as that was, where velocities are given: so it is with `interpolate_from_desired_state`;
    without it the controller begins from what it measures.
    """
    times, values, state = [trajectories[0].begin_s], [start], [start, 0.0, 0.0]
    ends = [each.begin_s for each in trajectories[1:]] + [np.inf]
    for each, end_s in zip(trajectories, ends, strict=True):
        rising = np.diff(each.at_s, prepend=-1.0) > 0.0
        knots, through = each.at_s[rising], each.points[rising]
        if knots[0] > 0.0:
            knots, through = np.append(0.0, knots), np.vstack([state[: through.shape[1]], through])
        left_s = min(end_s - each.begin_s, knots[-1])
        own, points, state = np.zeros(1), through[:1, 0], [float(through[0, 0]), 0.0, 0.0]
        if left_s > 0.0:
            curve = BPoly.from_derivatives(knots, through)
            fine = np.linspace(0.0, knots[-1], max(int(knots[-1] / _SPLINE_S), 2)) if through.shape[1] > 1 else knots
            own = np.append(fine[fine < left_s], left_s)
            points = curve(own)
            # beyond its end the controller keeps what the last point says of derivatives
            state = [float(curve.derivative(k)(left_s)) if k < through.shape[1] else 0.0 for k in range(3)]
        times += (each.begin_s + own).tolist()
        values += points.tolist()
        if np.isfinite(end_s):
            times.append(end_s)
            values.append(values[-1])
    return Track(np.array(times), np.array(values))
