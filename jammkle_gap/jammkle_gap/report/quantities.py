"""Numbers for people: three digits, a fitting prefix, and the interval in the same unit."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

_DASH = "-"
_PREFIXES = {3: "k", 0: "", -3: "m", -6: "µ", -9: "n"}
_PREFIXED = ("Pa", "m", "s", "N", "rad", "V", "A")
"""Units that take a prefix; others are shown as they are."""
_ALWAYS = {"Pa": 3}
"""Powers of ten of units that are shown with one prefix throughout, so that no two numbers of a page differ by it."""
_DIGITS = 3
_LARGEST_PLAIN = 1e5
_SMALLEST_PLAIN = 1e-3
_MANY_UNITS = 10.0
_SURE, _NEVER = 0.99, 0.01


def scale(value: float, unit: str) -> tuple[float, str]:
    """Return what to divide by, and the unit with its prefix, for a number of this size and those beside it."""
    if unit in _ALWAYS:
        return 10.0 ** _ALWAYS[unit], f"{_PREFIXES[_ALWAYS[unit]]}{unit}"
    if unit not in _PREFIXED or not math.isfinite(value) or value == 0.0:
        return 1.0, "" if unit == "1" else unit
    power = 3 * math.floor(math.log10(abs(value)) / 3)
    # Millimetres and milliseconds are read more easily than 12.3e-6.
    power = min(max(power, min(_PREFIXES)), max(_PREFIXES))
    return 10.0**power, f"{_PREFIXES[power]}{unit}"


def digits(value: float) -> str:
    """Return a number with three digits."""
    if not math.isfinite(value):
        return _DASH
    if value == 0.0:
        return "0"
    if not _SMALLEST_PLAIN <= abs(value) < _LARGEST_PLAIN:
        return f"{value:.2e}"
    places = max(_DIGITS - 1 - math.floor(math.log10(abs(value))), 0)
    return f"{value:.{places}f}"


def times(gap: float) -> str:
    """Return a gap in healthy scatter: what lies far below 1 is nothing, and needs no digits."""
    if not math.isfinite(gap):
        return _DASH
    return f"{gap:.0f}" if gap >= _MANY_UNITS**2 else f"{gap:.1f}" if gap >= _MANY_UNITS else f"{gap:.2f}"


def quantity(value: float, unit: str) -> str:
    """Return a number with its unit, such as `12.3 kPa`."""
    return quantities([value], unit)[0]


def quantities(values: Sequence[float], unit: str) -> list[str]:
    """Return numbers that are read side by side, all in the unit that fits the largest."""
    factor, name = scale(max((abs(each) for each in values if math.isfinite(each)), default=0.0), unit)
    return [f"{digits(each / factor)} {name}".rstrip() if math.isfinite(each) else _DASH for each in values]


def known(value: float, interval: tuple[float, float], unit: str) -> str:
    """Return a number with its unit and as many digits as its interval has."""
    if not all(map(math.isfinite, (value, *interval))):
        return quantity(value, unit)
    factor, name = scale(value or max(interval, key=abs), unit)
    return f"{_to(value / factor, (interval[1] - interval[0]) / factor)} {name}".rstrip()


def span(value: float, interval: tuple[float, float], unit: str) -> str:
    """Return an interval in the unit that its value is shown in, such as `12.1 to 12.5 kPa`."""
    if not all(map(math.isfinite, interval)):
        return _DASH
    factor, name = scale(value or max(interval, key=abs), unit)
    low, high = (_to(end / factor, (interval[1] - interval[0]) / factor) for end in interval)
    return f"{low} to {high} {name}".rstrip()


def _to(value: float, width: float) -> str:
    """Return a number with as many digits as the width of its interval deserves, three at least."""
    if width <= 0.0 or value == 0.0:
        return digits(value)
    places = max(_DIGITS - 1 - math.floor(math.log10(abs(value))), 1 - math.floor(math.log10(width)), 0)
    return digits(value) if places > 2 * _DIGITS else f"{value:.{places}f}"


def probability(value: float) -> str:
    """Return a probability with two digits; never 0 or 1, which nothing is."""
    if not math.isfinite(value):
        return _DASH
    if value > _SURE:
        return f"above {_SURE}"
    return f"below {_NEVER}" if value < _NEVER else f"{value:.2f}"


def percent(share: float) -> str:
    """Return a share as a whole per cent; what was closed beyond scatter counts as all."""
    return _DASH if not math.isfinite(share) else f"{_whole(share)} %"


def percents(interval: tuple[float, float]) -> str:
    """Return an interval of shares, such as `91 to 97 %`."""
    if not all(map(math.isfinite, interval)):
        return _DASH
    low, high = map(_whole, interval)
    return f"{low} %" if low == high else f"{low} to {high} %"


def _whole(share: float) -> int:
    return round(min(100.0 * share, 100.0))
