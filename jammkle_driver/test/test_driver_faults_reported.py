"""Every fault of plant, board, line and the driver's own pace over DDS: the report, the action, and the way back."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from fake_ankle import PASSING, TIMEOUT_S, Ankle, graph_of_its_own, numbers_of
from std_srvs.srv import Trigger

from jammkle_common import names
from jammkle_common.names import ACHILLES, CHANNELS, PERONEAL_LEFT, PERONEAL_RIGHT
from jammkle_common.qos import publisher_qos
from jammkle_driver.core.hardware import MANIFOLD, released
from jammkle_driver.core.watch import BOARD
from jammkle_driver.fake import WATCHDOG_S, FakeFault, LinkFault
from jammkle_driver.parameters import DriverParameters
from jammkle_msgs.msg import ChannelJamCommand, ChannelJamState, Fault, JamCommand
from jammkle_msgs.srv import Jam

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

STALL_S = 0.4
"""Twice the time after which a board lets go of a driver that stands still."""
HELD_PA = 40e3
STREAM_PERIOD_S = 0.05
NOISE_SHARE = 0.2


@pytest.fixture(scope="module")
def ankle() -> Iterator[Ankle]:
    """One driver that runs through all of the faults, one after the other."""
    with graph_of_its_own() as graph:
        made = Ankle(graph)
        yield made
        del made.driver  # else pytest keeps the node alive


@pytest.fixture
def make_ankle() -> Iterator[Callable[..., Ankle]]:
    """Start a driver with parameters of its own."""
    with graph_of_its_own() as graph:
        yield partial(Ankle, graph)


@dataclass(frozen=True)
class Broken:
    """What is broken, how it is reported, and with which number; the number's size, where the plant knows it."""

    reason: int
    fault: FakeFault | LinkFault
    place: str
    number: str
    size: float = 0.0
    vented: bool = False
    """Whether it happens to a vented ankle, not to a jammed one."""
    shaken: bool = False
    true: float | None = None
    text: str = ""
    """What the report of the board says."""


NATS = "log-likelihood gained (nats)"
LEAK = "leak conductance (m^3/(s Pa))"
LINE = "line conductance (share of declared)"
FLOW = "pump flow (share of declared)"
OFFSET = "sensor offset (Pa)"
MUST_BE = "pressure that must be (Pa)"
AT_MANIFOLD = "pressure of the manifold (Pa)"
READING = "reading (Pa)"
SILENCE = "silence allowed (s)"

BROKEN = {
    "leak": Broken(Fault.LEAK, FakeFault.LEAK, ACHILLES, LEAK, 3e-10, true=3e-10),
    "leak of the manifold": Broken(Fault.LEAK, FakeFault.LEAK, MANIFOLD, LEAK, 3e-10, true=3e-10),
    "blocked line": Broken(Fault.BLOCKED_LINE, FakeFault.BLOCKED, PERONEAL_RIGHT, LINE, 0.05, vented=True, true=0.05),
    "valve stuck open": Broken(Fault.VALVE_STUCK_OPEN, FakeFault.STUCK_OPEN, PERONEAL_LEFT, AT_MANIFOLD, shaken=True),
    "valve stuck closed": Broken(Fault.VALVE_STUCK_CLOSED, FakeFault.STUCK_CLOSED, ACHILLES, AT_MANIFOLD, vented=True),
    "pump dead": Broken(Fault.PUMP_DEAD, FakeFault.PUMP_DEAD, MANIFOLD, FLOW, vented=True, true=0.0),
    "pump weak": Broken(
        Fault.PUMP_WEAK, FakeFault.PUMP_WEAK, MANIFOLD, FLOW, 0.25, vented=True, shaken=True, true=0.25
    ),
    "sensor dead": Broken(Fault.SENSOR_DEAD, FakeFault.SENSOR_DEAD, ACHILLES, SILENCE, true=0.5),
    "sensor stuck": Broken(Fault.SENSOR_STUCK, FakeFault.SENSOR_STUCK, PERONEAL_RIGHT, MUST_BE, shaken=True),
    "sensor drifting": Broken(Fault.SENSOR_DRIFTING, FakeFault.SENSOR_DRIFT, PERONEAL_LEFT, OFFSET, -3e3),
    "sensor off at once": Broken(Fault.SENSOR_DRIFTING, FakeFault.SENSOR_BIAS, ACHILLES, OFFSET, 6e3, true=6e3),
    "sensor of the manifold off": Broken(Fault.SENSOR_DRIFTING, FakeFault.SENSOR_BIAS, MANIFOLD, OFFSET, 6e3, true=6e3),
    "sensor out of range": Broken(
        Fault.SENSOR_OUT_OF_RANGE, FakeFault.SENSOR_OUT_OF_RANGE, ACHILLES, READING, 130e3, true=130e3
    ),
    "board unplugged": Broken(
        Fault.BOARD_UNPLUGGED, LinkFault.UNPLUGGED, BOARD, "exchanges (1)", text="the board does not answer"
    ),
    "board rebooted": Broken(
        Fault.BOARD_REBOOTED, LinkFault.REBOOTED, BOARD, "board starts (1)", text="last reset: reset pin"
    ),
    "brown-out": Broken(Fault.BROWN_OUT, LinkFault.BROWN_OUT, BOARD, "supply (V)", text="the supply fell below"),
}


