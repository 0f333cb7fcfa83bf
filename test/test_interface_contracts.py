"""Every message and service is a contract: unit, meaning of zero, and enums that start at UNKNOWN."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "jammkle_msgs"
FILES = sorted([*PACKAGE.glob("msg/*.msg"), *PACKAGE.glob("srv/*.srv")])
FIELD = re.compile(r"^(?P<type>[\w/]+(\[\d*\])?)\s+(?P<name>[a-z]\w*)\s*$")
CONSTANT = re.compile(r"^(?P<type>\w+)\s+(?P<name>[A-Z][A-Z0-9_]*)\s*=\s*(?P<value>\S+)\s*$")
NOTHING = ("zero", "empty", "not stamped")


@dataclass(frozen=True)
class Line:
    """A field or constant of an interface file, with the comment above it."""

    kind: str
    name: str
    value: str
    comment: str


def lines_of(text: str) -> list[Line]:
    """Fields and constants of an interface file, each with the comment block directly above it."""
    found = []
    comment: list[str] = []
    for line in text.splitlines():
        if line.startswith("#"):
            comment.append(line.lstrip("# "))
            continue
        field = FIELD.match(line)
        constant = CONSTANT.match(line)
        if field:
            found.append(Line("field", field["name"], "", "\n".join(comment)))
        elif constant:
            found.append(Line("constant", constant["name"], constant["value"], "\n".join(comment)))
        elif line.strip() not in {"", "---"}:
            pytest.fail(f"cannot read line: {line}")
        comment = []
    return found


def faults(text: str) -> list[str]:
    """What an interface file's text leaves out."""
    found = []
    lines = lines_of(text)
    for line in lines:
        if line.kind == "constant":
            if not line.comment:
                found.append(f"{line.name}: no meaning")
            continue
        if "Unit:" not in line.comment:
            found.append(f"{line.name}: no unit")
        elif not any(word in line.comment.split("Unit:")[1].lower() for word in NOTHING):
            found.append(f"{line.name}: no meaning of zero")
    constants = [line for line in lines if line.kind == "constant"]
    if constants and (constants[0].name, constants[0].value) != ("UNKNOWN", "0"):
        found.append(f"{constants[0].name}={constants[0].value}: the first value must be UNKNOWN=0")
    if [line.value for line in constants] != [str(index) for index in range(len(constants))]:
        found.append("enum values must count up from 0")
    return found


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_every_field_states_unit_and_zero(path: Path) -> None:
    """Each field names its unit and what zero (or empty) means; each enum starts at UNKNOWN = 0."""
    assert faults(path.read_text()) == []


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_every_interface_says_what_it_is(path: Path) -> None:
    """The file opens with a comment for the reader, apart from the first field's own."""
    head = path.read_text().split("\n\n")[0]
    assert head.startswith("# ")
    assert "Unit:" not in head


def test_every_interface_is_built() -> None:
    """CMakeLists.txt lists each file, so that none is forgotten."""
    cmake = (PACKAGE / "CMakeLists.txt").read_text()
    listed = set(re.findall(r'"((?:msg|srv|action)/\w+\.\w+)"', cmake))
    assert listed == {str(path.relative_to(PACKAGE)) for path in FILES}


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("float64 force\n", "no unit"),
        ("# Pull.\n# Unit: N.\nfloat64 force\n", "no meaning of zero"),
        ("# Running.\nuint8 RUNNING=0\n", "UNKNOWN=0"),
        ("uint8 UNKNOWN=0\n", "no meaning"),
    ],
)
def test_a_broken_contract_is_found(text: str, fault: str) -> None:
    """The check itself can fail."""
    assert any(fault in line for line in faults(text))
