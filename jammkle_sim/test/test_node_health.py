"""The sim node on real DDS: what it says of bad input, failures, broken tendons and its own pace."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu
from std_msgs.msg import Float32

from jammkle_common import names

if TYPE_CHECKING:
    from collections.abc import Callable

STEP_NS = 500_000


def test_a_bad_duty_is_refused_aloud(start_graph: Callable[..., Any], fake: Any) -> None:
    """NaN and out of range: WARN with value and limit, the last good value kept; a good one clears it."""
    graph = start_graph(lambda _: fake, start_paused=True)
    reports = graph.record(DiagnosticArray, names.DIAGNOSTICS.name)
    duty = graph.publisher(Float32, names.PUMP_DUTY)
    duty.publish(Float32(data=0.25))
    graph.spin_until(lambda: fake.duty == 0.25, "the good duty")
    for bad, text in ((math.nan, "nan"), (1.5, "1.5"), (-0.1, "-0.1")):
        duty.publish(Float32(data=bad))

        def refused(text: str = text) -> bool:
            status = graph.latest_status(reports, "commands")
            return status is not None and f"pump/duty is {text}; it must be 0 to 1" in status.message

        graph.spin_until(refused, f"the refusal of {text}")
        assert graph.latest_status(reports, "commands").level == DiagnosticStatus.WARN
        assert fake.duty == 0.25
    duty.publish(Float32(data=0.75))
    graph.spin_until(lambda: fake.duty == 0.75, "the next good duty")
    graph.spin_until(lambda: graph.latest_status(reports, "commands").level == DiagnosticStatus.OK, "the all-clear")


def test_an_unstable_simulation_pauses_and_says_so(start_graph: Callable[..., Any], fake: Any) -> None:
    """ERROR with the reason, the clock stands, going on is refused; a reset helps."""
    fake.unstable_at = 100
    graph = start_graph(lambda _: fake, speed=0.0)
    reports = graph.record(DiagnosticArray, names.DIAGNOSTICS.name)
    graph.spin_until(
        lambda: bool(reports) and graph.latest_status(reports, "simulation").level == DiagnosticStatus.ERROR, "ERROR"
    )
    assert "rig 'fake' became unstable; paused until ~/reset" in graph.latest_status(reports, "simulation").message
    steps = fake.steps
    answer = graph.set_paused(False)
    assert not answer.success
    assert "call ~/reset" in answer.message
    assert fake.steps == steps
    assert graph.reset().success
    assert graph.set_paused(False).success
    graph.spin_until(lambda: fake.steps > steps, "time to go on")


def test_a_failure_answers_the_step_that_met_it(start_graph: Callable[..., Any], fake: Any) -> None:
    """Who asked for steps is answered that they were not all taken, and why."""
    fake.unstable_at = 100
    graph = start_graph(lambda _: fake, start_paused=True)
    answer = graph.step(1000)
    assert not answer.success
    assert "became unstable" in answer.message


def test_nan_never_leaves(start_graph: Callable[..., Any], fake: Any) -> None:
    """A sensor that gives NaN ends in ERROR and a pause, without a message and without a tick."""
    graph = start_graph(lambda _: fake, start_paused=True)
    imu = graph.record(Imu, names.IMU.name)
    clocks = graph.record(Clock, names.CLOCK.name)
    reports = graph.record(DiagnosticArray, names.DIAGNOSTICS.name)
    assert graph.step(4).success
    fake.force_z = math.nan
    answer = graph.step(4)
    assert not answer.success
    assert "the IMU gave a value that is not finite" in answer.message
    graph.spin_until(
        lambda: bool(reports) and graph.latest_status(reports, "simulation").level == DiagnosticStatus.ERROR, "ERROR"
    )
    assert graph.stamps_ns(imu) == [4 * STEP_NS]
    assert all(math.isfinite(message.linear_acceleration.z) for message in imu)
    assert graph.ticks_ns(clocks)[0] == 4 * STEP_NS


def test_a_broken_tendon_is_an_error(start_graph: Callable[..., Any], fake: Any) -> None:
    """ERROR names the tendon as soon as it breaks; a reset makes it whole."""
    graph = start_graph(lambda _: fake, start_paused=True)
    reports = graph.record(DiagnosticArray, names.DIAGNOSTICS.name)
    fake.broken = {"achilles_left"}
    assert graph.step(4).success
    graph.spin_until(
        lambda: bool(reports) and graph.latest_status(reports, "tendons").level == DiagnosticStatus.ERROR, "ERROR"
    )
    assert "achilles_left" in graph.latest_status(reports, "tendons").message
    assert graph.reset().success
    assert graph.step(4).success
    graph.spin_until(lambda: graph.latest_status(reports, "tendons").level == DiagnosticStatus.OK, "the all-clear")


def test_diagnostics_tell_the_state_in_simulated_time(start_graph: Callable[..., Any], fake: Any) -> None:
    """A report has the simulated time as stamp and value, and names state, pace and late cycles."""
    graph = start_graph(lambda _: fake, start_paused=True, speed=2.0)
    reports = graph.record(DiagnosticArray, names.DIAGNOSTICS.name)
    assert graph.step(3000).success
    graph.spin_until(
        lambda: bool(reports) and graph.stamps_ns(reports)[-1] == 3000 * STEP_NS, "a report after the steps"
    )
    values = graph.values_of(graph.latest_status(reports, "simulation"))
    assert values["state"] == "paused"
    assert values["simulated time (s)"] == "1.5000"
    assert values["target real-time factor"] == "2"
    assert values["achieved real-time factor"] == "0.000"
    assert values["late cycles"] == "0"
