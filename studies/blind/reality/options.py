"""Settings of a run by the names that `jammkle rig` gives them, with its defaults."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from studies.blind.reality.record import Option, Plan

SIMULATOR_ONLY = ("seed", "parameter_set", "timestep_s")
"""Settings of `jammkle rig` that mean nothing on a real machine; accepted and not looked at."""


class BadPlanError(ValueError):
    """A plan that nobody could carry out. The message names the value and the way out."""


def settings(
    plan: Plan, defaults: Mapping[str, Option], fixed: Mapping[str, Option] | None = None
) -> dict[str, Option]:
    """Return every setting of a plan.

    Args:
        plan: What was set.
        defaults: What can be set, and what it is otherwise.
        fixed: What `jammkle rig` lets one choose but a machine has or has not; to be left as here.

    Raises:
        BadPlanError: an unknown name, or something that a machine cannot be told.

    """
    fixed = fixed or {}
    for name, value in plan.options.items():
        if name in SIMULATOR_ONLY or name in defaults:
            continue
        if name not in fixed:
            msg = f"rig '{plan.rig}' has no setting '{name}'; it has {', '.join(defaults)}"
            raise BadPlanError(msg)
        if value != fixed[name]:
            msg = f"'{name}' is {value}; a real machine has {fixed[name]}: set a fault instead"
            raise BadPlanError(msg)
    return {name: plan.options.get(name, default) for name, default in defaults.items()}
