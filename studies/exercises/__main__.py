"""`make exercises`: what an ideal observer sees of each effect in each exercise and on each rig, as tables."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from joblib import Memory  # type: ignore[import-untyped]  # carries no types

from jammkle_common.command.main import run as run_command
from jammkle_common.command.options import JsonOption
from jammkle_common.command.results import check_writable, say, write_json
from jammkle_gap import ankle_problem
from studies.exercises.observer import NAMEABLE, Lengths, Seen, family_of, lengths, nominal, seen, together

ROBOT = ("pressure", "angle", "acceleration", "rate", "event")
"""What a robot's sensors measure."""
RIG = (*ROBOT, "force", "slide")
KINDS: dict[str, tuple[str, dict[str, object], tuple[str, ...]]] = {
    "cycle": ("cycle", {}, ROBOT),
    "press": ("press", {}, ROBOT),
    "press, load cell": ("press", {}, RIG),
    "shake": ("shake", {}, ROBOT),
    "tilt": ("tilt", {}, ROBOT),
    "landing": ("landing", {}, ROBOT),
    "drop": ("drop", {"foot": "jammed"}, ROBOT),
    "slip": ("slip", {"foot": "jammed"}, ROBOT),
    "pressure": ("pressure", {}, ROBOT),
    "tensile": ("tensile", {"vacuum_pa": 50e3}, RIG),
}
"""Rig, its options and the sensors that count, by the name in the tables."""
SETS = {"all four": ("cycle", "press", "shake", "tilt")}
"""Kinds that one robot makes, one after the other."""
PAGE = Path(__file__).with_name("README.md")
_MOST = 999
"""Lengths beyond it are not distinguished."""

app = typer.Typer(add_completion=False, context_settings={"help_option_names": ["-h", "--help"]})


@app.command()
def exercises(
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder in which what was simulated is kept.", metavar="DIR")
    ] = Path("runs/exercises"),
    jobs: Annotated[int, typer.Option(help="Processes.")] = 2,
    page: Annotated[
        Path | None, typer.Option(help="Markdown file whose tables are written anew.", metavar="FILE")
    ] = None,
    json: JsonOption = None,
) -> int:
    """Say which effects each exercise shows, and which pairs of them it tells apart."""
    check_writable(json)
    kept = Memory(output, verbose=0).cache(_seen, ignore=["jobs"])
    version, found = ankle_problem().version, {}
    for name, (rig, options, sensors) in KINDS.items():
        say(f"{name} ...")
        found[name] = kept(rig, options, version, jobs).of(name, sensors)
    for name, kinds in SETS.items():
        found[name] = together(name, [found[kind] for kind in kinds])
    order = ("cycle", "press", "press, load cell", "shake", "tilt", *SETS)
    order = (*order, *(name for name in found if name not in order))
    measured = {name: lengths(found[name]) for name in order}
    tables = {"summary": _summary(found, measured), "effects": _effects(measured)}
    for table in tables.values():
        typer.echo(f"\n{table}")
    if page is not None:
        text = page.read_text(encoding="utf-8")
        for name, table in tables.items():
            marks = rf"(<!-- {name} -->\n).*?(\n<!-- end -->)"
            text = re.sub(marks, rf"\g<1>{table}\g<2>", text, flags=re.DOTALL)
        page.write_text(text, encoding="utf-8")
    write_json(json, {name: _as_json(found[name], each) for name, each in measured.items()})
    return 0


def _seen(rig: str, options: dict[str, object], version: str, jobs: int) -> Seen:  # noqa: ARG001 - what it is kept by
    return seen(rig, nominal(rig, options), jobs)


def _summary(found: dict[str, Seen], measured: dict[str, Lengths]) -> str:
    count = len(next(iter(measured.values())).effects)
    pairs = count * (count - 1) // 2
    lines = [
        f"| | s | effects seen, of {count} | distinguished from all others | pairs distinguished, of {pairs} |",
        "|---|---|---|---|---|",
    ]
    for name, each in measured.items():
        alone = int((np.minimum(each.length, each.left.min(axis=1)) >= NAMEABLE).sum())
        lines.append(f"| {name} | {found[name].lasts_s:.0f} | {each.seen} | {alone} | {each.pairs} |")
    return "\n".join(lines)


def _effects(measured: dict[str, Lengths]) -> str:
    families: dict[str, list[int]] = {}
    for i, effect in enumerate(next(iter(measured.values())).effects):
        families.setdefault(family_of(effect), []).append(i)
    lines = [f"| effect | {' | '.join(measured)} |", "|---" * (len(measured) + 1) + "|"]
    for family, places in families.items():
        cells = []
        for each in measured.values():
            _, worst = min((float(each.left[i].min()), i) for i in places)
            cells.append(f"{_short(each.length[worst])}, {_short(each.left[worst].min())}")
        lines.append(f"| {family} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _short(length: float) -> str:
    return f"{length:.0f}" if length <= _MOST else f"> {_MOST}"


def _as_json(kind: Seen, each: Lengths) -> dict[str, object]:
    return {
        "lasts_s": kind.lasts_s,
        "length": dict(zip(each.effects, each.length.tolist(), strict=True)),
        "not_told_apart": [
            [one, other]
            for i, one in enumerate(each.effects)
            for j, other in enumerate(each.effects)
            if i < j and not each.separated[i, j]
        ],
    }


if __name__ == "__main__":
    sys.exit(run_command(app))
