"""`jammkle gap session`: exercise, diagnose, and record what separates the remaining candidates, until one is named.

What was recorded stays in the folder, so that a session goes on where it was left: on a machine without a graph it says
what to record next, and the next call takes it up.

The design is adaptive, one run after the other, as in active model discrimination (Atkinson and Fedorov 1975,
Biometrika 62:289); each step is chosen by `jammkle_gap.core.design`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import typer

from jammkle_common.bags.contents import holds_a_bag
from jammkle_common.bags.run_sheet import RunSheet
from jammkle_common.bags.stopped import free_name, set_aside, was_stopped
from jammkle_common.command import EXERCISE, provided
from jammkle_common.command.errors import GraphError, InputError, StopRequest
from jammkle_common.command.results import folder_made, say
from jammkle_gap.ankle.problem import plans
from jammkle_gap.diagnosing import DiagnoseRequest, check, diagnose, recordings_of
from jammkle_sim.rigs.catalogue import EXERCISES

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from jammkle_gap.core.result import Diagnosis

_BRINGS_EXERCISES = "jammkle_bringup"


class _Recorder(Protocol):
    """`jammkle_bringup.exercise.exercise`."""

    def __call__(self, runs: Mapping[Path, RunSheet], namespace: str, asked_to_stop: Callable[[], bool]) -> None:
        """Do exercises on the live graph, and record each."""


@dataclass(frozen=True)
class SessionRequest:
    """One call of `jammkle gap session`."""

    folder: Path
    """Holds a bag per run, and gets the page and the corrected simulator."""
    namespace: str
    """Normalised namespace of the ankle."""
    further: int
    """Most runs after the first exercises, 0 or more."""
    json: Path | None
    jobs: int | None


def session(request: SessionRequest) -> Diagnosis:
    """Exercise, diagnose and go on, until one cause is named or nothing on offer would separate what is left.

    Raises:
        InputError: the folder holds something that is no bag of this machine, or an option cannot be used.
        GraphError: no robot is on the graph, and nothing is in the folder yet; or it refuses.
        Interrupted: stopped before anything was known.

    """
    if request.further < 0:
        msg = f"--further {request.further} must be 0 or more"
        raise InputError(msg)
    record: _Recorder = provided(EXERCISE, "record", _BRINGS_EXERCISES)
    stop = StopRequest()
    with folder_made(request.folder):
        check(_asked(request, []))
    _check_names(request.folder)
    _set_unfinished_aside(request.folder)
    bags = _bags_in(request.folder)
    there = {bag.name for bag in bags}
    missing = {request.folder / name: RunSheet(name, {}) for name in EXERCISES if name not in there}
    if missing:
        # before a robot moves for a minute and a half
        recordings_of(bags, None, _ankle(request), None, stop, request.jobs)
        say(
            f"first, the exercises {', '.join(each.rig for each in missing.values())}; where the robot is elsewhere, "
            f"`jammkle exercise NAME -o {request.folder}` records one there"
        )
        _record(record, missing, request, stop)
    done = 0
    while True:
        diagnosis = diagnose(_asked(request, _bags_in(request.folder)))
        following = diagnosis.next_experiment
        if following is None or not diagnosis.finished:
            say(_why_it_ends(diagnosis))
            return diagnosis
        if done == request.further:
            say(f"{done} further runs were made, as many as --further allows; `jammkle {following.name}` would be next")
            return diagnosis
        sheet = plans(EXERCISES)[following.name]
        say(f"next: jammkle {following.name}, {following.lasts_s:.0f} s: there, {following.sentence}")
        if not _may_go_on(request, stop):
            return diagnosis
        _record(record, {free_name(request.folder, sheet.rig): sheet}, request, stop)
        done += 1


def _bags_in(folder: Path) -> list[Path]:
    """Return the bags of a session, in the order of their names."""
    return sorted(each for each in folder.iterdir() if holds_a_bag(each))


def _check_names(folder: Path) -> None:
    """Refuse what is no bag, and stands where that of an exercise will be."""
    for bag in (folder / name for name in EXERCISES):
        is_empty = bag.is_dir() and not any(bag.iterdir())
        if bag.exists() and not is_empty and not holds_a_bag(bag):
            msg = f"{bag} is no bag, and has the name that the bag of an exercise will have: move it away"
            raise InputError(msg)


def _record(record: _Recorder, runs: Mapping[Path, RunSheet], request: SessionRequest, stop: StopRequest) -> None:
    try:
        record(runs, request.namespace, stop)
    except GraphError as error:
        msg = f"{error}; then call the session again: it goes on from {request.folder}"
        raise GraphError(msg) from error


def _set_unfinished_aside(folder: Path) -> None:
    """Move bags of exercises that were stopped on the way into a folder of their own: they are recorded anew."""
    of_exercises = re.compile(rf"({'|'.join(EXERCISES)})(_\d+)?")
    for bag in sorted(each for each in folder.iterdir() if each.is_dir() and of_exercises.fullmatch(each.name)):
        if was_stopped(bag):
            set_aside(bag)


def _ankle(request: SessionRequest) -> str | None:
    return None if request.namespace == "/" else request.namespace


def _asked(request: SessionRequest, bags: list[Path]) -> DiagnoseRequest:
    return DiagnoseRequest(
        bags, (), None, _ankle(request), None, request.folder, request.json, request.jobs, scheduler=None
    )


def _may_go_on(request: SessionRequest, stop: StopRequest) -> bool:
    """Return whether the next run may be made: a simulated robot moves by itself, a real one when a person says so."""
    try:
        simulated: bool = provided(EXERCISE, "is_simulated", _BRINGS_EXERCISES)(request.namespace, stop)
    except GraphError as error:
        say(f"{error}; start the robot, and call the session again: it goes on from {request.folder}")
        return False
    if simulated:
        return True
    return typer.confirm("The robot moves again. Is it ready, and nobody near it?", err=True)


def _why_it_ends(diagnosis: Diagnosis) -> str:
    """Return why nothing more is recorded."""
    if not diagnosis.finished:
        return "stopped: call the session again to go on"
    if len([each for each in diagnosis.candidates if each.names]) > 1:
        return "no exercise on offer would separate what is left: look at each of them"
    return "nothing is left to separate"
