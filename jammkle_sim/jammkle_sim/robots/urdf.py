"""Descriptions of a robot: its MJCF, and a URDF made from that with frames of sensors and ros2_control.

Joints are called as in `joint_states`. Format of URDF: http://wiki.ros.org/urdf/XML. Where the two differ:

- A body may have several hinges, a link hangs on one joint. Between two hinges of a body comes a link that takes a
  thousandth of the body's mass and inertia, in the same place, so that they still add up to the body's.
- What joins the robot to the world (a free joint, a boom) is left out: `odometry` tells where `base_link` is. That link
  has no mass, as robot_state_publisher (KDL) wants it.
- What has no place in URDF is left out: tendons, springs, the motors' inertia behind their gears.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import numpy as np

from jammkle_common.names import (
    ANKLE_JOINTS,
    BASE_FRAME,
    CHANNELS,
    IMU_FRAME,
    JOINT_STATES,
    LOAD_CELL_FRAME,
    MANIFOLD_FRAME,
    TENDONS_OF_CHANNEL,
    frame,
    resolved,
)
from jammkle_common.parameters import ParameterError
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.physics.kernels import LARGEST_SPEED

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from jammkle_sim.robots.robot import AttachedAnkle, Robot


BETWEEN_SHARE = 1e-3
"""Share of a body's mass and inertia that goes to each link between two of its hinges: some simulators refuse or drop
links that weigh nothing. Chosen small enough to move no centre of mass by more than some micrometres."""
_HINGE, _SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
_KINDS = {_HINGE: "revolute", _SLIDE: "prismatic"}


def robot_urdf(robot: Robot, namespace: str = "/") -> str:
    """Return the URDF of a robot in a normalised ROS namespace, which its frames begin with, as text.

    Raises:
        ParameterError: the model has what URDF has no word for: a ball joint or a free one inside the robot.

    """
    names = UrdfNames(robot, namespace)
    tree = ET.Element("robot", name=robot.name)
    tree.append(ET.Comment(f" Made from the MuJoCo model of {robot.name}; lengths in m, masses in kg, angles in rad. "))
    base = names.frame(BASE_FRAME)
    model = robot.model
    root = int(model.body_rootid[model.body(robot.base).id])
    if names.link(model.body(root).name) != base:
        ET.SubElement(tree, "link", name=base)
    for body in range(root, model.nbody):
        if int(model.body_rootid[body]) == root:
            _Body(tree, model, body, names).add(base if body == root else "")
    for ankle in robot.ankles:
        _add_frames(tree, robot, names, ankle)
    tree.extend(control_tags(robot, names, namespace))
    ET.indent(tree)
    return f'<?xml version="1.0"?>\n{ET.tostring(tree, encoding="unicode")}\n'


def robot_mjcf(robot: Robot) -> str:
    """Return the MJCF of a robot as text: what is simulated, but for the forces of its tendons.

    Those follow from pressure and history by a law of their own, and are controls here.
    """
    names, spec = UrdfNames(robot), robot.spec.copy()
    for joint in spec.joints:
        joint.name = names.joint(joint.name)
    for lock in spec.equalities:
        lock.name1 = names.joint(lock.name1)
    spec.compile()
    text: str = spec.to_xml()
    return text


class _Body:
    def __init__(self, tree: ET.Element, model: Any, body: int, names: UrdfNames) -> None:
        self._tree, self._model, self._body, self._names = tree, model, body, names
        self._link = names.link(model.body(body).name)

    def add(self, base: str) -> None:
        """Add links and joints; of the robot's root, which hangs fixed on `base`, those to the world are left out."""
        model, body = self._model, self._body
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        joints = [] if base else list(range(first, first + count))
        parent = base or self._names.link(model.body(int(model.body_parentid[body])).name)
        place_m, turn = (np.zeros(3), STILL) if base else (model.body_pos[body], model.body_quat[body])
        between = max(len(joints) - 1, 0)
        if not joints and self._link != base:
            _fix(self._tree, parent, self._link, place_m, turn)
        for index, joint in enumerate(joints):
            name = self._names.joint(model.joint(joint).name)
            axis = name.rpartition("_")[2]  # `pitch` of `lf_ankle_pitch`
            child = self._link if index == between else f"{self._link}_{axis}"
            if index < between:
                self._add_inertia(ET.SubElement(self._tree, "link", name=child), BETWEEN_SHARE)
            self._add_joint(joint, name, parent, child, place_m, turn)
            parent, place_m, turn = child, np.zeros(3), STILL
        link = ET.SubElement(self._tree, "link", name=self._link)
        if model.body_mass[body] > 0.0:
            self._add_inertia(link, 1.0 - between * BETWEEN_SHARE)
        add_shapes(link, model, body)

    def _add_inertia(self, link: ET.Element, share: float) -> None:
        model, body = self._model, self._body
        inertial = ET.SubElement(link, "inertial")
        origin(inertial, model.body_ipos[body], model.body_iquat[body])
        ET.SubElement(inertial, "mass", value=_text(share * model.body_mass[body]))
        moments = zip(("ixx", "iyy", "izz"), share * model.body_inertia[body], strict=True)
        products = {"ixy": "0", "ixz": "0", "iyz": "0"}
        ET.SubElement(inertial, "inertia", {**{key: _text(value) for key, value in moments}, **products})

    def _add_joint(self, index: int, name: str, parent: str, child: str, place_m: Any, turn: Any) -> None:
        model = self._model
        kind = int(model.jnt_type[index])
        reference = float(model.qpos0[model.jnt_qposadr[index]])
        if kind not in _KINDS or np.any(model.jnt_pos[index]) or (reference and kind != _HINGE):
            msg = (
                f"joint '{model.joint(index).name}' has no counterpart in URDF: it must be a hinge, or a slide whose "
                "reference is 0, through the origin of its body"
            )
            raise ParameterError(msg)
        if reference:  # a model stands at its references, URDF at 0
            back = np.zeros(4)
            mujoco.mju_axisAngle2Quat(back, model.jnt_axis[index], -reference)
            stands, turn = np.asarray(turn, dtype=np.float64), np.zeros(4)
            mujoco.mju_mulQuat(turn, stands, back)
        limited = bool(model.jnt_limited[index])
        word = "continuous" if kind == _HINGE and not limited else _KINDS[kind]
        joint = ET.SubElement(self._tree, "joint", name=name, type=word)
        origin(joint, place_m, turn)
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=child)
        ET.SubElement(joint, "axis", xyz=_numbers(model.jnt_axis[index]))
        freedom = int(model.jnt_dofadr[index])
        damping, friction = _text(model.dof_damping[freedom]), _text(model.dof_frictionloss[freedom])
        ET.SubElement(joint, "dynamics", damping=damping, friction=friction)
        lower, upper = model.jnt_range[index] if limited else (-np.inf, np.inf)
        bounds = {"lower": _text(lower), "upper": _text(upper)} if limited else {}
        effort = _text(_largest_effort(model, index))
        ET.SubElement(joint, "limit", {**bounds, "effort": effort, "velocity": _text(LARGEST_SPEED)})


