"""Processes of ours share no memory with others, so that nobody waits for one that was killed; users may choose so."""

from __future__ import annotations

import os
import subprocess
import sys
from xml.etree import ElementTree as ET

import pytest

from jammkle_common.processes import talk_by_udp
from jammkle_common.testing import own_domain

PARTICIPANT = """
import os, rclpy
from pathlib import Path
from jammkle_common.processes import talk_by_udp
talk_by_udp(os.environ)
rclpy.init()
node = rclpy.create_node("anybody")
print("/dev/shm/fastrtps" in Path("/proc/self/maps").read_text())
"""


def shares_memory(**chosen: str) -> bool:
    """Whether a participant that is started with what a user has chosen maps queues of Fast DDS."""
    inherited = {name: value for name, value in os.environ.items() if not name.startswith(("FAST", "ROS_", "RMW_"))}
    with own_domain() as number:
        answer = subprocess.run(
            [sys.executable, "-c", PARTICIPANT],
            env={**inherited, "ROS_DOMAIN_ID": str(number), **chosen},
            capture_output=True,
            text=True,
            check=True,
        )
    return answer.stdout.strip() == "True"


@pytest.mark.parametrize("reach", ["LOCALHOST", "SUBNET"])
def test_memory_is_shared_where_a_user_asks_for_it_alone(reach: str) -> None:
    """With discovery on this machine alone, and beyond it."""
    assert not shares_memory(ROS_AUTOMATIC_DISCOVERY_RANGE=reach)
    assert shares_memory(ROS_AUTOMATIC_DISCOVERY_RANGE=reach, FASTDDS_BUILTIN_TRANSPORTS="DEFAULT")


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
