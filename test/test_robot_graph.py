"""Robots over real DDS: four drivers and controllers on one quadruped, and a leg that tells its gait."""

from __future__ import annotations

import json
import math
import signal
import statistics
from itertools import pairwise
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from graph import Probe, Up, messages_of
from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_common.names import (
    ACHILLES,
    CLOCK,
    DIAGNOSTICS,
    GAIT_PHASE,
    IMU,
    JAM_COMMAND,
    JAM_STATE,
    JOINT_STATES,
    ODOMETRY,
    PLANNED_CONTACT,
    PRESSURES,
    QUADRUPED_ANKLES,
    ROBOT_DESCRIPTION,
    TRUE_CONTACT,
)
from jammkle_msgs.msg import ChannelJamState

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from processes import Processes

    from jammkle_msgs.msg import JamState, TrueContact

TICKS = 20
PERIOD_NS = 4_000_000
"""Of the clock, for nine nodes."""
SENSORS = (IMU, PRESSURES[ACHILLES], TRUE_CONTACT, JOINT_STATES)


def test_a_quadruped_stands_jams_and_is_recorded(
    start: Callable[..., Up], make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    """One command brings up nine nodes; one more jams all four ankles; the bag has every foot and its truth."""
    manual = tmp_path / "manual.yaml"
    manual.write_text("/**/controller: {ros__parameters: {auto_at_start: false}}\n")
    bag = tmp_path / "bag"
    patient = ("-p", "sim:lockstep_timeout_s:=0.0")  # so that no board lets go of a foot while a driver gets no core
    up = start("up", "--robot", "quadruped", "--speed", "0", "--params", str(manual), "--record", str(bag), *patient)
    probes = {ankle: make_probe(f"/{ankle}") for ankle in QUADRUPED_ANKLES}
    for ankle, probe in probes.items():
        probe.listen(JAM_STATE, *SENSORS)
        probe.wait_until_up()
        probe.spin_until(lambda probe=probe: all(probe.has(topic) for topic in SENSORS), "every sensor is received")
        assert probe.last(IMU).header.frame_id == f"{ankle}/imu"
        assert probe.last(PRESSURES[ACHILLES]).header.frame_id == f"{ankle}/achilles"
        assert {"ankle_pitch", "hip", "knee", "abduction"} <= set(probe.last(JOINT_STATES).name)
    whole = make_probe()
    whole.listen(ROBOT_DESCRIPTION, ODOMETRY, JOINT_STATES, CLOCK)
    parts = (ROBOT_DESCRIPTION, ODOMETRY, JOINT_STATES)
    whole.spin_until(lambda: all(whole.has(topic) for topic in parts), "the whole robot is received")
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
        probe.wait_until_jammed()
    whole.spin_until(lambda: len(whole.node.get_publishers_info_by_topic(CLOCK.name)) == 1, "there is one clock")
    whole.received[CLOCK.name].clear()
    whole.spin_until(lambda: len(whole.received[CLOCK.name]) > TICKS and period_ns(whole) <= PERIOD_NS, "it ticks")
    assert period_ns(whole) == PERIOD_NS
    status = start("status", "--json", str(tmp_path / "status.json"))
    assert status.wait() == 0
    found = json.loads((tmp_path / "status.json").read_text())
    assert set(found["ankles"]) == set(QUADRUPED_ANKLES)
    assert any(line["name"] == "/sim: simulation" for line in found["health"])
    assert up.stop() == 0, up.text()
    assert len(messages_of(bag, f"/{ODOMETRY.name}")) > 10
    contacts = {ankle: messages_of(bag, f"/{ankle}/{TRUE_CONTACT.name}") for ankle in QUADRUPED_ANKLES}
    states = {ankle: messages_of(bag, f"/{ankle}/{JAM_STATE.name}") for ankle in QUADRUPED_ANKLES}
    assert all(feet[-1].stands and feet[-1].sliding_distance_m < 0.005 for feet in contacts.values())
    # How four jammed legs share the weight depends on how the robot leant when they were jammed; the sum does not, as
    # long as all are jammed: at the end the boards vent, and the robot bobs.
    begin_s = max(next(time_s(each) for each in own if is_jammed(each)) for own in states.values())
    later = [[each for each in own if time_s(each) > begin_s] for own in states.values()]
    end_s = min(next((time_s(each) for each in own if not is_jammed(each)), math.inf) for own in later)
    forces = [
        sum(foot.normal_force_n for foot in feet)
        for feet in zip(*contacts.values(), strict=False)
        if all(begin_s <= time_s(foot) < end_s for foot in feet)
    ]
    assert statistics.median(forces) == pytest.approx(7.2 * STANDARD_GRAVITY_M_S2, rel=0.02)
    for own in states.values():
        assert {channel.state for channel in own[-1].channels} <= {
            ChannelJamState.JAMMED,
            ChannelJamState.VENTING,
            ChannelJamState.UNJAMMED,
            ChannelJamState.UNKNOWN,
        }


def time_s(message: JamState | TrueContact) -> float:
    """Stamp of a message."""
    return float(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)


def is_jammed(state: JamState) -> bool:
    """Whether every channel is."""
    return all(channel.state == ChannelJamState.JAMMED for channel in state.channels)


def period_ns(probe: Probe) -> int:
    """Return the least time between two ticks that came, ns; a tick that is repeated counts once."""
    ticks_ns = sorted({tick.clock.sec * 10**9 + tick.clock.nanosec for tick in probe.received[CLOCK.name]})
    return min((after - before for before, after in pairwise(ticks_ns)), default=PERIOD_NS + 1)


def test_an_ankle_and_the_simulation_above_it_miss_each_other(
    processes: Processes, make_probe: Callable[..., Probe]
) -> None:
    """The survivor reports who died, and since when; no ankle reports another's driver."""
    probe = make_probe()
    probe.listen(DIAGNOSTICS)
    processes.start("sim", "robot:=quadruped", module="jammkle_sim.robot")
    for ankle in QUADRUPED_ANKLES[:2]:
        processes.start(ankle, "use_sim_time:=true", module="jammkle_driver", namespace=f"/{ankle}")
    lost, kept = (f"{ankle}/driver" for ankle in QUADRUPED_ANKLES[:2])
    probe.spin_until(
        lambda: all(name in probe.line("/sim: nodes").message for name in (lost, kept)), "the simulation receives both"
    )
    probe.spin_until(lambda: "/sim" in probe.line(f"/{kept}: nodes").message, "the ankle receives the simulation's")
    processes.send(QUADRUPED_ANKLES[0], signal.SIGKILL)

    def missed_alone() -> bool:
        said = probe.line("/sim: nodes").message
        return f"{lost} is dead" in said and f"{kept} is dead" not in said

    probe.spin_until(missed_alone, "the driver is missed, and it alone")
    found = probe.line("/sim: nodes")
    assert found.level == DiagnosticStatus.ERROR
    assert float({each.key: each.value for each in found.values}[f"{lost}, silent for (s)"]) > 2.0
    assert f"{lost} is dead" not in probe.line(f"/{kept}: nodes").message
    processes.send("sim", signal.SIGKILL)
    probe.spin_until(lambda: "/clock has not ticked" in probe.line(f"/{kept}: nodes").message, "the clock is missed")
    assert processes.said(QUADRUPED_ANKLES[1]).count("/clock has not ticked") == 1


def test_a_leg_that_walks_tells_its_gait_and_is_jammed_ahead(
    start: Callable[..., Up], make_probe: Callable[..., Probe]
) -> None:
    """The controller receives the plan, learns how early the foot comes, and asks for vacuum before it can be felt."""
    up = start("up", "--robot", "leg", "-p", "sim:behaviour:=walk", "--speed", "0")
    probe = make_probe()
    probe.listen(JAM_STATE, JAM_COMMAND, GAIT_PHASE, PLANNED_CONTACT, DIAGNOSTICS)
    probe.wait_until_up()

    def inputs() -> set[str]:
        return set(probe.line("controller: inputs").message.removeprefix("beside the IMU: ").split(", "))

    probe.spin_until(lambda: {"gait phase", "planned contact"} <= inputs(), "the controller receives the gait")
    begun_at: list[float] = []
    wanted = True

    def is_jammed_ahead() -> bool:
        nonlocal wanted
        before, command = wanted, probe.last(JAM_COMMAND)
        wanted = any(channel.vacuum_pa > 0.0 for channel in command.channels)
        if wanted and not before and probe.has(GAIT_PHASE):
            begun_at.append(probe.last(GAIT_PHASE).data)
        return any(0.75 < phase < 1.0 for phase in begun_at)

    probe.spin_until(is_jammed_ahead, "it is jammed ahead of a touch-down")
    probe.spin_until(
        lambda: {each.data for each in probe.received[PLANNED_CONTACT.name]} == {True, False},
        "stance and swing are published",
    )
    phases = [each.data for each in probe.received[GAIT_PHASE.name]]
    assert all(0.0 <= phase < 1.0 for phase in phases)
    rises = sorted(after - before for before, after in pairwise(phases) if after > before)
    assert rises[len(rises) // 2] == pytest.approx(0.02, abs=0.001)  # 10 ms of 0.5 s
    assert up.stop() == 0, up.text()
