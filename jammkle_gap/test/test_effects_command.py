"""`jammkle gap effects`: the list of what a diagnosis may name."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from jammkle_common.command.main import main
from jammkle_gap.ankle.effects import ankle_library

if TYPE_CHECKING:
    from pathlib import Path

    import pytest


def test_every_effect_is_listed_with_what_is_fitted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """All names are there, in the table and in the JSON, with bounds around their null value."""
    assert main(["gap", "effects", "--json", str(tmp_path / "effects.json")]) == 0
    shown = capsys.readouterr().out
    listed = json.loads((tmp_path / "effects.json").read_text(encoding="utf-8"))["effects"]
    assert [each["name"] for each in listed] == [effect.name for effect in ankle_library()]
    for each in listed:
        assert each["name"] in shown
        for name, parameter in each["parameters"].items():
            assert name in shown
            assert parameter["minimum"] <= parameter["null"] <= parameter["maximum"]


def test_a_library_that_is_not_there_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One line, and the code of bad input."""
    assert main(["gap", "effects", "--library", str(tmp_path / "none.yaml")]) == 2
    assert "none.yaml" in capsys.readouterr().err
