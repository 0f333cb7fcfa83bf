"""A robot in the scene: its solids, and its tendons as bundles that take the colour of state and tension."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common.names import TENDONS
from jammkle_view.core.figure import FLOOR_HALF_M, WORLD, fibre_bundle, figure_of, tendon_tint
from jammkle_view.core.models import Kinematics, along

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    import viser

    from jammkle_view.core.ankle import AnkleState
    from jammkle_view.core.figure import Rgb
    from jammkle_view.core.models import Naming
    from jammkle_view.core.samples import Base

TENDON_RADIUS_M = 0.0055
"""Of a tendon that is soft: eighteen fibres of 2 mm, and the membrane's slack."""
SHRUNK = 0.2
"""Share of it by which a whole atmosphere would press the bundle together. Assumed, to be seen."""
_GHOST_OPACITY = 0.3
_CELL_M, _ABOVE_M = 0.1, 0.001
"""Width of the squares on the ground of a robot that moves, and how far above it they are drawn."""


class RobotScene:
    """One model, drawn and moved. A ghost is drawn in one see-through colour."""

    def __init__(
        self,
        server: viser.ViserServer,
        root: str,
        model: Any,
        ghost: Rgb | None = None,
        *,
        floats: bool = False,
        beside: RobotScene | None = None,
    ) -> None:
        """Draw it at its start.

        Args:
            server: Of the page.
            root: Name in the scene that everything hangs below.
            model: The mujoco.MjModel.
            floats: Whether its joints do not say where it is. Until somebody else does it is put onto the ground; then
                it stays in sight, and the ground passes under it.
            ghost: Its one colour, if it is to be seen through; the world around it is then left out.
            beside: On whose ground a ghost that floats moves.

        """
        self._kinematics = Kinematics(model)
        self._root = server.scene.add_frame(root, show_axes=False)
        self._bodies: dict[str, viser.FrameHandle] = {}
        self._floats, self._beside = floats, beside
        self._place_m = np.zeros(3)
        self._ground: viser.FrameHandle | None = None
        self._grid: viser.GridHandle | None = None
        if floats and beside is None:
            self._ground = server.scene.add_frame(f"{root}/ground", show_axes=False)
            self._grid = server.scene.add_grid(
                f"{root}/grid",
                width=2.0 * FLOOR_HALF_M[0],
                height=2.0 * FLOOR_HALF_M[1],
                cell_size=_CELL_M,
                section_size=_CELL_M,
                wxyz=self._kinematics.ground_rotation,
                shadow_opacity=0.0,
            )
        for solid in figure_of(model):
            if solid.body == WORLD and ghost is not None:
                continue
            parent = f"{root}/ground" if floats else root
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
        self.show({}, {}, {})

    @property
    def centre_m(self) -> Sequence[float]:
        """Middle of the bodies as they are seen, m."""
        middle_m = self._kinematics.positions_m.mean(axis=0) - (self._kinematics.travel_m if self._floats else 0.0)
        found: list[float] = middle_m.tolist()
        return found

    @property
    def reach_m(self) -> float:
        """How far its bodies are apart, m."""
        return float(np.ptp(self._kinematics.positions_m, axis=0).max(initial=0.0))

    def put(self, place_m: tuple[float, float, float]) -> None:
        """Draw all of it elsewhere, m."""
        self._place_m = np.array(place_m)
        self._root.position = place_m

    def remove(self) -> None:
        """Take it out of the scene."""
        self._root.remove()

    def set_visible(self, *, visible: bool) -> None:
        """Show or hide it."""
        self._root.visible = visible

    def show_ankles(self, ankles: Iterable[tuple[Naming, AnkleState]]) -> None:
        """Move it as its ankles are, and give their tendons their colours; the first says where the robot is."""
        positions: dict[str, float] = {}
        tints: dict[str, Rgb] = {}
        shares: dict[str, float] = {}
        bases: list[Base | None] = []
        for naming, ankle in ankles:
            bases.append(ankle.base)
            positions |= {naming.get(name, name): value for name, value in ankle.joints.items()}
            for name in TENDONS:
                tension_n, broken = ankle.tensions_n.get(name, 0.0), name in ankle.broken
                tints[naming.get(name, name)] = tendon_tint(ankle.state_of(name), tension_n, broken=broken)
                shares[naming.get(name, name)] = ankle.vacuum_share(name)
        self.show(positions, tints, shares, next(iter(bases), None))

    def show(
        self,
        positions: Mapping[str, float],
        tints: Mapping[str, Rgb],
        vacuum_shares: Mapping[str, float],
        base: Base | None = None,
    ) -> None:
        """Move it.

        Args:
            positions: Of joints by name, rad or m; a joint that is not named stays.
            tints: Colour by tendon; a ghost keeps its own.
            vacuum_shares: How far each tendon is evacuated, 0 to 1, by name.
            base: Where it is, if that is known and its joints do not say.

        """
        self._kinematics.move(positions, base if self._floats else None)
        sunk_m = np.zeros(3)
        if self._floats and base is None:
            sunk_m[2] = -self._kinematics.clearance_m
        if self._ground is not None and self._grid is not None:
            travel_m, axes = self._kinematics.travel_m, self._kinematics.ground_matrix
            self._root.position = self._place_m - travel_m
            self._ground.position = travel_m
            self._grid.position = axes @ (_CELL_M * np.round(travel_m @ axes / _CELL_M) + (0.0, 0.0, _ABOVE_M))
        elif self._beside is not None:
            self._root.position = self._beside._root.position  # noqa: SLF001 - one of its kind
        positions_m, rotations = self._kinematics.positions_m + sunk_m, self._kinematics.rotations
        for name, frame in self._bodies.items():
            place = self._places[name]
            frame.position, frame.wxyz = positions_m[place], rotations[place]
        if self._tendons is None:
            return
        begins_m, ends_m = (each + sunk_m for each in self._kinematics.segment_ends_m)
        turns, lengths_m = along(begins_m, ends_m)
        segments = self._kinematics.segments
        radius_m = np.array([TENDON_RADIUS_M * (1.0 - SHRUNK * vacuum_shares.get(name, 0.0)) for name in segments])
        self._tendons.batched_positions = begins_m.astype(np.float32)
        self._tendons.batched_wxyzs = turns.astype(np.float32)
        self._tendons.batched_scales = np.stack((radius_m, radius_m, lengths_m), axis=1).astype(np.float32)
        if self._ghost is None:
            colours = np.array([tints.get(name, (200, 200, 200)) for name in segments], dtype=np.uint8)
        else:
            colours = np.tile(np.array(self._ghost, dtype=np.uint8), (len(segments), 1))
        if not np.array_equal(colours, self._tendons.batched_colors):
            self._tendons.batched_colors = colours
