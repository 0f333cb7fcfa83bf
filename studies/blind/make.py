"""Make the cases of a trial: choose rig and size, run the tests and the references, write their bags."""

from __future__ import annotations

import dataclasses
import shutil
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Protocol

import numpy as np

from jammkle_common.parameters import from_mapping
from jammkle_gap import Correction, ankle_library
from jammkle_sim.rigs.catalogue import as_it_is, rig_kind, run_rig, scattered
from studies.blind.bags import write_run
from studies.blind.cases import CaseNote, Kind, Rung, TrueEffect, Truth, write_case
from studies.blind.ceiling import COMMANDS
from studies.blind.plan import RIGS, FaultFact, plan_cases, settings_of
from studies.blind.reality.faults import FAULTS, FaultSetting
from studies.blind.reality.run import RIGS as REAL_RIGS
from studies.blind.reality.run import run as run_reality
from studies.blind.reality.sensors import Plan, RealRun, Track
from studies.blind.reality.specimen import machine as specimen
from studies.blind.size import HEALTHY, IdealDetector, detectable_size, share_for

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from studies.blind.plan import CasePlan

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
_LOCATIONS = {"air": ("pneumatics",), "sensing": ("sensing", "timing"), "timing": ("sensing", "timing")}
"""Subsystems of the library by those of the second simulator, where they differ. A delay is one of a sensor."""
_LOG_DELAY_S = (0.0005, 0.002)
"""From stamp to log in a bag of the lowest rung. Assumed."""
_DROPPED = 0.002
"""Share of the samples that a recorder of the lowest rung loses. Assumed, as in the second simulator."""


@dataclass(frozen=True)
class Wrong:
    """One thing that is wrong in a run."""

    fault: str
    values: Mapping[str, float]
    """By name of the parameter."""
    onset_s: float = 0.0
    """Since the start of the rig; 0: it was always there."""


@dataclass(frozen=True)
class SourceFault:
    """Something that can be wrong, as far as a trial has to know it."""

    fact: FaultFact
    location: tuple[str, ...]
    """Subsystems of the library that it may rightly be said to lie in."""
    ranges: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    """Null, minimum and maximum by name of the parameter."""

    def at(self, share: float, bounds: Mapping[str, float]) -> dict[str, float]:
        """Return its parameters at a share of the way from null to a bound each."""
        return {
            name: min(max(null + share * (bounds[name] - null), minimum), maximum)
            for name, (null, minimum, maximum) in self.ranges.items()
        }

    def bounds(self, random: np.random.Generator) -> dict[str, float]:
        """Draw the direction in which it grows: some way to one of the bounds of every parameter."""
        found = {}
        for name, (null, minimum, maximum) in self.ranges.items():
            reach = np.array([null - minimum, maximum - null])
            # A bound next to null is no direction: `2 % more flow` where a fifth is left at the other end.
            sides = [side for side in range(2) if reach[side] > 0.2 * reach.max()]
            bound = (minimum, maximum)[int(random.choice(sides))]
            weight = 1.0 if len(self.ranges) == 1 else float(random.uniform(0.3, 1.0))
            found[name] = min(max(null + weight * (bound - null), minimum), maximum)
        return found


class Source(Protocol):
    """Makes runs."""

    @property
    def faults(self) -> Mapping[str, SourceFault]:
        """What can be wrong, by name."""

    def run(self, plan: Plan, machine: int, wrong: Sequence[Wrong], seed: int) -> RealRun:
        """Run a plan once on a specimen; the same seed gives the same noise, whatever is wrong."""

    def effects(self, wrong: Sequence[Wrong]) -> tuple[TrueEffect, ...]:
        """Return what the library calls it, as far as it does."""


