"""What a robot is offered: effects on its joints, links, drives, sensors and timing, and the constants of its machine.

An effect of joints is offered for all of them, for those of one kind and for each, so that a cause they share is one
effect.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_gap.core.effects import Effect, EffectParameter, Library, Nuisance
from jammkle_gap.mujoco import effects
from jammkle_gap.mujoco.effects import FAMILIES, UNITS, Family, Scale, size_of
from jammkle_gap.mujoco.runs import Base, Quantity, Sense

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_gap.mujoco.robot import Robot
    from jammkle_gap.mujoco.simulator import Change


@dataclass(frozen=True)
class Offer:
    """What a robot is offered: effects, constants of the machine, and what each of them changes."""

    library: Library
    constants: tuple[Nuisance, ...]
    scatter: tuple[Nuisance, ...]
    """What no two runs have the same."""
    changes: Mapping[str, tuple[tuple[str, ...], tuple[float, ...], Change]]
    members: Mapping[str, tuple[str, ...]]
    """By effect that joints share, the effects of single joints."""

    @property
    def names(self) -> frozenset[str]:
        """Of all effects."""
        return frozenset(effect.name for effect in self.library)


def offer_of(robot: Robot, scales: Mapping[str, Scale]) -> Offer:
    """Return all effects that a robot may have, those that joints share among them, and its constants."""
    offered: list[Effect] = []
    changes: dict[str, tuple[tuple[str, ...], tuple[float, ...], Change]] = {}
    members: dict[str, tuple[str, ...]] = {}

    def offer(effect: Effect, change: Change) -> None:
        offered.append(effect)
        keys = tuple(effect.key(each) for each in effect.parameters)
        changes[effect.name] = (keys, tuple(each.null for each in effect.parameters), change)

    constants = []
    for nuisance, change in _constants(robot):
        constants.append(nuisance)
        changes[nuisance.name] = ((nuisance.name,), (nuisance.null,), change)
    scatter = []
    if robot.drives:
        source = "the clocks of computer and drive meet anew in each run: within half a cycle of 1 kHz"
        scatter.append(Nuisance("run/arrival", "s", 0.0, 0.0005, source, -0.01, 0.01))
        changes["run/arrival"] = (("run/arrival",), (0.0,), partial(effects.change_timing, "arrival_s"))
    driven = {each.joint for each in robot.drives}
    at_position = {each.joint for each in robot.drives if each.quantity is Quantity.POSITION}
    for number, family in enumerate(FAMILIES):
        able = at_position if family.position else driven if family.drive else set(robot.joints)
        if family.name == "torque_constant":
            able = driven or set(robot.efforts)
        joints = tuple(name for name in robot.joints if name in able)
        single = {joint: f"{family.name}_{joint}" for joint in joints}
        for label, group in groups_of(robot, joints).items():
            effect, change = _shared(number, f"{family.name}{label}", group, scales)
            offer(effect, change)
            members[effect.name] = tuple(single[joint] for joint in group)
        for joint in joints:
            effect, change = _single(number, single[joint], joint, scales[joint])
            offer(effect, change)
    for effect, change in (*_of_links(robot), *_of_stops(robot, scales), *_of_all(robot), *_of_senses(robot)):
        offer(effect, change)
    return Offer(Library(tuple(offered)), tuple(constants), tuple(scatter), changes, members)


def groups_of(robot: Robot, joints: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return joints that may share a cause, by the ending of its name: all (no ending), and those of one kind.

    Of one kind are those with the same limit of torque and the same rotor in the model.
    """
    kinds: dict[tuple[Any, ...], list[str]] = {}
    for name in joints:
        drive = next((each for each in robot.drives if each.joint == name), None)
        limit = () if drive is None else tuple(robot.model.actuator(drive.actuator).forcerange.round(6).tolist())
        dof = robot.dof(name)
        kinds.setdefault((robot.is_turning(name), limit, round(float(robot.model.dof_armature[dof]), 9)), []).append(
            name
        )
    found: dict[str, tuple[str, ...]] = {}
    if len(joints) > 1 and len({robot.is_turning(name) for name in joints}) == 1:
        found[""] = tuple(joints)
    for group in kinds.values():
        if 1 < len(group) < len(joints):
            found[f"_{_label(group)}"] = tuple(group)
    return found


