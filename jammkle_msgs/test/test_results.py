"""Where results go."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_graph.command import results

if TYPE_CHECKING:
    import pytest


def test_a_pipe_cuts_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    """Where no terminal says how wide it is, a long line stays in one piece."""
    results.console().print("word " * 60)
    assert len(capsys.readouterr().out.splitlines()) == 1
