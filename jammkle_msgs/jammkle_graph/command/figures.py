"""The style of every figure."""

from __future__ import annotations

from typing import Any

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