def _label(names: Sequence[str]) -> str:
    words = [re.split(r"[_\W]+|\d+", name) for name in names]
    common = [word for word in words[0] if len(word) > 2 and all(word in each for each in words)]  # noqa: PLR2004
    common = [word for word in common if word not in {"joint", "link", "motor"}]
    return "_".join(common) if common else f"{names[0]}_to_{names[-1]}"


def _shared(number: int, name: str, joints: tuple[str, ...], scales: Mapping[str, Scale]) -> tuple[Effect, Change]:
    family = FAMILIES[number]
    parameters = tuple(
        EffectParameter(
            each.name,
            UNITS[each.scale][0] if each.scale in _PLAIN else "1",
            each.null,
            each.minimum,
            each.maximum,
            each.source,
            shares=each.shares,
        )
        for each in family.numbers
    )
    sizes = tuple(tuple(size_of(each.scale, scales[joint]) for each in family.numbers) for joint in joints)
    where = f"the joints {', '.join(joints)}"
    return Effect(name, family.subsystem, parameters, _sentence(family, where)), partial(
        effects.change_joints, number, joints, sizes
    )


_PLAIN = ("time", "share", "angle")
"""Scales that are the same for all joints; of others joints share a part of each one's own."""


def _single(number: int, name: str, joint: str, scale: Scale) -> tuple[Effect, Change]:
    family = FAMILIES[number]
    parameters = []
    for each in family.numbers:
        size = size_of(each.scale, scale)
        unit = UNITS[each.scale][0 if scale.turning else 1]
        bounds = (each.null * size, each.minimum * size, each.maximum * size)
        parameters.append(EffectParameter(each.name, unit, *bounds, each.source, shares=each.shares))
    effect = Effect(name, family.subsystem, tuple(parameters), _sentence(family, f"joint {joint}"))
    return effect, partial(effects.change_joints, number, (joint,), (tuple(1.0 for _ in family.numbers),))


def _sentence(family: Family, where: str) -> str:
    finding = family.finding.format(where=where)
    if where.startswith("joint "):
        for plural, singular in ((f"{where} rub", f"{where} rubs"), (f"{where} are", f"{where} is"),
                                 (f"{where} stick before they slide", f"{where} sticks before it slides"),
                                 (f"{where} have more", f"{where} has more"),
                                 ("by their speed", "by its speed")):  # fmt: skip
            finding = finding.replace(plural, singular)
    return f"{finding[:1].upper()}{finding[1:]}: {family.check}."


def moving_bodies(robot: Robot) -> list[str]:
    """Return the bodies with a mass that a measured joint, one that follows it or a free base moves, in order."""
    model = robot.model
    base = (robot.floating,) if robot.floating else ()
    roots = {int(model.joint(name).bodyid[0]) for name in (*robot.joints, *robot.followers, *base)}
    found = []
    for number in range(1, model.nbody):
        above = number
        while above and above not in roots:
            above = int(model.body_parentid[above])
        if above and model.body_mass[number] > 0.0 and model.body(number).name:
            found.append(model.body(number).name)
    return found


