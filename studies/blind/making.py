"""Make one case: choose rig and size, run the tests and the references. What comes out is runs and the truth."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from studies.blind.key import Kind, Truth
from studies.blind.reality.record import Plan
from studies.blind.regimes import settings_of
from studies.blind.sizes import columns_of, scatter_of, share_for, size_of
from studies.blind.sources import Wrong
from studies.blind.whitened import HEALTHY, IdealDetector, detectable_size

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from studies.blind.plan import CasePlan
    from studies.blind.reality.record import RealRun
    from studies.blind.sources import Source

REPEATS = 2
"""Runs to be diagnosed per setting: the least that shows what differs from run to run."""
REFERENCES = 5
"""Healthy runs per setting that are handed over."""
_TWINS = 3
"""Runs with and without the fault that its size is taken from: those to be diagnosed, and one more."""
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
        runs = tuple(run for repeat in range(REPEATS) for run in trial.faulty(repeat, wrong))
        references = tuple(run for repeat in range(REFERENCES) for run in trial.references(repeat))
        truth = Truth(
            kind=case.kind,
            effects=self._source.effects(wrong),
            rung=case.rung,
            what=" + ".join(f"{each.fault} ({_text(each.values)})" for each in wrong),
            location=tuple(dict.fromkeys(place for fault in faults for place in fault.location)),
            size=trial.size(wrong, _TWINS) if wrong else None,
            scatter=trial.in_scatter(wrong) if wrong else None,
            wanted=case.wanted,
            rigs=(trial.rig,),
            machine=case.machine,
        )
        return MadeCase(runs, references, truth)

    def _share(self, trial: _Trial, fault: str, bounds: Mapping[str, float]) -> tuple[float, float]:
        row = self._source.faults[fault]

        def size_at(share: float) -> float:
            return trial.size([Wrong(fault, row.at(share, bounds))], REPEATS)

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
    """One case on one rig. Of every setting twins come first, then references, then what the maker keeps."""

    def __init__(self, maker: Maker, case: CasePlan, rig: str, onset: float, seeds: Sequence[int]) -> None:
        self._maker, self._case, self.rig, self._onset, self._seeds = maker, case, rig, onset, seeds
        self._plans = maker.plans(rig)
        self._settings = range(len(self._plans))
        self._healthy: dict[tuple[int, int], RealRun] = {}
        self._latest: tuple[list[Wrong], dict[tuple[int, int], RealRun]] = ([], {})
        self._detectors: list[IdealDetector] = []
        self.wanted = case.wanted

    def faulty(self, repeat: int, wrong: Sequence[Wrong]) -> list[RealRun]:
        """Return a run of every setting; the latest faults are remembered, as a search ends with those wanted."""
        if not wrong:
            return [self._healthy_run(setting, repeat) for setting in self._settings]
        if self._latest[0] != list(wrong):
            self._latest = (list(wrong), {})
        known = self._latest[1]
        for setting in self._settings:
            if (setting, repeat) not in known:
                onset_s = self._onset * self._end_s(setting) if self._onset else 0.0
                begun = [dataclasses.replace(each, onset_s=onset_s) for each in wrong]
                known[setting, repeat] = self._run(setting, repeat, begun)
        return [known[setting, repeat] for setting in self._settings]

    def references(self, repeat: int) -> list[RealRun]:
        """Return a healthy run of every setting that is no twin."""
        return [self._healthy_run(setting, _TWINS + repeat) for setting in self._settings]

    def size(self, wrong: Sequence[Wrong], twins: int) -> float:
        """Return the size of what is wrong, in what an ideal detector needs."""
        if not self._detectors:
            self._detectors = [
                IdealDetector([self._healthy_run(setting, repeat) for repeat in range(HEALTHY)])
                for setting in self._settings
            ]
        runs = [self.faulty(repeat, wrong) for repeat in range(twins)]
        gains = [
            detector.gain(
                [detector.difference(self._healthy_run(setting, i), run[setting]) for i, run in enumerate(runs)]
            )
            for setting, detector in enumerate(self._detectors)
        ]
        return detectable_size(gains, REPEATS, REFERENCES)

    def in_scatter(self, wrong: Sequence[Wrong]) -> float:
        """Return the size of what is wrong in the run-to-run scatter, over the first run of every setting."""
        healthy = [columns_of(self._healthy_run(setting, 0)) for setting in self._settings]
        scatters = [
            scatter_of([columns_of(self._healthy_run(setting, _TWINS + i)) for i in range(REFERENCES)])
            for setting in self._settings
        ]
        return size_of(list(zip(healthy, map(columns_of, self.faulty(0, wrong)), strict=True)), scatters)

    def _healthy_run(self, setting: int, repeat: int) -> RealRun:
        if (setting, repeat) not in self._healthy:
            self._healthy[setting, repeat] = self._run(setting, repeat, ())
        return self._healthy[setting, repeat]

    def _run(self, setting: int, repeat: int, wrong: Sequence[Wrong]) -> RealRun:
        """Run one setting; repeats differ in all that a day makes differ."""
        seed = self._seeds[repeat * len(self._plans) + setting]
        return self._maker.run(self._plans[setting], self._case.machine, wrong, seed)

    def _end_s(self, setting: int) -> float:
        columns = columns_of(self._healthy_run(setting, 0))
        return max(float(times_s[-1]) for times_s, _ in columns.values())


def _text(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {value:.4g}" for name, value in values.items())
