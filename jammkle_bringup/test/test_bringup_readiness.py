"""Waiting for a graph that starts: what is missing is named, a death ends the wait, and so does a request to stop."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from std_srvs.srv import Trigger

from jammkle_bringup import up
from jammkle_bringup.core.supervisor import ChildSpec, Supervisor
from jammkle_bringup.graph_client import GraphClient
from jammkle_bringup.up import Startup
from jammkle_common.command.errors import GraphError, Interrupted
from jammkle_common.diagnostics import LIVENESS_LINE, SILENT_FOR
from jammkle_common.messages import LOCKSTEP_LINE
from jammkle_common.names import CONTROLLER_NODE, DRIVER_NODE, IMU, SIM_NODE

if TYPE_CHECKING:
    from collections.abc import Callable

SLEEPING = ChildSpec("sim", (sys.executable, "-c", "import time; time.sleep(600)"))
DYING = ChildSpec("sim", (sys.executable, "-c", "import sys; sys.exit('no more air')"))


def wait(spec: ChildSpec, asked_to_stop: Callable[[], bool] = lambda: False) -> None:
    """Wait for a graph whose only process is not a node at all."""
    with (
        Supervisor([spec], lambda *_: None) as supervisor,
        GraphClient("/", asked_to_stop) as client,
    ):
        Startup(client, supervisor, "; see the log").wait_until_connected({SIM_NODE, CONTROLLER_NODE})


@pytest.mark.parametrize(
    ("there", "said"),
    [
        ((), "start the graph with `jammkle up`"),
        (("controller", "driver"), "/driver is on the graph, but was killed, or is not configured: start it anew"),
        (("controller", "sim"), "/controller and /sim run without a driver: start one"),
    ],
)
def test_who_is_there_without_a_driver_is_named(ros_domain: int, there: tuple[str, ...], said: str) -> None:
    """A driver that was cleaned up or killed is no reason to look for a whole graph in another domain."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=ros_domain, signal_handler_options=SignalHandlerOptions.NO)
    nodes = [rclpy.create_node(name, context=context) for name in there]
    with GraphClient("/", lambda: False) as client, pytest.raises(GraphError, match=said):
        client.ankles()
    for node in nodes:
        node.destroy_node()
    rclpy.shutdown(context=context)


@pytest.mark.usefixtures("ros_domain")
def test_what_is_missing_is_named_when_the_time_is_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """The line names nodes, topics and the time, speaks only of nodes that were started, and ends with the hint."""
    monkeypatch.setattr(up, "READY_TIMEOUT_S", 0.3)
    with pytest.raises(GraphError, match=r"not ready after 0\.3 s, missing: .*; see the log$") as caught:
        wait(SLEEPING)
    assert f"{SIM_NODE} ({IMU.name})" in str(caught.value)
    assert f"{CONTROLLER_NODE} ({IMU.name})" in str(caught.value)
    assert DRIVER_NODE not in str(caught.value)


@pytest.mark.usefixtures("ros_domain")
def test_a_death_ends_the_wait() -> None:
    """Who died is said, long before the time is up."""
    with pytest.raises(GraphError, match="sim died with exit code 1; it said: no more air; see the log"):
        wait(DYING)


@pytest.mark.usefixtures("ros_domain")
def test_a_driver_that_could_not_be_configured_is_not_waited_for() -> None:
    """It answers, and is not active: nothing more will come of it."""
    idle = ChildSpec("driver", (sys.executable, "-m", "jammkle_driver", "--ros-args", "-p", "autostart:=false"))
    with Supervisor([idle], lambda *_: None) as supervisor, GraphClient("/", lambda: False) as client:
        startup = Startup(client, supervisor)
        with pytest.raises(GraphError, match=r"driver is not active \(lifecycle state 1\)"):
            startup.wait_until_active()


@pytest.mark.usefixtures("ros_domain")
def test_a_request_to_stop_ends_the_wait() -> None:
    """Ctrl-C need not wait for nodes that never come."""
    end_s = time.monotonic() + 0.3
    with pytest.raises(Interrupted):
        wait(SLEEPING, lambda: time.monotonic() > end_s)


