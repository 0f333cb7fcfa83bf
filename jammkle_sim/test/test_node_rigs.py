"""~/run_rig on real DDS: the same results as without the graph, samples on the topics, cancel, refusal, trouble."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import yaml
from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import FluidPressure, Imu
from std_msgs.msg import Bool, String

from jammkle_common import names
from jammkle_common.parameters import from_mapping
from jammkle_msgs.action import RunRig
from jammkle_msgs.msg import TendonState, TendonStates
from jammkle_sim.rigs.catalogue import RIGS, run_rig, scattered
from jammkle_sim.rigs.run import RunInProgress
from jammkle_sim.rigs.simulation import UnstableSimulationError

if TYPE_CHECKING:
    from collections.abc import Callable

SHORT_PULL = ("speed_m_s=0.1", "extension_m=0.02")
TEARING_PULL = ("speed_m_s=0.2", "extension_m=0.07")


class Goal:
    """One goal sent to the sim node of a graph, with its feedback."""

    def __init__(self, graph: Any, rig: str, options: tuple[str, ...] = (), repeats: int = 0, seed: int = 0) -> None:
        self._graph = graph
        self.feedback: list[RunRig.Feedback] = []
        goal = RunRig.Goal(rig=rig, options=list(options), repeats=repeats, seed=seed)
        client = graph.action_client(RunRig, names.RUN_RIG)
        sent = client.send_goal_async(goal, lambda message: self.feedback.append(message.feedback))
        graph.spin_until(sent.done, "the goal's acceptance")
        self.handle = sent.result()
        assert self.handle.accepted
        self._result = self.handle.get_result_async()

    def result(self) -> tuple[int, RunRig.Result]:
        """Wait for the end; return status and result."""
        self._graph.spin_until(self._result.done, "the goal's result")
        answer = self._result.result()
        return answer.status, answer.result

    def cancel(self) -> None:
        """Ask for the end, and wait until that was heard."""
        heard = self.handle.cancel_goal_async()
        self._graph.spin_until(heard.done, "the answer to the cancel request")
        assert heard.result().goals_canceling

    def wait_until_running(self) -> None:
        """Wait for the first feedback."""
        self._graph.spin_until(lambda: bool(self.feedback), "the first feedback")


@pytest.mark.parametrize(
    ("rig", "options", "given"),
    [
        ("tensile", (*SHORT_PULL, "vacuum_pa=50e3", "material=a85"),
         {"speed_m_s": 0.1, "extension_m": 0.02, "vacuum_pa": 50e3, "material": "a85"}),
        ("drop", ("foot=squash_ball",), {"foot": "squash_ball"}),
        ("landing", ("timestep_s=0.00025", "release_time_s=0.5"), {"timestep_s": 0.00025, "release_time_s": 0.5}),
    ],
)  # fmt: skip
def test_a_rig_measures_the_same_as_without_the_graph(
    start_graph: Callable[..., Any], rig: str, options: tuple[str, ...], given: dict[str, object]
) -> None:
    """The figures, and the IMU's samples on the topic, are those of run_rig with the same options."""
    graph = start_graph(start_paused=True, speed=0.0)
    imu = graph.record(Imu, names.IMU.name)
    status, result = Goal(graph, rig, options, seed=3).result()
    assert status == GoalStatus.STATUS_SUCCEEDED
    assert result.success, result.message
    alone = run_rig(rig, from_mapping(RIGS[rig].options, {**given, "seed": 3}), lambda _: None, lambda: False)
    assert {figure.name: list(figure.values) for figure in result.figures} == {
        name: [value] for name, value in alone.results.items()
    }
    if names.IMU.name in alone.topics:
        series = alone.topics[names.IMU.name]
        graph.spin_until(lambda: len(imu) >= len(series.time_s), "every sample of the IMU")
        assert [graph.stamp_ns(message.header.stamp) for message in imu] == [
            1_000_000 * (index + 1) for index in range(len(series.time_s))
        ]
        upward = [message.linear_acceleration.z for message in imu]
        assert upward == series.column("linear_acceleration_z_m_s2").tolist()
    else:
        assert not imu


