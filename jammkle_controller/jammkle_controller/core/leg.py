"""What a leg is, read from the robot's URDF (REP-103 frames, SI): lengths, masses, its place on the body, its sole.

The leg's joints are called as in joint_states, behind a prefix where the description has several legs. Hip and knee
turn about y, to the left; at zero the links hang straight below one another, each with its mass about half-way down.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple
from xml.etree import ElementTree as ET

from jammkle_common.names import ANKLE_JOINTS
from jammkle_common.parameters import ParameterError
from jammkle_controller.core.motion import ZERO, Vector, cross, dot

if TYPE_CHECKING:
    from collections.abc import Iterator

    from jammkle_controller.parameters import ControllerParameters


@dataclass(frozen=True)
class Leg:
    """A leg of two links that hang down, and where it is on the body: what `robot_description` says of it."""

    thigh_m: float
    """From hip to knee."""
    shank_m: float
    """From knee to the ankle's joint."""
    thigh_kg: float
    """Taken for a rod."""
    shank_kg: float
    """With ankle and foot; taken for a rod."""
    shank_centre_m: float
    """From the knee to the centre of that mass."""
    abduction: str = ""
    """Name of the joint above the hip in joint_states, which turns about x; empty: there is none."""
    hip_m: Vector = ZERO
    """Of the axis of abduction, or of the hip where there is none, in base_link, the frame of the body's twist."""
    offset_m: float = 0.0
    """From there to the left to the plane of the leg."""
    lean_rad: float = 0.0
    """Pitch of the ankle's frame against the shank's: the shank's lean as it stands."""
    toe_m: float = 0.0
    heel_m: float = 0.0
    half_width_m: float = 0.0
    sole_m: float = 0.0
    """From the ankle's joint to the corners of the sole: forward, backward, to both sides, down."""
    lever_m: Vector = ZERO
    """From the IMU to the middle of the sole, in the IMU's frame."""


STRAIGHT = 0.05
"""Largest share of a link's length by which its lower joint may be before or behind its upper one at zero."""
_ANKLE = ANKLE_JOINTS[1]
"""The joint of the ankle that comes first, below the shank: its pitch."""
_X, _Y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
_TO_AXIS = 1e-3


class _Place(NamedTuple):
    """A frame in another: its origin, m, and its axes."""

    origin: Vector
    axes: tuple[Vector, Vector, Vector]

    def point(self, point: Vector) -> Vector:
        """Return a point of the frame in the other."""
        x, y, z = (sum(point[k] * self.axes[k][i] for k in range(3)) for i in range(3))
        return (self.origin[0] + x, self.origin[1] + y, self.origin[2] + z)

    def within(self, inner: _Place) -> _Place:
        """Return a frame that is given in this one in the other."""
        turned = [tuple(a - b for a, b in zip(self.point(axis), self.origin, strict=True)) for axis in inner.axes]
        return _Place(self.point(inner.origin), (turned[0], turned[1], turned[2]))  # type: ignore[arg-type]  # three each

    def local(self, point: Vector) -> Vector:
        """Return a point of the other in this frame."""
        way = (point[0] - self.origin[0], point[1] - self.origin[1], point[2] - self.origin[2])
        return (dot(way, self.axes[0]), dot(way, self.axes[1]), dot(way, self.axes[2]))


_HERE = _Place(ZERO, ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))


class _Joint(NamedTuple):
    """A joint of the description."""

    name: str
    kind: str
    parent: str
    child: str
    place: _Place
    axis: Vector


