"""Every fault of the plant through a running node over DDS: the report, the action, and the way back to a jam."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from fake_ankle import PASSING, TIMEOUT_S, Ankle, graph_of_its_own, numbers_of
from std_srvs.srv import Trigger

from jammkle_common import names
from jammkle_common.names import ACHILLES, CHANNELS, PERONEAL_LEFT, PERONEAL_RIGHT
from jammkle_driver.core.hardware import MANIFOLD
from jammkle_driver.fake import FakeFault
from jammkle_driver.parameters import DriverParameters
from jammkle_msgs.msg import ChannelJamState, Fault
from jammkle_msgs.srv import Jam

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


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
    fault: FakeFault
    place: str
    number: str
    size: float = 0.0
    while_jammed: bool = False
    shaken: bool = False
    true: float | None = None


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
    "leak": Broken(Fault.LEAK, FakeFault.LEAK, ACHILLES, LEAK, 3e-10, while_jammed=True, true=3e-10),
    "leak of the manifold": Broken(Fault.LEAK, FakeFault.LEAK, MANIFOLD, LEAK, 3e-10, while_jammed=True, true=3e-10),
    "blocked line": Broken(Fault.BLOCKED_LINE, FakeFault.BLOCKED, PERONEAL_RIGHT, LINE, 0.05, true=0.05),
    "valve stuck open": Broken(
        Fault.VALVE_STUCK_OPEN, FakeFault.STUCK_OPEN, PERONEAL_LEFT, AT_MANIFOLD, while_jammed=True, shaken=True
    ),
    "valve stuck closed": Broken(Fault.VALVE_STUCK_CLOSED, FakeFault.STUCK_CLOSED, ACHILLES, AT_MANIFOLD),
    "pump dead": Broken(Fault.PUMP_DEAD, FakeFault.PUMP_DEAD, MANIFOLD, FLOW, true=0.0),
    "pump weak": Broken(Fault.PUMP_WEAK, FakeFault.PUMP_WEAK, MANIFOLD, FLOW, 0.25, shaken=True, true=0.25),
    "sensor dead": Broken(Fault.SENSOR_DEAD, FakeFault.SENSOR_DEAD, ACHILLES, SILENCE, while_jammed=True, true=0.5),
    "sensor stuck": Broken(
        Fault.SENSOR_STUCK, FakeFault.SENSOR_STUCK, PERONEAL_RIGHT, MUST_BE, while_jammed=True, shaken=True
    ),
    "sensor drifting": Broken(
        Fault.SENSOR_DRIFTING, FakeFault.SENSOR_DRIFT, PERONEAL_LEFT, OFFSET, -3e3, while_jammed=True
    ),
    "sensor off at once": Broken(
        Fault.SENSOR_DRIFTING, FakeFault.SENSOR_BIAS, ACHILLES, OFFSET, 6e3, while_jammed=True, true=6e3
    ),
    "sensor of the manifold off": Broken(
        Fault.SENSOR_DRIFTING, FakeFault.SENSOR_BIAS, MANIFOLD, OFFSET, 6e3, while_jammed=True, true=6e3
    ),
    "sensor out of range": Broken(
        Fault.SENSOR_OUT_OF_RANGE,
        FakeFault.SENSOR_OUT_OF_RANGE,
        ACHILLES,
        READING,
        130e3,
        while_jammed=True,
        true=130e3,
    ),
}


@pytest.mark.parametrize("broken", BROKEN.values(), ids=BROKEN)
def test_a_fault_is_reported_acted_upon_and_left_again(ankle: Ankle, broken: Broken) -> None:
    """On jam_state, on /diagnostics with numbers and units, at the outputs; the repaired ankle jams once cleared."""
    ankle.jam_again()
    if not broken.while_jammed:
        ankle.trigger(names.UNJAM_ALL)
        ankle.spin_until_in(ChannelJamState.UNJAMMED)
    ankle.plant.inject(broken.fault, broken.place, broken.size)
    ankle.wait_for_fault(shaken=broken.shaken)

    concerned = CHANNELS if broken.place == MANIFOLD else (broken.place,)
    reported = ankle.fault
    assert reported.reason == broken.reason
    assert reported.text.startswith(f"{broken.place} ")
    assert re.search(r"\d", reported.text)
    assert "then call ~/clear_fault" in reported.text
    assert reported.action == "every channel vented until ~/clear_fault"
    faulty = {channel.channel for channel in ankle.said.states[-1].channels if channel.state == ChannelJamState.FAULT}
    assert faulty == set(concerned)
    for channel in concerned:
        assert ankle.said.state_of(channel).fault == broken.reason
        assert ankle.said.state_of(channel).reason == reported.text
    ankle.graph.spin_until(ankle.said.released)

    ankle.graph.spin_until(lambda: reported.text in ankle.said.lines["fault"].message)
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
