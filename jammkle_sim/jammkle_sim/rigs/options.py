"""Options that several rigs have, each with its default, words and range in one place; and what is asked of any."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

from jammkle_common.constants import HELD_VACUUM_PA, MAX_SEED
from jammkle_common.parameters import ParameterClass, from_mapping, parameter, rows
from jammkle_sim.physics.constants import TENDON_SETS

P = TypeVar("P", bound=ParameterClass)

FROM_RESET = "; a change holds from the next `~/reset` on"


def seed_option() -> Any:
    """Make the field `seed`."""
    return parameter(0, "Seed of all that is random; the same seed gives the same bytes", "", 0, MAX_SEED)


def parameter_set_option() -> Any:
    """Make the field `parameter_set`."""
    return parameter(
        "fitted",
        "Constants of the tendons: fitted to the paper's measurements, or as printed in it",
        choices=tuple(TENDON_SETS),
        flag=False,
    )


def timestep_option(rule: str) -> Any:
    """Make the field `timestep_s`; at twice the default a drop's peak reads 1 to 1.5 m/s^2 high.

    Args:
        rule: What it must fit, in words.

    """
    return parameter(0.0005, f"Length of a simulation step; {rule}", "s", 1e-4, 1e-3, flag=False)


def run_timestep_option() -> Any:
    """Make the field `timestep_s` of a rig that runs by itself."""
    return timestep_option("must divide 1 ms")


def jammed_vacuum_option() -> Any:
    """Make the field `vacuum_pa` of a rig whose ankle may be jammed."""
    return parameter(HELD_VACUUM_PA, "Vacuum of the jammed ankle", "Pa", 5e3, 75e3)


def hang_pitch_option() -> Any:
    """Make the field `hang_pitch_deg` of an exercise, whose ankle is a robot's as it is built."""
    description = "Pitch at which the ankle's foot hangs from its shank, toe-down; 0: flat"
    return parameter(0.0, description, "deg", 0.0, 45.0, flag=False)


def reservoir_option() -> Any:
    """Make the field `reservoir_volume_m3` of an exercise, whose air is a robot's as it is built."""
    return parameter(0.0, "Reservoir that stores vacuum between two jams; 0: none", "m^3", 0.0, 1e-3, flag=False)


def drop_height_option(ground: str, *, dynamic: bool = False) -> Any:
    """Make the field `drop_height_m`; the paper's drop test has 50 mm.

    Args:
        ground: What it falls onto.
        dynamic: Whether it may be changed for the next reset.

    """
    description = f"Fall of the foot's lowest point onto the {ground}{FROM_RESET if dynamic else ''}"
    return parameter(0.05, description, "m", 0.0, 0.5, dynamic=dynamic)


def release_time_option(start: str) -> Any:
    """Make the field `release_time_s`; `start` is what it counts from."""
    return parameter(1.0, f"Time after {start} at which the carriage is released", "s", 0.0, 3600.0, flag=False)


def mass_option(*, flag: bool = True) -> Any:
    """Make the field `mass_kg`; the paper's drop test has 1.8 kg.

    Args:
        flag: Whether it can be typed, and not only be set in a file.

    """
    return parameter(1.8, "Mass of all that falls, foot included", "kg", 0.5, 20.0, flag=flag)


def slope_option(*, dynamic: bool = False) -> Any:
    """Make the field `slope_deg`; the paper's slip test has 40 degrees, toe uphill.

    Args:
        dynamic: Whether it may be changed for the next reset.

    """
    description = f"Inclination of the slope to land on{FROM_RESET if dynamic else ''}"
    return parameter(40.0, description, "deg", 0.0, 50.0, dynamic=dynamic)


def slope_friction_option() -> Any:
    """Make the field `friction` of a landing.

    Assumed, as in the slip rig. It matters: near 0.55 the toe almost locks at first touch, which gives the first peak;
    at 0.3 and below the heel strikes the slope in the end.
    """
    return parameter(0.55, "Coulomb friction between foot and slope", "", 0.0, 2.0)


def replaced_within_range(options: P, **values: float) -> P:
    """Return the options with other values, each moved to the nearest one that its range allows."""
    ranges = {row.name: (row.minimum, row.maximum) for row in rows(type(options))}
    return dataclasses.replace(options, **{name: _within(value, *ranges[name]) for name, value in values.items()})


def checked(options: P) -> P:
    """Return the options, each in its own type.

    Raises:
        ParameterError: one is out of range or of the wrong type.

    """
    return from_mapping(type(options), dataclasses.asdict(options))


def changed_text(options: ParameterClass) -> str:
    """Name the options that are not as by default, on one line: `foot=jammed, mass_kg=3.0`."""
    changed = [(row, getattr(options, row.name)) for row in rows(type(options))]
    return ", ".join(f"{row.name}={value}" for row, value in changed if value != row.default) or "all as by default"


def _within(value: float, minimum: float | None, maximum: float | None) -> float:
    low = value if minimum is None else max(value, minimum)
    return low if maximum is None else min(low, maximum)
