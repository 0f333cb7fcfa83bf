"""What `jammkle up` works out from its options before anything starts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from jammkle_bringup.core.node_table import Robot
from jammkle_bringup.graph_options import GraphOptions, given_value, with_imu_mount
from jammkle_graph.names import CONTROLLER_NODE, SIM_NODE

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