def test_several_runs_scatter_as_without_the_graph(start_graph: Callable[..., Any]) -> None:
    """Each figure has a value per run, those of the rig's own scatter, with its unit."""
    graph = start_graph(speed=0.0)
    _, result = Goal(graph, "tensile", SHORT_PULL, repeats=3, seed=5).result()
    options = from_mapping(RIGS["tensile"].options, {"speed_m_s": 0.1, "extension_m": 0.02, "seed": 5})
    alone = [
        run_rig("tensile", scattered("tensile", options, repeat), lambda _: None, lambda: False) for repeat in range(3)
    ]
    figures = {figure.name: figure for figure in result.figures}
    assert list(figures["peak_force_n"].values) == [run.results["peak_force_n"] for run in alone]
    assert len(set(figures["peak_force_n"].values)) == 3
    assert figures["peak_force_n"].unit == "N"
    assert figures["energy_in_n_m"].unit == "N m"
    assert figures["share_lost"].unit == ""


def test_the_ankle_stands_still_meanwhile_and_time_goes_on(start_graph: Callable[..., Any], fake: Any) -> None:
    """The clock rises strictly through rig and ankle without a gap; the ankle takes no step while the rig runs."""
    graph = start_graph(lambda _: fake, start_paused=True, speed=0.0)
    assert graph.step(100).success
    clocks = graph.record(Clock, names.CLOCK.name)
    descriptions = graph.record(String, names.SIM_PARAMETERS.name, latched=True)
    goal = Goal(graph, "tensile", SHORT_PULL)
    steps_before = fake.steps
    assert goal.result()[0] == GoalStatus.STATUS_SUCCEEDED
    assert fake.steps == steps_before == 100
    rig_ns = graph.sim.time_ns - 50_000_000
    assert rig_ns == 2_000_000_000  # 1.5 s until the pull, 0.2 s up, 0.2 s back, 0.1 s of rest
    assert graph.set_paused(False).success
    graph.spin_until(lambda: fake.steps > 200, "the ankle to go on")
    ticks = [graph.stamp_ns(message.clock) for message in clocks]
    rising = [tick for tick in ticks if tick > 50_000_000]
    assert all(earlier < later for earlier, later in itertools.pairwise(rising))
    assert 50_000_000 + rig_ns in rising
    assert [yaml.safe_load(message.data)["rig"] for message in descriptions][-2:] == ["tensile", "fake"]


def test_progress_rises_to_one(start_graph: Callable[..., Any]) -> None:
    """Feedback tells the share of all runs, never falling, and ends at 1."""
    graph = start_graph(speed=0.0)
    goal = Goal(graph, "drop", repeats=2)
    goal.result()
    graph.spin_until(lambda: goal.feedback[-1].progress == 1.0, "the last feedback")
    shares = [feedback.progress for feedback in goal.feedback]
    assert shares == sorted(shares)
    assert all(0.0 <= share <= 1.0 for share in shares)


def test_a_paused_rig_is_cancelled(start_graph: Callable[..., Any], fake: Any) -> None:
    """The rig pauses with ~/set_paused, is cancelled all the same, and the ankle runs again as before."""
    graph = start_graph(lambda _: fake)
    goal = Goal(graph, "tensile")
    goal.wait_until_running()
    assert graph.set_paused(True).success
    stands_ns = graph.sim.time_ns
    assert "while rig 'tensile' runs" in graph.reset().message
    assert "while rig 'tensile' runs" in graph.step(1).message
    assert graph.sim.time_ns == stands_ns
    goal.cancel()
    status, result = goal.result()
    assert status == GoalStatus.STATUS_CANCELED
    assert not result.success
    assert result.message == "cancelled in tensile, run 1 of 1"
    steps = fake.steps
    graph.spin_until(lambda: fake.steps > steps, "the ankle to go on")
    assert graph.sim.time_ns >= stands_ns


