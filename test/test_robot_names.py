"""A robot that calls joints and channels by names of its own: over DDS, with the driver behind."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING, Any

import pytest
from sensor_msgs.msg import JointState

from graph import Probe, Up, environment
from jammkle_common.names import (
    ACHILLES,
    CHANNELS,
    JAM_STATE,
    JOINT_STATES,
    ROBOTS_JAM_COMMAND,
    ROBOTS_JAM_STATE,
    ROBOTS_JOINT_STATES,
    Service,
)
from jammkle_msgs.msg import ChannelJamCommand, ChannelJamState, JamCommand

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

NAMESPACE = "/lf_ankle"
FILE = """
/**/robot_names:
  ros__parameters:
    joints: lf_foot_pitch=ankle_pitch, lf_foot_roll=-ankle_roll
    channels: rear=achilles, inner=peroneal_right
"""
THEIRS = ("peroneal_left", "inner", "rear")


def robots(name: str, kind: str) -> Service:
    """Return a service on the robot's side."""
    return Service("robot", name, kind, "")


JAM = robots("jam", "jammkle_msgs/srv/Jam")
UNJAM = robots("unjam", "jammkle_msgs/srv/Unjam")
REAR_JAM = robots("rear/jam", "std_srvs/srv/SetBool")


@pytest.fixture
def graph(start: Callable[..., Up], make_probe: Callable[..., Probe], tmp_path: Path) -> tuple[Up, Probe]:
    """Bring up driver and controller on the built-in plant, with the robot's names."""
    file = tmp_path / "names.yaml"
    file.write_text(FILE)
    up = start("up", "--hardware", "fake", "--robot-names", "--params", str(file), "--namespace", NAMESPACE)
    probe = make_probe(NAMESPACE)
    probe.listen(JAM_STATE, ROBOTS_JAM_STATE)
    probe.wait_until_up()
    return up, probe


def theirs(probe: Probe) -> dict[str, int]:
    """Return the state of each channel as the robot hears it."""
    state = probe.last(ROBOTS_JAM_STATE)
    return {} if state is None else {each.channel: each.state for each in state.channels}


def test_a_mission_speaks_in_the_robots_words(graph: tuple[Up, Probe]) -> None:
    """Jam and unjam by service, switch and stream; what is told has the robot's names; a driver that hangs is told."""
    up, probe = graph
    probe.spin_until(lambda: tuple(theirs(probe)) == THEIRS, "the robot hears its own names")
    answer = probe.call(JAM, channels=["rear"], vacuum_pa=50e3)
    assert answer.success, answer.message
    assert "rear" in answer.message
    assert ACHILLES not in answer.message
    probe.spin_until(lambda: theirs(probe)["rear"] == ChannelJamState.JAMMED, "rear is jammed")
    probe.wait_for_channels(ChannelJamState.JAMMED, ACHILLES)
    assert theirs(probe)["inner"] == ChannelJamState.UNJAMMED
    refused = probe.call(JAM, channels=[ACHILLES])
    assert not refused.success
    assert refused.message == f"unknown channel '{ACHILLES}': the channels are {', '.join(THEIRS)}"
    assert probe.call(UNJAM, channels=[]).success
    probe.wait_for_channels(ChannelJamState.UNJAMMED)
    assert probe.call(REAR_JAM, data=True).success
    probe.wait_for_channels(ChannelJamState.JAMMED, ACHILLES)
    assert probe.call(REAR_JAM, data=False).success
    probe.wait_for_channels(ChannelJamState.UNJAMMED)
    commands = probe.publisher(ROBOTS_JAM_COMMAND)
    wish = JamCommand(channels=[ChannelJamCommand(channel="inner", vacuum_pa=40e3)])

    def held() -> bool:
        commands.publish(wish)
        ours = probe.channel_states()["peroneal_right"]
        return theirs(probe)["inner"] == ours == ChannelJamState.JAMMED

    probe.spin_until(held, "inner is jammed by the stream")
    driver: Any = up.child("jammkle_driver")
    driver.suspend()
    try:
        hanging = probe.call(JAM, channels=["rear"])
    finally:
        driver.resume()
    assert not hanging.success
    assert "is the driver there?" in hanging.message


def node(domain_id: int, *parameters: str) -> subprocess.Popen[str]:
    """Start the node alone."""
    given = [word for parameter in parameters for word in ("-p", parameter)]
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
            return probe.last(JOINT_STATES) is not None

        probe.spin_until(passed_on, "joint states come by our names")
        message = probe.last(JOINT_STATES)
        assert list(message.name) == ["ankle_roll", "ankle_pitch"]
        assert list(message.position) == [-0.1, 0.2]
        assert message.header.stamp.sec == 7
    finally:
        process.terminate()
        process.communicate(timeout=30)


def test_a_simulation_is_heard_by_the_robots_names(domain_id: int, make_probe: Callable[..., Probe]) -> None:
    """The other way round; and where no driver is there, a request is answered and says so."""
    process = node(domain_id, "joints:=lf_foot_roll=-ankle_roll", "joints_of:=ankle", "channels:=rear=achilles")
    try:
        probe = make_probe(NAMESPACE)
        probe.listen(ROBOTS_JOINT_STATES)
        simulated = probe.publisher(JOINT_STATES)

        def passed_on() -> bool:
            simulated.publish(JointState(name=["ankle_roll", "ankle_yaw"], position=[0.1, 0.3]))
            return probe.last(ROBOTS_JOINT_STATES) is not None

        probe.spin_until(passed_on, "joint states come by the robot's names")
        message = probe.last(ROBOTS_JOINT_STATES)
        assert (list(message.name), list(message.position)) == (["lf_foot_roll"], [-0.1])
        answer = probe.call(JAM, channels=["rear"])
        assert not answer.success
        assert "is the driver there?" in answer.message
    finally:
        process.terminate()
        process.communicate(timeout=30)
    assert process.returncode == 0


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ((), "joints and channels are empty"),
        (("channels:=rear=heel",), "'heel' is no channel of ours: use one of " + ", ".join(CHANNELS)),
    ],
)
def test_names_that_cannot_be_mapped_are_refused(domain_id: int, parameters: tuple[str, ...], words: str) -> None:
    process = node(domain_id, *parameters)
    _out, errors = process.communicate(timeout=60)
    assert process.returncode == 2
    assert words in errors
    assert "Traceback" not in errors
