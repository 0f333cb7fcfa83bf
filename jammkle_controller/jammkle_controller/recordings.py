"""Recordings as a stream of what a controller receives, and a controller over it, without ROS.

The recordings are bags with any IMU in them, and tables of numbers. The same samples lead to the same decisions as in
the graph.
"""

from __future__ import annotations

import csv
import functools
import itertools
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from jammkle_common import names
from jammkle_common.bags.reading import name_of, namespaces_in, opened
from jammkle_common.bags.times import BagTimes
from jammkle_common.command.errors import InputError
from jammkle_common.constants import NANOSECONDS_PER_SECOND, STANDARD_GRAVITY_M_S2
from jammkle_common.names import normalised, resolved
from jammkle_common.parameters import ParameterError, is_number
from jammkle_controller.core.controller import AnkleController
from jammkle_controller.core.imu import ImuSample
from jammkle_controller.core.leg import leg_of
from jammkle_controller.core.reading import Received, received_in

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from jammkle_common.bags.reading import BagReader
    from jammkle_controller.core.events import ContactEvent
    from jammkle_controller.core.imu import StreamCounts
    from jammkle_controller.core.leg import Leg
    from jammkle_controller.parameters import ControllerParameters

FORCE_UNITS = {"m/s^2": 1.0, "g": STANDARD_GRAVITY_M_S2}
RATE_UNITS = {"rad/s": 1.0, "deg/s": math.radians(1.0)}
_IMU_TYPE = names.IMU.message_type
_AXES = 3
_DELIMITERS = ";\t, "
"""Spaces last: they follow any other."""


@dataclass(frozen=True)
class Recording:
    """What was recorded, by rising time of arrival."""

    name: str
    received: list[Received]
    imu_topic: str = ""
    leg: Leg | None = None
    """What the robot's leg is, where efforts or odometry are read."""
    reference: list[tuple[int, float]] = field(default_factory=list)
    """Times, ns, and values of a force or switch that is drawn beside, and not used."""

    @functools.cached_property
    def samples(self) -> list[ImuSample]:
        """The samples of the IMU alone."""
        return [each.what for each in self.received if isinstance(each.what, ImuSample)]

    def at_s(self, time_ns: int) -> float:
        """Return a time from the first of them on, s."""
        return (time_ns - self.samples[0].time_ns) / NANOSECONDS_PER_SECOND


@dataclass(frozen=True)
class TableFormat:
    """How a table of numbers is to be read: columns by name or by number from 1, and units.

    Attributes:
        force: Columns of the specific force.
        rate: Columns of the angular velocity; none: there is no gyro.
        time: Column of the time, s; empty: rows come at `rate_hz`.
        reference: Column that is drawn beside; empty: none.
        force_unit: One of FORCE_UNITS.
        rate_unit: One of RATE_UNITS.
        rate_hz: Rate of the rows, where there is no time.

    """

    force: tuple[str, ...] = ("1", "2", "3")
    rate: tuple[str, ...] = ("4", "5", "6")
    time: str = ""
    reference: str = ""
    force_unit: str = "m/s^2"
    rate_unit: str = "rad/s"
    rate_hz: float = 0.0


