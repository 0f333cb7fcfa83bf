"""Write the run of a rig or a robot as a bag that looks as if the graph had been recorded: types, units, stamps."""

from __future__ import annotations

import functools
import heapq
import json
import operator
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from jammkle_common.bags.definitions import Serialiser
from jammkle_common.bags.writing import BagLog, bag_delivery
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.messages import Health, Level, diagnostic_array, message_class
from jammkle_common.names import (
    CHANNELS,
    CLOCK,
    DIAGNOSTICS,
    GAIT_PHASE,
    IMU,
    JOINT_STATES,
    LOAD_CELL,
    MANIFOLD_FRAME,
    MANIFOLD_PRESSURE,
    ODOMETRY,
    OF_THE_WHOLE,
    PLANNED_CONTACT,
    PRESSURES,
    PUMP_DUTY,
    ROBOT_DESCRIPTION,
    ROBOT_TOPICS,
    SIM_NODE,
    SIM_PARAMETERS,
    SOLENOIDS,
    TENDON_STATES,
    TENDONS,
    TOPICS,
    TRUE_CONTACT,
    Topic,
    below,
    published,
    resolved,
)
from jammkle_sim.conversions import OutgoingMessages, parameters_message, time_message
from jammkle_sim.rigs.simulation import BaseSample, FootTruth, ImuSample, TendonSample

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from rosbags.interfaces import Qos

    from jammkle_common.bags.definitions import MessageDefinitions
    from jammkle_common.bags.writing import BagCounts
    from jammkle_sim.rigs.run import RigRun, Series


RESULTS_KEY = "rig_results"
"""Custom data of a bag that holds what the rig itself measured, as JSON."""

_OF_SIMULATION = (*OF_THE_WHOLE, DIAGNOSTICS)
"""What one simulation says for all of its ankles."""