@pytest.mark.parametrize("broken", BROKEN.values(), ids=BROKEN)
def test_a_fault_is_reported_acted_upon_and_left_again(ankle: Ankle, broken: Broken) -> None:
    """On jam_state, on /diagnostics with numbers and units, at the outputs; the repaired ankle jams once cleared."""
    ankle.jam_again()
    if broken.vented:
        ankle.trigger(names.UNJAM_ALL)
        ankle.spin_until_in(ChannelJamState.UNJAMMED)
    ankle.board.inject(broken.fault, broken.place, broken.size)
    ankle.wait_for_fault(shaken=broken.shaken)

    concerned = CHANNELS if broken.place in {MANIFOLD, BOARD} else (broken.place,)
    reported = ankle.fault
    assert reported.reason == broken.reason
    if broken.place == BOARD:
        assert broken.text in reported.text
    else:
        assert reported.text.startswith(f"{broken.place} ")
        assert re.search(r"\d", reported.text)
    assert re.search("then call ~/clear_fault|call ~/clear_fault, then jam anew", reported.text)
    assert reported.action == "every channel vented until ~/clear_fault"
    faulty = {channel.channel for channel in ankle.said.states[-1].channels if channel.state == ChannelJamState.FAULT}
    assert faulty == set(concerned)
    for channel in concerned:
        assert ankle.said.state_of(channel).fault == broken.reason
        assert ankle.said.state_of(channel).reason == reported.text
    ankle.graph.spin_until(ankle.said.released)
    ankle.graph.spin_until(lambda: ankle.board.driven == released(CHANNELS))

    ankle.graph.spin_until(lambda: reported.text in ankle.said.lines["fault"].message)
    if broken.place == BOARD:
        ankle.graph.spin_until(lambda: ankle.said.lines["link"].level == DiagnosticStatus.ERROR)
    line = ankle.said.lines["fault"]
    assert line.level == DiagnosticStatus.ERROR
    assert reported.action in line.message
    for values in (ankle.said.values_of("fault"), ankle.said.values_of(concerned[0])):
        numbers = numbers_of(values)
        if broken.true is not None:
            assert numbers[broken.number] == pytest.approx(
                broken.true, rel=0.5, abs=0.06 if broken.true < 1.0 else None
            )
        assert broken.number in numbers

    refused = ankle.graph.call(Jam, names.JAM.path, channels=[concerned[0]])
    assert not refused.success
    assert reported.text in refused.message
    ankle.jam_again()
    ankle.graph.spin_until(lambda: ankle.said.lines["link"].level != DiagnosticStatus.ERROR)


def test_a_silent_sensor_of_the_manifold_is_reported_and_costs_no_jam(ankle: Ankle) -> None:
    """It is a warning with what is done instead: the channels alone regulate the pump, and stay JAMMED."""
    ankle.jam_again()
    ankle.plant.inject(FakeFault.SENSOR_DEAD, MANIFOLD)
    ankle.graph.spin_until(lambda: ankle.fault.reason == Fault.SENSOR_DEAD)
    assert ankle.fault.text.startswith("manifold sensor gives no valid pressure for 0.5 s")
    assert ankle.fault.action == "the pump is regulated by the channels alone"
    ankle.graph.spin_until(lambda: ankle.said.lines["fault"].level == DiagnosticStatus.WARN)
    assert ankle.said.values_of("fault")[SILENCE] == "0.5"
    assert ankle.said.lines["manifold"].level == DiagnosticStatus.WARN
    assert ankle.trigger(names.UNJAM_ALL)
    ankle.spin_until_in(ChannelJamState.UNJAMMED)
    assert ankle.trigger(names.JAM_ALL)
    ankle.spin_until_in(ChannelJamState.JAMMED)
    assert all(ankle.said.solenoids.values())
    ankle.plant.heal()
    ankle.graph.spin_until(lambda: ankle.fault.reason in PASSING)
    ankle.graph.spin_until(lambda: ankle.said.lines["manifold"].level == DiagnosticStatus.OK)


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
    """EXECUTOR_OVERLOADED, with how often and for how long; the fake ankle waited, and stays as it was."""
    ankle.jam_again()
    time.sleep(STALL_S)  # the driver, and the board's plant with it: the executor is this thread's
    ankle.graph.spin_until(lambda: ankle.fault.reason == Fault.EXECUTOR_OVERLOADED)
    ankle.graph.spin_until(lambda: "EXECUTOR_OVERLOADED" in ankle.said.lines["fault"].message)
    numbers = numbers_of(ankle.said.values_of("fault"))
    assert numbers["longest standstill (s)"] >= STALL_S
    assert numbers["standstills (1)"] >= 1
    assert ankle.fault.action == "none: the board lets go where that lasts"
    assert ankle.said.lines["executor"].level == DiagnosticStatus.WARN
    assert ankle.said.all_in(ChannelJamState.JAMMED)


