"""What packages bring along for one another."""

from __future__ import annotations

from importlib.metadata import EntryPoint

import pytest

from jammkle_common import command
from jammkle_common.command import COMMANDS, entries, provided
from jammkle_common.command.errors import InputError


def test_what_nobody_brings_along_is_told_in_one_line() -> None:
    """The line names the package that is missing."""
    with pytest.raises(InputError, match="jammkle_absent, which is not installed"):
        provided("jammkle.nothing", "load", "jammkle_absent")


def test_a_name_is_listed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a workspace lies over another both name the same verb; the names come sorted."""
    group = COMMANDS
    twice = [EntryPoint(name, "json:loads", group) for name in ("up", "jam", "up")]
    monkeypatch.setattr(command, "entry_points", lambda group: [each for each in twice if each.group == group])
    assert list(entries(group)) == ["jam", "up"]
