"""`jammkle jam`, `unjam`, `call` and `status`: clients of a running graph.

What comes from the graph is turned here into what people read: vacuums in kPa, gauge, positive; words for states.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.srv import GetParameters
from rich.markup import escape
from rich.table import Table
from std_srvs.srv import SetBool, Trigger

from jammkle_bringup.graph_client import ANSWER_TIMEOUT_S, GraphClient, below
from jammkle_common.command.errors import GraphError, InputError
from jammkle_common.command.results import STATE_COLOURS
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.diagnostics import LIVENESS_LINE, MISSED_AFTER_S, reporting
from jammkle_common.names import (
    CHANNELS,
    DIAGNOSTICS,
    DRIVER_NODE,
    JAM,
    JAM_STATE,
    SERVICES,
    SET_BOOL,
    SIM_NODE,
    TRIGGER,
    UNJAM,
    relative,
    resolved,
)
from jammkle_common.qos import subscriber_qos
from jammkle_msgs.msg import ChannelJamState, JamState
from jammkle_msgs.srv import Jam, Unjam

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

_MAX_VACUUM = "max_vacuum_pa"
_PA_PER_KPA = 1e3
_LATEST_S = 6.0
"""How long reports are waited for, s: every node sends one a second, but some nodes are discovered only with the next
announcement, which the DDS of ROS 2 (Fast DDS) sends every 3 s."""

_STATES = {getattr(ChannelJamState, name): name for name in STATE_COLOURS}
_OK = "OK"
_LEVEL_STYLES = {_OK: "green", "WARN": "yellow", "ERROR": "bold red", "STALE": "dim"}
_LEVELS = {getattr(DiagnosticStatus, name): name for name in _LEVEL_STYLES}
_PACE = "achieved real-time factor"


@dataclass(frozen=True)
class Answer:
    """A node's answer to a request."""

    success: bool
    message: str


@dataclass(frozen=True)
class JamAnswer(Answer):
    """The driver's answer to a request to jam or unjam."""

    channels: tuple[str, ...]
    vacuum_kpa: float


@dataclass(frozen=True)
class ChannelStatus:
    """One channel: vacuums in kPa, gauge, positive; None where nothing is measured."""

    channel: str
    state: str
    commanded_vacuum_kpa: float
    measured_vacuum_kpa: float | None
    reason: str


@dataclass(frozen=True)
class JamStatus:
    """All channels of an ankle."""

    stamp_s: float
    emergency_stopped: bool
    manifold_vacuum_kpa: float | None
    channels: tuple[ChannelStatus, ...]


@dataclass(frozen=True)
class HealthStatus:
    """One line of /diagnostics."""

    name: str
    level: str
    message: str
    values: dict[str, str]


def together(answers: Mapping[str, Answer]) -> tuple[Answer, dict[str, Any]]:
    """Return the answers of several drivers, by ankle, as one, and all of them for JSON."""
    first = next(iter(answers.values()))
    if len(answers) == 1:
        return first, asdict(first)
    message = "; ".join(f"{ankle}: {answer.message}" for ankle, answer in answers.items())
    joined = replace(first, success=all(answer.success for answer in answers.values()), message=message)
    return joined, {**asdict(joined), "ankles": {ankle: asdict(answer) for ankle, answer in answers.items()}}


def jam(
    namespace: str, channels: Sequence[str], vacuum_kpa: float, asked_to_stop: Callable[[], bool]
) -> dict[str, Answer]:
    """Ask the driver, or that of each of a robot's ankles, to jam channels; none means all.

    Raises:
        InputError: an unknown channel, or a vacuum that is none, or beyond the driver's limit.
        GraphError: no driver answers.

    """
    _check_channels(channels)
    if not (math.isfinite(vacuum_kpa) and vacuum_kpa > 0):
        msg = f"--vacuum-kpa {vacuum_kpa:g} must be above 0 (gauge, positive); `jammkle unjam` vents"
        raise InputError(msg)
    vacuum_pa = vacuum_kpa * _PA_PER_KPA
    request = Jam.Request(channels=list(channels), vacuum_pa=vacuum_pa)
    limits = GetParameters.Request(names=[_MAX_VACUUM])
    with GraphClient(namespace, asked_to_stop) as client:
        ankles = client.ankles()
        for ankle in ankles:  # before any of them is jammed
            values = client.call(f"{below(ankle, DRIVER_NODE)}/get_parameters", GetParameters, limits).values
            largest_pa = values[0].double_value if values else math.inf
            if vacuum_pa > largest_pa:
                limit = f"the driver's {_MAX_VACUUM} of {largest_pa / _PA_PER_KPA:g} kPa"
                msg = f"--vacuum-kpa {vacuum_kpa:g} is beyond {limit}: ask for less"
                raise InputError(msg)
        answers = {ankle: client.call(below(ankle, JAM.path), Jam, request) for ankle in ankles}
    return _answered(answers, channels, vacuum_kpa)


