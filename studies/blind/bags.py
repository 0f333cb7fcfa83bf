"""Write a run as somebody else's recorder would: standard types, its own log times, and a note of what was set up."""

from __future__ import annotations

import contextlib
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from jammkle_common import names
from jammkle_common.bags.definitions import MessageDefinitions, share_folders
from jammkle_common.constants import NANOSECONDS_PER_SECOND

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray
    from rosbags.typesys.store import Typestore

    from studies.blind.reality.sensors import RealRun, Track

_TOPICS = {topic.name: topic for topic in names.TOPICS}
_ENDLESS = QosTime(2**31 - 1, 2**32 - 1)
_NOTE = names.SIM_PARAMETERS


def write_run(run: RealRun, path: Path) -> None:
    """Write one run. Times count from the start of the rig; topics that no ankle has are left out."""
    store = _store()
    writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    note = yaml.safe_dump({"rig": run.plan.rig, "options": dict(run.plan.options)}, sort_keys=False)
    rows = [(0, _NOTE.name, store.types["std_msgs/msg/String"](note))]
    for name, track in run.topics.items():
        if name in _TOPICS:
            log_ns = _nanoseconds(track.log_s).tolist()
            rows += [(at, name, message) for at, message in zip(log_ns, _messages(name, track), strict=True)]
    writer.open()
    with contextlib.closing(writer):
        connections = {
            name: writer.add_connection(
                f"/{name}", _TOPICS[name].message_type, typestore=store, offered_qos_profiles=[_qos(name)]
            )
            for name in dict.fromkeys(name for _, name, _ in rows)
        }
        for at, name, message in sorted(rows, key=lambda row: row[:2]):
            writer.write(connections[name], at, store.serialize_cdr(message, _TOPICS[name].message_type))


def _qos(name: str) -> Qos:
    is_latched = _TOPICS[name].kind is names.TopicKind.STATE
    return Qos(
        QosHistory.KEEP_LAST, 10, QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL if is_latched else QosDurability.VOLATILE,
        _ENDLESS, _ENDLESS, QosLiveliness.AUTOMATIC, _ENDLESS, avoid_ros_namespace_conventions=False,
    )  # fmt: skip


@lru_cache(maxsize=1)
def _store() -> Typestore:
    """Return the types; instrumented tendons have the only one that is not a standard one."""
    store = get_typestore(Stores.ROS2_JAZZY)
    tendons = names.TENDON_STATES.message_type
    found = get_types_from_msg(MessageDefinitions(share_folders()).find(tendons).text, tendons)
    store.register({name: fields for name, fields in found.items() if name not in store.types})
    return store


def _messages(topic: str, track: Track) -> Iterator[Any]:
    """Give the message of every sample."""
    types, message_type = _store().types, _TOPICS[topic].message_type
    make = types[message_type]
    if topic == names.JOINT_STATES.name:
        joints = [name.removesuffix(".position") for name in track.columns if name.endswith(".position")]
        positions = _table(track, [f"{name}.position" for name in joints])
        rates = _table(track, [f"{name}.velocity" for name in joints if f"{name}.velocity" in track.columns])
        for header, position, rate in zip(_headers(track, ""), positions, rates, strict=True):
            yield make(header, joints, position, rate, np.zeros(0))
    elif topic == names.TENDON_STATES.name:
        tendons = [_tendon(track, name) for name in names.TENDONS if f"{name}.tension_n" in track.columns]
        for header, *states in zip(_headers(track, ""), *tendons, strict=True):
            yield make(header, states)
    elif topic == names.IMU.name:
        upright, unknown = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0), np.zeros(9)
        turns = _vectors(track, "angular_velocity_{}_rad_s")
        forces = _vectors(track, "linear_acceleration_{}_m_s2")
        for header, turn, force in zip(_headers(track, names.IMU_FRAME), turns, forces, strict=True):
            yield make(header, upright, np.array([-1.0, *np.zeros(8)]), turn, unknown, force, unknown)
    elif topic == names.LOAD_CELL.name:
        wrench = types["geometry_msgs/msg/Wrench"]
        wrenches = map(wrench, _vectors(track, "force_{}_n"), _vectors(track, "torque_{}_n_m"))
        yield from map(make, _headers(track, names.LOAD_CELL_FRAME), wrenches)
    elif "fluid_pressure_pa" in track.columns:
        for header, pressure_pa in zip(_headers(track, ""), _column(track, "fluid_pressure_pa"), strict=True):
            yield make(header, pressure_pa, 0.0)
    else:
        convert = bool if message_type.endswith("Bool") else float
        yield from map(make, map(convert, _column(track, "data")))


def _headers(track: Track, frame: str) -> Iterator[Any]:
    types = _store().types
    header, time = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    seconds, left = np.divmod(_nanoseconds(track.stamp_s), NANOSECONDS_PER_SECOND)
    return (header(time(*each), frame) for each in zip(seconds.tolist(), left.tolist(), strict=True))


def _vectors(track: Track, pattern: str) -> Iterator[Any]:
    make = _store().types["geometry_msgs/msg/Vector3"]
    return map(make, *(_column(track, pattern.format(axis)) for axis in "xyz"))


def _tendon(track: Track, name: str) -> Iterator[Any]:
    make: Any = _store().types["jammkle_msgs/msg/TendonState"]
    columns = (_column(track, f"{name}.{what}") for what in ("extension_m", "extension_rate_m_s", "tension_n"))
    for extension_m, rate_m_s, tension_n in zip(*columns, strict=True):
        yield make(
            name=name,
            condition=make.INTACT,
            extension_m=extension_m,
            extension_rate_m_s=rate_m_s,
            tension_n=tension_n,
        )


def _nanoseconds(times_s: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.maximum(np.round(times_s * NANOSECONDS_PER_SECOND).astype(np.int64), 0)


def _column(track: Track, name: str) -> list[float]:
    """Return a column as plain numbers; zeros where the track has none of this name."""
    if name not in track.columns:
        return [0.0] * len(track.values)
    found: list[float] = track.values[:, track.columns.index(name)].tolist()
    return found


def _table(track: Track, columns: list[str]) -> NDArray[np.float64]:
    return np.ascontiguousarray(track.values[:, [track.columns.index(name) for name in columns]])
