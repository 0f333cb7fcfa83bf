"""Between a finished run of a rig and the messages of a bag: types, units, stamps. The only place for both."""

from __future__ import annotations

import functools
import heapq
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.messages import Health, Level, diagnostic_array, message_class
from jammkle_common.names import (
    CHANNELS,
    DIAGNOSTICS,
    GAIT_PHASE,
    IMU,
    JOINT_STATES,
    LOAD_CELL,
    MANIFOLD_FRAME,
    MANIFOLD_PRESSURE,
    ODOMETRY,
    PLANNED_CONTACT,
    PRESSURES,
    PUMP_DUTY,
    ROBOT_DESCRIPTION,
    SIM_NODE,
    SIM_PARAMETERS,
    SOLENOIDS,
    TENDON_STATES,
    TENDONS,
    TRUE_CONTACT,
    Topic,
)
from jammkle_sim.conversions import OutgoingMessages, parameters_message, time_message
from jammkle_sim.rigs.base import BaseSample
from jammkle_sim.rigs.readout import ImuSample, TendonSample
from jammkle_sim.robots.foot_truth import FootTruth

if TYPE_CHECKING:
    from collections.abc import Iterator

    from jammkle_sim.rigs.run import RigRun, Series

Bool = message_class("std_msgs/msg/Bool")
Float32 = message_class("std_msgs/msg/Float32")
String = message_class("std_msgs/msg/String")

_HARDWARE_ID = "jammkle_sim"
_DIAGNOSTICS_PERIOD_S = 1.0

Timed = tuple[int, int, Topic, Callable[[], Any]]
"""Time, ns since the start of the rig; rank of the topic among those of one time; topic; what makes the message."""


def messages(run: RigRun, namespace: str, robot_namespace: str = "") -> Iterator[tuple[int, Topic, Any]]:
    """Give every message of a run in the order of time, sensors before commands, without /clock.

    A message may be filled anew for the next one: it must be used before the next is asked for.

    Args:
        run: The run.
        namespace: Normalised namespace of the ankle, for the name that diagnostics carry.
        robot_namespace: That of its robot, if it is another.

    Yields:
        Time, ns since the start of the rig; topic; message.

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
        _stream(run.topics[topic.name], rank, topic, make)
        for rank, (topic, make) in enumerate(makers, start=1)
        if topic.name in run.topics
    ]
    # Topics share messages that are filled anew, so none is made before its turn has come.
    for time_ns, _, topic, make_message in heapq.merge(*streams, key=lambda timed: timed[:2]):
        yield time_ns, topic, make_message()


def _stream(series: Series, rank: int, topic: Topic, make: Callable[[int, dict[str, float]], Any]) -> Iterator[Timed]:
    for time_s, values in zip(series.time_s.tolist(), series.values.tolist(), strict=True):
        time_ns = _nanoseconds(time_s)
        row = dict(zip(series.columns, values, strict=True))
        yield time_ns, rank, topic, functools.partial(make, time_ns, row)


def _parameters(run: RigRun) -> Iterator[Timed]:
    yield 0, 0, SIM_PARAMETERS, lambda: parameters_message(run.description)
    if run.robot_description:
        yield 0, 0, ROBOT_DESCRIPTION, lambda: String(data=run.robot_description)


def _diagnostics(run: RigRun, namespace: str, rank: int) -> Iterator[Timed]:
    """Tell of the tendons once a second, and when one tears."""
    torn_s = _torn_times_s(run)
    end_s = max(float(series.time_s[-1]) for series in run.topics.values())
    regular_s = [period * _DIAGNOSTICS_PERIOD_S for period in range(int(end_s / _DIAGNOSTICS_PERIOD_S) + 1)]
    name = f"{namespace.rstrip('/')}/{SIM_NODE}"
    for time_s in sorted({*regular_s, *torn_s.values()}):
        broken = [tendon for tendon, since_s in torn_s.items() if since_s <= time_s]
        time_ns = _nanoseconds(time_s)
        health = [_tendon_health(broken)]
        make = functools.partial(diagnostic_array, time_message(time_ns), name, _HARDWARE_ID, health)
        yield time_ns, rank, DIAGNOSTICS, make


def _tendon_health(broken: list[str]) -> Health:
    values = {"broken tendons": ", ".join(broken) or "none"}
    if broken:
        return Health("tendons", Level.ERROR, f"broken: {', '.join(broken)}; without force from here on", values)
    return Health("tendons", Level.OK, "whole", values)


def _torn_times_s(run: RigRun) -> dict[str, float]:
    """Return when each torn tendon tore, s, by its name."""
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
    """Return positions and rates by joint."""
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


def _nanoseconds(time_s: float) -> int:
    return round(time_s * NANOSECONDS_PER_SECOND)
