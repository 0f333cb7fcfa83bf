"""What the page on integration says is tried: a robot's own stack around one ankle, whose hardware is plain numbers."""

from __future__ import annotations

import importlib.util
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import WrenchStamped
from lifecycle_msgs.msg import Transition
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Imu
from std_msgs.msg import Bool

from graph import Probe, environment
from jammkle_common.command.main import main
from jammkle_common.names import (
    ACHILLES,
    CHANNEL_JAMS,
    CHANNELS,
    CONTACT_EVENTS,
    DIAGNOSTICS,
    JAM_STATE,
    PERONEAL_LEFT,
    PRESSURES,
    QUADRUPED_ANKLES,
    SOLENOIDS,
    UNJAM_ALL,
    Service,
)
from jammkle_msgs.msg import ChannelJamState, ContactEvent, JamState
from jammkle_sim.robots.catalogue import robot_simulation
from jammkle_sim.robots.options import RobotOptions
from readme_tables import EXAMPLES

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

NAMESPACE = "/lf_ankle"
IN_NAMESPACE = ("--ros-args", "-r", f"__ns:={NAMESPACE}")
CHANGE_STATE = Service("driver", "change_state", "lifecycle_msgs/srv/ChangeState", "")
STAND_IN = Path(__file__).with_name("stand_in")
TOLD_BY_CONTROLLER_MANAGER = Path(__file__).with_name("controller_manager.yaml")
CONFIG = Path(__file__).parents[1] / "jammkle_bringup" / "config"
ACHILLES_JAMMED_PA = 80e3
"""Between the atmosphere and the default vacuum."""


@pytest.fixture
def run(domain_id: int) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start Python with arguments in the test's domain and namespace; what still runs at the end is stopped."""
    started: list[subprocess.Popen[str]] = []

    def begin(*arguments: Any) -> subprocess.Popen[str]:
        command = [sys.executable, *arguments]
        started.append(
            subprocess.Popen(
                command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment(domain_id)
            )
        )
        return started[-1]

    yield begin
    for process in started:
        if process.poll() is None:
            process.terminate()
        output, _ = process.communicate(timeout=30)
        sys.stdout.write(output)


@pytest.fixture
def probe(run: Callable[..., subprocess.Popen[str]], make_probe: Callable[..., Probe]) -> Probe:
    """Look on from the namespace while its driver waits for a manager."""
    run("-m", "jammkle_driver", *IN_NAMESPACE, "-p", "hardware:=fake", "-p", "autostart:=false")
    looking_on = make_probe(NAMESPACE)
    looking_on.listen(JAM_STATE, DIAGNOSTICS, PRESSURES[ACHILLES])
    return looking_on


def example(name: str) -> Any:
    """Load an example as a module."""
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def names_published(robot: str) -> list[str]:
    """What a real controller manager published on introspection_data/names about our description of a robot."""
    return list(yaml.safe_load(TOLD_BY_CONTROLLER_MANAGER.read_text())[robot])


def change(probe: Probe, transition: int) -> bool:
    """Ask the driver for a transition, as a manager does."""
    return bool(probe.call(CHANGE_STATE, transition=Transition(id=transition)).success)


def test_a_stack_around_one_ankle(run: Callable[..., subprocess.Popen[str]], probe: Probe) -> None:
    """A manager brings the driver up, a mission jams and lets go, and so does a client with standard types alone."""
    refused = run(EXAMPLES / "mission.py", *IN_NAMESPACE)
    assert refused.wait(timeout=60) == 1
    assert "mission: " in refused.stdout.read()
    assert change(probe, Transition.TRANSITION_CONFIGURE)
    assert change(probe, Transition.TRANSITION_ACTIVATE)
    probe.wait_for_channels(ChannelJamState.UNJAMMED)
    mission = run(EXAMPLES / "mission.py", *IN_NAMESPACE)
    assert mission.wait(timeout=60) == 0
    assert mission.stdout.read() == "stiff\nsoft\n"
    assert probe.call(CHANNEL_JAMS[ACHILLES], data=True).success
    probe.spin_until(
        lambda: probe.last(PRESSURES[ACHILLES]).fluid_pressure < ACHILLES_JAMMED_PA, "the channel's own pressure falls"
    )
    wanted = f"{NAMESPACE}/driver: {ACHILLES}"
    probe.spin_until(
        lambda: any(line.message.startswith("JAMMED") for line in probe.lines(wanted)),
        "/diagnostics says JAMMED in words",
    )
    assert probe.call(UNJAM_ALL).success
    probe.wait_for_channels(ChannelJamState.UNJAMMED)


