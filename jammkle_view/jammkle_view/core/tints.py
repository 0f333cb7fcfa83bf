"""Colours: of states, of tendons by state and tension, of lines in plots. RGB, 0 to 255."""

from __future__ import annotations

from jammkle_common.command.results import EVENT_COLOURS, LINE_COLOURS, STATE_COLOURS
from jammkle_view.core.samples import ChannelState, EventKind

Rgb = tuple[int, int, int]


def _rgb(colour: str) -> Rgb:
    """Return what `#rrggbb` means."""
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red, green, blue


STATE_TINTS: dict[ChannelState, Rgb] = {state: _rgb(STATE_COLOURS[state.name]) for state in ChannelState}
"""Hue of a tendon, and of its channel in the panel."""
BROKEN_TINT: Rgb = (40, 40, 40)
GHOST_TINT: Rgb = (165, 90, 215)
"""Of the simulation that lies over a recording."""

EVENT_TINTS: dict[EventKind, Rgb] = {kind: _rgb(EVENT_COLOURS[kind.name]) for kind in EventKind}
LINE_TINTS: dict[str, Rgb] = {name: _rgb(colour) for name, colour in LINE_COLOURS.items()}
"""Of lines in plots: channels, tendons, axes."""

FULL_TENSION_N = 30.0
"""Tension from which on a tendon has its full colour. Chosen for the eye: a landing pulls its Achilles tendons by some
20 N, and a jammed tendon tears far above."""
_PALEST = 0.6
"""Share of the state's colour in a slack tendon; the rest is white."""


def tendon_tint(state: ChannelState, tension_n: float, *, broken: bool) -> Rgb:
    """Return the colour of a tendon: the hue says its state, the depth its tension."""
    if broken:
        return BROKEN_TINT
    share = _PALEST + (1.0 - _PALEST) * min(max(tension_n / FULL_TENSION_N, 0.0), 1.0)
    red, green, blue = (round(255.0 - share * (255.0 - part)) for part in STATE_TINTS[state])
    return red, green, blue


def css(tint: Rgb, opacity: float = 1.0) -> str:
    """Return a colour as style sheets write it."""
    return f"rgba({tint[0]}, {tint[1]}, {tint[2]}, {opacity:g})"
