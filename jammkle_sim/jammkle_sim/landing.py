"""The rig that the sim node simulates, from the node's parameters."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING

from jammkle_sim.rigs.landing import LandingOptions, landing_simulation

if TYPE_CHECKING:
    from jammkle_sim.parameters import SimParameters
    from jammkle_sim.rigs.simulation import Simulation


def make_simulation(parameters: SimParameters) -> Simulation:
    """Build the landing rig.

    Args:
        parameters: The node's parameters.

    """
    options = LandingOptions(**{field.name: getattr(parameters, field.name) for field in fields(LandingOptions)})
    # The first step of a process compiles or loads the laws. It is taken by a rig that is thrown away, or else the
    # simulated time of the real one would start with a backlog.
    warm_up = landing_simulation(options)
    warm_up.advance(1)
    warm_up.record(1, 1)  # what a rig of ~/run_rig takes
    return landing_simulation(options)
