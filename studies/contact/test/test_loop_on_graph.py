"""A landing of the leg on the graph in lockstep, and the same in the loop without ROS: to the bit."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from rosbags.highlevel import AnyReader

from domains import own_domain
from graph import Probe, Up
from jammkle_common import names
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_controller.core.landing import RATED_KG
from jammkle_controller.parameters import ControllerParameters
from jammkle_driver.parameters import DriverParameters
from jammkle_sim.robots.catalogue import robot_simulation
from jammkle_sim.robots.options import RobotOptions
from studies.contact.loop import STATE_PERIOD_S, AnkleLoop

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    import pytest

Column = list[tuple[int, Any]]
"""What a topic holds: stamps, ns, and values."""

LANDING = RobotOptions(behaviour="drop", imu="body", drop_height_m=0.1, payload_kg=0.3, release_time_s=2.0)
"""With 2 s in which the reservoir is evacuated: the policy has something to choose with."""
LOAD_KG = RATED_KG + LANDING.payload_kg
LASTS_S = 3.5
PLACES = {names.MANIFOLD_FRAME: names.MANIFOLD_PRESSURE, **names.PRESSURES}


def test_the_graph_lands_as_the_loop_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every sample of IMU, joints, tendons and pressures, every event, command and change of pump and valves agrees."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    on_graph, in_loop = landed_on_graph(tmp_path), landed_in_loop()
    for what, column in in_loop.items():
        there = on_graph[what]
        odd = next((pair for pair in zip(there, column, strict=False) if pair[0] != pair[1]), None)
        assert odd is None, (what, odd)
        assert len(there) == len(column), what
    asked_pa = [vacuum_pa for _, vacuum_pa in in_loop[names.JAM_COMMAND.name]]
    assert any(pa[names.ACHILLES] > 0.0 and pa[names.PERONEAL_LEFT] == 0.0 for pa in asked_pa)  # braced in the air
    assert all(pa > 0.0 for pa in asked_pa[-1].values())


def landed_on_graph(folder: Path) -> Mapping[str, Column]:
    """Land under `jammkle up --record`, and return what the bag holds."""
    options = ("behaviour", "imu", "drop_height_m", "payload_kg", "release_time_s")
    given = [word for name in options for word in ("-p", f"sim:{name}:={getattr(LANDING, name)}")]
    given += ["-p", f"controller:load_kg:={LOAD_KG}"]
    with own_domain() as domain_id:
        up = Up(domain_id, folder, "up", "--robot", "leg", "--record", "bag", "--speed", "0", *given)
        probe = Probe(domain_id)
        probe.listen(names.CLOCK)
        try:
            probe.spin_until(lambda: probe.clock_s() > LASTS_S, "it has landed")
        finally:
            probe.close()
            code = up.stop()
            sys.stdout.write(up.text())
    assert code == 0
    return columns_of(folder / "bag")


def columns_of(bag: Path) -> Mapping[str, Column]:
    """Return what the loop knows as well; of commands without a stamp their changes, by the time of the log."""
    readers: dict[str, Callable[[Any], Any]] = {
        names.IMU.name: lambda m: (vector(m.linear_acceleration), vector(m.angular_velocity)),
        names.JOINT_STATES.name: lambda m: {
            name: pair for name, *pair in zip(m.name, m.position.tolist(), m.velocity.tolist(), strict=True)
        },
        names.TENDON_STATES.name: lambda m: {each.name: (each.extension_m, each.tension_n) for each in m.tendons},
        names.JAM_COMMAND.name: lambda m: {each.channel: each.vacuum_pa for each in m.channels},
        names.CONTACT_EVENTS.name: lambda m: (m.magnitude, m.source, m.probability),
        names.LANDING.name: lambda m: (m.speed_m_s, m.chosen_vacuum_pa, m.reached_vacuum_pa, m.surprised, m.why),
        **{topic.name: lambda m: m.fluid_pressure for topic in PLACES.values()},
        **{topic.name: lambda m: m.data for topic in (names.PUMP_DUTY, *names.SOLENOIDS.values())},
    }
    found: dict[str, Column] = {topic: [] for topic in readers}
    with AnyReader([bag]) as reader:
        connections = [each for each in reader.connections if each.topic.removeprefix("/") in readers]
        for connection, log_ns, raw in reader.messages(connections=connections):
            message: Any = reader.deserialize(raw, connection.msgtype)
            topic, stamp = connection.topic.removeprefix("/"), getattr(message, "header", None)
            value = readers[topic](message)
            time_ns = log_ns if stamp is None else stamp.stamp.sec * NANOSECONDS_PER_SECOND + stamp.stamp.nanosec
            if 0 < time_ns <= LASTS_S * NANOSECONDS_PER_SECOND and (
                stamp is not None or value != (found[topic][-1][1] if found[topic] else 0.0)
            ):
                found[topic].append((time_ns, value))
    return found


def vector(of_message: Any) -> tuple[float, float, float]:
    return (of_message.x, of_message.y, of_message.z)


def landed_in_loop() -> Mapping[str, Column]:
    """Land without ROS, and return the same."""
    simulation = robot_simulation("leg", LANDING)
    ankle = simulation.ankle
    controller = ControllerParameters(imu_mount=LANDING.imu, hang_pitch_deg=LANDING.hang_pitch_deg, load_kg=LOAD_KG)
    loop = AnkleLoop(ankle, controller, DriverParameters(reservoir_volume_m3=LANDING.reservoir_volume_m3))
    topics = (names.IMU, names.JOINT_STATES, names.TENDON_STATES, *PLACES.values())
    found: dict[str, Column] = {topic.name: [] for topic in topics}
    for sample in simulation.samples(LASTS_S, 500):
        time_ns = round(sample.time_s * NANOSECONDS_PER_SECOND)
        if time_ns % round(STATE_PERIOD_S * NANOSECONDS_PER_SECOND) == 0:
            positions, rates = ankle.joint_positions(), ankle.joint_velocities()
            joints = {joint: [positions[joint], rates[joint]] for joint in positions}
            found[names.JOINT_STATES.name].append((time_ns, joints))
            tendons = {each.name: (each.extension_m, each.tension_n) for each in ankle.tendons()}
            found[names.TENDON_STATES.name].append((time_ns, tendons))
            pressures_pa = {names.MANIFOLD_FRAME: ankle.manifold_pressure_pa(), **ankle.channel_pressures_pa()}
            for place, pressure_pa in pressures_pa.items():
                found[PLACES[place].name].append((time_ns, pressure_pa))
        read = loop.step(sample.time_s)
        felt = ((read.force_x, read.force_y, read.force_z), (read.rate_x, read.rate_y, read.rate_z))
        found[names.IMU.name].append((time_ns, felt))
    found[names.JAM_COMMAND.name] = list(loop.commands)
    found[names.CONTACT_EVENTS.name] = [
        (event.time_ns, (event.magnitude, event.source.value, event.probability)) for event in loop.events
    ]
    chosen = loop.controller.policy.landing
    assert chosen is not None
    what = (chosen.speed_m_s, chosen.chosen_pa, chosen.reached_pa, chosen.surprised, chosen.why)
    found[names.LANDING.name] = [(chosen.time_ns, what)]
    driven: dict[str, Column] = {topic.name: [] for topic in (names.PUMP_DUTY, *names.SOLENOIDS.values())}
    for time_ns, command in loop.driven:
        of_topic = {names.PUMP_DUTY.name: command.pump_duty}
        of_topic |= {names.SOLENOIDS[channel].name: on for channel, on in command.solenoids.items()}
        for topic, value in of_topic.items():
            if value != (driven[topic][-1][1] if driven[topic] else 0.0):
                driven[topic].append((time_ns, value))
    return found | driven
