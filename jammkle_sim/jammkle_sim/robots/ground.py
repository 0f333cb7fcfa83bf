"""Ground under a robot, a plane or a height field drawn from a seed, rising toward x; and robots put onto it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_sim.physics.ankle import AnkleParameters
from jammkle_sim.physics.constants import tendon_parameters
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.physics.pneumatics import PneumaticParameters
from jammkle_sim.physics.sensors import SensorParameters
from jammkle_sim.rigs.model import new_spec, release
from jammkle_sim.rigs.options import checked
from jammkle_sim.rigs.rig import GROUND, Event
from jammkle_sim.robots.options import Behaviour
from jammkle_sim.robots.robot import Robot

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from jammkle_sim.rigs.rig import JointControl
    from jammkle_sim.robots.options import RobotOptions
    from jammkle_sim.robots.robot import AttachedAnkle


_HALF_M = (4.0, 1.5)
"""Half the length and width of rough ground. Assumed: ten seconds of the fastest walk."""
_CELL_M = 0.02
"""Spacing of its heights."""
_BUMP_M = 0.05
"""Standard deviation of the Gaussian that smooths them: bumps as large as a foot. Assumed."""
_STREAM = 77
"""Keeps the ground's random numbers apart from the sensors' of the same seed."""


@dataclass(frozen=True)
class Ground:
    """Where the ground is."""

    slope_rad: float
    heights_m: NDArray[np.float64] | None
    """Across the slope, rows along y, columns along x; None: a plane."""

    @staticmethod
    def drawn(slope_deg: float, roughness_m: float, seed: int) -> Ground:
        """Return a ground; a rough one has the same bumps for the same seed, as high as asked for.

        Args:
            slope_deg: Inclination, degrees.
            roughness_m: From the lowest to the highest point, m; 0 is a plane.
            seed: Of the bumps.

        """
        if roughness_m == 0.0:
            return Ground(math.radians(slope_deg), None)
        from scipy.ndimage import gaussian_filter  # type: ignore[import-untyped]  # noqa: PLC0415 - see `rigs.guide`

        columns, rows = (round(2.0 * half_m / _CELL_M) + 1 for half_m in _HALF_M)
        white = np.random.Generator(np.random.Philox(key=seed, counter=[0, 0, 0, _STREAM])).standard_normal(
            (rows, columns)
        )
        smooth = gaussian_filter(white, _BUMP_M / _CELL_M, mode="wrap")
        smooth = (smooth - smooth.min()) / np.ptp(smooth)
        return Ground(math.radians(slope_deg), roughness_m * smooth)

    def add_to(self, spec: Any, contact_time_s: float) -> None:
        """Add the ground to a mujoco.MjSpec, with the time constant of a contact, s; the feet have the friction."""
        turn = (math.cos(self.slope_rad / 2.0), 0.0, -math.sin(self.slope_rad / 2.0), 0.0)
        common = {
            "name": GROUND,
            "quat": turn,
            "solref": (contact_time_s, 1.0),
            "friction": (1.0, 0.0, 0.0),
            "conaffinity": 3,
        }
        if self.heights_m is None:
            spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=(0.0, 0.0, 0.1), **common)
            return
        roughness_m = float(np.ptp(self.heights_m))
        rows, columns = self.heights_m.shape
        spec.add_hfield(
            name=GROUND,
            size=(*_HALF_M, roughness_m, 0.1),
            nrow=rows,
            ncol=columns,
            userdata=(self.heights_m / roughness_m).ravel(),
        )
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname=GROUND, **common)

    def height_m(self, x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how high the ground is, m, straight up, at places in the world."""
        # Bumps stand across the slope: at these gentle heights a place's own bump is the one above it.
        along_m = x_m / math.cos(self.slope_rad)
        bumps_m = np.zeros_like(along_m)
        if self.heights_m is not None:
            from scipy.ndimage import map_coordinates  # noqa: PLC0415 - as above

            at = np.array([(y_m + _HALF_M[1]) / _CELL_M, (along_m + _HALF_M[0]) / _CELL_M])
            bumps_m = map_coordinates(self.heights_m, at, order=1, mode="nearest")
        height_m: NDArray[np.float64] = x_m * math.tan(self.slope_rad) + bumps_m / math.cos(self.slope_rad)
        return height_m


IMPEDANCE_RATIO = 100.0
"""MuJoCo's impratio, as in the slip rig: a foot that sticks creeps by a hundredth of a millimetre a second, and by a
millimetre with the 10 of the other rigs. It costs no time."""


class Building:
    """One of our robots on its ground while it is built: its model, and what all its limbs are built with."""

    def __init__(self, name: str, base: str, options: RobotOptions) -> None:
        """Begin a model with the ground alone; the first body will be called `base`, and may bear an IMU for all.

        Raises:
            ParameterError: an option out of range.

        """
        self.name, self.base = name, base
        self.options = checked(options)
        self.ankle = AnkleParameters(hang_pitch_rad=math.radians(options.hang_pitch_deg))
        """Constants of every ankle."""
        self.sensors = SensorParameters(seed=options.seed)
        self.ground = Ground.drawn(options.slope_deg, options.roughness_m, options.seed)
        self.spec = new_spec(name, options.timestep_s)
        """The mujoco.MjSpec."""
        self.spec.option.impratio = IMPEDANCE_RATIO
        self.ground.add_to(self.spec, self.ankle.contact_time_s)

    @property
    def is_held(self) -> bool:
        """Whether the robot begins held in the air."""
        return self.options.behaviour in {Behaviour.DROP.value, Behaviour.HANG.value}

    def finished(
        self,
        ankles: tuple[AttachedAnkle, ...],
        joints: Mapping[str, float],
        control: Callable[[Any], JointControl],
        parts: Mapping[str, Any],
    ) -> Robot:
        """Compile the model, whose lowest foot starts on the ground or as far above it as it shall fall.

        Args:
            ankles: Whose feet stand.
            joints: Start of the servos and their targets, by name, rad.
            control: Makes what moves the joints, of the mujoco.MjModel.
            parts: Every dataclass of constants that the robot alone has, by name.

        """
        options, spec = self.options, self.spec
        drop_m = options.drop_height_m if self.is_held else 0.0
        spec.body(self.base).pos[2] += drop_m - _clearance_m(spec.compile(), self.ground, ankles, joints)
        model = spec.compile()
        spec.add_key(name="start", qpos=_start(model, joints).tolist(), ctrl=_controls(model, joints).tolist())
        model = spec.compile()
        return Robot(
            name=self.name,
            spec=spec,
            model=model,
            ankles=ankles,
            base=self.base,
            tendon=tendon_parameters(options.parameter_set),
            pneumatics=PneumaticParameters(reservoir_volume_m3=options.reservoir_volume_m3),
            sensors=self.sensors,
            control=control(model),
            events=_events_of(options, ankles),
            options=options,
            parts={"ankle": self.ankle, **parts},
        )


def _events_of(options: RobotOptions, ankles: tuple[AttachedAnkle, ...]) -> tuple[Event, ...]:
    """Return what happens to a robot, apart from its own doing."""
    if options.behaviour == Behaviour.DROP.value:
        return (Event(round(options.release_time_s / options.timestep_s), release),)
    if options.behaviour == Behaviour.SLIP.value:
        corners = tuple(corner for ankle in ankles for corner in ankle.corners)
        return (Event(round(options.slip_time_s / options.timestep_s), TurnSlippery(corners, options.slip_friction)),)
    return ()


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
