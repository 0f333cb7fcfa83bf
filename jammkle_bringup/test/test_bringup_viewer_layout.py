"""The viewers' layouts show topics and fields that exist."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
import yaml
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from jammkle_common.bags.definitions import MessageDefinitions, share_folders
from jammkle_common.names import (
    ANKLE_JOINTS,
    BASE_FRAME,
    CARRIAGE_JOINT,
    CHANNELS,
    IMU,
    JOINT_STATES,
    MANIFOLD_PRESSURE,
    ODOM_FRAME,
    ODOMETRY,
    PRESSURES,
    PUMP_DUTY,
    ROBOT_DESCRIPTION,
    SOLENOIDS,
    TENDON_STATES,
    TENDONS,
    TOPICS,
    published,
)
from jammkle_view.foxglove.node import TRANSFORM_SUFFIX

CONFIG = Path(__file__).resolve().parents[1] / "config"
KINDS = {f"/{topic.name.lstrip('/')}": topic.message_type for topic in TOPICS}
"""Type by topic, as it is called in the root namespace."""
LAYOUT = json.loads((CONFIG / "ankle.foxglove.json").read_text())
PLOTS = {name: config for name, config in LAYOUT["configById"].items() if name.startswith("Plot!")}
PATHS = sorted(path["value"] for plot in PLOTS.values() for path in plot["paths"])


LAYOUT_OF_PLOTJUGGLER = ET.parse(CONFIG / "ankle.plotjuggler.xml")  # noqa: S314 - our own file
CURVES = sorted(curve.attrib["name"] for curve in LAYOUT_OF_PLOTJUGGLER.iter("curve"))
LAYOUT_OF_RVIZ = yaml.safe_load((CONFIG / "robot.rviz").read_text())["Visualization Manager"]
SHOWN_BY = {
    "rviz_default_plugins/RobotModel": ("Description Topic", "std_msgs/msg/String"),
    "rviz_default_plugins/Odometry": ("Topic", "nav_msgs/msg/Odometry"),
    "rviz_default_plugins/Wrench": ("Topic", "geometry_msgs/msg/WrenchStamped"),
}
"""By display of RViz: its property that names a topic, and the type that it takes."""
ENTRIES = {
    "jammkle_msgs/msg/JamState": CHANNELS,
    "jammkle_msgs/msg/TendonStates": TENDONS,
}
"""What a message of these types lists, in order."""
JOINTS = (*ANKLE_JOINTS, CARRIAGE_JOINT)


def panels(layout: Any) -> set[str]:
    return {layout} if isinstance(layout, str) else panels(layout["first"]) | panels(layout["second"])


def check_fields(kind: str, fields: list[str]) -> None:
    """Fail where a field is not in its type; what stands in brackets is for others to check."""
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(MessageDefinitions(share_folders()).find(kind).text, kind))
    for field in fields:
        known = dict(store.fielddefs[kind][1])
        assert field in known, f"{kind} has no field {field}"
        inner = re.search(r"\w+/msg/\w+", str(known[field]))
        kind = inner.group() if inner else kind


@pytest.mark.parametrize("path", PATHS)
def test_a_path_plotted_in_foxglove_exists(path: str) -> None:
    """A plot's path is a topic of the graph, then fields of its type."""
    name, _, fields = path.partition(".")
    # without indices and filters
    check_fields(KINDS[name], re.sub(r"\[[^]]*\]|\{[^}]*\}", "", fields).split("."))


@pytest.mark.parametrize("curve", CURVES)
def test_a_curve_of_plotjuggler_exists(curve: str) -> None:
    """A curve is a topic, then fields with slashes between them; joint states go by the names of the joints."""
    name = max((topic for topic in KINDS if curve.startswith(f"{topic}/")), key=len, default="")
    assert name, f"{curve} is of no topic of the graph"
    kind, fields = KINDS[name], curve.removeprefix(f"{name}/").split("/")
    if name == f"/{JOINT_STATES.name}":
        joint, *fields = fields
        assert joint in JOINTS
    for place in re.findall(r"\[(\d+)\]", curve):
        assert int(place) < len(ENTRIES[kind])
    check_fields(kind, [re.sub(r"\[\d+\]", "", field) for field in fields])


@pytest.mark.parametrize("display", LAYOUT_OF_RVIZ["Displays"], ids=lambda display: display["Name"])
def test_a_display_of_rviz_gets_what_it_takes(display: dict[str, Any]) -> None:
    """Its topic is one of the graph, of the type that it shows, and is delivered as it asks for it."""
    if display["Class"] not in SHOWN_BY:
        assert not {"Topic", "Description Topic"} & set(display)
        return
    key, kind = SHOWN_BY[display["Class"]]
    (topic,) = [each for each in TOPICS if f"/{each.name}" == display[key]["Value"]]
    assert topic.message_type == kind
    offered = published(topic)
    assert offered.latched or display[key]["Durability Policy"] == "Volatile"
    assert offered.reliable or display[key]["Reliability Policy"] == "Best Effort"


def test_the_frames_of_rviz_are_those_of_the_robot() -> None:
    """It stands in odom and looks at the base; a layout for a namespace would have other frames."""
    assert LAYOUT_OF_RVIZ["Global Options"]["Fixed Frame"] == ODOM_FRAME
    assert LAYOUT_OF_RVIZ["Views"]["Current"]["Target Frame"] == BASE_FRAME


def test_every_panel_has_its_place() -> None:
    """The panels that are configured are those that are shown."""
    assert panels(LAYOUT["layout"]) == set(LAYOUT["configById"])


def test_every_measurement_of_an_ankle_is_plotted() -> None:
    """PlotJuggler shows all that the hardware tells; the load cell is a rig's."""
    plotted = {topic for topic in KINDS if any(curve.startswith(f"{topic}/") for curve in CURVES)}
    wanted = (IMU, JOINT_STATES, TENDON_STATES, MANIFOLD_PRESSURE, PUMP_DUTY, *PRESSURES.values(), *SOLENOIDS.values())
    assert {f"/{topic.name}" for topic in wanted} <= plotted


def test_foxglove_draws_the_robot_in_the_frames_that_it_gets() -> None:
    """From the description, on a ground that lies in odom, moved by the transform that the connection makes of it."""
    panel = LAYOUT["configById"]["3D!robot"]
    assert panel["followTf"] == BASE_FRAME
    assert panel["layers"]["ground"]["frameId"] == ODOM_FRAME
    assert panel["layers"]["robot"]["topic"] == f"/{ROBOT_DESCRIPTION.name}"
    assert set(panel["topics"]) == {f"/{ODOMETRY.name}{TRANSFORM_SUFFIX}"}
