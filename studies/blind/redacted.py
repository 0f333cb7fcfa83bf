"""Copy a bag of the graph without what tells the answer: a simulated ankle's bag says which effects are in it."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any

import yaml
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from jammkle_common import names
from jammkle_common.command.errors import GraphError
from jammkle_gap.ankle.bag import TAKERS

if TYPE_CHECKING:
    from pathlib import Path

_STORE = get_typestore(Stores.ROS2_JAZZY)
_STRING = names.SIM_PARAMETERS.message_type
_SECRET_OPTIONS = ("seed",)


def redacted(source: Path, target: Path, namespace: str) -> None:
    """Copy what sensors and commands said, with their times, and a note of rig and options in place of all parameters.

    Args:
        source: Bag of the live graph.
        target: Folder of the copy; it must not exist.
        namespace: Normalised namespace of the ankle; the copy has none.

    Raises:
        GraphError: the bag lacks the topic that says what was simulated.

    """
    prefix = namespace.rstrip("/")
    kept = {f"{prefix}/{name}": f"/{name}" for name in TAKERS} | {names.CLOCK.name: names.CLOCK.name}
    parameters = f"{prefix}/{names.SIM_PARAMETERS.name}"
    with AnyReader([source], default_typestore=_STORE) as reader:
        wanted = [each for each in reader.connections if each.topic in kept or each.topic == parameters]
        if not any(each.topic == parameters for each in wanted):
            msg = f"bag {source} lacks {parameters}; the simulation did not start"
            raise GraphError(msg)
        writer = Writer(target, version=9, storage_plugin=StoragePlugin.MCAP)
        writer.open()
        with contextlib.closing(writer):
            made: dict[str, Any] = {}
            for connection, log_ns, data in reader.messages(wanted):
                name = kept.get(connection.topic, f"/{names.SIM_PARAMETERS.name}")
                if name not in made:
                    made[name] = writer.add_connection(
                        name, connection.msgtype, msgdef=connection.msgdef.data, rihs01=connection.digest
                    )
                if connection.topic == parameters:
                    message: Any = _STORE.deserialize_cdr(data, _STRING)
                    writer.write(made[name], log_ns, _note(str(message.data)))
                else:
                    writer.write(made[name], log_ns, data)


def _note(text: str) -> bytes:
    described = yaml.safe_load(text)
    options = {name: value for name, value in described["options"].items() if name not in _SECRET_OPTIONS}
    note = yaml.safe_dump({"rig": described["rig"], "options": options}, sort_keys=False)
    return bytes(_STORE.serialize_cdr(_STORE.types[_STRING](note), _STRING))
