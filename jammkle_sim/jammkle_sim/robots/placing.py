"""Put a robot onto its ground, hold it until it is dropped, and turn the ground slippery."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_sim.physics.engine import mujoco
from jammkle_sim.rigs.rig import Event
from jammkle_sim.robots.options import Behaviour

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_sim.robots.attach import AttachedAnkle
    from jammkle_sim.robots.ground import Ground
    from jammkle_sim.robots.options import RobotOptions

IMPEDANCE_RATIO = 100.0
"""MuJoCo's impratio, as in the slip rig: a foot that sticks creeps by a hundredth of a millimetre a second, and by a
millimetre with the 10 of the other rigs. It costs no time."""
HOLD = "hold"
"""Equality constraint that keeps the base where it starts, until it is released."""


def compiled_on(
    spec: Any, base: Any, ground: Ground, ankles: tuple[AttachedAnkle, ...], joints: Mapping[str, float], drop_m: float
) -> Any:
    """Compile a model whose lowest foot starts so far above the ground.

    Args:
        spec: The mujoco.MjSpec, otherwise finished; its base is moved and a keyframe added.
        base: Its first body.
        ground: Where the ground is.
        ankles: Whose feet stand.
        joints: Start of the servos and their targets, by name, rad.
        drop_m: Height to fall, straight down.

    Returns:
        The mujoco.MjModel.

    """
    model = spec.compile()
    base.pos[2] += drop_m - _clearance_m(model, ground, ankles, joints)
    model = spec.compile()
    spec.add_key(name="start", qpos=_start(model, joints).tolist(), ctrl=_controls(model, joints).tolist())
    return spec.compile()


def events_of(options: RobotOptions, ankles: tuple[AttachedAnkle, ...]) -> tuple[Event, ...]:
    """Return what happens to a robot, apart from its own doing."""
    if options.behaviour == Behaviour.DROP.value:
        return (Event(round(options.release_time_s / options.timestep_s), release),)
    if options.behaviour == Behaviour.SLIP.value:
        corners = tuple(corner for ankle in ankles for corner in ankle.corners)
        return (Event(round(options.slip_time_s / options.timestep_s), TurnSlippery(corners, options.slip_friction)),)
    return ()


def release(data: Any) -> None:
    """Let go of a held base."""
    for index in range(data.model.neq):
        if data.model.equality(index).name.startswith(HOLD):
            data.eq_active[index] = 0


@dataclass(frozen=True)
class TurnSlippery:
    """Changes the friction of all feet."""

    corners: tuple[str, ...]
    """Names of the geoms that touch the ground."""
    friction: float

    def __call__(self, data: Any) -> None:
        """Do it."""
        for corner in self.corners:
            data.model.geom_friction[data.model.geom(corner).id, 0] = self.friction


def _clearance_m(model: Any, ground: Ground, ankles: tuple[AttachedAnkle, ...], joints: Mapping[str, float]) -> float:
    """Return how far down, m, the first rounded corner is from touching."""
    data = mujoco.MjData(model)
    data.qpos[:] = _start(model, joints)
    mujoco.mj_kinematics(model, data)
    corners = [model.geom(name) for ankle in ankles for name in ankle.corners]
    places_m = np.array([data.geom_xpos[corner.id] for corner in corners])
    radii_m = np.array([corner.size[0] for corner in corners])
    below_m = places_m[:, 2] - ground.height_m(places_m[:, 0], places_m[:, 1])
    return float((below_m - radii_m / np.cos(ground.slope_rad)).min())


def _start(model: Any, joints: Mapping[str, float]) -> Any:
    start = model.qpos0.copy()
    for name, angle_rad in joints.items():
        start[model.joint(name).qposadr[0]] = angle_rad
    return start


def _controls(model: Any, joints: Mapping[str, float]) -> Any:
    controls = np.zeros(model.nu)
    for name, angle_rad in joints.items():
        controls[model.actuator(name).id] = angle_rad
    return controls