@pytest.mark.parametrize(
    ("rig", "options", "repeats", "seed", "text"),
    [
        ("catapult", (), 1, 0, "rig 'catapult' does not exist; known are: tensile"),
        ("tensile", ("colour=red",), 1, 0, "unknown parameter 'colour'"),
        ("tensile", ("vacuum_pa",), 1, 0, "option 'vacuum_pa' has no '='"),
        ("tensile", ("vacuum_pa=1e6",), 1, 0, "vacuum_pa' is 1e+06; it must be 0 to 75000 Pa"),
        ("tensile", ("vacuum_pa=nan",), 1, 0, "vacuum_pa' is nan; it must be a finite number"),
        ("tensile", ("vacuum_pa=much",), 1, 0, "vacuum_pa' is 'much', and must be a number"),
        ("tensile", ("material=wood",), 1, 0, "material' is 'wood'; it must be one of multi, a30, a85"),
        ("drop", ("foot=jammed", "foot=standard"), 1, 0, "option 'foot' is given twice"),
        ("drop", ("seed=3",), 1, 0, "option 'seed=3' is refused"),
        ("tensile", ("membrane=no", "vacuum_pa=50e3"), 1, 0, "without a membrane it must be 0"),
        ("tensile", ("timestep_s=0.0003",), 1, 0, "must divide 0.001 s"),
        ("drop", (), 5000, 0, "repeats is 5000; it must be 0 to 1000"),
        ("drop", (), 1, 2**32 - 1, "seed is 4294967295; it must be 0 to 2147483647"),
    ],
)
def test_a_bad_goal_is_told_why(
    start_graph: Callable[..., Any],
    fake: Any,
    rig: str,
    options: tuple[str, ...],
    repeats: int,
    seed: int,
    text: str,
) -> None:
    """It is aborted with one line that names the value and the limit, and nothing moves."""
    graph = start_graph(lambda _: fake, start_paused=True)
    status, result = Goal(graph, rig, options, repeats, seed).result()
    assert status == GoalStatus.STATUS_ABORTED
    assert not result.success
    assert text in result.message
    assert "\n" not in result.message
    assert graph.sim.time_ns == 0
    assert graph.step(1).success


def test_a_second_goal_is_told_that_one_runs(start_graph: Callable[..., Any]) -> None:
    """The first goes on; the second names it and the way out."""
    graph = start_graph(speed=0.0)
    first = Goal(graph, "tensile", ("speed_m_s=0.001",))
    first.wait_until_running()
    status, result = Goal(graph, "drop").result()
    assert status == GoalStatus.STATUS_ABORTED
    assert "cannot run rig 'drop' while rig 'tensile' runs" in result.message
    first.cancel()
    assert first.result()[0] == GoalStatus.STATUS_CANCELED


def test_a_torn_tendon_shows(start_graph: Callable[..., Any]) -> None:
    """It reads BROKEN without force on the topic, is an ERROR until ~/reset, and stands in the result."""
    graph = start_graph(start_paused=True, speed=0.0)
    states = graph.record(TendonStates, names.TENDON_STATES.name)
    reports = graph.record(DiagnosticArray, names.DIAGNOSTICS.name)
    _, result = Goal(graph, "tensile", TEARING_PULL).result()
    assert result.success
    assert "tendon broken: peroneal_left in run 1" in result.message
    torn = next(figure for figure in result.figures if figure.name == "break_extension_m")
    assert torn.values[0] == pytest.approx(0.055, abs=0.001)
    last = states[-1].tendons[0]
    assert (last.name, last.condition, last.tension_n) == ("peroneal_left", TendonState.BROKEN, 0.0)
    conditions = [message.tendons[0].condition for message in states]
    assert conditions == sorted(conditions), "a torn tendon healed"

    def level_of_rig(level: bytes) -> Callable[[], bool]:
        return lambda: (
            graph.latest_status(reports, "rig") is not None and graph.latest_status(reports, "rig").level == level
        )

    graph.spin_until(level_of_rig(DiagnosticStatus.ERROR), "ERROR")
    assert "peroneal_left" in graph.latest_status(reports, "rig").message
    named = [status.message for report in reports for status in report.status if status.name.endswith(": tendons")]
    assert any("broken: peroneal_left; the next run of rig 'tensile'" in message for message in named)
    assert graph.reset().success
    graph.spin_until(level_of_rig(DiagnosticStatus.OK), "the all-clear")