def _add_frames(tree: ET.Element, robot: Robot, names: UrdfNames, ankle: Any) -> None:
    """Add the frames that an ankle's messages stand in, as links without mass.

    IMU and load cell are where the model has them. Where pump and valves are is the user's: the manifold is drawn at
    the ankle's mount, and a channel where its tendons begin.
    """
    model, mount = robot.model, ankle.mount
    frames = {MANIFOLD_FRAME: (mount, np.zeros(3), STILL)}
    known = {model.site(index).name for index in range(model.nsite)}
    for sensor in (IMU_FRAME, LOAD_CELL_FRAME):
        if ankle.named(sensor) in known:
            site = model.site(ankle.named(sensor))
            frames[sensor] = (model.body(int(model.site_bodyid[site.id])).name, site.pos, site.quat)
    for channel in CHANNELS:
        sites = [model.site(ankle.named(f"{tendon}_leg")).pos for tendon in TENDONS_OF_CHANNEL[channel]]
        frames[channel] = (mount, np.mean(sites, axis=0), STILL)
    for name, (body, place_m, turn) in frames.items():
        link = names.frame(name, ankle)
        ET.SubElement(tree, "link", name=link)
        _fix(tree, names.link(body), link, place_m, turn)


def _fix(tree: ET.Element, parent: str, child: str, place_m: Any, turn: Any) -> None:
    joint = ET.SubElement(tree, "joint", name=f"{child.replace('/', '_')}_fixed", type="fixed")
    origin(joint, place_m, turn)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)


def _largest_effort(model: Any, joint: int) -> float:
    """Return what a joint's actuator gives at most, N m or N; 0 of one that nothing drives."""
    driven = int(mujoco.mjtTrn.mjTRN_JOINT)
    for actuator in range(model.nu):
        on_joint = int(model.actuator_trntype[actuator]) == driven and int(model.actuator_trnid[actuator, 0]) == joint
        if on_joint and model.actuator_forcelimited[actuator]:
            return float(model.actuator_forcerange[actuator, 1])
    return 0.0


def _text(value: float) -> str:
    return f"{float(value):.9g}"


def _numbers(values: Iterable[float]) -> str:
    return " ".join(map(_text, values))


_JOINT_PREFIX = "ankle_"
"""What the names of an ankle's own joints begin with, whatever the ankle is called."""