def _of_links(robot: Robot) -> list[tuple[Effect, Change]]:
    found: list[tuple[Effect, Change]] = []
    model = robot.model
    bodies = moving_bodies(robot)
    total = sum(float(model.body(name).mass[0]) for name in bodies)
    for name in bodies:
        scale = EffectParameter("scale", "1", 1.0, 0.5, 2.0, "assumed: half to double")
        sentence = f"Body {name} has another mass than the model says: weigh it."
        found.append((Effect(f"mass_{name}", "links", (scale,), sentence), partial(effects.change_mass, name)))
        reach = 0.2 * max(_extent(robot, name), 0.02)
        axes = tuple(
            EffectParameter(axis, "m", 0.0, -reach, reach, "assumed: a fifth of the link's length") for axis in "xyz"
        )
        sentence = f"The centre of mass of body {name} lies elsewhere: balance it on an edge."
        found.append((Effect(f"centre_{name}", "links", axes, sentence), partial(effects.move_centre, name)))
    tips = [name for name in bodies if not _children(robot, name)]
    for name in tips:
        label = "payload" if len(tips) == 1 else f"payload_{name}"
        mass = EffectParameter("mass", "kg", 0.0, 0.0, 0.3 * total, "assumed: up to 0.3 of what moves")
        sentence = f"Body {name} carries a load that the model has not: look for tools, cables or what it grips."
        found.append((Effect(label, "links", (mass,), sentence), partial(effects.add_payload, name, _tip(robot, name))))
    return found


def _of_stops(robot: Robot, scales: Mapping[str, Scale]) -> list[tuple[Effect, Change]]:
    """Return end stops that a driven joint may meet early: near where it turned back, or beyond, as far as it moved."""
    found: list[tuple[Effect, Change]] = []
    for drive in robot.drives:
        own = scales[drive.joint]
        unit, travel = ("rad" if own.turning else "m"), own.reach[1] - own.reach[0]
        if not travel:
            continue
        for which, end, outward in (("lower", own.reach[0], -travel), ("upper", own.reach[1], travel)):
            ends = sorted((end - _STOP_INWARD * outward, end + outward))
            source = "where the joint turned back, and as far again; a stop gives by a few hundredths of the travel"
            angle = EffectParameter("position", unit, end + outward, ends[0], ends[1], source)
            sentence = f"Joint {drive.joint} meets its {which} stop early: look for what it runs into, and for cables."
            name = f"{which}_stop_{drive.joint}"
            found.append(
                (Effect(name, "joints", (angle,), sentence), partial(effects.put_stop, drive.joint, which == "upper"))
            )
    return found


_STOP_INWARD = 0.05
"""Of the travel, how far within it a stop is looked for. Assumed: stops of rubber and links give under load."""


def _children(robot: Robot, name: str) -> list[int]:
    model = robot.model
    own = model.body(name).id
    below = [k for k in range(1, model.nbody) if int(model.body_parentid[k]) == own]
    return [k for k in below if model.body_mass[k] > 0.0 or model.body_subtreemass[k] > 0.0]


def _extent(robot: Robot, name: str) -> float:
    """Return how far a body's own frame is from what hangs on it, or from its centre of mass, m."""
    model = robot.model
    own = model.body(name).id
    below = np.linalg.norm(model.body_pos[model.body_parentid == own], axis=1)
    return float(max([*below.tolist(), 2.0 * float(np.linalg.norm(model.body_ipos[own]))]))


def _tip(robot: Robot, name: str) -> tuple[float, float, float]:
    model = robot.model
    own = model.body(name).id
    sites = [k for k in range(model.nsite) if int(model.site_bodyid[k]) == own]
    places = [model.site_pos[k] for k in sites] or [model.body_ipos[own]]
    x, y, z = max(places, key=lambda each: float(np.linalg.norm(each))).tolist()
    return x, y, z


