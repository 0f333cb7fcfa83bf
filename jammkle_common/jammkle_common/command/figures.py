"""The style of every figure."""

from __future__ import annotations

from typing import Any

from jammkle_common.names import ACHILLES, PERONEAL_LEFT, PERONEAL_RIGHT

STYLE: dict[Any, Any] = {
    "svg.hashsalt": "jammkle",
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "axes.titlesize": 9.5,
    "lines.linewidth": 1.1,
}
"""For matplotlib; the salt makes the same picture the same bytes."""

STATE_COLOURS = {
    "UNKNOWN": "#969696",
    "UNJAMMED": "#e8b478",
    "JAMMING": "#f0a014",
    "JAMMED": "#196eeb",
    "VENTING": "#3cb9af",
    "FAULT": "#d72828",
}
"""Of the states of a channel, in every picture, page and table, by the constants of ChannelJamState."""

EVENT_COLOURS = {
    "IMPACT": "#d72828",
    "SLIP": "#f08c14",
    "LIFTOFF": "#1e78dc",
    "SETTLED": "#32963c",
    "SWING": "#825ac8",
    "UNKNOWN": "#969696",
}
"""Of what the controller felt, by the constants of ContactEvent."""

LINE_COLOURS = {
    PERONEAL_LEFT: "#d66024",
    PERONEAL_RIGHT: "#1e82be",
    ACHILLES: "#3c9646",
    "achilles_left": "#3c9646",
    "achilles_right": "#8cbe3c",
    "manifold": "#787878",
    "x": "#008c8c",
    "y": "#966e3c",
    "z": "#3c3c46",
}
"""Of channels, tendons and axes over time; axes share their plots with events, and no colour."""
