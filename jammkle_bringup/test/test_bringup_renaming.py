"""A robot's own names of joints: read, turned round, and refused where they cannot be."""

from __future__ import annotations

import pytest
from sensor_msgs.msg import JointState

from jammkle_bringup.core.renaming import JointRenaming, RenamingError

LEG = JointRenaming.parsed("lf_pitch=ankle_pitch, lf_roll = -ankle_roll,lf_knee=knee")
SENT = JointState(name=["lf_roll", "lf_hip", "lf_pitch"], position=[0.1, 9.0, 0.2], velocity=[1.0, 9.0, 2.0])


def test_joints_keep_their_order_and_change_their_sign() -> None:
    found = LEG.renamed(SENT)
    assert found is not None
    assert found.name == ("ankle_roll", "ankle_pitch")
    assert found.position == (-0.1, 0.2)
    assert found.velocity == (-1.0, 2.0)
    assert found.effort == ()
    assert LEG.renamed(JointState(name=["rf_knee"], position=[1.0])) is None


def test_the_way_back_gives_what_was_sent() -> None:
    there = LEG.renamed(SENT)
    assert there is not None
    back = LEG.reverse.renamed(there)
    assert back is not None
    assert (back.name, back.position, back.velocity) == (("lf_roll", "lf_pitch"), (0.1, 0.2), (1.0, 2.0))


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
    with pytest.raises(RenamingError, match=words):
        JointRenaming.parsed(text)