class Reality:
    """The second simulator."""

    def __init__(self) -> None:
        """Look at its table of faults."""
        self.faults: Mapping[str, SourceFault] = {
            name: SourceFault(
                FaultFact(name, fault.effect, tuple(fault.rigs)),
                _LOCATIONS.get(fault.subsystem, (fault.subsystem,)),
                {key: (row.null, row.minimum, row.maximum) for key, row in fault.parameters.items()},
            )
            for name, fault in FAULTS.items()
        }

    def run(self, plan: Plan, machine: int, wrong: Sequence[Wrong], seed: int) -> RealRun:
        """Run a plan once; see `Source`."""
        faults = [FaultSetting(each.fault, each.values, each.onset_s) for each in wrong]
        return run_reality(plan, specimen(machine), faults, seed)

    def effects(self, wrong: Sequence[Wrong]) -> tuple[TrueEffect, ...]:
        """Return what the library calls it; see `Source`."""
        rows = [(FAULTS[each.fault], each.values) for each in wrong]
        return tuple(
            TrueEffect(fault.effect, dict(fault.effect_values(values)) if fault.effect_values is not None else {})
            for fault, values in rows
            if fault.effect is not None
        )


class Simulator:
    """The simulator that also diagnoses, with effects of the library: the lowest rung."""

    def __init__(self, rigs: Sequence[str]) -> None:
        """Take the rigs that are recorded."""
        self._library = ankle_library()
        self.faults: Mapping[str, SourceFault] = {
            effect.name: SourceFault(
                FaultFact(effect.name, effect.name, tuple(rigs)),
                _LOCATIONS.get(effect.subsystem, (effect.subsystem,)),
                {each.name: (each.null, each.minimum, each.maximum) for each in effect.parameters},
            )
            for effect in self._library
        }

    def run(self, plan: Plan, machine: int, wrong: Sequence[Wrong], seed: int) -> RealRun:
        """Run a plan once; see `Source`. What is wrong was always there."""
        values = {f"{each.fault}.{name}": value for each in wrong for name, value in each.values.items()}
        change = Correction(self._library, values) if values else as_it_is
        options = from_mapping(rig_kind(plan.rig).options, {**plan.options, "seed": machine})
        done = run_rig(plan.rig, scattered(plan.rig, options, seed), lambda _: None, lambda: False, change)
        random = np.random.default_rng([machine, seed])
        topics = {}
        for name, series in done.topics.items():
            count = len(series.time_s)
            log_s = np.maximum.accumulate(series.time_s + random.uniform(*_LOG_DELAY_S, count))
            kept = random.random(count) >= (0.0 if name in COMMANDS else _DROPPED)
            topics[name] = Track(series.columns, series.time_s[kept], log_s[kept], series.values[kept])
        return RealRun(plan, topics)

    def effects(self, wrong: Sequence[Wrong]) -> tuple[TrueEffect, ...]:
        """Return the effects; see `Source`."""
        return tuple(TrueEffect(each.fault, dict(each.values)) for each in wrong)


@dataclass(frozen=True)
class MadeCase:
    """Runs of a case, and the truth of it."""

    runs: tuple[RealRun, ...]
    references: tuple[RealRun, ...]
    truth: Truth


def plan_of(seed: int, count: int, rigs: Sequence[str] = ()) -> tuple[CasePlan, ...]:
    """Return the cases of a trial; without rigs, on all of them."""
    recorded = tuple(rig for rig in RIGS if rig in REAL_RIGS and rig in (rigs or RIGS))
    faults, known = ([each.fact for each in source.faults.values()] for source in (Reality(), Simulator(recorded)))
    return plan_cases(seed, count, recorded, faults, known)


def make_case(seed: int, case: CasePlan, folder: Path) -> Truth:
    """Make one case, write its bags, and return what is true of it; what is left of an earlier try is removed."""
    made = made_case(_source(case.rung), seed, case)
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "bags").mkdir(parents=True)
    named: dict[str, list[str]] = {"run": [], "healthy": []}
    for kind, runs in (("run", made.runs), ("healthy", made.references)):
        for number, run in enumerate(runs, start=1):
            named[kind].append(f"bags/{kind}_{number}")
            write_run(run, folder / named[kind][-1])
    write_case(folder, CaseNote(tuple(named["run"]), tuple(named["healthy"])))
    return made.truth


