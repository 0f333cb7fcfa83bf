"""A second simulation on the same graph gives way with one line, and never are there two clocks for long."""

from __future__ import annotations

import subprocess
import sys
import time
from typing import TYPE_CHECKING

import rclpy

from graph import Probe, Up, environment
from jammkle_bringup.core.namespace_lock import ClockLock
from jammkle_common.health import LOCKSTEP_LINE
from jammkle_common.names import ACTUATOR_STATES, CLOCK, DIAGNOSTICS, DRIVER_NODE, JAM_ALL, JAM_STATE, SET_PAUSED
from jammkle_common.runner import EXIT_BAD_INPUT
from jammkle_msgs.msg import ChannelJamState

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from processes import Processes

PATIENCE_S = 60.0
PAUSE_S = 1.5
"""Longer than any time-out of driver and board, s of simulated time."""


def test_of_two_simulations_started_together_one_gives_way(domain_id: int, make_probe: Callable[..., Probe]) -> None:
    """Exactly one ends, by itself, with exit code 2 and one line; the other makes the clock alone."""
    probe = make_probe()
    both = [
        subprocess.Popen(
            [sys.executable, "-m", "jammkle_sim"], env=environment(domain_id), stderr=subprocess.PIPE, text=True
        )
        for _ in range(2)
    ]
    try:
        end_s = time.monotonic() + PATIENCE_S
        while all(each.poll() is None for each in both) and time.monotonic() < end_s:
            probe.executor.spin_once(timeout_sec=0.1)
        gave_way = [each for each in both if each.poll() is not None]
        assert len(gave_way) == 1
        assert gave_way[0].returncode == 2
        said = gave_way[0].stderr.read().strip().splitlines() if gave_way[0].stderr else []
        assert len(said) == 1
        assert "/clock is made by another simulation, /sim: stop that one" in said[0]
        probe.listen(CLOCK)
        probe.spin_until(lambda: len(probe.heard[CLOCK.name]) > 10, "the clock ticks")
        assert any(each.poll() is None for each in both)
    finally:
        for each in both:
            each.terminate()
            each.communicate(timeout=PATIENCE_S)


def test_a_demo_refuses_a_graph_that_starts_beside_it(
    domain_id: int, make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    """A driver of the same name comes up when the demo has looked already: no verdict, one line, nothing left."""
    probe = make_probe()
    demo = Up(domain_id, tmp_path, "demo", "-o", str(tmp_path / "runs"))
    probe.spin_until(lambda: "recorder are there" in demo.text(), "the demo's graph is complete")
    started = demo.children()
    other = rclpy.create_node(DRIVER_NODE, context=probe.context)
    try:
        assert demo.wait(PATIENCE_S) == EXIT_BAD_INPUT, demo.text()
        assert f"a second node /{DRIVER_NODE}" in demo.text().splitlines()[-1]
        assert "the landing failed" not in demo.text()
        assert not any(each.is_running() for each in started)
    finally:
        other.destroy_node()
        demo.stop()


def test_one_lock_is_for_one_clock(tmp_path: Path) -> None:
    """Who comes second gets none while the first has it; another domain is another clock."""
    with ClockLock("5", tmp_path) as first, ClockLock("5", tmp_path) as second, ClockLock("6", tmp_path) as other:
        assert first.take()
        assert not second.take()
        assert other.take()
    with ClockLock("5", tmp_path) as again:
        assert again.take()


def test_a_pause_beside_anothers_clock_is_no_fault(processes: Processes, make_probe: Callable[..., Probe]) -> None:
    """The clock goes on, the ankle stands still: no sensor is silent, no board lets go, the jam goes on."""
    processes.start("clock", module="jammkle_sim", namespace="/first")
    processes.start("sim", "publish_clock:=false", "use_sim_time:=true", namespace="/second")
    processes.start("driver", "use_sim_time:=true", namespace="/second")
    probe = make_probe("/second")
    probe.listen(JAM_STATE, ACTUATOR_STATES, CLOCK, DIAGNOSTICS)
    probe.spin_until(lambda: {"/second/sim", "/second/driver"} <= in_step(probe), "all are in step")
    probe.wait_for_channels(ChannelJamState.UNJAMMED)
    assert probe.call(JAM_ALL).success
    probe.wait_for_channels(ChannelJamState.JAMMED)
    for paused in (True, False, True, False):
        assert probe.call(SET_PAUSED, data=paused).success
        probe.spin_until(lambda paused=paused: probe.last(ACTUATOR_STATES).plant_paused is paused, "it is known")
        begun_s = ticked_s(probe)
        probe.spin_until(lambda begun_s=begun_s: ticked_s(probe) > begun_s + PAUSE_S, "the clock has gone on")
        state = probe.last(JAM_STATE)
        assert not state.fault.text
        assert {channel.state for channel in state.channels} == {ChannelJamState.JAMMED}
        assert not probe.last(ACTUATOR_STATES).host_silent


def in_step(probe: Probe) -> set[str]:
    """Return the nodes that a simulation is waiting for, or has been."""
    statuses = (status for array in probe.heard[DIAGNOSTICS.name] for status in array.status)
    return {value.key for status in statuses if status.name.endswith(LOCKSTEP_LINE) for value in status.values}


def ticked_s(probe: Probe) -> float:
    """Return what the clock shows, s."""
    clock = probe.last(CLOCK).clock
    return float(clock.sec) + clock.nanosec * 1e-9
