"""What is to be diagnosed, in which ways: blind with references and without, and, once the key is open, the rest."""

from __future__ import annotations

import enum
import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_bringup.core.blind import files
from jammkle_bringup.core.blind.key import Kind
from jammkle_bringup.core.blind.outcomes import level
from jammkle_bringup.core.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from jammkle_bringup.core.blind.key import Key

_SEAL = "sealed.json"
_LEFT_OUT_FROM = 4.0
"""Size from which an effect is left out of the library: where it would be named."""


class Run(enum.Enum):
    """A way of diagnosing, and the folder of its answers."""

    WITH = "with_references"
    WITHOUT = "without_references"
    BASELINES = "baselines"
    """What simpler methods say, with references; as blind as the first two."""
    ORACLE = "oracle"
    """Only the true effects on offer: how far the gap can be closed."""
    LEFT_OUT = "left_out"
    """The true effect not on offer."""


BLIND = (Run.WITH, Run.WITHOUT, Run.BASELINES)
"""Those that need no key."""


@dataclass(frozen=True)
class Task:
    """One call of the diagnosis."""

    run: Run
    case: str
    bags: tuple[Path, ...]
    references: tuple[Path, ...]
    options: tuple[str, ...]
    """Further arguments."""


def blind_tasks(trial: Path) -> list[Task]:
    """Return all that can be done without the key, case by case."""
    return [_task(trial, run, case, ()) for case in files.case_names(trial) for run in BLIND]


def open_tasks(trial: Path, key: Key) -> list[Task]:
    """Return what is done with the key.

    The oracle is asked about every single effect and pair; an effect is left out in the largest of its cases.
    """
    found = []
    largest: dict[str, tuple[float, str]] = {}
    for case, truth in sorted(key.cases.items()):
        if truth.kind in {Kind.SINGLE, Kind.PAIR}:
            only = tuple(word for name in sorted(truth.names) for word in ("--only", name))
            found.append(_task(trial, Run.ORACLE, case, only))
        reached = level(truth)
        if truth.kind is Kind.SINGLE and reached is not None and reached >= _LEFT_OUT_FROM:
            name = next(iter(truth.names))
            largest[name] = max(largest.get(name, (0.0, "")), (truth.size or 0.0, case))
    found += [_task(trial, Run.LEFT_OUT, case, ("--without", name)) for name, (_, case) in sorted(largest.items())]
    return found


def missing(trial: Path, tasks: Sequence[Task]) -> list[Task]:
    """Return the tasks without an answer yet."""
    return [task for task in tasks if not files.answer_file(trial, task.run.value, task.case).exists()]


def seal(trial: Path) -> str:
    """Fix the blind answers before the key is opened, and return their hash.

    Raises:
        InputError: some are missing, or they are not those that were sealed when the key was first opened.

    """
    tasks = blind_tasks(trial)
    left = missing(trial, tasks)
    if left:
        msg = f"{len(left)} of {len(tasks)} diagnoses of {trial} are still to be made"
        msg += f"; run `jammkle gap blind run {trial}`"
        raise InputError(msg)
    digest = hashlib.sha256()
    for task in tasks:
        digest.update(f"{task.run.value}/{task.case}\n".encode())
        digest.update(files.answer_file(trial, task.run.value, task.case).read_bytes())
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


def _task(trial: Path, run: Run, case: str, options: tuple[str, ...]) -> Task:
    folder = trial / files.CASES / case
    note = files.read_case(folder)
    told: tuple[str, ...] = () if note.rig is None else ("--rig", note.rig)
    told += tuple(word for name, value in note.options.items() for word in ("--set", f"{name}={value}"))
    references = () if run is Run.WITHOUT else note.references
    return Task(
        run,
        case,
        tuple((folder / bag).resolve() for bag in note.bags),
        tuple((folder / bag).resolve() for bag in references),
        (*told, *options),
    )