@lru_cache(maxsize=2)
def _source(rung: Rung) -> Source:
    return Simulator(RIGS) if rung is Rung.KNOWN else Reality()


def made_case(source: Source, trial_seed: int, case: CasePlan) -> MadeCase:
    """Return runs and truth of one case."""
    random = np.random.default_rng(case.seed)
    faults = [source.faults[name] for name in case.faults]
    bounds = [fault.bounds(random) for fault in faults]
    onset = float(random.uniform(*_ONSET)) if case.kind is Kind.MIDRUN else 0.0
    seeds = [int(each) for each in random.integers(1, 2**31, 64)]

    def on(rig: str) -> _OnRig:
        plans = [Plan(rig, dict(settings)) for settings in settings_of(trial_seed, rig)]
        return _OnRig(source, plans, case.machine, onset, seeds)

    trial, shares, nearest = on(case.rigs[0]), [0.0] * len(faults), -1.0
    for offered in case.rigs if faults else ():
        tried = on(offered)
        found = [tried.share(fault, bound, case.wanted) for fault, bound in zip(faults, bounds, strict=True)]
        least = min(size for _, size in found)
        if least > nearest:
            nearest, trial, shares = least, tried, [share for share, _ in found]
        if case.wanted is None or least >= _ENOUGH * case.wanted:
            break
    wrong = [
        Wrong(fault.fact.name, fault.at(share, bound))
        for fault, share, bound in zip(faults, shares, bounds, strict=True)
    ]
    truth = Truth(
        kind=case.kind,
        effects=source.effects(wrong),
        rung=case.rung,
        what=" + ".join(f"{each.fault} ({_text(each.values)})" for each in wrong),
        location=tuple(dict.fromkeys(place for fault in faults for place in fault.location)),
        size=trial.size(wrong, _TWINS) if wrong else None,
        wanted=case.wanted,
        rigs=(trial.rig,),
        machine=case.machine,
    )
    runs = tuple(run for repeat in range(REPEATS) for run in trial.faulty(repeat, wrong))
    return MadeCase(runs, tuple(run for repeat in range(REFERENCES) for run in trial.references(repeat)), truth)


class _OnRig:
    """One case on one rig. Of every setting twins come first, then references, then what the maker keeps."""

    def __init__(self, source: Source, plans: Sequence[Plan], machine: int, onset: float, seeds: Sequence[int]) -> None:
        self._source, self._plans, self._machine, self._onset, self._seeds = source, plans, machine, onset, seeds
        self.rig = plans[0].rig
        self._settings = range(len(plans))
        self._healthy: dict[tuple[int, int], RealRun] = {}
        self._latest: tuple[list[Wrong], dict[tuple[int, int], RealRun]] = ([], {})
        self._detectors: list[IdealDetector] = []

    def share(self, fault: SourceFault, bounds: Mapping[str, float], wanted: float | None) -> tuple[float, float]:
        """Return the share of a fault's range at which it is as large as wanted, and the size there."""

        def size_at(share: float) -> float:
            return self.size([Wrong(fault.fact.name, fault.at(share, bounds))], REPEATS)

        return (1.0, size_at(1.0)) if wanted is None else share_for(size_at, wanted)

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

    def _healthy_run(self, setting: int, repeat: int) -> RealRun:
        if (setting, repeat) not in self._healthy:
            self._healthy[setting, repeat] = self._run(setting, repeat, ())
        return self._healthy[setting, repeat]

    def _run(self, setting: int, repeat: int, wrong: Sequence[Wrong]) -> RealRun:
        """Run one setting; repeats differ in all that a day makes differ."""
        seed = self._seeds[repeat * len(self._plans) + setting]
        return self._source.run(self._plans[setting], self._machine, wrong, seed)

    def _end_s(self, setting: int) -> float:
        topics = self._healthy_run(setting, 0).topics
        return max(float(track.stamp_s[-1]) for name, track in topics.items() if name not in COMMANDS)


def _text(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {value:.4g}" for name, value in values.items())
