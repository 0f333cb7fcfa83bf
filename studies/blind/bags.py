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

from jammkle_common import names
from jammkle_common.bags.writing import check_free
from jammkle_common.command.errors import InputError
from jammkle_common.constants import NANOSECONDS_PER_SECOND

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray
    from rosbags.typesys.store import Typestore

    from jammkle_common.bags.definitions import MessageDefinitions
    from studies.blind.reality.record import RealRun, Track

    Maker = Callable[[Track], Iterator[Any]]
    """Gives the message of every sample."""

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
            for log_ns, name, data in sorted(self._messages(run), key=lambda each: each[:2]):
                writer.write(connections[name], log_ns, data)

    def _messages(self, run: RealRun) -> Iterator[tuple[int, str, memoryview]]:
        """Give log time, topic and data of every message, topic by topic."""
        note = self._type("std_msgs/msg/String")(note_of(run))
        yield 0, names.SIM_PARAMETERS.name, self._store.serialize_cdr(note, names.SIM_PARAMETERS.message_type)
        for name, track in run.topics.items():
            maker = self._makers.get(name)
            if maker is not None:
                message_type = _TOPICS[name].message_type
                for log_ns, message in zip(_nanoseconds(track.log_s).tolist(), maker(track), strict=True):
                    yield log_ns, name, self._store.serialize_cdr(message, message_type)

    def _type(self, name: str) -> Any:
        return self._store.types[name]

    def _headers(self, track: Track, frame: str) -> Iterator[Any]:
        header, time = self._type("std_msgs/msg/Header"), self._type("builtin_interfaces/msg/Time")
        seconds, left = np.divmod(_nanoseconds(track.stamp_s), NANOSECONDS_PER_SECOND)
        return (header(time(*each), frame) for each in zip(seconds.tolist(), left.tolist(), strict=True))

    def _vectors(self, track: Track, pattern: str) -> Iterator[Any]:
        return map(self._type("geometry_msgs/msg/Vector3"), *(_column(track, pattern.format(axis)) for axis in "xyz"))

    def _data(self, message_type: str, convert: type, track: Track) -> Iterator[Any]:
        return map(self._type(message_type), map(convert, _column(track, "data")))

    def _pressure(self, track: Track) -> Iterator[Any]:
        make = self._type("sensor_msgs/msg/FluidPressure")
        for header, pressure_pa in zip(self._headers(track, ""), _column(track, "fluid_pressure_pa"), strict=True):
            yield make(header, pressure_pa, 0.0)

    def _imu(self, track: Track) -> Iterator[Any]:
        make = self._type("sensor_msgs/msg/Imu")
        upright = self._type("geometry_msgs/msg/Quaternion")(0.0, 0.0, 0.0, 1.0)
        unknown = np.zeros(9)
        no_orientation = np.array([-1.0, *np.zeros(8)])
        rates = self._vectors(track, "angular_velocity_{}_rad_s")
        forces = self._vectors(track, "linear_acceleration_{}_m_s2")
        for header, rate, force in zip(self._headers(track, names.IMU_FRAME), rates, forces, strict=True):
            yield make(header, upright, no_orientation, rate, unknown, force, unknown)

    def _wrench(self, track: Track) -> Iterator[Any]:
        stamped, wrench = self._type("geometry_msgs/msg/WrenchStamped"), self._type("geometry_msgs/msg/Wrench")
        wrenches = map(wrench, self._vectors(track, "force_{}_n"), self._vectors(track, "torque_{}_n_m"))
        return map(stamped, self._headers(track, names.LOAD_CELL_FRAME), wrenches)

    def _joints(self, track: Track) -> Iterator[Any]:
        make = self._type("sensor_msgs/msg/JointState")
        joints = [name.removesuffix(".position") for name in track.columns if name.endswith(".position")]
        positions = _table(track, [f"{name}.position" for name in joints])
        rates = _table(track, [f"{name}.velocity" for name in joints if f"{name}.velocity" in track.columns])
        for header, position, rate in zip(self._headers(track, ""), positions, rates, strict=True):
            yield make(header, joints, position, rate, np.zeros(0))

    def _tendons(self, track: Track) -> Iterator[Any]:
        make = self._type(names.TENDON_STATES.message_type)
        tendons = [self._tendon(track, name) for name in names.TENDONS if f"{name}.tension_n" in track.columns]
        for header, *states in zip(self._headers(track, ""), *tendons, strict=True):
            yield make(header, states)

    def _tendon(self, track: Track, name: str) -> Iterator[Any]:
        make = self._type("jammkle_msgs/msg/TendonState")
        columns = (_column(track, f"{name}.{what}") for what in ("extension_m", "extension_rate_m_s", "tension_n"))
        for extension_m, rate_m_s, tension_n in zip(*columns, strict=True):
            yield make(
                name=name,
                condition=make.INTACT,
                extension_m=extension_m,
                extension_rate_m_s=rate_m_s,
                tension_n=tension_n,
            )


_TOPICS = {topic.name: topic for topic in names.TOPICS}


def note_of(run: RealRun) -> str:
    """Return the page of the lab notebook: rig and settings as YAML, and nothing else."""
    note = {"rig": run.plan.rig, "options": dict(run.plan.options)}
    return yaml.safe_dump(note, sort_keys=False, allow_unicode=True)


def _nanoseconds(times_s: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.maximum(np.round(times_s * NANOSECONDS_PER_SECOND).astype(np.int64), 0)


def _column(track: Track, name: str) -> list[float]:
    """Return a column as plain numbers; zeros where the track has none of this name."""
    if name not in track.columns:
        return [0.0] * len(track.values)
    found: list[float] = track.values[:, track.columns.index(name)].tolist()
    return found


def _table(track: Track, columns: Sequence[str]) -> NDArray[np.float64]:
    """Return columns beside one another, a row per sample."""
    return np.ascontiguousarray(track.values[:, [track.columns.index(name) for name in columns]])
