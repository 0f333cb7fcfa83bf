"""What a command line says of bags, of all or of one by its name: `--rig BAG=tensile`, `--set BAG:key=value`.

Pure: texts in, tables out. A bag is named by the last part of its path, or by as much of the path as it takes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import yaml

from jammkle_common.parameters import in_si, option_name, parameter_of, renamed
from jammkle_sim.rigs.catalogue import RIGS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


class BadRequestError(ValueError):
    """A request that cannot be read; the message names it and says what would be right."""


@dataclass(frozen=True)
class BagRequest:
    """What is said of one bag."""

    rig: str | None = None
    """What it was recorded on; None: the bag tells."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """How that was set, whatever the bag says."""
    own: frozenset[str] = frozenset()
    """Options that are said of this bag alone."""


def requests_for(bags: Sequence[str], rigs: Sequence[str], settings: Sequence[str]) -> tuple[BagRequest, ...]:
    """Return what is said of each bag; what names a bag goes before what is for all.

    Args:
        bags: Their paths.
        rigs: `RIG` or `BAG=RIG`.
        settings: `NAME=VALUE` or `BAG:NAME=VALUE`.

    Raises:
        BadRequestError: one of them cannot be read, or names no bag or more than one.

    """
    for_all, of_bag = _rigs(bags, rigs)
    options: dict[str, Any] = {}
    own: list[dict[str, Any]] = [{} for _ in bags]
    for text in settings:
        bag, name, value = _setting(text)
        (options if bag is None else own[_place(bags, bag, f"--set '{text}'")])[name] = value
    return tuple(
        BagRequest(of_bag.get(place, for_all), {**options, **own[place]}, frozenset(own[place]))
        for place in range(len(bags))
    )


def _rigs(bags: Sequence[str], rigs: Sequence[str]) -> tuple[str | None, dict[int, str]]:
    for_all: str | None = None
    of_bag: dict[int, str] = {}
    for text in rigs:
        bag, sign, rig = text.rpartition("=")
        if rig not in RIGS:
            msg = f"--rig '{text}' names the rig '{rig}', which does not exist; known are: {', '.join(RIGS)}"
            raise BadRequestError(msg)
        if sign:
            of_bag[_place(bags, bag, f"--rig '{text}'")] = rig
        elif for_all not in {None, rig}:
            msg = f"--rig is given twice for all bags, as '{for_all}' and '{rig}'; give one of them as BAG={rig}"
            raise BadRequestError(msg)
        else:
            for_all = rig
    return for_all, of_bag


def _setting(text: str) -> tuple[str | None, str, Any]:
    """Return bag, None for all, parameter and value, in SI, of one setting."""
    left, sign, value = text.partition("=")
    bag, colon, name = left.rpartition(":")
    if not name or not sign or not value or (colon and not bag):
        msg = f"--set '{text}' must be NAME=VALUE or BAG:NAME=VALUE, such as vacuum-kpa=50 or run_3:vacuum-kpa=50"
        raise BadRequestError(msg)
    try:
        read = yaml.safe_load(value)
    except yaml.YAMLError as error:
        msg = f"--set '{text}' has a value that cannot be read; write a number or a word, such as vacuum-kpa=50"
        raise BadRequestError(msg) from error
    if isinstance(read, bool):  # YAML takes yes and no for something else than the rigs do
        read = value
    typed = f"--{name.replace('_', '-')}"
    moved = renamed(typed, {option_name(name.replace("-", "_"))})
    if moved is not None:
        msg = f"--set '{text}': {moved.replace('--', '')}"
        raise BadRequestError(msg)
    parameter = parameter_of(name)
    return (bag if colon else None), parameter, in_si(parameter, _number(read))


def _number(value: Any) -> Any:
    """Return a number where a text is one, such as 5e4, which YAML takes for a word."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def _place(bags: Sequence[str], name: str, request: str) -> int:
    """Return which bag is meant by a name: the end of its path."""
    parts = PurePath(name).parts
    found = [place for place, bag in enumerate(bags) if parts and PurePath(bag).parts[-len(parts) :] == parts]
    if len(found) != 1:
        known = ", ".join(str(bag) for bag in bags)
        how = "names no bag" if not found else f"names {len(found)} bags"
        msg = f"{request} {how}; name one of these by the end of its path: {known}"
        raise BadRequestError(msg)
    return found[0]
