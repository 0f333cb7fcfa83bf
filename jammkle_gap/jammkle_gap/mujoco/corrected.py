"""The corrected model: an MJCF with constants and effects, nonidealities in a text of it, and what it closes."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import numpy as np

from jammkle_gap.mujoco.drives import add_motor, joint_of
from jammkle_gap.mujoco.nonideal import TEXT_NAME, Nonidealities, nonidealities_of, text_of
from jammkle_gap.mujoco.robot import SENSORS, load, match
from jammkle_gap.mujoco.runs import Gains
from jammkle_gap.mujoco.simulator import RobotSimulator, run, scale_of
from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from jammkle_gap.core.data import Recording
    from jammkle_gap.mujoco.robot import Robot
    from jammkle_gap.mujoco.runs import Run
    from jammkle_gap.mujoco.simulator import Machine

_BY_BODY = ("mass", "inertia", "ipos", "iquat", "pos")
_BY_DOF = ("damping", "frictionloss", "armature")


@dataclass(frozen=True)
class SignalClosing:
    """How far a signal was off, and is with the corrected model, in windows that were not fitted."""

    signal: str
    unit: str
    nominal: float
    """Root mean square of measured less simulated, in `unit`."""
    corrected: float
    noise: float
    """Standard deviation of one reading."""


@dataclass(frozen=True)
class Corrected:
    """A robot with what was found in it."""

    xml: str
    """The user's model with constants and effects, as MJCF; nonidealities are a text in it, for `Modifier`."""
    rest: Mapping[str, Any]
    """What MJCF cannot describe, by field of `Nonidealities`; a number, or numbers by joint."""
    gains: Mapping[str, Gains]
    """Of controllers outside of the model."""
    values: Mapping[str, float]
    """Effects by `effect.parameter` and constants by name."""


def corrected_of(robot: Robot, machine: Machine, values: Mapping[str, float], folder: Path) -> Corrected:
    """Return the user's model with a machine in it.

    A joint whose controller is outside of the model gets a motor where it has no actuator, so that a `Modifier` can
    drive it. A site whose sensors were compared gets those that the model has not.

    Args:
        robot: As it was matched.
        machine: With the values.
        values: Effects and constants that it has.
        folder: Where the file will be, so that meshes are found from there.

    Raises:
        BadRobotError: the model cannot be loaded any more.

    """
    spec, model = load(robot.file)
    without = [drive.joint for drive in robot.drives if _actuator_of(model, drive.joint) is None]
    for joint in without:
        add_motor(spec, joint)
    model = spec.compile() if without else model
    _put_links(robot, machine.model, model)
    gains = _put_drives(robot, machine.model, model)
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
    spec.copy_back(model)
    _put_flags(robot, machine.model, model, spec)
    _put_sensors(robot, model, spec)
    rest = {each.name: value for each in fields(Nonidealities) if (value := getattr(machine, each.name))}
    if not robot.drives and "delay_s" in rest:
        # Nobody commands it: positions that come behind efforts are efforts before positions.
        rest["effort_delay_s"] = rest.get("effort_delay_s", 0.0) - rest.pop("delay_s")
    for text in list(spec.texts):
        if text.name == TEXT_NAME:
            spec.delete(text)
    if said := text_of(rest, gains):
        spec.add_text(name=TEXT_NAME, data=said)
    xml = _with_assets(spec.to_xml(), robot.file.resolve(), folder.resolve())
    return Corrected(xml, rest, gains, dict(values))


def _with_assets(xml: str, file: Path, folder: Path) -> str:
    """Return a model that finds its assets' files from another folder; those of attached models are beside these."""
    root = ET.fromstring(xml)  # noqa: S314 - MuJoCo's own text; and the user's own model below
    compiler = root.find("compiler")
    if compiler is None:
        return xml
    models = ET.parse(file).iterfind("asset/model[@file]")  # noqa: S314
    attached = [file.parent / str(each.get("file")) for each in models]
    for kind, tags in (("meshdir", ("mesh", "hfield", "skin")), ("texturedir", ("texture",))):
        own = file.parent / compiler.get(kind, "")
        places = [own, *(each.parent / _asset_folder(each, kind) for each in attached)]
        named = [
            (each, key) for tag in tags for each in root.iter(tag) for key in each.attrib if key.startswith("file")
        ]
        for asset, key in named:
            found = next((path for place in places if (path := place / asset.attrib[key]).is_file()), None)
            if found is not None:
                asset.set(key, os.path.relpath(found, own))
        if named:
            compiler.set(kind, os.path.relpath(own, folder))
    for text in root.iter("text"):  # written as CDATA, which would be lost
        if text.text:
            text.set("data", text.text)
            text.text = None
    return ET.tostring(root, encoding="unicode")


def _asset_folder(file: Path, kind: str) -> str:
    """Return `meshdir` or `texturedir` of a model's file."""
    compiler = ET.parse(file).find("compiler")  # noqa: S314
    given = {} if compiler is None else compiler.attrib
    return given.get(kind, given.get("assetdir", ""))


