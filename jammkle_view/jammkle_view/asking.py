"""Carries out what was asked for on the page, by the graph's own services, topics and parameters."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from std_msgs.msg import Bool
from std_srvs.srv import SetBool, Trigger

from jammkle_common import names
from jammkle_common.qos import publisher_qos
from jammkle_msgs.srv import Jam as JamService
from jammkle_msgs.srv import Unjam as UnjamService
from jammkle_view.core.wishes import Action, Ask, Jam, SetSim, Unjam

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.client import Client
    from rclpy.node import Node
    from rclpy.publisher import Publisher

    from jammkle_view.core.wishes import Wish

    Answer = Callable[[str, bool], None]
    """Takes what a node said, and whether it did what was asked."""

SPEED = "speed"
"""Parameter of the simulation that whoever started it may have chosen."""
_GET_PARAMETERS = f"{names.SIM_NODE}/get_parameters"
_SET_PARAMETERS = f"{names.SIM_NODE}/set_parameters"
_REQUESTS: dict[Action, tuple[str, Any, Any]] = {
    Action.TELL_SPEED: (_GET_PARAMETERS, GetParameters, GetParameters.Request(names=[SPEED])),
    Action.CLEAR_FAULT: (names.CLEAR_FAULT.path, Trigger, Trigger.Request()),
    Action.RESET: (names.RESET.path, Trigger, Trigger.Request()),
    Action.PAUSE: (names.SET_PAUSED.path, SetBool, SetBool.Request(data=True)),
    Action.GO_ON: (names.SET_PAUSED.path, SetBool, SetBool.Request(data=False)),
    Action.AUTO_ON: (names.SET_AUTO.path, SetBool, SetBool.Request(data=True)),
    Action.AUTO_OFF: (names.SET_AUTO.path, SetBool, SetBool.Request(data=False)),
}
"""Service, its type and what is asked."""
_PATIENCE_S = 2.0
"""How long a request waits for its service. Assumed; discovery on one machine takes about 0.3 s."""


@dataclass(frozen=True)
class _Waiting:
    """A request that waits for its service to be found."""

    path: str
    client: Client
    request: Any
    said: str
    until_s: float
    persistent: bool = False
    """Whether it is sent again while it is refused: what it needs was published just before."""


class Asking:
    """Clients of the services that the page needs, each made when it is first needed."""

    def __init__(self, node: Node, answer: Answer, take_speed: Callable[[float], None]) -> None:
        """Ask nothing yet.

        Args:
            node: In whose namespace the ankles are.
            answer: Told what comes back.
            take_speed: Told the speed of the simulation, where that was asked for.

        """
        self._node, self._answer, self._take_speed = node, answer, take_speed
        self._clients: dict[str, Client] = {}
        self._stops: dict[str, Publisher] = {}
        self._waiting: list[_Waiting] = []

    def go_on(self) -> None:
        """Send what waits for a service that was found by now; to be called again and again."""
        waiting, self._waiting = self._waiting, []
        for each in waiting:
            if each.client.service_is_ready():
                each.client.call_async(each.request).add_done_callback(
                    lambda future, each=each: self._take(future.result(), each)
                )
            elif time.monotonic() < each.until_s:
                self._waiting.append(each)
            else:
                self._answer(f"{each.path} is not there", False)  # noqa: FBT003 - as every answer

    def carry_out(self, wish: Wish) -> None:
        """Have a request sent by `go_on`; the answer comes later."""
        match wish:
            case Jam(channels=channels, vacuum_pa=vacuum_pa):
                channels = channels or names.CHANNELS
                request = JamService.Request(channels=list(channels), vacuum_pa=vacuum_pa)
                self._call(wish.ankle, names.JAM.path, JamService, request)
            case Unjam(channels=channels):
                request = UnjamService.Request(channels=list(channels or names.CHANNELS))
                self._call(wish.ankle, names.UNJAM.path, UnjamService, request)
            case SetSim(name=name, value=value):
                number = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)
                request = SetParameters.Request(parameters=[Parameter(name=name, value=number)])
                self._call(wish.ankle, _SET_PARAMETERS, SetParameters, request, f"{name} is {value:g}")
            case Ask(action=Action.EMERGENCY_STOP):
                self._stop(wish.ankle, stop=True)
                self._answer("emergency stop sent", True)  # noqa: FBT003 - as every answer
            case Ask(action=action):
                if action is Action.CLEAR_FAULT and wish.ankle in self._stops:
                    self._stop(wish.ankle, stop=False)
                self._call(wish.ankle, *_REQUESTS[action], persistent=action is Action.CLEAR_FAULT)

    def _call(
        self, ankle: str, path: str, kind: Any, request: Any, said: str = "", *, persistent: bool = False
    ) -> None:
        name = f"{ankle}/{path}" if ankle else path
        if name not in self._clients:
            self._clients[name] = self._node.create_client(kind, name)
        until_s = time.monotonic() + _PATIENCE_S
        self._waiting.append(_Waiting(path, self._clients[name], request, said, until_s, persistent))

    def _take(self, response: Any, asked: _Waiting) -> None:
        if response is None:
            return
        if asked.persistent and not response.success and time.monotonic() < asked.until_s:
            self._waiting.append(asked)
            return
        if isinstance(response, GetParameters.Response):
            for value in response.values:
                self._take_speed(float(value.double_value))
            return
        for each in getattr(response, "results", ()):  # of set_parameters: one for each, the first says it all
            self._answer(asked.said if each.successful else each.reason, bool(each.successful))
            return
        self._answer(response.message, bool(response.success))

    def _stop(self, ankle: str, *, stop: bool) -> None:
        topic = names.EMERGENCY_STOP
        if ankle not in self._stops:
            name = f"{ankle}/{topic.name}" if ankle else topic.name
            self._stops[ankle] = self._node.create_publisher(Bool, name, publisher_qos(topic))
        self._stops[ankle].publish(Bool(data=stop))
