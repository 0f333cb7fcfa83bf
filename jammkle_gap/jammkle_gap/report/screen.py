"""What `jammkle gap diagnose` says in the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.markup import escape
from rich.padding import Padding
from rich.table import Table

from jammkle_gap.november.verdict import Verdict
from jammkle_gap.report import tables, words
from jammkle_gap.report.quantities import noise_units, percent, percents
from jammkle_graph.command import results

if TYPE_CHECKING:
    from pathlib import Path

    from jammkle_gap.november.diagnosis import Diagnosis
    from jammkle_gap.report.page import Setting

_SIGNALS_SHOWN = 6
_STYLES = {
    Verdict.NO_GAP: "bold green",
    Verdict.EFFECTS: "bold blue",
    Verdict.AMBIGUOUS: "bold yellow",
    Verdict.UNKNOWN: "bold red",
}
_WIDTH = 80
"""Text is broken at this, columns; tables are made to fit it."""


def show(diagnosis: Diagnosis, setting: Setting, page: Path) -> None:
    """Print the verdict, what to check, two short tables, what they mean, and where the rest is."""
    console = results.console()

    def say(text: str, indent: int = 0) -> None:
        width = min(_WIDTH, console.width) - indent
        console.print(Padding(escape(text), (0, 0, 0, indent)), width=width + indent)

    if not diagnosis.finished:
        say("STOPPED EARLY: not every effect was fitted, and a better one may be missing.")
    style = _STYLES[diagnosis.verdict]
    console.print(f"[{style}]{diagnosis.verdict.value.replace('_', ' ')}[/{style}]")
    say(words.headline(diagnosis))
    for check in words.checks(diagnosis):
        say(f"- {check}", 2)
    if diagnosis.effects:
        console.print(_effect_table(diagnosis))
    console.print(_gap_table(diagnosis))
    for sentence in words.explanation(diagnosis):
        say(sentence)
    for note in words.notes(diagnosis):
        say(f"note: {note}")
    if not diagnosis.finished:
        say("STOPPED EARLY: run it again to its end before anything is taken apart.")
    spent = diagnosis.spent
    say(f"{spent.runs} simulator runs, {spent.simulated_s:.0f} simulated seconds, {spent.wall_s:.0f} s")
    console.print(words.corrected_note(diagnosis, setting.corrected), markup=False, soft_wrap=True)
    console.print(f"page: {page}", markup=False, soft_wrap=True)


def _effect_table(diagnosis: Diagnosis) -> Table:
    table = Table(title=words.effects_title(diagnosis), title_justify="left", min_width=_WIDTH // 2)
    table.add_column("effect: parameter", overflow="fold", max_width=40)
    table.add_column("value", justify="right")
    table.add_column("95 % interval", justify="right", max_width=24)
    for line in tables.parameter_lines(diagnosis.effects):
        bound = " (at bound)" if line["remark"] else ""
        name = f"{words.label(line['effect'])}\n  [dim]{escape(line['parameter'])}[/dim]"
        table.add_row(name, escape(line["value"]), escape(line["interval"]) + bound)
    return table


def _gap_table(diagnosis: Diagnosis) -> Table:
    table = Table(title="Gap, in units of the noise (held out)", title_justify="left")
    table.add_column("signal", max_width=28, overflow="fold")
    for heading in ("nominal", "with effect", "closed", "95 % interval"):
        table.add_column(heading, justify="right")
    lines = tables.signal_lines(diagnosis)
    for line in lines[:_SIGNALS_SHOWN]:
        table.add_row(escape(line["signal"]), *(line[key] for key in ("nominal", "with_effect", "closed", "interval")))
    if len(lines) > _SIGNALS_SHOWN:
        table.add_row(f"({len(lines) - _SIGNALS_SHOWN} more on the page)", "", "", "", "")
    overall = diagnosis.gap
    table.add_section()
    table.add_row(
        "all signals",
        noise_units(overall.nominal),
        noise_units(overall.with_effect),
        percent(overall.closed),
        percents(overall.interval),
    )
    return table
