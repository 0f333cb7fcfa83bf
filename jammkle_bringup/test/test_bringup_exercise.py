"""Exercises beside one another: of one robot the second is refused, those of two robots go on."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

import pytest
import rclpy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float32

from jammkle_bringup.exercise import exercise
from jammkle_bringup.graph_client import COMMAND_NODE
from jammkle_common.bags.run_sheet import RunSheet
from jammkle_common.command.errors import GraphError, InputError
from jammkle_common.names import DRIVER_NODE, JOINT_STATES, PUMP_DUTY, resolved
from jammkle_common.qos import publisher_qos

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from rclpy.node import Node


@pytest.fixture
def nodes(ros_domain: int) -> Iterator[list[Node]]:
    """Make a driver that answers nothing in each of three places, and an exercise of the robot `/one`."""
    with contextlib.ExitStack() as stack:
        context = rclpy.Context()
        rclpy.init(context=context, domain_id=ros_domain, signal_handler_options=SignalHandlerOptions.NO)
        stack.callback(rclpy.shutdown, context=context)
        made = []
        for namespace in ("/one/lf_ankle", "/one/rf_ankle", "/two"):
            made.append(rclpy.create_node(DRIVER_NODE, context=context, namespace=namespace))
            made[-1].create_publisher(Float32, PUMP_DUTY.name, publisher_qos(PUMP_DUTY))
        made.append(rclpy.create_node(f"{COMMAND_NODE}_0", context=context, namespace="/one"))
        for ankle in ("lf_ankle", "rf_ankle"):
            name = resolved(f"/one/{ankle}", JOINT_STATES.name)
            made[-1].create_publisher(JointState, name, publisher_qos(JOINT_STATES))
        for node in made:
            stack.callback(node.destroy_node)
        yield made


@pytest.mark.parametrize("namespace", ["/one", "/one/lf_ankle"])
def test_a_second_exercise_of_a_robot_is_refused(nodes: list[Node], tmp_path: Path, namespace: str) -> None:
    """Of the same namespace, and of one ankle of the robot; nothing is recorded."""
    assert nodes
    with pytest.raises(InputError, match=rf"another exercise is going on in .*\(/one/{COMMAND_NODE}_0\)"):
        exercise({tmp_path / "bag": RunSheet("press")}, namespace, lambda: False)
    assert not (tmp_path / "bag").exists()


def test_an_exercise_of_another_robot_is_in_nobodys_way(nodes: list[Node], tmp_path: Path) -> None:
    """It goes on to ask its driver, which does not answer here."""
    assert nodes
    with pytest.raises(GraphError, match="/two/driver/get_parameters did not answer"):
        exercise({tmp_path / "bag": RunSheet("press")}, "/two", lambda: False)
