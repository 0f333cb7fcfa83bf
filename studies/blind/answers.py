"""What the diagnosis said of a case, read from its JSON: what the score needs, and no more."""

from __future__ import annotations

import enum
import itertools
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

NO_GAP: Final = "no_gap"
UNKNOWN: Final = "unknown"
"""What probabilities are stated for, beside candidates."""


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
    """Ends of the 90 % interval."""


@dataclass(frozen=True)
class Answer:
    """One diagnosis."""

    said: Said
    candidates: tuple[frozenset[str], ...] = ()
    """The credible set without "none of them", best first; empty unless effects are named, as leads are no answer."""
    ranking: tuple[frozenset[str], ...] = ()
    """All candidates, most probable first, whether or not a gap was found."""
    probabilities: Mapping[str, float] = field(default_factory=dict)
    """Of NO_GAP, of UNKNOWN, and of candidates by `label_of`; they add up to 1."""
    conformal: Mapping[str, float] = field(default_factory=dict)
    """p-value of each single effect."""
    classes: tuple[frozenset[str], ...] = ()
    """Effects that these recordings cannot tell apart at all: naming one is naming all."""
    silent: frozenset[str] = frozenset()
    """Effects that move nothing in these recordings."""
    located: str = ""
    """The subsystem that most likely holds the cause."""
    closed: float | None = None
    """Share of the gap that the best candidate closes on held-out settings."""
    estimates: Mapping[str, Estimate] = field(default_factory=dict)
    """By `effect.parameter`, of the first candidate."""
    p_value: float | None = None
    """Of the test for a gap."""
    wall_s: float = 0.0
    cpu_s: float = 0.0
    """Of the process that diagnosed."""
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

    def is_same(self, names: Iterable[str], other: Iterable[str]) -> bool:
        """Whether two combinations are the same up to equivalence classes."""
        one, two = list(names), list(other)
        if len(one) != len(two):
            return False
        return any(
            all(a == b or self._equivalent(a, b) for a, b in zip(one, order, strict=True))
            for order in itertools.permutations(two)
        )

    def _equivalent(self, one: str, other: str) -> bool:
        return any(one in members and other in members for members in self.classes)


def label_of(names: Iterable[str]) -> str:
    """Return the text that stands for a combination; UNKNOWN for none of the effects on offer."""
    return " + ".join(sorted(names)) or UNKNOWN


def refused(problem: str) -> dict[str, Any]:
    """Return what is kept of a case that the diagnosis would not, or could not, judge."""
    return {"refused": problem}


def answer_of(content: Mapping[str, Any]) -> Answer:
    """Return the answer that a diagnosis's JSON holds."""
    runtime = content.get("runtime") or {}
    if "refused" in content:
        return Answer(Said.REFUSED, problem=str(content["refused"]))
    said = Said(content["verdict"])
    named = [each for each in content.get("set") or [] if each["names"]]
    listed = named if said in {Said.EFFECTS, Said.AMBIGUOUS} else []
    posterior = {label_of(each["names"]): float(each["probability"] or 0.0) for each in content.get("posterior") or []}
    gap = float(content.get("gap_probability") or 0.0)
    return Answer(
        said,
        tuple(frozenset(each["names"]) for each in listed),
        tuple(frozenset(each["names"]) for each in content.get("posterior") or [] if each["names"]),
        {NO_GAP: 1.0 - gap, **{label: gap * value for label, value in posterior.items()}},
        {name: float(value) for name, value in (content.get("conformal") or {}).items() if value is not None},
        tuple(map(frozenset, content.get("classes") or ())),
        frozenset(content.get("silent") or ()),
        max(content.get("subsystems") or {"": 0.0}, key=(content.get("subsystems") or {"": 0.0}).__getitem__),
        _closed(content.get("gap") or {}),
        _estimates(listed[0]["effects"] if listed else []),
        content.get("p_value"),
        float(runtime.get("wall_s") or 0.0),
        float(runtime.get("cpu_s") or 0.0),
        int(runtime.get("simulator_runs") or 0),
        commit=str(content.get("commit") or ""),
    )


def _closed(gap: Mapping[str, Any]) -> float | None:
    """Return the mean over settings that were held out; of one setting alone, what a fit to it closes."""
    held = [each["closed"] for each in gap.get("held_out") or [] if each["closed"] is not None]
    if held:
        return float(np.mean(np.clip(held, 0.0, 1.0)))
    closed = gap.get("closed")
    return None if closed is None else float(np.clip(closed, 0.0, 1.0))


def _estimates(effects: Iterable[Mapping[str, Any]]) -> dict[str, Estimate]:
    return {
        f"{effect['name']}.{name}": Estimate(value["value"], *value["interval"])
        for effect in effects
        for name, value in effect["parameters"].items()
        if None not in (value["value"], *value["interval"])
    }