def read_bag(
    path: Path,
    topic: str,
    namespace: str | None,
    parameters: ControllerParameters,
    layout: TableFormat = TableFormat(),
) -> Recording:
    """Read a bag with an IMU.

    Args:
        path: The bag.
        topic: Of the IMU; empty: imu/data of the namespace, or the only one of its type.
        namespace: Normalised namespace, in which the other inputs are; None: that of the IMU's topic, or the only one.
        parameters: Of the controller: which joints are its leg's, and whether efforts and odometry are read.
        layout: Of it the units of the IMU, where they are not those of REP-145.

    Raises:
        InputError: unreadable; a layout of tables; no IMU, or several IMUs or ankles, none chosen; a leg that is needed
            is not described.

    """
    if layout != TableFormat(force_unit=layout.force_unit, rate_unit=layout.rate_unit):
        msg = f"bag {path} has topics and no columns: of a table's options it takes --force-unit and --rate-unit alone"
        raise InputError(msg)
    force_scale = _scale(FORCE_UNITS, layout.force_unit, "--force-unit")
    rate_scale = _scale(RATE_UNITS, layout.rate_unit, "--rate-unit")
    with opened(path) as reader:
        namespace = _namespace(reader, topic) if namespace is None else namespace
        shared = normalised(parameters.robot_namespace) if parameters.robot_namespace else namespace
        of_imus = {each.topic for each in reader.connections if each.msgtype == _IMU_TYPE}
        whole = [each for each in reader.on(of_imus) if each.msgtype == _IMU_TYPE]
        imus = sorted(each.topic for each in whole)
        imu = topic or _only_imu(path, imus, resolved(namespace, names.IMU.name))
        if imu not in imus:
            msg = f"bag {path} holds no {_IMU_TYPE} on {imu}; it has: {', '.join(imus) or 'none'}"
            raise InputError(msg)
        leg = _leg(path, reader, resolved(shared, names.ROBOT_DESCRIPTION.name), parameters)
        others = {
            resolved(namespace, each.name): each
            for each in (names.FOOT_CONTACT, names.GAIT_PHASE, names.PLANNED_CONTACT, names.LOAD_CELL, names.JAM_STATE)
        }
        others[resolved(namespace, names.JOINT_STATES.name)] = names.JOINT_STATES
        if parameters.use_odometry:
            others[resolved(shared, names.ODOMETRY.name)] = names.ODOMETRY
        others.pop(imu, None)
        wanted = [each for each in whole if each.topic == imu]
        received = []
        for connection, time_ns, _, data in BagTimes(reader).messages([*wanted, *reader.on(others)]):
            message: Any = reader.deserialize(data, connection.msgtype)
            what = others.get(connection.topic, names.IMU)
            if connection.msgtype == what.message_type:
                received += received_in(message, what, time_ns, parameters, leg)
    received = [
        each._replace(what=each.what.scaled(force_scale, rate_scale)) if isinstance(each.what, ImuSample) else each
        for each in received
    ]
    return Recording(name_of(path), received, imu, leg)


def _namespace(reader: BagReader, topic: str) -> str:
    """Return the namespace of the IMU's topic, if an ankle is there, else of the only ankle; `/`: of none."""
    found = namespaces_in(reader.topics)
    own = namespaces_in([topic])
    if own and own[0] in found:
        return own[0]
    return reader.chosen_namespace(None) if found else "/"


def _leg(path: Path, reader: Any, topic: str, parameters: ControllerParameters) -> Leg | None:
    """Return the leg, if it is needed, from the parameter or from the bag."""
    if not parameters.needs_leg:
        return None
    text = parameters.robot_description
    for connection in reader.on([topic]) if not text else ():
        for _, _, data in reader.messages([connection]):
            text = reader.deserialize(data, connection.msgtype).data
    if not text:
        msg = f"bag {path} holds no URDF on {topic}, which use_efforts, use_odometry and imu_link need; give it with "
        msg += '--set robot_description="$(cat robot.urdf)"'
        raise InputError(msg)
    try:
        return leg_of(text, parameters)
    except ParameterError as error:
        raise InputError(str(error)) from error


def _only_imu(path: Path, imus: list[str], usual: str) -> str:
    if usual in imus:
        return usual
    if len(imus) == 1:
        return imus[0]
    what = f"several ({', '.join(imus)}): choose one with --topic" if imus else f"none of type {_IMU_TYPE}"
    msg = f"bag {path} holds no {usual}; of other IMUs it holds {what}"
    raise InputError(msg)


def read_table(path: Path, layout: TableFormat) -> Recording:
    """Read a table of numbers: rows of values, a head of names or none.

    Between columns stand semicolons, tabs, commas or spaces: the first of these that cuts the first line into three.

    Raises:
        InputError: it cannot be read, a column does not exist, a value is no number, or a unit is not known.

    """
    force_scale = _scale(FORCE_UNITS, layout.force_unit, "--force-unit")
    rate_scale = _scale(RATE_UNITS, layout.rate_unit, "--rate-unit")
    if len(layout.force) != _AXES or len(layout.rate) not in (0, _AXES):
        msg = f"columns of {path}: {len(layout.force)} of force and {len(layout.rate)} of rate; it must be 3 and 3 or 0"
        raise InputError(msg)
    if not layout.time and not layout.rate_hz:
        msg = f"{path} has no column of time (--time): give the rate of its rows with --rate-hz"
        raise InputError(msg)
    least_hz, most_hz = _RATES_HZ
    if not layout.time and not least_hz <= layout.rate_hz <= most_hz:
        msg = f"--rate-hz {layout.rate_hz:g} must be {least_hz:g} to {most_hz:g} Hz"
        raise InputError(msg)
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:  # spreadsheets begin with a byte order mark
            line = next((each for each in file if each.strip()), "")
            file.seek(0)
            delimiter = next((each for each in _DELIMITERS if _columns(line, each) >= _AXES), ",")
            rows = csv.reader(file, delimiter=delimiter, skipinitialspace=True)
            first = next(rows, [])
            head = [] if all(is_number(cell) for cell in first if cell.strip()) else first
            body = rows if head else itertools.chain([first], rows)
            return _table(path, layout, head, body, force_scale, rate_scale)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        msg = f"{path} cannot be read: {error}"
        raise InputError(msg) from error


