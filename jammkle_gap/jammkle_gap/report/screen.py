"""What `jammkle gap diagnose` says in the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.markup import escape
from rich.padding import Padding
from rich.table import Table

from jammkle_common.command import results
from jammkle_gap.core.result import Verdict
from jammkle_gap.report import words
from jammkle_gap.report.page import bars_of
from jammkle_gap.report.words import parameter_lines, percent, percents, signal_lines, times

if TYPE_CHECKING:
    from pathlib import Path

    from jammkle_gap.core.result import Diagnosis
    from jammkle_gap.report.words import Asked

_SIGNALS_SHOWN = 6
_BARS_SHOWN = 5
_BAR_WIDTH = 24
"""Characters of a probability of 1."""
_STYLES = {
    Verdict.NO_GAP: "bold green",
    Verdict.EFFECTS: "bold blue",
    Verdict.AMBIGUOUS: "bold yellow",
    Verdict.UNKNOWN: "bold red",
}
_WIDTH = 80
"""Text is broken at this, columns; tables are made to fit it."""


def show(diagnosis: Diagnosis, asked: Asked, page: Path) -> None:
    """Print the verdict, what to check, short tables, what they mean, and where the rest is."""
    console = results.console()

    def say(text: str, indent: int = 0) -> None:
        width = min(_WIDTH, console.width) - indent
        console.print(Padding(escape(text), (0, 0, 0, indent)), width=width + indent)

    if not diagnosis.finished:
        say("STOPPED EARLY: not every effect was fitted, and a better one may be missing.")
    style = _STYLES[diagnosis.verdict]
    console.print(f"[{style}]{words.VERDICTS[diagnosis.verdict].upper()}[/{style}]")
    say(words.headline(diagnosis))
    for answer in words.answers(diagnosis):
        say(f"{answer.question.lower()}: {answer.short}. {answer.more}", 2)
    for check in words.checks(diagnosis, asked.sentences):
        say(f"- {check}", 2)
    for asked_for, table in (
        (diagnosis.candidates, _posterior_table),
        (diagnosis.effects, _effect_table),
        (diagnosis.ledger, _ledger_table),
        (diagnosis.signals, _gap_table),
    ):
        if asked_for:
            console.print(table(diagnosis))
    for sentence in words.explanation(diagnosis):
        say(sentence)
    for note in diagnosis.notes:
        say(f"note: {note}")
    if not diagnosis.finished:
        say("STOPPED EARLY: run it again to its end before anything is taken apart.")
    spent = diagnosis.spent
    say(f"{spent.runs} simulator runs, {spent.simulated_s:.0f} simulated seconds, {spent.wall_s:.0f} s")
    console.print(words.corrected_note(diagnosis, asked.corrected), markup=False, soft_wrap=True)
    console.print(f"page: {page}", markup=False, soft_wrap=True)


def _posterior_table(diagnosis: Diagnosis) -> Table:
    table = Table(title="Posterior", title_justify="left", show_header=False, min_width=_WIDTH // 2)
    table.add_column("candidate", overflow="fold", max_width=40)
    table.add_column("probability", justify="right")
    table.add_column("bar", width=_BAR_WIDTH, no_wrap=True)
    bars = bars_of(diagnosis)
    for bar in [*bars[:_BARS_SHOWN], *(each for each in bars[_BARS_SHOWN:] if each.label == words.NONE_OF_THEM)]:
        length = round(_BAR_WIDTH * bar.probability)
        table.add_row(escape(bar.label), f"{100.0 * bar.probability:.1f} %", "#" * length)
    return table


def _effect_table(diagnosis: Diagnosis) -> Table:
    table = Table(title=words.effects_title(diagnosis), title_justify="left", min_width=_WIDTH // 2)
    table.add_column("effect: parameter", overflow="fold", max_width=28)
    table.add_column("value", justify="right")
    table.add_column("90 % interval", justify="right", max_width=20)
    for line in parameter_lines(diagnosis.effects):
        bound = " (at bound)" if line["remark"] else ""
        name = f"{words.label(line['effect'])}\n  [dim]{escape(line['parameter'])}[/dim]"
        table.add_row(name, escape(line["value"]), escape(line["interval"]) + bound)
    return table


def _ledger_table(diagnosis: Diagnosis) -> Table:
    table = Table(title="What closes the gap, where it was not fitted", title_justify="left", min_width=_WIDTH // 2)
    table.add_column("part", overflow="fold", max_width=40)
    table.add_column("share", justify="right")
    table.add_column("gap with it alone", justify="right")
    for line in words.ledger_lines(diagnosis):
        table.add_row(escape(line["part"]), line["share"], line["gap"])
    if any(each.gap > diagnosis.gap.nominal for each in diagnosis.ledger):
        table.caption = (
            f"more than the nominal {times(diagnosis.gap.nominal)}: fitted alone, it stands in for the others"
        )
    return table


def _gap_table(diagnosis: Diagnosis) -> Table:
    table = Table(title="Gap, in physical units and in healthy scatter", title_justify="left")
    table.add_column("signal", max_width=28, overflow="fold")
    for heading in ("residual", "in scatter", "with effect"):
        table.add_column(heading, justify="right")
    lines = signal_lines(diagnosis)
    for line in lines[:_SIGNALS_SHOWN]:
        table.add_row(*(escape(line[key]) for key in ("signal", "nominal_physical", "nominal", "corrected")))
    if len(lines) > _SIGNALS_SHOWN:
        table.add_row(f"({len(lines) - _SIGNALS_SHOWN} more on the page)", "", "", "")
    gap = diagnosis.gap
    table.add_section()
    closed = f"{percent(gap.closed)} closed ({percents(gap.interval)})" if diagnosis.effects else ""
    table.add_row(f"whitened, all {closed}", "", times(gap.nominal), times(gap.corrected))
    return table
