"""The sim node on real DDS: rates, clock, pause, step, reset, namespace."""

from __future__ import annotations

import itertools
import math
import time
from typing import TYPE_CHECKING, Any

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import FluidPressure, Imu, JointState
from std_msgs.msg import Bool, Float32, String
from std_srvs.srv import SetBool, Trigger

from jammkle_common import names
from jammkle_msgs.msg import ActuatorStates, TendonStates
from jammkle_msgs.srv import Step

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

STEP_NS = 500_000


def shifted(graph: Any, messages: list[Any], start_ns: int) -> list[tuple[int, list[tuple[float, ...]]]]:
    """Tendon states as time since a start and plain numbers."""
    return [
        (
            graph.stamp_ns(message.header.stamp) - start_ns,
            [(t.extension_m, t.extension_rate_m_s, t.tension_n) for t in message.tendons],
        )
        for message in messages
    ]


def test_every_topic_has_its_rate_to_the_nanosecond(start_graph: Callable[..., Any]) -> None:
    """Over half a simulated second each stream has exactly the stamps of its rate, on the grid."""
    graph = start_graph(start_paused=True, imu_rate_hz=1000)
    topics = [
        (Imu, names.IMU, 1_000_000),
        (JointState, names.JOINT_STATES, 2_000_000),
        (TendonStates, names.TENDON_STATES, 2_000_000),
        (WrenchStamped, names.LOAD_CELL, 2_000_000),
        (FluidPressure, names.MANIFOLD_PRESSURE, 10_000_000),
        *((FluidPressure, topic, 10_000_000) for topic in names.PRESSURES.values()),
    ]
    streams = [(graph.record(kind, topic.name), period_ns) for kind, topic, period_ns in topics]
    assert graph.step(1000).success
    for messages, period_ns in streams:
        expected = [period_ns * (index + 1) for index in range(500_000_000 // period_ns)]
        graph.spin_until(lambda m=messages, e=expected: len(m) >= len(e), f"{len(expected)} messages")
        assert graph.stamps_ns(messages) == expected


def test_the_hardware_says_when_it_took_each_command(start_graph: Callable[..., Any]) -> None:
    """actuator_states names every change at the step from which on it counts, and else repeats what holds at 100 Hz."""
    graph = start_graph(start_paused=True)
    reported = graph.record(ActuatorStates, names.ACTUATOR_STATES.name)
    duty = graph.publisher(Float32, names.PUMP_DUTY)
    solenoid = graph.publisher(Bool, names.SOLENOIDS[names.ACHILLES])
    assert graph.step(105).success
    duty.publish(Float32(data=0.5))
    graph.spin_until(lambda: reported[-1].pump_duty == 0.5, "the duty is acknowledged")
    assert graph.step(2).success
    solenoid.publish(Bool(data=True))
    graph.spin_until(lambda: any(reported[-1].energised), "the solenoid is acknowledged")
    assert graph.step(100).success
    graph.spin_until(lambda: graph.stamp_ns(reported[-1].header.stamp) == 200 * STEP_NS, "the rest")
    states = {
        graph.stamp_ns(each.header.stamp): (each.pump_duty, dict(zip(each.channels, each.energised, strict=True)))
        for each in reported
    }
    nothing = dict.fromkeys(names.CHANNELS, False)
    drawing = {**nothing, names.ACHILLES: True}
    expected = dict.fromkeys((40, 60, 80, 100), (0.0, nothing))
    expected |= {105: (0.5, nothing), 107: (0.5, drawing)}
    # What has just changed needs no repeating at 120 steps, nor does the very first report at 20.
    expected |= dict.fromkeys((140, 160, 180, 200), (0.5, drawing))
    states.pop(0, None)  # it may have come before the test's node was discovered
    assert states == {step * STEP_NS: state for step, state in expected.items()}


def test_clock_rises_and_follows_its_state(start_graph: Callable[..., Any]) -> None:
    """Every /clock is later than the one before, and was sent after the state with the same stamp."""
    graph = start_graph(speed=0.0)
    clocks = graph.record(Clock, names.CLOCK.name)
    states = graph.record(TendonStates, names.TENDON_STATES.name)
    graph.spin_until(lambda: len(clocks) > 300 and len(states) > 300, "300 ticks")
    ticks = graph.ticks_ns(clocks)
    assert all(earlier < later for earlier, later in itertools.pairwise(ticks))
    state_sent = {
        graph.stamp_ns(message.header.stamp): sent
        for sent, topic, message in graph.sent
        if topic == names.TENDON_STATES.name
    }
    clock_sent = {
        graph.stamp_ns(message.clock): sent for sent, topic, message in graph.sent if topic == names.CLOCK.name
    }
    common = state_sent.keys() & clock_sent.keys()
    assert len(common) > 250
    assert all(state_sent[time_ns] < clock_sent[time_ns] for time_ns in common)


def test_at_speed_one_simulated_time_stays_behind_real_time(start_graph: Callable[..., Any]) -> None:
    """No tick comes earlier than real time allows."""
    before_s = time.monotonic()
    graph = start_graph(speed=1.0)
    clocks = graph.record(Clock, names.CLOCK.name)
    graph.spin_until(lambda: bool(clocks) and graph.ticks_ns(clocks)[-1] > 500_000_000, "half a second")
    assert graph.ticks_ns(clocks)[-1] * 1e-9 <= time.monotonic() - before_s


def test_as_fast_as_possible_waits_for_no_clock(start_graph: Callable[..., Any]) -> None:
    """With speed 0 something is due after every cycle, and /diagnostics says how fast that is."""
    graph = start_graph(speed=0.0)
    clocks = graph.record(Clock, names.CLOCK.name)
    reports = graph.record(DiagnosticArray, names.DIAGNOSTICS.name)
    graph.spin_until(lambda: bool(clocks), "the first tick")
    assert [graph.sim.cycle() for _ in range(100)] == [0.0] * 100

    def values() -> dict[str, str]:
        status = graph.latest_status(reports, "simulation")
        return graph.values_of(status) if status else {}

    def is_measured() -> bool:
        return values().get("achieved real-time factor", "")[:1].isdigit()

    graph.spin_until(is_measured, "a measured factor")
    assert values()["target real-time factor"] == "as fast as possible"


def test_pause_stands_and_step_moves_exactly(start_graph: Callable[..., Any]) -> None:
    """Paused, the clock only repeats itself; a step moves it by exactly its steps, and shows the state."""
    graph = start_graph(speed=0.0)
    clocks = graph.record(Clock, names.CLOCK.name)
    states = graph.record(TendonStates, names.TENDON_STATES.name)
    graph.spin_until(lambda: bool(clocks), "the first tick")
    refused = graph.step(1)
    assert not refused.success
    assert "pause first with ~/set_paused" in refused.message
    assert graph.set_paused(True).success
    standing_ns = round(graph.step(1).simulated_time_s * 1e9)
    graph.spin_until(lambda: graph.ticks_ns(clocks)[-1] == standing_ns, "the clock of the step")
    for steps in (1, 3, 2000):
        answer = graph.step(steps)
        assert answer.success
        standing_ns += steps * STEP_NS
        assert round(answer.simulated_time_s * 1e9) == standing_ns
        graph.spin_until(
            lambda at=standing_ns: graph.ticks_ns(clocks)[-1] == at and graph.stamps_ns(states)[-1] == at,
            "clock and state",
        )
    count = len(clocks)
    # A standing clock is repeated for those who join late.
    graph.spin_until(lambda: len(clocks) > count, "the clock once more")
    assert set(graph.ticks_ns(clocks)[count:]) == {standing_ns}


def test_the_time_after_a_step_is_the_nearest_number(start_graph: Callable[..., Any]) -> None:
    """What ~/step answers is the decimal number itself, without the last bit of a sum or a product."""
    graph = start_graph(start_paused=True)
    assert [graph.step(steps).simulated_time_s for steps in (9, 2, 2, 7)] == [0.0045, 0.0055, 0.0065, 0.01]
    refused = graph.step(0)  # moves nothing, and is answered with the time as well
    assert (refused.success, refused.simulated_time_s) == (False, 0.01)
    assert "steps is 0; it must be 1 to 100000" in refused.message


def test_other_services_answer_while_steps_are_taken(start_graph: Callable[..., Any]) -> None:
    """A long ~/step blocks nobody: another call is answered (refused) before the steps are done."""
    graph = start_graph(start_paused=True)
    resume = graph.client(SetBool, names.SET_PAUSED)
    step = graph.client(Step, names.STEP).call_async(Step.Request(steps=20_000))
    graph.spin_until(lambda: graph.sim.time_ns > 0, "the first of the steps")
    pause = resume.call_async(SetBool.Request(data=False))
    graph.spin_until(pause.done, "answer of ~/set_paused")
    assert not step.done()
    assert not pause.result().success
    assert "still to take" in pause.result().message
    graph.spin_until(step.done, "answer of ~/step")
    assert step.result().success
    assert math.isclose(step.result().simulated_time_s, 10.0)


def test_every_request_for_steps_is_answered(start_graph: Callable[..., Any]) -> None:
    """Also one that comes when the steps of another are done and not yet answered; who comes in between is refused."""
    graph = start_graph(start_paused=True)
    clients = [graph.client(Step, names.STEP) for _ in range(3)]
    for _ in range(20):
        asked = [client.call_async(Step.Request(steps=1)) for client in clients]
        graph.spin_until(lambda asked=asked: all(each.done() for each in asked), "three answers")
        assert any(each.result().success for each in asked)


def test_a_reset_that_cannot_be_is_refused(start_graph: Callable[..., Any], tmp_path: Path) -> None:
    """The file of effects has gone since the start: the machine stays as it is, and the node lives."""
    effects = tmp_path / "effects.yaml"
    effects.write_text("payload: {mass_kg: 0.5}\n")
    graph = start_graph(start_paused=True, effects_file=str(effects))
    effects.unlink()
    graph.sim.set_parameters([Parameter("slope_deg", value=5.0)])
    refused = graph.call(Trigger, names.RESET, Trigger.Request())
    assert not refused.success
    assert str(effects) in refused.message
    assert graph.step(1).success


def test_reset_brings_the_same_run_again(start_graph: Callable[..., Any]) -> None:
    """After a reset, tendons and noise are equal to the bit, counted from the reset; time goes on."""
    graph = start_graph(start_paused=True, release_time_s=0.02)
    states = graph.record(TendonStates, names.TENDON_STATES.name)
    imu = graph.record(Imu, names.IMU.name)
    runs = []
    for start_ns, extra in ((0, 0), (603 * STEP_NS, 3)):
        states.clear()
        imu.clear()
        assert graph.step(600).success
        graph.spin_until(lambda: len(imu) == 150 and len(states) == 150, "150 of each")
        noise = [(message.linear_acceleration.z, message.angular_velocity.x) for message in imu]
        runs.append((shifted(graph, states, start_ns), noise))
        if not extra:
            assert graph.step(3).success  # off the grid of the outputs
            graph.spin_until(lambda: len(states) == 151, "the state off the grid")
        answer = graph.reset()
        assert answer.success
    assert runs[0] == runs[1]
    assert any(row[1][0][2] > 0.0 for row in runs[0][0]), "nothing happened in this run"


def test_commands_survive_a_reset(start_graph: Callable[..., Any], fake: Any) -> None:
    """The driver's commands still stand after a reset: it was the rig that went back, not the driver."""
    graph = start_graph(lambda _: fake, start_paused=True)
    graph.publisher(Float32, names.PUMP_DUTY).publish(Float32(data=0.5))
    graph.publisher(Bool, names.SOLENOIDS["achilles"]).publish(Bool(data=True))
    graph.spin_until(lambda: fake.duty == 0.5 and fake.energised["achilles"], "the commands")
    assert graph.reset().success
    assert fake.duty == 0.5
    assert fake.energised == {"peroneal_left": False, "peroneal_right": False, "achilles": True}


def test_late_joiners_get_parameters_and_time(start_graph: Callable[..., Any]) -> None:
    """Who comes during a pause still gets sim_parameters, as YAML, and the standing /clock."""
    graph = start_graph(start_paused=True, slope_deg=30.0)
    assert graph.step(10).success
    parameters = graph.record(String, names.SIM_PARAMETERS.name, latched=True)
    clocks = graph.record(Clock, names.CLOCK.name)
    graph.spin_until(lambda: bool(parameters) and bool(clocks), "parameters and clock")
    assert yaml.safe_load(parameters[0].data)["options"]["slope_deg"] == 30.0
    assert graph.ticks_ns(clocks)[0] == 10 * STEP_NS


def test_speed_changes_while_running(start_graph: Callable[..., Any], fake: Any) -> None:
    """A good speed is taken at once, a bad one refused with its range, and fixed parameters stay fixed."""
    graph = start_graph(lambda _: fake, speed=0.01)
    assert graph.sim.set_parameters([Parameter("speed", value=0.0)])[0].successful
    steps = fake.steps
    graph.spin_until(lambda: fake.steps - steps > 20_000, "ten seconds at once")
    refused = graph.sim.set_parameters([Parameter("speed", value=-1.0)])[0]
    assert not refused.successful
    assert graph.sim.get_parameter("speed").value == 0.0
    assert not graph.sim.set_parameters([Parameter("seed", value=3)])[0].successful


def test_topics_follow_the_namespace_and_the_clock_does_not(start_graph: Callable[..., Any], fake: Any) -> None:
    """With a namespace everything but /clock and /diagnostics moves into it."""
    graph = start_graph(lambda _: fake, namespace="lf_ankle", start_paused=True)
    topics = {publisher.topic_name for publisher in graph.sim.publishers}
    assert {"/clock", "/diagnostics", "/lf_ankle/imu/data", "/lf_ankle/achilles/pressure"} <= topics
    assert {subscription.topic_name for subscription in graph.sim.subscriptions} >= {
        "/lf_ankle/pump/duty",
        "/lf_ankle/achilles/solenoid",
    }
    assert all(service.service_name.startswith("/lf_ankle/sim/") for service in graph.sim.services)


@pytest.mark.parametrize("makes_it", [True, False])
def test_a_simulation_makes_the_clock_or_follows_it(
    start_graph: Callable[..., Any], fake: Any, *, makes_it: bool
) -> None:
    """Never both, whatever is set for all nodes: with both ends of one topic in a process Fast DDS can hang."""
    graph = start_graph(lambda _: fake, publish_clock=makes_it, use_sim_time=True)
    assert ("/clock" in {publisher.topic_name for publisher in graph.sim.publishers}) == makes_it
    assert ("/clock" in {subscription.topic_name for subscription in graph.sim.subscriptions}) != makes_it


def test_the_simulated_board_lets_go_when_nobody_commands(start_graph: Callable[..., Any]) -> None:
    """A duty that is not repeated is dropped, reported, and not taken again before a release of all."""
    graph = start_graph()
    reported = graph.record(ActuatorStates, names.ACTUATOR_STATES.name)
    health = graph.record(DiagnosticArray, names.DIAGNOSTICS.name)
    duty = graph.publisher(Float32, names.PUMP_DUTY)
    duty.publish(Float32(data=0.5))
    graph.spin_until(lambda: any(each.pump_duty == 0.5 for each in reported), "the duty is taken")
    graph.spin_until(lambda: reported[-1].host_silent and reported[-1].pump_duty == 0.0, "the board lets go")

    def reported_as_error() -> bool:
        lines = [status for array in health for status in array.status if status.name.endswith(": commands")]
        return any(line.level == DiagnosticStatus.ERROR for line in lines)

    graph.spin_until(reported_as_error, "the error is reported")
    duty.publish(Float32(data=0.7))
    graph.spin_until(lambda: reported[-1].host_silent, "it is still latched")
    assert reported[-1].pump_duty == 0.0
    duty.publish(Float32(data=0.0))
    graph.spin_until(lambda: not reported[-1].host_silent, "a release acknowledges it")
    duty.publish(Float32(data=0.7))
    graph.spin_until(lambda: any(each.pump_duty == pytest.approx(0.7) for each in reported), "it takes commands again")


def test_the_simulated_board_waits_while_time_stands(start_graph: Callable[..., Any]) -> None:
    """In a paused simulation a command by hand stays as it is: the board's time stands, too."""
    graph = start_graph(start_paused=True)
    reported = graph.record(ActuatorStates, names.ACTUATOR_STATES.name)
    duty = graph.publisher(Float32, names.PUMP_DUTY)
    duty.publish(Float32(data=0.5))
    graph.spin_until(lambda: bool(reported) and reported[-1].pump_duty == 0.5, "the duty is taken")
    begun_s = time.monotonic()
    graph.spin_until(lambda: time.monotonic() - begun_s > 0.5, "longer than the watchdog")
    assert not reported[-1].host_silent
    assert reported[-1].pump_duty == 0.5
