"""A quadruped over real DDS: four drivers and controllers against one simulation, one clock, frames of their own."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import pytest

from graph import Probe, Up, messages_of
from jammkle_graph.names import (
    ACHILLES,
    CLOCK,
    IMU,
    JAM_STATE,
    JOINT_STATES,
    ODOMETRY,
    PRESSURES,
    QUADRUPED_ANKLES,
    ROBOT_DESCRIPTION,
    TRUE_CONTACT,
)
from jammkle_msgs.msg import ChannelJamState

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

SENSORS = (IMU, PRESSURES[ACHILLES], TRUE_CONTACT, JOINT_STATES)


@pytest.mark.timeout(300)
def test_a_quadruped_stands_jams_and_is_recorded(
    start: Callable[..., Up], make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    """One command brings up nine nodes; one more jams all four ankles; the bag has every foot and its truth."""
    manual = tmp_path / "manual.yaml"
    manual.write_text("/**/controller: {ros__parameters: {auto_at_start: false}}\n")
    bag = tmp_path / "bag"
    # Slow, since a driver that gets no processor for 0.2 s is taken for dead, and others may need the machine.
    up = start("up", "--robot", "quadruped", "--speed", "0.25", "--params", str(manual), "--record", str(bag))
    probes = {ankle: make_probe(f"/{ankle}") for ankle in QUADRUPED_ANKLES}
    for ankle, probe in probes.items():
        probe.listen(JAM_STATE, *SENSORS)
        probe.wait_until_up()
        probe.spin_until(lambda probe=probe: all(probe.last(topic) for topic in SENSORS), "every sensor is heard")
        assert probe.last(IMU).header.frame_id == f"{ankle}/imu"
        assert probe.last(PRESSURES[ACHILLES]).header.frame_id == f"{ankle}/achilles"
        assert {"ankle_pitch", "hip", "knee", "abduction"} <= set(probe.last(JOINT_STATES).name)
    whole = make_probe()
    whole.listen(ROBOT_DESCRIPTION, ODOMETRY, JOINT_STATES)
    parts = (ROBOT_DESCRIPTION, ODOMETRY, JOINT_STATES)
    whole.spin_until(lambda: all(whole.last(topic) for topic in parts), "the whole robot is heard")
    tree = ET.fromstring(whole.last(ROBOT_DESCRIPTION).data)  # noqa: S314 - our own
    moving = {joint.attrib["name"] for joint in tree.findall("joint") if joint.attrib["type"] != "fixed"}
    assert set(whole.last(JOINT_STATES).name) == moving
    links = {link.attrib["name"] for link in tree.findall("link")}
    assert {probe.last(topic).header.frame_id for probe in probes.values() for topic in SENSORS[:3]} <= links
    odometry = whole.last(ODOMETRY)
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "base_link")
    assert odometry.pose.pose.position.z == pytest.approx(0.28, abs=0.02)
    assert start("jam").wait() == 0
    for probe in probes.values():
        probe.wait_for_channels(ChannelJamState.JAMMED)
    assert len(probes["lf_ankle"].node.get_publishers_info_by_topic(CLOCK.name)) == 1
    status = start("status", "--json", str(tmp_path / "status.json"))
    assert status.wait() == 0
    found = json.loads((tmp_path / "status.json").read_text())
    assert set(found["ankles"]) == set(QUADRUPED_ANKLES)
    assert any(line["name"] == "/sim: simulation" for line in found["health"])
    assert up.stop() == 0, up.text()
    assert len(messages_of(bag, f"/{ODOMETRY.name}")) > 10
    for ankle in QUADRUPED_ANKLES:
        truth = messages_of(bag, f"/{ankle}/{TRUE_CONTACT.name}")
        assert truth[-1].stands
        assert truth[-1].normal_force_n == pytest.approx(17.7, rel=0.3)  # a quarter of 7.2 kg
        assert truth[-1].sliding_distance_m < 0.005
        states = messages_of(bag, f"/{ankle}/{JAM_STATE.name}")
        assert {channel.state for channel in states[-1].channels} <= {
            ChannelJamState.JAMMED,
            ChannelJamState.VENTING,
            ChannelJamState.UNJAMMED,
            ChannelJamState.UNKNOWN,
        }
