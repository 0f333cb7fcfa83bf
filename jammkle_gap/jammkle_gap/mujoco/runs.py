"""What was recorded of a robot: angles, efforts and commands by joint, from bags, CSV files or arrays.

Names, signs, offsets and units follow a map where recording and model do not agree:

    joints:
      shoulder_pan_joint: {model: joint1, sign: -1, offset: 0.1}   # model's = sign * recorded + offset
      gripper: locked                                              # or: elbow_joint: joint3
    units: degrees
    commands: {topic: /arm/commands, order: [joint1, joint2], quantity: position}
    gains: {joint1: {kp: 100, kd: 3}}      # of a controller that is not in the model
    torque_constants: {joint1: 0.12}       # N m/A, where efforts are currents
    base: held                             # or free, or measured: as odometry says
    noise: {position: 0.001, effort: 0.1}  # of one reading, by the data sheet
    tolerances: {friction: 0.5}            # of what the model says, as a standard deviation and share of it
    sensors: {/wrist/wrench: {site: flange, sign: -1}}  # IMU, force and torque: topic, or frame, and site of the model
"""

from __future__ import annotations

import csv
from dataclasses import dataclass, field, replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml
from scipy.interpolate import CubicHermiteSpline  # type: ignore[import-untyped]  # carries no types

from jammkle_common.bags.reading import name_of, opened
from jammkle_common.bags.times import BagTimes
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_gap.core.data import BadRecordingError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import ArrayLike, NDArray

    from jammkle_common.bags.reading import BagReader, Connection


class BadRobotError(ValueError):
    """Model, map and recording do not fit together; the message names what does not, and what would."""


class Quantity(Enum):
    """What is measured or commanded of a joint."""

    POSITION = "position"
    VELOCITY = "velocity"
    EFFORT = "effort"


class Sense(Enum):
    """What a sensor at a site of the model reads along each of its axes."""

    ACCELERATION = "acceleration"
    """Specific force (REP 145), m/s^2."""
    RATE = "angular_velocity"
    """rad/s."""
    FORCE = "force"
    """Of the site's body on its parent, N."""
    TORQUE = "torque"
    """N m."""


AXES = ("x", "y", "z")


class Base(Enum):
    """What becomes of a floating base."""

    HELD = "held"
    """Fixed where the model has it, as on a stand."""
    FREE = "free"
    """Left to move, from where the model has it."""
    MEASURED = "measured"
    """Moved as odometry measured it."""


BASE_COLUMNS = ("x", "y", "z", "qw", "qx", "qy", "qz")
"""Of a base's pose: m, and a quaternion."""


