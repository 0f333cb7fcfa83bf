"""Between a goal of ~/run_rig and its messages."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_msgs.action import RunRig
from jammkle_msgs.msg import RigFigure
from jammkle_sim.core.rig_goal import RigGoal

if TYPE_CHECKING:
    from collections.abc import Iterable

    from jammkle_sim.core.rig_goal import Figure


def rig_goal_from(request: RunRig.Goal) -> RigGoal:
    """Return what a goal of ~/run_rig asks for.

    Raises:
        ParameterError: an unknown rig or option, or a value out of range.

    """
    return RigGoal(request.rig, list(request.options), request.repeats, request.seed)


def rig_feedback(progress: float, time_s: float) -> RunRig.Feedback:
    """Return the share of all runs that is done, and the simulated time, s, of the present one."""
    return RunRig.Feedback(progress=progress, simulated_time_s=time_s)


def rig_result(message: str, figures: Iterable[Figure], *, success: bool) -> RunRig.Result:
    """Return the end of a goal: what happened and what was measured, SI."""
    return RunRig.Result(
        success=success,
        message=message,
        figures=[RigFigure(name=each.name, unit=each.unit, values=list(each.values)) for each in figures],
    )
