"""What rclpy's lifecycle leaves open: a transition that is not allowed now must not end the node."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lifecycle_msgs.srv import ChangeState
    from rclpy.lifecycle import LifecycleNode


def refuse_bad_transitions(node: LifecycleNode) -> None:
    """Answer false to a transition that is not allowed now.

    rclpy lets it escape from the executor, which would end the driver: anybody who activates twice would drop the leg.
    """
    change_state = node._service_change_state.callback  # noqa: SLF001 - there is no other way in

    def answer(request: ChangeState.Request, response: ChangeState.Response) -> ChangeState.Response:
        try:
            return change_state(request, response)
        except RuntimeError as error:
            node.get_logger().warning(f"transition {request.transition.id} refused: {error}")
            response.success = False
            return response

    node._service_change_state.callback = answer  # noqa: SLF001 - as above
