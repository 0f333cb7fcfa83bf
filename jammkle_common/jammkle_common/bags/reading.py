"""Open a bag and read it, or say in one line why that cannot be done."""

from __future__ import annotations

import contextlib
import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rosbags.typesys import Stores, get_typestore

from jammkle_common import names
from jammkle_common.bags.contents import (
    check_finished,
    checked_count,
    contents_of,
)
from jammkle_common.bags.definitions import KnownTypes, UndecodableError, one_line
from jammkle_common.bags.storage import ZSTD, begins_with, decompressed, merged, open_file, plain_data
from jammkle_common.command.errors import InputError
from jammkle_common.command.results import note
from jammkle_common.names import TOPICS

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping

    from jammkle_common.bags.contents import Contents
    from jammkle_common.bags.storage import BagFile, Connection

_OWN_PACKAGE = "jammkle_msgs/"
_OURS = {topic.name: topic.message_type for topic in TOPICS}


class BagReader:
    """An open bag, made by `opened`.

    Attributes:
        path: As it was given.
        connections: Topics whose messages can be decoded.
        left_out: Those whose messages cannot.
        message_count: Messages of `connections`.
        start_time: First log time, ns.
        end_time: Last log time, ns.
        typestore: Types of the messages.
        custom_data: What the recorder added.
        notes: What is worth a word: files and topics that are not used, and why.

    """

    def __init__(self, contents: Contents, files: list[BagFile]) -> None:
        """Look at the channels of the files."""
        self.path = contents.bag
        self.custom_data = contents.custom_data
        self._files = files
        self.typestore = get_typestore(Stores.EMPTY)
        types = self._types = KnownTypes(self.typestore)
        known: dict[tuple[str, str, str, bytes], Connection] = {}
        self._places: list[dict[int, int]] = [{} for _ in files]
        channels = [(place, channel) for place, file in enumerate(files) for channel in file.channels]
        # Of two definitions of one type the usual one is taken.
        for place, channel in sorted(channels, key=lambda each: types.differs(each[1])):
            key = (channel.topic, channel.msgtype, channel.encoding, channel.definition)
            before = known.get(key)
            if before is None:
                known[key] = channel._replace(id=len(known), why_left_out=_why_left_out(channel, types))
            else:
                offered = before.offered or channel.offered
                known[key] = before._replace(msgcount=before.msgcount + channel.msgcount, offered=offered)
            self._places[place][channel.id] = known[key].id
        self.every = list(known.values())
        self.connections = [each for each in self.every if not each.why_left_out]
        self.left_out = [each for each in self.every if each.why_left_out]
        self.message_count = sum(each.msgcount for each in self.connections)
        filled = [file for file in files if any(each.msgcount for each in file.channels)]
        self.start_time = min((file.first_ns for file in filled), default=0)
        self.end_time = max((file.last_ns for file in filled), default=0)
        said = checked_count(contents, sum(each.msgcount for each in self.every))
        self.notes = [said] if said else []
        self.notes += [f"bag {self.path}: {each.topic} is left out: {each.why_left_out}" for each in self.left_out]

    @property
    def topics(self) -> Mapping[str, int]:
        """Return the messages of each topic that can be decoded."""
        counts: dict[str, int] = {}
        for each in self.connections:
            counts[each.topic] = counts.get(each.topic, 0) + each.msgcount
        return counts

    def chosen_namespace(self, wanted: str | None) -> str:
        """Return the normalised namespace of the ankle that is meant; None: of the only one.

        Raises:
            InputError: the bag holds nothing of an ankle there, or several ankles and none is chosen.

        """
        found = namespaces_in(self.topics)
        if wanted in found:
            return wanted
        if wanted is None and len(found) == 1:
            return found[0]
        msg = f"bag {self.path} holds no topic of an ankle; record the topics that `jammkle record` takes"
        if found:
            not_there = "" if wanted is None else f", not '{wanted}'"
            msg = f"bag {self.path} holds the namespaces {', '.join(found)}; choose one with --namespace{not_there}"
        raise InputError(msg)

    def on(self, topics: Collection[str]) -> list[Connection]:
        """Return the connections of some topics; one of another type, or that lacks fields, is left out, and named."""
        found = []
        for each in self.connections:
            if each.topic not in topics:
                continue
            ours = next((kind for name, kind in _OURS.items() if f"/{each.topic}".endswith(f"/{name}")), each.msgtype)
            why = "" if each.msgtype == ours else f"it is of type {each.msgtype}, not {ours}"
            if not each.msgtype.startswith(_OWN_PACKAGE):  # bags of older releases lack fields of ours
                why = why or self._types.lacking(each)
            if why:
                note(f"bag {self.path}: {each.topic} is left out: {why}")
            else:
                found.append(each)
        return found

    def messages(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
        """Read connection, log time, ns, and data of messages of some connections, by log time."""
        chosen = {each.id: each for each in connections}
        keys = [{key for key, number in place.items() if number in chosen} for place in self._places]
        for time_ns, place, key, data in merged(self._files, keys):
            yield chosen[self._places[place][key]], time_ns, plain_data(data)

    def set_back_ns(self) -> dict[int, int]:
        """Return by how much the log of each connection goes back in the order in which its messages were written, ns.

        Files are taken in the order of their first messages, as their names need not say which was recorded first.
        Channels of one topic, as ROS 1 has one of each publisher, are looked at one by one: files list them so.
        """
        before_ns: dict[int, int] = {}
        back_ns = {each.id: 0 for each in self.every}
        places = sorted(range(len(self._files)), key=lambda place: self._files[place].first_ns)
        with contextlib.suppress(Exception):  # what is damaged is said where messages are read
            for place in places:
                latest_ns: dict[int, int] = {}
                for key, times_ns in self._files[place].written():
                    number = self._places[place][key]
                    last_ns = latest_ns.get(key, before_ns.get(number, 0))
                    for log_ns in times_ns:
                        back_ns[number] = max(back_ns[number], last_ns - log_ns)
                        last_ns = max(last_ns, log_ns)
                    latest_ns[key] = last_ns
                for key, last_ns in latest_ns.items():
                    number = self._places[place][key]
                    before_ns[number] = max(before_ns.get(number, 0), last_ns)
        return back_ns

    def deserialize(self, data: bytes, message_type: str) -> Any:
        """Return a message.

        Raises:
            InputError: the data are not of the type.

        """
        try:
            return self.typestore.deserialize_cdr(data, message_type)
        except Exception as error:  # errors of struct, of text, of index, as the data are broken
            msg = f"bag {self.path} is damaged: a message of type {message_type} cannot be decoded: {one_line(error)}"
            raise InputError(msg) from error

    def serialize(self, message: Any, message_type: str) -> bytes:
        """Return a message as CDR."""
        return bytes(self.typestore.serialize_cdr(message, message_type))


def _why_left_out(channel: Connection, types: KnownTypes) -> str:
    """Make the type of a channel known; return why its messages cannot be decoded."""
    if channel.encoding != "cdr":
        return f"its messages are '{channel.encoding}' and not CDR"
    try:
        types.add(channel)
    except UndecodableError as error:
        return str(error)
    return ""


def name_of(bag: Path) -> str:
    """Return the name of a bag as text that can be written anywhere, also where its bytes are none in UTF-8."""
    return os.fsencode(bag.name).decode(errors="backslashreplace")


@contextlib.contextmanager
def opened(path: Path, *, quietly: bool = False) -> Iterator[BagReader]:
    """Open a bag folder or a single bag file for reading.

    What is left out of it is said on stderr, once, unless quietly. Types without a definition in it are those of ROS 2
    Jazzy, and those that are installed.

    Raises:
        InputError: there is no bag, it cannot be read, or it is not whole.

    """
    with contextlib.ExitStack() as stack:
        try:
            contents = contents_of(path)
            check_finished(contents)
            reader = BagReader(contents, open_files(contents, stack))
        except InputError:
            raise
        # As in `open_files`.
        except Exception as error:
            msg = f"bag {path} cannot be read: {one_line(error)}"
            raise InputError(msg) from error
        for line in () if quietly else reader.notes:
            note(line)
        yield reader


def open_files(contents: Contents, stack: contextlib.ExitStack) -> list[BagFile]:
    """Open the files of a bag until a stack ends; those that are compressed as a whole are unpacked by then.

    Raises:
        InputError: one is damaged, or no file of a bag.
        OSError: one cannot be opened, or not be unpacked.

    """
    files = []
    for path in contents.files:
        try:
            plain = path
            if begins_with(path).startswith(ZSTD):
                folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="jammkle-"))
                plain = Path(folder, path.stem)
                decompressed(path, plain)
            file = open_file(plain)
        except OSError:
            raise
        # The libraries let errors of their parsers, of struct and of codecs through: what is broken decides.
        except Exception as error:
            msg = f"bag file {path} cannot be read: {one_line(error)}"
            raise InputError(msg) from error
        stack.callback(file.close)
        files.append(file)
    return files


