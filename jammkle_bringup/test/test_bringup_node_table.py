"""The table of nodes: commands, options of `up`, parameter file and launch file say the same."""

from __future__ import annotations

import importlib.util
import re
import sys
import types
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import rclpy
import yaml

from jammkle_bringup.core.node_table import (
    NODES,
    Robot,
    check_parameter_files,
    command_of,
    merged_values,
    nodes_for,
    simulated_time,
)
from jammkle_bringup.graph_options import (
    GraphOptions,
    check,
    given_value,
    given_values,
    with_given,
    with_legs,
    with_robot_as_built,
)
from jammkle_bringup.up import child_specs
from jammkle_common.command.errors import InputError
from jammkle_common.names import CONTROLLER_NODE, GAP_MONITOR_NODE, SIM_NODE
from jammkle_common.parameters import from_mapping

if TYPE_CHECKING:
    from jammkle_bringup.core.supervisor import ChildSpec

PACKAGE = Path(__file__).resolve().parents[1]


def specs(**options: Any) -> dict[str, ChildSpec]:
    return {spec.name: spec for spec in child_specs(GraphOptions("/lf_ankle", **options))}


def test_the_recorder_starts_first_and_the_driver_last() -> None:
    """Processes stop in reverse: the simulation sees the release, and the recorder sees everything."""
    assert list(specs(bag=Path("bag"))) == ["recorder", "sim", "controller", "driver"]


def test_only_what_follows_the_simulation_uses_simulated_time() -> None:
    """Driver, controller and recorder run on /clock when hardware is simulated, the sim never."""
    simulated = specs(bag=Path("bag"))
    for name in ("driver", "controller"):
        assert "use_sim_time:=true" in simulated[name].command
    assert "sim" in simulated["recorder"].command
    assert "use_sim_time:=true" not in simulated["sim"].command
    assert not any(simulated_time(entry, "modbus") for entry in NODES)
    assert "sim" not in [entry.name for entry in nodes_for("modbus")]


def test_values_keep_their_type_on_the_command_line() -> None:
    """ROS reads 2.0 as a number with a point, true as a truth value and quoted text as text."""
    command = command_of(NODES[0], "/", {"speed": 2.0, "start_paused": True, "seed": 3, "parameter_set": "fitted"})
    given = dict(part.split(":=") for part in command if ":=" in part and not part.startswith("__"))
    read = {name: yaml.safe_load(value) for name, value in given.items()}
    assert read == {"speed": 2.0, "start_paused": True, "seed": 3, "parameter_set": "fitted"}
    assert isinstance(read["speed"], float)


def test_the_parameter_file_has_the_defaults() -> None:
    """config/ankle.yaml gives every parameter its default, in any namespace."""
    path = PACKAGE / "config" / "ankle.yaml"
    content = yaml.safe_load(path.read_text())
    for entry in NODES:
        table = entry.parameters()
        assert from_mapping(table, content[f"/**/{entry.name}"]["ros__parameters"]) == table()
    for namespace in ("/", "/lf_ankle", "/robot/lf_ankle"):
        check_parameter_files([path], namespace, NODES)


@pytest.mark.parametrize(
    ("section", "namespace", "fits"),
    [
        ("driver", "/", True),
        ("/driver", "/", True),
        ("driver", "/lf_ankle", False),
        ("/lf_ankle/driver", "/lf_ankle", True),
        ("/*/driver", "/lf_ankle", True),
        ("/*/driver", "/robot/lf_ankle", False),
        ("/**/driver", "/robot/lf_ankle", True),
        ("/**/driver", "/", True),
    ],
)
def test_sections_fit_nodes_as_ros_reads_them(tmp_path: Path, section: str, namespace: str, *, fits: bool) -> None:
    """One star is one level of a name, two are any number; a file that fits nothing is refused."""
    path = tmp_path / "parameters.yaml"
    path.write_text(f"{section}:\n  ros__parameters:\n    max_vacuum_pa: 50000.0\n    use_sim_time: true\n")
    if fits:
        check_parameter_files([path], namespace, NODES)
    else:
        with pytest.raises(InputError, match="no section fits"):
            check_parameter_files([path], namespace, NODES)


