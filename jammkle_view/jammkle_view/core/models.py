"""The MuJoCo model of what a robot stands in, from what its simulation says of itself."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import yaml

from jammkle_common.names import ANKLE_JOINTS, TENDONS
from jammkle_common.parameters import ParameterError
from jammkle_sim.physics.ankle import AnkleParameters
from jammkle_sim.rigs.catalogue import RIGS
from jammkle_sim.robots.catalogue import robot
from jammkle_sim.robots.options import RobotOptions

if TYPE_CHECKING:
    from collections.abc import Mapping

HANGING = "pressure"
"""Rig that stands for an ankle of which nobody says what it stands in: it hangs in the air."""


@dataclasses.dataclass(frozen=True)
class Naming:
    """What an ankle's parts are called in the model, by what its topics call them. What is not here is called alike."""

    joints: Mapping[str, str] = dataclasses.field(default_factory=dict)
    tendons: Mapping[str, str] = dataclasses.field(default_factory=dict)

    def joint(self, told: str) -> str:
        """Return the name of a joint in the model."""
        return self.joints.get(told, told)

    def tendon(self, told: str) -> str:
        """Return the name of a tendon in the model."""
        return self.tendons.get(told, told)


@dataclasses.dataclass(frozen=True)
class Setting:
    """What a robot stands in."""

    rig: str
    """Name of the rig, or of the robot."""
    options: dict[str, Any]
    """By name."""
    model: Any
    """The mujoco.MjModel."""
    ankles: Mapping[str, Naming] = dataclasses.field(default_factory=lambda: {"": Naming()})
    """Its ankles, by namespace below that of the whole; a single one is in that."""
    floats: bool = False
    """Whether nobody tells where its body is: it is then drawn with its lowest foot on the ground."""


def setting_of(description: str) -> Setting:
    """Return what a text of sim_parameters describes; a hanging ankle where it tells of nothing that is known.

    Args:
        description: YAML with `rig` or `robot`, `options` and the constants of the ankle; may be empty.

    """
    try:
        content = yaml.safe_load(description)
    except yaml.YAMLError:
        content = None
    told: dict[str, Any] = content if isinstance(content, dict) else {}
    options = dict(told.get("options") or {})
    try:
        if "robot" in told:
            return _robot(str(told["robot"]), options)
        if told.get("rig") in RIGS:
            return Setting(told["rig"], options, _rig(told["rig"], options, dict(told.get("ankle") or {})))
    except (ParameterError, TypeError):  # of another version of this project
        pass
    return Setting(HANGING, {}, _rig(HANGING, {}, {}))


def _rig(rig: str, options: dict[str, Any], ankle: dict[str, Any]) -> Any:
    kind = RIGS[rig]
    chosen = kind.options(**_known(kind.options, options))
    other = {} if kind.ankle is None or not ankle else {"ankle": AnkleParameters(**ankle)}
    built, _ = kind.build(chosen, **other)
    return built.model


def _robot(name: str, options: dict[str, Any]) -> Setting:
    built = robot(name, RobotOptions(**_known(RobotOptions, options)))
    several = len(built.ankles) > 1
    ankles = {
        ankle.name if several else "": Naming(
            {**{told: ankle.named(told) for told in ANKLE_JOINTS}, **ankle.joints},
            {tendon: ankle.named(tendon) for tendon in TENDONS},
        )
        for ankle in built.ankles
    }
    return Setting(name, options, built.model, ankles, floats=True)


def _known(table: Any, options: dict[str, Any]) -> dict[str, Any]:
    """Return the options that a table has; those of another version are left out."""
    known = {field.name for field in dataclasses.fields(table)}
    return {name: value for name, value in options.items() if name in known}
