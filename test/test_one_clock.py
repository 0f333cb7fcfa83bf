"""One /clock on a graph: who makes a second one is warned, or is refused, or lives in the first one's time."""

from __future__ import annotations

import signal
from typing import TYPE_CHECKING

import rclpy

from graph import Probe, Up
from jammkle_common.messages import LOCKSTEP_LINE
from jammkle_common.names import ACTUATOR_STATES, CLOCK, DIAGNOSTICS, DRIVER_NODE, JAM_ALL, JAM_STATE, SET_PAUSED
from jammkle_common.runner import EXIT_BAD_INPUT
from jammkle_msgs.msg import ChannelJamState

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from processes import Processes

PAUSE_S = 1.5
"""Longer than any time-out of driver and board, s of simulated time."""


def test_two_simulations_that_make_the_clock_both_warn(processes: Processes, make_probe: Callable[..., Probe]) -> None:
    """Each warns on diagnostics while there are two, with the way out, and no longer once the other has gone."""
    for name in ("first", "second"):
        processes.start(name, module="jammkle_sim", namespace=f"/{name}")
    probe = make_probe()
    probe.listen(DIAGNOSTICS)

    def warned(name: str) -> bool:
        return "/clock is made by 2 simulations: stop the others" in probe.line(f"/{name}/sim: simulation").message

    probe.spin_until(lambda: warned("first") and warned("second"), "both warn")
    processes.send("second", signal.SIGTERM)
    probe.spin_until(lambda: not warned("first"), "the one that is left is content")


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
        assert demo.wait() == EXIT_BAD_INPUT, demo.text()
        assert f"a second node /{DRIVER_NODE}" in demo.text().splitlines()[-1]
        assert "the landing failed" not in demo.text()
        assert not any(each.is_running() for each in started)
    finally:
        other.destroy_node()
        demo.stop()


def test_a_pause_beside_anothers_clock_is_no_fault(processes: Processes, make_probe: Callable[..., Probe]) -> None:
    """The clock goes on, the ankle stands still: no sensor is silent, no board lets go, the jam goes on."""
    patient = "lockstep_timeout_s:=0.0"  # so that no board lets go while a driver gets no core
    processes.start("clock", patient, module="jammkle_sim", namespace="/first")
    processes.start("sim", patient, "publish_clock:=false", "use_sim_time:=true", namespace="/second")
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
        begun_s = probe.clock_s()
        probe.spin_until(lambda begun_s=begun_s: probe.clock_s() > begun_s + PAUSE_S, "the clock has gone on")
        state = probe.last(JAM_STATE)
        assert not state.fault.text
        assert {channel.state for channel in state.channels} == {ChannelJamState.JAMMED}
        assert not probe.last(ACTUATOR_STATES).host_silent


def in_step(probe: Probe) -> set[str]:
    """Return the nodes that a simulation is waiting for, or has been."""
    return {value.key for status in probe.lines(LOCKSTEP_LINE) for value in status.values}
