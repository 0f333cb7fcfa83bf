"""What `jammkle up` works out from its options before anything starts."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest

from jammkle_bringup.core.node_table import Robot
from jammkle_bringup.graph_options import (
    GraphOptions,
    check,
    given_value,
    given_values,
    with_given,
    with_imu_mount,
    with_legs,
)
from jammkle_bringup.up import child_specs
from jammkle_common.command.errors import InputError
from jammkle_common.names import CONTROLLER_NODE, SIM_NODE

if TYPE_CHECKING:
    from pathlib import Path


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
    assert given_value(with_imu_mount(options), CONTROLLER_NODE, "imu_mount") == mount


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
    known = [with_imu_mount(options).values[f"{ankle}/controller"]["imu_mount"] for ankle in options.robot.ankles]
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
