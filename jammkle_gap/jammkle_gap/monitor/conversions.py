"""Between the gap monitor's core and ROS: the one place where shapes and enums change; all is SI."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from jammkle_common.bags.run_sheet import read_text
from jammkle_common.command.errors import InputError
from jammkle_common.messages import Health, Level
from jammkle_common.names import SIM_PARAMETERS
from jammkle_gap.monitor.twin import GapState
from jammkle_msgs.msg import SimulatorGap, SubsystemGap

if TYPE_CHECKING:
    from collections.abc import Sequence

    from builtin_interfaces.msg import Time

    from jammkle_gap.monitor.twin import SubsystemReport

_NS = 1e-9
_NOT_ASKED = ("seed", "release_time_s")
"""Options that the twin does not need: it has no noise, and sees by itself when the slide is let go."""
_STATES = {
    GapState.WAITING: (SubsystemGap.UNKNOWN, Level.OK),
    GapState.CLOSE: (SubsystemGap.CLOSE, Level.OK),
    GapState.WIDE: (SubsystemGap.WIDE, Level.WARN),
    GapState.STALE: (SubsystemGap.STALE, Level.STALE),
}
"""What each state is in a message, and on /diagnostics."""


def stamp_s(message: Any) -> float:
    """Return when a message was measured, s, by its header."""
    stamp = message.header.stamp
    return float(stamp.sec) + stamp.nanosec * _NS


def rig_of(description: str) -> tuple[str, dict[str, Any]]:
    """Return the name of the rig and its options from sim_parameters; an empty name where it does not say."""
    try:
        sheet = read_text(description, SIM_PARAMETERS.name)
    except InputError:
        return "", {}
    return sheet.rig, {name: value for name, value in sheet.options.items() if name not in _NOT_ASKED}


def simulator_gap_message(
    stamp: Time, limit: float, reports: Sequence[SubsystemReport], messages: Sequence[str]
) -> SimulatorGap:
    """Write the gap of every subsystem, noise units, with a sentence on each."""
    message = SimulatorGap(limit=limit)
    message.header.stamp = stamp
    message.subsystems = [
        SubsystemGap(
            name=report.name,
            state=_STATES[report.state][0],
            gap=math.nan if report.worst is None else report.worst.gap,
            signal="" if report.worst is None else report.worst.signal,
            phase="" if report.worst is None else report.worst.phase,
            message=text,
        )
        for report, text in zip(reports, messages, strict=True)
    ]
    return message


def subsystem_health(report: SubsystemReport, limit: float) -> Health:
    """Return one line on a subsystem."""
    values = {"limit (noise units)": f"{limit:g}"}
    values |= {f"gap of {signal} (noise units)": f"{gap:.2f}" for signal, gap in sorted(report.gaps.items())}
    return Health(report.name, _STATES[report.state][1], sentence(report), values)


def sentence(report: SubsystemReport) -> str:
    """Say where the robot has left its simulator; it changes only when that does."""
    if report.state is GapState.STALE:
        return f"cannot be followed: no {', '.join(report.missing)}"
    if report.worst is None:
        return "nothing to compare yet"
    if report.state is GapState.WIDE:
        return f"the robot has left its simulator: {report.worst.signal} while {report.worst.phase}"
    return "as simulated"
