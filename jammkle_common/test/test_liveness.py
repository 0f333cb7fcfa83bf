"""A node whose reports stop is missed, one that was stopped in order is not, and who stood still blames nobody."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import serialize_message

from jammkle_common.diagnostics import CLOCK_MISSED_AFTER_S, FAREWELL, Liveness, reporting
from jammkle_common.messages import Level


class FakeNode:
    """A node of which nothing but its name and its one subscription is used."""

    def __init__(self, namespace: str, name: str) -> None:
        self.namespace = namespace
        self.name = name
        self.take: Any = None

    def get_namespace(self) -> str:
        return self.namespace

    def get_name(self) -> str:
        return self.name

    def create_subscription(self, _kind: object, _topic: str, take: Any, _qos: object, *, raw: bool) -> None:
        assert raw
        self.take = take


class Listener:
    """Liveness with a clock of its own."""

    def __init__(self, namespace: str, name: str = "driver", ankles: tuple[str, ...] | None = ()) -> None:
        self.now_s = 100.0
        self.node = FakeNode(namespace, name)
        self.liveness = Liveness(self.node, ankles, lambda: self.now_s)

    def receive(self, *names: str) -> None:
        self.node.take(serialize_message(DiagnosticArray(status=[DiagnosticStatus(name=name) for name in names])))

    def wait(self, seconds: float) -> Any:
        """Let time pass while the listener reports once a second."""
        for _ in range(round(seconds)):
            self.now_s += 1.0
            health = self.liveness.health()
        return health


@pytest.mark.parametrize(("namespace", "prefix"), [("/", "/"), ("/lf_ankle", "/lf_ankle/")])
def test_a_silent_node_is_missed_with_what_it_means(namespace: str, prefix: str) -> None:
    """Two reports that do not come make a node dead; another ankle's nodes and one's own are nobody's to miss."""
    listener = Listener(namespace)
    listener.receive(f"{prefix}controller: policy", f"{prefix}driver: link", "/rf_ankle/sim: rig", f"{prefix}sim: rig")
    assert listener.liveness.health().level is Level.OK
    listener.wait(2)
    listener.receive(f"{prefix}sim: rig")
    health = listener.wait(2)
    assert health.level is Level.ERROR
    assert "controller is dead" in health.message
    assert "command_timeout_s" in health.message
    assert "sim" not in health.message.partition(":")[0]
    listener.receive(f"{prefix}controller: policy")
    assert listener.liveness.health().level is Level.OK


def test_an_ankle_of_a_robot_misses_the_simulation_above_it() -> None:
    """Once that has named the ankle in its report; a simulation that has not is another robot's."""
    listener = Listener("/lf_ankle")
    listener.receive("/sim: simulation", "/sim: rf_ankle tendons", "/rf_ankle/driver: link")
    assert listener.wait(5).level is Level.OK
    listener.receive("/sim: simulation", "/sim: lf_ankle tendons")
    health = listener.wait(4)
    assert health.level is Level.ERROR
    assert health.message.startswith("/sim is dead or hangs: there is no ankle any more")
    assert float(health.values["/sim, silent for (s)"]) == pytest.approx(4.0)
    listener.receive(f"/sim{FAREWELL}")
    assert listener.wait(4).level is Level.OK


def test_a_simulation_misses_the_nodes_of_its_ankles() -> None:
    """By ankle and node; those of an ankle that it does not simulate, such as a real one, are not its own."""
    listener = Listener("/", "sim", ("lf_ankle", "rf_ankle"))
    listener.receive("/lf_ankle/driver: link", "/rf_ankle/driver: link", "/real_ankle/driver: link")
    listener.wait(2)
    listener.receive("/rf_ankle/driver: link")
    health = listener.wait(2)
    assert health.level is Level.ERROR
    assert health.message.startswith("lf_ankle/driver is dead or hangs: nobody drives pump and solenoids")
    assert "rf_ankle" not in health.message
    assert "real_ankle" not in "".join(health.values)


def test_a_clock_that_stands_is_not_taken_for_a_lost_ankle(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its maker may be the simulation of another namespace: the one at hand follows, and its ankle is there."""
    listener = Listener("/lf_ankle")
    standing = SimpleNamespace(clock_silent_s=CLOCK_MISSED_AFTER_S + 1.0, knows_time=False)
    monkeypatch.setattr(listener.liveness, "_node", standing)
    health = listener.liveness.health()
    assert health.level is Level.ERROR
    assert health.message.startswith("/clock has not ticked for 6 s of real time: who makes it is dead or hangs.")
    assert "no ankle" not in health.message


def test_a_recorder_knows_every_ankle_and_is_missed_with_a_warning() -> None:
    """It records all of a namespace; without it the ankle does all that it did."""
    recorder = Listener("/", "recorder", None)
    recorder.receive("/lf_ankle/driver: link", "/sim: rig")
    assert set(reporting("/recorder: nodes", recorder.wait(1).values)) == {"/lf_ankle/driver", "/sim"}
    listener = Listener("/")
    listener.receive("/recorder: recording")
    health = listener.wait(4)
    assert health.level is Level.WARN
    assert health.message.startswith("recorder is dead or hangs: nothing is recorded any more")


def test_who_says_farewell_is_not_missed() -> None:
    """A node that is stopped in order is taken off the list."""
    listener = Listener("/")
    listener.receive("/controller: policy")
    listener.receive(f"/controller{FAREWELL}")
    assert listener.wait(5).level is Level.OK


def test_who_stood_still_blames_nobody() -> None:
    """A listener that was stopped for 5 s has received nothing, and misses nobody for it."""
    listener = Listener("/")
    listener.receive("/controller: policy")
    listener.wait(1)
    listener.now_s += 5.0
    assert listener.liveness.health().level is Level.OK
    assert listener.wait(3).level is Level.ERROR


def test_a_node_that_died_before_the_clock_was_set_back_is_missed() -> None:
    """What was received at a later time of the old run does not count until the new one comes to it."""
    listener = Listener("/")
    listener.receive("/sim: tendons")
    listener.now_s = 0.0
    assert listener.wait(1.0).level is Level.OK
    assert listener.wait(8.0).level is Level.ERROR
