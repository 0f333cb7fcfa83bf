"""Shapes of a link: what the model's geoms are, and boxes and rods where it has none to look at."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import numpy as np

from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from numpy.typing import NDArray

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
    """Add visual and collision elements to a link.

    Args:
        link: Where they go.
        model: The mujoco.MjModel.
        body: Number of the body.

    """
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
    xyz = " ".join(f"{float(value):.9g}" for value in place_m)
    rpy = " ".join(f"{value + 0.0:.9g}" for value in _roll_pitch_yaw(turn))  # no -0
    ET.SubElement(parent, "origin", xyz=xyz, rpy=rpy)


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
    told = {name: f"{float(value):.9g}" for name, value in sizes.items()}
    _add(link, kind, model.geom_pos[index], model.geom_quat[index], words, told)


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
        sizes = {"radius": f"{_ROD_M:g}", "length": f"{height_m:.9g}"}
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


def _numbers(values: NDArray[np.float64]) -> str:
    return " ".join(f"{float(value):.9g}" for value in values)
