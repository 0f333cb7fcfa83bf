"""Write a run as somebody else's recorder would: standard types, its own log times, and a note of what was set up."""

from __future__ import annotations

import contextlib
import functools
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer, WriterError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from jammkle_bringup.core.bag_log import check_free
from jammkle_bringup.core.errors import InputError
from jammkle_graph import names
from jammkle_graph.constants import NANOSECONDS_PER_SECOND

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    from rosbags.typesys.store import Typestore

    from jammkle_bringup.core.message_definitions import MessageDefinitions
    from jammkle_sim.reality.record import RealRun, Track

    Row = Mapping[str, float]
    Maker = Callable[[int, Row], Any]

_ENDLESS = QosTime(2**31 - 1, 2**32 - 1)


def _qos(durability: QosDurability) -> Qos:
    return Qos(
        QosHistory.KEEP_LAST, 10, QosReliability.RELIABLE, durability,
        _ENDLESS, _ENDLESS, QosLiveliness.AUTOMATIC, _ENDLESS, avoid_ros_namespace_conventions=False,
    )  # fmt: skip


class RunWriter:
    """Writes runs into bags. Made once, as it takes a moment to know the types."""

    def __init__(self, definitions: MessageDefinitions) -> None:
        """Learn the types.

        Args:
            definitions: Where that of instrumented tendons comes from, the only type that is not a standard one.

        Raises:
            InputError: it is not installed.

        """
        self._store: Typestore = get_typestore(Stores.ROS2_JAZZY)
        self._definitions = definitions
        tendons = names.TENDON_STATES.message_type
        found = get_types_from_msg(definitions.find(tendons).text, tendons)
        self._store.register({name: fields for name, fields in found.items() if name not in self._store.types})
        self._makers: dict[str, Maker] = {
            names.IMU.name: self._imu,
            names.JOINT_STATES.name: self._joints,
            names.TENDON_STATES.name: self._tendons,
            names.LOAD_CELL.name: self._wrench,
            names.PUMP_DUTY.name: functools.partial(self._data, "std_msgs/msg/Float32", float),
        }
        for topic in (names.MANIFOLD_PRESSURE, *names.PRESSURES.values()):
            self._makers[topic.name] = self._pressure
        for topic in names.SOLENOIDS.values():
            self._makers[topic.name] = functools.partial(self._data, "std_msgs/msg/Bool", bool)

    def write(self, run: RealRun, path: Path) -> None:
        """Write one run. Times count from the start of the rig.

        Args:
            run: The run; topics that no ankle has are left out.
            path: Folder of the bag; it must not exist.

        Raises:
            InputError: it exists or cannot be made.

        """
        check_free(path)
        writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        try:
            writer.open()
        except (OSError, WriterError) as error:
            msg = f"bag {path} cannot be made: {error}"
            raise InputError(msg) from error
        with contextlib.closing(writer):
            connections = {}
            for name in (names.SIM_PARAMETERS.name, *(each for each in run.topics if each in self._makers)):
                topic = _TOPICS[name]
                latched = topic.kind is names.TopicKind.STATE
                connections[name] = writer.add_connection(
                    f"/{name}",
                    topic.message_type,
                    typestore=self._store,
                    offered_qos_profiles=[_qos(QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE)],
                )
            for log_ns, name, message in sorted(self._messages(run), key=lambda each: each[:2]):
                data = self._store.serialize_cdr(message, _TOPICS[name].message_type)
                writer.write(connections[name], log_ns, data)

    def _messages(self, run: RealRun) -> Iterator[tuple[int, str, Any]]:
        yield 0, names.SIM_PARAMETERS.name, self._type("std_msgs/msg/String")(note_of(run))
        for name, track in run.topics.items():
            maker = self._makers.get(name)
            if maker is None:
                continue
            for log_ns, stamp_ns, row in _rows(track):
                yield log_ns, name, maker(stamp_ns, row)

    def _type(self, name: str) -> Any:
        return self._store.types[name]

    def _header(self, stamp_ns: int, frame: str) -> Any:
        seconds, left = divmod(stamp_ns, NANOSECONDS_PER_SECOND)
        return self._type("std_msgs/msg/Header")(self._type("builtin_interfaces/msg/Time")(seconds, left), frame)

    def _vector(self, row: Row, pattern: str) -> Any:
        return self._type("geometry_msgs/msg/Vector3")(*(row.get(pattern.format(axis), 0.0) for axis in "xyz"))

    def _data(self, message_type: str, convert: type, _: int, row: Row) -> Any:
        return self._type(message_type)(convert(row["data"]))

    def _pressure(self, stamp_ns: int, row: Row) -> Any:
        header = self._header(stamp_ns, "")
        return self._type("sensor_msgs/msg/FluidPressure")(header, row["fluid_pressure_pa"], 0.0)

    def _imu(self, stamp_ns: int, row: Row) -> Any:
        unknown = np.zeros(9)
        no_orientation = np.array([-1.0, *np.zeros(8)])
        return self._type("sensor_msgs/msg/Imu")(
            self._header(stamp_ns, names.IMU_FRAME),
            self._type("geometry_msgs/msg/Quaternion")(0.0, 0.0, 0.0, 1.0),
            no_orientation,
            self._vector(row, "angular_velocity_{}_rad_s"),
            unknown,
            self._vector(row, "linear_acceleration_{}_m_s2"),
            unknown,
        )

    def _wrench(self, stamp_ns: int, row: Row) -> Any:
        force, torque = self._vector(row, "force_{}_n"), self._vector(row, "torque_{}_n_m")
        wrench = self._type("geometry_msgs/msg/Wrench")(force, torque)
        return self._type("geometry_msgs/msg/WrenchStamped")(self._header(stamp_ns, names.LOAD_CELL_FRAME), wrench)

    def _joints(self, stamp_ns: int, row: Row) -> Any:
        joints = [name.removesuffix(".position") for name in row if name.endswith(".position")]
        positions = np.array([row[f"{name}.position"] for name in joints])
        rates = np.array([row[f"{name}.velocity"] for name in joints if f"{name}.velocity" in row])
        header = self._header(stamp_ns, "")
        return self._type("sensor_msgs/msg/JointState")(header, joints, positions, rates, np.zeros(0))

    def _tendons(self, stamp_ns: int, row: Row) -> Any:
        make = self._type("jammkle_msgs/msg/TendonState")
        tendons = [
            make(
                name=name,
                condition=make.INTACT,
                extension_m=row[f"{name}.extension_m"],
                extension_rate_m_s=row.get(f"{name}.extension_rate_m_s", 0.0),
                tension_n=row[f"{name}.tension_n"],
            )
            for name in names.TENDONS
            if f"{name}.tension_n" in row
        ]
        return self._type(names.TENDON_STATES.message_type)(self._header(stamp_ns, ""), tendons)


_TOPICS = {topic.name: topic for topic in names.TOPICS}


def note_of(run: RealRun) -> str:
    """Return the page of the lab notebook: rig and settings as YAML, and nothing else."""
    note = {"rig": run.plan.rig, "options": dict(run.plan.options)}
    return yaml.safe_dump(note, sort_keys=False, allow_unicode=True)


def _rows(track: Track) -> Iterator[tuple[int, int, Row]]:
    """Give log time, stamp (ns) and values of each sample."""
    log_ns = np.maximum(np.round(track.log_s * NANOSECONDS_PER_SECOND).astype(np.int64), 0)
    stamp_ns = np.maximum(np.round(track.stamp_s * NANOSECONDS_PER_SECOND).astype(np.int64), 0)
    for log, stamp, values in zip(log_ns.tolist(), stamp_ns.tolist(), track.values.tolist(), strict=True):
        yield log, stamp, dict(zip(track.columns, values, strict=True))