def test_a_misspelled_ankle_is_refused_beside_one_that_fits(tmp_path: Path) -> None:
    """Its values would be lost without a word. Sections of other robots stay, as files that several share have them."""
    path = tmp_path / "parameters.yaml"
    section = "{}:\n  ros__parameters:\n    max_vacuum_pa: 50000.0\n"
    path.write_text(section.format("/lf_ankle/driver") + section.format("/rf_ankel/driver"))
    with pytest.raises(InputError, match=r"section '/rf_ankel/driver' fits no node .* /rf_ankle/driver"):
        check_parameter_files([path], "/", nodes_for("fake", Robot.QUADRUPED))
    check_parameter_files([path], "/lf_ankle", NODES)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("ros__parameters:", "'ros__parameters' of '/**/driver' holds nothing"),
        ("ros__parameters: ~", "'ros__parameters' of '/**/driver' holds nothing"),
        ("ros__parameters: []", "'ros__parameters' of '/**/driver' is [], and must be names with values"),
        ("ros__parameters: false", "'ros__parameters' of '/**/driver' is False, and must be names with values"),
        ("ros__parameter: {max_vacuum_pa: 5.0e4}", "section '/**/driver' holds 'ros__parameter', which must be"),
        ("ros_parameters: {max_vacuum_pa: 5.0e4}", "section '/**/driver' holds 'ros_parameters', which must be"),
        ("ros_parameters:", "section '/**/driver' holds 'ros_parameters', which must be"),
        ("max_vacuum_pa: 5.0e4", "section '/**/driver' holds no 'ros__parameters'"),
        ("", "section '/**/driver' holds no 'ros__parameters'"),
    ],
)
def test_a_section_without_parameters_is_named(tmp_path: Path, text: str, said: str) -> None:
    """A node would end with five lines of rcl, or nothing would be set; an empty table is one that ROS takes."""
    path = tmp_path / "parameters.yaml"
    path.write_text(f"/**/driver:\n  {text}\n")
    with pytest.raises(InputError, match=f"^{re.escape(f'{path}: {said}')}"):
        check_parameter_files([path], "/", NODES)
    path.write_text("/**/driver:\n  ros__parameters: {}\n")
    check_parameter_files([path], "/", NODES)


@pytest.mark.usefixtures("ros_domain")
@pytest.mark.parametrize("text", ["2e-4", "2E-4", ".2e-3", "0.0002", "+2.0e-4"])
def test_numbers_are_read_as_ros_reads_them(tmp_path: Path, text: str) -> None:
    """What a node takes for a number is one for the check, too: YAML 1.2 needs no point before an exponent."""
    path = tmp_path / "parameters.yaml"
    path.write_text(f"/**/sim:\n  ros__parameters:\n    timestep_s: {text}\n")
    context = rclpy.Context()
    rclpy.init(args=["--ros-args", "--params-file", str(path)], context=context)
    node = rclpy.create_node("sim", context=context, automatically_declare_parameters_from_overrides=True)
    value = node.get_parameter("timestep_s").value
    node.destroy_node()
    rclpy.shutdown(context=context)
    assert value == 0.0002
    assert merged_values([path], "/", NODES[0]) == {"timestep_s": value}


def test_parameters_that_do_not_go_together_are_refused_over_several_files(tmp_path: Path) -> None:
    """A time step in one file and a rate in another that it does not fit; the last file wins where both say it."""
    texts = {"step": "timestep_s: 0.0004", "rate": "imu_rate_hz: 500", "other_rate": "imu_rate_hz: 400"}
    for name, text in texts.items():
        (tmp_path / name).write_text(f"/**/sim:\n  ros__parameters:\n    {text}\n    state_rate_hz: 250\n")
    step, rate, other_rate = (tmp_path / name for name in texts)
    check_parameter_files([rate], "/", NODES)
    check_parameter_files([step, rate], "/", NODES)
    with pytest.raises(InputError, match="400 Hz does not fit"):
        check_parameter_files([step, rate, other_rate], "/", NODES, {"sim": {"timestep_s": 0.001}})


class Recorded:
    """Stands in for any class of launch and launch_ros: keeps what it was made with."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        self.arguments = arguments
        self.named = named


@dataclass
class Context:
    """Stands in for LaunchContext."""

    launch_configurations: dict[str, str]


class Configuration(Recorded):
    """Stands in for LaunchConfiguration."""

    def perform(self, context: Context) -> str:
        return context.launch_configurations[self.arguments[0]]


@pytest.fixture
def launch_file(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Load the launch file with stand-ins for the distribution's launch packages."""
    stand_ins = {
        "launch": ("LaunchContext", "LaunchDescription"),
        "launch.actions": ("DeclareLaunchArgument", "EmitEvent", "OpaqueFunction"),
        "launch.events": ("Shutdown",),
        "launch_ros": (),
        "launch_ros.actions": ("Node",),
    }
    for name, classes in stand_ins.items():
        module = types.ModuleType(name)
        for each in classes:
            setattr(module, each, Recorded)
        monkeypatch.setitem(sys.modules, name, module)
    substitutions: Any = types.ModuleType("launch.substitutions")
    substitutions.LaunchConfiguration = Configuration
    monkeypatch.setitem(sys.modules, "launch.substitutions", substitutions)
    return load("ankle")


