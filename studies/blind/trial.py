"""One case: a specimen does its exercises, is diagnosed from its bags alone, and what was said is set beside the truth.

The truth is drawn from the seed and kept in a folder apart; the diagnosis gets paths of bags. Where it asks for another
exercise the maker records it, on the same specimen.
"""

from __future__ import annotations

import dataclasses
import json
import shutil
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from jammkle_gap import (
    Constants,
    Profiles,
    Runner,
    Whitener,
    ankle_problem,
    cache_folder,
    conclude,
    evidence_of,
    experiments,
    grid_signatures,
    grids_of,
    load_recordings,
    with_settings,
)
from studies.blind.bags import write_run
from studies.blind.observer import NAMEABLE, REPEATS
from studies.blind.reality.faults import FAULTS, FaultSetting
from studies.blind.reality.run import run
from studies.blind.reality.sensors import Plan
from studies.blind.reality.specimen import machine as specimen

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from jammkle_gap import Diagnosis, Evidence, Recording
    from studies.blind.observer import Observer

_KINDS: Final = ("single", "single", "none", "single", "outside", "single", "pair", "single", "none", "single")
"""Of ten cases six have one effect of the library, one two, one what the library has not, and two nothing."""
_SMALLEST: Final = 0.1
"""Share of its range from which on a fault is drawn, evenly in its logarithm. Chosen: the observer, whose equations are
the machine's, names most faults at a hundredth of their range; a builder looks for those that matter."""
REFERENCES: Final = 5
"""Healthy runs of each plan, where what has changed since is asked."""
_NOT_OF_ROBOTS = ("load_cell/", "carriage/")
_INSTRUMENTED = ("/tension", "/extension")
_LOCATIONS = {"air": ("pneumatics",), "sensing": ("sensing", "timing"), "timing": ("sensing", "timing")}
"""Subsystems of the library by those of the second simulator, where they differ. A delay is one of a sensor."""


@dataclass(frozen=True)
class Truth:
    """What is true of a case."""

    seed: int
    kind: str
    machine: int
    """Seed of the specimen."""
    faults: tuple[tuple[str, Mapping[str, float]], ...] = ()
    """Names in the second simulator, with their sizes."""
    effects: tuple[str, ...] = ()
    """What the library calls them, sorted."""
    values: Mapping[str, float] = field(default_factory=dict)
    """Parameters of the library's effects, where they can be given in its numbers."""
    location: tuple[str, ...] = ()
    """Subsystems that it may rightly be said to lie in."""
    distances: tuple[float, ...] = ()
    """Of each fault from its best rival, to the ideal observer, in standard deviations."""

    @property
    def is_nameable(self) -> bool:
        """Whether the ideal observer names every fault."""
        return bool(self.distances) and min(self.distances) >= NAMEABLE


@dataclass(frozen=True)
class Answer:
    """What was said at one time."""

    verdict: str
    first: tuple[str, ...]
    """Effects of the first candidate that has any."""
    named: tuple[tuple[str, ...], ...]
    """Members of the credible set, and of their equivalence classes; the empty one is none of the effects."""
    ranking: tuple[tuple[str, ...], ...]
    """The most probable ones, whether there is a gap or not."""
    probabilities: tuple[float, ...]
    p_value: float
    subsystem: str
    closed: float
    """Share of the gap that closes in what was not fitted."""
    estimates: Mapping[str, tuple[float, float, float]]
    """Value and ends of the 90 % interval by parameter, of the first candidate."""
    rms: tuple[str, ...]
    """Single effects by the RMS error that they leave after calibration, best first."""
    asked: str
    """The exercise that would separate them; empty: none."""
    cpu_s: float
    wall_s: float
    runs: int