class _Tree:
    """Links and joints of a description, at zero angles."""

    def __init__(self, text: str) -> None:
        try:
            root = ET.fromstring(text)  # noqa: S314 - the robot's own description; ElementTree loads nothing from outside
        except ET.ParseError as error:
            msg = f"robot_description is no XML: {error}"
            raise ParameterError(msg) from error
        self._links = {link.get("name", ""): link for link in root.findall("link")}
        self.joints = {joint.name: joint for joint in map(_joint, root.findall("joint"))}
        self.above = {joint.child: joint for joint in self.joints.values()}

    def link(self, name: str) -> ET.Element:
        """Return a link by its name.

        Raises:
            ParameterError: there is none.

        """
        if name not in self._links:
            msg = f"robot_description has no link '{name}'"
            raise ParameterError(msg)
        return self._links[name]

    def joint(self, prefix: str, name: str) -> _Joint:
        """Return a joint by its name, with the prefix or, where the description has the whole name, without.

        Raises:
            ParameterError: there is none.

        """
        found = self.joints.get(prefix + name, self.joints.get(name))
        if found is None:
            moving = ", ".join(joint.name for joint in self.joints.values() if joint.kind != "fixed")
            msg = f"robot_description has no joint '{prefix}{name}' (joint_prefix and name); it has: {moving}"
            raise ParameterError(msg)
        return found

    def place(self, link: str, base: str = "") -> _Place:
        """Return where a link is in another above it; empty: in the root."""
        place = _HERE
        while link != base and link in self.above:
            joint = self.above[link]
            place = joint.place.within(place)
            link = joint.parent
        return place

    def below(self, link: str) -> Iterator[str]:
        """Return a link and every one that hangs on it."""
        yield link
        for joint in self.joints.values():
            if joint.parent == link:
                yield from self.below(joint.child)

    def mass(self, link: str) -> tuple[float, Vector]:
        """Return mass, kg, and its centre, in that link's frame, of a link and what hangs on it."""
        mass_kg, moment = 0.0, [0.0, 0.0, 0.0]
        for name in self.below(link):
            inertial = self.link(name).find("inertial")
            if inertial is None:
                continue
            own_kg = float(_attribute(inertial, "mass", "value", "0"))
            centre = self.place(name, link).point(_place(inertial).origin)
            mass_kg += own_kg
            moment = [sum_ + own_kg * part for sum_, part in zip(moment, centre, strict=True)]
        x, y, z = (part / mass_kg if mass_kg else 0.0 for part in moment)
        return mass_kg, (x, y, z)


def leg_of(description: str, parameters: ControllerParameters) -> Leg:
    """Return the leg of a controller.

    Args:
        description: URDF of the robot.
        parameters: Which joints are the leg's, and which link carries the IMU.

    Raises:
        ParameterError: it is no URDF, lacks a joint or link, or the leg is built otherwise; the line says which.

    """
    tree = _Tree(description)
    prefix = parameters.joint_prefix
    hip, knee, ankle = (tree.joint(prefix, name) for name in (parameters.hip_joint, parameters.knee_joint, _ANKLE))
    for joint in (hip, knee, ankle):
        if math.dist(joint.axis, _Y) > _TO_AXIS:
            msg = f"joint '{joint.name}' of robot_description turns about {joint.axis}; it must be 0 1 0, to the left"
            raise ParameterError(msg)
    abduction = _abduction(tree, hip.parent)
    top = abduction or hip
    to_knee = tree.place(knee.parent, hip.child).within(knee.place).origin
    to_ankle = tree.place(ankle.parent, knee.child).within(ankle.place)
    for what, way in ((knee, to_knee), (ankle, to_ankle.origin)):
        if way[2] >= 0.0 or abs(way[0]) > STRAIGHT * -way[2]:
            msg = f"joint '{what.name}' of robot_description is at {way} of the one above; it must be straight below it"
            raise ParameterError(msg)
    offset_m = to_knee[1] + to_ankle.origin[1]
    if abduction is not None:
        offset_m += tree.place(hip.parent, abduction.child).within(hip.place).origin[1]
    both_kg, _ = tree.mass(hip.child)
    shank_kg, centre = tree.mass(knee.child)
    toe_m, heel_m, half_width_m, sole_m = _sole(tree, ankle)
    return Leg(
        thigh_m=-to_knee[2],
        shank_m=-to_ankle.origin[2],
        thigh_kg=both_kg - shank_kg,
        shank_kg=shank_kg,
        shank_centre_m=-centre[2],
        abduction="" if abduction is None else abduction.name.removeprefix(prefix),
        hip_m=tree.place(top.parent).within(top.place).origin,
        offset_m=offset_m,
        lean_rad=math.atan2(to_ankle.axes[2][0], to_ankle.axes[2][2]),
        toe_m=toe_m,
        heel_m=heel_m,
        half_width_m=half_width_m,
        sole_m=sole_m,
        lever_m=_lever(tree, ankle, sole_m, parameters.imu_link),
    )


