"""What may be asked of the driver: names and vacuums are checked here, with one line that says what is wrong."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


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
            msg = f"unknown channel '{name}'; known are: {', '.join(known)}"
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
        RequestError: a channel is unknown or named twice, or a vacuum is neither 0 nor in range.

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
    return tuple(wishes)
