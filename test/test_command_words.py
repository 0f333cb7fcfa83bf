"""One vocabulary on the command line, whichever package brings a subcommand."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from command_tree import kind, long_name, options, subcommands

from jammkle_common.command.main import main
from jammkle_common.parameters import RENAMED, TYPED_UNITS

if TYPE_CHECKING:
    from collections.abc import Iterator

UNITS = ("-kpa", "-mm", "-mm-s", "-ml", "-s", "-hz", "-kg", "-deg", "-l-min", "-dm3-s-bar")
"""What the name of an option that takes a number with a unit ends in."""
NO_UNIT = {"--friction", "--speed"}
"""Numbers without a unit; --speed is simulated time per real time."""
PLACES = {"DIR", "FILE", "BAG"}


def every_option() -> Iterator[tuple[str, Any]]:
    """Every option of every subcommand, with its words."""
    for words, command in subcommands().items():
        for option in options(command):
            yield words, option


def test_the_walk_finds_what_packages_bring() -> None:
    """Subcommands of all four packages are there, at every depth."""
    assert {"jam", "up", "rig tensile", "gap diagnose", "hardware check"} <= set(subcommands())


def test_numbers_are_typed_in_one_unit_each() -> None:
    """Vacuum in kPa, lengths in mm, speeds in mm/s; the unit ends the name."""
    for words, option in every_option():
        name = long_name(option)
        if kind(option) is float and name not in NO_UNIT:
            assert name.endswith(UNITS), f"jammkle {words} {name}"
        if "vacuum" in name and kind(option) in {float, int}:
            assert name.endswith("-kpa"), f"jammkle {words} {name}"


def test_an_option_takes_the_same_in_every_subcommand() -> None:
    """Kind of value and short form are one for each name; how often it may be given may differ."""
    kinds: dict[str, dict[Any, list[str]]] = defaultdict(lambda: defaultdict(list))
    for words, option in every_option():
        place = option.metavar if kind(option) is Path else ""
        taken = (kind(option), place, tuple(sorted(option.opts)))
        kinds[long_name(option)][taken].append(words)
    assert not {name: dict(found) for name, found in kinds.items() if len(found) > 1}


def test_paths_say_what_they_lead_to() -> None:
    """A path is a folder, a file or a bag, and the help says which; results go to the folder -o."""
    for words, option in every_option():
        if kind(option) is Path:
            assert option.metavar in PLACES, f"jammkle {words} {long_name(option)}"
        assert "-o" not in option.opts or option.metavar == "DIR", words


def old_spellings() -> list[tuple[str, str, str]]:
    """Subcommand, old and new spelling of everything that was typed in SI or has another name now."""
    ends = [(unit.typed_end.replace("_", "-"), unit.si_end.replace("_", "-")) for unit in TYPED_UNITS]
    found = [
        (words, name.removesuffix(typed_end) + si_end, name)
        for words, name in ((words, long_name(option)) for words, option in every_option())
        for typed_end, si_end in ends
        if name.endswith(typed_end)
    ]
    return found + [(words, old, new) for words, names in RENAMED.items() for old, new in names.items()]


@pytest.mark.parametrize("form", ["{0} 1", "{0}=1"])
def test_old_spellings_name_the_new_one(form: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 2 and one line on stderr, for every one of them."""
    assert len(old_spellings()) > 10
    for words, old, new in old_spellings():
        assert main([*words.split(), *form.format(old).split()]) == 2, (words, old)
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith(f"jammkle: {old} is {new} now"), (words, line)
