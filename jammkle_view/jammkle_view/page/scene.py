"""A robot in the scene: its solids, and its tendons as bundles that take the colour of state and tension."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_view.core.figure import WORLD, fibre_bundle, figure_of
from jammkle_view.core.kinematics import Kinematics, along

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import viser

    from jammkle_view.core.tints import Rgb

TENDON_RADIUS_M = 0.0055
"""Of a tendon that is soft: eighteen fibres of 2 mm, and the membrane's slack."""
SHRUNK = 0.2
"""Share of it by which a whole atmosphere would press the bundle together. Assumed, to be seen."""
_GHOST_OPACITY = 0.3


class RobotScene:
    """One model, drawn and moved. A ghost is drawn in one see-through colour."""

    def __init__(
        self, server: viser.ViserServer, root: str, model: Any, ghost: Rgb | None = None, *, floats: bool = False
    ) -> None:
        """Draw it at its start.

        Args:
            server: Of the page.
            root: Name in the scene that everything hangs below.
            model: The mujoco.MjModel.
            floats: Whether nobody tells where it is: it is then put onto the ground.
            ghost: Its one colour, if it is to be seen through; the world around it is then left out.

        """
        self._kinematics = Kinematics(model)
        self._root = server.scene.add_frame(root, show_axes=False)
        self._bodies: dict[str, viser.FrameHandle] = {}
        for solid in figure_of(model):
            if solid.body == WORLD and ghost is not None:
                continue
            parent = root
            if solid.body != WORLD:
                parent = f"{root}/{solid.body}"
                if solid.body not in self._bodies:
                    self._bodies[solid.body] = server.scene.add_frame(parent, show_axes=False)
            server.scene.add_mesh_simple(
                f"{parent}/{solid.name}",
                solid.vertices_m,
                solid.faces,
                color=solid.tint if ghost is None else ghost,
                opacity=None if ghost is None else _GHOST_OPACITY,
                flat_shading=False,
                cast_shadow=ghost is None,
                receive_shadow=ghost is None,
            )
        vertices, faces = fibre_bundle()
        count = len(self._kinematics.segments)
        self._places = {name: index for index, name in enumerate(self._kinematics.bodies)}
        self._tendons: viser.BatchedMeshHandle | None = None
        if count:
            self._tendons = server.scene.add_batched_meshes_simple(
                f"{root}/tendons",
                vertices,
                faces,
                batched_wxyzs=np.tile((1.0, 0.0, 0.0, 0.0), (count, 1)),
                batched_positions=np.zeros((count, 3)),
                batched_scales=np.full((count, 3), TENDON_RADIUS_M),
                batched_colors=np.full((count, 3), 200, dtype=np.uint8),
                opacity=None if ghost is None else _GHOST_OPACITY,
                lod="off",
            )
        self._ghost = ghost
        self._floats = floats
        self.show({}, {}, {})

    @property
    def tendons(self) -> tuple[str, ...]:
        """Names of the tendons, once per straight piece."""
        return self._kinematics.segments

    @property
    def centre_m(self) -> Sequence[float]:
        """Middle of the bodies, m."""
        found: list[float] = self._kinematics.positions_m.mean(axis=0).tolist()
        return found

    @property
    def reach_m(self) -> float:
        """How far its bodies are apart, m."""
        return float(np.ptp(self._kinematics.positions_m, axis=0).max(initial=0.0))

    def put(self, place_m: tuple[float, float, float]) -> None:
        """Draw all of it elsewhere, m."""
        self._root.position = place_m

    def remove(self) -> None:
        """Take it out of the scene."""
        self._root.remove()

    def set_visible(self, *, visible: bool) -> None:
        """Show or hide it."""
        self._root.visible = visible

    def show(
        self, positions: Mapping[str, float], tints: Mapping[str, Rgb], vacuum_shares: Mapping[str, float]
    ) -> None:
        """Move it.

        Args:
            positions: Of joints by name, rad or m; a joint that is not named stays.
            tints: Colour by tendon; a ghost keeps its own.
            vacuum_shares: How far each tendon is evacuated, 0 to 1, by name.

        """
        self._kinematics.move(positions)
        sunk_m = np.array((0.0, 0.0, -self._kinematics.clearance_m if self._floats else 0.0))
        positions_m, rotations = self._kinematics.positions_m + sunk_m, self._kinematics.rotations
        for name, frame in self._bodies.items():
            place = self._places[name]
            frame.position, frame.wxyz = positions_m[place], rotations[place]
        if self._tendons is None:
            return
        begins_m, ends_m = (each + sunk_m for each in self._kinematics.segment_ends_m)
        turns, lengths_m = along(begins_m, ends_m)
        radius_m = np.array([TENDON_RADIUS_M * (1.0 - SHRUNK * vacuum_shares.get(name, 0.0)) for name in self.tendons])
        self._tendons.batched_positions = begins_m.astype(np.float32)
        self._tendons.batched_wxyzs = turns.astype(np.float32)
        self._tendons.batched_scales = np.stack((radius_m, radius_m, lengths_m), axis=1).astype(np.float32)
        if self._ghost is None:
            colours = np.array([tints.get(name, (200, 200, 200)) for name in self.tendons], dtype=np.uint8)
        else:
            colours = np.tile(np.array(self._ghost, dtype=np.uint8), (len(self.tendons), 1))
        if not np.array_equal(colours, self._tendons.batched_colors):
            self._tendons.batched_colors = colours
