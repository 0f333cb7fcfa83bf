"""Ground under a robot: a plane or a height field drawn from a seed, inclined, rising toward x."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates  # type: ignore[import-untyped]  # carries no types

from jammkle_sim.physics.engine import mujoco
from jammkle_sim.rigs.rig import GROUND

if TYPE_CHECKING:
    from numpy.typing import NDArray

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
        columns, rows = (round(2.0 * half_m / _CELL_M) + 1 for half_m in _HALF_M)
        white = np.random.Generator(np.random.Philox(key=seed, counter=[0, 0, 0, _STREAM])).standard_normal(
            (rows, columns)
        )
        smooth = gaussian_filter(white, _BUMP_M / _CELL_M, mode="wrap")
        smooth = (smooth - smooth.min()) / np.ptp(smooth)
        return Ground(math.radians(slope_deg), roughness_m * smooth)

    def add_to(self, spec: Any, contact_time_s: float) -> None:
        """Add the ground to a model; the feet have the friction.

        Args:
            spec: The mujoco.MjSpec.
            contact_time_s: Time constant of the contact, s.

        """
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
            at = np.array([(y_m + _HALF_M[1]) / _CELL_M, (along_m + _HALF_M[0]) / _CELL_M])
            bumps_m = map_coordinates(self.heights_m, at, order=1, mode="nearest")
        height_m: NDArray[np.float64] = x_m * math.tan(self.slope_rad) + bumps_m / math.cos(self.slope_rad)
        return height_m
