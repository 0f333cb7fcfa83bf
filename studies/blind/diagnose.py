"""Diagnose cases from their bags alone, in several ways, and say what the simplest method would have named."""

from __future__ import annotations

import dataclasses
import enum
import hashlib
import itertools
import subprocess
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from jammkle_common.command.errors import GraphError, InputError
from jammkle_gap import (
    BadRecordingError,
    Constants,
    Library,
    Profiles,
    Recording,
    Runner,
    SimulatorError,
    Whitener,
    ankle_library,
    ankle_problem,
    as_dict,
    cache_folder,
    conclude,
    evidence_of,
    fit_place,
    grid_signatures,
    grids_of,
    load_recordings,
    with_settings,
)
from jammkle_sim.rigs.simulation import UnstableSimulationError
from studies.blind.cases import Kind, Rung, main_rungs
from studies.blind.ceiling import CEILING_CONSTANTS, INSTRUMENTED, ceiling_problem

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap import Evidence, Problem
    from studies.blind.cases import CaseNote, Truth

FEW = 12
"""Cases up to which every one is in the samples."""
ONE_IN = 6
"""Beyond it, every sixth case is in the sample. Chosen, to keep the standard trial short."""
CEILINGS = 12
"""Cases with a fault that the ceiling is asked about: its simulator takes ten times as long."""
_CLEAR = 2.0
"""Size from which on the ceiling is asked."""
_FITTED, _EVALUATIONS = 4, 3
"""Single effects that are fitted for the least error, the best on their grids, and the steps of such a fit."""
_RANKED = 5
"""How many effects are kept of the ranking by error."""
_OF_RIGS = ("load_cell/", "carriage/")
"""Beginnings of the names of signals that a rig has and a robot has not."""
_KEPT = {
    "verdict", "set", "posterior", "gap_probability", "p_value", "subsystems", "gap", "classes", "notes",
    "runtime",
}  # fmt: skip
"""Of a diagnosis's JSON; the rest is in no figure."""


class Way(enum.Enum):
    """A way of diagnosing."""

    WITHOUT = "rig_0"
    """No reference."""
    WITH = "rig_5"
    """The headline: all references, and the sensors of the rig."""
    RMS = "rms"
    """Single effects by the root mean square that they leave of what the headline looks at."""
    FEWER = "rig_3"
    """Three references per setting."""
    ROBOT = "robot_5"
    """Without load cell and carriage."""
    INSTRUMENTED = "instrumented_5"
    """With tension and extension of every tendon."""
    ORACLE = "oracle"
    """Only the true effects on offer: how far the gap can be closed."""
    LEFT_OUT = "left_out"
    """The true effect not on offer."""
    CEILING = "ceiling"
    """With the second simulator in the place of the first, and its own faults as the library."""


EVERY: Final = (Way.WITH, Way.RMS)
"""Ways that every case is diagnosed in."""
SAMPLED: Final = (Way.FEWER, Way.WITHOUT, Way.ROBOT, Way.INSTRUMENTED)
"""Ways that a sample of the cases is diagnosed in."""
_REFERENCES: Final = {Way.FEWER: 3, Way.WITHOUT: 0}
"""References per setting that a way takes; those not named take all."""


@dataclass(frozen=True)
class Question:
    """One answer that is asked for."""

    way: Way
    only: tuple[str, ...] = ()
    """Effects that are on offer, and no others; empty: all."""
    without: tuple[str, ...] = ()
    """Effects that are not on offer."""


def sampled(cases: Sequence[str]) -> frozenset[str]:
    """Return the cases that are diagnosed with fewer references and other sensors, too."""
    return frozenset(case for case in cases if len(cases) <= FEW or _drawn(case) % ONE_IN == 0)


def _drawn(case: str) -> int:
    """Return a number that nobody chose, the same whenever it is asked for."""
    return int.from_bytes(hashlib.sha256(case.encode()).digest()[:4], "big")


def blind_questions(cases: Sequence[str]) -> dict[str, list[Question]]:
    """Return all that is asked before anything is known of the truth, by case; those without references first."""
    some = sampled(cases)
    ways = {case: {*EVERY, *(SAMPLED if case in some else ())} for case in cases}
    return {case: [Question(way) for way in Way if way in ways[case]] for case in cases}


