"""`jammkle up --foxglove`: an app that knows the protocol gets the topics that it asks for, and changes nothing."""

from __future__ import annotations

import contextlib
import json
import math
import re
import socket
import struct
import subprocess
import sys
import time
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import Imu
from std_msgs.msg import String
from websockets.sync.client import ClientConnection, connect

from browser import wait_until
from graph import environment
from jammkle_common.names import BASE_FRAME, IMU, JAM_STATE, ODOM_FRAME, ODOMETRY, ROBOT_DESCRIPTION, TF
from jammkle_msgs.msg import JamState
from jammkle_view.foxglove.node import TRANSFORM_SUFFIX, FoxgloveNode

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from rclpy.publisher import Publisher

    from graph import Probe, Up

PROTOCOL = "foxglove.sdk.v1"
MESSAGE = 1
"""First byte of a binary frame that holds a message; then its subscription, uint32, and its time, uint64 ns."""
TIMEOUT_S = 60.0
BASE_TRANSFORM = f"/{ODOMETRY.name}{TRANSFORM_SUFFIX}"


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        return int(taken.getsockname()[1])


class App:
    """As much of the app as it takes to look on."""

    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection
        self.channels: dict[str, dict[str, Any]] = {}
        self.messages: dict[int, list[tuple[int, bytes]]] = {}
        self.reported: list[dict[str, Any]] = []
        self.requests: dict[int, str] = {}
        """What was asked for, by the number of its channel."""

    def listen_until(self, holds: Callable[[], bool], what: str) -> None:
        end_s = time.monotonic() + TIMEOUT_S
        while not holds():
            assert time.monotonic() < end_s, f"gave up waiting until {what}; channels: {sorted(self.channels)}"
            try:
                frame = self.connection.recv(timeout=0.5)
            except TimeoutError:
                continue
            if isinstance(frame, str):
                said = json.loads(frame)
                self.reported.append(said)
                for channel in said.get("channels", ()):
                    self.channels[channel["topic"]] = channel
                # The server's library offers a channel a moment before it knows it, and refuses who is quicker.
                for number in re.findall(r"Unknown channel ID: (\d+)", str(said.get("message"))):
                    self.connection.send(self.requests[int(number)])
            elif frame[0] == MESSAGE:
                subscription, time_ns = struct.unpack_from("<IQ", frame, 1)
                self.messages.setdefault(subscription, []).append((time_ns, frame[13:]))

    def subscribe(self, number: int, topic: str) -> None:
        self.listen_until(lambda: topic in self.channels, f"{topic} is offered")
        request = {"op": "subscribe", "subscriptions": [{"id": number, "channelId": self.channels[topic]["id"]}]}
        self.requests[self.channels[topic]["id"]] = json.dumps(request)
        self.connection.send(json.dumps(request))


def check_transform(data: bytes, urdf: str) -> None:
    """Fail where the app could not draw the robot of a description in odom, above the ground."""
    (transform,) = get_typestore(Stores.ROS2_JAZZY).deserialize_cdr(data, TF.message_type).transforms  # type: ignore[attr-defined]
    assert (transform.header.frame_id, transform.child_frame_id) == (ODOM_FRAME, BASE_FRAME)
    assert f'link name="{BASE_FRAME}"' in urdf
    assert transform.transform.translation.z > 0.0
    turn = transform.transform.rotation
    assert math.hypot(turn.w, turn.x, turn.y, turn.z) == pytest.approx(1.0)


