"""What was recorded of a robot: angles, efforts and commands by joint, from bags, CSV files or arrays.

Names, signs, offsets and units follow a map where recording and model do not agree: `RobotMap`, docs/any_robot.md.
"""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from jammkle_common.command.errors import InputError
from jammkle_common.yaml_text import read_file
from jammkle_gap.core.data import BadRecordingError

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from numpy.typing import ArrayLike, NDArray


_Kind = TypeVar("_Kind", bound=Enum)


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

    @property
    def unit(self) -> str:
        """Of its readings."""
        return {Sense.ACCELERATION: "m/s^2", Sense.RATE: "rad/s", Sense.FORCE: "N", Sense.TORQUE: "N m"}[self]


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
Senses = dict[tuple[str, Sense], tuple[Track, ...]]
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
    prescribed: tuple[str, ...] = ()
    """Joints of the model that move as they were measured, whatever acts on them."""
    degrees: bool | None = None
    """Whether angles are in degrees; None: radians, and doubted where the model's limits say so."""
    command_degrees: bool | None = None
    """Whether commanded angles are; None: as the others."""
    states: str | None = None
    """Topic of the joint states; None: all that there are."""
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
    senses: bool = True
    """Whether sensors at sites are compared at all."""


_KEYS = (
    "model",  # for the command; a caller gives the model itself
    "joints",
    "units",
    "states",
    "commands",
    "gains",
    "torque_constants",
    "base",
    "noise",
    "tolerances",
    "sensors",
)
TOLERATED = ("mass", "length", "gain", "friction", "damping", "armature")
_LOCKED, _MEASURED, _NO_SENSORS = "locked", "measured", "none"


def read_map(source: Path | Mapping[str, Any] | None) -> RobotMap:
    """Read a map from a YAML file, or from what such a file would hold.

    Raises:
        BadRobotError: it cannot be read, or has a key or a value that it cannot have.

    """
    where = f"map {source}" if isinstance(source, Path) else "the map"
    try:
        table = read_file(source, where) if isinstance(source, Path) else source
    except InputError as error:
        msg = f"{error}; see docs/any_robot.md for its keys"
        raise BadRobotError(msg) from error
    return _map_of(_table(table or {}, where), where)


def _map_of(table: Mapping[str, Any], where: str) -> RobotMap:
    _check_keys(table, _KEYS, where)
    joints: dict[str, JointMap] = {}
    fixed: dict[str, list[str]] = {_LOCKED: [], _MEASURED: []}
    for name, given in _part(table, "joints", where).items():
        if isinstance(given, str) and given in fixed:
            fixed[given].append(name)
        else:
            joints[name] = _joint_of(name, given, f"{where}, joint {name}")
    commands = _part(table, "commands", where)
    _check_keys(commands, ("topic", "order", "quantity", "units"), f"{where}, commands")
    tolerances = _numbers(table, "tolerances", where)
    _check_keys(tolerances, TOLERATED, f"{where}, tolerances")
    for name, value in tolerances.items():
        if not 0.0 < value < 1.0:
            msg = f"{where}, tolerances: {name} {value:g} must be a share of what the model says, above 0 and below 1"
            raise BadRobotError(msg)
    noise = _numbers(table, "noise", where)
    for name, value in noise.items():
        if not value > 0.0:
            msg = f"{where}, noise: {name} {value:g} must be more than 0: the standard deviation of one reading"
            raise BadRobotError(msg)
    torque_constants = _numbers(table, "torque_constants", where)
    for name, value in torque_constants.items():
        if value == 0.0:
            msg = f"{where}, torque_constants: that of {name} must not be 0 (N m/A; below 0 where signs differ)"
            raise BadRobotError(msg)
    senses = table.get("sensors") != _NO_SENSORS
    sensors = _part(table, "sensors", where) if senses else {}
    return RobotMap(
        joints=joints,
        locked=tuple(fixed[_LOCKED]),
        prescribed=tuple(fixed[_MEASURED]),
        degrees=_in_degrees(table, where),
        command_degrees=_in_degrees(commands, f"{where}, commands"),
        states=_topic_of(table, "states", where),
        topic=_topic_of(commands, "topic", f"{where}, commands"),
        order=_order_of(commands, f"{where}, commands: order"),
        quantity=_choice(Quantity, commands.get("quantity", "position"), f"{where}, commands: quantity"),
        gains={
            name: _gains_of(each, f"{where}, gains of {name}") for name, each in _part(table, "gains", where).items()
        },
        torque_constants=torque_constants,
        base=_choice(Base, table.get("base", "held"), f"{where}: base"),
        noise={_choice(Quantity, name, f"{where}, noise:"): each for name, each in noise.items()},
        tolerances=tolerances,
        sensors={name: _sensor_of(each, f"{where}, sensor {name}") for name, each in sensors.items()},
        senses=senses,
    )


