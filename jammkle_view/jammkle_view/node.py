"""The viewer's node: shows the graph of its namespace on a page, and hands on what is clicked there."""

from __future__ import annotations

import queue
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.node import Node
from std_msgs.msg import Bool
from std_srvs.srv import SetBool, Trigger

from jammkle_common import names
from jammkle_common.command.errors import InputError
from jammkle_common.diagnostics import Liveness
from jammkle_common.messages import Level, message_class
from jammkle_common.names import normalised
from jammkle_common.parameters import ParameterError, declare
from jammkle_common.qos import newest_qos, publisher_qos, subscriber_qos
from jammkle_msgs.srv import Jam as JamService
from jammkle_msgs.srv import Unjam as UnjamService
from jammkle_sim.core.engine import RealTimeFactor
from jammkle_view.core.ankle import Ankle
from jammkle_view.core.samples import TAKERS, Action, Ask, Jam, SetSim, Unjam
from jammkle_view.page.live import LivePage
from jammkle_view.page.server import address_of, is_watched, serve
from jammkle_view.parameters import ViewerParameters

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.client import Client
    from rclpy.executors import Executor
    from rclpy.publisher import Publisher
    from rclpy.subscription import Subscription

    from jammkle_common.names import Topic
    from jammkle_common.runner import StopFlag
    from jammkle_view.core.samples import Request

    Answer = Callable[[str, bool], None]
    "Takes what a node said, and whether it did what was asked."

_WATCHER = f"_{names.VIEWER_NODE}_samples"
"""Node that nobody spins; ROS hides names with an underscore in front."""


_SELDOM = (names.JAM_STATE, names.CONTACT_EVENTS, names.LANDING, names.SIM_PARAMETERS)
_SHOWN = (names.JOINT_STATES, names.TENDON_STATES)
_PLOTTED = (*names.PRESSURES.values(), names.MANIFOLD_PRESSURE)
_IMU_DEPTH = 100
"""A tenth of a second at 1 kHz: three frames, of which every sample is plotted, as an impact lasts a few alone."""


class AnkleSubscriptions:
    """Subscriptions to one ankle's topics, and who takes their messages."""

    def __init__(self, node: Node, watcher: Node, namespace: str, ankle: Ankle, *, with_base: bool) -> None:
        """Subscribe for an ankle in a namespace below both nodes' own; empty: in that.

        Args:
            node: Whose executor serves what is seldom.
            watcher: A node without executor: its messages call nobody.
            namespace: Of the ankle.
            ankle: Who takes the messages.
            with_base: Whether to subscribe to where the whole is, too; one of several ankles will do.

        """
        self._ankle = ankle
        self._watcher, self._within = watcher, namespace
        seldom = [(namespace, topic) for topic in _SELDOM]
        if namespace:  # one simulation of several ankles publishes above them
            seldom.append(("", names.SIM_PARAMETERS))
        for within, topic in seldom:
            make = TAKERS[topic.name]
            node.create_subscription(
                message_class(topic.message_type),
                names.below(within, topic),
                lambda message, make=make: ankle.take(make(message)),
                subscriber_qos(topic),
            )
        self._shown = [(topic.name, self._watch(namespace, topic, 1)) for topic in _SHOWN]
        if with_base:
            self._shown.append((names.ODOMETRY.name, self._watch("", names.ODOMETRY, 1)))
        self._plotted: list[tuple[str, Subscription]] = []
        self._imu: Subscription | None = None

    def look(self) -> None:
        """Take the newest of every measurement; of an IMU that is plotted all since the last look."""
        for topic, subscription in (*self._shown, *self._plotted):
            self._take(topic, subscription)
        if self._imu is not None:
            for _ in range(_IMU_DEPTH):
                if not self._take(names.IMU.name, self._imu):
                    break

    def plot(self, *, wanted: bool) -> None:
        """Subscribe to what is only plotted, or cease to."""
        if wanted and self._imu is None:
            self._imu = self._watch(self._within, names.IMU, _IMU_DEPTH)
            self._plotted = [(topic.name, self._watch(self._within, topic, 1)) for topic in _PLOTTED]
        elif not wanted and self._imu is not None:
            for subscription in (self._imu, *(subscription for _, subscription in self._plotted)):
                self._watcher.destroy_subscription(subscription)
            self._plotted, self._imu = [], None

    def _take(self, topic: str, subscription: Subscription) -> bool:
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
        if taken is None:
            return False
        self._ankle.take(TAKERS[topic](taken[0]))
        return True

    def _watch(self, within: str, topic: Topic, depth: int) -> Subscription:
        kind, name = message_class(topic.message_type), names.below(within, topic)
        return self._watcher.create_subscription(kind, name, _nobody, newest_qos(depth))


