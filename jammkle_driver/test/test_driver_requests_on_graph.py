"""Requests of any kind and order to a running node over DDS, most of them malformed: each is answered, none does harm.

The node is held to what its fake hardware is commanded, at the very moment. `make soak` makes some 17,000 steps of it.
"""

from __future__ import annotations

import contextlib
import math
from typing import TYPE_CHECKING, Any

import pytest
from fake_ankle import graph_of_its_own
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule, run_state_machine_as_test
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import SetParameters
from rclpy._rclpy_pybind11 import RCLError
from rclpy.parameter import Parameter
from std_msgs.msg import Bool
from std_srvs.srv import SetBool, Trigger

from jammkle_common import names
from jammkle_common.names import CHANNELS
from jammkle_common.qos import publisher_qos
from jammkle_driver.core.hardware import ActuatorCommand, released
from jammkle_driver.fake import FakeFault, LinkFault
from jammkle_msgs.msg import ChannelJamCommand, ChannelJamState, JamCommand
from jammkle_msgs.srv import Jam, Unjam
from malformed import NAME, NAMES, PASCALS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from driver_graph import Graph

MOST_PA = 70e3
LEAST_PA = 5e3
LONGEST_ANSWER = 600
WAYS_OUT = (
    "activate",
    "~/clear_fault",
    "ask again",
    "start the hardware",
    "unjam those first",
    "look at",
    "cut the supply",
)
"""What an answer that refuses a good request says of what to do first."""
NOISE_SHARE = 0.2
EXAMPLES_SHARE = 0.1
"""Of the profile's number of examples: a round trip takes a hundred times longer than a call."""


class Asked:
    """A running driver on a fake ankle, everybody who asks it, and a witness at its hardware."""

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        self.driver = graph.lawful_driver(hardware="fake")
        self.unsafe: list[str] = []
        self._clients: dict[str, Any] = {}
        self.commands = graph.node.create_publisher(
            JamCommand, names.JAM_COMMAND.name, publisher_qos(names.JAM_COMMAND)
        )
        self.stops = graph.node.create_publisher(Bool, names.EMERGENCY_STOP.name, publisher_qos(names.EMERGENCY_STOP))
        self.board = self.driver._hardware.board
        self._drive = self.board.plant.command
        self.board.plant.command = self._witness
        graph.spin_until(lambda: graph.ankle.all_in(ChannelJamState.UNJAMMED))

    def _witness(self, solenoids: Mapping[str, bool], duty: float, late_s: float = 0.0) -> None:
        driver, ankle = self.driver._driver, self.driver._driver.ankle
        may_drive = driver.active and not driver.stop.reason and not ankle.faulty and ankle.jammed
        off = ActuatorCommand(dict(solenoids), duty) == released(CHANNELS)
        if not 0.0 <= duty <= 1.0 or not (off or may_drive):
            self.unsafe.append(f"{solenoids}, duty {duty} with {driver.standing}")
        self._drive(solenoids, duty, late_s)

    def call(self, kind: Any, path: str, **request: Any) -> Any:
        """Call a service of the driver, by a client that stays."""
        if path not in self._clients:
            self._clients[path] = self.graph.node.create_client(kind, path)
            self.graph.spin_until(self._clients[path].service_is_ready)
        future = self._clients[path].call_async(kind.Request(**request))
        self.graph.spin_until(future.done)
        return future.result()

    def change_state(self, identifier: int) -> bool:
        """Ask for a transition of the lifecycle."""
        return bool(self.call(ChangeState, "driver/change_state", transition=Transition(id=identifier)).success)

    def calm(self) -> None:
        """Come back to an active driver that is asked for nothing."""
        self.board.heal()
        self.change_state(Transition.TRANSITION_ACTIVATE)

        def clear() -> bool:
            self.stops.publish(Bool(data=False))
            return bool(self.call(Trigger, names.CLEAR_FAULT.path).success)

        self.graph.spin_until(clear)
        self.call(Trigger, names.UNJAM_ALL.path)


@pytest.fixture
def asked() -> Iterator[Asked]:
    with graph_of_its_own() as graph:
        made = Asked(graph)
        yield made
        vars(made).clear()  # else pytest keeps the node alive


def in_range(vacuum_pa: float) -> bool:
    """Whether a vacuum may be asked for."""
    return vacuum_pa == 0.0 or (math.isfinite(vacuum_pa) and LEAST_PA <= vacuum_pa <= MOST_PA)


def known(channels: list[str]) -> bool:
    """Whether there are such channels; what follows a zero does not go over DDS."""
    return all(name.partition("\0")[0] in CHANNELS for name in channels)


