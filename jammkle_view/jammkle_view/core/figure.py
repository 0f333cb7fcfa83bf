"""Colours of states, tendons and lines, and what a model looks like: solids on its bodies.

The models carry no shapes but those that touch the ground. Feet are drawn around their contacts, end plates around the
ends of tendons, and what holds them follows from where those are. None of it weighs anything or touches anything.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh
from trimesh import creation

from jammkle_common.command.results import EVENT_COLOURS, LINE_COLOURS, STATE_COLOURS
from jammkle_common.names import CARRIAGE_JOINT
from jammkle_sim.physics.engine import mujoco
from jammkle_view.core.models import BALL, GROUNDS, tendon_sites
from jammkle_view.core.samples import ChannelState, EventKind

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

Rgb = tuple[int, int, int]


def _rgb(colour: str) -> Rgb:
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red, green, blue


STATE_TINTS: dict[ChannelState, Rgb] = {state: _rgb(STATE_COLOURS[state.name]) for state in ChannelState}
"""Hue of a tendon, and of its channel in the panel."""
BROKEN_TINT: Rgb = (40, 40, 40)
GHOST_TINT: Rgb = (165, 90, 215)
"""Of the simulation that lies over a recording."""

EVENT_TINTS: dict[EventKind, Rgb] = {kind: _rgb(EVENT_COLOURS[kind.name]) for kind in EventKind}
LINE_TINTS: dict[str, Rgb] = {name: _rgb(colour) for name, colour in LINE_COLOURS.items()}
"""Of lines in plots: channels, tendons, axes."""

FULL_TENSION_N = 30.0
"""Tension from which on a tendon has its full colour. Chosen for the eye: a landing pulls its Achilles tendons by some
20 N, and a jammed tendon tears far above."""
_PALEST = 0.6
"""Share of the state's colour in a slack tendon; the rest is white."""


def tendon_tint(state: ChannelState, tension_n: float, *, broken: bool) -> Rgb:
    """Return the colour of a tendon: the hue says its state, the depth its tension, palest where that is NaN."""
    if broken:
        return BROKEN_TINT
    share = _PALEST + (1.0 - _PALEST) * min(max(0.0, tension_n / FULL_TENSION_N), 1.0)
    red, green, blue = (round(255.0 - share * (255.0 - part)) for part in STATE_TINTS[state])
    return red, green, blue


def css(tint: Rgb) -> str:
    """Return a colour as style sheets write it."""
    return f"rgba({tint[0]}, {tint[1]}, {tint[2]}, 1)"


WORLD = ""
"""Body of what does not move."""

_PRINTED: Rgb = (70, 74, 82)
_SOLE: Rgb = (45, 47, 52)
_METAL: Rgb = (176, 180, 188)
_PLATE: Rgb = (228, 230, 234)
_GROUND: Rgb = (214, 198, 172)

_PLATE_RADIUS_M, _PLATE_M = 0.009, 0.004
_BALL_M, _ROD_M, _TUBE_M = 0.009, 0.005, 0.016
_SHANK_M = 0.12
"""Shown length of what is above the upper end plate, m."""
_RAIL_BEHIND_M, _RAIL_SIDE_M = 0.11, 0.045
_RAIL_DOWN_M, _RAIL_UP_M = 0.16, 0.14
"""How far the rails reach from where the carriage starts, m."""
_GROUND_HALF_M = (0.18, 0.12, 0.006)
FLOOR_HALF_M = (0.55, 0.4)
"""Of the ground that a robot without a rig stands on."""
_FOOT_SPHERES = 3
"""A body with so many balls or more is a sole with rounded corners."""


@dataclass(frozen=True)
class Solid:
    """One surface, fixed to a body."""

    name: str
    body: str
    """Name of the body, or WORLD."""
    vertices_m: NDArray[np.float64]
    faces: NDArray[np.int64]
    tint: Rgb


def figure_of(model: Any) -> tuple[Solid, ...]:
    """Return all solids of a model."""
    solids = [*_grounds(model), *_contacts(model), *_plates(model), *_ankles(model), *_slide(model)]
    return tuple(solids)


