"""URDF of a robot from its MuJoCo model: links with the model's inertias, joints, frames of sensors, ros2_control.

Format: http://wiki.ros.org/urdf/XML. Where the two differ:

- A body may have several hinges, a link hangs on one joint. Between two hinges of a body comes a link that takes a
  thousandth of the body's mass and inertia, in the same place, so that they still add up to the body's.
- What joins the robot to the world (a free joint, a boom) is left out: `odometry` tells where `base_link` is. That link
  has no mass, as robot_state_publisher (KDL) wants it.
- What has no place in URDF is left out: tendons, springs, the motors' inertia behind their gears.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import numpy as np

from jammkle_common.names import (
    BASE_FRAME,
    CHANNELS,
    IMU_FRAME,
    LOAD_CELL_FRAME,
    MANIFOLD_FRAME,
    TENDONS_OF_CHANNEL,
)
from jammkle_common.parameters import ParameterError
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.physics.kernels import LARGEST_SPEED
from jammkle_sim.robots.urdf_control import control_tags
from jammkle_sim.robots.urdf_names import UrdfNames
from jammkle_sim.robots.urdf_shapes import STILL, add_shapes, origin

if TYPE_CHECKING:
    from jammkle_sim.robots.robot import Robot

BETWEEN_SHARE = 1e-3
"""Share of a body's mass and inertia that goes to each link between two of its hinges: some simulators refuse or drop
links that weigh nothing. Chosen small enough to move no centre of mass by more than some micrometres."""
_HINGE, _SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
_KINDS = {_HINGE: "revolute", _SLIDE: "prismatic"}


def robot_urdf(robot: Robot, namespace: str = "/") -> str:
    """Return the URDF of a robot as text.

    Args:
        robot: The robot.
        namespace: Normalised ROS namespace of the robot, which its frames begin with.

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


class _Body:
    """One body of the model on its way into the tree."""

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
            child = self._link if index == between else f"{self._link}_{_axis_word(name)}"
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
        if kind not in _KINDS or np.any(model.jnt_pos[index]) or reference:
            msg = (
                f"joint '{model.joint(index).name}' has no counterpart in URDF: it must be a hinge or a slide through "
                "the origin of its body whose reference is 0"
            )
            raise ParameterError(msg)
        limited = bool(model.jnt_limited[index])
        word = "continuous" if kind == _HINGE and not limited else _KINDS[kind]
        joint = ET.SubElement(self._tree, "joint", name=name, type=word)
        origin(joint, place_m, turn)
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=child)
        ET.SubElement(joint, "axis", xyz=" ".join(_text(each) for each in model.jnt_axis[index]))
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


def _axis_word(joint: str) -> str:
    """Return what tells one joint of a body from its others: `pitch` of `lf_ankle_pitch`."""
    return joint.rpartition("_")[2]


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