def unjam(namespace: str, channels: Sequence[str], asked_to_stop: Callable[[], bool]) -> dict[str, Answer]:
    """Ask the driver, or that of each of a robot's ankles, to vent channels; none means all.

    Raises:
        InputError: an unknown channel.
        GraphError: no driver answers.

    """
    _check_channels(channels)
    request = Unjam.Request(channels=list(channels))
    with GraphClient(namespace, asked_to_stop) as client:
        answers = client.call_each(client.ankles(), UNJAM.path, Unjam, request)
    return _answered(answers, channels, 0.0)


CALLED = {each.path: each for each in SERVICES if each.service_type in {TRIGGER, SET_BOOL}}
"""Services that need no more than true or false, by name relative to the namespace."""


def call(
    namespace: str,
    service: str,
    value: bool | None,  # noqa: FBT001 - as the service has it
    asked_to_stop: Callable[[], bool],
) -> dict[str, Answer]:
    """Call a service of a node, of each of a robot's ankles where it is theirs.

    Args:
        namespace: Of the ankle or the robot, normalised.
        service: One of `CALLED`.
        value: For those that take one.
        asked_to_stop: Ends it early.

    Raises:
        InputError: an unknown service, or a value that it does not take, or takes and has not got.
        GraphError: nobody answers.

    """
    known = CALLED.get(service.strip("/"))
    if known is None:
        msg = f"service '{service}' is not one of {', '.join(CALLED)}"
        raise InputError(msg)
    takes_value = known.service_type == SET_BOOL
    if takes_value is (value is None):
        msg = f"{service} {'takes true or false' if takes_value else 'takes no value'} ({known.note})"
        raise InputError(msg)
    kind: Any = SetBool if takes_value else Trigger
    request = kind.Request() if value is None else kind.Request(data=value)
    with GraphClient(namespace, asked_to_stop) as client:
        ankles = ("",) if known.node == SIM_NODE else client.ankles()
        answers = client.call_each(ankles, known.path, kind, request)
    return {ankle: Answer(each.success, each.message) for ankle, each in answers.items()}


def _answered(answers: Mapping[str, Any], channels: Sequence[str], vacuum_kpa: float) -> dict[str, Answer]:
    asked = tuple(channels) or CHANNELS
    return {ankle: JamAnswer(each.success, each.message, asked, vacuum_kpa) for ankle, each in answers.items()}


def _check_channels(channels: Sequence[str]) -> None:
    for channel in channels:
        if channel not in CHANNELS:
            msg = f"unknown channel '{channel}': the channels are {', '.join(CHANNELS)} (none means all of them)"
            raise InputError(msg)


def status(namespace: str, asked_to_stop: Callable[[], bool]) -> tuple[dict[str, JamStatus], tuple[HealthStatus, ...]]:
    """Return the state of each ankle's channels, and the health of every node.

    Raises:
        GraphError: no driver is received.

    """
    states: dict[str, JamState] = {}
    health: dict[str, HealthStatus] = {}
    with GraphClient(namespace, asked_to_stop) as client:
        # From the start, as it takes a second until all have reported, and some time to find the ankles too.
        client.subscribe(
            DiagnosticArray,
            DIAGNOSTICS,
            lambda array: health.update({line.name: line for line in _health_status(array)}),
            subscriber_qos(DIAGNOSTICS),
        )

        def subscribe(ankle: str) -> None:
            name = resolved(namespace, below(ankle, JAM_STATE.name))

            def take(state: JamState) -> None:
                states[ankle] = state

            client.node.create_subscription(JamState, name, take, subscriber_qos(JAM_STATE))

        ankles = client.ankles(subscribe)
        if not client.wait_until(lambda: states.keys() >= set(ankles), ANSWER_TIMEOUT_S):
            silent = next(ankle for ankle in ankles if ankle not in states)
            raise GraphError(client.no_answer(below(silent, JAM_STATE.name)))
        drivers = {resolved(namespace, below(ankle, DRIVER_NODE)) for ankle in ankles}
        client.wait_until(lambda: all_reported(_inside(namespace, ankles, health), drivers), _LATEST_S)
        shown = _inside(namespace, ankles, health)
    return {ankle: _jam_status(states[ankle]) for ankle in ankles}, tuple(shown[name] for name in sorted(shown))


def _inside(namespace: str, ankles: Sequence[str], health: Mapping[str, HealthStatus]) -> dict[str, HealthStatus]:
    """Return the lines of the nodes of these ankles, and of a robot's, which are in the namespace above."""
    places = {"", *ankles}
    nodes = {name: relative(namespace, name.partition(":")[0]) for name in health}
    return {
        name: health[name] for name, node in nodes.items() if node is not None and node.rpartition("/")[0] in places
    }