def _nobody(_message: object) -> None:
    """Stand where rclpy wants a callback; never called."""


SPEED = "speed"
"""Parameter of the simulation that whoever started it may have chosen."""
_GET_PARAMETERS = f"{names.SIM_NODE}/get_parameters"
_SET_PARAMETERS = f"{names.SIM_NODE}/set_parameters"
_REQUESTS: dict[Action, tuple[str, Any, Any]] = {
    Action.READ_SPEED: (_GET_PARAMETERS, GetParameters, GetParameters.Request(names=[SPEED])),
    Action.CLEAR_FAULT: (names.CLEAR_FAULT.path, Trigger, Trigger.Request()),
    Action.RESET: (names.RESET.path, Trigger, Trigger.Request()),
    Action.PAUSE: (names.SET_PAUSED.path, SetBool, SetBool.Request(data=True)),
    Action.GO_ON: (names.SET_PAUSED.path, SetBool, SetBool.Request(data=False)),
    Action.AUTO_ON: (names.SET_AUTO.path, SetBool, SetBool.Request(data=True)),
    Action.AUTO_OFF: (names.SET_AUTO.path, SetBool, SetBool.Request(data=False)),
}
"""Service, its type and what is asked."""
_FACTOR_FROM_S = 1.0
"""Real time from which on a real-time factor is shown. Assumed: steady to look at, and soon right after a change."""
_PATIENCE_S = 2.0
"""How long a request waits for its service. Assumed; discovery on one machine takes about 0.3 s."""


@dataclass(frozen=True)
class _Waiting:
    path: str
    client: Client
    request: Any
    said: str
    until_s: float
    persistent: bool = False
    """Whether it is sent again while it is refused: what it needs was published just before."""


class Requests:
    """Clients of the services that the page needs, each made when it is first needed."""

    def __init__(self, node: Node, answer: Answer, take_speed: Callable[[float], None]) -> None:
        """Ask nothing yet of the ankles in the namespace of a node; take answers, and the speed where that was read."""
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

    def carry_out(self, asked: Request) -> None:
        """Have a request sent by `go_on`; the answer comes later."""
        match asked:
            case Jam(channels=channels, vacuum_pa=vacuum_pa):
                channels = channels or names.CHANNELS
                request = JamService.Request(channels=list(channels), vacuum_pa=vacuum_pa)
                self._call(asked.ankle, names.JAM.path, JamService, request)
            case Unjam(channels=channels):
                request = UnjamService.Request(channels=list(channels or names.CHANNELS))
                self._call(asked.ankle, names.UNJAM.path, UnjamService, request)
            case SetSim(name=name, value=value):
                number = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)
                request = SetParameters.Request(parameters=[Parameter(name=name, value=number)])
                self._call(asked.ankle, _SET_PARAMETERS, SetParameters, request, f"{name} is {value:g}")
            case Ask(action=Action.EMERGENCY_STOP):
                self._stop(asked.ankle, stop=True)
                self._answer("emergency stop sent", True)  # noqa: FBT003 - as every answer
            case Ask(action=action):
                if action is Action.CLEAR_FAULT and asked.ankle in self._stops:
                    self._stop(asked.ankle, stop=False)
                self._call(asked.ankle, *_REQUESTS[action], persistent=action is Action.CLEAR_FAULT)

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
            self._stops[ankle] = self._node.create_publisher(Bool, names.below(ankle, topic), publisher_qos(topic))
        self._stops[ankle].publish(Bool(data=stop))


