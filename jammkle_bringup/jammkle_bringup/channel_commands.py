"""`jammkle jam`, `jammkle unjam` and `jammkle status`: clients of a running graph."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import GetParameters

from jammkle_bringup.conversions import HealthStatus, JamStatus, health_status, jam_status, pa_from_kpa
from jammkle_bringup.graph_client import ANSWER_TIMEOUT_S, GraphClient, no_answer
from jammkle_common.command.errors import GraphError, InputError
from jammkle_common.diagnostics import LIVENESS_LINE, MISSED_AFTER_S, SILENT_FOR
from jammkle_common.names import CHANNELS, DIAGNOSTICS, DRIVER_NODE, JAM, JAM_STATE, UNJAM, relative, resolved
from jammkle_common.qos import subscriber_qos
from jammkle_msgs.msg import JamState
from jammkle_msgs.srv import Jam, Unjam

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

_MAX_VACUUM = "max_vacuum_pa"
_PA_PER_KPA = 1e3
_LATEST_S = 6.0
"""How long reports are waited for, s: every node sends one a second, but some nodes are discovered only with the next
announcement, which the DDS of ROS 2 (Fast DDS) sends every 3 s."""


@dataclass(frozen=True)
class Answer:
    """What the driver said to a request."""

    success: bool
    message: str
    channels: tuple[str, ...]
    vacuum_kpa: float

    def as_json(self) -> dict[str, Any]:
        """Return a mapping for JSON."""
        return asdict(self)


def together(answers: Mapping[str, Answer]) -> tuple[Answer, dict[str, Any]]:
    """Return what several drivers said as one answer, and all of it for JSON.

    Args:
        answers: By ankle; a single one under an empty name.

    """
    first = next(iter(answers.values()))
    if len(answers) == 1:
        return first, first.as_json()
    message = "; ".join(f"{ankle}: {answer.message}" for ankle, answer in answers.items())
    whole = replace(first, success=all(answer.success for answer in answers.values()), message=message)
    return whole, {**whole.as_json(), "ankles": {ankle: answer.as_json() for ankle, answer in answers.items()}}


def check_channels(channels: Sequence[str]) -> None:
    """Refuse names that are no channel.

    Raises:
        InputError: a name is no channel.

    """
    for channel in channels:
        if channel not in CHANNELS:
            msg = f"unknown channel '{channel}': the channels are {', '.join(CHANNELS)} (none means all of them)"
            raise InputError(msg)


def check_vacuum(vacuum_kpa: float) -> None:
    """Refuse what no vacuum can be; the driver's own limit is asked of the driver.

    Raises:
        InputError: not a number, zero, negative or not finite.

    """
    if not (math.isfinite(vacuum_kpa) and vacuum_kpa > 0):
        msg = f"--vacuum-kpa {vacuum_kpa:g} must be above 0 (gauge, positive); `jammkle unjam` vents"
        raise InputError(msg)


def jam(
    namespace: str, channels: Sequence[str], vacuum_kpa: float, asked_to_stop: Callable[[], bool]
) -> dict[str, Answer]:
    """Ask the driver, or that of each of a robot's ankles, to jam channels; none means all.

    Raises:
        InputError: an unknown channel, or a vacuum beyond the driver's limit.
        GraphError: no driver answers.

    """
    check_channels(channels)
    check_vacuum(vacuum_kpa)
    wish = Jam.Request(channels=list(channels), vacuum_pa=pa_from_kpa(vacuum_kpa))
    limits = GetParameters.Request(names=[_MAX_VACUUM])
    answers: dict[str, Answer] = {}
    with GraphClient(namespace, asked_to_stop) as client:
        ankles = client.ankles()
        for ankle in ankles:  # before any of them is jammed
            path = _path(ankle, f"{DRIVER_NODE}/get_parameters")
            values = client.call_path(path, GetParameters, limits).values
            largest_pa = values[0].double_value if values else math.inf
            if pa_from_kpa(vacuum_kpa) > largest_pa:
                limit = f"the driver's {_MAX_VACUUM} of {largest_pa / _PA_PER_KPA:g} kPa"
                msg = f"--vacuum-kpa {vacuum_kpa:g} is beyond {limit}: ask for less"
                raise InputError(msg)
        for ankle in ankles:
            answer = client.call_path(_path(ankle, JAM.path), Jam, wish)
            answers[ankle] = Answer(answer.success, answer.message, tuple(channels) or CHANNELS, vacuum_kpa)
    return answers


def unjam(namespace: str, channels: Sequence[str], asked_to_stop: Callable[[], bool]) -> dict[str, Answer]:
    """Ask the driver, or that of each of a robot's ankles, to vent channels; none means all.

    Raises:
        InputError: an unknown channel.
        GraphError: no driver answers.

    """
    check_channels(channels)
    wish = Unjam.Request(channels=list(channels))
    answers: dict[str, Answer] = {}
    with GraphClient(namespace, asked_to_stop) as client:
        for ankle in client.ankles():
            answer = client.call_path(_path(ankle, UNJAM.path), Unjam, wish)
            answers[ankle] = Answer(answer.success, answer.message, tuple(channels) or CHANNELS, 0.0)
    return answers


def status(namespace: str, asked_to_stop: Callable[[], bool]) -> tuple[dict[str, JamStatus], tuple[HealthStatus, ...]]:
    """Return what each ankle's driver says of its channels, and what every node says of its health.

    Raises:
        GraphError: no driver is heard.

    """
    states: dict[str, JamState] = {}
    health: dict[str, HealthStatus] = {}
    with GraphClient(namespace, asked_to_stop) as client:
        # From the start, as it takes a second until all have reported, and some time to find the ankles too.
        client.subscribe(
            DiagnosticArray,
            DIAGNOSTICS,
            lambda array: health.update({line.name: line for line in health_status(array)}),
            subscriber_qos(DIAGNOSTICS),
        )
        ankles = client.ankles()

        def taking(ankle: str) -> Callable[[JamState], None]:
            return lambda state: states.update({ankle: state})

        for ankle in ankles:
            name = resolved(namespace, _path(ankle, JAM_STATE.name))
            client.node.create_subscription(JamState, name, taking(ankle), subscriber_qos(JAM_STATE))
        if not client.wait_until(lambda: len(states) == len(ankles), ANSWER_TIMEOUT_S):
            silent = next(ankle for ankle in ankles if ankle not in states)
            raise GraphError(no_answer(_path(silent, JAM_STATE.name), namespace, ANSWER_TIMEOUT_S))
        drivers = {resolved(namespace, _path(ankle, DRIVER_NODE)) for ankle in ankles}
        client.wait_until(lambda: all_reported(_inside(namespace, ankles, health), drivers), _LATEST_S)
        shown = _inside(namespace, ankles, health)
    return {ankle: jam_status(states[ankle]) for ankle in ankles}, tuple(shown[name] for name in sorted(shown))


def _inside(namespace: str, ankles: Sequence[str], health: Mapping[str, HealthStatus]) -> dict[str, HealthStatus]:
    """Return the lines of the nodes of these ankles, and of a robot's, which are in the namespace above."""
    places = {"", *ankles}
    nodes = {name: relative(namespace, name.partition(":")[0]) for name in health}
    return {
        name: health[name] for name, node in nodes.items() if node is not None and node.rpartition("/")[0] in places
    }


def _path(ankle: str, name: str) -> str:
    """Return a name of an ankle as seen from the graph's namespace."""
    return f"{ankle}/{name}" if ankle else name


def all_reported(health: Mapping[str, HealthStatus], drivers: Collection[str]) -> bool:
    """Return whether there is a report of each driver, and of every node that another one receives reports of.

    Each node lists those in its line `nodes`, with how long each has been silent. Who is missed there already is not
    waited for: it is dead, and the line says so.

    Args:
        health: Lines so far, by name.
        drivers: Full names of the drivers.

    """
    seen = {name.partition(":")[0] for name in health}
    if not seen.issuperset(drivers):
        return False
    for name, line in health.items():
        if not name.endswith(LIVENESS_LINE):
            continue
        place = name.rpartition("/")[0]
        for key, silent_s in line.values.items():
            node = key.removesuffix(SILENT_FOR)
            full = node if node.startswith("/") else f"{place}/{node}"
            if key.endswith(SILENT_FOR) and float(silent_s) <= MISSED_AFTER_S and full not in seen:
                return False
    return True