def all_reported(health: Mapping[str, HealthStatus], drivers: Collection[str]) -> bool:
    """Return whether there is a report of each driver, and of every node that another one receives reports of.

    Each node lists those in its line `nodes`, with how long each has been silent. Who is missed there already is not
    waited for: it is dead, and the line says so.
    """
    seen = {name.partition(":")[0] for name in health}
    if not seen.issuperset(drivers):
        return False
    received = (reporting(name, line.values) for name, line in health.items() if name.endswith(LIVENESS_LINE))
    return all(silent_s > MISSED_AFTER_S or node in seen for reports in received for node, silent_s in reports.items())


def _jam_status(state: JamState) -> JamStatus:
    return JamStatus(
        stamp_s=state.header.stamp.sec + state.header.stamp.nanosec / NANOSECONDS_PER_SECOND,
        emergency_stopped=state.emergency_stopped,
        manifold_vacuum_kpa=_measured_kpa(state.manifold_vacuum_pa),
        channels=tuple(
            ChannelStatus(
                channel=channel.channel,
                state=_STATES.get(channel.state, str(channel.state)),
                commanded_vacuum_kpa=channel.commanded_vacuum_pa / _PA_PER_KPA,
                measured_vacuum_kpa=_measured_kpa(channel.measured_vacuum_pa),
                reason=channel.reason,
            )
            for channel in state.channels
        ),
    )


def _health_status(array: DiagnosticArray) -> tuple[HealthStatus, ...]:
    return tuple(
        HealthStatus(
            line.name,
            _LEVELS.get(line.level, "UNKNOWN"),
            line.message,
            {value.key: value.value for value in line.values},
        )
        for line in array.status
    )


def _measured_kpa(pascal: float) -> float | None:
    return None if math.isnan(pascal) else pascal / _PA_PER_KPA


def status_tables(ankles: Mapping[str, JamStatus], health: Sequence[HealthStatus], *, verbose: bool) -> list[Table]:
    """Return the tables of `jammkle status`, one for each ankle; `verbose` shows every value that nodes report."""
    tables = [_channels_table(ankle, status) for ankle, status in ankles.items()]
    lines = Table(title="Health" if verbose else "Health: what is not OK", title_justify="left")
    for heading in ("node: what", "level", "message"):
        lines.add_column(heading, overflow="fold")
    shown = [line for line in health if verbose or line.level != _OK]
    for line in shown:
        text = "\n".join([line.message, *(f"{key}: {value}" for key, value in line.values.items())])
        lines.add_row(escape(line.name), _styled(line.level, _LEVEL_STYLES), escape(text))
    return [*tables, lines] if shown else tables


def status_line(ankles: Mapping[str, JamStatus], health: Sequence[HealthStatus], *, verbose: bool) -> str:
    """Return all of `jammkle status` in one line: ankles, states of their channels, nodes, what is not OK, the pace."""
    states = Counter(channel.state for status in ankles.values() for channel in status.channels)
    channels = ", ".join(f"{count} {state}" for state, count in states.most_common())
    nodes = len({line.name.partition(":")[0] for line in health})
    bad = Counter(line.level for line in health if line.level != _OK)
    levels = ", ".join(f"{count} {level}" for level, count in bad.most_common()) or "all OK"
    parts = [_counted(len(ankles), "ankle"), f"channels {channels}", f"{_counted(nodes, 'node')}, {levels}"]
    parts += [f"real-time factor {line.values[_PACE]}" for line in health if _PACE in line.values]
    return "; ".join(parts) + ("" if verbose else " (--all shows every line)")


def _counted(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _channels_table(ankle: str, status: JamStatus) -> Table:
    channels = Table(title=f"Channels of {ankle}" if ankle else "Channels", title_justify="left")
    for heading in ("channel", "state"):
        channels.add_column(heading)
    for heading in ("commanded, kPa", "measured, kPa"):
        channels.add_column(heading, justify="right")
    channels.add_column("reason")
    for channel in status.channels:
        channels.add_row(
            channel.channel,
            _styled(channel.state, STATE_COLOURS),
            f"{channel.commanded_vacuum_kpa:.1f}",
            _kpa(channel.measured_vacuum_kpa),
            escape(channel.reason),
        )
    channels.add_row("manifold", "", "", _kpa(status.manifold_vacuum_kpa), "")
    return channels


def _kpa(kilopascal: float | None) -> str:
    return "not measured" if kilopascal is None else f"{kilopascal:.1f}"


def _styled(text: str, styles: dict[str, str]) -> str:
    style = styles.get(text)
    return f"[{style}]{text}[/{style}]" if style else text
