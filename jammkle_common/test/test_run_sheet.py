"""The run sheet of a bag: recorded, or written by hand."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from jammkle_common.bags.run_sheet import FILE_NAME, TEMPLATE, RunSheet, read_sheet, read_text
from jammkle_common.command.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

RECORDED = "rig: drop\ntimestep_s: 0.001\noptions: {foot: jammed, drop_height_m: 0.05}\n"


def test_a_bag_holds_its_run_sheet(tmp_path: Path) -> None:
    """Rig and options, whatever else was simulated; without any text nothing is known."""
    assert read_sheet(tmp_path, RECORDED) == RunSheet("drop", {"foot": "jammed", "drop_height_m": 0.05})
    assert read_sheet(tmp_path, None) == RunSheet()


def test_a_file_in_the_bag_goes_before_what_was_recorded(tmp_path: Path) -> None:
    """Line by line."""
    (tmp_path / FILE_NAME).write_text("options: {drop_height_m: 8e-2, membrane: yes}", encoding="utf-8")
    expected = {"foot": "jammed", "drop_height_m": 0.08, "membrane": "yes"}
    assert read_sheet(tmp_path, RECORDED) == RunSheet("drop", expected)


def test_a_file_beside_bags_is_for_those_that_know_nothing(tmp_path: Path) -> None:
    """A bag that has a run sheet of its own keeps it."""
    (tmp_path / FILE_NAME).write_text("rig: tensile", encoding="utf-8")
    assert read_sheet(tmp_path / "foreign", None).rig == "tensile"
    assert read_sheet(tmp_path / "own", RECORDED).rig == "drop"


@pytest.mark.parametrize(
    ("text", "said"), [("a: b: c", "is not YAML"), ("options: fast", "options that are no table but 'fast'")]
)
def test_what_cannot_be_read_is_one_line(text: str, said: str) -> None:
    """With the source that it is from."""
    with pytest.raises(InputError, match=said) as error:
        read_text(text, "sheet")
    assert str(error.value).startswith("sheet ")
    assert "\n" not in str(error.value)


def test_the_template_is_a_run_sheet() -> None:
    """As printed it can be read."""
    assert read_text(TEMPLATE, "template").options == {"drop_height_m": 0.05, "foot": "jammed"}