@pytest.fixture
def robot_launch_file(launch_file: Any) -> Any:
    """Load the robots' launch file with the same stand-ins."""
    assert launch_file
    return load("robot")


def load(name: str) -> Any:
    spec = importlib.util.spec_from_file_location(f"{name}_launch", PACKAGE / "launch" / f"{name}.launch.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def launched(launch_file: Any, **given: str) -> list[Any]:
    """Return the nodes that a launch file starts, with these arguments and its defaults."""
    defaults = {name: default for name, (default, _) in launch_file.ARGUMENTS.items()}
    nodes: list[Any] = launch_file.nodes(Context({**defaults, **given}))
    return nodes


def test_the_launch_file_starts_what_the_command_starts(launch_file: Any) -> None:
    """Same packages, names, namespace and simulated time as `jammkle up`."""
    nodes = launched(launch_file, namespace="lf_ankle", speed="2")
    started = {node.named["name"]: node.named for node in nodes}
    wanted = specs(values={"sim": {"speed": 2.0}})
    assert list(started) == list(wanted)
    for name, given in started.items():
        command = wanted[name].command
        assert given["package"] in command
        assert f"__ns:={given['namespace']}" in command
        (values,) = given["parameters"]
        assert ("use_sim_time:=true" in command) == values.get("use_sim_time", False)
        assert ("speed:=2.0" in command) == (values.get("speed") == 2.0)


def test_a_quadruped_is_one_simulation_and_a_set_for_each_ankle(robot_launch_file: Any) -> None:
    """One sim above, four controllers, then four drivers, each in its ankle's namespace; the launch file the same."""
    robot = given_values(Robot.QUADRUPED, "sim", None, None)
    specs = child_specs(GraphOptions("/robot", robot=Robot.QUADRUPED, values=robot))
    legs = [f"{leg}_ankle" for leg in ("lf", "rf", "lh", "rh")]
    controllers, drivers = ([f"{leg}/{node}" for leg in legs] for node in ("controller", "driver"))
    assert [spec.name for spec in specs] == ["sim", *controllers, *drivers]
    assert "robot:='quadruped'" in specs[0].command
    assert "__ns:=/robot" in specs[0].command
    assert "__ns:=/robot/lf_ankle" in specs[1].command
    started = launched(robot_launch_file, namespace="robot", behaviour="walk")
    for spec, node in zip(specs, started, strict=True):
        assert f"__ns:={node.named['namespace']}" in spec.command
        assert spec.name.endswith(node.named["name"])
    installed = (PACKAGE.parent / "jammkle_sim" / "setup.py").read_text()
    assert f'"{started[0].named["executable"]} = jammkle_sim.robot:main"' in installed


@pytest.mark.parametrize(
    ("given", "found"), [("", "/fleet/one"), ("lf_ankle", "/fleet/one/lf_ankle"), ("/lf_ankle", "/lf_ankle")]
)
def test_an_including_launch_file_pushes_its_namespace(launch_file: Any, given: str, found: str) -> None:
    """As launch_ros does it: a name is within what was pushed, an absolute one is not."""
    nodes = launched(launch_file, ros_namespace="/fleet/one", namespace=given)
    assert {node.named["namespace"] for node in nodes} == {found}


def test_the_parameter_file_of_robots_fits_them() -> None:
    """config/robot.yaml fits a leg, and every ankle of a quadruped; a section may be one ankle's."""
    path = PACKAGE / "config" / "robot.yaml"
    assert "imu_mount: shank" in path.read_text()  # where a simulated robot has it unless a file says otherwise
    for robot in (Robot.LEG, Robot.QUADRUPED):
        check_parameter_files([path], "/", nodes_for("sim", robot))


def test_a_section_may_be_that_of_one_ankle(tmp_path: Path) -> None:
    """The port of one leg's board is its own; an error names the ankle."""
    path = tmp_path / "ports.yaml"
    path.write_text("/lh_ankle/driver: {ros__parameters: {port: /dev/lh}}\n")
    lf, _, lh, _ = [entry for entry in nodes_for("modbus", Robot.QUADRUPED) if entry.name == "driver"]
    assert merged_values([path], "/", lf) == {}
    assert merged_values([path], "/", lh) == {"port": "/dev/lh"}
    path.write_text("/lh_ankle/driver: {ros__parameters: {safe_state: melt}}\n")
    with pytest.raises(InputError, match=r"lh_ankle/driver: .*'melt'"):
        check_parameter_files([path], "/", nodes_for("sim", Robot.QUADRUPED))


def test_what_a_robot_does_not_have_is_refused() -> None:
    """One board for four ankles, a twin of a quadruped."""
    with pytest.raises(InputError, match=r"--port is one board, a quadruped has 4: .*/lf_ankle/driver"):
        check(GraphOptions("/", "modbus", robot=Robot.QUADRUPED, values={"driver": {"port": "/dev/one"}}))
    with pytest.raises(InputError, match="--monitor needs --robot ankle"):
        check(GraphOptions("/", robot=Robot.LEG, monitor=True))


def test_the_launch_file_starts_the_monitor_where_asked(launch_file: Any) -> None:
    """monitor:=true adds the gap monitor, by an executable that its package installs, in simulated time; else not."""
    plain = launched(launch_file)
    *others, monitor = launched(launch_file, monitor="true")
    assert [node.named["name"] for node in others] == [node.named["name"] for node in plain]
    assert monitor.named["name"] == GAP_MONITOR_NODE
    assert monitor.named["parameters"][0]["use_sim_time"] is True
    installed = (PACKAGE.parent / monitor.named["package"] / "setup.py").read_text()
    assert f'"{monitor.named["executable"]} = jammkle_gap.monitor.__main__:main"' in installed


def test_the_launch_file_leaves_time_for_discovery(launch_file: Any) -> None:
    """Nothing waits for the nodes there, so by default the ankle hangs for longer; both arguments reach the sim."""
    for given, release_time_s, publish_clock in (
        ({}, 5.0, True),
        ({"release_time_s": "2", "publish_clock": "false"}, 2.0, False),
    ):
        sim, *others = launched(launch_file, **given)
        (values,) = sim.named["parameters"]
        assert values["release_time_s"] == release_time_s
        assert values["publish_clock"] is publish_clock
        assert not any("release_time_s" in node.named["parameters"][0] for node in others)


def test_the_launch_file_declares_its_arguments(launch_file: Any, tmp_path: Path) -> None:
    """Every argument has a default and a description, and a file of parameters is passed on, which may name joints."""
    description = launch_file.generate_launch_description()
    declared = [action for action in description.arguments[0] if "default_value" in action.named]
    assert {action.arguments[0] for action in declared} == set(launch_file.ARGUMENTS)
    assert all(action.named["description"] for action in declared)
    file = tmp_path / "mine.yaml"
    file.write_text("/**/robot_names: {ros__parameters: {joints: lf_pitch=ankle_pitch}}")
    nodes = launched(launch_file, params=str(file))
    assert all(node.named["parameters"][0] == str(file) for node in nodes)
    assert "robot_names" in [node.named["name"] for node in nodes]


def test_the_launch_file_refuses_what_is_not_there(launch_file: Any) -> None:
    """As the command does."""
    with pytest.raises(InputError, match="serial is not known"):
        launched(launch_file, hardware="serial")


@pytest.mark.parametrize(
    ("robot", "given", "mount"),
    [
        (Robot.ANKLE, "", None),
        (Robot.LEG, "", "shank"),
        (Robot.QUADRUPED, f"/**/{SIM_NODE}: {{ros__parameters: {{imu: foot}}}}", "foot"),
        (Robot.QUADRUPED, f"/**/{CONTROLLER_NODE}: {{ros__parameters: {{imu_mount: body}}}}", "body"),
    ],
)
def test_controllers_of_a_simulated_robot_know_where_its_imus_are(
    tmp_path: Path, robot: Robot, given: str, mount: str | None
) -> None:
    """On the simulation's own place, unless a file says otherwise."""
    file = tmp_path / "some.yaml"
    file.write_text(given)
    options = GraphOptions("/", parameter_files=(file,) if given else (), robot=robot)
    assert given_value(with_robot_as_built(options), CONTROLLER_NODE, "imu_mount") == mount


def test_a_parameter_reaches_the_drivers_of_every_ankle_or_of_one() -> None:
    """By a node's name, its path, or its full name; the closer one wins, and both reach the command of the process."""
    options = GraphOptions("/robot", robot=Robot.QUADRUPED)
    given = ("driver:max_vacuum_pa:=5e4", "lf_ankle/driver:max_vacuum_pa:=40000", "/robot/rf_ankle/driver:pump:=it's")
    commands = {spec.name: spec.command for spec in child_specs(with_given(options, given))}
    assert {name for name, words in commands.items() if "max_vacuum_pa:=50000.0" in words} == {
        *("rf_ankle/driver", "lh_ankle/driver", "rh_ankle/driver")
    }
    assert "max_vacuum_pa:=40000" in commands["lf_ankle/driver"]
    assert [name for name, words in commands.items() if "pump:='it''s'" in words] == ["rf_ankle/driver"]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("max_vacuum_pa:=1", "give NODE:NAME:=VALUE"),
        ("driver:max_vacuum_pa=1", "give NODE:NAME:=VALUE"),
        ("lf_ankle/driver:max_vacuum_pa:=1", "no node 'lf_ankle/driver' in this graph; known are: controller"),
        ("driver:max_vacuum_pa:=[1, 2]", "must be a number"),
        ("driver:max_vacuum_pa:=-1.0", "max_vacuum_pa"),
        ("driver:max_vacum_pa:=1.0", "unknown parameter 'max_vacum_pa'"),
        ("driver:hardware:=modbus", "start with --hardware modbus"),
    ],
)
def test_a_parameter_that_cannot_be_is_refused(text: str, why: str) -> None:
    with pytest.raises(InputError, match=re.escape(why)):
        check(with_given(GraphOptions("/"), [text]))