def messages(
    reader: BagReader, path: Path, connections: Collection[Connection] | None = None
) -> Iterator[tuple[Connection, int, bytes]]:
    """Read connection, log time, ns, and data (CDR) of every message, by log time.

    A chunk that does not fit its checksum is noticed, if its recorder wrote one (rosbags writes none, hence `jammkle`),
    and so is whatever does not fit the lengths or the compression.

    Args:
        reader: The bag, open.
        path: Its name, for the error.
        connections: What is read; None stands for all that can be decoded.

    Raises:
        InputError: the bag is damaged.

    """
    count = 0
    try:
        for message in reader.messages(reader.connections if connections is None else connections):
            count += 1
            yield message
    # As in `opened`: what comes out depends on what is broken. An error of who takes the messages does not come here.
    except Exception as error:
        msg = f"bag {path} is damaged after {count} messages: {one_line(error)}"
        raise InputError(msg) from error
    expected = sum(each.msgcount for each in (reader.connections if connections is None else connections))
    if count != expected:
        msg = f"bag {path} is damaged: it holds {count} messages where its index says {expected}"
        raise InputError(msg)


_TELLING: tuple[names.Topic, ...] = (
    names.LOAD_CELL,
    names.JAM_STATE,
    names.CONTACT_EVENTS,
    names.MANIFOLD_PRESSURE,
    names.PUMP_DUTY,
    *names.PRESSURES.values(),
    *names.SOLENOIDS.values(),
)
"""Topics of an ankle, of which every recording of one has some, whoever made it."""


def namespaces_in(topics: Iterable[str]) -> tuple[str, ...]:
    """Return the namespaces in which topics of an ankle stand, sorted; `/` for the outermost.

    An IMU alone, or joint states, do not make an ankle where there is one: a whole robot has them too.
    """
    known = tuple(topics)
    return _with(known, _TELLING) or _with(known, (names.IMU,)) or _with(known, (names.JOINT_STATES,))


def _with(topics: Iterable[str], telling: Iterable[names.Topic]) -> tuple[str, ...]:
    endings = tuple(f"/{topic.name}" for topic in telling)
    return tuple(sorted({topic[: -len(end)] or "/" for topic in topics for end in endings if topic.endswith(end)}))
