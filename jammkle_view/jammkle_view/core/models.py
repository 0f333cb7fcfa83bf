"""The MuJoCo model of what a robot stands in, from what its simulation says of itself."""

from __future__ import annotations

import dataclasses
from typing import Any

import yaml

from jammkle_graph.parameters import ParameterError
from jammkle_sim.physics.ankle import AnkleParameters
from jammkle_sim.rigs.catalogue import RIGS

HANGING = "pressure"
"""Rig that stands for an ankle of which nobody says what it stands in: it hangs in the air."""


@dataclasses.dataclass(frozen=True)
class Setting:
    """What a robot stands in."""

    rig: str
    options: dict[str, Any]
    """Of the rig, by name."""
    model: Any
    """The mujoco.MjModel."""


def setting_of(description: str) -> Setting:
    """Return what a text of sim_parameters describes; a hanging ankle where it tells of nothing that is known.

    Args:
        description: YAML with `rig`, `options` and the constants of the ankle; may be empty.

    """
    try:
        content = yaml.safe_load(description)
    except yaml.YAMLError:
        content = None
    told: dict[str, Any] = content if isinstance(content, dict) else {}
    rig, options = str(told.get("rig", HANGING)), dict(told.get("options") or {})
    if rig not in RIGS:
        rig, options = HANGING, {}
    try:
        return Setting(rig, options, _built(rig, options, dict(told.get("ankle") or {})))
    except (ParameterError, TypeError):  # of another version of this project
        return Setting(HANGING, {}, _built(HANGING, {}, {}))


def _built(rig: str, options: dict[str, Any], ankle: dict[str, Any]) -> Any:
    kind = RIGS[rig]
    known = {field.name for field in dataclasses.fields(kind.options)}
    chosen = kind.options(**{name: value for name, value in options.items() if name in known})
    other = {} if kind.ankle is None or not ankle else {"ankle": AnkleParameters(**ankle)}
    built, _ = kind.build(chosen, **other)
    return built.model
