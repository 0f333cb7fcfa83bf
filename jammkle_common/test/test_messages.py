"""Messages by name: what is not installed is refused in a line, or plain where it comes with ROS."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import pytest

from jammkle_common.command.errors import InputError
from jammkle_common.messages import installed_class, message_class

if TYPE_CHECKING:
    from collections.abc import Callable


@pytest.mark.parametrize("of_type", [installed_class, message_class])
@pytest.mark.parametrize("message_type", ["absent_msgs/msg/Thing", "std_msgs/msg/Absent", "Thing"])
def test_a_type_that_is_not_there_is_named(of_type: Callable[[str], Any], message_type: str) -> None:
    """A package without its Python module, a type that its package has not, and what is no type."""
    with pytest.raises(InputError, match=f"{message_type} is not installed here: build its package and source"):
        of_type(message_type)


def test_without_ros_a_class_is_plain(monkeypatch: pytest.MonkeyPatch) -> None:
    """It has the same fields, and cannot be subscribed to."""
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", None)
    assert message_class("tf2_msgs/msg/TFMessage")().transforms == []
    with pytest.raises(InputError, match="tf2_msgs/msg/TFMessage is not installed"):
        installed_class("tf2_msgs/msg/TFMessage")
