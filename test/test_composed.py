"""Nodes composed into one process: they are on the graph as ever, jam, and end in order."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING, Any

import pytest

from graph import REAL_TIMEOUT_S, Probe, environment
from jammkle_common.names import CLOCK, JAM, JAM_STATE, PUMP_DUTY, SET_AUTO, SOLENOIDS
from jammkle_msgs.msg import ChannelJamState

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

COMPOSED = (sys.executable, "-m", "jammkle_bringup.composed")
IN_NAMESPACE = ("--ros-args", "-r", "__ns:=/lf_ankle")


@pytest.fixture
def compose(domain_id: int) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start the process with arguments; it is ended after the test, whatever happens."""
    started: list[subprocess.Popen[str]] = []

    def begin(*arguments: str) -> subprocess.Popen[str]:
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
        started.append(subprocess.Popen([*COMPOSED, *arguments], env=environment(domain_id), text=True, **pipes))
        return started[-1]

    yield begin
    for process in started:
        process.kill()
        output, _ = process.communicate(timeout=30.0)
        sys.stdout.write(output)


def test_controller_and_driver_share_a_process(
    compose: Callable[..., Any], make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    """On hardware: they are on the graph as ever, jam, and on SIGTERM the driver has the last word."""
    own = tmp_path / "own.yaml"
    own.write_text(
        "/**/driver: {ros__parameters: {hardware: fake}}\n/**/controller: {ros__parameters: {auto_at_start: false}}\n"
    )
    process = compose("controller", "driver", *IN_NAMESPACE, "--params-file", str(own))
    probe = make_probe("/lf_ankle")
    probe.listen(JAM_STATE, PUMP_DUTY, *SOLENOIDS.values())
    probe.wait_until_up()
    assert probe.call(SET_AUTO, data=False).success
    assert probe.call(JAM, vacuum_pa=40e3).success
    commanded = (PUMP_DUTY, *SOLENOIDS.values())
    probe.spin_jammed_until(lambda: all(probe.last(topic).data for topic in commanded), "it jams")
    process.terminate()
    assert process.wait(REAL_TIMEOUT_S) == 0
    probe.spin_until(lambda: not any(probe.last(topic).data for topic in commanded), "pump and solenoids are let go")


def test_two_ankles_share_a_process(
    compose: Callable[..., Any], make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    """Each driver in its own namespace, with its own section of the file; one is jammed, and the other is not."""
    own = tmp_path / "own.yaml"
    own.write_text(
        "/**/driver: {ros__parameters: {hardware: fake}}\n"
        "/lf_ankle/driver: {ros__parameters: {default_vacuum_pa: 30000.0}}\n"
    )
    process = compose("lf_ankle/driver", "rf_ankle/driver", "--ros-args", "--params-file", str(own))
    left, right = (make_probe(f"/{ankle}") for ankle in ("lf_ankle", "rf_ankle"))
    for probe in (left, right):
        probe.listen(JAM_STATE)
        probe.wait_until_up()
    assert left.call(JAM).success
    by_default = [30e3, 30e3, 30e3]
    left.wait_until_jammed(lambda: [each.commanded_vacuum_pa for each in left.last(JAM_STATE).channels] == by_default)
    right.received[JAM_STATE.name].clear()
    right.wait_for_channels(ChannelJamState.UNJAMMED)
    process.terminate()
    assert process.wait(REAL_TIMEOUT_S) == 0


def test_a_simulated_ankle_fits_into_one_process(
    compose: Callable[..., Any], make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    """Three nodes, one clock, and the driver knows every channel; slow, as all of it has one core."""
    (tmp_path / "slow.yaml").write_text("/**/sim: {ros__parameters: {speed: 0.2}}\n")
    process = compose(*IN_NAMESPACE, "--params-file", str(tmp_path / "slow.yaml"))
    probe = make_probe("/lf_ankle")
    probe.listen(JAM_STATE, CLOCK)
    probe.wait_until_up()
    nodes = {"/lf_ankle/sim", "/lf_ankle/controller", "/lf_ankle/driver"}
    probe.spin_until(
        lambda: nodes <= {f"{space}/{name}" for name, space in probe.node.get_node_names_and_namespaces()},
        "all three are on the graph",
    )
    probe.spin_until(lambda: len(probe.node.get_publishers_info_by_topic(CLOCK.name)) == 1, "there is one clock")
    assert probe.last(JAM_STATE).header.stamp.sec < 1000  # simulated time
    process.terminate()
    assert process.wait(REAL_TIMEOUT_S) == 0


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (("pump",), "there is no node 'pump'; known are: sim, controller, driver"),
        (("lf_ankle/sim",), "there is no node 'lf_ankle/sim'"),
        (("lf_ankle/driver", *IN_NAMESPACE), "'lf_ankle/driver' and __ns:= exclude each other"),
        (("controller", "driver", "--ros-args", "-p", "driver:max_vacuum_pa:=-1.0"), "max_vacuum_pa"),
    ],
)
def test_bad_input_is_one_line(domain_id: int, arguments: tuple[str, ...], why: str) -> None:
    """A node that there is none of, and a parameter of one of them; what was made before goes in order."""
    done = subprocess.run(
        [*COMPOSED, *arguments],
        env=environment(domain_id),
        capture_output=True,
        text=True,
        check=False,
        timeout=REAL_TIMEOUT_S,
    )
    assert done.returncode == 2
    assert why in done.stderr
    assert "Traceback" not in done.stderr
