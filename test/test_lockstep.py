"""Simulated time waits for all that steer: the same seed gives the same bag, and nobody can make it stand still."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from builtin_interfaces.msg import Time
from same_bag import differences, recorded
from std_msgs.msg import Header

from graph import environment, interface
from jammkle_common.names import (
    ACTUATOR_STATES,
    CLOCK,
    DIAGNOSTICS,
    JAM_ALL,
    JAM_STATE,
    LOCKSTEP,
    RESET,
    SET_AUTO,
    SET_PAUSED,
    STEP,
    UNJAM_ALL,
)
from jammkle_common.qos import answer_qos
from jammkle_msgs.msg import ChannelJamState
from studies.faults.busy import busy_loops

if TYPE_CHECKING:
    from collections.abc import Callable

    from processes import Processes

    from graph import Probe, Up

CHUNK_STEPS = 500
"""Steps of 0.5 ms that are taken at once."""
EXAMPLE = Path(__file__).parents[1] / "docs" / "examples" / "in_step.py"


FOR_EVER = ("-p", "sim:lockstep_timeout_s:=0.0")
RECORDED = ("--record", "bag")


def paused_graph(start: Callable[..., Up], probe: Probe, *arguments: str) -> Up:
    """Bring a graph up that waits at time zero."""
    up = start("up", "-p", "sim:start_paused:=true", *arguments)
    probe.spin_until(lambda: "jammkle: up; paused" in up.text(), "the graph is up")
    return up


def go_on(probe: Probe, chunks: int) -> None:
    """Take chunks of steps."""
    for _ in range(chunks):
        assert probe.call(STEP, steps=CHUNK_STEPS).success


def ask_for_jams(probe: Probe) -> None:
    """Take over by hand, vent and jam, each at a stamp of its own, and leave it to the controller again."""
    assert probe.call(SET_AUTO, data=False).success
    assert probe.call(UNJAM_ALL).success
    go_on(probe, 2)
    assert probe.call(JAM_ALL).success
    go_on(probe, 2)
    assert probe.call(SET_AUTO, data=True).success
    go_on(probe, 3)


def reports(probe: Probe) -> str:
    """Return what was last reported of lockstep."""
    return str(probe.line("/sim: lockstep").message)


def steps_in_progress(probe: Probe) -> Any:
    """Ask for a chunk of steps, and return its future."""
    kind = interface(STEP.service_type)
    client = probe.node.create_client(kind, STEP.path)
    probe.spin_until(client.service_is_ready, "steps are offered")
    return client.call_async(kind.Request(steps=CHUNK_STEPS))


def bag_of(up: Up) -> Path:
    """Return the bag of a graph."""
    return up.output.parent / "bag"


def test_the_same_seed_gives_the_same_bag_on_any_machine(
    start: Callable[..., Up], make_probe: Callable[..., Probe]
) -> None:
    """Idle, and beside four busy loops with a driver that is stopped for a while, every message agrees to the byte.

    Both are waited for without end: by default who does not answer for a second, on whatever machine, is gone without.
    """
    probe = make_probe()
    up = paused_graph(start, probe, *RECORDED, *FOR_EVER)
    go_on(probe, 6)
    ask_for_jams(probe)
    assert up.stop() == 0
    other = paused_graph(start, probe, *RECORDED, *FOR_EVER)
    probe.listen(DIAGNOSTICS)
    driver = other.child("jammkle_driver")
    with busy_loops():
        go_on(probe, 5)
        driver.send_signal(signal.SIGSTOP)
        steps = steps_in_progress(probe)
        probe.spin_until(lambda: "time stands still until /driver answers" in reports(probe), "it is waited for")
        assert not steps.done()
        driver.send_signal(signal.SIGCONT)
        probe.spin_until(steps.done, "the steps are taken")
        ask_for_jams(probe)
    assert other.stop() == 0
    assert differences(bag_of(up), bag_of(other), 3_250_000_000) == []


def test_time_that_runs_freely_waits_for_nobody(start: Callable[..., Up], make_probe: Callable[..., Probe]) -> None:
    """With `lockstep` false an ankle jams as in step, and a stopped driver is not waited for: the board vents."""
    probe = make_probe()
    # slowly, so that a busy machine keeps up
    up = start("up", "--speed", "0.2", "-p", "sim:lockstep:=false", "-p", "controller:auto_at_start:=false")
    probe.listen(JAM_STATE, ACTUATOR_STATES, CLOCK)
    probe.wait_until_up()
    probe.spin_until(lambda: probe.call(JAM_ALL).success, "the jam is taken")
    probe.wait_until_jammed()
    driver = up.child("jammkle_driver")
    driver.send_signal(signal.SIGSTOP)
    stopped_s = probe.last(CLOCK).clock.sec
    probe.spin_until(lambda: probe.last(CLOCK).clock.sec > stopped_s + 2, "time goes on")
    probe.spin_until(lambda: not any(probe.last(ACTUATOR_STATES).energised), "the board has let go")
    driver.send_signal(signal.SIGCONT)
    assert up.stop() == 0


@pytest.mark.slow
def test_a_leg_with_efforts_and_odometry_gives_the_same_bag(
    start: Callable[..., Up], make_probe: Callable[..., Probe]
) -> None:
    """What the controller must know of its leg is there before the first step."""
    probe, bags = make_probe(), []
    for _ in range(2):
        given = ("-p", "controller:use_efforts:=true", "-p", "controller:use_odometry:=true")
        up = paused_graph(start, probe, "--robot", "leg", *RECORDED, *FOR_EVER, *given)
        go_on(probe, 8)
        assert up.stop() == 0
        bags.append(bag_of(up))
    assert differences(*bags, 1_900_000_000) == []
    assert len(recorded(bags[0], 1_900_000_000)["/odom"]) > 100


@pytest.mark.slow
@pytest.mark.parametrize("robot", [(), ("--robot", "leg"), ("--robot", "quadruped")], ids=["ankle", "leg", "quadruped"])
def test_the_same_seed_gives_the_same_bag_at_any_speed(
    start: Callable[..., Up], make_probe: Callable[..., Probe], robot: tuple[str, ...]
) -> None:
    """As fast as it goes, in real time, and at 0.3 of it beside four busy loops."""
    bags = [ran(start, make_probe(), *robot, "--speed", speed) for speed in ("0", "1")]
    with busy_loops():
        bags.append(ran(start, make_probe(), *robot, "--speed", "0.3"))
    until_ns = round(RUN_S * 1e9)
    for bag in bags[1:]:
        assert differences(bags[0], bag, until_ns) == []
    assert sum(map(len, recorded(bags[0], until_ns).values())) > 1000 * RUN_S


RUN_S = 10.0
"""Simulated time of each run."""


def ran(start: Callable[..., Up], probe: Probe, *arguments: str) -> Path:
    """Let a graph run from its start, without a pause, and return its bag."""
    up = paused_graph(start, probe, *RECORDED, *FOR_EVER, *arguments)
    probe.listen(CLOCK)
    assert probe.call(SET_PAUSED, data=False).success
    probe.spin_until(lambda: probe.last(CLOCK).clock.sec > RUN_S, "it has run")
    assert up.stop() == 0
    return bag_of(up)


@pytest.mark.slow
def test_a_driver_under_a_debugger_is_waited_for(start: Callable[..., Up], make_probe: Callable[..., Probe]) -> None:
    """Also when the graph has forgotten it, as DDS does with a process that says nothing for 20 s."""
    probe = make_probe()
    up = paused_graph(start, probe, *RECORDED, *FOR_EVER)
    go_on(probe, 1)
    for name in ("jammkle_driver", "jammkle_controller"):
        child = up.child(name)
        child.send_signal(signal.SIGSTOP)
        steps, stopped_s = steps_in_progress(probe), time.monotonic()
        while time.monotonic() - stopped_s < FORGOTTEN_S:
            probe.executor.spin_once(timeout_sec=0.1)
            assert not steps.done()
        child.send_signal(signal.SIGCONT)
        probe.spin_until(steps.done, "the steps are taken")
    assert up.stop() == 0


FORGOTTEN_S = 30.0
"""Longer than the lease of a participant of Fast DDS."""


def test_a_recorder_that_is_stopped_misses_nothing_and_shifts_nothing(
    start: Callable[..., Up], make_probe: Callable[..., Probe]
) -> None:
    """After SIGSTOP for longer than it is waited for, every sample and command is there, at the time it was said."""
    probe = make_probe()
    up = start("up", "--record", "bag", "--speed", "0.3", "-p", "sim:lockstep_timeout_s:=5.0")
    probe.listen(CLOCK, DIAGNOSTICS)
    probe.spin_until(lambda: probe.clock_s() > 1.8, "the ankle is jammed")
    recorder = next(each for each in up.children() if "record" in each.cmdline())
    recorder.send_signal(signal.SIGSTOP)
    stopped_s = probe.clock_s()
    probe.spin_until(lambda: probe.clock_s() > stopped_s + 0.5, "time has gone on without it")
    probe.received[DIAGNOSTICS.name].clear()
    recorder.send_signal(signal.SIGCONT)
    probe.spin_until(lambda: reports(probe).startswith("in step") and "/recorder" in reports(probe), "it has caught up")
    probe.spin_until(lambda: probe.clock_s() > stopped_s + 2.0, "time goes on")
    assert up.stop() == 0
    begin_ns, end_ns = round((stopped_s - 0.5) * 1e9), round((stopped_s + 1.5) * 1e9)
    found = recorded(bag_of(up), end_ns)
    for topic, period_ns in (("/imu/data", 2_000_000), ("/clock", 2_000_000), ("/achilles/pressure", 10_000_000)):
        log_ns = [at_ns for at_ns, _ in found[topic] if at_ns > begin_ns]
        assert log_ns == list(range(log_ns[0], log_ns[-1] + 1, period_ns)), topic
    for topic in ("/achilles/solenoid", "/jam_command"):  # repeated at 20 Hz, on the grid of simulated time
        grid = {at_ns for at_ns, _ in found[topic] if at_ns > begin_ns and at_ns % 50_000_000 == 0}
        assert sorted(grid) == list(range(min(grid), max(grid) + 1, 50_000_000)), topic


def test_a_node_of_ones_own_takes_part_in_ten_lines(
    start: Callable[..., Up], make_probe: Callable[..., Probe], domain_id: int
) -> None:
    """The example of the docs is waited for; killed, it is named and given up; so is whoever gives wrong answers."""
    probe = make_probe()
    probe.listen(DIAGNOSTICS, CLOCK)
    paused_graph(start, probe, *RECORDED)
    mission = subprocess.Popen([sys.executable, EXAMPLE], env=environment(domain_id))
    try:
        probe.spin_until(lambda: reports(probe) == "in step: /controller, /driver, /mission, /recorder", "it is known")
        go_on(probe, 1)
        mission.send_signal(signal.SIGSTOP)
        steps = steps_in_progress(probe)
        probe.spin_until(lambda: "/mission has not answered for 1 s" in reports(probe), "it is given up")
        probe.spin_until(steps.done, "time goes on without it")
        mission.send_signal(signal.SIGCONT)
        probe.spin_until(lambda: reports(probe).startswith("in step: /controller, /driver, /mission"), "it is back")
    finally:
        mission.kill()
        mission.wait()
    guest = probe.node.create_publisher(Header, LOCKSTEP.name, answer_qos())
    probe.spin_until(lambda: guest.get_subscription_count() > 0, "it is listened to")

    for stamp, reported in (
        (Time(sec=1_000_000), "/guest says it is done with 1000000.0000 s"),
        (Time(), "/guest keeps saying that it is done with 0.0000 s"),
        (None, "/guest answers twice: two nodes have that name"),  # done with the latest tick
    ):

        def nonsense(stamp: Time | None = stamp, reported: str = reported) -> bool:
            guest.publish(Header(frame_id="/guest", stamp=stamp or probe.last(CLOCK).clock))
            return reported in reports(probe)

        probe.spin_until(nonsense, reported)
    before_s = probe.clock_s()
    go_on(probe, 1)
    probe.spin_until(lambda: probe.clock_s() > before_s, "time goes on by steps")
    assert probe.call(SET_PAUSED, data=False).success
    probe.spin_until(lambda: probe.clock_s() > before_s + 0.5, "time runs on")


def test_a_reset_leaves_no_fault_behind(start: Callable[..., Up], make_probe: Callable[..., Probe]) -> None:
    """Jammed, evacuating and vented: pressures jump by a reset, and nobody takes that for a leak or a bad sensor."""
    probe = make_probe()
    probe.listen(JAM_STATE)
    by_hand = ("-p", "controller:auto_at_start:=false", "-p", "sim:release_time_s:=3600.0")
    paused_graph(start, probe, *FOR_EVER, *by_hand)
    go_on(probe, 1)
    for service, chunks in ((JAM_ALL, 4), (JAM_ALL, 1), (UNJAM_ALL, 1), (JAM_ALL, 4), (UNJAM_ALL, 4)):
        assert probe.call(service).success
        go_on(probe, chunks)
        assert probe.call(RESET).success
        go_on(probe, 6)
        assert ChannelJamState.FAULT not in probe.channel_states().values(), (service, probe.last(JAM_STATE))


def test_a_simulation_that_is_started_anew_is_taken_up(processes: Processes, make_probe: Callable[..., Probe]) -> None:
    """A clock that jumps back stops nobody: time-outs count from there, and the ankle is jammed again."""
    probe = make_probe()
    probe.listen(JAM_STATE, CLOCK, DIAGNOSTICS)
    processes.start("controller", "use_sim_time:=true")
    processes.start("driver", "use_sim_time:=true")
    processes.start("sim")
    probe.wait_for_channels(ChannelJamState.JAMMED)
    probe.spin_until(lambda: probe.clock_s() > 8.0, "it has gone on for longer than a discovery takes")
    processes.send("sim", signal.SIGKILL)
    processes.start("sim", "speed:=0.2")  # so that its first eight seconds are not missed
    probe.received[CLOCK.name].clear()
    probe.spin_until(lambda: 0.0 < probe.clock_s() < 8.0, "time has begun anew")
    probe.received[DIAGNOSTICS.name].clear()
    probe.spin_until(lambda: reports(probe) == "in step: /controller, /driver", "both are taken up")
    probe.received[JAM_STATE.name].clear()
    probe.wait_for_channels(ChannelJamState.JAMMED)
