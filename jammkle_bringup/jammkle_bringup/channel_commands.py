"""`jammkle jam`, `jammkle unjam` and `jammkle status`: clients of a running graph."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import GetParameters

from jammkle_bringup.conversions import HealthStatus, JamStatus, health_status, jam_status, pa_from_kpa
from jammkle_bringup.graph_client import ANSWER_TIMEOUT_S, GraphClient, no_answer
from jammkle_graph.command.errors import GraphError, InputError
from jammkle_graph.names import CHANNELS, DIAGNOSTICS, DRIVER_NODE, JAM, JAM_STATE, UNJAM
from jammkle_graph.qos import subscriber_qos
from jammkle_graph.roll_call import ROLL_CALL_LINE, SILENT_FOR
from jammkle_msgs.msg import JamState
from jammkle_msgs.srv import Jam, Unjam

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

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


def jam(namespace: str, channels: Sequence[str], vacuum_kpa: float, asked_to_stop: Callable[[], bool]) -> Answer:
    """Ask the driver to jam channels; none means all.

    Raises:
        InputError: an unknown channel, or a vacuum beyond the driver's limit.
        GraphError: no driver answers.

    """
    check_channels(channels)
    check_vacuum(vacuum_kpa)
    with GraphClient(namespace, asked_to_stop) as client:
        request = GetParameters.Request(names=[_MAX_VACUUM])
        values = client.call_path(f"{DRIVER_NODE}/get_parameters", GetParameters, request).values
        largest_pa = values[0].double_value if values else math.inf
        if pa_from_kpa(vacuum_kpa) > largest_pa:
            limit = f"the driver's {_MAX_VACUUM} of {largest_pa / _PA_PER_KPA:g} kPa"
            msg = f"--vacuum-kpa {vacuum_kpa:g} is beyond {limit}: ask for less"
            raise InputError(msg)
        wish = Jam.Request(channels=list(channels), vacuum_pa=pa_from_kpa(vacuum_kpa))
        answer = client.call(JAM, Jam, wish)
    return Answer(answer.success, answer.message, tuple(channels) or CHANNELS, vacuum_kpa)


def unjam(namespace: str, channels: Sequence[str], asked_to_stop: Callable[[], bool]) -> Answer:
    """Ask the driver to vent channels; none means all.

    Raises:
        InputError: an unknown channel.
        GraphError: no driver answers.

    """
    check_channels(channels)
    with GraphClient(namespace, asked_to_stop) as client:
        answer = client.call(UNJAM, Unjam, Unjam.Request(channels=list(channels)))
    return Answer(answer.success, answer.message, tuple(channels) or CHANNELS, 0.0)


def status(namespace: str, asked_to_stop: Callable[[], bool]) -> tuple[JamStatus, tuple[HealthStatus, ...]]:
    """Return what the driver says of its channels, and what every node of the namespace says of its health.

    Raises:
        GraphError: no driver is heard.

    """
    states: list[JamState] = []
    health: dict[str, HealthStatus] = {}

    def take_health(array: DiagnosticArray) -> None:
        prefix = f"{namespace.rstrip('/')}/"
        for line in health_status(array):
            inside = line.name.removeprefix(prefix).partition(":")[0]
            if line.name.startswith(prefix) and "/" not in inside:
                health[line.name] = line

    with GraphClient(namespace, asked_to_stop) as client:
        client.subscribe(JamState, JAM_STATE, states.append, subscriber_qos(JAM_STATE))
        client.subscribe(DiagnosticArray, DIAGNOSTICS, take_health, subscriber_qos(DIAGNOSTICS))
        if not client.wait_until(lambda: bool(states), ANSWER_TIMEOUT_S):
            raise GraphError(no_answer(JAM_STATE.name, namespace, ANSWER_TIMEOUT_S))
        client.wait_until(lambda: False, _HEALTH_S)
        client.wait_until(lambda: not _unheard(health.values()), _LATEST_S - _HEALTH_S)
    return jam_status(states[-1]), tuple(health[name] for name in sorted(health))


def _unheard(health: Iterable[HealthStatus]) -> set[str]:
    """Return nodes that others have heard lately and we have not; each node tells in its line `nodes` whom it hears."""
    lines = list(health)
    heard = {line.name.rpartition("/")[2].partition(":")[0] for line in lines}
    known: set[str] = set()
    for line in lines:
        if line.name.endswith(ROLL_CALL_LINE):
            known |= {key.removesuffix(SILENT_FOR) for key in line.values if key.endswith(SILENT_FOR)}
    return known - heard
