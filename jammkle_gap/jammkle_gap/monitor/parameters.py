"""Parameters of the gap monitor: one table that is declared, bounded, validated and documented from here."""

from __future__ import annotations

from dataclasses import dataclass

from jammkle_common.parameters import parameter
from jammkle_sim.rigs.catalogue import RIGS

FROM_THE_GRAPH = "from_graph"
"""Rig that sim_parameters tells."""


@dataclass(frozen=True)
class GapMonitorParameters:
    """What can be set on the gap monitor."""

    rig: str = parameter(
        FROM_THE_GRAPH,
        "What the robot stands in, with the rig's default options; from_graph: what sim_parameters tells",
        choices=(FROM_THE_GRAPH, *RIGS),
    )
    window_s: float = parameter(2.0, "Time over which a gap is taken", "s", 0.5, 30.0)
    limit: float = parameter(
        4.0,
        "Gap of a signal, in units of its noise, above which it has left its simulator",
        "",
        1.5,
        1000.0,
    )
    hold_s: float = parameter(0.5, "For how long a gap must be above the limit before it is warned of", "s", 0.0, 30.0)
    input_timeout_s: float = parameter(
        1.0, "Silence of a measurement after which its subsystem is reported as stale", "s", 0.2, 30.0
    )
    command_jitter_s: float = parameter(
        0.01,
        "How far the times of commands may be off where the hardware has no actuator_states; what that does to a "
        "pressure counts as noise",
        "s",
        0.0,
        0.05,
    )
