"""Write the run of a rig as a bag that looks as if the graph had been recorded."""

from __future__ import annotations

import functools
import heapq
import json
import operator
from typing import TYPE_CHECKING, Any

from jammkle_common.bags.definitions import Serialiser
from jammkle_common.bags.writing import BagLog, bag_delivery
from jammkle_common.names import (
    CLOCK,
    DIAGNOSTICS,
    OF_THE_WHOLE,
    ROBOT_TOPICS,
    SIM_PARAMETERS,
    TOPICS,
    below,
    published,
    resolved,
)
from jammkle_sim.commands.rig_messages import messages
from jammkle_sim.conversions import OutgoingMessages

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from rosbags.interfaces import Qos

    from jammkle_common.bags.definitions import MessageDefinitions
    from jammkle_common.bags.writing import BagCounts
    from jammkle_common.names import Topic
    from jammkle_sim.rigs.run import RigRun

RESULTS_KEY = "rig_results"
"""Custom data of a bag that holds what the rig itself measured, as JSON."""

_OF_SIMULATION = (*OF_THE_WHOLE, DIAGNOSTICS)
"""What one simulation says for all of its ankles."""


def write_bag(run: RigRun, path: Path, namespace: str, definitions: MessageDefinitions) -> BagCounts:
    """Write every topic of a run, /clock after all else of its time, and the parameters as custom data.

    Args:
        run: The run. Its time zero is the bag's.
        path: Folder of the bag; it must not exist.
        namespace: Normalised namespace of the ankle.
        definitions: Where message definitions come from.

    Raises:
        InputError: the path exists or cannot be made.
        NotFiniteError: the run holds NaN or infinity; the bag ends before it.

    """
    return write_bags({"": run}, path, namespace, definitions)


def write_bags(runs: Mapping[str, RigRun], path: Path, namespace: str, definitions: MessageDefinitions) -> BagCounts:
    """Write what several ankles of one robot measured in the same time into one bag; as `write_bag` otherwise.

    Args:
        runs: By namespace of each ankle below `namespace`; a single one may be in that, under an empty name.
        path: As for `write_bag`.
        namespace: Normalised namespace of the robot.
        definitions: As for `write_bag`.

    """
    log = BagLog(path, definitions)
    serialiser = Serialiser(definitions)
    of_robot = [topic for topic in ROBOT_TOPICS if any(topic.name in run.topics for run in runs.values())]
    for ankle in runs:
        for topic in (*TOPICS, *of_robot):
            name = _name(topic, ankle, namespace)
            log.add_topic(name, topic.message_type, functools.partial(_offered, topic))
    clock = OutgoingMessages(())

    def write(name: str, topic: Topic, message: Any) -> None:
        log.write(name, serialiser.serialised(topic.message_type, message), at_ns)

    at_ns = 0
    streams = [_stream(run, ankle, namespace, is_first=i == 0) for i, (ankle, run) in enumerate(runs.items())]
    try:
        for time_ns, name, topic, message in heapq.merge(*streams, key=operator.itemgetter(0)):
            if time_ns > at_ns:
                write(CLOCK.name, CLOCK, clock.clock(at_ns))
                at_ns = time_ns
            write(name, topic, message)
            if topic is SIM_PARAMETERS:
                log.set_custom_data(SIM_PARAMETERS.name, message.data)
        write(CLOCK.name, CLOCK, clock.clock(at_ns))
        results = {ankle: run.results for ankle, run in runs.items()}
        log.set_custom_data(RESULTS_KEY, json.dumps(results.get("", results)))
    finally:
        counts = log.close()
    return counts


def _stream(run: RigRun, ankle: str, namespace: str, *, is_first: bool) -> Iterator[tuple[int, str, Topic, Any]]:
    """Give the messages of one ankle with their full names; of what the one simulation says, only the first's."""
    for time_ns, topic, message in messages(run, resolved(namespace, ankle).rstrip("/") or "/", namespace):
        if is_first or topic not in _OF_SIMULATION:
            yield time_ns, _name(topic, ankle, namespace), topic, message


def _name(topic: Topic, ankle: str, namespace: str) -> str:
    return resolved(namespace, topic.name if topic in _OF_SIMULATION else below(ankle, topic))


def _offered(topic: Topic) -> Sequence[Qos]:
    return [bag_delivery(published(topic))]
