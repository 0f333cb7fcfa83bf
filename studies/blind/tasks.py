"""What is to be diagnosed, in which ways: blind with references and without, and, once the key is open, the rest."""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_common.command.errors import InputError
from jammkle_common.parameters import typed_name, typed_value
from studies.blind import files
from studies.blind.key import Kind, Rung, main_rungs
from studies.blind.outcomes import level
from studies.blind.questions import Questions, Run, Way

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from studies.blind.key import Key

_SEAL = "sealed.json"

EVERY = (Run.WITH, Run.BASELINES)
"""Ways that every case is diagnosed in."""
SAMPLED = (Run.WITHOUT, Run.FEWER, Run.ROBOT, Run.INSTRUMENTED)
"""Ways that a sample of the cases is diagnosed in."""
BLIND = (*EVERY, *SAMPLED)
"""Those that need no key."""
FEW = 12
"""Cases up to which every one is in the samples."""
ONE_IN = 6
"""Beyond it, every sixth case is in the sample. Chosen, to keep the standard trial short."""
CEILINGS = 12
"""Cases with a fault that the ceiling is asked about: its simulator takes ten times as long."""


@dataclass(frozen=True)
class Task:
    """One case and the ways in which it is to be diagnosed."""

    case: str
    asked: Questions


def blind_tasks(trial: Path) -> list[Task]:
    """Return all that can be done without the key, case by case."""
    sampled = sample(trial)
    names = files.case_names(trial)
    return [_task(trial, case, map(Way, BLIND if case in sampled else EVERY)) for case in names]


def sample(trial: Path) -> frozenset[str]:
    """Return the cases that are diagnosed with fewer references and other sensors, too: by the hash of the key.

    Raises:
        InputError: it is no trial.

    """
    names, sha256 = files.case_names(trial), files.read_trial(trial).key_sha256
    if len(names) <= FEW:
        return frozenset(names)
    return frozenset(name for name in names if _drawn(sha256, name) % ONE_IN == 0)


def _drawn(sha256: str, case: str) -> int:
    """Return a number that nobody chose, the same whenever it is asked for."""
    return int.from_bytes(hashlib.sha256(f"{sha256} {case}".encode()).digest()[:4], "big")


def open_tasks(trial: Path, key: Key) -> list[Task]:
    """Return what is done with the key, case by case.

    The oracle is asked about every single effect and pair; an effect is left out in the largest of its cases that
    figures are of. The ceiling is asked about some of those that the reality made and that an ideal detector sees twice
    over, each rig's in turn.
    """
    main = main_rungs(key.cases.values())
    ways: dict[str, list[Way]] = {}
    largest: dict[str, tuple[float, str]] = {}
    for case, truth in sorted(key.cases.items()):
        if truth.kind in {Kind.SINGLE, Kind.PAIR}:
            ways[case] = [Way(Run.ORACLE, only=tuple(sorted(truth.names)))]
        if truth.rung in main and truth.kind is Kind.SINGLE and truth.size is not None:
            name = next(iter(truth.names))
            largest[name] = max(largest.get(name, (0.0, "")), (truth.size, case))
    for name, (_, case) in largest.items():
        ways[case].append(Way(Run.LEFT_OUT, without=(name,)))
    for case in _under_the_ceiling(trial, key):
        ways[case].append(Way(Run.CEILING))
    return [_task(trial, case, asked) for case, asked in ways.items()]


def _under_the_ceiling(trial: Path, key: Key) -> list[str]:
    facts = files.read_trial(trial)
    if not facts.regimes:  # another reality, which this program does not have
        return []
    by_rig: dict[tuple[str, ...], list[str]] = {}
    for case in sorted(key.cases, key=lambda name: _drawn(facts.key_sha256, name)):
        truth = key.cases[case]
        clear = truth.kind in {Kind.SINGLE, Kind.PAIR} and (level(truth) or 0.0) >= 2.0  # noqa: PLR2004 - a size
        if clear and truth.rung is Rung.WITHHELD:
            by_rig.setdefault(truth.rigs, []).append(case)
    turns = itertools.zip_longest(*by_rig.values())
    return [case for turn in turns for case in turn if case is not None][:CEILINGS]


def missing(trial: Path, tasks: Sequence[Task]) -> list[Task]:
    """Return the tasks with ways that have no answer yet, and of each task those ways alone."""
    found = []
    for task in tasks:
        ways = [way for way in task.asked.ways if not files.answer_file(trial, way.run.value, task.case).exists()]
        if ways:
            found.append(dataclasses.replace(task, asked=dataclasses.replace(task.asked, ways=tuple(ways))))
    return found


def seal(trial: Path) -> str:
    """Fix the blind answers before the key is opened, and return their hash.

    Raises:
        InputError: some are missing, or they are not those that were sealed when the key was first opened.

    """
    tasks = blind_tasks(trial)
    left = missing(trial, tasks)
    if left:
        msg = f"{_ways(left)} of {_ways(tasks)} diagnoses of {trial} are still to be made"
        msg += f"; run `python -m studies.blind run {trial}`"
        raise InputError(msg)
    digest = hashlib.sha256()
    for task in tasks:
        for way in sorted(task.asked.ways, key=lambda each: each.run.value):
            digest.update(f"{way.run.value}/{task.case}\n".encode())
            digest.update(files.answer_file(trial, way.run.value, task.case).read_bytes())
    found = digest.hexdigest()
    file = trial / files.ANSWERS / _SEAL
    if file.exists():
        sealed = files.read_json(file, "seal", "make the trial anew").get("sha256")
        if sealed != found:
            msg = f"answers in {trial} were changed after the key had been opened: they are not blind any more"
            msg = f"{msg}; make a new trial with another seed"
            raise InputError(msg)
    else:
        files.write_json(file, {"format": files.FORMAT, "sha256": found})
    return found


def _ways(tasks: Sequence[Task]) -> int:
    return sum(len(task.asked.ways) for task in tasks)


def _task(trial: Path, case: str, ways: Iterable[Way]) -> Task:
    folder = trial / files.CASES / case
    note = files.read_case(folder)
    asked = Questions(
        tuple((folder / bag).resolve() for bag in note.bags),
        tuple((folder / bag).resolve() for bag in note.references),
        note.rig,
        tuple(f"{typed_name(name)}={typed_value(name, value)}" for name, value in note.options.items()),
        # Those without references first: what must not look at them is answered before they are read.
        tuple(sorted(ways, key=lambda way: way.takes_references)),
    )
    return Task(case, asked)
