"""Health of the robot as its simulated twin sees it, for /diagnostics."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_common.messages import Health, Level
from jammkle_gap.monitor.core.monitor import GapState

if TYPE_CHECKING:
    from jammkle_gap.monitor.core.monitor import SubsystemReport

_LEVELS = {
    GapState.WAITING: Level.OK,
    GapState.CLOSE: Level.OK,
    GapState.WIDE: Level.WARN,
    GapState.STALE: Level.STALE,
}


def subsystem_health(report: SubsystemReport, limit: float) -> Health:
    """Return one line on a subsystem."""
    values = {"limit (noise units)": f"{limit:g}"}
    values |= {f"gap of {signal} (noise units)": f"{gap:.2f}" for signal, gap in sorted(report.gaps.items())}
    return Health(report.name, _LEVELS[report.state], sentence(report), values)


def sentence(report: SubsystemReport) -> str:
    """Say where the robot has left its simulator; it changes only when that does."""
    if report.state is GapState.STALE:
        return f"cannot be followed: no {', '.join(report.missing)}"
    if report.worst is None:
        return "nothing to compare yet"
    if report.state is GapState.WIDE:
        return f"the robot has left its simulator: {report.worst.signal} while {report.worst.phase}"
    return "as simulated"


def unknown_rig_health(why: str) -> Health:
    """Return the line that stands in for all as long as there is no twin."""
    return Health("twin", Level.STALE, why)
