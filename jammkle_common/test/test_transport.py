"""Processes of ours share no memory with others, so that nobody waits for one that was killed, unless users choose so.

What they receive is kept until a busy machine lets them read it.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from xml.etree import ElementTree as ET

import pytest

from domains import own_domain
from jammkle_common.processes import talk_by_udp

WANTED_BYTES = 4 * 2**20

PARTICIPANT = """
import contextlib, os, rclpy, socket
from pathlib import Path
from jammkle_common.processes import talk_by_udp
talk_by_udp(os.environ)
rclpy.init()
node = rclpy.create_node("anybody")
print("/dev/shm/fastrtps" in Path("/proc/self/maps").read_text())
buffers = []
first = 7400 + 250 * int(os.environ["ROS_DOMAIN_ID"])
for each in os.listdir("/proc/self/fd"):
    with contextlib.suppress(OSError), socket.socket(fileno=os.dup(int(each))) as end:
        if end.type == socket.SOCK_DGRAM and end.getsockname()[1] in range(first, first + 250):
            buffers.append(end.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF))
print(min(buffers))
"""


def started(**chosen: str) -> tuple[bool, int]:
    """Start a participant with what a user has chosen.

    Returns:
        Whether it maps queues of Fast DDS, and the least buffer that it receives into, bytes.

    """
    inherited = {name: value for name, value in os.environ.items() if not name.startswith(("FAST", "ROS_", "RMW_"))}
    with own_domain() as number:
        answer = subprocess.run(
            [sys.executable, "-c", PARTICIPANT],
            env={**inherited, "ROS_DOMAIN_ID": str(number), **chosen},
            capture_output=True,
            text=True,
            check=True,
        )
    shared, buffer = answer.stdout.split()
    return shared == "True", int(buffer)


@pytest.mark.parametrize("reach", ["LOCALHOST", "SUBNET"])
def test_memory_is_shared_where_a_user_asks_for_it_alone(reach: str) -> None:
    """With discovery on this machine alone, and beyond it."""
    assert not started(ROS_AUTOMATIC_DISCOVERY_RANGE=reach)[0]
    assert started(ROS_AUTOMATIC_DISCOVERY_RANGE=reach, FASTDDS_BUILTIN_TRANSPORTS="DEFAULT")[0]


@pytest.mark.parametrize("reach", ["LOCALHOST", "SUBNET"])
def test_a_burst_of_discovery_is_not_lost(reach: str) -> None:
    """Buffers are as large as any socket's here that asks for as much."""
    with socket.socket(type=socket.SOCK_DGRAM) as end:
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, WANTED_BYTES)
        allowed = end.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
    assert started(ROS_AUTOMATIC_DISCOVERY_RANGE=reach)[1] == allowed


@pytest.mark.parametrize(
    "chosen",
    [
        {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"},
        {"FASTRTPS_DEFAULT_PROFILES_FILE": "mine.xml"},
        {"FASTDDS_DEFAULT_PROFILES_FILE": "mine.xml", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
        {"ROS_LOCALHOST_ONLY": "1"},
        {"ROS_STATIC_PEERS": "10.0.0.2", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
    ],
)
def test_what_a_user_has_chosen_stays(chosen: dict[str, str]) -> None:
    """Another middleware, a profile, or the deprecated way to stay on one machine."""
    environment = dict(chosen)
    talk_by_udp(environment)
    assert environment == chosen


def test_to_choose_twice_is_to_choose_once() -> None:
    """As a command does that starts others, which inherit its environment."""
    once = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    talk_by_udp(once)
    twice = dict(once)
    talk_by_udp(twice)
    assert twice == once
    assert set(once) == {"ROS_AUTOMATIC_DISCOVERY_RANGE", "FASTRTPS_DEFAULT_PROFILES_FILE"}


def test_participants_are_announced_for_as_long_as_others_take_to_start() -> None:
    """On this machine and beyond it, ten times a second for 5 s; the files are there, and say so."""
    for environment in ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}, {}):
        talk_by_udp(environment)
        profile = ET.parse(environment["FASTRTPS_DEFAULT_PROFILES_FILE"])  # noqa: S314 - our own file
        (initial,) = profile.iterfind(".//{*}initialAnnouncements")
        assert initial.findtext("{*}count") == "50"
        assert initial.findtext("{*}period/{*}nanosec") == "100000000"