def _abduction(tree: _Tree, link: str) -> _Joint | None:
    """Return the joint about x above the hip, if there is one."""
    while link in tree.above:
        joint = tree.above[link]
        if joint.kind != "fixed":
            return joint if math.dist(joint.axis, _X) <= _TO_AXIS else None
        link = joint.parent
    return None


def _sole(tree: _Tree, ankle: _Joint) -> tuple[float, float, float, float]:
    """Return how far what touches the ground reaches from the ankle's joint: forward, backward, sideways, down, m.

    Of spheres the lowest points count, of boxes the corners; meshes say nothing, and the sole is then the joint.
    """
    points = []
    for name in tree.below(ankle.child):
        place = tree.place(name, ankle.child)
        for collision in tree.link(name).findall("collision"):
            shape = place.within(_place(collision))
            radius = _attribute(collision, "geometry/sphere", "radius", "")
            size = _numbers(_attribute(collision, "geometry/box", "size", ""))
            if radius:
                x, y, z = shape.origin
                points.append((x, y, z - float(radius)))
            elif size:
                corners = itertools.product(*((-edge / 2.0, edge / 2.0) for edge in size))
                points += [shape.point((x, y, z)) for x, y, z in corners]
    if not points:
        return 0.0, 0.0, 0.0, 0.0
    return (
        max(point[0] for point in points),
        -min(point[0] for point in points),
        max(abs(point[1]) for point in points),
        -min(point[2] for point in points),
    )


def _lever(tree: _Tree, ankle: _Joint, sole_m: float, imu: str) -> Vector:
    """Return the way from the IMU to the sole below the ankle's joint, in the IMU's frame; no IMU is named: none."""
    if not imu:
        return ZERO
    tree.link(imu)
    return tree.place(imu).local(tree.place(ankle.child).point((0.0, 0.0, -sole_m)))


def _joint(element: ET.Element) -> _Joint:
    x, y, z = _numbers(_attribute(element, "axis", "xyz", "1 0 0"))
    return _Joint(
        element.get("name", ""),
        element.get("type", ""),
        _attribute(element, "parent", "link", ""),
        _attribute(element, "child", "link", ""),
        _place(element),
        (x, y, z),
    )


def _place(element: ET.Element) -> _Place:
    """Return the origin of a joint, inertial or collision; roll, pitch, yaw are about the axes outside of it."""
    x, y, z = _numbers(_attribute(element, "origin", "xyz", "0 0 0"))
    roll, pitch, yaw = _numbers(_attribute(element, "origin", "rpy", "0 0 0"))
    forward = (math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), -math.sin(pitch))
    left = (
        math.cos(yaw) * math.sin(pitch) * math.sin(roll) - math.sin(yaw) * math.cos(roll),
        math.sin(yaw) * math.sin(pitch) * math.sin(roll) + math.cos(yaw) * math.cos(roll),
        math.cos(pitch) * math.sin(roll),
    )
    return _Place((x, y, z), (forward, left, cross(forward, left)))


def _attribute(element: ET.Element, path: str, name: str, missing: str) -> str:
    found = element.find(path)
    return missing if found is None else found.get(name, missing)


def _numbers(text: str) -> list[float]:
    try:
        return [float(part) for part in text.split()]
    except ValueError as error:
        msg = f"robot_description has '{text}' where numbers must be"
        raise ParameterError(msg) from error
