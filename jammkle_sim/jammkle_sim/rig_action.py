"""Action of the sim node, ~/run_rig: rigs of the catalogue, run in place of the simulated ankle.

A run is taken forward by the node's own loop, between callbacks, so that everything else stays alive. A coroutine as
execute callback would be simpler, but the events executor asks an awaiting one 270,000 times per second whether it is
done; so goals are only taken note of, and executed, in the sense of rclpy, when their result stands.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import GoalEvent

from jammkle_common import names
from jammkle_common.parameters import ParameterError
from jammkle_msgs.action import RunRig
from jammkle_sim.core.rig_goal import RigRows, periods_of
from jammkle_sim.core.run_control import RefusedError
from jammkle_sim.goal_messages import rig_feedback, rig_goal_from, rig_result

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.action.server import ServerGoalHandle
    from rclpy.node import Node

    from jammkle_sim.core.engine import Engine
    from jammkle_sim.core.rig_goal import RigGoal
    from jammkle_sim.rigs.run import RunInProgress
    from jammkle_sim.rigs.simulation import Simulation

_FEEDBACK_PERIOD_S = 0.1
"""Real time between two feedbacks, s."""


class RigAction:
    """The action server, and the goal that it works on: one at a time."""

    def __init__(
        self,
        node: Node,
        engine: Engine,
        show: Callable[[Simulation | None], None],
        on_change: Callable[[], None],
    ) -> None:
        """Offer the action on `node`.

        Args:
            node: The node.
            engine: Drives the ankle, and the rig in its place.
            show: Called with the simulation whose outputs are to be published; None is the ankle's.
            on_change: Called when `place` or `trouble` has become something else.

        """
        self._engine = engine
        self._show = show
        self._on_change = on_change
        self._handle: ServerGoalHandle | None = None
        self._goal: RigGoal | None = None
        self._running: RunInProgress | None = None
        self._trouble = ""
        self._feedback_due_s = 0.0
        self._server = ActionServer(
            node,
            RunRig,
            names.RUN_RIG.name,
            self._never_executed,
            handle_accepted_callback=self._accept,
            cancel_callback=lambda _handle: CancelResponse.ACCEPT,
        )

    def destroy(self) -> None:
        """Take the action off the graph."""
        self._server.destroy()

    @property
    def place(self) -> str:
        """Which run of which rig is running; empty if none is."""
        return self._goal.place if self._goal is not None else ""

    @property
    def trouble(self) -> str:
        """What tore or failed in the latest goal; empty if nothing did."""
        return self._trouble

    def forget_trouble(self) -> None:
        """Take what went wrong as seen."""
        self._trouble = ""

    def go_on(self) -> None:
        """Do what is due between two outputs: begin and finish runs, tell the progress, end the goal."""
        if self._goal is None or self._handle is None or self._running is None:
            return
        if self._handle.is_cancel_requested:
            self._end(f"cancelled in {self.place}", self._handle.canceled)
        elif self._running.is_finished:
            self._goal.keep(self._running.result())
            if self._goal.is_done:
                self._succeed(self._goal, self._handle)
            else:
                self._begin_run(self._goal)
        elif time.monotonic() >= self._feedback_due_s:
            self._tell_progress(self._goal, self._running)

    def fail(self, why: str) -> None:
        """End the goal, if there is one, because it cannot go on."""
        if self._goal is not None and self._handle is not None:
            self._trouble = f"{self.place}: {why}"
            self._end(self._trouble, self._handle.abort)

    def _accept(self, handle: ServerGoalHandle) -> None:
        """Begin with a goal, or end it at once: a goal that is rejected could not be told why."""
        try:
            goal = rig_goal_from(handle.request)
            self._engine.control.begin_rig(goal.rig)
        except (ParameterError, RefusedError) as error:
            message = str(error)
            handle.execute(lambda refused: _ended(refused.abort, rig_result(message, (), success=False)))
            return
        # Executing without having been executed: rclpy has no public way to say so.
        handle._update_state(GoalEvent.EXECUTE)  # noqa: SLF001
        self._goal, self._handle, self._running = goal, handle, None
        self._trouble = ""
        self._feedback_due_s = 0.0
        self._begin_run(goal)  # now, or the ankle would take a step before the rig's first

    def _begin_run(self, goal: RigGoal) -> None:
        try:
            running = goal.begin()
        except ParameterError as error:
            if self._handle is not None:
                self._end(str(error), self._handle.abort)
            return
        self._running = running
        self._engine.lend(RigRows(running), periods_of(running))
        self._show(running.simulation)
        self._on_change()

    def _tell_progress(self, goal: RigGoal, running: RunInProgress) -> None:
        self._feedback_due_s = time.monotonic() + _FEEDBACK_PERIOD_S
        if self._handle is not None:
            share, time_s = goal.share_done(running.share_done), running.simulation.rig_time_s
            self._handle.publish_feedback(rig_feedback(share, time_s))

    def _succeed(self, goal: RigGoal, handle: ServerGoalHandle) -> None:
        torn = goal.torn()
        self._trouble = f"{goal.rig}: tendon broken: {torn}" if torn else ""
        handle.publish_feedback(rig_feedback(1.0, 0.0))
        self._end(f"done: {goal.place}{f'; tendon broken: {torn}' if torn else ''}", handle.succeed, success=True)

    def _end(self, message: str, conclude: Callable[[], None], *, success: bool = False) -> None:
        """Give back the ankle's simulation, then the result."""
        goal, handle = self._goal, self._handle
        self._goal = self._handle = self._running = None
        self._engine.control.end_rig()
        self._engine.take_back()
        self._show(None)
        self._on_change()
        if goal is not None and handle is not None:
            result = rig_result(message, goal.figures(), success=success)
            self._server.notify_execute(handle, lambda _handle: _ended(conclude, result))

    def _never_executed(self, _handle: ServerGoalHandle) -> RunRig.Result:
        """Stand in for the execute callback that rclpy insists on."""
        raise NotImplementedError


class NoRigAction:
    """Stands for the action on a node that runs no rigs: its robot has no place for one."""

    place = ""
    trouble = ""

    def go_on(self) -> None:
        """Nothing is due."""

    def fail(self, why: str) -> None:
        """Nothing can fail."""

    def forget_trouble(self) -> None:
        """There was none."""

    def destroy(self) -> None:
        """There is nothing on the graph."""


def _ended(conclude: Callable[[], None], result: RunRig.Result) -> RunRig.Result:
    conclude()
    return result
