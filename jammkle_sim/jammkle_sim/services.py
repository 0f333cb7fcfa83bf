"""Services of the sim node: ~/set_paused, ~/reset and ~/step."""

from __future__ import annotations

from typing import TYPE_CHECKING

from std_srvs.srv import SetBool, Trigger

from jammkle_common import names
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_msgs.srv import Step
from jammkle_sim.core.run_control import RefusedError, RunState

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node
    from rclpy.service import Service

    from jammkle_sim.core.engine import Engine


class LateAnswer:
    """Lets a service answer after its callback has returned, so that a long request does not block the node.

    The executor hands every answer, with the header that says whose it is, to `Service.send_response`; the events
    executor knows no other way (it does not await coroutines). This stands in between and holds the answer back.
    """

    def __init__(self, service: Service) -> None:
        """Stand in front of `service`."""
        self._send = service.send_response
        self._hold = False
        self._held: tuple[object, object] | None = None
        service.send_response = self._take

    def hold_next(self) -> None:
        """Hold back the answer that the callback now running returns."""
        self._hold = True

    def release(self, fill: Callable[[object], None]) -> None:
        """Send the answer held back, after `fill` has written it; does nothing if there is none."""
        if self._held is not None:
            response, header = self._held
            self._held = None
            fill(response)
            self._send(response, header)

    def _take(self, response: object, header: object) -> None:
        if self._hold:
            self._hold = False
            self._held = (response, header)
        else:
            self._send(response, header)


class Services:
    """The services, and the answer that is still owed for steps being taken."""

    def __init__(
        self, node: Node, engine: Engine, reset: Callable[[], None], on_state_change: Callable[[], None]
    ) -> None:
        """Offer the services on `node`.

        Args:
            node: The node.
            engine: What is paused, resumed and stepped.
            reset: Resets rig and commands; may raise RefusedError.
            on_state_change: Called after every wish that was granted.

        """
        self._engine = engine
        self._reset_rig = reset
        self._on_state_change = on_state_change
        self._steps_asked = 0
        node.create_service(SetBool, names.SET_PAUSED.name, self._set_paused)
        node.create_service(Trigger, names.RESET.name, self._reset)
        self._step_answer = LateAnswer(node.create_service(Step, names.STEP.name, self._step))

    def answer_finished_steps(self) -> None:
        """Answer ~/step if its steps are done, or if they never will be."""
        if self._steps_asked and self._engine.control.state is not RunState.STEPPING:
            self._step_answer.release(self._fill_step_answer)
            self._steps_asked = 0
            self._on_state_change()

    def _set_paused(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        try:
            if request.data:
                self._engine.pause()
            else:
                self._engine.resume()
        except RefusedError as error:
            response.message = str(error)
            return response
        response.success = True
        response.message = f"{self._engine.control.state.value} at {self._simulated_s():.4f} s"
        self._on_state_change()
        return response

    def _reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            self._reset_rig()
        except RefusedError as error:
            response.message = str(error)
            return response
        response.success = True
        response.message = (
            f"rig and noise as at the start; simulated time goes on from {self._simulated_s():.4f} s, "
            f"{self._engine.control.state.value}"
        )
        self._on_state_change()
        return response

    def _step(self, request: Step.Request, response: Step.Response) -> Step.Response:
        try:
            self._engine.begin_steps(request.steps)
        except RefusedError as error:
            response.message = str(error)
            response.simulated_time_s = self._simulated_s()
            return response
        self._steps_asked = request.steps
        self._step_answer.hold_next()
        return response

    def _fill_step_answer(self, response: Step.Response) -> None:
        failure = self._engine.control.failure
        response.success = not failure
        response.message = failure or f"took {self._steps_asked} steps"
        response.simulated_time_s = self._simulated_s()

    def _simulated_s(self) -> float:
        return self._engine.time_ns / NANOSECONDS_PER_SECOND