@dataclass(frozen=True)
class ReportedJoint:
    """One joint that is in joint_states."""

    ankle: str
    """Name of the ankle that reports it."""
    name: str
    """Name in the joint_states of that ankle."""
    joint: str
    """Name in the model."""
    unique: str
    """Name in the whole robot: in its URDF, and in the joint_states of all of it."""


class UrdfNames:
    """Names of one robot's parts."""

    def __init__(self, robot: Robot, namespace: str = "/") -> None:
        """Take the robot's ankles, and the normalised ROS namespace that its frames begin with."""
        self._namespace = namespace
        self._ankles = robot.ankles
        self.reported: tuple[ReportedJoint, ...] = tuple(_reported(robot))
        """Every joint that is in joint_states."""
        self._joints = {joint.joint: joint.unique for joint in self.reported}

    def within(self, ankle: AttachedAnkle) -> str:
        """Return the namespace of an ankle below the robot's; a single one is in that."""
        return ankle.name if len(self._ankles) > 1 else ""

    def link(self, body: str) -> str:
        """Return the frame of a body, by its name in the model."""
        ankle, _, part = body.rpartition("/")
        single = len(self._ankles) == 1 and ankle == self._ankles[0].name
        return self.frame(part if single else body)

    def frame(self, name: str, ankle: AttachedAnkle | None = None) -> str:
        """Return a frame of the robot, or of one of its ankles."""
        return frame(self._namespace, frame(self.within(ankle), name) if ankle is not None else name)

    def joint(self, joint: str) -> str:
        """Return the name of a joint by its name in the model; one that nobody reports keeps that."""
        return self._joints.get(joint, joint)


def _reported(robot: Robot) -> Iterator[ReportedJoint]:
    several = len(robot.ankles) > 1
    for ankle in robot.ankles:
        for joint in ANKLE_JOINTS:
            alone = f"{ankle.name}_{joint.removeprefix(_JOINT_PREFIX)}"
            yield ReportedJoint(ankle.name, joint, ankle.named(joint), alone if several else joint)
        for name, joint in ankle.joints.items():
            yield ReportedJoint(ankle.name, name, joint, joint if several else name)


_SPHERE, _BOX = int(mujoco.mjtGeom.mjGEOM_SPHERE), int(mujoco.mjtGeom.mjGEOM_BOX)
_CYLINDER, _CAPSULE = int(mujoco.mjtGeom.mjGEOM_CYLINDER), int(mujoco.mjtGeom.mjGEOM_CAPSULE)
_SOLE_CORNERS = 4
"""A body with so many balls is a foot, and is drawn as the box around them up to its joint."""
STILL = np.array((1.0, 0.0, 0.0, 0.0))
"""Quaternion of what is not turned."""
_ROD_M, _BALL_M = 0.006, 0.03
"""Radius of the rod that stands for what is between two ends of tendons, and of a base without a shape of its own."""
_TINTS = {"printed": "0.27 0.29 0.32 1", "metal": "0.69 0.71 0.74 1"}


def add_shapes(link: ET.Element, model: Any, body: int) -> None:
    """Add visual and collision elements of a body, by its number, to a link."""
    geoms = [index for index in range(model.ngeom) if int(model.geom_bodyid[index]) == body]
    balls = [index for index in geoms if int(model.geom_type[index]) == _SPHERE]
    if len(balls) >= _SOLE_CORNERS:
        _add_sole(link, model, balls)
    for index in geoms:
        if len(balls) < _SOLE_CORNERS or index not in balls:
            _add_geom(link, "visual", model, index)
        if model.geom_contype[index] or model.geom_conaffinity[index]:
            _add_geom(link, "collision", model, index)
    if not geoms:
        _add_stand_in(link, model, body)


def origin(parent: ET.Element, place_m: Any, turn: Any) -> None:
    """Add the origin of something: m, and roll, pitch, yaw about fixed axes, rad, from a quaternion (w, x, y, z)."""
    rpy = [value + 0.0 for value in _roll_pitch_yaw(turn)]  # no -0
    ET.SubElement(parent, "origin", xyz=_numbers(place_m), rpy=_numbers(rpy))


def _roll_pitch_yaw(turn: Any) -> tuple[float, float, float]:
    nine = np.zeros(9)
    mujoco.mju_quat2Mat(nine, np.asarray(turn, dtype=np.float64))
    rotation = nine.reshape(3, 3)
    pitch = math.asin(float(np.clip(-rotation[2, 0], -1.0, 1.0)))
    if math.hypot(rotation[0, 0], rotation[1, 0]) < 1e-9:  # noqa: PLR2004 - straight up or down: yaw and roll are one
        return 0.0, pitch, math.atan2(-rotation[0, 1], rotation[1, 1])
    return math.atan2(rotation[2, 1], rotation[2, 2]), pitch, math.atan2(rotation[1, 0], rotation[0, 0])


