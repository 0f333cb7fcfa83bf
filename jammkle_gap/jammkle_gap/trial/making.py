"""Make one case: choose rig and size, run the tests and the references. What comes out is runs and the truth."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.trial.key import Kind, Truth
from jammkle_gap.trial.regimes import settings_of
from jammkle_gap.trial.sizes import columns_of, scatter_of, share_for, size_of
from jammkle_gap.trial.sources import Wrong
from jammkle_reality.record import Plan

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_gap.trial.plan import CasePlan
    from jammkle_gap.trial.sizes import Columns
    from jammkle_gap.trial.sources import Source
    from jammkle_reality.record import RealRun

REPEATS = 2
"""Runs to be diagnosed per setting: the least that shows what differs from run to run."""
REFERENCES = 3
"""Runs in good order per setting."""
_ENOUGH = 0.9
"""Share of the wanted size with which a rig is taken."""
_ONSET = (0.35, 0.65)
"""Share of a run at which a change in mid-run sets in."""


@dataclass(frozen=True)
class MadeCase:
    """Runs of a case, and the truth of it."""

    runs: tuple[RealRun, ...]
    references: tuple[RealRun, ...]
    truth: Truth


class Maker:
    """Makes cases of one trial from one source."""

    def __init__(self, source: Source, trial_seed: int) -> None:
        """Prepare.

        Args:
            source: Of the runs.
            trial_seed: Chooses the regimes.

        """
        self._source = source
        self._trial_seed = trial_seed

    def make(self, case: CasePlan) -> MadeCase:
        """Make one case. The same plan always gives the same.

        Args:
            case: What is wanted.

        """
        random = np.random.default_rng(case.seed)
        faults = [self._source.faults[name] for name in case.faults]
        bounds = [fault.bounds(random) for fault in faults]
        onset = float(random.uniform(*_ONSET)) if case.kind is Kind.MIDRUN else 0.0
        seeds = [int(each) for each in random.integers(1, 2**31, 64)]
        trial, shares = _Trial(self, case, case.rigs[0], onset, seeds), [0.0] * len(faults)
        nearest = -1.0
        for offered in case.rigs if faults else ():
            tried = _Trial(self, case, offered, onset, seeds)
            found = [self._share(tried, fault.fact.name, bound) for fault, bound in zip(faults, bounds, strict=True)]
            least = min(size for _, size in found)
            if least > nearest:
                nearest, trial, shares = least, tried, [share for share, _ in found]
            if case.wanted is None or least >= _ENOUGH * case.wanted:
                break
        wrong = [
            Wrong(fault.fact.name, fault.at(share, bound))
            for fault, share, bound in zip(faults, shares, bounds, strict=True)
        ]
        repeats = (trial.run(setting, repeat, wrong) for repeat in range(1, REPEATS) for setting in trial.settings)
        runs = (*trial.first(wrong), *repeats)
        references = tuple(run for repeat in zip(*trial.references(), strict=True) for run in repeat)
        truth = Truth(
            kind=case.kind,
            effects=self._source.effects(wrong),
            rung=case.rung,
            what=" + ".join(f"{each.fault} ({_text(each.values)})" for each in wrong),
            location=tuple(dict.fromkeys(place for fault in faults for place in fault.location)),
            size=trial.size(wrong) if wrong else None,
            wanted=case.wanted,
            rigs=(trial.rig,),
            machine=case.machine,
        )
        return MadeCase(runs, references, truth)

    def _share(self, trial: _Trial, fault: str, bounds: Mapping[str, float]) -> tuple[float, float]:
        row = self._source.faults[fault]

        def size_at(share: float) -> float:
            return trial.size([Wrong(fault, row.at(share, bounds))])

        if trial.wanted is None:
            return 1.0, size_at(1.0)
        return share_for(size_at, trial.wanted)

    def run(self, plan: Plan, machine: int, wrong: Sequence[Wrong], seed: int) -> RealRun:
        """Run a plan once."""
        return self._source.run(plan, machine, wrong, seed)

    def plans(self, rig: str) -> list[Plan]:
        """Return how a rig is set."""
        return [Plan(rig, dict(settings)) for settings in settings_of(self._trial_seed, rig)]


class _Trial:
    """One case on one rig."""

    def __init__(self, maker: Maker, case: CasePlan, rig: str, onset: float, seeds: Sequence[int]) -> None:
        self._maker, self._case, self.rig, self._onset, self._seeds = maker, case, rig, onset, seeds
        self._plans = maker.plans(rig)
        self._healthy: list[Columns] = []
        self._references: list[list[RealRun]] = []
        self._scatters: list[Mapping[str, float]] = []
        self._first: tuple[list[Wrong], list[RealRun]] | None = None
        self.settings = range(len(self._plans))
        self.wanted = case.wanted

    def run(self, setting: int, repeat: int, wrong: Sequence[Wrong]) -> RealRun:
        """Run one setting; repeats differ in all that a day makes differ."""
        plan = self._plans[setting]
        seed = self._seeds[repeat * len(self._plans) + setting]
        if self._onset and wrong:
            end_s = self._end_s(setting)
            wrong = [dataclasses.replace(each, onset_s=self._onset * end_s) for each in wrong]
        return self._maker.run(plan, self._case.machine, wrong, seed)

    def first(self, wrong: Sequence[Wrong]) -> list[RealRun]:
        """Return the first run of every setting; the latest are kept, as a search ends with those that are wanted."""
        if self._first is None or self._first[0] != list(wrong):
            self._first = list(wrong), [self.run(setting, 0, wrong) for setting in self.settings]
        return self._first[1]

    def size(self, wrong: Sequence[Wrong]) -> float:
        """Return the size of what is wrong, over the first run of every setting."""
        faulty = [columns_of(run) for run in self.first(wrong)]
        return size_of(list(zip(self._first_healthy(), faulty, strict=True)), self._scatter())

    def references(self) -> list[list[RealRun]]:
        """Return runs in good order, per setting."""
        if not self._references:
            self._references = [
                [self.run(setting, REPEATS + repeat, ()) for repeat in range(REFERENCES)] for setting in self.settings
            ]
        return self._references

    def _scatter(self) -> list[Mapping[str, float]]:
        """Return what differs from run to run in each setting, when nothing is wrong with this very specimen."""
        if not self._scatters:
            self._scatters = [
                scatter_of([healthy, *map(columns_of, references)])
                for healthy, references in zip(self._first_healthy(), self.references(), strict=True)
            ]
        return self._scatters

    def _first_healthy(self) -> list[Columns]:
        if not self._healthy:
            self._healthy = [columns_of(self.run(setting, 0, ())) for setting in self.settings]
        return self._healthy

    def _end_s(self, setting: int) -> float:
        return max(float(times_s[-1]) for times_s, _ in self._first_healthy()[setting].values())


def _text(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {value:.4g}" for name, value in values.items())
