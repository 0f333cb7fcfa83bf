"""A driver's node on a fake ankle, on real DDS: things fail behind it, and what it tells is received."""

from __future__ import annotations

import contextlib
import re
from typing import TYPE_CHECKING, Any

import pytest
from std_srvs.srv import Trigger

from domains import own_domain
from driver_graph import Graph, Onlooker
from jammkle_common import names
from jammkle_common.names import ACHILLES
from jammkle_msgs.msg import ChannelJamState, Fault

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from jammkle_driver.fake import FakeBoard, FakePlant

TIMEOUT_S = 40.0
"""How long is waited for anything; only a broken driver ever gets there."""
PASSING = {Fault.UNKNOWN, Fault.EXECUTOR_OVERLOADED, Fault.BOARD_LET_GO}
"""What a busy machine brings about, and what passes by itself."""
STEADY_TICKS = 20
"""How often outputs are repeated, each 0.05 s, while a jam comes to rest."""
_NUMBER_WITH_UNIT = re.compile(r".+ \((Pa|s|1|V|Hz|nats|share of declared|share of telegrams|m\^3/\(s Pa\))\)")


class Ankle:
    """A driver's node on a fake ankle in process, and who looks on."""

    def __init__(self, graph: Graph, **parameters: Any) -> None:
        self.graph = graph
        self.said = graph.ankle
        self.driver = graph.lawful_driver(hardware="fake", **parameters)

    @property
    def board(self) -> FakeBoard:
        """What can be unplugged, reset and disturbed, and plugged in again."""
        board: FakeBoard = self.driver._hardware.board
        return board

    @property
    def plant(self) -> FakePlant:
        """What can be broken and repaired."""
        return self.board.plant

    @property
    def fault(self) -> Fault:
        """The worst that is known, as reported on jam_state."""
        return self.said.states[-1].fault

    def spin_until_in(self, state: int) -> None:
        """Wait until every channel is in a state."""
        self.graph.spin_until(lambda: self.said.all_in(state), TIMEOUT_S)

    def trigger(self, service: names.Service) -> bool:
        """Call a service without arguments; return whether it was taken."""
        return bool(self.graph.call(Trigger, service.path).success)

    def wait_for_fault(self, *, shaken: bool = False) -> None:
        """Keep it jammed, or jam and vent it in turn, until a fault is reported: some show in motion alone."""

        def reported() -> bool:
            if self.fault.reason not in PASSING:
                return True
            if self.said.all_in(ChannelJamState.UNJAMMED):
                self.trigger(names.JAM_ALL)
            elif shaken and self.said.all_in(ChannelJamState.JAMMED):
                self.trigger(names.UNJAM_ALL)
            return False

        self.graph.spin_until(reported, TIMEOUT_S)

    def jam_again(self) -> None:
        """Repair everything, and come back to a jam."""
        self.board.heal()
        self.clear_and_jam()

    def clear_and_jam(self) -> None:
        """Clear and jam, until every channel has been JAMMED for a while, and the diagnosis knows the atmosphere."""
        self.graph.spin_until(lambda: self.said.values_of("atmosphere").get("measured by vented channels") == "yes")

        def jammed() -> bool:
            states = {channel.state for channel in self.said.states[-1].channels}
            if ChannelJamState.FAULT in states:
                self.trigger(names.CLEAR_FAULT)
            elif ChannelJamState.UNJAMMED in states:
                self.trigger(names.JAM_ALL)
            if states != {ChannelJamState.JAMMED} or self.fault.reason not in PASSING:
                self.said.received.clear()
            return self.said.received.count(ACHILLES) > STEADY_TICKS

        self.graph.spin_until(jammed, TIMEOUT_S)


def numbers_of(values: Mapping[str, str], *others: str) -> dict[str, float]:
    """Return the numbers among the values of a line on /diagnostics but for others; each must have a unit."""
    words = {"action", "fault", *others, *(key for key, value in values.items() if value == "not measured")}
    numbers = {key: float(value) for key, value in values.items() if key not in words}
    assert all(_NUMBER_WITH_UNIT.fullmatch(key) for key in numbers)
    return numbers


@contextlib.contextmanager
def graph_of_its_own(onlooker: type[Onlooker] = Onlooker) -> Iterator[Graph]:
    with pytest.MonkeyPatch.context() as patch, own_domain() as domain_id:
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        graph = Graph(domain_id, onlooker)
        yield graph
        graph.close()
