"""What the page says, as HTML. Texts from the graph are escaped: anybody may publish there."""

from __future__ import annotations

import html
import math
from typing import TYPE_CHECKING

from jammkle_common.names import TENDONS
from jammkle_view.core.figure import EVENT_TINTS, FULL_TENSION_N, STATE_TINTS, css
from jammkle_view.core.samples import ChannelState

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from jammkle_view.core.ankle import AnkleState
    from jammkle_view.core.samples import Channel, Event

_PA_PER_KPA = 1000.0
_PER_MILLI = 1000.0
_BOX = "padding: 2px 12px; font-size: 12px; line-height: 1.5"


def channel_html(known: Channel | None, channel: str = "") -> str:
    """Return state and vacuum of a channel, with its name where one is given."""
    state = ChannelState.UNKNOWN if known is None else known.state
    vacuum, reason = "", ""
    if known is not None:
        measured = "-" if math.isnan(known.measured_vacuum_pa) else f"{known.measured_vacuum_pa / _PA_PER_KPA:.1f}"
        commanded = math.isfinite(known.commanded_vacuum_pa)
        vacuum = f"{measured}{f' of {known.commanded_vacuum_pa / _PA_PER_KPA:.0f}' if commanded else ''} kPa"
        reason = html.escape(known.reason)
    pill = (
        f'<span style="background: {css(STATE_TINTS[state])}; color: white; border-radius: 9px; padding: 1px 8px; '
        f'font-weight: 600; font-size: 11px">{state.name}</span>'
    )
    name = f"<b>{html.escape(channel.replace('_', ' '))}</b>"
    return (
        f'<div style="{_BOX}; display: flex" title="{reason}"><div style="width: 105px">{name}</div>'
        f'<div style="flex: 1">{pill}</div><div>{vacuum}</div></div>'
    )


def status_html(parts: Iterable[tuple[str, str]]) -> str:
    """Return figures in a row, each with its name above it."""
    cells = "".join(
        f'<div style="flex: 1"><div style="opacity: 0.6; font-size: 10.5px">{html.escape(name)}</div>'
        f'<div style="font-size: 15px; font-weight: 600">{html.escape(value)}</div></div>'
        for name, value in parts
    )
    return f'<div style="{_BOX}; display: flex; gap: 8px">{cells}</div>'


def number(value: float, form: str, unit: str = "") -> str:
    """Return a number as text; a dash where there is none."""
    return "-" if math.isnan(value) else f"{value:{form}}{unit}"


def events_html(events: Sequence[Event], most: int = 6) -> str:
    """Return the latest events, the newest first."""
    if not events:
        return f'<div style="{_BOX}; opacity: 0.6">nothing felt yet</div>'
    rows = "".join(
        f'<tr><td style="padding-right: 8px">{event.time_s:.3f} s</td>'
        f'<td style="color: {css(EVENT_TINTS[event.kind])}; font-weight: 600; padding-right: 8px">'
        f"{event.kind.name}</td>"
        f"<td>{event.magnitude:.3g} {html.escape(event.unit)}</td>"
        f'<td style="padding-left: 8px; opacity: 0.7">felt after {1e3 * event.detection_delay_s:.1f} ms</td></tr>'
        for event in sorted(events, key=lambda each: -each.time_s)[:most]
    )
    return f'<div style="{_BOX}"><table style="border-collapse: collapse; font-size: 12px">{rows}</table></div>'


def landing_html(ankle: AnkleState) -> str:
    """Return what was chosen for the latest landing and what was reached, and how far each tendon still stretches."""
    rows = [
        (
            name.replace("_", " "),
            number(_PER_MILLI * ankle.extensions_m.get(name, math.nan), ".1f", " mm"),
            number(_PER_MILLI * ankle.left_m(name), ".1f", " mm"),
        )
        for name in TENDONS
    ]
    landing = ankle.landing
    said = "no touch-down yet"
    if landing is not None:
        chosen, reached = (pa / _PA_PER_KPA for pa in (landing.chosen_vacuum_pa, landing.reached_vacuum_pa))
        said = f"<b>chosen {chosen:.0f} kPa, reached {reached:.0f} kPa</b> at {landing.time_s:.2f} s: "
        said += html.escape(landing.why)
    return f'<div style="{_BOX}">{said}</div>' + table_html(("tendon", "stretched by", "left"), rows)


def legend_html() -> str:
    """Return what the colours of the tendons mean."""
    pills = " ".join(
        f'<span style="white-space: nowrap"><span style="display: inline-block; width: 10px; height: 10px; '
        f'border-radius: 5px; background: {css(tint)}"></span> {state.name.lower()}</span>'
        for state, tint in STATE_TINTS.items()
    )
    return (
        f'<div style="{_BOX}; font-size: 11px">{pills}<br>pale: slack; full colour: pulls {FULL_TENSION_N:g} N '
        "or more; dark: broken</div>"
    )


def answer_html(text: str, *, good: bool) -> str:
    """Return what a node has answered to a request."""
    tint = "inherit" if good else "rgb(215, 40, 40)"
    return f'<div style="{_BOX}; color: {tint}; min-height: 18px">{html.escape(text)}</div>'


def table_html(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table; the first column is left-aligned, numbers are not."""

    def line(tag: str, texts: Sequence[str]) -> str:
        cells = (
            f'<{tag} style="text-align: {"right" if place else "left"}; padding: 0 6px">{html.escape(text)}</{tag}>'
            for place, text in enumerate(texts)
        )
        return f"<tr>{''.join(cells)}</tr>"

    body = line("th", head) + "".join(line("td", row) for row in rows)
    style = "font-size: 11.5px; width: 100%; white-space: nowrap"
    return f'<div style="{_BOX}"><table style="{style}">{body}</table></div>'


_SCALES = {"Pa": (1e-3, "kPa"), "m": (1e3, "mm"), "rad": (math.degrees(1.0), "deg")}


def scaled(value: float, unit: str) -> str:
    """Return an SI value in the unit that people read: kPa, mm, degrees."""
    factor, shown = _SCALES.get(unit, (1.0, unit))
    return f"{factor * value:.3g} {shown}"
