"""The controller as a real process on real DDS; the test plays the IMU and listens."""

from __future__ import annotations

import math
import signal
import struct
import time
from typing import TYPE_CHECKING, Any

import pytest
from controller_bench import GRAVITY_M_S2, INTERVAL_S, LANDED_AT_S, TIMEOUT_S
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import WrenchStamped
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu

from jammkle_common import wire
from jammkle_common.names import CHANNELS, LOAD_CELL, UNJAM
from jammkle_common.qos import publisher_qos
from jammkle_msgs.msg import ChannelJamState, ContactEvent, Fault, JamState

if TYPE_CHECKING:
    from collections.abc import Callable

    from controller_bench import Bench


def big_endian(message: Imu | WrenchStamped) -> bytes:
    """Return a message as a machine of the other byte order sends it."""
    serialized, doubles = serialize_message(message), wire.IMU_DOUBLES if isinstance(message, Imu) else 6
    words = struct.unpack_from("<iII", serialized, 4)
    numbers = struct.unpack(f"<{doubles}d", serialized[-doubles * 8 :])
    return (
        b"\0\0"
        + serialized[2:4]
        + struct.pack(">iII", *words)
        + serialized[16 : -doubles * 8]
        + struct.pack(f">{doubles}d", *numbers)
    )


def test_sensors_of_either_byte_order_are_felt(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench("--ros-args", "-p", "use_load:=true")
    bench.encode = big_endian
    bench.land()
    assert bench.events[-1].header.frame_id == "imu"
    loads = bench.node.create_publisher(WrenchStamped, LOAD_CELL.name, publisher_qos(LOAD_CELL))
    loaded = WrenchStamped()
    loaded.wrench.force.z = -40.0

    def takes_load(encode: Callable[[WrenchStamped], WrenchStamped | bytes] | None) -> bool:
        loaded.header.stamp = bench.node.get_clock().now().to_msg()
        if encode is not None:
            loads.publish(encode(loaded))
        return "load" in bench.health["inputs"].message.partition(";")[0]

    bench.spin_until(lambda: takes_load(big_endian), "the load is taken")
    bench.spin_until(lambda: not takes_load(None), "nothing is taken for a while")
    bench.spin_until(lambda: takes_load(lambda message: message), "the load is taken again")


def test_landing_is_reported_and_jams_after_the_delay(make_bench: Callable[..., Bench]) -> None:
    """A landing gives events stamped with their samples, and vacuum once the samples' time has passed the delay.

    The delay is the samples' time, not the wall's: while no sample comes, as in a paused simulation, nothing jams.
    """
    bench = make_bench()
    assert bench.set_points_pa() == dict.fromkeys(CHANNELS, 0.0)
    bench.land()
    liftoff, impact = bench.events
    assert liftoff.type == ContactEvent.LIFTOFF
    stamp = impact.header.stamp
    assert stamp.sec + stamp.nanosec * 1e-9 == pytest.approx(LANDED_AT_S, abs=1e-9)
    assert impact.header.frame_id == "imu"
    assert impact.unit == "m/s^2"
    assert impact.magnitude == pytest.approx(40.0, abs=0.2)
    assert impact.probability > 0.9
    assert impact.source == "imu"
    bench.wait_more()
    assert bench.set_points_pa() == dict.fromkeys(CHANNELS, 0.0)
    bench.feel(30.0, LANDED_AT_S + 0.019)
    bench.wait_more()
    assert bench.set_points_pa() == dict.fromkeys(CHANNELS, 0.0)
    bench.feel(20.0, LANDED_AT_S + 0.02)
    bench.spin_until(lambda: bench.set_points_pa() == dict.fromkeys(CHANNELS, 40e3), "the channels are to be jammed")
    bench.stand(LANDED_AT_S + 0.024, LANDED_AT_S + 0.4)
    bench.spin_until(lambda: bench.kinds()[-1] == ContactEvent.SETTLED, "the landing settles")
    assert bench.set_points_pa() == dict.fromkeys(CHANNELS, 40e3)


def test_delay_of_zero_can_be_set_while_running(make_bench: Callable[..., Bench]) -> None:
    """jam_delay_s is dynamic: with zero the impact's own sample jams; out of range is refused by name and limit."""
    bench = make_bench()
    refused = bench.set_parameter("jam_delay_s", 3.0)
    assert not refused.successful
    assert "jam_delay_s" in refused.reason
    assert "1" in refused.reason
    assert bench.set_parameter("jam_delay_s", 0.0).successful
    bench.land()
    bench.spin_until(lambda: bench.set_points_pa() == dict.fromkeys(CHANNELS, 40e3), "the impact jams")


def test_auto_off_ends_the_stream_and_on_resumes_it(make_bench: Callable[..., Bench]) -> None:
    """With auto off no jam_command is sent, while events are reported; with auto on the set points are sent at once."""
    bench = make_bench()
    answer = bench.set_auto(on=False)
    assert answer.success
    assert "command_timeout_s" in answer.message
    sent = bench.reports
    bench.spin_until(lambda: bench.reports >= sent + 2, "what was under way has come")
    bench.commands.clear()
    bench.land()
    bench.stand(LANDED_AT_S + INTERVAL_S, LANDED_AT_S + 0.1)
    sent = bench.reports
    bench.spin_until(lambda: bench.reports >= sent + 2, "two more reports have come")
    assert bench.commands == []
    assert bench.set_auto(on=True).success
    bench.spin_until(lambda: bool(bench.commands), "the stream goes on")
    assert bench.set_points_pa() == dict.fromkeys(CHANNELS, 40e3)


def test_auto_can_be_off_from_the_start(make_bench: Callable[..., Bench]) -> None:
    """With auto_at_start false nothing is commanded before ~/set_auto."""
    bench = make_bench("--ros-args", "-p", "auto_at_start:=false", is_up=False)
    bench.spin_until(lambda: bench.reports >= 2, "the controller is received")
    assert bench.commands == []
    assert KeyValue(key="automatic", value="false") in bench.health["policy"].values
    bench.set_auto(on=True)
    bench.spin_until(lambda: bool(bench.commands), "the stream begins")


def test_health_of_the_imu_is_reported(make_bench: Callable[..., Bench]) -> None:
    """A missing IMU is an error that says for how long, NaN samples are a warning with their count, and it passes."""
    bench = make_bench()
    error, warning = DiagnosticStatus.ERROR, DiagnosticStatus.WARN
    bench.spin_until(lambda: bench.health["imu"].level == error, "the missing IMU is an error")
    assert "no usable sample on /imu/data for" in bench.health["imu"].message
    bench.stand(0.1, 0.3)
    bench.feel(math.nan, 0.3)

    def warned() -> bool:
        bench.feel(GRAVITY_M_S2, 0.3 + bench.reports * 1.0)
        return bench.health["imu"].level == warning and "1 not finite" in bench.health["imu"].message

    bench.spin_until(warned, "the NaN is a warning")
    bench.spin_until(lambda: bench.health["imu"].level == error, "the IMU is missed again")


def test_an_imu_of_another_clock_is_reported(make_bench: Callable[..., Bench]) -> None:
    """Stamps 50 ms behind the node's clock are in order; 0.3 s behind it, or ahead of it, they are a warning."""
    bench = make_bench()
    felt_s = time.time() - 0.1

    def comes(behind_s: float, said: str) -> bool:
        nonlocal felt_s
        until_s = max(felt_s, time.time() - behind_s)
        bench.stand(felt_s, until_s)
        felt_s = until_s
        return said in bench.health["imu"].message

    bench.spin_until(lambda: comes(0.05, "samples come in"), "samples come in")
    for _ in range(2):
        reports = bench.reports
        bench.spin_until(lambda before=reports: comes(0.05, "") and bench.reports > before, "a report comes")
    assert "clock" not in bench.health["imu"].message
    for behind_s, said in ((0.3, "0.2 s or more behind the clock"), (-0.3, "0.2 s or more ahead of the clock")):
        bench.spin_until(lambda off_s=behind_s, words=said: comes(off_s, words), f"stamps {said} are reported")
        assert bench.health["imu"].level == DiagnosticStatus.WARN


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_ends_cleanly_on_signals(make_bench: Callable[..., Bench], number: signal.Signals) -> None:
    """SIGTERM and SIGINT end the process with 0 and without a word."""
    bench = make_bench()
    bench.stand(0.1, 0.3)
    assert bench.stop(number) == 0
    assert bench.errors.read_text() == ""


@pytest.mark.parametrize(("given", "named"), [("jam_dely_s:=0.1", "jam_dely_s"), ("jam_delay_s:=-1.0", "0 to 1 s")])
def test_bad_parameters_get_one_line(make_bench: Callable[..., Bench], given: str, named: str) -> None:
    """An unknown parameter or a value out of range ends the process with 2 and one line that names it."""
    bench = make_bench("--ros-args", "-p", given, is_up=False)
    assert bench.process.wait(timeout=TIMEOUT_S) == 2
    lines = bench.errors.read_text().splitlines()
    assert len(lines) == 1
    assert named in lines[0]


def test_set_points_that_the_driver_would_refuse_are_refused(make_bench: Callable[..., Bench]) -> None:
    """Once the driver's limits are known, a set point beyond them is refused with both numbers; one within is taken."""
    bench = make_bench()
    bench.driver_says(JamState(min_vacuum_pa=5e3, max_vacuum_pa=45e3))
    bench.spin_until(lambda: bench.policy_says("45000"), "the set points of the start are objected to")
    assert bench.health["policy"].level == DiagnosticStatus.ERROR
    refused = bench.set_parameter("hold_vacuum_pa", 46e3)
    assert not refused.successful
    assert "45000" in refused.reason
    assert bench.set_parameter("hold_vacuum_pa", 38e3).successful
    assert bench.set_parameter("full_vacuum_pa", 45e3).successful
    bench.spin_until(lambda: bench.health["policy"].level == DiagnosticStatus.OK, "all is well")


@pytest.mark.parametrize("policy", ["fixed", "auto"])
def test_a_fixed_vacuum_that_the_driver_would_refuse_is_refused(make_bench: Callable[..., Bench], policy: str) -> None:
    """It is asked for at every landing with policy fixed, and named; with another policy it is no trouble."""
    given = ("full_vacuum_pa:=45000.0", "landing_vacuum_pa:=50000.0", f"policy:={policy}")
    bench = make_bench("--ros-args", *(word for each in given for word in ("-p", each)))
    bench.driver_says(JamState(min_vacuum_pa=5e3, max_vacuum_pa=45e3))
    if policy == "fixed":
        bench.spin_until(lambda: bench.policy_says("landing_vacuum_pa"), "the vacuum of the start is objected to")
        assert bench.health["policy"].level == DiagnosticStatus.ERROR
    answers: list[Any] = []

    def is_refused() -> bool:
        answers.append(bench.set_parameter("landing_vacuum_pa", 46e3))
        return not answers[-1].successful

    bench.spin_until(is_refused, "the driver's limits are known")
    assert "45000" in answers[-1].reason
    bench.health.pop("policy")
    bench.spin_until(lambda: "policy" in bench.health, "health is reported again")
    assert bench.health["policy"].level == (DiagnosticStatus.ERROR if policy == "fixed" else DiagnosticStatus.OK)
    assert bench.set_parameter("landing_vacuum_pa", 20e3).successful
    bench.spin_until(lambda: bench.health["policy"].level == DiagnosticStatus.OK, "all is well")


def test_a_stance_that_was_held_before_is_taken_up(make_bench: Callable[..., Bench]) -> None:
    """Channels that were let go since jam_command fell silent are jammed again once the body is seen at rest.

    And a driver that does not follow then is reported where it hurts, in its own words; somebody who vents is no fault.
    """
    bench = make_bench()
    stale = ChannelJamState(channel=CHANNELS[0], fault=Fault.COMMANDS_STALE)
    bench.driver_says(JamState(channels=[stale], refused_command="refused: an example"))
    bench.wait_more()
    assert bench.set_points_pa() == dict.fromkeys(CHANNELS, 0.0)
    bench.stand(0.1, 0.6)
    bench.spin_until(lambda: bench.set_points_pa() == dict.fromkeys(CHANNELS, 40e3), "the stance is held")
    bench.spin_until(lambda: bench.policy_says("an example"), "the refusal is reported")
    assert bench.health["policy"].level == DiagnosticStatus.ERROR
    by_hand = [ChannelJamState(channel=channel, reason=f"asked by {UNJAM.name}") for channel in CHANNELS]
    bench.driver_says(JamState(channels=by_hand))
    bench.spin_until(lambda: bench.policy_says("vented by a service"), "what somebody has asked for is reported")
    assert bench.health["policy"].level == DiagnosticStatus.OK
    bench.driver_says(JamState(channels=[*by_hand[:2], ChannelJamState(channel=CHANNELS[2], reason="let go")]))
    bench.spin_until(lambda: bench.policy_says(f"{CHANNELS[2]}: let go"), "what nobody has asked for is reported")
    assert bench.health["policy"].level == DiagnosticStatus.ERROR


def test_a_robot_that_nobody_held_is_left_soft(make_bench: Callable[..., Bench]) -> None:
    """A controller that finds channels vented for no reason of its own waits for a landing."""
    bench = make_bench()
    bench.driver_says(JamState(channels=[ChannelJamState(channel=CHANNELS[0])]))
    bench.stand(0.1, 0.6)
    bench.wait_more()
    assert bench.set_points_pa() == dict.fromkeys(CHANNELS, 0.0)


def test_an_imu_in_g_is_reported_and_moves_nothing(make_bench: Callable[..., Bench]) -> None:
    """Readings in g are an error on /diagnostics that names unit and safe mode, and give no event and no set point."""
    bench = make_bench()
    for index in range(100):
        bench.feel(1.0, 0.1 + index * INTERVAL_S)
    bench.spin_until(lambda: "unit" in bench.health["imu"].message, "the unit is reported")
    assert bench.health["imu"].level == DiagnosticStatus.ERROR
    assert "unavailable" in bench.health["imu"].message
    assert "kept" in bench.health["imu"].message
    assert bench.events == []
    bench.wait_more()
    assert bench.set_points_pa() == dict.fromkeys(CHANNELS, 0.0)