def test_a_board_that_let_go_of_a_late_driver_is_reported(ankle: Ankle) -> None:
    """BOARD_LET_GO: vented, no FAULT, and a jam that is asked anew works without a person."""
    ankle.jam_again()
    ankle.board.advance(WATCHDOG_S)  # without a command, as of a driver that stood still
    ankle.graph.spin_until(lambda: ankle.fault.reason == Fault.BOARD_LET_GO)
    assert "no fresh command" in ankle.fault.text
    ankle.graph.spin_until(lambda: "BOARD_LET_GO" in ankle.said.lines["fault"].message)
    assert "board starts (1)" in numbers_of(ankle.said.values_of("fault"))
    assert ankle.board.driven == released(CHANNELS)
    ankle.spin_until_in(ChannelJamState.UNJAMMED)
    assert ankle.trigger(names.JAM_ALL)
    ankle.spin_until_in(ChannelJamState.JAMMED)


def test_the_leak_of_each_channel_is_on_diagnostics(ankle: Ankle) -> None:
    """In Pa/s and as a conductance: of what decays together in the manifold's row, of a channel alone in its own."""
    decay, conductance = (
        "decay while the pump rests (Pa/s)",
        "leak conductance by decay, manifold included (m^3/(s Pa))",
    )
    by_law = "leak conductance by the law of the air (m^3/(s Pa))"
    declared = DriverParameters().leak_conductance_m3_s_pa
    ankle.jam_again()
    for channels in (CHANNELS, (ACHILLES,)):
        ankle.trigger(names.UNJAM_ALL)
        ankle.spin_until_in(ChannelJamState.UNJAMMED)
        assert ankle.graph.call(Jam, names.JAM.path, channels=channels).success
        row = f"{channels[0] if len(channels) == 1 else MANIFOLD} leak"
        reported = ", ".join(sorted(channels))
        ankle.graph.spin_until(
            lambda row=row, names=reported: ankle.said.values_of(row).get("connected") == names, TIMEOUT_S
        )
        values = ankle.said.values_of(row)
        assert float(values[decay]) > 0.0
        # the manifold leaks as well as each channel that is connected, each as declared
        assert float(values[conductance]) == pytest.approx((1 + len(channels)) * declared, rel=0.3)
    for place in (MANIFOLD, *CHANNELS):
        mean, _, deviation = ankle.said.values_of(f"{place} leak")[by_law].partition(" +- ")
        assert float(mean) - 3.0 * float(deviation) < declared < float(mean) + 3.0 * float(deviation)


def test_a_valve_that_stays_open_makes_an_unjam_fail(ankle: Ankle) -> None:
    """What is commanded to vent and does not is no success."""
    ankle.jam_again()
    ankle.plant.inject(FakeFault.STUCK_OPEN, PERONEAL_LEFT)
    ankle.trigger(names.UNJAM_ALL)
    ankle.graph.spin_until(lambda: ankle.fault.reason == Fault.VALVE_STUCK_OPEN, TIMEOUT_S)
    answer = ankle.graph.call(Trigger, names.UNJAM_ALL.path)
    assert not answer.success
    assert PERONEAL_LEFT in answer.message
    ankle.jam_again()


@pytest.mark.parametrize(
    ("parameters", "action", "outputs"),
    [
        (
            {"safe_state": "hold"},
            "every channel kept as it was, pump off until ~/clear_fault",
            dict.fromkeys(CHANNELS, True),
        ),
        (
            {"fault_policy": "channel"},
            "achilles vented until ~/clear_fault",
            {PERONEAL_LEFT: True, PERONEAL_RIGHT: True, ACHILLES: False},
        ),
    ],
    ids=["hold", "channel"],
)
def test_the_action_is_what_the_policies_say(
    make_ankle: Callable[..., Ankle], parameters: dict[str, str], action: str, outputs: dict[str, bool]
) -> None:
    """With hold the solenoids stay and the pump is off; with a policy for the channel alone, the others go on."""
    ankle = make_ankle(**parameters)
    ankle.jam_again()
    ankle.plant.inject(FakeFault.SENSOR_OUT_OF_RANGE, ACHILLES, 130e3)
    ankle.graph.spin_until(lambda: ankle.fault.reason == Fault.SENSOR_OUT_OF_RANGE)
    assert ankle.fault.action == action
    ankle.graph.spin_until(lambda: ankle.said.solenoids == outputs)
    if "pump off" in action:
        ankle.graph.spin_until(lambda: ankle.said.duty == 0.0)
    ankle.graph.spin_until(lambda: action in ankle.said.lines["fault"].message)
    ankle.jam_again()


def test_a_script_breaks_and_heals_the_fake_ankle(make_ankle: Callable[..., Ankle]) -> None:
    """`fake_faults` lets a sensor break and come right: reported as such, and well once it is healed and cleared."""
    ankle = make_ankle(fake_faults="0.3 sensor_out_of_range achilles 130e3; 1.2 heal")
    ankle.graph.spin_until(lambda: bool(ankle.said.states) and ankle.fault.reason == Fault.SENSOR_OUT_OF_RANGE)
    ankle.clear_and_jam()
