"""A robot that calls joints by names of its own."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from sensor_msgs.msg import JointState

from graph import Probe, environment
from jammkle_common.names import JOINT_STATES, ROBOTS_JOINT_STATES

if TYPE_CHECKING:
    from collections.abc import Callable

NAMESPACE = "/lf_ankle"


def node(domain_id: int, *parameters: str, remaps: tuple[str, ...] = ()) -> subprocess.Popen[str]:
    """Start the node alone."""
    given = [word for parameter in parameters for word in ("-p", parameter)]
    given += [word for remap in remaps for word in ("-r", remap)]
    command = [sys.executable, "-m", "jammkle_bringup.robot_names", "--ros-args", "-r", f"__ns:={NAMESPACE}", *given]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment(domain_id))


def test_joints_come_by_our_names(domain_id: int, make_probe: Callable[..., Probe]) -> None:
    process = node(domain_id, "joints:=lf_foot_pitch=ankle_pitch, lf_foot_roll=-ankle_roll")
    try:
        probe = make_probe(NAMESPACE)
        probe.listen(JOINT_STATES)
        robot = probe.publisher(ROBOTS_JOINT_STATES)
        sent = JointState(name=["lf_foot_roll", "lf_knee", "lf_foot_pitch"], position=[0.1, 9.0, 0.2])
        sent.header.stamp.sec = 7

        def passed_on() -> bool:
            robot.publish(sent)
            return probe.has(JOINT_STATES)

        probe.spin_until(passed_on, "joint states come by our names")
        message = probe.last(JOINT_STATES)
        assert list(message.name) == ["ankle_roll", "ankle_pitch"]
        assert list(message.position) == [-0.1, 0.2]
        assert message.header.stamp.sec == 7
    finally:
        process.terminate()
        process.communicate(timeout=30)


def test_simulated_joints_come_by_the_robots_names(domain_id: int, make_probe: Callable[..., Probe]) -> None:
    """The other way round, by remaps alone."""
    ways = ("robot/joint_states:=joint_states", "joint_states:=robot/joint_states")
    process = node(domain_id, "joints:=lf_foot_roll=-ankle_roll", remaps=ways)
    try:
        probe = make_probe(NAMESPACE)
        probe.listen(ROBOTS_JOINT_STATES)
        simulated = probe.publisher(JOINT_STATES)

        def passed_on() -> bool:
            simulated.publish(JointState(name=["ankle_roll", "ankle_yaw"], position=[0.1, 0.3]))
            return probe.has(ROBOTS_JOINT_STATES)

        probe.spin_until(passed_on, "joint states come by the robot's names")
        message = probe.last(ROBOTS_JOINT_STATES)
        assert (list(message.name), list(message.position)) == (["lf_foot_roll"], [-0.1])
    finally:
        process.terminate()
        process.communicate(timeout=30)
    assert process.returncode == 0


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ((), "joints is empty"),
        (("joints:=rear=heel",), "'heel' is no joint of ours: use one of ankle_roll"),
    ],
)
def test_names_that_cannot_be_mapped_are_refused(domain_id: int, parameters: tuple[str, ...], words: str) -> None:
    process = node(domain_id, *parameters)
    _out, errors = process.communicate(timeout=60)
    assert process.returncode == 2
    assert words in errors
    assert "Traceback" not in errors


def test_parameters_without_ros_args_are_refused(domain_id: int) -> None:
    """They would be ignored, and a robot would run with others than were given."""
    command = [sys.executable, "-m", "jammkle_bringup.robot_names", "-p", "joints:=lf_foot_roll=-ankle_roll"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment(domain_id), timeout=60, check=False)
    assert done.returncode == 2
    assert done.stderr == "'-p' is no argument of a node: its parameters and remappings follow --ros-args\n"
