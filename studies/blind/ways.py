"""One way of diagnosing all cases: its figures over all, by rung, by rig and by cause."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from studies.blind.key import Rung, main_rungs
from studies.blind.scoring import Case, Figure, calibration, figures

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_gap.core.effects import EffectParameter
    from studies.blind.statistics import Bin


@dataclass(frozen=True)
class Way:
    """One way of diagnosing."""

    name: str
    cases: tuple[Case, ...]
    figures: Mapping[str, Figure]
    """Over the withheld cases; where there are none, over all."""
    rungs: Mapping[Rung, Mapping[str, Figure]]
    counts: Mapping[Rung, int]
    rigs: Mapping[str, Mapping[str, Figure]]
    effects: Mapping[str, Mapping[str, Figure]]
    """By single effect, and by cause outside the library."""
    bins: tuple[Bin, ...]


def main_cases(cases: Sequence[Case]) -> tuple[Case, ...]:
    """Return the cases that the figures are of: those of the independent model, or all where there are none."""
    main = main_rungs(case.truth for case in cases)
    return tuple(case for case in cases if case.truth.rung in main)


def way_of(name: str, cases: Sequence[Case], parameters: Mapping[str, EffectParameter]) -> Way:
    """Return a way of diagnosing with all of its figures."""
    by_rung = {rung: [case for case in cases if case.truth.rung is rung] for rung in Rung}
    main = main_cases(cases)
    rigs = sorted({", ".join(case.truth.rigs) for case in main} - {""})
    effects = sorted({_cause(case) for case in main} - {""})
    return Way(
        name,
        tuple(cases),
        figures(main, parameters),
        {rung: figures(some, parameters) for rung, some in by_rung.items() if some},
        {rung: len(some) for rung, some in by_rung.items() if some},
        {rig: figures([case for case in main if ", ".join(case.truth.rigs) == rig], parameters) for rig in rigs},
        {each: figures([case for case in main if _cause(case) == each], parameters) for each in effects},
        calibration(main),
    )


def _cause(case: Case) -> str:
    """Return the single cause of a case; empty where there is none or several."""
    if len(case.truth.names) == 1:
        return next(iter(case.truth.names))
    return "" if case.truth.names else case.truth.what.partition(" (")[0]