def test_an_unstable_rig_says_what_it_was(
    start_graph: Callable[..., Any], fake: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The goal is aborted, ERROR names rig, run and options; the ankle goes on unharmed."""

    def blow_up(self: RunInProgress, rows: int) -> None:
        if self.rows_done >= 100:
            msg = f"simulation of rig 'drop' became unstable; it was: {self._options}"
            raise UnstableSimulationError(msg)
        take(self, rows)

    take = RunInProgress.advance
    monkeypatch.setattr(RunInProgress, "advance", blow_up)
    graph = start_graph(lambda _: fake, speed=0.0)
    reports = graph.record(DiagnosticArray, names.DIAGNOSTICS.name)
    status, result = Goal(graph, "drop", ("foot=standard",)).result()
    assert status == GoalStatus.STATUS_ABORTED
    assert "drop, run 1 of 1: simulation of rig 'drop' became unstable" in result.message
    assert "foot='standard'" in result.message
    graph.spin_until(
        lambda: (
            graph.latest_status(reports, "rig") is not None
            and graph.latest_status(reports, "rig").level == DiagnosticStatus.ERROR
        ),
        "ERROR",
    )
    assert "became unstable" in graph.latest_status(reports, "rig").message
    assert graph.latest_status(reports, "simulation").level != DiagnosticStatus.ERROR
    steps = fake.steps
    graph.spin_until(lambda: fake.steps > steps, "the ankle to go on")


def test_a_foot_that_wedges_ends_its_goal_and_nothing_else(start_graph: Callable[..., Any], fake: Any) -> None:
    """The goal is aborted with range, descent and way out; the ankle goes on, and the next goal runs."""
    graph = start_graph(lambda _: fake, speed=0.0)
    status, result = Goal(graph, "slip", ("foot=jammed", "slope_deg=20", "speed_m_s=0.02")).result()
    assert status == GoalStatus.STATUS_ABORTED
    assert "the force passed 245 N, the range of the load cell, at a descent of" in result.message
    steps = fake.steps
    graph.spin_until(lambda: fake.steps > steps, "the ankle to go on")
    assert Goal(graph, "tensile", ("extension_m=0.001",)).result()[1].success


def test_who_waits_for_a_rig_is_told_when_the_node_stops(start_graph: Callable[..., Any]) -> None:
    """A node that is stopped while a rig runs ends the goal first."""
    graph = start_graph()
    goal = Goal(graph, "tensile")
    goal.wait_until_running()
    graph.sim.shut_down()
    status, result = goal.result()
    assert status == GoalStatus.STATUS_ABORTED
    assert result.message == "tensile, run 1 of 1: the sim node was stopped"


def test_commands_wait_for_the_ankle(start_graph: Callable[..., Any], fake: Any) -> None:
    """What the driver commands while a rig runs does nothing to the rig, and stands for the ankle afterwards."""
    graph = start_graph(lambda _: fake, speed=0.0)
    solenoid = graph.publisher(Bool, names.SOLENOIDS["achilles"])
    pressures = graph.record(FluidPressure, names.PRESSURES["achilles"].name)
    goal = Goal(graph, "tensile", ("speed_m_s=0.001",))
    goal.wait_until_running()
    pressures.clear()

    def a_second_has_passed() -> bool:
        solenoid.publish(Bool(data=True))  # again and again, as the driver does: the board's watchdog goes on
        return len(pressures) > 100

    graph.spin_until(a_second_has_passed, "a second of the rig")
    graph.spin_until(lambda: fake.energised["achilles"], "the command")
    assert all(abs(message.fluid_pressure - 101_325.0) < 1000.0 for message in pressures)
    goal.cancel()
    goal.result()
    assert fake.energised["achilles"]


def test_a_rig_keeps_the_pace(start_graph: Callable[..., Any]) -> None:
    """At a hundredth of real time, as the parameter speed says, next to nothing of the rig has happened yet."""
    graph = start_graph(speed=0.01)
    goal = Goal(graph, "drop")
    goal.wait_until_running()
    begin_ns = graph.sim.time_ns
    graph.spin_until(lambda: len(goal.feedback) > 5, "half a second of feedback")
    assert graph.sim.time_ns - begin_ns < 10**9
    assert math.isfinite(goal.feedback[-1].simulated_time_s)
    goal.cancel()
    goal.result()


def test_numbers_on_the_topics_are_finite(start_graph: Callable[..., Any]) -> None:
    """A drop with a tendonless foot sends no tendon_states at all, and only finite pressures."""
    graph = start_graph(start_paused=True, speed=0.0)
    states = graph.record(TendonStates, names.TENDON_STATES.name)
    pressures = graph.record(FluidPressure, names.MANIFOLD_PRESSURE.name)
    assert Goal(graph, "drop", ("foot=standard",)).result()[1].success
    assert not states
    assert np.isfinite([message.fluid_pressure for message in pressures]).all()
    assert len(pressures) > 200