def test_the_controller_hears_an_imu_of_another_name(
    run: Callable[..., subprocess.Popen[str]], make_probe: Callable[..., Probe]
) -> None:
    """Remapped, it takes the trunk's IMU and no other, and the foot's state follows from its events."""
    run("-m", "jammkle_controller", *IN_NAMESPACE, "-r", "imu/data:=/trunk/imu")
    foot = run(EXAMPLES / "foot_contact.py", *IN_NAMESPACE)
    probe = make_probe(NAMESPACE)
    probe.spin_until(
        lambda: probe.node.count_subscribers("/trunk/imu") == 1, "the controller subscribes to the trunk's IMU"
    )
    assert probe.node.count_subscribers(f"{NAMESPACE}/imu/data") == 0
    events = probe.publisher(CONTACT_EVENTS)
    probe.spin_until(lambda: events.get_subscription_count() > 0, "the events are received")
    for kind, contact in ((ContactEvent.IMPACT, True), (ContactEvent.LIFTOFF, False)):
        events.publish(ContactEvent(type=kind))
        late = make_probe(NAMESPACE)
        received: list[bool] = []
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        late.node.create_subscription(
            Bool, "contact", lambda message, received=received: received.append(message.data), latched
        )
        late.spin_until(
            lambda received=received, contact=contact: received[-1:] == [contact], "the latched state is received"
        )
    foot.terminate()
    assert foot.wait(timeout=30) == 0


def test_a_parameter_of_another_type_is_refused_in_one_line(run: Callable[..., subprocess.Popen[str]]) -> None:
    """A node of a user's is spared the traceback of rclpy, whose message names both types, as ours are."""
    refused = run(EXAMPLES / "foot_load.py", "--ros-args", "-p", "mass_kg:=7")
    output, _ = refused.communicate(timeout=60)
    assert (refused.returncode, len(output.splitlines())) == (2, 1), output
    assert "'7' of type 'INTEGER', expecting type 'DOUBLE'" in output


def test_topics_of_a_channel_can_have_other_names(run: Callable[..., Any], make_probe: Callable[..., Probe]) -> None:
    """They are remapped where the driver starts."""
    valve = ("-r", "achilles/solenoid:=/valves/two/solenoid", "-r", "achilles/pressure:=/valves/two/pressure")
    run("-m", "jammkle_driver", *IN_NAMESPACE, *valve)
    probe = make_probe(NAMESPACE)
    probe.listen(SOLENOIDS[PERONEAL_LEFT])
    probe.spin_until(lambda: probe.last(SOLENOIDS[PERONEAL_LEFT]) is not None, "the driver speaks")
    topics = {name for name, _ in probe.node.get_topic_names_and_types()}
    assert {"/valves/two/solenoid", "/valves/two/pressure"} <= topics
    assert not {f"{NAMESPACE}/achilles/solenoid", f"{NAMESPACE}/achilles/pressure"} & topics


def test_the_load_on_a_foot_is_estimated(run: Callable[..., Any], make_probe: Callable[..., Probe]) -> None:
    """Over DDS: nothing before the contact is known, then mass times specific force, shared by the feet that stand."""
    run(EXAMPLES / "foot_load.py", "--ros-args", "-p", "mass_kg:=4.0", "-p", "ankles:=[left, right]")
    probe = make_probe("/")
    imu = probe.node.create_publisher(Imu, "/imu/data", 10)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    received: dict[str, list[WrenchStamped]] = {"left": [], "right": []}
    contacts = {}
    for foot, messages in received.items():
        probe.node.create_subscription(WrenchStamped, f"/{foot}/foot_load", messages.append, 10)
        contacts[foot] = probe.node.create_publisher(Bool, f"/{foot}/contact", latched)
    probe.spin_until(lambda: imu.get_subscription_count() > 0, "the IMU is received")
    sample = Imu()
    sample.header.frame_id = "trunk"
    sample.linear_acceleration.x, sample.linear_acceleration.z = 1.0, 10.0

    def loads() -> list[tuple[float, float]]:
        imu.publish(sample)
        forces = [each[-1].wrench.force for each in received.values() if each]
        return [(force.x, force.z) for force in forces]

    for left, right, expected in ((True, True, [(2.0, 20.0), (2.0, 20.0)]), (False, True, [(0.0, 0.0), (4.0, 40.0)])):
        assert loads() != expected
        for foot, stands in (("left", left), ("right", right)):
            contacts[foot].publish(Bool(data=stands))
        probe.spin_until(lambda expected=expected: loads() == expected, f"the loads are {expected}")
    assert received["right"][-1].header.frame_id == "trunk"


