"""The MuJoCo model of what a robot stands in, where bodies and tendons are, and what can be changed while it runs."""

from __future__ import annotations

import dataclasses
import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from jammkle_common.names import ANKLE_JOINTS, TENDONS
from jammkle_common.parameters import ParameterError
from jammkle_sim.physics.ankle import AnkleParameters
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.rigs.catalogue import RIGS
from jammkle_sim.robots.catalogue import robot
from jammkle_sim.robots.options import ROBOTS, Behaviour, RobotOptions

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from jammkle_view.core.samples import Base

_BASE = 1
"""Body that carries a robot: the first after the world."""
GROUNDS = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))
BALL = int(mujoco.mjtGeom.mjGEOM_SPHERE)
"""Kinds of geoms, as a model numbers them."""
_FOOT_BALLS = 4
"""Rounded corners of a sole."""
_SITE = int(mujoco.mjtWrap.mjWRAP_SITE)


def tendon_sites(model: Any) -> dict[str, tuple[int, ...]]:
    """Return the sites that each tendon passes through, in order, by name of the tendon."""
    found = {}
    for index in range(model.ntendon):
        first, count = int(model.tendon_adr[index]), int(model.tendon_num[index])
        wraps = range(first, first + count)
        found[model.tendon(index).name] = tuple(
            int(model.wrap_objid[place]) for place in wraps if int(model.wrap_type[place]) == _SITE
        )
    return found