def open_questions(truths: Mapping[str, Truth], *, with_ceiling: bool) -> dict[str, list[Question]]:
    """Return what is asked with the truth at hand, by case.

    The oracle is asked about every single effect and pair; an effect is left out in the largest of its cases that
    figures are of. The ceiling is asked about some of those that the second simulator made and that an ideal detector
    sees twice over, each rig's in turn.
    """
    main = main_rungs(truths.values())
    asked: dict[str, list[Question]] = {}
    largest: dict[str, tuple[float, str]] = {}
    by_rig: dict[tuple[str, ...], list[str]] = {}
    for case, truth in sorted(truths.items()):
        if truth.kind in {Kind.SINGLE, Kind.PAIR}:
            asked[case] = [Question(Way.ORACLE, only=tuple(sorted(truth.names)))]
        if truth.rung in main and truth.kind is Kind.SINGLE and truth.size is not None:
            (name,) = truth.names
            largest[name] = max(largest.get(name, (0.0, "")), (truth.size, case))
    for name, (_, case) in largest.items():
        asked[case].append(Question(Way.LEFT_OUT, without=(name,)))
    for case in sorted(asked, key=_drawn) if with_ceiling else ():
        truth = truths[case]
        if truth.rung is Rung.WITHHELD and (truth.level or 0.0) >= _CLEAR:
            by_rig.setdefault(truth.rigs, []).append(case)
    turns = [case for turn in itertools.zip_longest(*by_rig.values()) for case in turn if case is not None]
    for case in turns[:CEILINGS]:
        asked[case].append(Question(Way.CEILING))
    return asked


def commit() -> str:
    """Return the commit of this program, with a + if files differ from it; empty where it is not known."""
    words = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--abbrev=40", "--dirty=+"]
    return subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip()  # noqa: S603


def answers(note: CaseNote, questions: Sequence[Question]) -> dict[str, dict[str, Any]]:
    """Answer the questions on one case, by the values of their ways."""
    program, case, found = commit(), _Case(note), {}
    for asked in questions:
        try:
            content = case.answer(asked)
        except (BadRecordingError, SimulatorError, UnstableSimulationError, InputError, GraphError) as error:
            content = {"refused": str(error)}
        found[asked.way.value] = content | {"commit": program}
    return found


class _Case:
    """The recordings of one case, and what was found of them."""

    def __init__(self, note: CaseNote) -> None:
        self._note = note
        self._known: dict[object, dict[str, Any]] = {}
        self._headline: Evidence | None = None
        self._simulator = Remembering(ankle_problem())
        self._read: dict[str, tuple[Recording, ...]] = {}

    def answer(self, asked: Question) -> dict[str, Any]:
        most = _REFERENCES.get(asked.way)
        runs, references = (
            self._recordings(self._note.bags),
            self._recordings(self._note.references if most != 0 else ()),
        )
        runs, references = in_settings(runs, references)
        if most is not None:
            references = first_of_each(references, most)
        runs, references = ([_seen(each, asked.way) for each in group] for group in (runs, references))
        if asked.way is Way.CEILING:
            return _diagnosed(runs, references, ceiling_problem(), CEILING_CONSTANTS)[0]
        if asked.way is Way.RMS:
            evidence = self._headline or self._evidence(runs, references)
            return {"rms": least_error(evidence)[:_RANKED], "classes": [list(each) for each in evidence.classes]}
        key = (asked.only, asked.without, *((run.name, *(each.name for each in run.signals)) for run in runs),
               *(run.name for run in references))  # fmt: skip
        if key not in self._known:
            # Where other sensors are not there, their answer is one that was given.
            self._known[key], evidence = _diagnosed(runs, references, self._problem(asked), Constants())
            if asked.way is Way.WITH:
                self._headline = evidence
        return self._known[key]

    def _evidence(self, runs: Sequence[Recording], references: Sequence[Recording]) -> Evidence:
        problem = self._problem(Question(Way.WITH))
        return evidence_of(runs, references, problem, Runner(problem, 1), Constants(), cache_folder())

    def _problem(self, asked: Question) -> Problem:
        library = ankle_library()
        if asked.only:
            library = Library(tuple(library.effect(name) for name in asked.only))
        for name in asked.without:
            library = library.without(name)
        return dataclasses.replace(ankle_problem(library), simulator=self._simulator)

    def _recordings(self, bags: Sequence[str]) -> list[Recording]:
        """Return recordings with all of their signals, read when they are first asked for."""
        for bag in bags:
            if bag not in self._read:
                self._read[bag] = load_recordings(Path(bag), self._note.rig, options=self._note.options)
                self._simulator.know(self._read[bag])
        return [each for bag in bags for each in self._read[bag]]


def in_settings(runs: Sequence[Recording], references: Sequence[Recording]) -> tuple[list[Recording], list[Recording]]:
    """Return runs with their settings, and the references that are repeats of one of them."""
    every = with_settings([*runs, *references])
    own, others = list(every[: len(runs)]), every[len(runs) :]
    found = [each for each in others if each.setting in {run.setting for run in own}]
    if others and not found:
        msg = f"no reference is a repeat of recording {own[0].name}"
        raise BadRecordingError(msg)
    return own, found