def test_one_controller_that_knows_its_imu_leaves_the_others_as_they_are() -> None:
    options = with_given(GraphOptions("/", robot=Robot.QUADRUPED), ["lf_ankle/controller:imu_mount:=body"])
    known = [with_robot_as_built(options).values[f"{ankle}/controller"]["imu_mount"] for ankle in options.robot.ankles]
    assert known == ["body", "shank", "shank", "shank"]


def test_controllers_that_need_their_leg_find_it_in_the_description() -> None:
    """Each of a quadruped by its own joints, in the robot's namespace; what is given wins, the others get nothing."""
    asked = [
        "controller:use_odometry:=true",
        "rh_ankle/controller:joint_prefix:=hind_",
        "lh_ankle/controller:use_odometry:=false",
    ]
    values = with_legs(with_given(GraphOptions("/robot", robot=Robot.QUADRUPED), asked)).values
    assert values["rf_ankle/controller"] == {
        "robot_namespace": "/robot",
        "joint_prefix": "rf_",
    }
    assert values["rh_ankle/controller"]["joint_prefix"] == "hind_"
    assert values["lh_ankle/controller"] == {"use_odometry": False}


def test_a_page_that_is_not_installed_is_refused_before_anything_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    """With what to install; without `--view` nobody asks."""
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    check(GraphOptions("/"))
    with pytest.raises(InputError, match=r"pip install 'jammkle\[view\]'"):
        check(GraphOptions("/", view=True))


def test_the_page_of_a_quadruped_knows_its_ankles() -> None:
    assert given_values(Robot.QUADRUPED, "sim", None, None)["viewer"] == {
        "ankles": "lf_ankle,rf_ankle,lh_ankle,rh_ankle"
    }
    assert given_values(Robot.ANKLE, "sim", None, None) == {}


def test_the_robots_names_come_where_joints_are_named(tmp_path: Path) -> None:
    """By a file or by -p: a node for each ankle that has some, before those that it serves."""
    file = tmp_path / "names.yaml"
    file.write_text("/**/robot_names: {ros__parameters: {joints: lf_pitch=ankle_pitch}}")
    started = [spec.name for spec in child_specs(GraphOptions("/lf_ankle", parameter_files=(file,)))]
    assert started == ["robot_names", "sim", "controller", "driver"]
    options = with_given(GraphOptions("/", robot=Robot.QUADRUPED), ["rf_ankle/robot_names:joints:=a=ankle_roll"])
    assert [spec.name for spec in child_specs(options) if "robot_names" in spec.name] == ["rf_ankle/robot_names"]