class ViewerNode(Node):
    """Shows the ankles of its namespace. `drive` drives it: frame by frame, callbacks in between."""

    def __init__(self) -> None:
        """Make the node and open the page.

        Raises:
            ParameterError: an unknown parameter, a value out of range, or a port that is taken.

        """
        super().__init__(names.VIEWER_NODE, automatically_declare_parameters_from_overrides=True)
        values = declare(self, ViewerParameters)
        self._frame_s = 1.0 / values.frame_rate_hz
        self._known = {name: Ankle() for name in _ankles(values.ankles)}
        self._factor = RealTimeFactor(_FACTOR_FROM_S)
        self._requested: queue.SimpleQueue[Request] = queue.SimpleQueue()
        try:
            self._server = serve(values.host, values.port, "Jammkle")
        except InputError as error:
            raise ParameterError(str(error)) from error
        self._page = LivePage(self._server, tuple(self._known), self._requested.put)
        self._requests = Requests(self, lambda text, good: self._page.answer(text, good=good), self._page.show_speed)
        self._watcher = Node(
            _WATCHER, namespace=self.get_namespace(), enable_rosout=False, start_parameter_services=False
        )
        self._inputs = {
            name: AnkleSubscriptions(self, self._watcher, name, ankle, with_base=place == 0)
            for place, (name, ankle) in enumerate(self._known.items())
        }
        self._liveness = Liveness(self, ankles=None)
        self._seen: frozenset[str] = frozenset()
        self._said_of_nodes = ""
        self.get_logger().info(f"page: {address_of(self._server)}")

    def drive(self, executor: Executor, stop: StopFlag) -> None:
        """Run until asked to stop."""
        due_s = time.monotonic()
        while not stop:
            left_s = due_s - time.monotonic()
            if left_s > 0.0:
                executor.spin_once(timeout_sec=left_s)
                continue
            executor.spin_once(timeout_sec=0.0)
            self._frame()
            due_s = max(due_s + self._frame_s, time.monotonic())

    def shut_down(self) -> None:
        """Close the page."""
        self._server.stop()

    def destroy_node(self) -> None:
        """Leave the graph."""
        self._watcher.destroy_node()
        super().destroy_node()

    def _frame(self) -> None:
        """Look at what is new, do what was clicked, and show it where somebody looks."""
        now_s = time.monotonic()
        for name, subscriptions in self._inputs.items():
            subscriptions.plot(wanted=name == self._page.chosen)
            subscriptions.look()
        self._look_at_nodes()
        while not self._requested.empty():
            self._requests.carry_out(self._requested.get())
        self._requests.go_on()
        self._factor.note(next(iter(self._known.values())).time_s, now_s)
        if is_watched(self._server):
            self._page.show(self._known, self._factor.value(), now_s)

    def _look_at_nodes(self) -> None:
        """Say who is dead. Of the channels of a driver that is dead or has left nothing is known any more."""
        alive = self._liveness.alive()
        self._seen |= alive
        for name, ankle in self._known.items():
            if (f"{name}/{names.DRIVER_NODE}" if name else names.DRIVER_NODE) in self._seen - alive:
                ankle.lose_driver()
        health = self._liveness.health()
        said = "" if health.level is Level.OK else health.message
        if said != self._said_of_nodes:
            self._said_of_nodes = said
            self._page.answer(health.message, good=not said)


def _ankles(given: str) -> tuple[str, ...]:
    """Return relative namespaces from a text that parts them by commas; the viewer's own is the empty one.

    Raises:
        ParameterError: one of them is no ROS name.

    """
    try:
        return tuple(normalised(each).lstrip("/") for each in given.split(","))
    except InputError as error:
        msg = f"parameter 'ankles': {error}"
        raise ParameterError(msg) from error