def write_bags(runs: Mapping[str, RigRun], path: Path, namespace: str, definitions: MessageDefinitions) -> BagCounts:
    """Write every topic of runs at the same time into one bag, /clock after all else of its time; parameters as data.

    Args:
        runs: By namespace of each ankle below `namespace`; a single one may be in that, under an empty name. Their time
            zero is the bag's.
        path: Folder of the bag; it must not exist.
        namespace: Normalised namespace of the robot.
        definitions: Where message definitions come from.

    Raises:
        InputError: the path exists or cannot be made.
        NotFiniteError: a run holds NaN or infinity; the bag ends before it.

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
        data = message if isinstance(message, bytes) else serialiser.serialised(topic.message_type, message)
        log.write(name, data, at_ns)

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


Bool = message_class("std_msgs/msg/Bool")
Float32 = message_class("std_msgs/msg/Float32")
String = message_class("std_msgs/msg/String")

_HARDWARE_ID = "jammkle_sim"
_DIAGNOSTICS_PERIOD_S = 1.0

Timed = tuple[int, int, Topic, Callable[[], Any]]
"""Time, ns since the start of the rig; rank of the topic among those of one time; topic; what makes the message."""


def messages(run: RigRun, namespace: str, robot_namespace: str = "") -> Iterator[tuple[int, Topic, Any]]:
    """Give every message of a run in the order of time, sensors before commands, without /clock.

    A message may be filled anew for the next one: it must be used before the next is asked for. Namespaces are those of
    the ankle, for the name that diagnostics carry, and of its robot, if that is another.

    Yields:
        Time, ns since the start of the rig; topic; message, or the bytes of one.

    Raises:
        NotFiniteError: the run holds NaN or infinity.

    """
    present = {name.partition(".")[0] for name in _columns(run, TENDON_STATES)}
    tendons = tuple(tendon for tendon in TENDONS if tendon in present)
    outgoing, whole = OutgoingMessages(tendons, namespace), OutgoingMessages((), robot_namespace or namespace)
    makers: list[tuple[Topic, Callable[[int, dict[str, float]], Any]]] = [
        (IMU, lambda time_ns, row: outgoing.imu(time_ns, _imu(row))),
        (JOINT_STATES, lambda time_ns, row: outgoing.joint_states(time_ns, *_joints(row))),
        (TENDON_STATES, lambda time_ns, row: outgoing.tendon_states(time_ns, _tendons(row, tendons))),
        (TRUE_CONTACT, lambda time_ns, row: outgoing.true_contact(time_ns, _truth(row))),
        (PLANNED_CONTACT, lambda _, row: Bool(data=row["data"] > 0.0)),
        (GAIT_PHASE, lambda _, row: Float32(data=row["data"])),
        (ODOMETRY, lambda time_ns, row: whole.odometry(time_ns, BaseSample(*_base(row)))),
        (LOAD_CELL, lambda time_ns, row: outgoing.wrench(time_ns, _vector(row, "force_{}_n"))),
        *(
            (topic, lambda time_ns, row, place=place: outgoing.pressure(time_ns, row["fluid_pressure_pa"], place))
            for place, topic in {MANIFOLD_FRAME: MANIFOLD_PRESSURE, **PRESSURES}.items()
        ),
        (PUMP_DUTY, lambda _, row: Float32(data=row["data"])),
        *((SOLENOIDS[channel], lambda _, row: Bool(data=row["data"] > 0.0)) for channel in CHANNELS),
    ]
    streams = [_parameters(run), _diagnostics(run, namespace, len(makers) + 1)]
    streams += [
        _timed(run.topics[topic.name], rank, topic, make)
        for rank, (topic, make) in enumerate(makers, start=1)
        if topic.name in run.topics
    ]
    # Topics share messages that are filled anew, so none is made before its turn has come.
    for time_ns, _, topic, make_message in heapq.merge(*streams, key=lambda timed: timed[:2]):
        yield time_ns, topic, make_message()


def _timed(series: Series, rank: int, topic: Topic, make: Callable[[int, dict[str, float]], Any]) -> Iterator[Timed]:
    for time_s, values in zip(series.time_s.tolist(), series.values.tolist(), strict=True):
        time_ns = round(time_s * NANOSECONDS_PER_SECOND)
        row = dict(zip(series.columns, values, strict=True))
        yield time_ns, rank, topic, functools.partial(make, time_ns, row)


def _parameters(run: RigRun) -> Iterator[Timed]:
    yield 0, 0, SIM_PARAMETERS, lambda: parameters_message(run.description)
    if run.robot_description:
        yield 0, 0, ROBOT_DESCRIPTION, lambda: String(data=run.robot_description)


def _diagnostics(run: RigRun, namespace: str, rank: int) -> Iterator[Timed]:
    """Report the tendons once a second, and when one tears."""
    torn_s = _torn_times_s(run)
    end_s = max(float(series.time_s[-1]) for series in run.topics.values())
    regular_s = [period * _DIAGNOSTICS_PERIOD_S for period in range(int(end_s / _DIAGNOSTICS_PERIOD_S) + 1)]
    name = f"{namespace.rstrip('/')}/{SIM_NODE}"
    for time_s in sorted({*regular_s, *torn_s.values()}):
        broken = [tendon for tendon, since_s in torn_s.items() if since_s <= time_s]
        time_ns = round(time_s * NANOSECONDS_PER_SECOND)
        health = [_tendon_health(broken)]
        make = functools.partial(diagnostic_array, time_message(time_ns), name, _HARDWARE_ID, health)
        yield time_ns, rank, DIAGNOSTICS, make


def _tendon_health(broken: list[str]) -> Health:
    values = {"broken tendons": ", ".join(broken) or "none"}
    if broken:
        return Health("tendons", Level.ERROR, f"broken: {', '.join(broken)}; without force from here on", values)
    return Health("tendons", Level.OK, "whole", values)


def _torn_times_s(run: RigRun) -> dict[str, float]:
    if not run.broken:
        return {}
    series = run.topics[TENDON_STATES.name]
    return {
        tendon: float(series.time_s[int((series.column(f"{tendon}.broken") > 0.0).argmax())]) for tendon in run.broken
    }


def _columns(run: RigRun, topic: Topic) -> tuple[str, ...]:
    return run.topics[topic.name].columns if topic.name in run.topics else ()


def _imu(row: dict[str, float]) -> ImuSample:
    return ImuSample(_vector(row, "linear_acceleration_{}_m_s2"), _vector(row, "angular_velocity_{}_rad_s"))


def _truth(row: dict[str, float]) -> FootTruth:
    return FootTruth(row["stands"] > 0.0, row["normal_force_n"], row["sliding_speed_m_s"], row["sliding_distance_m"])


def _base(row: dict[str, float]) -> tuple[Any, Any, Any, Any]:
    turn = tuple(row[f"orientation_{axis}"] for axis in "wxyz")
    return _vector(row, "position_{}_m"), turn, _vector(row, "linear_{}_m_s"), _vector(row, "angular_{}_rad_s")


def _vector(row: dict[str, float], pattern: str) -> tuple[float, float, float]:
    x, y, z = (row[pattern.format(axis)] for axis in "xyz")
    return x, y, z


def _joints(row: dict[str, float]) -> tuple[dict[str, float], dict[str, float]]:
    return _of_all(row, ".position"), _of_all(row, ".velocity")


def _of_all(row: dict[str, float], suffix: str) -> dict[str, float]:
    return {name.removesuffix(suffix): value for name, value in row.items() if name.endswith(suffix)}


def _tendons(row: dict[str, float], tendons: tuple[str, ...]) -> tuple[TendonSample, ...]:
    return tuple(
        TendonSample(
            name,
            row[f"{name}.extension_m"],
            row[f"{name}.extension_rate_m_s"],
            row[f"{name}.tension_n"],
            row[f"{name}.broken"] > 0.0,
        )
        for name in tendons
    )
