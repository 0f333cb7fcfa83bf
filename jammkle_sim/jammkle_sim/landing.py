"""The rig that the sim node simulates, from the node's parameters."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

from jammkle_common.command.errors import InputError
from jammkle_common.parameters import ParameterError
from jammkle_sim.effects_file import load_change
from jammkle_sim.rigs.catalogue import as_it_is
from jammkle_sim.rigs.changes import BadChangeError
from jammkle_sim.rigs.landing import LandingOptions, landing_parts
from jammkle_sim.rigs.simulation import Simulation

if TYPE_CHECKING:
    from collections.abc import Callable

    from jammkle_sim.parameters import SimParameters
    from jammkle_sim.rigs.rig import Rig


def make_simulation(parameters: SimParameters) -> Simulation:
    """Build the landing rig.

    Args:
        parameters: The node's parameters.

    Raises:
        ParameterError: the rig refuses a value, or the effects file cannot be used.

    """
    change = _effects(parameters.effects_file)
    options = landing_options(parameters)
    # The first step of a process compiles or loads the laws. It is taken by a rig that is thrown away, or else the
    # simulated time of the real one would start with a backlog.
    warm_up = Simulation(change(landing_parts(options)))
    warm_up.advance(1)
    return Simulation(change(landing_parts(options)))


def landing_options(parameters: SimParameters) -> LandingOptions:
    """Return what the parameters say of the rig; speed and rates are none of its business."""
    return LandingOptions(**{field.name: getattr(parameters, field.name) for field in fields(LandingOptions)})


def _effects(file: str) -> Callable[[Rig], Rig]:
    """Return what the effects of a file do to a rig; nothing without a file.

    Raises:
        ParameterError: it cannot be read, or holds what cannot be simulated live.

    """
    if not file:
        return as_it_is
    try:
        change = load_change(Path(file))
        change.check_live()
    except (BadChangeError, InputError) as error:
        msg = f"parameter 'effects_file': {error}"
        raise ParameterError(msg) from error
    return change
