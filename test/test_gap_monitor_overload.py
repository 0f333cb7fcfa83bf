"""The gap monitor's node with a twin that takes all the time it gets: its inputs and its reports come first."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.experimental import EventsExecutor
from sensor_msgs.msg import Imu

from jammkle_common import names
from jammkle_common.diagnostics import PERIOD_S
from jammkle_common.qos import publisher_qos
from jammkle_common.runner import StopFlag
from jammkle_gap.monitor.node import GapMonitorNode
from jammkle_gap.monitor.twin import GapMonitor
from jammkle_msgs.msg import SimulatorGap

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rclpy.node import Node

STRETCH_S = 0.05
"""What one stretch takes: ten times as long as on a machine that keeps up."""
SAMPLES = 50
"""Samples of the IMU that come meanwhile, at 1 kHz."""
STRETCHES = 80


@pytest.fixture
def onlooker(domain_id: int) -> Iterator[Node]:
    """Make a node for the robot's end of the topics; it is never spun."""
    rclpy.init(args=["--ros-args", "-p", "gap_monitor:rig:=drop"], domain_id=domain_id)
    node = rclpy.create_node("onlooker")
    yield node
    node.destroy_node()
    rclpy.shutdown()


def test_the_newest_samples_come_in_and_reports_keep_coming(onlooker: Node, monkeypatch: pytest.MonkeyPatch) -> None:
    """However long the twin takes, no backlog of messages builds up, and none keeps reports waiting."""
    stop = StopFlag()
    imu = onlooker.create_publisher(Imu, names.IMU.name, publisher_qos(names.IMU))
    reports = onlooker.create_subscription(SimulatorGap, names.SIMULATOR_GAP.name, lambda _: None, 1000)
    health = onlooker.create_subscription(DiagnosticArray, names.DIAGNOSTICS.name, lambda _: None, 1000)
    stamps: list[int] = []
    lags: list[int] = []

    def take(_monitor: GapMonitor, _topic: str, time_s: float, *_: object) -> None:
        stamps.append(round(time_s))

    def advance(_monitor: GapMonitor, _now_s: float) -> bool:
        begin = SAMPLES * len(lags)
        lags.append(begin - (stamps[-1] if stamps else 0))
        if len(lags) == STRETCHES:
            stop.stop()
        for number in range(begin, begin + SAMPLES):
            message = Imu()
            message.header.stamp.sec = number + 1
            imu.publish(message)
        time.sleep(STRETCH_S)
        return True

    monkeypatch.setattr(GapMonitor, "take", take)
    monkeypatch.setattr(GapMonitor, "advance", advance)
    node = GapMonitorNode()
    executor = EventsExecutor()
    executor.add_node(node)
    end_s = time.monotonic() + 30.0
    while not (imu.get_subscription_count() and node.count_subscribers(names.SIMULATOR_GAP.name)):
        assert time.monotonic() < end_s, "they never met"
        executor.spin_once(timeout_sec=0.05)
    begin_s = time.monotonic()
    node.drive(executor, stop)
    passed_s = time.monotonic() - begin_s
    executor.shutdown()
    node.destroy_node()

    assert max(lags[STRETCHES // 2 :]) <= 2 * SAMPLES
    assert _taken(reports) >= STRETCHES // 10
    assert _taken(health) >= passed_s / (2.0 * PERIOD_S) - 1.0


def _taken(subscription: object) -> int:
    """Count what has arrived."""
    count = 0
    with subscription.handle:  # type: ignore[attr-defined]
        while subscription.handle.take_message(subscription.msg_type, False) is not None:  # type: ignore[attr-defined]  # noqa: FBT003 - rclpy's own
            count += 1
    return count
