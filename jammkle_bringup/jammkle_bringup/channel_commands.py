"""`jammkle jam`, `jammkle unjam` and `jammkle status`: clients of a running graph."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import GetParameters

from jammkle_bringup.conversions import HealthStatus, JamStatus, health_status, jam_status, pa_from_kpa
from jammkle_bringup.graph_client import ANSWER_TIMEOUT_S, GraphClient, no_answer
from jammkle_graph.command.errors import GraphError, InputError
from jammkle_graph.names import CHANNELS, DIAGNOSTICS, DRIVER_NODE, JAM, JAM_STATE, UNJAM
from jammkle_graph.namespace import relative, resolved
from jammkle_graph.qos import subscriber_qos
from jammkle_graph.roll_call import ROLL_CALL_LINE, SILENT_FOR
from jammkle_msgs.msg import JamState
from jammkle_msgs.srv import Jam, Unjam

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

_MAX_VACUUM = "max_vacuum_pa"
_PA_PER_KPA = 1e3
_HEALTH_S = 1.3  # every node reports once a second
_LATEST_S = 6.0
"""How long a node is waited for that others have heard, s: some are discovered only with the next announcement, which
the DDS of ROS 2 (Fast DDS) sends every 3 s."""


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
        ankles = client.ankles()
        places = {"", *ankles}  # a robot's simulation is in the namespace above its ankles

        def take_health(array: DiagnosticArray) -> None:
            for line in health_status(array):
                inside = relative(namespace, line.name.partition(":")[0])
                if inside is not None and inside.rpartition("/")[0] in places:
                    health[line.name] = line

        def taking(ankle: str) -> Callable[[JamState], None]:
            return lambda state: states.update({ankle: state})

        for ankle in ankles:
            name = resolved(namespace, _path(ankle, JAM_STATE.name))
            client.node.create_subscription(JamState, name, taking(ankle), subscriber_qos(JAM_STATE))
        client.subscribe(DiagnosticArray, DIAGNOSTICS, take_health, subscriber_qos(DIAGNOSTICS))
        if not client.wait_until(lambda: len(states) == len(ankles), ANSWER_TIMEOUT_S):
            silent = next(ankle for ankle in ankles if ankle not in states)
            raise GraphError(no_answer(_path(silent, JAM_STATE.name), namespace, ANSWER_TIMEOUT_S))
        client.wait_until(lambda: False, _HEALTH_S)
        client.wait_until(lambda: not _unheard(health.values()), _LATEST_S - _HEALTH_S)
    return {ankle: jam_status(states[ankle]) for ankle in ankles}, tuple(health[name] for name in sorted(health))


def _path(ankle: str, name: str) -> str:
    """Return a name of an ankle as seen from the graph's namespace."""
    return f"{ankle}/{name}" if ankle else name


def _unheard(health: Iterable[HealthStatus]) -> set[str]:
    """Return nodes that others have heard lately and we have not; each node tells in its line `nodes` whom it hears."""
    lines = list(health)
    heard = {line.name.partition(":")[0] for line in lines}
    known: set[str] = set()
    for line in lines:
        if line.name.endswith(ROLL_CALL_LINE):
            place = line.name.rpartition("/")[0]
            names = [key.removesuffix(SILENT_FOR) for key in line.values if key.endswith(SILENT_FOR)]
            known |= {name if name.startswith("/") else f"{place}/{name}" for name in names}
    return known - heard