def _part(table: Mapping[str, Any], key: str, where: str) -> dict[str, Any]:
    """Return a table within a table; empty if there is none."""
    given = table.get(key)
    return {} if given is None else {str(name): value for name, value in _table(given, f"{where}: {key}").items()}


def _numbers(table: Mapping[str, Any], key: str, where: str) -> dict[str, float]:
    part = _part(table, key, where)
    return {name: _number(value, f"{where}, {key}: {name}") for name, value in part.items()}


def _table(given: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(given, Mapping):
        msg = f"{where} is {given!r}; it must be a table, NAME: VALUE a line"
        raise BadRobotError(msg)
    return given


def _number(given: Any, where: str) -> float:
    try:
        # a text, too: YAML reads 1e-3 as one; yes and no are none
        number = math.nan if isinstance(given, bool | np.bool_) else float(given)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        msg = f"{where} is '{given}'; it must be a number"
        raise BadRobotError(msg)
    return number


def _topic_of(table: Mapping[str, Any], key: str, where: str) -> str | None:
    given = table.get(key)
    if not isinstance(given, str | None):
        msg = f"{where}: {key} is {given!r}; it must be one topic, such as /{key}"
        raise BadRobotError(msg)
    return given


def _order_of(commands: Mapping[str, Any], where: str) -> tuple[str, ...]:
    given = commands.get("order") or []
    if not isinstance(given, list | tuple):
        msg = f"{where} is {given!r}; it must be a list of joints, [FIRST, SECOND]"
        raise BadRobotError(msg)
    return tuple(map(str, given))


def _joint_of(name: str, given: Any, where: str) -> JointMap:
    if isinstance(given, str):
        return JointMap(given)
    _check_keys(_table(given, where), ("model", "sign", "offset"), where)
    sign = _number(given.get("sign", 1.0), f"{where}: sign")
    if abs(sign) != 1.0:
        msg = f"{where}: sign {sign:g} must be 1 or -1"
        raise BadRobotError(msg)
    return JointMap(str(given.get("model", name)), sign, _number(given.get("offset", 0.0), f"{where}: offset"))


def _gains_of(given: Any, where: str) -> Gains:
    if not isinstance(given, dict) or not given:
        msg = f"{where} are '{given}'; write {{kp: ..., kd: ...}}, of a velocity controller kd alone"
        raise BadRobotError(msg)
    _check_keys(given, ("kp", "kd"), where)
    found = Gains(*(_number(given.get(key, 0.0), f"{where}: {key}") for key in ("kp", "kd")))
    if not (found.kp >= 0.0 and found.kd >= 0.0 and found.kp + found.kd > 0.0):
        msg = f"{where}: kp {found.kp:g} and kd {found.kd:g} must be at least 0, and one of them above"
        raise BadRobotError(msg)
    return found


def _choice(kind: type[_Kind], given: Any, where: str) -> _Kind:
    known = {each.value: each for each in kind}
    if given not in known:
        msg = f"{where} '{given}' must be one of {', '.join(map(str, known))}"
        raise BadRobotError(msg)
    return known[given]


def _in_degrees(table: Mapping[str, Any], where: str) -> bool | None:
    units = table.get("units")
    if units not in {None, "degrees", "radians"}:
        msg = f"{where}: units '{units}' must be degrees or radians"
        raise BadRobotError(msg)
    return None if units is None else units == "degrees"


def _sensor_of(given: Any, where: str) -> SensorMap:
    if isinstance(given, str):
        return SensorMap(given)
    _check_keys(_table(given, where), ("site", "sign"), where)
    if "site" not in given:
        msg = f"{where} has no site; name one of the model's, site: NAME"
        raise BadRobotError(msg)
    return SensorMap(str(given["site"]), _number(given.get("sign", 1.0), f"{where}: sign"))


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
    if times.ndim != 1 or times.size < FEWEST or not (np.diff(times) > 0.0).all():  # a time that is no number, too
        msg = f"recording {name} has times that do not rise, or are no numbers, or fewer than {FEWEST}"
        msg += "; give one rising time per sample"
        raise BadRecordingError(msg)
    since_s = times - times[0]
    sensed, measured = _split_sensed(measured)
    senses: Senses = {key: rows for key, axes in sensed.items() if (rows := _rows_of(name, key[0], since_s, axes))}
    posed = [f"base.{each}" for each in BASE_COLUMNS]
    base: tuple[Track, ...] = ()
    if all(column in measured for column in posed):
        base = _rows_of(name, "base", since_s, [measured.pop(column) for column in posed])
    commanded = {key: held(track) for key, track in _tracks_of(name, since_s, commands or {}).items()}
    return checked(Run(name, _tracks_of(name, since_s, measured), commanded, notes, senses, base))


def _tracks_of(name: str, since_s: NDArray[np.float64], columns: Mapping[str, ArrayLike]) -> Tracks:
    tracks: Tracks = {}
    for column, given in columns.items():
        joint, _, quantity = column.rpartition(".")
        values = np.asarray(given, dtype=float)
        if not joint or quantity not in {each.value for each in Quantity} or values.shape != since_s.shape:
            msg = f"recording {name} has a column '{column}' of shape {values.shape}"
            msg += f"; it must be JOINT.position, JOINT.velocity or JOINT.effort, of shape {since_s.shape}"
            msg += ", or of a sensor SITE.force.x and so on, with all of its axes"
            raise BadRecordingError(msg)
        finite = np.isfinite(values)
        if finite.any():
            tracks[joint, Quantity(quantity)] = Track(since_s[finite], values[finite])
    return tracks


def _rows_of(name: str, of: str, since_s: NDArray[np.float64], columns: Sequence[ArrayLike]) -> tuple[Track, ...]:
    """Return columns that belong together, at the times at which all are numbers; empty if there are too few."""
    given = [np.asarray(column, dtype=float) for column in columns]
    if any(column.shape != since_s.shape for column in given):
        msg = f"recording {name} has columns of {of} of shapes {[column.shape for column in given]}"
        msg += f"; each must have shape {since_s.shape}"
        raise BadRecordingError(msg)
    whole = np.isfinite(given).all(axis=0)
    return tuple(Track(since_s[whole], column[whole]) for column in given) if whole.sum() >= FEWEST else ()


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


LONGEST_STEP_S = 0.2
"""Between readings, on the median. Chosen: a robot that moves once a second is differentiated by five of them."""
_LONGEST_HOLE_S = 30.0
"""Of readings. Chosen: a lost link comes back within seconds; more is two recordings in one, or a wrong stamp."""
FEWEST = 20
"""Samples of a recording. Chosen: fewer cannot be differentiated."""
_TIME, _COMMAND = "time_s", "command."


def run_of_csv(path: Path) -> Run:
    """Read a CSV file with the columns `time_s`, `JOINT.position` and so on, `command.JOINT.position` and so on.

    Raises:
        BadRecordingError: it cannot be read, or its columns are others.

    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:  # with a byte order mark, as Excel writes it
            rows = list(csv.reader(file))
        if len(rows) <= 1:
            msg = f"{path} holds no samples"
            raise BadRecordingError(msg)
        names = [each.strip() for each in rows[0]]
        if twice := sorted(name for name, count in Counter(names).items() if name and count > 1):
            msg = f"{', '.join(twice)} {'is' if len(twice) == 1 else 'are'} there more than once"
            raise ValueError(msg)  # noqa: TRY301 - said as the others are
        uneven = [k for k, row in enumerate(rows, 1) if row and len(row) != len(names)]
        if uneven:
            msg = f"line {uneven[0]} has {len(rows[uneven[0] - 1])} cells, and the first one {len(names)}"
            raise ValueError(msg)  # noqa: TRY301 - said as the others are
        table = np.array([[float(cell) if cell.strip() else np.nan for cell in row] for row in rows[1:] if row])
        columns = dict(zip(names, table.T, strict=True))
        if _TIME not in columns:
            msg = f"no column {_TIME} among {', '.join(names)}"
            raise ValueError(msg)  # noqa: TRY301 - said as the others are
        times = columns.pop(_TIME)
    except (OSError, UnicodeDecodeError, ValueError, IndexError) as error:
        msg = f"{path} cannot be read as CSV ({' '.join(str(error).split())})"
        msg += f"; it must have a row of names ({_TIME}, JOINT.position, {_COMMAND}JOINT.position) and rows of numbers"
        raise BadRecordingError(msg) from error
    measured = {name: values for name, values in columns.items() if not name.startswith(_COMMAND)}
    commands = {name.removeprefix(_COMMAND): values for name, values in columns.items() if name.startswith(_COMMAND)}
    return run_of_arrays(path.name, times, measured, commands)


def held(track: Track) -> Track:
    """Return a track that stays at each value until the next."""
    times = np.repeat(track.time_s, 2)[1:]
    values = np.repeat(track.values, 2)[:-1]
    return Track(times, values)


def checked(run: Run) -> Run:
    """Return a run whose joints were measured.

    Raises:
        BadRecordingError: none was, or too shortly, or too rarely.

    """
    if not run.joints():
        msg = f"recording {run.name} holds no position of any joint; record joint_states with positions"
        raise BadRecordingError(msg)
    for joint in run.joints():
        time_s = run.measured[joint, Quantity.POSITION].time_s
        if time_s.size < FEWEST:
            msg = f"recording {run.name} holds {time_s.size} positions of joint {joint}, fewer than {FEWEST}"
            msg += "; record longer"
            raise BadRecordingError(msg)
        steps_s = np.diff(time_s)
        between_s = float(np.median(steps_s))
        if steps_s.max() > _LONGEST_HOLE_S:
            msg = f"positions of joint {joint} in recording {run.name} stop for {steps_s.max():.4g} s"
            msg += f", more than {_LONGEST_HOLE_S:g} s; cut it there and give its parts, or look at its stamps"
            raise BadRecordingError(msg)
        if between_s > LONGEST_STEP_S:
            msg = f"recording {run.name} has {between_s:.4g} s between positions of joint {joint}, more than"
            msg += f" {LONGEST_STEP_S:g} s; give times in seconds, and record at 5 Hz or more"
            raise BadRecordingError(msg)
    return run


def in_model_terms(run: Run, given: RobotMap, slides: Collection[str] = ()) -> Run:
    """Return a run by the names, signs, zeros and units of the model.

    Args:
        run: As it was read.
        given: The map.
        slides: Joints of the model that are no angles, so that degrees do not concern them.

    Raises:
        BadRobotError: two of its joints are the same one of the model.

    """

    def moved(tracks: Tracks, *, in_degrees: bool | None) -> Tracks:
        by_model: dict[str, str] = {}  # commands may have other names than readings
        degrees = np.pi / 180.0 if in_degrees else 1.0
        found = {}
        for (joint, quantity), track in tracks.items():
            asked = given.joints.get(joint, JointMap(joint))
            if (other := by_model.setdefault(asked.model, joint)) != joint:
                msg = f"joints {other} and {joint} of {run.name} are both '{asked.model}' of the model, by the map"
                msg += "; name another one for one of them, or lock it"
                raise BadRobotError(msg)
            is_angle = quantity is not Quantity.EFFORT and asked.model not in slides
            factor = asked.sign * (degrees if is_angle else 1.0)
            offset = asked.offset if quantity is Quantity.POSITION else 0.0
            if quantity is Quantity.EFFORT:
                factor *= given.torque_constants.get(asked.model, 1.0)
            found[asked.model, quantity] = track.changed(factor, offset)
        return found

    sensed = {}
    for (name, sense), axes in run.sensed.items():
        asked = given.sensors.get(name, SensorMap(name))
        if (asked.site, sense) in sensed:
            msg = f"two sensors of {run.name} are at site {asked.site}, by the map; leave one out of it"
            raise BadRobotError(msg)
        sensed[asked.site, sense] = tuple(each.changed(asked.sign, 0.0) for each in axes)
    measured = moved(run.measured, in_degrees=given.degrees)
    commanded = given.degrees if given.command_degrees is None else given.command_degrees
    commands = moved(run.commands, in_degrees=commanded)
    return replace(run, measured=measured, commands=commands, sensed=sensed, base=_unflipped(run.base))


def _unflipped(base: tuple[Track, ...]) -> tuple[Track, ...]:
    """Return a pose whose quaternion does not jump to its opposite, which is the same orientation."""
    if not base:
        return base
    turns = np.array([each.values for each in base[3:]])
    signs = np.concatenate(([1.0], np.cumprod(np.where((turns[:, 1:] * turns[:, :-1]).sum(axis=0) < 0.0, -1.0, 1.0))))
    return (*base[:3], *(Track(each.time_s, signs * each.values) for each in base[3:]))
