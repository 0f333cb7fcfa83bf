"""What may be asked of the driver: names and vacuums are checked here, with one line that says what is wrong."""

from __future__ import annotations

import math
import reprlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


_LONGEST_SHOWN = 60
"""Characters of a name that an answer repeats."""


class RequestError(ValueError):
    """A request that cannot be taken. The message names the value, the limit and the way out, in one line."""


@dataclass(frozen=True)
class VacuumLimits:
    """Vacuum that may be asked for.

    Attributes:
        minimum_pa: Least vacuum to jam with, Pa.
        maximum_pa: Most vacuum to jam with, Pa.
        default_pa: Vacuum of a request that names none, Pa.

    """

    minimum_pa: float
    maximum_pa: float
    default_pa: float


@dataclass(frozen=True)
class Wish:
    """What one channel shall do.

    Attributes:
        channel: Name of the channel.
        vacuum_pa: Vacuum to hold, Pa, gauge, positive; 0 = unjam.

    """

    channel: str
    vacuum_pa: float


def checked_channels(asked: Sequence[str], known: Sequence[str]) -> tuple[str, ...]:
    """Return the channels asked for, each once, in the driver's order; all of them if none is named.

    Raises:
        RequestError: a name is unknown.

    """
    for name in asked:
        if name not in known:
            msg = f"unknown channel {_shown(name)}; known are: {', '.join(known)}"
            raise RequestError(msg)
    return tuple(name for name in known if name in asked) if asked else tuple(known)


def checked_vacuum(vacuum_pa: float, limits: VacuumLimits) -> float:
    """Return the vacuum to jam with, Pa; 0 stands for the default.

    Raises:
        RequestError: not a number, or out of range.

    """
    if vacuum_pa == 0.0:
        return limits.default_pa
    if not (math.isfinite(vacuum_pa) and limits.minimum_pa <= vacuum_pa <= limits.maximum_pa):
        msg = (
            f"vacuum_pa is {vacuum_pa:g}; it must be {limits.minimum_pa:g} to {limits.maximum_pa:g} Pa "
            f"below ambient, or 0 for the default of {limits.default_pa:g} Pa"
        )
        raise RequestError(msg)
    return vacuum_pa


def checked_wishes(wishes: Sequence[Wish], known: Sequence[str], limits: VacuumLimits) -> tuple[Wish, ...]:
    """Return the wishes unchanged if every one of them can be taken.

    Raises:
        RequestError: a channel is unknown or named twice, a vacuum is neither 0 nor in range, or two vacuums to jam
            with differ.

    """
    named: set[str] = set()
    for wish in wishes:
        checked_channels([wish.channel], known)
        if wish.channel in named:
            msg = f"channel '{wish.channel}' is named twice; name each channel once"
            raise RequestError(msg)
        named.add(wish.channel)
        in_range = math.isfinite(wish.vacuum_pa) and limits.minimum_pa <= wish.vacuum_pa <= limits.maximum_pa
        if wish.vacuum_pa != 0.0 and not in_range:
            msg = (
                f"vacuum_pa of '{wish.channel}' is {wish.vacuum_pa:g}; "
                f"it must be 0 to unjam, or {limits.minimum_pa:g} to {limits.maximum_pa:g} Pa below ambient"
            )
            raise RequestError(msg)
    jams = [wish for wish in wishes if wish.vacuum_pa > 0.0]
    for jam in jams:
        if jam.vacuum_pa != jams[0].vacuum_pa:
            msg = (
                f"vacuum_pa is {jams[0].vacuum_pa:g} for {jams[0].channel}, but {jam.vacuum_pa:g} for {jam.channel}: "
                "channels share one manifold, so name one vacuum for all that shall jam"
            )
            raise RequestError(msg)
    return tuple(wishes)


def check_shared_vacuum(wishes: Sequence[Wish], held_pa: Mapping[str, float]) -> None:
    """Check that all channels still share one vacuum once the wishes are taken.

    One pump, one manifold and valves that only connect or vent cannot hold two vacuums at once.

    Args:
        wishes: What would be taken; its vacuums are 0 or one and the same.
        held_pa: Vacuum asked for until now, per channel, Pa; 0 = unjam.

    Raises:
        RequestError: a channel that the wishes leave alone is jammed to another vacuum.

    """
    named = {wish.channel for wish in wishes}
    for vacuum_pa in {wish.vacuum_pa for wish in wishes if wish.vacuum_pa > 0.0}:
        others = {name: pa for name, pa in held_pa.items() if name not in named and pa not in (0.0, vacuum_pa)}
        if others:
            jams = [wish.channel for wish in wishes if wish.vacuum_pa == vacuum_pa]
            msg = (
                f"vacuum_pa is {vacuum_pa:g} for {_listed(jams)}, but {_listed(list(others))} "
                f"{'hold' if len(others) > 1 else 'holds'} {max(others.values()):g} Pa: channels share one manifold, "
                "so jam all of them to one vacuum or unjam those first"
            )
            raise RequestError(msg)


def _shown(name: str) -> str:
    """Return a name in quotes, in one line however long or odd it is."""
    shown = reprlib.Repr()
    shown.maxstring = _LONGEST_SHOWN
    return shown.repr(name)


def _listed(names: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))