@dataclass(frozen=True)
class Track:
    """One number over time."""

    time_s: NDArray[np.float64]
    """Not falling, shape (n,), s."""
    values: NDArray[np.float64]
    """Shape (n,), SI; between two times straight, so that a step has two values at one time."""

    def at(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the values at some times; before and after as at the ends."""
        found: NDArray[np.float64] = np.interp(time_s, self.time_s, self.values)
        return found

    def mean_about(self, time_s: NDArray[np.float64], width_s: float) -> NDArray[np.float64]:
        """Return means over stretches about some times, so that a step that falls on one of them counts half."""
        times, values = self.time_s, self.values
        spans = np.diff(times)
        area = np.concatenate(([0.0], np.cumsum(0.5 * spans * (values[1:] + values[:-1]))))
        slopes = np.append(np.divide(np.diff(values), spans, out=np.zeros_like(spans), where=spans > 0.0), 0.0)

        def integral(at: NDArray[np.float64]) -> NDArray[np.float64]:
            last = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 1)
            since = at - times[last]
            slope = np.where(since < 0.0, 0.0, slopes[last])  # before the first it is as there
            found: NDArray[np.float64] = area[last] + since * (values[last] + 0.5 * slope * since)
            return found

        return (integral(time_s + 0.5 * width_s) - integral(time_s - 0.5 * width_s)) / width_s

    def changed(self, factor: float, offset: float) -> Track:
        """Return `factor * values + offset`."""
        return Track(self.time_s, factor * self.values + offset)


Tracks = dict[tuple[str, Quantity], Track]
"""By joint and quantity."""


Senses = dict[tuple[str, Sense], tuple[Track, Track, Track]]
"""By site and sense, along x, y and z of the site."""


@dataclass(frozen=True)
class Run:
    """One recording of a robot, by the names of its joints."""

    name: str
    measured: Tracks
    commands: Tracks
    """Empty where nothing was commanded: efforts are then what moved it."""
    notes: tuple[str, ...] = ()
    sensed: Senses = field(default_factory=dict)
    """By frame or topic at first, and by site in the model's terms."""
    base: tuple[Track, ...] = ()
    """Pose of a floating base, by `BASE_COLUMNS`; empty: not measured."""

    def joints(self) -> tuple[str, ...]:
        """Return the joints whose position was measured."""
        return tuple(name for name, quantity in self.measured if quantity is Quantity.POSITION)


@dataclass(frozen=True)
class Gains:
    """Of a PD controller that acts on a joint: N m/rad and N m s/rad, or N/m and N s/m."""

    kp: float
    kd: float


@dataclass(frozen=True)
class JointMap:
    """What a recorded joint is in the model."""

    model: str
    sign: float = 1.0
    offset: float = 0.0
    """rad or m: model's = sign * recorded + offset."""


@dataclass(frozen=True)
class SensorMap:
    """Where a recorded sensor is in the model."""

    site: str
    sign: float = 1.0


@dataclass(frozen=True)
class RobotMap:
    """What recording and model call differently, and what neither says."""

    joints: Mapping[str, JointMap] = field(default_factory=dict)
    """By recorded name; those not in it have the model's names."""
    locked: tuple[str, ...] = ()
    """Joints of the model that are held."""
    degrees: bool | None = None
    """Whether angles are in degrees; None: radians, and doubted where the model's limits say so."""
    topic: str | None = None
    """Of the commands; None: the only one that there is."""
    order: tuple[str, ...] = ()
    """Joints of commands without names."""
    quantity: Quantity = Quantity.POSITION
    """Of commands without names."""
    gains: Mapping[str, Gains] = field(default_factory=dict)
    """By the model's joint."""
    torque_constants: Mapping[str, float] = field(default_factory=dict)
    """N m/A by the model's joint, of those whose efforts are currents."""
    base: Base = Base.HELD
    noise: Mapping[Quantity, float] = field(default_factory=dict)
    """Standard deviation of one reading, SI; those not in it are estimated."""
    tolerances: Mapping[str, float] = field(default_factory=dict)
    """Standard deviation of what the model says of every body, joint or drive, as a share of it, by `TOLERATED`."""
    sensors: Mapping[str, SensorMap] = field(default_factory=dict)
    """By topic or frame; those not in it have the name of a site as their frame."""


_KEYS = ("joints", "units", "commands", "gains", "torque_constants", "base", "noise", "tolerances", "sensors")
TOLERATED = ("mass", "length", "gain", "friction", "damping", "armature")
_LOCKED = "locked"


def read_map(source: Path | Mapping[str, Any] | None) -> RobotMap:
    """Read a map from a YAML file, or from what such a file would hold.

    Raises:
        BadRobotError: it cannot be read, or has a key or a value that it cannot have.

    """
    where = f"map {source}" if isinstance(source, Path) else "the map"
    try:
        table = yaml.safe_load(source.read_text(encoding="utf-8")) if isinstance(source, Path) else source
        return _map_of(dict(table or {}), where)
    except BadRobotError:
        raise
    except (OSError, UnicodeDecodeError, yaml.YAMLError, TypeError, ValueError, AttributeError, KeyError) as error:
        msg = f"{where} cannot be used: {' '.join(str(error).split())}; see docs/any_robot.md for its keys"
        raise BadRobotError(msg) from error


def _map_of(table: dict[str, Any], where: str) -> RobotMap:
    _check_keys(table, _KEYS, where)
    joints, locked = {}, []
    for name, said in dict(table.get("joints") or {}).items():
        if said == _LOCKED:
            locked.append(str(name))
        elif isinstance(said, str):
            joints[str(name)] = JointMap(said)
        else:
            _check_keys(said, ("model", "sign", "offset"), f"{where}, joint {name}")
            sign = float(said.get("sign", 1.0))
            if abs(sign) != 1.0:
                msg = f"{where}, joint {name}: sign {sign:g} must be 1 or -1"
                raise BadRobotError(msg)
            joints[str(name)] = JointMap(str(said.get("model", name)), sign, float(said.get("offset", 0.0)))
    units = table.get("units")
    if units not in {None, "degrees", "radians"}:
        msg = f"{where}: units '{units}' must be degrees or radians"
        raise BadRobotError(msg)
    commands = dict(table.get("commands") or {})
    _check_keys(commands, ("topic", "order", "quantity"), f"{where}, commands")
    gains = {}
    for name, said in dict(table.get("gains") or {}).items():
        _check_keys(said, ("kp", "kd"), f"{where}, gains of {name}")
        gains[str(name)] = Gains(float(said["kp"]), float(said.get("kd", 0.0)))
    tolerances = {str(name): float(value) for name, value in dict(table.get("tolerances") or {}).items()}
    _check_keys(tolerances, TOLERATED, f"{where}, tolerances")
    for name, value in tolerances.items():
        if not 0.0 < value < 1.0:
            msg = f"{where}, tolerances: {name} {value:g} must be a share of what the model says, above 0 and below 1"
            raise BadRobotError(msg)
    return RobotMap(
        joints,
        tuple(locked),
        None if units is None else units == "degrees",
        commands.get("topic"),
        tuple(map(str, commands.get("order") or ())),
        Quantity(commands.get("quantity", "position")),
        gains,
        {str(name): float(value) for name, value in dict(table.get("torque_constants") or {}).items()},
        Base(table.get("base", "held")),
        {Quantity(name): float(value) for name, value in dict(table.get("noise") or {}).items()},
        tolerances,
        {str(name): _sensor_of(said, f"{where}, sensor {name}") for name, said in _table(table, "sensors").items()},
    )


def _table(table: Mapping[str, Any], key: str) -> dict[str, Any]:
    return dict(table.get(key) or {})


def _sensor_of(said: Any, where: str) -> SensorMap:
    if isinstance(said, str):
        return SensorMap(said)
    _check_keys(said, ("site", "sign"), where)
    return SensorMap(str(said["site"]), float(said.get("sign", 1.0)))


def _check_keys(table: Mapping[str, Any], known: Sequence[str], where: str) -> None:
    strange = [str(key) for key in table if key not in known]
    if strange:
        msg = f"{where} has the key '{strange[0]}'; it may have: {', '.join(known)}"
        raise BadRobotError(msg)


def run_of_arrays(
    name: str,
    time_s: ArrayLike,
    measured: Mapping[str, ArrayLike],
    commands: Mapping[str, ArrayLike] | None = None,
    notes: tuple[str, ...] = (),
) -> Run:
    """Return a run from arrays on one clock.

    Args:
        name: Of the run.
        time_s: Rising, shape (n,), s.
        measured: By `joint.position`, `joint.velocity`, `joint.effort`; by `site.acceleration.x`,
            `site.angular_velocity.x`, `site.force.x`, `site.torque.x` and so on; and, of a floating base, by `base.x`,
            `base.y`, `base.z`, `base.qw`, `base.qx`, `base.qy`, `base.qz`; each of shape (n,), SI.
        commands: By the same names, as they were in force at these times.
        notes: What the reader of the diagnosis should know.

    Raises:
        BadRecordingError: a name or a shape is not as said, or a time does not rise.

    """
    times = np.asarray(time_s, dtype=float)
    if times.ndim != 1 or times.size < _FEWEST or (np.diff(times) <= 0.0).any():
        msg = f"recording {name} has times that do not rise, or fewer than {_FEWEST}; give one rising time per sample"
        raise BadRecordingError(msg)
    tables: list[Tracks] = []
    sensed, measured = _split_sensed(measured)
    posed = [f"base.{each}" for each in BASE_COLUMNS]
    base: tuple[Track, ...] = ()
    if all(name in measured for name in posed):
        base = tuple(Track(times - times[0], np.asarray(measured[name], dtype=float)) for name in posed)
        measured = {name: values for name, values in measured.items() if name not in posed}
    for columns in (measured, commands or {}):
        tracks: Tracks = {}
        for column, given in columns.items():
            joint, _, quantity = column.rpartition(".")
            values = np.asarray(given, dtype=float)
            if not joint or quantity not in {each.value for each in Quantity} or values.shape != times.shape:
                msg = f"recording {name} has a column '{column}' of shape {values.shape}"
                msg += f"; it must be JOINT.position, JOINT.velocity or JOINT.effort, of shape {times.shape}"
                msg += ", or of a sensor SITE.force.x and so on, with all of its axes"
                raise BadRecordingError(msg)
            finite = np.isfinite(values)
            if finite.any():
                tracks[joint, Quantity(quantity)] = Track(times[finite] - times[0], values[finite])
        tables.append(tracks)
    commanded = {key: _held(track) for key, track in tables[1].items()}
    since_s = times - times[0]
    senses: Senses = {}
    for sensor, axes in sensed.items():
        x, y, z = (Track(since_s, np.asarray(each, dtype=float)) for each in axes)
        senses[sensor] = (x, y, z)
    return _checked(Run(name, tables[0], commanded, notes, senses, base))


def _split_sensed(
    columns: Mapping[str, ArrayLike],
) -> tuple[dict[tuple[str, Sense], list[ArrayLike]], dict[str, ArrayLike]]:
    """Return the columns of sensors that have all of their axes, and the others."""
    found, rest = {}, dict(columns)
    for column in columns:
        site, _, sense = column.removesuffix(".x").rpartition(".")
        names = [f"{site}.{sense}.{axis}" for axis in AXES]
        if sense in {each.value for each in Sense} and all(name in columns for name in names):
            found[site, Sense(sense)] = [rest.pop(name) for name in names]
    return found, rest


_FEWEST = 20
"""Samples of a recording. Chosen: fewer cannot be differentiated."""
_TIME, _COMMAND = "time_s", "command."


def run_of_csv(path: Path) -> Run:
    """Read a CSV file with the columns `time_s`, `JOINT.position` and so on, `command.JOINT.position` and so on.

    Raises:
        BadRecordingError: it cannot be read, or its columns are others.

    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.reader(file))
        names = [each.strip() for each in rows[0]]
        table = np.array([[float(cell) if cell.strip() else np.nan for cell in row] for row in rows[1:] if row])
        columns = dict(zip(names, table.T, strict=True))
        times = columns.pop(_TIME)
    except (OSError, UnicodeDecodeError, ValueError, IndexError, KeyError) as error:
        msg = f"{path} cannot be read as CSV ({' '.join(str(error).split())})"
        msg += f"; it must have a row of names ({_TIME}, JOINT.position, {_COMMAND}JOINT.position) and rows of numbers"
        raise BadRecordingError(msg) from error
    measured = {name: values for name, values in columns.items() if not name.startswith(_COMMAND)}
    commands = {name[len(_COMMAND) :]: values for name, values in columns.items() if name.startswith(_COMMAND)}
    return run_of_arrays(path.name, times, measured, commands)


_STATE = "sensor_msgs/msg/JointState"
_TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
_ARRAY = "std_msgs/msg/Float64MultiArray"
_STATES_END = "joint_states"
_IMU, _WRENCH = "sensor_msgs/msg/Imu", "geometry_msgs/msg/WrenchStamped"
_ODOMETRY = "nav_msgs/msg/Odometry"


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
        states = [each for each in reader.connections if each.msgtype == _STATE and each.topic.endswith(_STATES_END)]
        if not states:
            types = ", ".join(sorted({each.msgtype for each in reader.connections})) or "nothing"
            msg = f"bag {path} holds no {_STATES_END} ({_STATE}), but {types}; record that topic"
            raise BadRecordingError(msg)
        commanding = _commanding(reader, path, given)
        times = BagTimes(reader)
        samples: dict[tuple[str, Quantity], tuple[list[float], list[float]]] = {}
        commands = _Commands(given.order or tuple(order), given.quantity, name_of(path))
        sensing = [each for each in reader.connections if each.msgtype in {_IMU, _WRENCH} and each.msgcount]
        sensed = _Sensed(given)
        moving = [each for each in reader.connections if each.msgtype == _ODOMETRY and each.msgcount]
        if given.base is Base.MEASURED and len({each.topic for each in moving}) > 1:
            msg = f"bag {path} holds odometry on {', '.join(sorted(each.topic for each in moving))}"
            msg += "; leave all but one topic out of the bag"
            raise BadRecordingError(msg)
        poses: list[tuple[float, ...]] = []
        kept = [*states, *commanding, *sensing, *moving]
        begin_ns: int | None = None
        for connection, time_ns, _, data in times.messages(kept):
            begin_ns = time_ns if begin_ns is None else begin_ns
            time_s = (time_ns - begin_ns) / NANOSECONDS_PER_SECOND
            message = reader.deserialize(data, connection.msgtype)
            if connection in commanding:
                commands.take(connection.msgtype, time_s, message)
                continue
            if connection in sensing:
                sensed.take(connection, time_s, message)
                continue
            if connection in moving:
                at, turn = message.pose.pose.position, message.pose.pose.orientation
                poses.append((time_s, at.x, at.y, at.z, turn.w, turn.x, turn.y, turn.z))
                continue
            for quantity, row in _rows(message):
                for joint, value in zip(message.name, row, strict=False):
                    if np.isfinite(value):
                        kept_times, values = samples.setdefault((joint, quantity), ([], []))
                        kept_times.append(time_s)
                        values.append(float(value))
        notes = [*commands.notes, *times.doubts.values()]
    measured = {key: _in_order(path, key, *lists) for key, lists in samples.items()}
    base = tuple(_rising(poses))
    return _checked(Run(name_of(path), measured, commands.tracks(measured), tuple(notes), sensed.tracks(), base))


def _rising(rows: Sequence[tuple[float, ...]]) -> list[Track]:
    """Return the columns of rows that begin with a time; those whose time does not rise, or no numbers, are left out.

    Returns:
        Empty where there are too few.

    """
    table = np.array(sorted(rows))
    table = table[np.isfinite(table).all(axis=1)] if len(table) else table
    table = table[np.concatenate(([True], np.diff(table[:, 0]) > 0.0))] if len(table) else table
    return [Track(table[:, 0], column) for column in table.T[1:]] if len(table) >= _FEWEST else []


class _Sensed:
    """Readings of IMUs and of force and torque, by topic where the map names it, else by frame."""

    def __init__(self, given: RobotMap) -> None:
        self._given = given
        self._rows: dict[tuple[str, Sense], list[tuple[float, float, float, float]]] = {}

    def take(self, connection: Connection, time_s: float, message: Any) -> None:
        """Take a message."""
        name = connection.topic if connection.topic in self._given.sensors else message.header.frame_id
        if connection.msgtype == _IMU:
            parts = {Sense.ACCELERATION: message.linear_acceleration, Sense.RATE: message.angular_velocity}
        else:
            parts = {Sense.FORCE: message.wrench.force, Sense.TORQUE: message.wrench.torque}
        for sense, each in parts.items():
            self._rows.setdefault((name, sense), []).append((time_s, each.x, each.y, each.z))

    def tracks(self) -> Senses:
        """Return all readings."""
        found = {}
        for key, rows in self._rows.items():
            if axes := _rising(rows):
                x, y, z = axes
                found[key] = (x, y, z)
        return found


def _commanding(reader: BagReader, path: Path, given: RobotMap) -> list[Connection]:
    """Return the topic of the commands, if there is one.

    Raises:
        BadRecordingError: there are several, or not the one that the map names.

    """
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


def _rows(message: Any) -> Iterable[tuple[Quantity, Any]]:
    return (
        (Quantity.POSITION, message.position),
        (Quantity.VELOCITY, message.velocity),
        (Quantity.EFFORT, message.effort),
    )


class _Commands:
    """Set points as a controller plays them: a trajectory from its first point on, anything else until the next."""

    def __init__(self, order: Sequence[str], quantity: Quantity, bag: str) -> None:
        self._order, self._quantity, self._bag = tuple(order), quantity, bag
        self._points: dict[tuple[str, Quantity], tuple[list[float], list[float]]] = {}
        self._trajectories: dict[str, list[tuple[float, NDArray[np.float64], NDArray[np.float64], Any]]] = {}
        self.notes: list[str] = []

    def take(self, message_type: str, time_s: float, message: Any) -> None:
        """Take a message."""
        if message_type == _TRAJECTORY:
            self._take_trajectory(time_s, message)
        elif message_type == _STATE:
            for quantity, row in _rows(message):
                self._hold(time_s, message.name, quantity, row)
        else:
            if len(message.data) != len(self._order):
                msg = f"bag {self._bag} holds commands of {len(message.data)} numbers without names"
                msg += "; name their joints in the map (commands: {order: [...], quantity: position})"
                raise BadRecordingError(msg)
            note = f"numbers of the commands are taken for the {self._quantity.value} of {', '.join(self._order)}"
            if note not in self.notes:
                self.notes.append(note)
            self._hold(time_s, self._order, self._quantity, message.data)

    def _hold(self, time_s: float, names: Sequence[str], quantity: Quantity, row: Any) -> None:
        for joint, value in zip(names, row, strict=False):
            if np.isfinite(value):
                times, values = self._points.setdefault((joint, quantity), ([], []))
                times.append(time_s)
                values.append(float(value))

    def _take_trajectory(self, time_s: float, message: Any) -> None:
        lasts = [point.time_from_start for point in message.points]
        at_s = np.array([each.sec + each.nanosec / NANOSECONDS_PER_SECOND for each in lasts])
        for column, joint in enumerate(message.joint_names):
            positions = np.array([point.positions[column] for point in message.points if len(point.positions)])
            velocities = np.array([point.velocities[column] for point in message.points if len(point.velocities)])
            if len(positions) == len(at_s) and len(at_s):
                given = velocities if len(velocities) == len(at_s) else None
                self._trajectories.setdefault(joint, []).append((time_s, at_s, positions, given))

    def tracks(self, measured: Tracks) -> Tracks:
        """Return all set points; a joint without any before its first trajectory is where it was measured."""
        found = {}
        for key, (times, values) in self._points.items():
            order = np.argsort(times, kind="stable")
            found[key] = _held(Track(np.array(times)[order], np.array(values)[order]))
        for joint, trajectories in self._trajectories.items():
            start = measured.get((joint, Quantity.POSITION))
            first = trajectories[0][2][0] if start is None else start.values[0]
            found[joint, Quantity.POSITION] = _played(trajectories, float(first))
        return found


_SPLINE_S = 0.005
"""Between the points at which a spline is taken, s. Chosen: a controller's own rate is 100 to 1000 Hz."""


def _played(trajectories: Sequence[tuple[float, Any, Any, Any]], start: float) -> Track:
    """Return the set point of a joint as joint_trajectory_controller plays trajectories, each until the next.

    Straight from point to point, and by cubic splines where velocities are given, from where it is at the beginning.
    """
    times, values = [trajectories[0][0]], [start]
    ends = [each[0] for each in trajectories[1:]] + [np.inf]
    for (begin_s, at_s, positions, velocities), end_s in zip(trajectories, ends, strict=True):
        own, points = [0.0], [values[-1]]
        keep = at_s > 0.0
        if keep.any():
            knots, through = np.append(0.0, at_s[keep]), np.append(values[-1], positions[keep])
            own, points = knots.tolist(), through.tolist()
            if velocities is not None and knots.size > 1:
                spline = CubicHermiteSpline(knots, through, np.append(0.0, velocities[keep]))
                fine = np.linspace(0.0, knots[-1], max(int(knots[-1] / _SPLINE_S), 2))
                own, points = fine.tolist(), spline(fine).tolist()
        else:  # at once
            own, points = [0.0, 0.0], [values[-1], float(positions[-1])]
        left = end_s - begin_s
        inside = [k for k, each in enumerate(own) if each <= left]
        cut = [own[k] for k in inside], [points[k] for k in inside]
        last = float(np.interp(min(left, own[-1]), own, points)) if own[-1] > 0.0 else points[-1]
        times += [begin_s + each for each in cut[0]]
        values += cut[1]
        if np.isfinite(end_s):
            times.append(end_s)
            values.append(last)
    return Track(np.array(times), np.array(values))


def _held(track: Track) -> Track:
    """Return a track that stays at each value until the next."""
    times = np.repeat(track.time_s, 2)[1:]
    values = np.repeat(track.values, 2)[:-1]
    return Track(times, values)


def _in_order(path: Path, key: tuple[str, Quantity], times: list[float], values: list[float]) -> Track:
    """Return samples by rising times.

    Raises:
        BadRecordingError: more than a hundredth of them have a time that does not rise.

    """
    order = np.argsort(times, kind="stable")
    time_s, read = np.array(times)[order], np.array(values)[order]
    kept = np.concatenate(([True], np.diff(time_s) > 0.0))
    if kept.mean() < _MOSTLY:
        msg = f"bag {path}: {100.0 * (1.0 - kept.mean()):.0f} % of the stamps of joint {key[0]} do not rise"
        msg += "; record one publisher with a steady clock"
        raise BadRecordingError(msg)
    return Track(time_s[kept], read[kept])


_MOSTLY = 0.99


def _checked(run: Run) -> Run:
    """Return a run whose joints were measured.

    Raises:
        BadRecordingError: none was, or too shortly.

    """
    if not run.joints():
        msg = f"recording {run.name} holds no position of any joint; record joint_states with positions"
        raise BadRecordingError(msg)
    for joint in run.joints():
        count = run.measured[joint, Quantity.POSITION].time_s.size
        if count < _FEWEST:
            msg = f"recording {run.name} holds {count} positions of joint {joint}, fewer than {_FEWEST}; record longer"
            raise BadRecordingError(msg)
    return run


def in_model_terms(run: Run, given: RobotMap) -> Run:
    """Return a run by the names, signs, zeros and units of the model."""
    degrees = np.pi / 180.0 if given.degrees else 1.0

    def moved(tracks: Tracks) -> Tracks:
        found = {}
        for (joint, quantity), track in tracks.items():
            asked = given.joints.get(joint, JointMap(joint))
            factor = asked.sign * (1.0 if quantity is Quantity.EFFORT else degrees)
            offset = asked.offset if quantity is Quantity.POSITION else 0.0
            if quantity is Quantity.EFFORT:
                factor *= given.torque_constants.get(asked.model, 1.0)
            found[asked.model, quantity] = track.changed(factor, offset)
        return found

    sensed = {}
    for (name, sense), axes in run.sensed.items():
        asked = given.sensors.get(name, SensorMap(name))
        x, y, z = (each.changed(asked.sign, 0.0) for each in axes)
        sensed[asked.site, sense] = (x, y, z)
    base = _unflipped(run.base)
    return replace(run, measured=moved(run.measured), commands=moved(run.commands), sensed=sensed, base=base)


def _unflipped(base: tuple[Track, ...]) -> tuple[Track, ...]:
    """Return a pose whose quaternion does not jump to its opposite, which is the same orientation."""
    if not base:
        return base
    turns = np.array([each.values for each in base[3:]])
    signs = np.concatenate(([1.0], np.cumprod(np.where((turns[:, 1:] * turns[:, :-1]).sum(axis=0) < 0.0, -1.0, 1.0))))
    return (*base[:3], *(Track(each.time_s, signs * each.values) for each in base[3:]))
