"""Which cases a trial has: kinds, faults, sizes, rigs, specimens; drawn from the seed, and from nothing else."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from studies.blind.key import Kind, Rung
from studies.blind.outcomes import SIZES

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

_LARGER: Final = (4.0, 8.0)
"""Of each effect of a pair and of those that set in during a run: there the question is which, not whether."""
_OUTSIDE: Final = (2.0, 4.0, 8.0)
"""Outside the library: an ideal detector sees all of them."""

_SHARES: Final = (
    (Kind.NONE, Rung.WITHHELD, 200),
    (Kind.SINGLE, Rung.WITHHELD, 112),
    (Kind.PAIR, Rung.WITHHELD, 30),
    (Kind.OUTSIDE, Rung.WITHHELD, 30),
    (Kind.MIDRUN, Rung.WITHHELD, 12),
    (Kind.SINGLE, Rung.KNOWN, 16),
)
"""Cases of each kind in 400. Assumed: enough healthy ones to see 1 % of false alarms, 28 singles of each size."""


@dataclass(frozen=True)
class FaultFact:
    """What the plan must know of a fault."""

    name: str
    effect: str | None
    """The library's name; None where it has none."""
    rigs: tuple[str, ...]
    """Where it can show."""


@dataclass(frozen=True)
class CasePlan:
    """What is to be made."""

    name: str
    kind: Kind
    rung: Rung
    faults: tuple[str, ...]
    wanted: float | None
    """Size of each fault."""
    rigs: tuple[str, ...]
    """Rigs to choose from, the first in which the faults are seen as much as wanted is taken."""
    machine: int
    """Seed of the specimen."""
    seed: int
    """Of everything else that is drawn for this case."""


def plan_cases(
    seed: int, count: int, rigs: Sequence[str], faults: Sequence[FaultFact], known: Sequence[FaultFact]
) -> tuple[CasePlan, ...]:
    """Return the cases of a trial, in an order that tells nothing.

    Args:
        seed: Of the trial.
        count: How many cases.
        rigs: Rigs that can be recorded.
        faults: What can be wrong with the reality.
        known: What can be wrong with the simulator that also diagnoses: the library.

    """
    random = np.random.default_rng([seed, 1])
    slots = [slot for slot, number in zip(_SHARES, _counts(count), strict=True) for _ in range(number)]
    shown, known = _shown_on(rigs, faults), _shown_on(rigs, known)
    inside = [each for each in shown if each.effect is not None]
    outside = [each for each in shown if each.effect is None]
    drawn = {
        (Kind.NONE, Rung.WITHHELD): itertools.repeat(((), None)),
        (Kind.SINGLE, Rung.WITHHELD): _singles(random, inside, SIZES),
        (Kind.PAIR, Rung.WITHHELD): _pairs(random, inside),
        (Kind.OUTSIDE, Rung.WITHHELD): _singles(random, outside, _OUTSIDE),
        (Kind.MIDRUN, Rung.WITHHELD): _singles(random, inside, _LARGER),
        (Kind.SINGLE, Rung.KNOWN): _singles(random, known, SIZES),
    }
    turn = itertools.cycle(rigs)
    order = random.permutation(len(slots))
    made: list[CasePlan | None] = [None] * len(slots)
    for slot, place in zip(slots, order.tolist(), strict=True):
        kind, rung, _ = slot
        # Where the rigs can show no fault of a kind, nothing is wrong.
        chosen, wanted = next(drawn[kind, rung], ((), None))
        kind, rung = (kind, rung) if chosen else (Kind.NONE, Rung.WITHHELD)
        offered = [next(turn)] if not chosen else [rig for rig in rigs if all(rig in each.rigs for each in chosen)]
        made[place] = CasePlan(
            name=f"{place + 1:04d}",
            kind=kind,
            rung=rung,
            faults=tuple(each.name for each in chosen),
            wanted=wanted,
            rigs=tuple(str(rig) for rig in random.permutation(offered)),
            machine=int(random.integers(1, 2**31)),
            seed=int(random.integers(1, 2**31)),
        )
    return tuple(each for each in made if each is not None)


def _shown_on(rigs: Sequence[str], faults: Sequence[FaultFact]) -> list[FaultFact]:
    """Return the faults that some of the rigs can show, with those rigs alone."""
    kept = [FaultFact(each.name, each.effect, tuple(rig for rig in each.rigs if rig in rigs)) for each in faults]
    return [each for each in kept if each.rigs]


def _counts(count: int) -> list[int]:
    """Share a number of cases out, largest remainders first; each kind gets its share to within one."""
    shares = np.array([number for _, _, number in _SHARES], dtype=float)
    exact = count * shares / shares.sum()
    counts = np.floor(exact).astype(int)
    for place in np.argsort(counts - exact, kind="stable")[: count - int(counts.sum())]:
        counts[place] += 1
    return [int(number) for number in counts]


def _singles(
    random: np.random.Generator, faults: Sequence[FaultFact], sizes: Sequence[float]
) -> Iterator[tuple[tuple[FaultFact, ...], float | None]]:
    """Give every fault once, then every fault again; every size as often as any other, with other faults each time."""
    size = itertools.cycle(sizes)
    while faults:
        for place in random.permutation(len(faults)).tolist():
            yield (faults[place],), next(size)
        for _ in range(int(random.integers(len(sizes)))):
            next(size)


def _pairs(
    random: np.random.Generator, faults: Sequence[FaultFact]
) -> Iterator[tuple[tuple[FaultFact, ...], float | None]]:
    """Give pairs of different effects that one rig can show, each fault about as often as any other."""
    size = itertools.cycle(_LARGER)
    while any(_fit(one, other) for one, other in itertools.combinations(faults, 2)):
        left = [faults[place] for place in random.permutation(len(faults)).tolist()]
        while len(left) > 1:
            first = left.pop()
            partner = next((each for each in left if _fit(first, each)), None)
            if partner is not None:
                left.remove(partner)
                yield (first, partner), next(size)


def _fit(one: FaultFact, other: FaultFact) -> bool:
    """Tell whether two faults are a pair: different effects, and a rig that can show both."""
    return one.effect != other.effect and bool(set(one.rigs) & set(other.rigs))