def _table(
    path: Path, layout: TableFormat, head: list[str], rows: Iterator[list[str]], force_scale: float, rate_scale: float
) -> Recording:
    force = [_column(path, head, name) for name in layout.force]
    rate = [_column(path, head, name) for name in layout.rate]
    time = _column(path, head, layout.time) if layout.time else -1
    beside = _column(path, head, layout.reference) if layout.reference else -1
    received, reference = [], []
    for number, row in enumerate(rows):
        if not any(row[index].strip() for index in force if index < len(row)):
            continue  # a table of several sensors goes on where the IMU has ended
        try:
            at_s = float(row[time]) if layout.time else (number + 1) / layout.rate_hz
            at_ns = round(at_s * NANOSECONDS_PER_SECOND)
            x, y, z = (force_scale * float(row[index]) for index in force)
            p, q, r = (rate_scale * float(row[index]) for index in rate) if rate else (0.0, 0.0, 0.0)
            if layout.reference:
                reference.append((at_ns, float(row[beside])))
        except (ValueError, IndexError, OverflowError) as error:
            what = f"it has {len(row)} columns" if isinstance(error, IndexError) else error
            msg = f"{path}, row {number + 1}: {what}; columns are chosen with --force, --rate, --time, --contact-force"
            raise InputError(msg) from error
        received.append(Received(at_ns, ImuSample(at_ns, x, y, z, p, q, r)))
    if not received:
        msg = f"{path} holds no rows"
        raise InputError(msg)
    return Recording(name_of(path), received, reference=reference)


_RATES_HZ = (0.1, 1e6)
"""Of the rows of a table: an IMU gives more than one in ten seconds, and fewer than a million a second."""


def _scale(units: dict[str, float], unit: str, option: str) -> float:
    if unit not in units:
        msg = f"{option} is '{unit}'; it must be one of {', '.join(units)}"
        raise InputError(msg)
    return units[unit]


def _column(path: Path, head: list[str], name: str) -> int:
    if name in head:
        return head.index(name)
    if name.isdigit() and int(name) >= 1:
        return int(name) - 1
    known = f"its columns are {', '.join(head)}" if head else "it has no head: count columns from 1"
    msg = f"{path} has no column '{name}'; {known}"
    raise InputError(msg)


def _columns(line: str, delimiter: str) -> int:
    return len(next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), []))


@dataclass(frozen=True)
class Decision:
    """From a time, ns, on: what the policy does and wants, per channel, Pa."""

    time_ns: int
    state: str
    vacuum_pa: dict[str, float]


@dataclass(frozen=True)
class Replay:
    """What a controller made of a stream."""

    events: list[ContactEvent]
    decisions: list[Decision]
    """On every change of state or set point."""
    troubles: list[tuple[int, str]]
    """When an IMU became unbelievable, ns, and why; an empty reason says that it was believed again."""
    swing: list[tuple[int, float]]
    """Probability of swing, at every tenth sample."""
    counts: StreamCounts


def replay(stream: Iterable[Received], parameters: ControllerParameters, leg: Leg | None = None) -> Replay:
    """Run a new controller over a stream.

    Args:
        stream: What it receives, by time of arrival.
        parameters: As of the node.
        leg: What the leg is, where efforts or odometry are used.

    """
    controller = AnkleController(parameters, leg=leg)
    events: list[ContactEvent] = []
    decisions: list[Decision] = []
    troubles: list[tuple[int, str]] = []
    swing: list[tuple[int, float]] = []
    state, reported = None, ""
    for number, received in enumerate(stream):
        reaction = controller.take(received)
        events += reaction.events
        if reaction.changed or controller.policy.state is not state:
            state = controller.policy.state
            decisions.append(Decision(received.time_ns, state.value, dict(controller.set_points_pa)))
        reason = controller.watch.reason
        if reason != reported:
            troubles.append((received.time_ns, reason))
            reported = reason
        if number % 10 == 0:
            swing.append((received.time_ns, controller.detector.swing_probability))
    return Replay(events, decisions, troubles, swing, controller.gate.counts)
