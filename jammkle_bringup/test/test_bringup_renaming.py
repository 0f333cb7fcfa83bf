"""A robot's own names: of joints in messages, and in a whole bag by `jammkle rename`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from sensor_msgs.msg import JointState

from jammkle_bringup.core.renaming import JointRenaming
from jammkle_common.bags.reading import messages, opened
from jammkle_common.command.errors import InputError
from jammkle_common.command.main import main

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from conftest import BagMaker

LEG = JointRenaming.parsed("lf_pitch=ankle_pitch, lf_roll = -ankle_roll,lf_knee=knee")
SENT = JointState(name=["lf_roll", "lf_hip", "lf_pitch"], position=[0.1, 9.0, 0.2], velocity=[1.0, 9.0, 2.0])


def test_joints_keep_their_order_and_change_their_sign() -> None:
    assert LEG.renamed(SENT) == (
        ["ankle_roll", "ankle_pitch"],
        {"position": [-0.1, 0.2], "velocity": [-1.0, 2.0], "effort": []},
    )
    assert LEG.renamed(JointState(name=["rf_knee"], position=[1.0])) is None


def test_the_way_back_gives_what_was_sent() -> None:
    there = LEG.renamed(SENT)
    assert there is not None
    joints, values = there
    back = LEG.reverse.renamed(JointState(name=joints, **values))
    assert back is not None
    assert back[0] == ["lf_roll", "lf_pitch"]
    assert (back[1]["position"], back[1]["velocity"]) == ([0.1, 0.2], [1.0, 2.0])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("lf_pitch", "lf_pitch=ankle_pitch|theirs=ours"),
        ("a=ankle_pich", "'ankle_pich' is no joint of ours.*ankle_pitch"),
        ("a=ankle_pitch, a=ankle_roll", "'a' stands twice"),
        ("a=ankle_pitch, b=-ankle_pitch", "'ankle_pitch' would have two names"),
        ("a b=ankle_pitch", "theirs=ours"),
    ],
)
def test_joints_that_cannot_be_mapped_are_refused(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        JointRenaming.parsed(text)


NAMES = ("--joint", "lf_pitch=ankle_pitch", "--joint", "lf_roll=-ankle_roll")


@pytest.fixture
def foreign(bag_maker: Callable[[str], BagMaker]) -> Path:
    """Record a robot's joints, a pressure, and a topic that nobody here knows."""
    bag = bag_maker("foreign")
    for step in range(20):
        time_s = 100.0 + 0.1 * step
        angles = np.array([9.0, 0.01 * step, 0.02 * step])
        none = np.array([])
        joints = bag.make(
            "sensor_msgs/msg/JointState", bag.header(time_s), ["knee", "lf_roll", "lf_pitch"], angles, none, none
        )
        bag.write("/joint_states", time_s, joints)
        bag.write("/valves/two/pressure", time_s, bag.pressure(time_s, 101325.0 - step))
        bag.write("/battery", time_s, bag.make("std_msgs/msg/Float32", 24.0))
    return bag.close()


def test_joints_and_topics_get_the_names_that_the_verbs_know(foreign: Path, tmp_path: Path) -> None:
    new = tmp_path / "new"
    topic = ("--topic", "/valves/two/pressure=/achilles/pressure")
    assert main(["rename", str(foreign), "-o", str(new), *NAMES, *topic]) == 0
    with opened(new) as reader:
        assert {each.topic for each in reader.connections} == {"/joint_states", "/achilles/pressure", "/battery"}
        joints = [each for each in reader.connections if each.topic == "/joint_states"]
        found = [reader.deserialize(data, each.msgtype) for each, _, data in messages(reader, new, joints)]
    assert len(found) == 20
    assert found[5].name == ["ankle_roll", "ankle_pitch"]
    assert found[5].position.tolist() == pytest.approx([-0.05, 0.1])
    assert found[5].header.stamp.nanosec == 500_000_000


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "nothing to rename"),
        (("--joint", "lf_pitch=ankle_pich"), "no joint of ours"),
        (("--joint", "rf_pitch=ankle_pitch"), "has no joint rf_pitch"),
        (("--topic", "/valves/one=/achilles/pressure"), "has no topic /valves/one: it has /battery"),
        (("--topic", "/battery=/joint_states"), "has a topic /joint_states already"),
        (("--topic", "battery=/power"), "must be /theirs=/ours"),
    ],
)
def test_what_cannot_be_renamed_is_refused(
    foreign: Path, tmp_path: Path, arguments: tuple[str, ...], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    new = tmp_path / "new"
    assert main(["rename", str(foreign), "-o", str(new), *arguments]) == 2
    assert words in capsys.readouterr().err
    assert not new.exists()


def test_everything_else_stays(foreign: Path, tmp_path: Path) -> None:
    new = tmp_path / "new"
    assert main(["rename", str(foreign), "-o", str(new), *NAMES]) == 0
    found = []
    for path in (foreign, new):
        with opened(path) as reader:
            found.append(
                [(each.topic, time_ns, data) for each, time_ns, data in messages(reader, path)]
                + [(each.topic, each.msgtype, each.digest) for each in reader.connections]
            )
    old, renamed = ([row for row in rows if row[0] != "/joint_states"] for rows in found)
    assert old == renamed
    assert len(found[0]) == len(found[1])
