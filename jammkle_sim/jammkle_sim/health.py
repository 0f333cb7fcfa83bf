"""Health of the sim node, for /diagnostics."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.health import COMMANDS_LINE, Health, Level
from jammkle_sim.core.pacing import AS_FAST_AS_POSSIBLE
from jammkle_sim.core.run_control import RunState
from jammkle_sim.inputs import WATCHDOG_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_sim.core.engine import Engine

_SLOW_BELOW = 0.9
"""Share of the wanted speed below which the simulation counts as too slow. Assumed: clear of measuring noise."""


def simulation_health(engine: Engine) -> Health:
    """Run state, simulated time and pace."""
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
    if control.state is RunState.RUNNING and factor < _SLOW_BELOW * pacer.speed:
        return Health("simulation", Level.WARN, "slower than wanted; lower the parameter speed", values)
    return Health("simulation", Level.OK, control.state.value, values)


def tendon_health(broken: Sequence[str], rig: str, ankle: str = "") -> Health:
    """Whether every tendon is whole.

    Args:
        broken: Names of those that are not.
        rig: Name of the rig that runs in the ankle's place; empty if none does.
        ankle: Which of several; empty: there is but one.

    """
    about = f"{ankle} tendons".strip()
    values = {"broken tendons": ", ".join(broken) or "none"}
    if broken:
        way_out = f"the next run of rig '{rig}' starts with whole ones" if rig else "~/reset makes them whole"
        return Health(about, Level.ERROR, f"broken: {', '.join(broken)}; {way_out}", values)
    return Health(about, Level.OK, "whole", values)


def rig_health(running: str, trouble: str) -> Health:
    """What ~/run_rig does, and what went wrong in the goal before.

    Args:
        running: Which run of which rig is running; empty if none is.
        trouble: What tore or failed in the latest goal; empty if nothing did.

    """
    if running:
        return Health("rig", Level.OK, f"running {running}")
    if trouble:
        return Health("rig", Level.ERROR, f"{trouble}; the next goal of ~/run_rig or ~/reset clears this")
    return Health("rig", Level.OK, "none running")


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