class Kinematics:
    """A model that is moved by the positions of its joints, without any dynamics."""

    def __init__(self, model: Any) -> None:
        """Stand at the start of a mujoco.MjModel: at its keyframe, if it has one."""
        self._model = model
        self._data = mujoco.MjData(model)
        if model.nkey:
            mujoco.mj_resetDataKeyframe(model, self._data, 0)
        simple = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
        self._address = {
            model.joint(index).name: int(model.jnt_qposadr[index])
            for index in range(model.njnt)
            if int(model.jnt_type[index]) in simple
        }
        kinds = [int(kind) for kind in model.geom_type]
        self._ground = next((index for index, kind in enumerate(kinds) if kind in GROUNDS), None)
        balls = [int(model.geom_bodyid[index]) for index, kind in enumerate(kinds) if kind == BALL]
        self._corners = [
            index
            for index, kind in enumerate(kinds)
            if kind == BALL and balls.count(int(model.geom_bodyid[index])) >= _FOOT_BALLS
        ]
        self.bodies: tuple[str, ...] = tuple(model.body(index).name for index in range(1, model.nbody))
        """Names, in the order of `positions_m` and `rotations`; the world is not among them."""
        sites = tendon_sites(model)
        pairs = [(name, begin, end) for name, places in sites.items() for begin, end in itertools.pairwise(places)]
        self.segments: tuple[str, ...] = tuple(name for name, _, _ in pairs)
        """Name of the tendon that each straight piece belongs to."""
        self._begins = [begin for _, begin, _ in pairs]
        self._ends = [end for _, _, end in pairs]
        self.move({})

    def move(self, positions: Mapping[str, float], base: Base | None = None) -> None:
        """Put joints where they are, rad or m; names that the model does not have are passed over.

        Args:
            positions: By name.
            base: Where the body that carries the robot is; None: where the model has it.

        """
        for name, value in positions.items():
            address = self._address.get(name)
            if address is not None:
                self._data.qpos[address] = value
        mujoco.mj_kinematics(self._model, self._data)
        self._turn, self._matrix, self._shift_m = np.array((1.0, 0.0, 0.0, 0.0)), np.eye(3), np.zeros(3)
        if base is not None:
            back, matrix = np.zeros(4), np.zeros(9)
            mujoco.mju_negQuat(back, self._data.xquat[_BASE])
            mujoco.mju_mulQuat(self._turn, np.array(base.rotation), back)
            mujoco.mju_normalize4(self._turn)
            mujoco.mju_quat2Mat(matrix, self._turn)
            self._matrix = matrix.reshape(3, 3)
            self._shift_m = np.array(base.position_m) - self._matrix @ self._data.xpos[_BASE]

    @property
    def travel_m(self) -> NDArray[np.float64]:
        """Way along the ground to below the base from below where the model has its origin, m."""
        x, y, _ = self._placed(self._data.xpos[_BASE])
        nx, ny, nz = self.ground_matrix[:, 2]
        return np.array((x, y, -(nx * x + ny * y) / nz))

    @property
    def ground_matrix(self) -> NDArray[np.float64]:
        """Axes of the ground as columns: along it, to the left, up from it; level where there is none."""
        if self._ground is None:
            return np.eye(3)
        found: NDArray[np.float64] = self._data.geom_xmat[self._ground].reshape(3, 3)
        return found

    @property
    def ground_rotation(self) -> NDArray[np.float64]:
        """The same as a quaternion (w, x, y, z)."""
        turn = np.zeros(4)
        mujoco.mju_mat2Quat(turn, self.ground_matrix.ravel())
        return turn

    def _placed(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        found: NDArray[np.float64] = points_m @ self._matrix.T + self._shift_m
        return found

    @property
    def clearance_m(self) -> float:
        """How far the lowest foot is above the ground, straight up, m; 0 where there is no ground or no foot.

        Bumps of rough ground are left out.
        """
        if self._ground is None or not self._corners:
            return 0.0
        normal = self.ground_matrix[:, 2]
        above_m = (self._placed(self._data.geom_xpos[self._corners]) - self._data.geom_xpos[self._ground]) @ normal
        return float((above_m - self._model.geom_size[self._corners, 0]).min() / normal[2])

    @property
    def positions_m(self) -> NDArray[np.float64]:
        """Origin of each body, shape (bodies, 3), m."""
        return self._placed(self._data.xpos[1:])

    @property
    def rotations(self) -> NDArray[np.float64]:
        """Orientation of each body as a quaternion (w, x, y, z), shape (bodies, 4)."""
        w, x, y, z = self._turn
        left = np.array(((w, -x, -y, -z), (x, w, -z, y), (y, z, w, -x), (z, -y, x, w)))  # quaternions multiply so
        found: NDArray[np.float64] = self._data.xquat[1:] @ left.T
        return found

    @property
    def segment_ends_m(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Begin and end of each straight piece of a tendon, each of shape (segments, 3), m."""
        return self._placed(self._data.site_xpos[self._begins]), self._placed(self._data.site_xpos[self._ends])


def along(
    begins_m: NDArray[np.float64], ends_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return quaternions (w, x, y, z), (n, 4), and lengths, (n,), m, that lay cylinders of axis z from begin to end."""
    way_m = ends_m - begins_m
    length_m: NDArray[np.float64] = np.linalg.norm(way_m, axis=1)
    axis = way_m / np.maximum(length_m, 1e-9)[:, np.newaxis]
    # The shortest turn from z to the axis: half the angle, about z cross axis.
    turn = np.stack((1.0 + axis[:, 2], -axis[:, 1], axis[:, 0], np.zeros(len(axis))), axis=1)
    size = np.linalg.norm(turn, axis=1)
    turn[size < 1e-6] = (0.0, 1.0, 0.0, 0.0)  # noqa: PLR2004 - straight down: half a turn about x
    rotation: NDArray[np.float64] = turn / np.where(size < 1e-6, 1.0, size)[:, np.newaxis]  # noqa: PLR2004 - as above
    return rotation, length_m


HANGING = "pressure"
"""Rig that stands for an ankle of which nothing says what it stands in: it hangs in the air."""


Naming = dict[str, str]
"""What an ankle's joints and tendons are called in the model, by what topics call them; those that differ alone."""


@dataclasses.dataclass(frozen=True)
class Setting:
    """What a robot stands in."""

    rig: str
    """Name of the rig, or of the robot."""
    options: dict[str, Any]
    """By name."""
    model: Any
    """The mujoco.MjModel."""
    ankles: Mapping[str, Naming] = dataclasses.field(default_factory=lambda: {"": {}})
    """Its ankles, by namespace below that of the whole; a single one is in that."""
    floats: bool = False
    """Whether nothing says where its body is: it is then drawn with its lowest foot on the ground."""


def setting_of(description: str) -> Setting:
    """Return what a text of sim_parameters describes; a hanging ankle where it describes nothing that is known."""
    content = described(description)
    try:
        if "robot" in content:
            return _robot(str(content["robot"]), content)
        if content.get("rig") in RIGS:
            return _rig(content["rig"], content)
    except (ParameterError, TypeError):  # of another version of this project
        pass
    return _rig(HANGING, {})


def described(description: str) -> dict[str, Any]:
    """Return what a text of sim_parameters says; nothing of what is not YAML."""
    try:
        content = yaml.safe_load(description)
    except yaml.YAMLError:
        return {}
    return content if isinstance(content, dict) else {}


def known(table: Any, content: Mapping[str, Any]) -> dict[str, Any]:
    """Return those of the options in a description that a table has; those of another version are left out."""
    fields = {field.name for field in dataclasses.fields(table)}
    return {name: value for name, value in _options(content).items() if name in fields}


def _options(content: Mapping[str, Any]) -> dict[str, Any]:
    return dict(content.get("options") or {})


def _rig(rig: str, content: Mapping[str, Any]) -> Setting:
    kind, ankle = RIGS[rig], dict(content.get("ankle") or {})
    other = {} if kind.ankle is None or not ankle else {"ankle": AnkleParameters(**ankle)}
    built, _ = kind.build(kind.options(**known(kind.options, content)), **other)
    return Setting(rig, _options(content), built.model)


def _robot(name: str, content: Mapping[str, Any]) -> Setting:
    built = robot(name, RobotOptions(**known(RobotOptions, content)))
    several = len(built.ankles) > 1
    ankles = {
        ankle.name if several else "": {
            **{name: ankle.named(name) for name in (*ANKLE_JOINTS, *TENDONS)},
            **ankle.joints,
        }
        for ankle in built.ankles
    }
    return Setting(name, _options(content), built.model, ankles, floats=True)


_LANDING = "landing"
"""Rig of the sim node, whose slope and drop height may be changed."""
_STEEPEST_DEG = {_LANDING: 50.0, **dict.fromkeys(ROBOTS, 40.0)}
"""As far as the simulation allows."""
_HIGHEST_MM = 200.0
"""Chosen: four times the default; the simulation allows 500 mm."""


@dataclass(frozen=True)
class Knob:
    """A number of the simulation, as a slider offers it."""

    parameter: str
    label: str
    minimum: float
    maximum: float
    step: float
    start: float
    per_unit: float = 1.0
    """What one unit of the slider is in the parameter's unit."""
    hint: str = ""


def knobs_of(setting: Setting) -> tuple[Knob, ...]:
    """Return what can be changed while a setting is simulated."""
    hint = "Holds from the next reset on"
    knobs = [Knob("speed", "speed", 0.05, 2.0, 0.05, 1.0, hint="Simulated time per real time")]
    if setting.rig in _STEEPEST_DEG:
        slope_deg = float(setting.options["slope_deg"])
        steepest_deg = _STEEPEST_DEG[setting.rig]
        knobs.append(Knob("slope_deg", "slope [deg]", 0.0, steepest_deg, 1.0, slope_deg, hint=hint))
    if setting.rig == _LANDING or setting.options.get("behaviour") == Behaviour.DROP.value:
        height_mm = 1e3 * float(setting.options["drop_height_m"])
        knobs.append(Knob("drop_height_m", "drop height [mm]", 0.0, _HIGHEST_MM, 5.0, height_mm, 1e-3, hint))
    return tuple(knobs)