def first_of_each(references: Sequence[Recording], count: int) -> list[Recording]:
    """Return so many references of every setting."""
    seen: Counter[str] = Counter()
    kept = []
    for each in references:
        seen[each.setting] += 1
        if seen[each.setting] <= count:
            kept.append(each)
    return kept


def _seen(recording: Recording, way: Way) -> Recording:
    """Return a recording with the signals that a way looks at: the load cell, but on a robot, where the rig has one."""
    if way is Way.INSTRUMENTED:
        return recording
    has_cell = any(each.name.startswith("load_cell/") for each in recording.signals)
    hidden = _OF_RIGS if way is Way.ROBOT or not has_cell else ()
    signals = [each for each in recording.signals if not each.name.endswith(INSTRUMENTED)]
    signals = [each for each in signals if not each.name.startswith(hidden)] if hidden else signals
    if not signals:
        msg = f"recording {recording.name} has no signal that '{way.value}' looks at"
        raise BadRecordingError(msg)
    return dataclasses.replace(recording, signals=tuple(signals))


def _diagnosed(
    runs: Sequence[Recording], references: Sequence[Recording], problem: Problem, constants: Constants
) -> tuple[dict[str, Any], Evidence]:
    """Return what `diagnose` says, and the evidence behind it."""
    started, begun = time.perf_counter(), time.process_time()
    runner = Runner(problem, 1)
    evidence = evidence_of(runs, references, problem, runner, constants, cache_folder())
    found = as_dict(conclude(evidence, (), runner, constants))
    found["runtime"] |= {"wall_s": time.perf_counter() - started, "cpu_s": time.process_time() - begun}
    return {key: value for key, value in found.items() if key in _KEPT}, evidence


def least_error(evidence: Evidence) -> list[str]:
    """Return single effects by the root mean square that they leave, in units of the sensors' own noise, best first.

    No scatter between runs, no whitening. It looks at the evidence of the headline, so that what differs is the method.
    """
    whiteners = tuple(
        Whitener(np.square(setting.layout.floor), np.zeros((setting.layout.size, 0))) for setting in evidence.settings
    )
    alone = tuple(dataclasses.replace(each, factor=1.0) for each in evidence.difference.settings)
    plain = dataclasses.replace(evidence.difference, whiteners=whiteners, settings=alone, shared=np.zeros((0, 0)))
    plain = dataclasses.replace(plain, whitened=plain.whiten([each.difference for each in evidence.residuals]))
    signatures = grid_signatures(evidence.grids, plain)
    if not signatures:
        return []
    profiles = Profiles(grids_of(evidence.problem), signatures, plain.whitened)
    places = {name: profiles.single(name) for name in profiles.names}
    length = float(plain.whitened @ plain.whitened)
    left = {name: length - place.gain for name, place in places.items()}
    constants = Constants(fit_evaluations=_EVALUATIONS)
    for name in sorted(left, key=left.__getitem__)[:_FITTED]:
        fit, _ = fit_place(evidence.problem, evidence.settings, plain, evidence.machine, places[name], constants)
        left[name] = min(left[name], fit.left)
    return sorted(left, key=left.__getitem__)


class Remembering:
    """Runs every recording with all of its signals, and keeps what came of it: all ways ask for the same runs."""

    def __init__(self, problem: Problem) -> None:
        """Take the simulator of a problem; `know` gives it the recordings."""
        self._simulator = problem.simulator
        self._whole: dict[str, Recording] = {}
        self._made: dict[tuple[str, tuple[tuple[str, float], ...]], dict[str, NDArray[np.float32]]] = {}

    def know(self, recordings: Sequence[Recording]) -> None:
        """Take recordings with all of their signals; their names differ."""
        self._whole |= {each.name: each for each in recordings}

    def __call__(self, recording: Recording, values: Mapping[str, float]) -> Mapping[str, NDArray[np.float64]]:
        """Run again what was commanded, as the simulator of a `Problem` does."""
        whole = self._whole.get(recording.name)
        if whole is None:
            return self._simulator(recording, values)
        place = (recording.name, tuple(sorted(values.items())))
        if place not in self._made:
            # Single precision rounds to a ten-millionth: far below the noise of any sensor.
            made = self._simulator(whole, values)
            self._made[place] = {name: np.asarray(each, dtype=np.float32) for name, each in made.items()}
        return {name: each.astype(float) for name, each in self._made[place].items()}