def fibre_bundle() -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the surface of a tendon: length 1 from the origin along z, radius 1, as fluted as a bundle of fibres."""
    lobes, per_lobe = 12, 6
    angle = np.linspace(0.0, 2.0 * np.pi, lobes * per_lobe, endpoint=False)
    radius = 0.9 + 0.1 * np.abs(np.cos(lobes / 2.0 * angle))
    ring = np.stack((radius * np.cos(angle), radius * np.sin(angle)), axis=1)
    low, high = (np.column_stack((ring, np.full(len(ring), z))) for z in (0.0, 1.0))
    here = np.arange(len(ring))
    after = np.roll(here, -1)
    top = len(ring)
    faces = np.concatenate(
        (np.stack((here, after, after + top), axis=1), np.stack((here, after + top, here + top), axis=1))
    )
    return np.concatenate((low, high)), faces


def _solid(name: str, body: str, mesh: trimesh.Trimesh, tint: Rgb) -> Solid:
    return Solid(name, body, np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces), tint)


def _body_name(model: Any, body: int) -> str:
    return WORLD if body == 0 else str(model.body(body).name)


def _grounds(model: Any) -> Iterator[Solid]:
    """Give the planes, as far as a robot reaches."""
    half_m = np.array(_GROUND_HALF_M)
    if not any(model.joint(index).name == CARRIAGE_JOINT for index in range(model.njnt)):
        half_m[:2] = FLOOR_HALF_M
    for index in range(model.ngeom):
        if int(model.geom_type[index]) in GROUNDS:
            slab = creation.box(extents=2.0 * half_m)
            slab.apply_translation((0.0, 0.0, -half_m[2]))
            yield _placed(model, index, slab, _GROUND)


def _contacts(model: Any) -> Iterator[Solid]:
    """Give what touches the ground, and other shapes that the model has."""
    by_body: dict[int, list[int]] = {}
    for index in range(model.ngeom):
        by_body.setdefault(int(model.geom_bodyid[index]), []).append(index)
    for body, geoms in by_body.items():
        balls = [index for index in geoms if int(model.geom_type[index]) == BALL]
        if len(balls) >= _FOOT_SPHERES:
            parts = [_shape(model, index) for index in balls]
            corners = np.concatenate(
                [part.vertices + model.geom_pos[index] for part, index in zip(parts, balls, strict=True) if part]
            )
            sole = trimesh.Trimesh(corners).convex_hull
            yield _solid(f"sole_{body}", _body_name(model, body), sole, _SOLE)
        else:
            balls = []
        for index in geoms:
            if index in balls:
                continue
            mesh = _shape(model, index)
            if mesh is not None:
                yield _placed(model, index, mesh, _PRINTED)


def _shape(model: Any, geom: int) -> Any:
    """Return the surface, a Trimesh, of a geom in its own frame; None for a plane and what cannot be drawn."""
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    kinds = mujoco.mjtGeom
    if kind == BALL:
        return creation.icosphere(subdivisions=2, radius=float(size[0]))
    if kind == int(kinds.mjGEOM_CAPSULE):
        capsule = creation.capsule(height=2.0 * float(size[1]), radius=float(size[0]))
        capsule.apply_translation(-capsule.bounds.mean(axis=0))
        return capsule
    if kind == int(kinds.mjGEOM_CYLINDER):
        return creation.cylinder(radius=float(size[0]), height=2.0 * float(size[1]))
    if kind == int(kinds.mjGEOM_BOX):
        return creation.box(extents=2.0 * size)
    return None


def _placed(model: Any, geom: int, mesh: trimesh.Trimesh, tint: Rgb) -> Solid:
    place = np.eye(4)
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
    place[:3, :3], place[:3, 3] = turn.reshape(3, 3), model.geom_pos[geom]
    mesh.apply_transform(place)
    body = int(model.geom_bodyid[geom])
    return _solid(f"geom_{geom}", _body_name(model, body), mesh, tint)


def _ends(model: Any) -> dict[int, NDArray[np.float64]]:
    """Return where tendons end on each body, shape (n, 3), m, in the frame of the body."""
    found: dict[int, list[NDArray[np.float64]]] = {}
    for places in tendon_sites(model).values():
        for site in (places[0], places[-1]):
            found.setdefault(int(model.site_bodyid[site]), []).append(model.site_pos[site])
    return {body: np.array(points) for body, points in found.items()}


def _plates(model: Any) -> Iterator[Solid]:
    """Give an end plate for every body on which tendons end."""
    for body, points_m in _ends(model).items():
        discs = [creation.cylinder(radius=_PLATE_RADIUS_M, height=_PLATE_M, sections=24) for _ in points_m]
        corners = np.concatenate([disc.vertices + at_m for disc, at_m in zip(discs, points_m, strict=True)])
        plate = trimesh.Trimesh(corners).convex_hull
        yield _solid(f"plate_{body}", _body_name(model, body), plate, _PLATE)


def _ankles(model: Any) -> Iterator[Solid]:
    """Give ball, rod and shank of every ankle: a body that turns, on a body above it on which its tendons begin."""
    ends_m = _ends(model)
    slide = int(mujoco.mjtJoint.mjJNT_SLIDE)
    for foot in ends_m:
        above = int(model.body_parentid[foot])
        joints = range(int(model.body_jntadr[foot]), int(model.body_jntadr[foot]) + int(model.body_jntnum[foot]))
        if above not in ends_m or not joints or any(int(model.jnt_type[joint]) == slide for joint in joints):
            continue
        name, centre_m = _body_name(model, foot), model.body_pos[foot]
        ball = creation.icosphere(subdivisions=3, radius=_BALL_M)
        yield _solid(f"ball_{foot}", name, ball, _METAL)
        sole_m = _lowest_m(model, foot)
        pedestal = creation.cone(radius=0.022, height=abs(sole_m) + 0.012, sections=32)
        pedestal.apply_translation((0.0, 0.0, sole_m))
        yield _solid(f"pedestal_{foot}", name, pedestal, _PRINTED)
        height_m = float(ends_m[above][:, 2].mean() - centre_m[2])
        yield _solid(f"rod_{foot}", _body_name(model, above), _upright(_ROD_M, centre_m, 0.0, height_m), _METAL)
        if not {above, int(model.body_parentid[above])} & {int(body) for body in model.geom_bodyid if body}:
            tube = _upright(_TUBE_M, centre_m, height_m, height_m + _SHANK_M)
            yield _solid(f"shank_{foot}", _body_name(model, above), tube, _PRINTED)


def _lowest_m(model: Any, body: int) -> float:
    """Return how far below the origin of a body its contacts' centres are, m; negative."""
    heights = [float(model.geom_pos[i][2]) for i in range(model.ngeom) if int(model.geom_bodyid[i]) == body]
    return min(heights, default=-0.01)


