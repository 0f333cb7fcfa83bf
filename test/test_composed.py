"""Nodes composed into one process: they are on the graph as ever, jam, and end in order."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from graph import Probe, environment
from jammkle_graph.names import JAM, JAM_STATE, PUMP_DUTY, SET_AUTO, SOLENOIDS
from jammkle_msgs.msg import ChannelJamState

if TYPE_CHECKING:
    from collections.abc import Callable

COMPOSED = (sys.executable, "-m", "jammkle_bringup.composed")


def test_one_process_is_a_whole_graph(domain_id: int, make_probe: Callable[..., Probe]) -> None:
    """Slow, so that a busy machine does not matter: three nodes in a namespace, a jam, and on SIGINT the last word."""
    arguments = ("--ros-args", "-r", "__ns:=/lf_ankle", "-p", "sim:speed:=0.3", "-p", "controller:auto_at_start:=false")
    process = subprocess.Popen(
        [*COMPOSED, *arguments], env=environment(domain_id), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        probe = make_probe("/lf_ankle")
        probe.listen(JAM_STATE, PUMP_DUTY, *SOLENOIDS.values())
        probe.wait_until_up()
        nodes = {"/lf_ankle/sim", "/lf_ankle/controller", "/lf_ankle/driver"}
        probe.spin_until(
            lambda: nodes <= {f"{space}/{name}" for name, space in probe.node.get_node_names_and_namespaces()},
            "all three are on the graph",
        )
        assert probe.call(SET_AUTO, data=False).success
        assert probe.call(JAM, vacuum_pa=40e3).success
        probe.wait_for_channels(ChannelJamState.JAMMED)
        process.terminate()
        assert process.wait(30.0) == 0
        told = (PUMP_DUTY, *SOLENOIDS.values())
        probe.spin_until(lambda: not any(probe.last(topic).data for topic in told), "pump and solenoids are let go")
    finally:
        process.kill()
        output, _ = process.communicate(timeout=30.0)
        sys.stdout.write(output)


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (("pump",), "there is no node 'pump'; known are: sim, controller, driver"),
        (("controller", "driver", "--ros-args", "-p", "driver:max_vacuum_pa:=-1.0"), "max_vacuum_pa"),
    ],
)
def test_bad_input_is_one_line(domain_id: int, arguments: tuple[str, ...], why: str) -> None:
    """A node that there is none of, and a parameter of one of them; what was made before goes in order."""
    done = subprocess.run(
        [*COMPOSED, *arguments], env=environment(domain_id), capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 2
    assert why in done.stderr
    assert "Traceback" not in done.stderr
