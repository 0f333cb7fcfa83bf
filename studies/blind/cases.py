"""Cases: what a lab hands over with the bags, and, in a file apart, what is true of them.

TRIAL/cases/NAME/case.json    which bags are to be diagnosed, which are references; nothing of the truth
KEY.json                      kept elsewhere: {"cases": {NAME: {"kind": ..., "effects": [...]}}}
"""

from __future__ import annotations

import dataclasses
import enum
import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

from jammkle_common.command.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

SIZES: Final = (1.0, 2.0, 4.0, 8.0)
"""Sizes that figures are separated by, in what an ideal detector needs."""
_NEARLY = 0.9
"""A case counts for a size that it misses by less than a tenth: sizes are a factor of two apart."""


class Kind(enum.Enum):
    """What is the matter in a case."""

    NONE = "none"
    SINGLE = "single"
    """One effect of the library."""
    PAIR = "pair"
    OUTSIDE = "outside"
    """Something that the library has not: `UNKNOWN` is right."""
    MIDRUN = "midrun"
    """An effect of the library that sets in while the run is on."""


class Rung(enum.Enum):
    """Where the bags of a case come from, from the easiest to the hardest."""

    KNOWN = "known"
    """The simulator that also diagnoses."""
    WITHHELD = "withheld"
    """Another model than the simulator."""


@dataclass(frozen=True)
class TrueEffect:
    """An effect as the library calls it."""

    name: str
    parameters: Mapping[str, float] = field(default_factory=dict)
    """In the library's units; those that cannot be given in them are left out."""


@dataclass(frozen=True)
class Truth:
    """What is true of one case."""

    kind: Kind
    effects: tuple[TrueEffect, ...] = ()
    rung: Rung = Rung.WITHHELD
    what: str = ""
    """In words, where the library has no name for it."""
    location: tuple[str, ...] = ()
    """Subsystems that it may rightly be said to lie in; empty: not asked."""
    size: float | None = None
    """In units of what an ideal detector with these sensors needs; see `size`."""
    wanted: float | None = None
    """The size that was aimed at: the smaller of it and `size` where the fault's range ends."""
    rigs: tuple[str, ...] = ()
    machine: int | None = None
    """Seed of the specimen."""

    @property
    def names(self) -> frozenset[str]:
        """Names of the effects."""
        return frozenset(effect.name for effect in self.effects)

    @property
    def level(self) -> float | None:
        """The largest of SIZES that it reaches; 0 if none, None if its size is not known."""
        if self.size is None:
            return None
        return max((size for size in SIZES if self.size >= _NEARLY * size), default=0.0)

    @property
    def is_visible(self) -> bool:
        """Whether an ideal detector sees it; where its size is not known, it is taken to."""
        return self.level != 0.0


@dataclass(frozen=True)
class CaseNote:
    """What a lab hands over with the bags of one case."""

    bags: tuple[str, ...]
    """To be diagnosed; paths relative to the case's folder."""
    references: tuple[str, ...] = ()
    """Of the same machine while healthy."""
    rig: str | None = None
    """What was recorded, where the bags do not say."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """How it was set, where the bags do not say."""


def main_rungs(truths: Iterable[Truth]) -> frozenset[Rung]:
    """Return the rungs that figures are of: cases of an independent model, or all where there are none."""
    there = frozenset(truth.rung for truth in truths)
    return frozenset({Rung.WITHHELD}) & there or there


def write_case(folder: Path, note: CaseNote) -> None:
    """Write `case.json`."""
    (folder / "case.json").write_text(json.dumps(dataclasses.asdict(note), indent=1), encoding="utf-8")


def read_case(folder: Path) -> CaseNote:
    """Read `case.json`; bags and references with their whole paths."""
    file = folder / "case.json"
    content = read_json(file)
    bags, references = content.get("bags"), content.get("references") or []
    options = content.get("options") or {}
    if not isinstance(bags, list) or not bags or not isinstance(references, list) or not isinstance(options, dict):
        msg = f"{file} must list 'bags' to diagnose, and may have a list of 'references' and a table of 'options'"
        raise InputError(msg)
    every = [*map(str, bags), *map(str, references)]
    for place, bag in enumerate(every):
        if not (folder / bag).exists() or bag in every[:place]:
            msg = f"{file} names bag '{bag}', which is not in {folder}, or was named before"
            raise InputError(msg)
    paths = [str((folder / bag).resolve()) for bag in every]
    rig = content.get("rig")
    return CaseNote(tuple(paths[: len(bags)]), tuple(paths[len(bags) :]), None if rig is None else str(rig), options)


def case_names(trial: Path) -> list[str]:
    """Return the names of a trial's cases, sorted."""
    names = sorted(file.parent.name for file in trial.glob("cases/*/case.json"))
    if not names:
        msg = f"trial {trial} has no cases: nothing matches cases/*/case.json"
        raise InputError(msg)
    return names


def write_key(file: Path, truths: Mapping[str, Truth]) -> None:
    """Write what is true."""
    content = {"cases": {name: dataclasses.asdict(truth) for name, truth in sorted(truths.items())}}
    file.write_text(json.dumps(content, indent=1, default=lambda each: each.value) + "\n", encoding="utf-8")


def read_key(file: Path, trial: Path) -> dict[str, Truth]:
    """Read what is true of the cases of a trial; only `kind` and, where there are any, `effects` must be there."""
    if file.resolve().is_relative_to(trial.resolve()):
        msg = f"--key {file} lies inside the trial {trial}, where the diagnosis could read it; keep it elsewhere"
        raise InputError(msg)
    table = read_json(file).get("cases")
    if not isinstance(table, dict) or not table:
        msg = f"key {file} has no cases; write NAME: {{kind: ..., effects: [...]}} under 'cases'"
        raise InputError(msg)
    found = {str(name): _truth_of(str(name), each) for name, each in table.items()}
    strange = sorted(set(found) ^ set(case_names(trial)))
    if strange:
        msg = f"case {strange[0]} is in key {file} or in trial {trial}, and not in both; give the key of this trial"
        raise InputError(msg)
    return found


def _truth_of(case: str, table: Any) -> Truth:
    try:
        given = {name: table[name] for name in table if name in {each.name for each in dataclasses.fields(Truth)}}
        effects = tuple(
            TrueEffect(
                str(each["name"]), {name: float(value) for name, value in (each.get("parameters") or {}).items()}
            )
            for each in given.get("effects", ())
        )
        given |= {name: tuple(given.get(name, ())) for name in ("location", "rigs")}
        kind, rung = Kind(given["kind"]), Rung(given.get("rung", Rung.WITHHELD.value))
        truth = Truth(**{**given, "kind": kind, "rung": rung, "effects": effects})
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        msg = f"key's case {case} cannot be read ({type(error).__name__}: {error}); see README.md"
        raise InputError(msg) from error
    counts = {Kind.SINGLE: 1, Kind.PAIR: 2, Kind.MIDRUN: len(effects)}
    if len(effects) != counts.get(kind, 0):
        msg = f"key's case {case} is '{kind.value}' with {len(effects)} effects; it must have {counts.get(kind, 0)}"
        raise InputError(msg)
    return truth


def read_json(file: Path) -> dict[str, Any]:
    """Read a table in JSON."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        msg = f"{file} cannot be read as JSON: {error}"
        raise InputError(msg) from error
    if not isinstance(content, dict):
        msg = f"{file} holds no table"
        raise InputError(msg)
    return content
