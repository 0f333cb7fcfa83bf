"""Between ROS messages and the gap monitor's core: the one place where shapes and enums change; all is SI."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import yaml

from jammkle_gap.monitor.core.monitor import GapState
from jammkle_msgs.msg import SimulatorGap, SubsystemGap

if TYPE_CHECKING:
    from collections.abc import Sequence

    from builtin_interfaces.msg import Time

    from jammkle_gap.monitor.core.monitor import SubsystemReport

_NS = 1e-9
_NOT_ASKED = ("seed", "release_time_s")
"""Options that the twin does not need: it has no noise, and sees by itself when the slide is let go."""
_STATES = {
    GapState.WAITING: SubsystemGap.UNKNOWN,
    GapState.CLOSE: SubsystemGap.CLOSE,
    GapState.WIDE: SubsystemGap.WIDE,
    GapState.STALE: SubsystemGap.STALE,
}


def stamp_s(message: Any) -> float:
    """Return when a message was measured, s, by its header."""
    stamp = message.header.stamp
    return float(stamp.sec) + stamp.nanosec * _NS


def rig_of(description: str) -> tuple[str, dict[str, Any]]:
    """Return the name of the rig and its options from sim_parameters; an empty name where it does not tell."""
    try:
        content = yaml.safe_load(description)
    except yaml.YAMLError:
        return "", {}
    content = content if isinstance(content, dict) else {}
    options = dict(content.get("options") or {})
    for name in _NOT_ASKED:
        options.pop(name, None)
    return str(content.get("rig", "")), options


def simulator_gap_message(
    stamp: Time, limit: float, reports: Sequence[SubsystemReport], messages: Sequence[str]
) -> SimulatorGap:
    """Write the gap of every subsystem, noise units, with a sentence on each."""
    message = SimulatorGap(limit=limit)
    message.header.stamp = stamp
    message.subsystems = [
        SubsystemGap(
            name=report.name,
            state=_STATES[report.state],
            gap=math.nan if report.worst is None else report.worst.gap,
            signal="" if report.worst is None else report.worst.signal,
            phase="" if report.worst is None else report.worst.phase,
            message=text,
        )
        for report, text in zip(reports, messages, strict=True)
    ]
    return message
