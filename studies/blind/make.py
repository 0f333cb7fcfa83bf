"""`python -m studies.blind make`: write the bags of a trial and, elsewhere, its key, and publish the key's hash."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import joblib  # type: ignore[import-untyped]  # carries no types

from jammkle_common.bags.definitions import MessageDefinitions, share_folders
from jammkle_common.command import results
from jammkle_common.command.errors import InputError, Interrupted, StopRequest
from jammkle_common.command.results import commit, progress_bar
from jammkle_common.constants import MAX_SEED
from jammkle_gap.ankle.effects import ankle_library
from jammkle_gap.backend import backend
from studies.blind import files
from studies.blind.bags import RunWriter
from studies.blind.key import Key, Rung, check_apart, new_salt, truth_as_dict, truth_of, write_key
from studies.blind.making import Maker
from studies.blind.plan import plan_cases
from studies.blind.regimes import regime_name, rigs
from studies.blind.sources import Reality, Simulator

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from studies.blind.plan import CasePlan

MOST_CASES, MOST_LIVE = 9999, 99


@dataclass(frozen=True)
class MakeRequest:
    """One call of `python -m studies.blind make`."""

    seed: int
    cases: int
    folder: Path
    key: Path
    jobs: int | None
    rigs: Sequence[str] = ()
    """Only these; empty: all."""
    live: int = 0
    """Further cases, from the live graph."""


def default_key(folder: Path) -> Path:
    """Return where the key of a trial goes if nobody says: beside its folder."""
    resolved = folder.resolve()
    return resolved.with_name(f"{resolved.name}_key.json")


def make(request: MakeRequest) -> int:
    """Make a trial, or go on where it was stopped, and return the exit code.

    Raises:
        InputError: something cannot be as asked for.
        Interrupted: asked to stop; what is made stays.

    """
    _check(request)
    stop = StopRequest()
    reality = Reality()
    recorded = tuple(rig for rig in rigs() if rig in reality.rigs and rig in (request.rigs or reality.rigs))
    simulator = Simulator(ankle_library(), recorded)
    plan = plan_cases(
        request.seed,
        request.cases,
        recorded,
        [each.fact for each in reality.faults.values()],
        [each.fact for each in simulator.faults.values()],
    )
    notes = _Notes(request)
    left = [case for case in plan if not notes.has(case.name)]
    done = len(plan) - len(left)
    with backend(request.jobs, None) as jobs, progress_bar("making cases") as show:
        parallel = joblib.Parallel(n_jobs=-1 if jobs is None else jobs, return_as="generator_unordered")
        tasks = (joblib.delayed(_make_case)(request.seed, recorded, case, request.folder) for case in left)
        for name, truth in parallel(tasks):
            notes.add(name, truth)
            done += 1
            show(done / len(plan), f"{done} of {len(plan)}")
            if stop():
                raise Interrupted
    _make_live(request, notes, stop)
    sha256 = write_key(request.key, notes.key())
    facts = files.TrialFacts(sha256, request.seed, commit(), regime_name(request.seed))
    files.write_trial(request.folder, facts)
    notes.remove()
    console = results.console()
    console.print(f"{len(plan) + request.live} cases are in {request.folder}, the key is {request.key}", markup=False)
    console.print(f"hash of the key: {sha256}", markup=False)
    return 0


def _make_live(request: MakeRequest, notes: _Notes, stop: StopRequest) -> None:
    """Record cases from the live graph, one after the other: each takes what real time takes."""
    if not request.live:
        return
    # Starts ROS, which only these cases need.
    from studies.blind.live import LiveCase  # noqa: PLC0415

    for number in range(request.live):
        case = LiveCase(request.seed, number)
        if notes.has(case.name):
            continue
        place = request.folder / files.CASES / case.name
        shutil.rmtree(place, ignore_errors=True)
        (place / files.BAGS).mkdir(parents=True)
        note, truth = case.make(place, stop)
        files.write_case(place, note)
        notes.add(case.name, truth_as_dict(truth))


def _check(request: MakeRequest) -> None:
    if not 0 <= request.seed <= MAX_SEED:
        msg = f"--seed {request.seed} must be 0 to {MAX_SEED}"
        raise InputError(msg)
    if not 1 <= request.cases <= MOST_CASES:
        msg = f"--cases {request.cases} must be 1 to {MOST_CASES}"
        raise InputError(msg)
    if request.jobs is not None and request.jobs < 1:
        msg = f"--jobs {request.jobs} must be 1 or more"
        raise InputError(msg)
    if not 0 <= request.live <= MOST_LIVE:
        msg = f"--live {request.live} must be 0 to {MOST_LIVE}"
        raise InputError(msg)
    unknown = [rig for rig in request.rigs if rig not in rigs()]
    if unknown:
        msg = f"--rig '{unknown[0]}' is not recorded in trials; known are: {', '.join(rigs())}"
        raise InputError(msg)
    check_apart(request.key, request.folder)
    results.check_writable(request.key, "--key")
    if request.key.exists():
        msg = f"--key {request.key} exists: nothing is overwritten; choose another one or move it away"
        raise InputError(msg)
    if (request.folder / files.TRIAL_NAME).exists():
        msg = f"folder {request.folder} holds a trial already"
        msg += ": diagnose it with `python -m studies.blind run`, or choose another folder"
        raise InputError(msg)
    try:
        (request.folder / files.CASES).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        msg = f"folder {request.folder} cannot be made: {error.strerror}"
        raise InputError(msg) from error


class _Notes:
    """What is made so far, in a file beside the key, so that a trial goes on where it was stopped."""

    def __init__(self, request: MakeRequest) -> None:
        self._file = request.key.with_name(f"{request.key.name}.part")
        self._cases = request.folder / files.CASES
        wanted = {"seed": request.seed, "cases": request.cases, "rigs": list(request.rigs), "live": request.live}
        self._truths: dict[str, Any] = {}
        if self._file.exists():
            header, *lines = [json.loads(line) for line in self._file.read_text(encoding="utf-8").splitlines()]
            self._salt = str(header.pop("salt"))
            if header != wanted:
                msg = (
                    f"{self._file} belongs to a trial that was begun otherwise ({header}); remove it and {self._cases}"
                )
                raise InputError(msg)
            self._truths = {line["case"]: line["truth"] for line in lines}
        else:
            self._salt = new_salt()
            self._file.touch(mode=0o600)
            self._append({**wanted, "salt": self._salt})

    def has(self, case: str) -> bool:
        return case in self._truths and (self._cases / case / files.CASE_NAME).exists()

    def add(self, case: str, truth: dict[str, Any]) -> None:
        self._truths[case] = truth
        self._append({"case": case, "truth": truth})

    def key(self) -> Key:
        return Key({name: truth_of(name, truth) for name, truth in self._truths.items()}, self._salt)

    def remove(self) -> None:
        self._file.unlink()

    def _append(self, line: dict[str, Any]) -> None:
        with self._file.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line, allow_nan=False) + "\n")


@lru_cache(maxsize=4)
def _maker(rung: Rung, seed: int, recorded: tuple[str, ...]) -> Maker:
    """Return what makes cases in this process; it remembers what every case needs."""
    source = Simulator(ankle_library(), recorded) if rung is Rung.KNOWN else Reality()
    return Maker(source, seed)


@lru_cache(maxsize=1)
def _writer() -> RunWriter:
    return RunWriter(MessageDefinitions(share_folders()))


def _make_case(seed: int, recorded: tuple[str, ...], case: CasePlan, folder: Path) -> tuple[str, dict[str, Any]]:
    """Make one case and write its bags; whatever is left of an earlier try is removed."""
    made = _maker(case.rung, seed, recorded).make(case)
    place = folder / files.CASES / case.name
    shutil.rmtree(place, ignore_errors=True)
    (place / files.BAGS).mkdir(parents=True)
    named = {
        f"{files.BAGS}/{kind}_{number}": run
        for kind, runs in (("run", made.runs), ("healthy", made.references))
        for number, run in enumerate(runs, start=1)
    }
    for name, run in named.items():
        _writer().write(run, place / name)
    bags = tuple(named)
    files.write_case(place, files.CaseNote(bags[: len(made.runs)], bags[len(made.runs) :]))
    return case.name, truth_as_dict(made.truth)