def _of_all(robot: Robot) -> list[tuple[Effect, Change]]:
    """Return effects of timing, of the base, and of drives together."""
    late = "buses and drivers: up to some tens of milliseconds"
    found: list[tuple[Effect, Change]] = []
    if robot.drives:
        # The same later: no recording of commands and readings tells which of them is late.
        delay = EffectParameter("time", "s", 0.0, 0.0, 0.08, late)
        sentence = "Commands or readings come late: look at the load of bus and computer, and at sensor filters."
        found.append((Effect("delay", "timing", (delay,), sentence), partial(effects.change_timing, "delay_s")))
        rate = EffectParameter("rate", "1", 0.0, -0.01, 0.01, "assumed: clocks without synchronisation, within 1 %")
        sentence = "The clock of the readings runs at another rate than that of the commands: synchronise them."
        found.append((Effect("clock_skew", "timing", (rate,), sentence), partial(effects.change_timing, "clock_rate")))
        held = tuple(each.joint for each in robot.drives if robot.is_turning(each.joint))
        if held:
            lowest = -1.0 if float(robot.model.body_gravcomp.max()) > 0.5 else 0.0  # noqa: PLR2004 - rather with it
            share = EffectParameter("share", "1", 0.0, lowest, lowest + 1.0, "from none to all of the weight")
            sentence = "The drives hold another share of the weight by themselves: look at gravity compensation."
            found.append(
                (Effect("gravity_compensation", "drives", (share,), sentence), partial(effects.hold_weight, held))
            )
    else:
        delay = EffectParameter("time", "s", 0.0, 0.0, 0.05, late)
        sentence = "Positions come late behind efforts: look at filters of the sensors and at the bus."
        found.append((Effect("delay", "timing", (delay,), sentence), partial(effects.change_timing, "delay_s")))
    if robot.given.base is Base.HELD and np.any(robot.model.opt.gravity):
        source = "assumed: a base set up by eye, within 6 degrees"
        angles = tuple(EffectParameter(axis, "rad", 0.0, -0.1, 0.1, source) for axis in ("roll", "pitch"))
        sentence = "The base stands askew: put a level on it."
        found.append((Effect("base_tilt", "base", angles, sentence), effects.tilt_base))
    elif robot.given.base is not Base.HELD:
        scale = EffectParameter("scale", "1", 1.0, 0.2, 2.0, "tables of dry friction")
        sentence = "The floor grips otherwise than the model says: clean it, or measure its friction."
        found.append((Effect("floor_friction", "base", (scale,), sentence), effects.change_grip))
        scale = EffectParameter("scale", "1", 1.0, 0.3, 5.0, "assumed: from a steel plate to a mat")
        sentence = "The floor gives otherwise than the model says: stand the robot on a plate, and compare."
        found.append((Effect("floor_give", "base", (scale,), sentence), effects.change_give))
    return found


def _of_senses(robot: Robot) -> list[tuple[Effect, Change]]:
    """Return errors of sensors at sites: zero, scale, and how they are mounted."""
    weight = 9.81 * float(robot.model.body_mass[1:].sum())
    zeros = {
        Sense.ACCELERATION: ("m/s^2", 1.0, "data sheets of MEMS sensors: zero within 0.1 g"),
        Sense.RATE: ("rad/s", 0.1, "data sheets of MEMS sensors: zero within 6 degrees/s"),
        Sense.FORCE: ("N", 0.5 * weight, "assumed: zeroed with up to half of the weight on it"),
        Sense.TORQUE: ("N m", 0.1 * weight, "assumed: the same at 0.2 m"),
    }
    found: list[tuple[Effect, Change]] = []
    for site, sense in robot.senses:
        signal, (unit, most, source) = f"{site}/{sense.value}", zeros[sense]
        axes = tuple(EffectParameter(axis, unit, 0.0, -most, most, source) for axis in "xyz")
        what = f"the {sense.value.replace('_', ' ')} at {site}"
        sentence = f"Readings of {what} have another zero: let the robot stand still, and zero the sensor."
        found.append(
            (Effect(f"{sense.value}_offset_{site}", "sensing", axes, sentence), partial(effects.offset_sensor, signal))
        )
        scale = EffectParameter("scale", "1", 1.0, 0.8, 1.2, "assumed: a wrong range or unit is far off, others less")
        sentence = f"Readings of {what} have another scale: look at the sensor's range and calibration."
        found.append(
            (
                Effect(f"{sense.value}_scale_{site}", "sensing", (scale,), sentence),
                partial(effects.scale_sensor, signal),
            )
        )
    for site in dict.fromkeys(site for site, _ in robot.senses):
        source = "assumed: mounted within 12 degrees"
        turns = tuple(EffectParameter(axis, "rad", 0.0, -0.2, 0.2, source) for axis in "xyz")
        sentence = f"The sensor at {site} sits askew: look at how it is mounted, and at its frame."
        found.append((Effect(f"mounting_{site}", "sensing", turns, sentence), partial(effects.turn_sensor, site)))
    return found