class Everybody(RuleBasedStateMachine):
    """Whoever may ask anything of one running driver."""

    def __init__(self, asked: Asked) -> None:
        super().__init__()
        self.asked = asked
        asked.calm()

    @rule(channels=NAMES, vacuum_pa=PASCALS)
    def jam(self, channels: list[str], vacuum_pa: float) -> None:
        answer = self.asked.call(Jam, names.JAM.path, channels=channels, vacuum_pa=vacuum_pa)
        self.check(answer, channels, vacuum_pa)

    @rule(channels=NAMES)
    def unjam(self, channels: list[str]) -> None:
        self.check(self.asked.call(Unjam, names.UNJAM.path, channels=channels), channels, 0.0)

    @rule(service=st.sampled_from((names.JAM_ALL, names.UNJAM_ALL, names.CLEAR_FAULT)))
    def trigger(self, service: names.Service) -> None:
        self.check(self.asked.call(Trigger, service.path), [], 0.0)

    @rule(channel=st.sampled_from(CHANNELS), on=st.booleans())
    def switch(self, channel: str, *, on: bool) -> None:
        self.check(self.asked.call(SetBool, names.CHANNEL_JAMS[channel].path, data=on), [], 0.0)

    @rule(set_points=st.lists(st.tuples(NAME, PASCALS), max_size=4))
    def stream(self, set_points: list[tuple[str, float]]) -> None:
        entries = [ChannelJamCommand(channel=name, vacuum_pa=vacuum_pa) for name, vacuum_pa in set_points]
        self.asked.commands.publish(JamCommand(channels=entries))

    @rule(stop=st.booleans())
    def emergency_stop(self, *, stop: bool) -> None:
        self.asked.stops.publish(Bool(data=stop))

    @rule(
        identifier=st.sampled_from(
            (
                Transition.TRANSITION_ACTIVATE,
                Transition.TRANSITION_DEACTIVATE,
                Transition.TRANSITION_CONFIGURE,
                0,
                9,
                255,
            )
        )
    )
    def change_state(self, identifier: int) -> None:
        self.asked.change_state(identifier)

    @rule(
        name=st.sampled_from(("default_vacuum_pa", "ambient_pressure_pa", "max_vacuum_pa", "hardware", " ", "soleus")),
        value=st.one_of(PASCALS, st.text(max_size=5), st.booleans(), st.integers(-5, 5)),
    )
    def set_parameter(self, name: str, value: float | str | bool) -> None:  # noqa: FBT001 - of any type
        parameter = Parameter("x", value=value).to_parameter_msg()
        parameter.name = name
        (answer,) = self.asked.call(SetParameters, "driver/set_parameters", parameters=[parameter]).results
        good = name in {"default_vacuum_pa", "ambient_pressure_pa"} and isinstance(value, float) and value != 0.0
        assert answer.successful <= good
        assert answer.successful or answer.reason

    @rule(place=st.sampled_from(CHANNELS), pressure_pa=st.sampled_from((130e3, math.nan, -math.inf)))
    def break_sensor(self, place: str, pressure_pa: float) -> None:
        self.asked.board.plant.inject(FakeFault.SENSOR_OUT_OF_RANGE, place, pressure_pa)

    @rule(fault=st.sampled_from(LinkFault))
    def befall_the_board(self, fault: LinkFault) -> None:
        self.asked.board.inject(fault, size=NOISE_SHARE)

    @rule()
    def heal(self) -> None:
        self.asked.board.heal()

    @invariant()
    def nothing_unsafe_is_driven(self) -> None:
        assert not self.asked.unsafe
        assert 0.0 <= self.asked.graph.ankle.duty <= 1.0

    @staticmethod
    def check(answer: Any, channels: list[str], vacuum_pa: float) -> None:
        """Hold an answer to what it must say: one line with the value, the limit and the way out."""
        assert answer.message
        assert len(answer.message) < LONGEST_ANSWER
        assert "\n" not in answer.message
        if answer.success:
            assert known(channels)
            assert in_range(vacuum_pa)
        elif not known(channels):
            assert answer.message.startswith("unknown channel ")
            assert ", ".join(CHANNELS) in answer.message
        elif not in_range(vacuum_pa):
            assert f"vacuum_pa is {vacuum_pa:g}; it must be 5000 to 70000 Pa" in answer.message
        else:
            assert any(words in answer.message for words in WAYS_OUT), answer.message


def test_whatever_is_asked_is_answered_and_nothing_unsafe_is_driven(asked: Asked) -> None:
    """Services, streams, stops, parameters and transitions at random, while sensors break: the node lives, and jams."""
    profile = settings()
    run_state_machine_as_test(
        lambda: Everybody(asked),
        settings=settings(
            max_examples=round(profile.max_examples * EXAMPLES_SHARE),
            suppress_health_check=list(HealthCheck),
            phases=(Phase.generate,),  # a node that runs does not do the same thing twice
        ),
    )
    asked.calm()
    # Until vented channels have shown the atmosphere, ambient_pressure_pa counts, which was set to nonsense.
    asked.graph.spin_until(
        lambda: asked.graph.ankle.values_of("atmosphere").get("measured by vented channels") == "yes"
    )
    # As its answers and faults say: refused or failed, clear and ask again.
    asked.graph.spin_until(
        lambda: (
            asked.graph.ankle.all_in(ChannelJamState.JAMMED)
            or (not asked.call(Jam, names.JAM.path).success and asked.call(Trigger, names.CLEAR_FAULT.path) is None)
        )
    )


@pytest.mark.parametrize("junk", [b"", b"\x00\x01\x00\x00", b"\x00\x01\x00\x00\xff\xff\xff\x7f", bytes(range(256))])
def test_bytes_that_are_no_message_do_no_harm(asked: Asked, junk: bytes) -> None:
    """A publisher whose bytes cannot be read, or only as a stop, costs neither the node nor the next jam."""
    for publisher in (asked.commands, asked.stops):
        asked.graph.spin_until(lambda publisher=publisher: publisher.get_subscription_count() > 0)
        with contextlib.suppress(RCLError):  # what DDS itself does not take
            publisher.publish(junk)
    asked.calm()
    assert asked.call(Trigger, names.JAM_ALL.path).success
    asked.graph.spin_until(lambda: asked.graph.ankle.all_in(ChannelJamState.JAMMED))
    assert not asked.unsafe
