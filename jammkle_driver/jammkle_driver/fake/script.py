"""A script of faults: one line each, with the time, what fails, where and how much."""

from __future__ import annotations

from dataclasses import dataclass

from jammkle_common.names import CHANNELS
from jammkle_driver.core.hardware import MANIFOLD
from jammkle_driver.fake.faults import FakeFault, LinkFault

HEAL = "heal"
_WORDS = "TIME_S FAULT [PLACE [SIZE]]"
"""Of what befalls the board or its line there is no PLACE."""


class ScriptError(ValueError):
    """A line of a script that cannot be understood. The message names the line, the value and what would be right."""


@dataclass(frozen=True)
class ScriptedFault:
    """One line of a script.

    Attributes:
        time_s: When, s after the start.
        fault: What fails; None heals everything.
        place: Where: a channel or the manifold.
        size: How much; see `FakeFault` and `LinkFault`.

    """

    time_s: float
    fault: FakeFault | LinkFault | None
    place: str
    size: float


def read_script(text: str) -> tuple[ScriptedFault, ...]:
    """Return what a script says, in the order of time; empty lines and what follows a # are left out.

    Raises:
        ScriptError: a line cannot be understood.

    """
    lines = [
        (number, line.split("#")[0].split()) for number, line in enumerate(text.replace(";", "\n").splitlines(), 1)
    ]
    return tuple(sorted((_line(number, words) for number, words in lines if words), key=lambda each: each.time_s))


def _line(number: int, words: list[str]) -> ScriptedFault:
    known: dict[str, FakeFault | LinkFault] = {fault.value: fault for fault in (*FakeFault, *LinkFault)}
    places = (MANIFOLD, *CHANNELS)
    word = words[1] if len(words) > 1 else ""
    if word not in {HEAL, *known}:
        choices = ", ".join((HEAL, *known))
        msg = f"line {number} of the script of faults has '{word}'; it must be {_WORDS} with one of: {choices}"
        raise ScriptError(msg)
    sizes = words[2:3] if isinstance(known.get(word), LinkFault) else words[3:4]
    place = words[2] if len(words) > 2 and sizes != words[2:3] else MANIFOLD  # noqa: PLR2004 - the third word
    if place not in places:
        msg = f"line {number} of the script of faults has '{place}'; the place must be one of: {', '.join(places)}"
        raise ScriptError(msg)
    if place == MANIFOLD and known.get(word) in {FakeFault.BLOCKED, FakeFault.STUCK_OPEN, FakeFault.STUCK_CLOSED}:
        msg = f"line {number} of the script of faults: {word} needs a channel, one of: {', '.join(CHANNELS)}"
        raise ScriptError(msg)
    try:
        time_s, size = float(words[0]), float(sizes[0]) if sizes else 0.0
    except ValueError as error:
        msg = f"line {number} of the script of faults: {error}; it must be {_WORDS}"
        raise ScriptError(msg) from error
    return ScriptedFault(time_s, known.get(word), place, size)
