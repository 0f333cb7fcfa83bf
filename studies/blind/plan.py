"""Which cases a trial has and how the rigs are set; drawn from the seed, and from nothing else."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from studies.blind.cases import SIZES, Kind, Rung

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

DEVELOPMENT_SEEDS: Final = 1000
"""Seeds below it are for development; thresholds of the diagnosis may be tuned on them, and on no other."""
STANDARD_SEED: Final = 46_811
"""Of the standard trial, `make blind`."""
STANDARD_CASES: Final = 200
"""Of the standard trial; 100 of them healthy."""


_SETTINGS: Final[Mapping[str, Mapping[str, tuple[Mapping[str, float | str], ...]]]] = {
    "development": {
        "pressure": (
            {"vacuum_pa": 50e3, "cycles": 2, "jam_time_s": 1.0, "vent_time_s": 0.5},
            {"vacuum_pa": 25e3, "cycles": 2, "jam_time_s": 0.8, "vent_time_s": 0.4},
        ),
        "tensile": (
            {"vacuum_pa": 0.0, "speed_m_s": 0.05, "extension_m": 0.02},
            {"vacuum_pa": 50e3, "speed_m_s": 0.03, "extension_m": 0.02},
        ),
        "drop": (
            {"foot": "unjammed", "drop_height_m": 0.05},
            {"foot": "jammed", "vacuum_pa": 50e3, "drop_height_m": 0.05},
        ),
        "slip": (
            {"foot": "unjammed", "speed_m_s": 0.02},
            {"foot": "jammed", "vacuum_pa": 50e3, "speed_m_s": 0.02},
        ),
        "landing": ({"drop_height_m": 0.05, "slope_deg": 40.0}, {"drop_height_m": 0.03, "slope_deg": 30.0}),
    },
    "held out": {
        "pressure": (
            {"vacuum_pa": 60e3, "cycles": 2, "jam_time_s": 1.3, "vent_time_s": 0.5},
            {"vacuum_pa": 35e3, "cycles": 2, "jam_time_s": 0.9, "vent_time_s": 0.6},
        ),
        "tensile": (
            {"vacuum_pa": 10e3, "speed_m_s": 0.08, "extension_m": 0.022},
            {"vacuum_pa": 60e3, "speed_m_s": 0.02, "extension_m": 0.018},
        ),
        "drop": (
            {"foot": "unjammed", "drop_height_m": 0.04},
            {"foot": "jammed", "vacuum_pa": 40e3, "drop_height_m": 0.06},
        ),
        "slip": (
            {"foot": "unjammed", "speed_m_s": 0.03},
            {"foot": "jammed", "vacuum_pa": 40e3, "speed_m_s": 0.03},
        ),
        "landing": ({"drop_height_m": 0.04, "slope_deg": 35.0}, {"drop_height_m": 0.06, "slope_deg": 25.0}),
    },
}
RIGS: Final = tuple(_SETTINGS["held out"])

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


def regime(seed: int) -> str:
    """Return to which table of settings a seed belongs."""
    return "development" if seed < DEVELOPMENT_SEEDS else "held out"


def settings_of(seed: int, rig: str) -> tuple[Mapping[str, float | str], ...]:
    """Return how a rig is set in a trial, one entry per setting that is recorded."""
    return _SETTINGS[regime(seed)][rig]


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
    """Rigs to choose from; the first in which the faults are seen as much as wanted is taken."""
    machine: int
    """Seed of the specimen."""
    seed: int
    """Of everything else that is drawn for this case."""


def plan_cases(
    seed: int, count: int, rigs: Sequence[str], faults: Sequence[FaultFact], known: Sequence[FaultFact]
) -> tuple[CasePlan, ...]:
    """Return the cases of a trial, in an order that says nothing of them."""
    random = np.random.default_rng([seed, 1])
    slots = [slot for slot, number in zip(_SHARES, _counts(count), strict=True) for _ in range(number)]
    shown, known = _shown_on(rigs, faults), _shown_on(rigs, known)
    inside = [each for each in shown if each.effect is not None]
    drawn = {
        (Kind.NONE, Rung.WITHHELD): itertools.repeat(((), None)),
        (Kind.SINGLE, Rung.WITHHELD): _singles(random, inside, SIZES),
        (Kind.PAIR, Rung.WITHHELD): _pairs(random, inside),
        (Kind.OUTSIDE, Rung.WITHHELD): _singles(random, [each for each in shown if each.effect is None], _OUTSIDE),
        (Kind.MIDRUN, Rung.WITHHELD): _singles(random, inside, _LARGER),
        (Kind.SINGLE, Rung.KNOWN): _singles(random, known, SIZES),
    }
    turn = itertools.cycle(rigs)
    order = random.permutation(len(slots))
    made: dict[int, CasePlan] = {}
    for (kind, rung, _), place in zip(slots, order.tolist(), strict=True):
        # Where the rigs can show no fault of a kind, nothing is wrong.
        chosen, wanted = next(drawn[kind, rung], ((), None))
        offered = [next(turn)] if not chosen else [rig for rig in rigs if all(rig in each.rigs for each in chosen)]
        made[place] = CasePlan(
            name=f"{place + 1:04d}",
            kind=kind if chosen else Kind.NONE,
            rung=rung if chosen else Rung.WITHHELD,
            faults=tuple(each.name for each in chosen),
            wanted=wanted,
            rigs=tuple(str(rig) for rig in random.permutation(offered)),
            machine=int(random.integers(1, 2**31)),
            seed=int(random.integers(1, 2**31)),
        )
    return tuple(made[place] for place in sorted(made))


def _shown_on(rigs: Sequence[str], faults: Sequence[FaultFact]) -> list[FaultFact]:
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

    def fit(one: FaultFact, other: FaultFact) -> bool:
        return one.effect != other.effect and bool(set(one.rigs) & set(other.rigs))

    size = itertools.cycle(_LARGER)
    while any(fit(one, other) for one, other in itertools.combinations(faults, 2)):
        left = [faults[place] for place in random.permutation(len(faults)).tolist()]
        while len(left) > 1:
            first = left.pop()
            partner = next((each for each in left if fit(first, each)), None)
            if partner is not None:
                left.remove(partner)
                yield (first, partner), next(size)
