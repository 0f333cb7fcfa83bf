"""Health of the sim node, for /diagnostics."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.messages import COMMANDS_LINE, Health, Level
from jammkle_common.names import CLOCK
from jammkle_sim.core.pacing import AS_FAST_AS_POSSIBLE
from jammkle_sim.core.run_control import RunState
from jammkle_sim.inputs import WATCHDOG_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_sim.core.engine import Engine

_SLOW_BELOW = 0.9
"""Share of the wanted speed below which the simulation counts as too slow. Assumed: clear of measuring noise."""


def simulation_health(engine: Engine, clocks: int) -> Health:
    """Run state, simulated time and pace, and whether the clock is this simulation's alone.

    Args:
        engine: Drives the simulation.
        clocks: How many publish the clock that this one publishes.

    """
    control, pacer = engine.control, engine.pacer
    factor = engine.real_time_factor
    values = {
        "state": control.state.value,
        "simulated time (s)": f"{engine.time_ns / NANOSECONDS_PER_SECOND:.4f}",
        "target real-time factor": "as fast as possible" if pacer.speed == AS_FAST_AS_POSSIBLE else f"{pacer.speed:g}",
        "achieved real-time factor": "not measured yet" if math.isnan(factor) else f"{factor:.3f}",
        "late cycles": str(pacer.late_cycles),
        "real time given up (s)": f"{pacer.given_up_s:.3f}",
    }
    if control.state is RunState.FAILED:
        return Health("simulation", Level.ERROR, f"{control.failure}; paused until ~/reset", values)
    if clocks > 1:
        message = (
            f"{CLOCK.name} is made by {clocks} simulations: stop the others, choose another ROS_DOMAIN_ID, or give "
        )
        message += "all but one publish_clock:=false to live in its time"
        return Health("simulation", Level.WARN, message, values)
    if control.state is RunState.RUNNING and factor < _SLOW_BELOW * pacer.speed:
        return Health("simulation", Level.WARN, "slower than wanted; lower the parameter speed", values)
    return Health("simulation", Level.OK, control.state.value, values)


def tendon_health(broken: Sequence[str], ankle: str = "") -> Health:
    """Whether every tendon is whole.

    Args:
        broken: Names of those that are not.
        ankle: Which of several; empty: there is but one.

    """
    about = f"{ankle} tendons".strip()
    values = {"broken tendons": ", ".join(broken) or "none"}
    if broken:
        return Health(about, Level.ERROR, f"broken: {', '.join(broken)}; ~/reset makes them whole", values)
    return Health(about, Level.OK, "whole", values)


def command_health(refused: str, ankle: str = "", *, let_go: bool) -> Health:
    """Whether the latest command was followed, and the driver is heard.

    Args:
        refused: Why the latest command was refused; empty when it was followed.
        ankle: Which of several; empty: there is but one.
        let_go: Whether the simulated board has let go as it had not heard the driver.

    """
    about = f"{ankle}{COMMANDS_LINE}".strip()
    if let_go:
        message = f"no command for {WATCHDOG_S:g} s while something was on: everything released, until told to release"
        return Health(about, Level.ERROR, message)
    if refused:
        return Health(about, Level.WARN, refused)
    return Health(about, Level.OK, "followed")