def _put_links(robot: Robot, changed: mujoco.MjModel, model: mujoco.MjModel) -> None:
    """Put what has changed of bodies, joints, contacts and gravity into the user's model."""
    nominal = robot.model
    for number in range(1, nominal.nbody):
        for field in _BY_BODY:
            ours = getattr(changed, f"body_{field}")[number]
            if not np.array_equal(ours, getattr(nominal, f"body_{field}")[number]):
                getattr(model, f"body_{field}")[number] = ours
    for joint in robot.joints:
        at, own_at = robot.dof(joint), int(model.joint(joint).dofadr[0])
        for field in _BY_DOF:
            getattr(model, f"dof_{field}")[own_at] = getattr(changed, f"dof_{field}")[at]
        model.jnt_range[model.joint(joint).id] = changed.jnt_range[changed.joint(joint).id]
    model.geom_friction[:], model.geom_solref[:] = changed.geom_friction, changed.geom_solref
    model.opt.gravity[:] = changed.opt.gravity


def _put_drives(robot: Robot, changed: mujoco.MjModel, model: mujoco.MjModel) -> dict[str, Gains]:
    """Put drives into the user's model; return the gains of controllers that are not in it."""
    gains = {}
    for drive in robot.drives:
        actuator = changed.actuator(drive.actuator)
        number = _actuator_of(model, drive.joint)
        gear = float(model.actuator_gear[number, 0])  # which `match` has put into the numbers
        outside = drive.joint in {*robot.given.gains, *robot.estimated}
        model.actuator_forcerange[number] = np.sort(changed.actuator_forcerange[actuator.id] / gear)
        if outside:
            by_position = actuator.biasprm[1] != 0.0
            gains[drive.joint] = Gains(float(actuator.gainprm[0]) if by_position else 0.0, -float(actuator.biasprm[2]))
            continue
        model.actuator_gainprm[number] = changed.actuator_gainprm[actuator.id] / gear**2
        model.actuator_biasprm[number] = changed.actuator_biasprm[actuator.id] / gear**2
        model.actuator_biasprm[number, 0] *= gear
    return gains


def _put_flags(robot: Robot, changed: mujoco.MjModel, model: mujoco.MjModel, spec: mujoco.MjSpec) -> None:
    """Put what `copy_back`, which copies numbers, leaves out."""
    for drive in robot.drives:
        if changed.actuator_forcelimited[changed.actuator(drive.actuator).id]:
            spec.actuators[_actuator_of(model, drive.joint)].forcelimited = True
        if changed.jnt_limited[changed.joint(drive.joint).id]:
            spec.joint(drive.joint).limited = True
    for joint in robot.joints:
        if changed.jnt_actgravcomp[number := changed.joint(joint).id]:
            own = spec.joint(joint)
            own.actgravcomp = True
            own.actfrclimited = bool(changed.jnt_actfrclimited[number])
            own.actfrcrange = changed.jnt_actfrcrange[number]
    if not np.array_equal(changed.body_gravcomp, robot.model.body_gravcomp):
        for number, body in enumerate(spec.bodies):
            body.gravcomp = float(changed.body_gravcomp[number])


def _put_sensors(robot: Robot, model: mujoco.MjModel, spec: mujoco.MjSpec) -> None:
    """Put the sensors that were compared where the model has none; those it has stay where they are in its data."""
    own = set(zip(model.sensor_type.tolist(), model.sensor_objid.tolist(), strict=True))
    for site, sense in robot.senses:
        if (int(SENSORS[sense]), int(model.site(site).id)) not in own:
            spec.add_sensor(type=SENSORS[sense], objtype=mujoco.mjtObj.mjOBJ_SITE, objname=site)


def _actuator_of(model: mujoco.MjModel, joint: str) -> int | None:
    return next((k for k in range(model.nu) if joint_of(model, k) == joint), None)


def closing_of(
    robot: Robot, file: Path, runs: Sequence[Run], recordings: Sequence[Recording]
) -> tuple[SignalClosing, ...]:
    """Load the corrected model as a user would, and say how far it closes the gap in some windows.

    Args:
        robot: As it was matched.
        file: Where the model was written; nonidealities are read from it, too.
        runs: In the model's terms, as `robot` was matched with.
        recordings: Windows of them.

    Raises:
        InfeasibleError: it blows up.
        BadRobotError: the file cannot be loaded.

    """
    nonideal, gains = nonidealities_of(load(file)[1])
    loaded = match(file, runs, replace(robot.given, gains={**robot.given.gains, **gains}))
    nominal, corrected = (RobotSimulator(each, {}).machine({}) for each in (robot, loaded))
    for name, value in vars(nonideal).items():
        setattr(corrected, name, value)
    units: dict[str, str] = {}
    squares: dict[str, list[tuple[float, ...]]] = {}
    for recording in recordings:
        made = [run(each, recording) for each in (nominal, corrected)]
        for signal in recording.signals:
            count = len(signal.values)
            left = [float(np.square(signal.values - each[signal.name]).sum()) for each in made]
            squares.setdefault(signal.name, []).append((*left, scale_of(signal) ** 2 * count, count))
            units[signal.name] = signal.unit
    found = []
    for name, rows in squares.items():
        *sums, count = np.sum(rows, axis=0)
        found.append(SignalClosing(name, units[name], *np.sqrt(np.array(sums) / count).tolist()))
    return tuple(found)


def share_left(closing: Sequence[SignalClosing]) -> float:
    """Return the share of the gap that the corrected model leaves: root mean square over all signals, beyond noise.

    Infinite where there was none.
    """
    nominal, corrected = (
        sum(max((size / each.noise) ** 2 - 1.0, 0.0) for each, size in zip(closing, sizes, strict=True))
        for sizes in ([each.nominal for each in closing], [each.corrected for each in closing])
    )
    return float(np.sqrt(corrected / nominal)) if nominal > 0.0 else np.inf if corrected > 0.0 else 0.0