def truth_of(seed: int, observer: Observer) -> Truth:
    """Draw what is wrong in a case."""
    random, kind = np.random.default_rng([seed, 35]), _KINDS[seed % len(_KINDS)]
    machine = int(random.integers(1000, 2**31))
    pool = [name for name in observer.reach if (observer.faults[name].effect is None) == (kind == "outside")]
    wrong: list[FaultSetting] = []
    while len(wrong) < {"none": 0, "pair": 2}.get(kind, 1):
        each = _drawn(str(random.choice(pool)), random)
        if all(FAULTS[each.fault].effect != FAULTS[other.fault].effect for other in wrong):
            wrong.append(each)
    rows = [(FAULTS[each.fault], each.values) for each in wrong]
    effects = [fault.effect for fault, _ in rows if fault.effect is not None]
    return Truth(
        seed,
        kind,
        machine,
        tuple((each.fault, dict(each.values)) for each in wrong),
        tuple(sorted(effects)),
        {
            f"{fault.effect}.{name}": value
            for fault, values in rows
            if fault.effect is not None and fault.effect_values is not None
            for name, value in fault.effect_values(values).items()
        },
        tuple(dict.fromkeys(each for fault, _ in rows for each in _LOCATIONS.get(fault.subsystem, (fault.subsystem,)))),
        tuple(observer.distances(wrong).values()),
    )


def _drawn(name: str, random: np.random.Generator) -> FaultSetting:
    """Return a fault of random direction and size."""
    fault, share = FAULTS[name], float(np.exp(random.uniform(np.log(_SMALLEST), 0.0)))
    whole = {}
    for place, (key, row) in enumerate(fault.parameters.items()):
        reach = np.array([row.null - row.minimum, row.maximum - row.null])
        # A bound next to null is no direction: 2 % more flow where a fifth is left at the other end.
        bound = (row.minimum, row.maximum)[int(random.choice(np.flatnonzero(reach > 0.2 * reach.max())))]
        whole[key] = (float(random.uniform(0.3, 1.0)) if place else 1.0) * (bound - row.null)
    return FaultSetting(
        name,
        {
            key: min(max(row.null + share * whole[key], row.minimum), row.maximum)
            for key, row in fault.parameters.items()
        },
    )


class Maker:
    """Records exercises of the specimen of a case."""

    def __init__(self, truth: Truth, folder: Path) -> None:
        """Keep the truth; bags go into the folder."""
        self._truth, self._folder = truth, folder
        self._seeds = np.random.default_rng([truth.seed, 36]).integers(1, 2**31, 4096).tolist()

    def record(self, plan: Plan, count: int = REPEATS) -> list[Path]:
        """Return bags of runs with what is wrong."""
        faults = [FaultSetting(name, values) for name, values in self._truth.faults]
        return self._recorded(plan, faults, count, "run")

    def record_healthy(self, plan: Plan, count: int) -> list[Path]:
        """Return bags of runs of the same specimen in order."""
        return self._recorded(plan, (), count, "healthy")

    def _recorded(self, plan: Plan, faults: Sequence[FaultSetting], count: int, label: str) -> list[Path]:
        made = []
        for _ in range(count):
            path = self._folder / f"{label}_{len(self._seeds)}"
            seed = self._seeds.pop()
            write_run(run(plan, specimen(self._truth.machine), faults, seed), path)
            made.append(path)
        return made


def run_case(
    seed: int, observer: Observer, folder: Path, *, further: int = 3, since: bool = False, jobs: int = 1
) -> dict[str, Any]:
    """Make a case, diagnose it, and return truth and answers, as they are kept.

    Args:
        seed: Of everything.
        observer: Says what is recorded, and how large faults are.
        folder: Of the trial; bags are removed again.
        further: Exercises that may be asked for.
        since: Whether healthy runs of the same specimen are handed over.
        jobs: Runs at a time.

    """
    truth = truth_of(seed, observer)
    keys, bags = folder / "keys", folder / "bags" / str(seed)
    shutil.rmtree(bags, ignore_errors=True)
    for each in (keys, bags):
        each.mkdir(parents=True, exist_ok=True)
    (keys / f"{seed}.json").write_text(json.dumps(dataclasses.asdict(truth), indent=1), encoding="utf-8")
    maker = Maker(truth, bags)
    runs = [path for plan in observer.plans for path in maker.record(plan)]
    references = [path for plan in observer.plans for path in maker.record_healthy(plan, REFERENCES)] if since else []
    answers = diagnosed(runs, references, maker.record, further, jobs)
    shutil.rmtree(bags)
    return {"truth": dataclasses.asdict(truth), "answers": [dataclasses.asdict(each) for each in answers]}


