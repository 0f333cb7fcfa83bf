"""Fixtures of the bringup tests: ROS domains of their own, and bags made of known messages."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from domains import own_domain
from jammkle_common.bags.definitions import MessageDefinitions, share_folders
from jammkle_common.bags.writing import bag_delivery

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from rosbags.interfaces import Connection

    from jammkle_common.names import Delivery


@pytest.fixture
def ros_domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Reserve a ROS domain on this machine for one test and the processes it starts."""
    with own_domain() as number:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        yield number


class BagMaker:
    """Writes messages, given as nested values, into a bag."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._definitions = MessageDefinitions(share_folders())
        self._store = get_typestore(Stores.ROS2_JAZZY)
        self._writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
        self._writer.open()
        self._connections: dict[str, Connection] = {}

    def make(self, message_type: str, *values: Any) -> Any:
        """Make a message of a type from the values of its fields, in their order."""
        definition = self._definitions.find(message_type)
        if message_type not in self._store.types:
            new = get_types_from_msg(definition.text, message_type)
            self._store.register({name: fields for name, fields in new.items() if name not in self._store.types})
        return self._store.types[message_type](*values)

    def header(self, time_s: float) -> Any:
        """Make a header with a stamp."""
        seconds, nanoseconds = divmod(round(time_s * 1e9), 10**9)
        return self.make("std_msgs/msg/Header", self.make("builtin_interfaces/msg/Time", seconds, nanoseconds), "")

    def pressure(self, time_s: float, pressure_pa: float) -> Any:
        """Make an absolute pressure, Pa, with a stamp."""
        return self.make("sensor_msgs/msg/FluidPressure", self.header(time_s), pressure_pa, 0.0)

    def clock(self, time_s: float) -> Any:
        """Make a tick of /clock."""
        return self.make("rosgraph_msgs/msg/Clock", self.header(time_s).stamp)

    def jam_state(self, time_s: float, state: int, commanded_pa: float, *channels: str) -> Any:
        """Make a jam_state whose channels are all in a state, by its number, with a vacuum asked for, Pa."""
        fields = (state, commanded_pa, 0.0, "asked", 0)
        listed = [self.make("jammkle_msgs/msg/ChannelJamState", channel, *fields) for channel in channels]
        stopped, fault = False, self.make("jammkle_msgs/msg/Fault", 0, "", "")
        return self.make(
            "jammkle_msgs/msg/JamState", self.header(time_s), stopped, 0.0, listed, fault, 5e3, 7e4, "", 0.0
        )

    def impact(self, time_s: float) -> Any:
        """Make the event of an impact of 30 m/s^2, detected 2 ms late, stamped with a time."""
        fields = (1, 30.0, "m/s^2", 0.002, 0.9, "imu", self.make("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0))
        return self.make("jammkle_msgs/msg/ContactEvent", self.header(time_s), *fields)

    def write(self, topic: str, time_s: float, message: Any, delivery: Delivery | None = None) -> None:
        """Write a message at a log time; its topic is offered with a delivery."""
        if topic not in self._connections:
            kind = message.__msgtype__
            definition = self._definitions.find(kind)
            self._connections[topic] = self._writer.add_connection(
                topic,
                kind,
                msgdef=definition.text,
                rihs01=definition.type_hash,
                offered_qos_profiles=[] if delivery is None else [bag_delivery(delivery)],
            )
        data = self._store.serialize_cdr(message, message.__msgtype__)
        self._writer.write(self._connections[topic], round(time_s * 1e9), data)

    def close(self) -> Path:
        """Complete the bag and return its path."""
        self._writer.close()
        return self.path


@pytest.fixture
def bag_maker(tmp_path: Path) -> Callable[[str], BagMaker]:
    """Return a function that begins a bag of a given name."""
    return lambda name: BagMaker(tmp_path / name)
