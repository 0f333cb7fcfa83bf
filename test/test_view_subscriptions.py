"""What the viewer knows of an ankle, over real DDS; its page is not looked at."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from domains import wait_until
from jammkle_common import names
from jammkle_common.diagnostics import FAREWELL
from jammkle_common.qos import publisher_qos
from jammkle_msgs.msg import ChannelJamState, JamState
from jammkle_view.core.samples import ChannelState
from jammkle_view.node import ViewerNode

if TYPE_CHECKING:
    from collections.abc import Callable


@pytest.mark.parametrize("leaves", [False, True])
def test_channels_of_a_driver_that_is_gone_are_unknown(domain_id: int, *, leaves: bool) -> None:
    """They were jammed until the board let go. One that comes again counts, and the page says who is dead."""
    rclpy.init(domain_id=domain_id, signal_handler_options=SignalHandlerOptions.NO)
    viewer, driver = ViewerNode(), rclpy.create_node("driver")
    executor = SingleThreadedExecutor()
    executor.add_node(viewer)
    states = driver.create_publisher(JamState, names.JAM_STATE.name, publisher_qos(names.JAM_STATE))
    reports = driver.create_publisher(DiagnosticArray, names.DIAGNOSTICS.name, publisher_qos(names.DIAGNOSTICS))
    ankle, page = viewer._known[""], viewer._page

    def frames(condition: Callable[[], bool]) -> Callable[[], bool]:
        def frame() -> bool:
            executor.spin_once(timeout_sec=0.01)
            viewer._frame()
            return condition()

        return frame

    def report(about: str) -> None:
        reports.publish(DiagnosticArray(status=[DiagnosticStatus(name=f"/driver{about}")]))

    def is_jammed() -> bool:
        report(": jamming")
        states.publish(JamState(channels=[ChannelJamState(channel=names.ACHILLES, state=ChannelJamState.JAMMED)]))
        return names.ACHILLES in ankle.channels and "driver" in viewer._liveness.alive()

    for _ in range(2):
        wait_until(frames(is_jammed), "the viewer knows of channel and driver")
        assert ankle.channels[names.ACHILLES].state is ChannelState.JAMMED
        if leaves:
            report(FAREWELL)
        wait_until(frames(lambda: not ankle.channels), "the viewer knows that the driver is gone")
        assert ankle.state_of("achilles_left") is ChannelState.UNKNOWN
        assert ("driver is dead or hangs" in page._answer.content) is not leaves
    viewer.shut_down()
    executor.shutdown()
    viewer.destroy_node()
    driver.destroy_node()
    rclpy.shutdown()