class Reports:
    """A client that receives one report in each round of a wait, and a supervisor under whom nobody dies."""

    namespace = "/"

    def __init__(self, *reports: DiagnosticStatus) -> None:
        self.left = list(reports)
        self.take: Callable[[DiagnosticArray], None] = lambda _: None

    def subscribe(self, _kind: object, _topic: object, take: Callable[[DiagnosticArray], None], _qos: object) -> None:
        self.take = take

    def wait_until(self, predicate: Callable[[], bool], _timeout_s: float) -> bool:
        while not predicate():
            if not self.left:
                return False
            self.take(DiagnosticArray(status=[self.left.pop(0)]))
        return True

    def first_death(self) -> None:
        return None


def nodes_line(node: str, *received: str) -> DiagnosticStatus:
    """Return the report of a node that receives those of some others."""
    return DiagnosticStatus(
        name=f"{node}{LIVENESS_LINE}", values=[KeyValue(key=f"{each}{SILENT_FOR}", value="0.1") for each in received]
    )


IN_STEP = ("/driver", "/controller", "/recorder")
ALL_ANSWER = DiagnosticStatus(name=f"/sim{LOCKSTEP_LINE}", values=[KeyValue(key=name) for name in IN_STEP])


def test_time_begins_once_all_know_one_another(monkeypatch: pytest.MonkeyPatch) -> None:
    """That the simulation knows them is not enough: who has not found the recorder yet is not in the bag."""
    monkeypatch.setattr(up, "READY_TIMEOUT_S", 1.0)
    members = [name.removeprefix("/") for name in IN_STEP]
    first = (ALL_ANSWER, nodes_line("/recorder", "driver", "sim"), nodes_line("/driver", "sim", "controller"))
    short = Reports(*first)
    with pytest.raises(GraphError, match=r"after 1 s: /controller and /recorder to find each other$"):
        Startup(short, short).wait_until_in_step(members)  # type: ignore[arg-type]
    whole = Reports(*first, nodes_line("/controller", "recorder"), nodes_line("/controller"))
    Startup(whole, whole).wait_until_in_step(members)  # type: ignore[arg-type]
    assert len(whole.left) == 1


def test_ankles_of_a_robot_need_not_know_one_another(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each knows its own nodes and the recorder, by names relative to the namespace that they stand in."""
    monkeypatch.setattr(up, "READY_TIMEOUT_S", 1.0)
    members = ["recorder", *(f"{ankle}/{node}" for ankle in ("lf", "rf") for node in (DRIVER_NODE, CONTROLLER_NODE))]
    ready = Reports(
        DiagnosticStatus(name=f"/sim{LOCKSTEP_LINE}", values=[KeyValue(key=f"/{name}") for name in members]),
        nodes_line("/recorder", *members[1:]),
        nodes_line("/lf/driver", "controller", "/sim"),
        nodes_line("/rf/controller", "driver", "/sim"),
    )
    Startup(ready, ready).wait_until_in_step(members)  # type: ignore[arg-type]
    assert not ready.left


class Lossy:
    """A client of a service that loses this many answers."""

    def __init__(self, lost: int) -> None:
        self.lost = lost
        self.requests: list[object] = []

    def service_is_ready(self) -> bool:
        return True

    def call_async(self, request: object) -> Future:
        self.requests.append(request)
        future = Future()
        if len(self.requests) > self.lost:
            future.set_result("answered")
        return future


@pytest.mark.usefixtures("ros_domain")
@pytest.mark.parametrize("lost", [0, 1])
def test_an_answer_that_is_lost_is_asked_for_again(lost: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where a service has not found the client's end for answers when it answers."""
    lossy = Lossy(lost)
    with GraphClient("/", lambda: False) as client:
        monkeypatch.setattr(client.node, "create_client", lambda *_: lossy)
        monkeypatch.setattr(client.node, "destroy_client", lambda _: None)
        assert client.call("often", Trigger, Trigger.Request()) == "answered"
    assert len(lossy.requests) == lost + 1


@pytest.mark.usefixtures("ros_domain")
def test_a_service_that_never_answers_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """After the time that was given, in a line that names it."""
    with GraphClient("/", lambda: False) as client:
        monkeypatch.setattr(client.node, "create_client", lambda *_: Lossy(100))
        monkeypatch.setattr(client.node, "destroy_client", lambda _: None)
        with pytest.raises(GraphError, match=r"/never did not answer within 0\.2 s"):
            client.call("never", Trigger, Trigger.Request(), timeout_s=0.2)