def _add_geom(link: ET.Element, kind: str, model: Any, index: int) -> None:
    size, shape = model.geom_size[index], int(model.geom_type[index])
    if shape == _SPHERE:
        words, sizes = "sphere", {"radius": size[0]}
    elif shape in (_CYLINDER, _CAPSULE):  # a capsule without its ends, which URDF has not
        words, sizes = "cylinder", {"radius": size[0], "length": 2.0 * size[1]}
    elif shape == _BOX:
        _add(link, kind, model.geom_pos[index], model.geom_quat[index], "box", {"size": _numbers(2.0 * size)})
        return
    else:
        return
    text = {name: _text(value) for name, value in sizes.items()}
    _add(link, kind, model.geom_pos[index], model.geom_quat[index], words, text)


def _add_sole(link: ET.Element, model: Any, balls: list[int]) -> None:
    """Draw a foot: a box around its rounded corners, up to its joint."""
    low = (model.geom_pos[balls] - model.geom_size[balls, :1]).min(axis=0)
    high = (model.geom_pos[balls] + model.geom_size[balls, :1]).max(axis=0)
    high[2] = 0.0
    _add(link, "visual", (low + high) / 2.0, STILL, "box", {"size": _numbers(high - low)})


def _add_stand_in(link: ET.Element, model: Any, body: int) -> None:
    """Draw a body that has no geom: a rod up to the ends of its tendons, or a ball where it has mass alone."""
    sites = [index for index in range(model.nsite) if int(model.site_bodyid[index]) == body]
    height_m = max((float(model.site_pos[index][2]) for index in sites), default=0.0)
    if height_m > 0.0:
        sizes = {"radius": f"{_ROD_M:g}", "length": _text(height_m)}
        _add(link, "visual", (0.0, 0.0, height_m / 2.0), STILL, "cylinder", sizes)
    elif model.body_mass[body] > 0.0:
        _add(link, "visual", (0.0, 0.0, 0.0), STILL, "sphere", {"radius": f"{_BALL_M:g}"})


def _add(link: ET.Element, kind: str, place_m: Any, turn: Any, shape: str, sizes: dict[str, str]) -> None:
    part = ET.SubElement(link, kind)
    origin(part, place_m, turn)
    ET.SubElement(ET.SubElement(part, "geometry"), shape, sizes)
    if kind == "visual":
        name = "metal" if shape == "cylinder" else "printed"
        ET.SubElement(ET.SubElement(part, "material", name=name), "color", rgba=_TINTS[name])


VACUUM, STATE = "vacuum", "state"
"""Interfaces of a channel: Pa below ambient, and jammkle_msgs/ChannelJamState as a number."""
_JOINT_PLUGIN = "joint_state_topic_hardware_interface/JointStateTopicSystem"
_GPIO_PLUGIN = "cm_topic_hardware_component/CMTopicSystem"
LARGEST_VACUUM_PA = 70e3
"""Most that the driver takes, unless its parameter `max_vacuum_pa` says otherwise."""
_UNUSED = "unused_joint_commands"
"""Topic of commands that the joints' plugin asks for; nobody commands them."""


def control_tags(robot: Robot, names: UrdfNames, namespace: str) -> tuple[ET.Element, ET.Element]:
    """Return the tags of the joints and of the channels of a robot in a normalised namespace."""
    owner = namespace.strip("/").replace("/", "_") or robot.name
    joints = _system(f"{owner}_joints", _JOINT_PLUGIN)
    hardware = joints[0]
    for parameter, topic in (("joint_states_topic", JOINT_STATES.name), ("joint_commands_topic", _UNUSED)):
        ET.SubElement(hardware, "param", name=parameter).text = resolved(namespace, topic)
    for reported in names.reported:
        joint = ET.SubElement(joints, "joint", name=reported.unique)
        for interface in ("position", "velocity"):
            ET.SubElement(joint, "state_interface", name=interface)
    air = _system(f"{owner}_air", _GPIO_PLUGIN)
    for ankle in robot.ankles:
        for channel in CHANNELS:
            gpio = ET.SubElement(air, "gpio", name="_".join(part for part in (names.within(ankle), channel) if part))
            command = ET.SubElement(gpio, "command_interface", name=VACUUM)
            for bound, value_pa in (("min", 0.0), ("max", LARGEST_VACUUM_PA)):
                ET.SubElement(command, "param", name=bound).text = f"{value_pa:g}"
            for interface in (VACUUM, STATE):
                ET.SubElement(gpio, "state_interface", name=interface)
    return joints, air


def _system(name: str, plugin: str) -> ET.Element:
    system = ET.Element("ros2_control", name=name, type="system")
    ET.SubElement(ET.SubElement(system, "hardware"), "plugin").text = plugin
    return system
