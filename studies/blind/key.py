"""The key of a trial: what was really put into each case. It stays away from the trial until all is diagnosed."""

from __future__ import annotations

import enum
import hashlib
import json
import secrets
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from jammkle_common.command.errors import InputError
from studies.blind.files import FORMAT, read_json

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

_SALT_BYTES = 32


class Kind(enum.Enum):
    """What is the matter in a case."""

    NONE = "none"
    """Nothing."""
    SINGLE = "single"
    """One effect of the library."""
    PAIR = "pair"
    """Two of them."""
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
    LIVE = "live graph"
    """Recorded from the running graph."""
    REAL = "real"
    """A machine."""


@dataclass(frozen=True)
class TrueEffect:
    """An effect as the library calls it."""

    name: str
    parameters: Mapping[str, float] = field(default_factory=dict)
    """In the library's units; those that cannot be told in them are left out."""


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
    """In units of what an ideal detector with these sensors needs; see `whitened`."""
    scatter: float | None = None
    """Root mean square over signals of faulty minus healthy, in units of the run-to-run scatter; see `sizes`."""
    wanted: float | None = None
    """The size that was aimed at: the smaller of it and `size` where the fault's range ends."""
    rigs: tuple[str, ...] = ()
    machine: int | None = None
    """Seed of the specimen."""

    @property
    def names(self) -> frozenset[str]:
        """Names of the effects."""
        return frozenset(effect.name for effect in self.effects)


def main_rungs(truths: Iterable[Truth]) -> frozenset[Rung]:
    """Return the rungs that figures are of: cases of an independent model, or all where there are none."""
    there = frozenset(truth.rung for truth in truths)
    return frozenset({Rung.WITHHELD}) & there or there


@dataclass(frozen=True)
class Key:
    """All of it."""

    cases: Mapping[str, Truth]
    salt: str
    """Random, so that the hash of the key does not tell whether a guess of it is right."""


def new_salt() -> str:
    """Return a salt nobody can guess."""
    return secrets.token_hex(_SALT_BYTES)


def write_key(file: Path, key: Key) -> str:
    """Write the key, readable by its owner alone, and return its hash.

    Raises:
        InputError: it cannot be written.

    """
    content = {
        "format": FORMAT,
        "salt": key.salt,
        "cases": {name: truth_as_dict(truth) for name, truth in sorted(key.cases.items())},
    }
    data = (json.dumps(content, indent=1, allow_nan=False) + "\n").encode()
    try:
        file.touch(mode=0o600)
        file.write_bytes(data)
    except OSError as error:
        msg = f"--key {file} cannot be written: {error.strerror}"
        raise InputError(msg) from error
    return hashlib.sha256(data).hexdigest()


def read_key(file: Path, sha256: str) -> Key:
    """Read a key and see that it is the one whose hash was published.

    Raises:
        InputError: it cannot be read, or is another one.

    """
    try:
        found = hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError as error:
        msg = f"--key {file} cannot be read: {error.strerror}"
        raise InputError(msg) from error
    if found != sha256:
        msg = f"--key {file} has the hash {found[:12]}..., but {sha256[:12]}... was published with the trial"
        msg = f"{msg}: it is another key, or was changed since; give the one that was made with the trial"
        raise InputError(msg)
    content = read_json(file, "key", "see README.md")
    cases = content.get("cases")
    if not isinstance(cases, dict) or not cases:
        msg = f"key {file} has no cases; write CASE: {{kind: ..., effects: [...]}} under 'cases'"
        raise InputError(msg)
    return Key({str(name): truth_of(str(name), table) for name, table in cases.items()}, str(content.get("salt", "")))


def check_apart(key: Path, trial: Path) -> None:
    """Refuse a key inside the trial's folder, where the diagnosis could find it.

    Raises:
        InputError: it is inside.

    """
    if key.resolve().is_relative_to(trial.resolve()):
        msg = f"--key {key} lies inside the trial {trial}, where the diagnosis could read it; keep it elsewhere"
        raise InputError(msg)


def truth_as_dict(truth: Truth) -> dict[str, Any]:
    """Return what JSON can hold."""
    return {
        "kind": truth.kind.value,
        "rung": truth.rung.value,
        "effects": [{"name": each.name, "parameters": dict(each.parameters)} for each in truth.effects],
        "what": truth.what,
        "location": list(truth.location),
        "size": truth.size,
        "scatter": truth.scatter,
        "wanted": truth.wanted,
        "rigs": list(truth.rigs),
        "machine": truth.machine,
    }


def truth_of(case: str, table: Any) -> Truth:
    """Return one entry of a key; only `kind` and, where there are any, `effects` must be there.

    Raises:
        InputError: it makes no sense.

    """
    try:
        kind, rung = Kind(table["kind"]), Rung(table.get("rung", Rung.WITHHELD.value))
        effects = tuple(
            TrueEffect(str(each["name"]), {str(k): float(v) for k, v in (each.get("parameters") or {}).items()})
            for each in table.get("effects") or ()
        )
        truth = Truth(
            kind,
            effects,
            rung,
            str(table.get("what") or ""),
            tuple(map(str, table.get("location") or ())),
            _number(table.get("size")),
            _number(table.get("scatter")),
            _number(table.get("wanted")),
            tuple(map(str, table.get("rigs") or ())),
            None if table.get("machine") is None else int(table["machine"]),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        msg = f"key's case {case} cannot be read ({type(error).__name__}: {error}); see README.md"
        raise InputError(msg) from error
    counts = {Kind.NONE: 0, Kind.SINGLE: 1, Kind.PAIR: 2, Kind.OUTSIDE: 0, Kind.MIDRUN: len(truth.effects)}
    if len(truth.effects) != counts[kind]:
        msg = f"key's case {case} is '{kind.value}' with {len(effects)} effects; it must have {counts[kind]}"
        raise InputError(msg)
    return truth


def _number(value: Any) -> float | None:
    return None if value is None else float(value)