def _upright(radius_m: float, foot_m: Iterable[float], from_m: float, to_m: float) -> Any:
    post = creation.cylinder(radius=radius_m, height=to_m - from_m, sections=32)
    post.apply_translation((0.0, 0.0, (from_m + to_m) / 2.0))
    post.apply_translation(tuple(foot_m))
    return post


def _slide(model: Any) -> Iterator[Solid]:
    """Give the rig's slide: two rails, and what runs on them."""
    known = {model.joint(index).name: index for index in range(model.njnt)}
    if CARRIAGE_JOINT not in known:
        return
    carriage = int(model.jnt_bodyid[known[CARRIAGE_JOINT]])
    ends_m = _ends(model)
    highest_m = max((float(points[:, 2].max()) for body, points in ends_m.items() if body > carriage), default=0.0)
    at_m = highest_m + 0.75 * _SHANK_M if highest_m else (_SHANK_M if model.ngeom else 0.03)
    block = creation.box(extents=(_RAIL_BEHIND_M + 0.04, 2.0 * _RAIL_SIDE_M + 0.03, 0.035))
    block.apply_translation((-_RAIL_BEHIND_M / 2.0, 0.0, at_m))
    yield _solid("carriage", _body_name(model, carriage), block, _METAL)
    for body in sorted({int(body) for body in model.geom_bodyid} - {0, *ends_m}):
        # a foot without tendons, at the end of a bare leg
        yield _solid(f"leg_{body}", _body_name(model, carriage), _upright(_ROD_M, (0.0, 0.0, 0.0), -0.01, at_m), _METAL)
    for side in (-1.0, 1.0):
        foot_m = (-_RAIL_BEHIND_M, side * _RAIL_SIDE_M, float(model.body_pos[carriage][2]) + at_m)
        rail = _upright(0.006, foot_m, -_RAIL_DOWN_M, _RAIL_UP_M)
        yield _solid(f"rail_{'left' if side > 0 else 'right'}", WORLD, rail, _METAL)
    for name, height_m in (("upper", _RAIL_UP_M), ("lower", -_RAIL_DOWN_M)):
        beam = creation.box(extents=(0.025, 2.0 * _RAIL_SIDE_M + 0.03, 0.016))
        beam.apply_translation((-_RAIL_BEHIND_M, 0.0, float(model.body_pos[carriage][2]) + at_m + height_m))
        yield _solid(f"beam_{name}", WORLD, beam, _PRINTED)