@pytest.mark.parametrize(
    ("robot", "mass_kg", "behaviour", "median_n"), [("quadruped", 7.2, "stand", 5.0), ("leg", 1.8, "walk", 8.0)]
)
def test_the_estimate_is_as_good_as_the_guide_says(robot: str, mass_kg: float, behaviour: str, median_n: float) -> None:
    """Against the truth of the simulation, the feet that stand known: standing it is right, walking it is rough."""
    simulation = robot_simulation(robot, RobotOptions(behaviour=behaviour, imu="body"))
    errors_n = []
    for sample in simulation.samples(2.5, 100):
        standing = {name: ankle.foot.stands for name, ankle in sample.ankles.items()}
        felt = next(iter(sample.ankles.values())).imu.specific_force_m_s2
        for name, force_n in example("foot_load").loads_n(mass_kg, felt, standing).items():
            if sample.time_s > 0.5 and standing[name]:
                errors_n.append(abs(math.hypot(*force_n) - sample.ankles[name].foot.normal_force_n))
    assert np.median(errors_n) < median_n


@pytest.mark.parametrize("example", ["mission.cpp", "in_step.cpp"])
def test_examples_in_cpp_fit_the_messages(example: str) -> None:
    """They compile with the headers of the project's messages; what they use of rclcpp is declared."""
    headers = [f"-I{folder}" for folder in (Path(sys.prefix) / "include").iterdir()]
    command = [os.environ.get("CXX", "/usr/bin/c++"), "-fsyntax-only", "-Wall", "-Wextra", "-Werror", "-std=c++17"]
    command += [f"-I{STAND_IN}", *headers, str(EXAMPLES / example)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_commands_of_ros2_control_are_those_of_the_driver() -> None:
    """What controllers have set becomes a jam_command for each ankle, what nobody has set does not; states go back."""
    bridge = example("gpio_bridge")
    known = names_published("quadruped")
    values = [math.nan] * len(known)
    values[known.index("command_interface.lf_ankle_achilles/vacuum")] = 40e3
    values[known.index("command_interface.rh_ankle_peroneal_left/vacuum")] = 0.0
    wanted = bridge.set_points(known, values)
    assert wanted == {"lf_ankle_achilles": 40e3, "rh_ankle_peroneal_left": 0.0}
    sent = {
        ankle: [
            (each.channel, each.vacuum_pa)
            for each in bridge.command(ankle, CHANNELS, wanted, JamState().header.stamp).channels
        ]
        for ankle in QUADRUPED_ANKLES
    }
    assert sent == {"lf_ankle": [(ACHILLES, 40e3)], "rf_ankle": [], "lh_ankle": [], "rh_ankle": [(PERONEAL_LEFT, 0.0)]}
    report = JamState(
        channels=[
            ChannelJamState(channel=name, state=ChannelJamState.JAMMED, measured_vacuum_pa=4e4) for name in CHANNELS
        ]
    )
    states = {name: value for ankle in QUADRUPED_ANKLES for name, value in bridge.states(ankle, report).items()}
    joints = ("/position", "/velocity")
    assert set(states) == {name for name in known if name.startswith("state_interface.") and not name.endswith(joints)}
    assert {value for name, value in states.items() if name.endswith("/vacuum")} == {4e4}
    assert {value for name, value in states.items() if name.endswith("/state")} == {float(ChannelJamState.JAMMED)}
    with pytest.raises(ValueError, match="zip"):
        bridge.set_points(known, values[1:])


@pytest.mark.parametrize("robot", ["ankle", "quadruped"])
def test_a_controller_manager_finds_what_description_and_controllers_name(
    robot: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """The interfaces of the URDF are those that a real one publishes; the controllers' file commands every channel."""
    assert main(["robot", robot, "--urdf"]) == 0
    control = list(ET.fromstring(capsys.readouterr().out).iterfind("ros2_control"))  # noqa: S314 - our own text
    found = {
        f"{interface.tag}.{part.attrib['name']}/{interface.attrib['name']}"
        for system in control
        for part in (*system.iterfind("joint"), *system.iterfind("gpio"))
        for interface in part
    }
    known = names_published(robot)
    assert found == {name for name in known if not name.endswith(".is_limited")}
    controllers = yaml.safe_load((CONFIG / f"{robot}.ros2_control.yaml").read_text())
    gpio = controllers["/**/gpio_controller"]["ros__parameters"]
    commanded = {
        f"command_interface.{name}/{interface}"
        for name, of in gpio["command_interfaces"].items()
        for interface in of["interfaces"]
    }
    assert commanded == {name for name in found if name.startswith("command_interface.")}
    assert gpio["gpios"] == [each.attrib["name"] for system in control for each in system.iterfind("gpio")]