_TOLERANCES = {"mass": 0.025, "length": 0.02, "gain": 0.025}
"""Standard deviations, as shares, of what no machine has as its model says. Assumed: drawings and data sheets are kept
within 2 to 3 %. Friction, damping and armature have none unless the map gives one: they are effects."""
_FARTHEST = 4.0
"""Standard deviations up to which a constant is looked for."""


def _share(robot: Robot, name: str, kind: str) -> Nuisance:
    """Return a constant that scales what the model says, with the tolerance of its kind."""
    given = robot.given.tolerances.get(kind)
    sigma = _TOLERANCES[kind] if given is None else given
    source = "drawings and data sheets: within 2 to 3 %" if given is None else f"the map: within {100.0 * given:g} %"
    return Nuisance(name, "1", 1.0, sigma, source, max(1.0 - _FARTHEST * sigma, 0.05), 1.0 + _FARTHEST * sigma)


def _constants(robot: Robot) -> list[tuple[Nuisance, Change]]:
    """Return masses, lengths, gains and times of arrival, and what else the map gives a tolerance."""
    found: list[tuple[Nuisance, Change]] = []
    for name in moving_bodies(robot):
        found.append((_share(robot, f"{name}/mass", "mass"), partial(effects.change_mass, name)))
        if _extent(robot, name) > 0.0:
            found.append((_share(robot, f"{name}/length", "length"), partial(effects.change_length, name)))
    if robot.drives:
        source = "a recorder stamps commands when it receives them: within milliseconds"
        found.append(
            (
                Nuisance("commands/arrival", "s", 0.0, 0.003, source, -0.01, 0.01),
                partial(effects.change_timing, "arrival_s"),
            )
        )
    if robot.efforts:
        source = "a drive reads position and effort within a cycle of its own: within milliseconds"
        found.append(
            (
                Nuisance("efforts/arrival", "s", 0.0, 0.002, source, -0.01, 0.01),
                partial(effects.change_timing, "effort_delay_s"),
            )
        )
    found += _gain_constants(robot)
    for kind, own in _BY_DOF.items():
        if kind in robot.given.tolerances:
            able = [name for name in robot.joints if getattr(robot.model, own)[robot.dof(name)] > 0.0]
            found += [(_share(robot, f"{name}/{kind}", kind), partial(effects.scale_dof, own, name)) for name in able]
    for joint in robot.given.torque_constants:
        if joint in robot.efforts:
            source = "data sheets: torque constants within 5 %"
            found.append(
                (
                    Nuisance(f"{joint}/torque_constant", "1", 1.0, 0.05, source, 0.7, 1.3),
                    partial(effects.scale_effort, joint),
                )
            )
    return found


_BY_DOF = {"friction": "dof_frictionloss", "damping": "dof_damping", "armature": "dof_armature"}


def _gain_constants(robot: Robot) -> list[tuple[Nuisance, Change]]:
    """Return the gains of drives: both together, and kd by itself, as the step of a model damps a little, too."""
    guess = "estimated from efforts: within 20 %"
    found: list[tuple[Nuisance, Change]] = []
    for drive in robot.drives:
        joint = drive.joint
        kp, kd = partial(effects.change_position_gain, joint), partial(effects.change_rate_gain, joint)
        if joint in robot.estimated:
            found.append((Nuisance(f"{joint}/kp", "1", 1.0, 0.2, guess, 0.3, 3.0), kp))
            found.append((Nuisance(f"{joint}/kd", "1", 1.0, 0.2, guess, 0.3, 3.0), kd))
            continue
        found.append((_share(robot, f"{joint}/gain", "gain"), partial(effects.change_gains, joint)))
        if drive.quantity is Quantity.POSITION and robot.model.actuator(drive.actuator).biasprm[2] != 0.0:
            found.append((_share(robot, f"{joint}/kd", "gain"), kd))
    return found
