"""Write the run of a rig as a bag that looks as if the graph had been recorded."""

from __future__ import annotations

import functools
import json
from typing import TYPE_CHECKING, Any

from jammkle_graph.bags.delivered import bag_delivery
from jammkle_graph.bags.serialisation import Serialiser
from jammkle_graph.bags.writing import BagLog, TimeSource
from jammkle_graph.delivery import published
from jammkle_graph.names import CLOCK, SIM_PARAMETERS, TOPICS
from jammkle_graph.namespace import resolved
from jammkle_sim.commands.rig_messages import messages
from jammkle_sim.conversions import OutgoingMessages

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from rosbags.interfaces import Qos

    from jammkle_graph.bags.definitions import MessageDefinitions
    from jammkle_graph.bags.writing import BagCounts
    from jammkle_graph.names import Topic
    from jammkle_sim.rigs.run import RigRun

RESULTS_KEY = "rig_results"
"""Custom data of a bag that holds what the rig itself measured, as JSON."""


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
    log = BagLog(path, definitions, TimeSource.SIMULATED)
    serialiser = Serialiser(definitions)
    names = {topic.name: resolved(namespace, topic.name) for topic in TOPICS}
    for topic in TOPICS:
        log.add_topic(names[topic.name], topic.message_type, functools.partial(_offered, topic))
    clock = OutgoingMessages(())

    def write(topic: Topic, message: Any) -> None:
        log.write(names[topic.name], serialiser.serialised(topic.message_type, message))

    log.tick(0)
    at_ns = 0
    try:
        for time_ns, topic, message in messages(run, namespace):
            if time_ns > at_ns:
                write(CLOCK, clock.clock(at_ns))
                at_ns = time_ns
                log.tick(at_ns)
            write(topic, message)
            if topic is SIM_PARAMETERS:
                log.set_custom_data(SIM_PARAMETERS.name, message.data)
        write(CLOCK, clock.clock(at_ns))
        log.set_custom_data(RESULTS_KEY, json.dumps(run.results))
    finally:
        counts = log.close()
    return counts


def _offered(topic: Topic) -> Sequence[Qos]:
    return [bag_delivery(published(topic))]
