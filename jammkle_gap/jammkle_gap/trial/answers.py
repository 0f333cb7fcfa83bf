"""What the diagnosis said of a case, read from its JSON: what the score needs, and no more."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping


class Said(enum.Enum):
    """The verdicts, and one for a diagnosis that gave none."""

    NO_GAP = "NO_GAP"
    EFFECTS = "EFFECTS"
    AMBIGUOUS = "AMBIGUOUS"
    UNKNOWN = "UNKNOWN"
    REFUSED = "REFUSED"


@dataclass(frozen=True)
class Estimate:
    """One parameter of a named effect."""

    value: float
    low: float
    high: float
    """Ends of the 95 % interval."""


@dataclass(frozen=True)
class Answer:
    """One diagnosis."""

    said: Said
    candidates: tuple[frozenset[str], ...] = ()
    """The set, best first: with EFFECTS one, with AMBIGUOUS several; else empty, as leads are no answer."""
    probabilities: Mapping[str, float] = field(default_factory=dict)
    located: str = ""
    """The subsystem that the gap is said to lie in."""
    closed: float | None = None
    """Share of the gap that the best candidate closes on held-out data."""
    estimates: Mapping[str, Estimate] = field(default_factory=dict)
    """By `effect.parameter`, of the first candidate."""
    wall_s: float = 0.0
    runs: int = 0
    problem: str = ""
    """Why it was refused."""
    commit: str = ""
    """Of the program that diagnosed; empty: not known."""

    @property
    def names(self) -> frozenset[str]:
        """The first candidate."""
        return self.candidates[0] if self.candidates else frozenset()

    @property
    def is_alarm(self) -> bool:
        """Whether it says that something is wrong."""
        return self.said in {Said.EFFECTS, Said.AMBIGUOUS, Said.UNKNOWN}


def refused(problem: str) -> dict[str, Any]:
    """Return what is kept of a case that the diagnosis would not, or could not, judge."""
    return {"refused": problem}


def answer_of(content: Mapping[str, Any]) -> Answer:
    """Return the answer that a diagnosis's JSON holds."""
    runtime = content.get("runtime") or {}
    wall_s, runs = float(runtime.get("wall_s") or 0.0), int(runtime.get("simulator_runs") or 0)
    if "refused" in content:
        return Answer(Said.REFUSED, problem=str(content["refused"]))
    said = Said(content["verdict"])
    listed = content.get("set") or [] if said in {Said.EFFECTS, Said.AMBIGUOUS} else []
    first = listed[0]["effects"] if listed else []
    estimates = {
        f"{effect['name']}.{name}": Estimate(value["value"], *value["interval"])
        for effect in first
        for name, value in effect["parameters"].items()
        if None not in (value["value"], *value["interval"])
    }
    return Answer(
        said,
        tuple(frozenset(each["names"]) for each in listed),
        {name: float(value or 0.0) for name, value in (content.get("probabilities") or {}).items()},
        _located(content),
        (content.get("gap") or {}).get("closed"),
        estimates,
        wall_s,
        runs,
        commit=str(content.get("commit") or ""),
    )


def _located(content: Mapping[str, Any]) -> str:
    """Return the subsystem of the effects named; without any, the one to blame that is off most; else the worst place.

    Several effects that all lie in one subsystem are an answer; several in different ones go by the first.
    """
    if content["verdict"] in {Said.EFFECTS.value, Said.AMBIGUOUS.value} and content.get("effects"):
        return str(content["effects"][0]["subsystem"])
    blamed = [each for each in content.get("subsystems") or [] if each["to_blame"]]
    if blamed:
        return str(max(blamed, key=lambda each: each["gap"])["name"])
    places = content.get("where") or []
    return str(places[0]["subsystem"]) if places else ""
