"""What befalls board, line and the driver's own pace, over DDS: what is reported, what is done, and the way back."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from fake_ankle import TIMEOUT_S, Ankle, graph_of_its_own, numbers_of

from jammkle_common import names
from jammkle_common.names import CHANNELS
from jammkle_common.qos import publisher_qos
from jammkle_driver.core.hardware import released
from jammkle_driver.fake import LinkFault
from jammkle_msgs.msg import ChannelJamCommand, ChannelJamState, Fault, JamCommand
from jammkle_msgs.srv import Jam

if TYPE_CHECKING:
    from collections.abc import Iterator

STALL_S = 0.4
"""Twice the time after which a board lets go of a driver that stands still."""
HELD_PA = 40e3
STREAM_PERIOD_S = 0.05
NOISE_SHARE = 0.2


@pytest.fixture(scope="module")
def ankle() -> Iterator[Ankle]:
    """One driver that runs through all of it."""
    with graph_of_its_own() as graph:
        made = Ankle(graph)
        yield made
        del made.driver  # else pytest keeps the node alive


@dataclass(frozen=True)
class Mishap:
    """What befalls the board, how it is reported, and with which number."""

    reason: int
    fault: LinkFault
    text: str
    number: str


MISHAPS = (
    Mishap(Fault.BOARD_UNPLUGGED, LinkFault.UNPLUGGED, "the board does not answer", "exchanges (1)"),
    Mishap(Fault.BOARD_REBOOTED, LinkFault.REBOOTED, "last reset: reset pin", "board starts (1)"),
    Mishap(Fault.BROWN_OUT, LinkFault.BROWN_OUT, "the supply fell below", "supply (V)"),
)


def stand_still(_ankle: Ankle) -> None:
    """Let the driver, and the board's plant with it, stand still: the executor is this thread's."""
    time.sleep(STALL_S)


@pytest.mark.parametrize("mishap", MISHAPS, ids=lambda mishap: mishap.fault.value)
def test_what_befalls_a_jammed_board_is_reported_and_left_again(ankle: Ankle, mishap: Mishap) -> None:
    """FAULT of every channel with its reason, /diagnostics with numbers and units, outputs off; cleared, it jams."""
    ankle.jam_again()
    ankle.board.inject(mishap.fault)
    ankle.graph.spin_until(lambda: ankle.said.all_in(ChannelJamState.FAULT))
    reported = ankle.fault
    assert reported.reason == mishap.reason
    assert mishap.text in reported.text
    assert "~/clear_fault" in reported.text
    assert reported.action == "every channel vented until ~/clear_fault"
    assert {channel.fault for channel in ankle.said.states[-1].channels} == {mishap.reason}
    ankle.graph.spin_until(ankle.said.released)
    ankle.graph.spin_until(lambda: ankle.board.driven == released(CHANNELS))

    ankle.graph.spin_until(lambda: reported.text in ankle.said.lines["fault"].message)
    line = ankle.said.lines["fault"]
    assert line.level == DiagnosticStatus.ERROR
    assert reported.action in line.message
    for row in ("fault", CHANNELS[0]):
        assert mishap.number in numbers_of(ankle.said.values_of(row))
    ankle.graph.spin_until(lambda: ankle.said.lines["link"].level == DiagnosticStatus.ERROR)

    refused = ankle.graph.call(Jam, names.JAM.path, channels=[CHANNELS[0]])
    assert not refused.success
    assert reported.text in refused.message
    ankle.jam_again()
    ankle.graph.spin_until(lambda: ankle.said.lines["link"].level != DiagnosticStatus.ERROR)


def test_a_board_that_is_unplugged_is_named_on_the_terminal_once(
    ankle: Ankle, capfd: pytest.CaptureFixture[str]
) -> None:
    """Whoever has started the driver with the wrong port sees why, and not again with every try."""
    ankle.board.inject(LinkFault.UNPLUGGED)
    reason = ankle.board.link.detail.partition(";")[0]
    logged = ""

    def is_logged() -> bool:
        nonlocal logged
        logged += capfd.readouterr().err
        return reason in logged

    ankle.graph.spin_until(is_logged)
    ankle.graph.spin_until(lambda: reason in ankle.said.lines["link"].message)
    assert (logged + capfd.readouterr().err).count(f"]: {reason}") == 1
    ankle.board.heal()
    ankle.graph.spin_until(lambda: ankle.said.lines["link"].level != DiagnosticStatus.ERROR)


def test_a_board_that_resets_while_nothing_is_jammed_is_reported(ankle: Ankle) -> None:
    """A warning of the link with the cause, and no FAULT: nobody has lost anything, but the next jam would."""
    ankle.jam_again()
    ankle.trigger(names.UNJAM_ALL)
    ankle.spin_until_in(ChannelJamState.UNJAMMED)
    starts = ankle.board.link.starts
    ankle.board.inject(LinkFault.REBOOTED)
    ankle.graph.spin_until(
        lambda: numbers_of(ankle.said.values_of("link"), "last reset")["board starts (1)"] == starts + 1
    )
    assert "has started anew" in ankle.said.lines["link"].message
    assert ankle.said.lines["link"].level == DiagnosticStatus.WARN
    assert ankle.said.all_in(ChannelJamState.UNJAMMED)
    assert ankle.trigger(names.JAM_ALL)
    ankle.spin_until_in(ChannelJamState.JAMMED)


def test_noise_on_the_line_is_reported_and_costs_no_jam(ankle: Ankle) -> None:
    """A warning with the share of telegrams that were damaged; what is jammed stays so."""
    ankle.jam_again()
    ankle.board.inject(LinkFault.LINE_NOISE, size=NOISE_SHARE)

    def reported_share() -> float:
        return numbers_of(ankle.said.values_of("fault")).get("wrong check sums (share of telegrams)", 0.0)

    ankle.graph.spin_until(lambda: ankle.fault.reason == Fault.LINE_NOISE)
    assert ankle.fault.action == "none: the line repeats what is lost"
    ankle.graph.spin_until(lambda: reported_share() > 0.5 * NOISE_SHARE)
    assert reported_share() < 2.0 * NOISE_SHARE
    assert ankle.said.lines["fault"].level == DiagnosticStatus.WARN
    assert ankle.said.lines["link"].level == DiagnosticStatus.WARN
    assert ankle.said.all_in(ChannelJamState.JAMMED)
    assert all(ankle.board.driven.solenoids.values())
    ankle.board.heal()
    ankle.graph.spin_until(lambda: ankle.fault.reason != Fault.LINE_NOISE, TIMEOUT_S)


def test_a_stream_that_ends_is_reported_and_one_that_goes_on_jams_again(ankle: Ankle) -> None:
    """COMMANDS_STALE with the silence that is allowed; no FAULT, nothing to clear."""
    ankle.jam_again()
    ankle.trigger(names.UNJAM_ALL)
    ankle.spin_until_in(ChannelJamState.UNJAMMED)
    node, topic = ankle.graph.node, names.JAM_COMMAND
    publisher = node.create_publisher(JamCommand, topic.name, publisher_qos(topic))
    set_point = JamCommand(channels=[ChannelJamCommand(channel=name, vacuum_pa=HELD_PA) for name in CHANNELS])
    for _ in range(2):
        timer = node.create_timer(STREAM_PERIOD_S, lambda: publisher.publish(set_point))
        ankle.spin_until_in(ChannelJamState.JAMMED)
        node.destroy_timer(timer)
        ankle.graph.spin_until(lambda: ankle.fault.reason == Fault.COMMANDS_STALE)
        assert "no accepted jam_command for 0.5 s (command_timeout_s)" in ankle.fault.text
        assert ankle.fault.action.endswith("vented until asked anew")
        ankle.graph.spin_until(ankle.said.released)
        ankle.graph.spin_until(lambda: "COMMANDS_STALE" in ankle.said.lines["fault"].message)
        assert ankle.said.lines["fault"].level == DiagnosticStatus.WARN
        assert numbers_of(ankle.said.values_of("fault")) == {"silence allowed (s)": 0.5}
        ankle.spin_until_in(ChannelJamState.UNJAMMED)
    node.destroy_publisher(publisher)


def test_a_driver_that_stood_still_says_so(ankle: Ankle) -> None:
    """EXECUTOR_OVERLOADED, with how often and for how long; nothing was jammed, and nothing is held against it."""
    ankle.jam_again()
    ankle.trigger(names.UNJAM_ALL)
    ankle.spin_until_in(ChannelJamState.UNJAMMED)
    stand_still(ankle)
    ankle.graph.spin_until(lambda: ankle.fault.reason == Fault.EXECUTOR_OVERLOADED)
    ankle.graph.spin_until(lambda: "EXECUTOR_OVERLOADED" in ankle.said.lines["fault"].message)
    numbers = numbers_of(ankle.said.values_of("fault"))
    assert numbers["longest standstill (s)"] >= STALL_S
    assert numbers["standstills (1)"] >= 1
    assert ankle.fault.action == "none: the board lets go where that lasts"
    assert ankle.said.lines["executor"].level == DiagnosticStatus.WARN
    assert ankle.said.all_in(ChannelJamState.UNJAMMED)


def test_a_board_that_let_go_of_a_late_driver_is_reported(ankle: Ankle) -> None:
    """BOARD_LET_GO: vented, no FAULT, and a jam that is asked anew works without a person."""
    ankle.jam_again()
    stand_still(ankle)
    ankle.graph.spin_until(lambda: ankle.fault.reason == Fault.BOARD_LET_GO)
    assert "no fresh command" in ankle.fault.text
    ankle.graph.spin_until(lambda: "BOARD_LET_GO" in ankle.said.lines["fault"].message)
    assert "board starts (1)" in numbers_of(ankle.said.values_of("fault"))
    assert ankle.board.driven == released(CHANNELS)
    ankle.spin_until_in(ChannelJamState.UNJAMMED)
    assert ankle.trigger(names.JAM_ALL)
    ankle.spin_until_in(ChannelJamState.JAMMED)