def diagnosed(
    bags: Sequence[Path],
    references: Sequence[Path],
    record: Callable[[Plan], list[Path]],
    further: int,
    jobs: int,
) -> list[Answer]:
    """Return what is said of bags alone, and again after every further exercise that was asked for."""
    runs, known, found = _read(bags), _read(references), list[Answer]()
    while True:
        every = with_settings([*runs, *known])
        started, begun = time.perf_counter(), time.process_time()
        problem = ankle_problem()
        runner, constants = Runner(problem, jobs), Constants()
        own = every[: len(runs)]
        evidence = evidence_of(own, every[len(runs) :], problem, runner, constants, cache_folder())
        said = conclude(evidence, experiments(own), runner, constants)
        spent = time.process_time() - begun, time.perf_counter() - started
        found.append(_answer(said, evidence, *spent))
        if not found[-1].asked or len(found) > further:
            return found
        runs += _read(record(asked_for(found[-1].asked)))


def asked_for(name: str) -> Plan:
    """Return what is to be recorded for an experiment's name, `exercise NAME -p OPTION:=VALUE`."""
    _, exercise, *words = name.split()
    pairs = [word.split(":=") for word in words if ":=" in word]
    return Plan(exercise, {key: float(value) for key, value in pairs})


def _read(bags: Sequence[Path]) -> list[Recording]:
    """Return recordings with the sensors that a robot has."""
    found = []
    for recording in (each for bag in bags for each in load_recordings(bag)):
        kept = [each for each in recording.signals if not each.name.startswith(_NOT_OF_ROBOTS)]
        kept = [each for each in kept if not each.name.endswith(_INSTRUMENTED)]
        found.append(dataclasses.replace(recording, signals=tuple(kept)))
    return found


def _answer(said: Diagnosis, evidence: Evidence, cpu_s: float, wall_s: float) -> Answer:
    named = [each for each in said.candidates if each.names]
    members = [tuple(sorted(each.names)) for each in said.candidates]
    members += [(other,) for each in named for other in each.equivalents]
    ranked = sorted(said.posterior.items(), key=lambda item: -item[1])[:5]
    effects = named[0].effects if named else ()
    return Answer(
        said.verdict.value,
        tuple(sorted(named[0].names)) if named else (),
        tuple(members),
        tuple(tuple(sorted(names)) for names, _ in ranked),
        tuple(probability for _, probability in ranked),
        said.p_value,
        next(iter(said.subsystems), ""),
        said.gap.closed,
        {
            f"{effect.name}.{each.name}": (each.value, *each.interval)
            for effect in effects
            for each in effect.parameters
        },
        tuple(least_error(evidence)[:5]),
        said.next_experiment.name if said.next_experiment is not None else "",
        cpu_s,
        wall_s,
        said.spent.runs,
    )


def least_error(evidence: Evidence) -> list[str]:
    """Return single effects by the root mean square that they leave after calibration, best first.

    In units of the sensors' noise, with the constants of the machine fitted along their slopes; no scatter between
    runs, no error of the simulator.
    """
    plain = dataclasses.replace(
        evidence.difference,
        whiteners=tuple(
            Whitener(np.square(each.layout.floor), np.zeros((each.layout.size, 0))) for each in evidence.settings
        ),
        settings=tuple(dataclasses.replace(each, factor=1.0) for each in evidence.difference.settings),
    )
    columns = plain.by_scatter([each.shared.T for each in plain.settings])
    plain = dataclasses.replace(plain, shared=columns.T)
    plain = dataclasses.replace(plain, whitened=plain.whiten([each.difference for each in evidence.residuals]))
    signatures = grid_signatures(evidence.grids, plain)
    profiles = Profiles(grids_of(evidence.problem), signatures, plain.whitened)
    return sorted(profiles.names, key=lambda name: -profiles.single(name).gain)
