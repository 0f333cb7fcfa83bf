"""The run sheet of a bag: recorded, or written by hand."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from jammkle_common.bags.run_sheet import FILE_NAME, TEMPLATE, RunSheet, read_options, read_sheet, read_text
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
    ("text", "said"),
    [("a: b: c", "is not YAML"), ("options: fast", "has options that are a text, 'fast', and no mapping")],
)
def test_what_cannot_be_read_is_one_line(text: str, said: str) -> None:
    """With the source that it is from."""
    with pytest.raises(InputError, match=said) as error:
        read_text(text, "sheet")
    assert str(error.value).startswith("sheet ")
    assert "\n" not in str(error.value)


def test_a_file_of_options_is_a_run_sheet_or_a_table(tmp_path: Path) -> None:
    """Numbers and words are read in the same way; nothing is no options, and a robot is known too."""
    assert read_options(RECORDED, "file") == read_sheet(tmp_path, RECORDED)
    assert read_options("robot: leg\noptions: {seed: 3}", "file") == RunSheet("", {"seed": 3}, "leg")
    assert read_options("leg_mm: 2e2\nmembrane: no\n", "file") == {"leg_mm": 200.0, "membrane": "no"}
    assert read_options("# leg_mm: 200\n", "file") == {}
    with pytest.raises(InputError, match=r"^file holds a text, 'fast', and no mapping; write NAME: VALUE, one a line"):
        read_options("fast", "file")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("seed: 1\nfoot: jammed\nseed: 1", "file: 'seed' stands in line 1 and again in line 3; leave one of them"),
        ("options:\n  a: 1\n  a: 2", "file: 'a' stands in line 2 and again in line 3; leave one of them"),
        ("seed: " + "9" * 5000, "; a number must have at most 1000 digits"),
        ("!!timestamp 2020-99-99", "file is not YAML: month must be in 1..12"),
        ("[0x" + "f" * 9000 + "]", "file holds a list, list with a number of too many digits, and no mapping"),
        ("[" * 5000, "file is not YAML: "),
    ],
)
def test_what_yaml_would_take_or_trip_over_is_one_line(text: str, said: str) -> None:
    """Names that stand twice, numbers without end, dates that no calendar has."""
    with pytest.raises(InputError) as error:
        read_options(text, "file")
    assert said in str(error.value)
    assert len(str(error.value)) < 200


def test_only_who_types_a_file_is_told_of_quotes() -> None:
    """A number in quotes stays a text in a file of options; a run sheet beside a bag is read as before."""
    text = "rig: drop\noptions: {a: '2', b: 2e1, c: 2020-99-99}"
    sheet = read_options(text, "file")
    assert isinstance(sheet, RunSheet)
    assert sheet.options == {"a": "2", "b": 20.0, "c": "2020-99-99"}
    assert read_text(text, "sheet").options == {"a": 2.0, "b": 20.0, "c": "2020-99-99"}


def test_the_template_is_a_run_sheet() -> None:
    """As printed it can be read."""
    assert read_text(TEMPLATE, "template").options == {"drop_height_m": 0.05, "foot": "jammed"}