def test_the_app_gets_the_topics_it_looks_at(start: Callable[..., Up], tmp_path: Path) -> None:
    """Messages come as they were sent, in the time of the graph; latched ones reach whoever comes late."""
    (tmp_path / "manual.yaml").write_text("/**/controller: {ros__parameters: {auto_at_start: false}}\n")
    port = str(free_port())
    up = start("up", "--foxglove", "-p", f"foxglove:port:={port}", "--params", str(tmp_path / "manual.yaml"))
    address = wait_until(lambda: re.findall(r"Foxglove: (ws://localhost:\d+)", up.text()), "it listens", up.text)[0]
    assert address.endswith(port)
    wait_until(lambda: "jammkle: up" in up.text(), "the graph is up", up.text)
    for _ in range(2):  # the second one joins after all that is latched was sent to the first
        with connect(address, subprotocols=[PROTOCOL]) as connection:
            app = App(connection)
            app.subscribe(4, BASE_TRANSFORM)
            assert app.channels[BASE_TRANSFORM]["schemaName"] == TF.message_type
            for number, topic in enumerate((JAM_STATE, ROBOT_DESCRIPTION, IMU), start=1):
                app.subscribe(number, f"/{topic.name}")
                assert app.channels[f"/{topic.name}"]["schemaName"] == topic.message_type
                assert app.channels[f"/{topic.name}"]["encoding"] == "cdr"
            app.listen_until(lambda: {1, 2, 3, 4} <= set(app.messages), "every topic was received")  # noqa: B023
            app.listen_until(lambda: len(app.messages[3]) > 100, "the IMU streams")  # noqa: B023
            state = deserialize_message(app.messages[1][0][1], JamState)
            assert [each.channel for each in state.channels] == ["peroneal_left", "peroneal_right", "achilles"]
            assert "<robot" in deserialize_message(app.messages[2][0][1], String).data
            check_transform(app.messages[4][0][1], deserialize_message(app.messages[2][0][1], String).data)
            time_ns, data = app.messages[3][-1]
            stamp = deserialize_message(data, Imu).header.stamp
            assert abs(time_ns - (stamp.sec * 10**9 + stamp.nanosec)) < 10**9  # the graph's time, not this machine's
            (info,) = [said for said in app.reported if said["op"] == "serverInfo"]
            assert set(info["capabilities"]) == {"time"}  # nothing that would let it publish or call
    assert up.stop() == 0, up.text()


def test_a_publisher_that_comes_later_and_promises_less_is_forwarded(
    domain_id: int, make_probe: Callable[..., Probe]
) -> None:
    """A subscription that asks for more than a publisher offers gets nothing of it, and nobody says so."""
    probe, port, topic = make_probe(), str(free_port()), "/seen"
    weaker = ReliabilityPolicy.BEST_EFFORT
    reliable = probe.node.create_publisher(String, topic, 10)
    command = [sys.executable, "-m", "jammkle_view.foxglove", "--ros-args", "-p", f"port:={port}"]
    with subprocess.Popen(command, env=environment(domain_id)) as process:
        try:
            wait_until(lambda: listens(port), "it listens")
            with connect(f"ws://localhost:{port}", subprotocols=[PROTOCOL]) as connection:
                app = App(connection)
                app.subscribe(1, topic)

                def seen(publisher: Publisher, text: str) -> bool:
                    publisher.publish(String(data=text))
                    return any(deserialize_message(data, String).data == text for _, data in app.messages.get(1, ()))

                app.listen_until(lambda: seen(reliable, "reliable"), "the first is forwarded")
                best_effort = probe.node.create_publisher(String, topic, QoSProfile(depth=10, reliability=weaker))
                app.listen_until(lambda: seen(best_effort, "best effort"), "the second is forwarded")
        finally:
            process.terminate()


def test_a_type_without_its_python_module_is_not_forwarded() -> None:
    """Its definition may be installed alone: that ends no connection, and a line names it."""
    said: list[str] = []
    stand_in = SimpleNamespace(
        _source=lambda name: name,
        _qos=lambda _: QoSProfile(depth=1),
        _take=lambda *_: None,
        _types={"/seen": "absent_msgs/msg/Thing"},
        get_logger=lambda: SimpleNamespace(warning=said.append),
    )
    FoxgloveNode._subscribe(stand_in, "/seen")
    assert len(said) == 1
    assert said[0].startswith("/seen is not forwarded: type absent_msgs/msg/Thing is not installed here")


def listens(port: str) -> bool:
    with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", int(port))):
        return True
    return False


def test_what_cannot_be_is_refused_in_a_line(start: Callable[..., Up]) -> None:
    """A port without the connection, and one that is taken."""
    refused = start("up", "-p", "foxglove:port:=9999")
    assert refused.wait() == 2
    assert "no node 'foxglove' in this graph" in refused.text()
