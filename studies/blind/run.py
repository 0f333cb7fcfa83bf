"""`python -m studies.blind run`: diagnose every case in a process of its own that is told of its bags and no more."""

from __future__ import annotations

import concurrent.futures
import contextlib
import functools
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jammkle_common import processes
from jammkle_common.command import results
from jammkle_common.command.errors import GraphError, InputError, Interrupted, StopRequest
from jammkle_common.command.results import progress_bar
from jammkle_gap.backend import backend
from studies.blind import files
from studies.blind.answers import refused
from studies.blind.key import check_apart, read_key
from studies.blind.questions import said_file, write_questions
from studies.blind.tasks import blind_tasks, missing, open_tasks, seal

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from studies.blind.questions import Way
    from studies.blind.tasks import Task

_POLL_S = 0.2
_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Linear algebra in one thread: with a process per core, threads that wait for one another took ten times as long."""
_SAY_EVERY_S = 60.0
"""How often progress is said where there is no terminal for a bar."""
_EXIT_INTERRUPTED = 130
_KEPT = {
    "verdict", "reasons", "effects", "set", "posterior", "conformal", "gap_probability", "p_value", "where",
    "subsystems", "gap", "classes", "silent", "calibration", "references_left", "next_experiment", "notes", "finished",
    "runtime", "baselines", "commit",
}  # fmt: skip
"""Of a diagnosis's JSON; the rest is in no figure."""
_QUESTIONS = "questions.json"
_ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class RunRequest:
    """One call of `python -m studies.blind run`."""

    folder: Path
    key: Path | None
    """If given: the key is opened, and what needs it is done too."""
    jobs: int | None
    scheduler: str | None


def run(request: RunRequest) -> int:
    """Diagnose what is left to diagnose, and return the exit code.

    Raises:
        InputError: the trial, the key or the scheduler cannot be used.
        GraphError: a diagnosis failed in a way that says nothing of its case.
        Interrupted: asked to stop; finished diagnoses are kept, those that are under way are made again.

    """
    if request.jobs is not None and request.jobs < 1:
        msg = f"--jobs {request.jobs} must be 1 or more"
        raise InputError(msg)
    facts = files.read_trial(request.folder)
    if request.key is not None:
        check_apart(request.key, request.folder)
    with backend(request.jobs, request.scheduler):
        pass  # a scheduler that does not answer says nothing of a case
    stop = StopRequest()
    _diagnose(request, blind_tasks(request.folder), "diagnosing", stop)
    if request.key is not None:
        seal(request.folder)
        key = read_key(request.key, facts.key_sha256)
        _diagnose(request, open_tasks(request.folder, key), "the key is open: oracle and effects left out", stop)
    results.console().print(f"every case of {request.folder} is diagnosed", markup=False)
    return 0


def _diagnose(request: RunRequest, tasks: Sequence[Task], title: str, stop: Callable[[], bool]) -> None:
    left = missing(request.folder, tasks)
    jobs = request.jobs or (1 if request.scheduler is not None else os.cpu_count() or 1)
    done, started, said = len(tasks) - len(left), time.monotonic(), time.monotonic()
    ended = contextlib.ExitStack()
    with ended, progress_bar(title) as show:
        pool = ended.enter_context(concurrent.futures.ThreadPoolExecutor(jobs))
        waiting = {pool.submit(_answer, request, task, stop) for task in left}
        ended.callback(lambda: [each.cancel() for each in waiting])
        while waiting:
            finished, waiting = concurrent.futures.wait(waiting, _POLL_S, concurrent.futures.FIRST_COMPLETED)
            for each in finished:
                each.result()
            done += len(finished)
            show(done / len(tasks), f"{done} of {len(tasks)} cases")
            if stop():
                raise Interrupted
            if finished and time.monotonic() - said > _SAY_EVERY_S and not sys.stderr.isatty():
                said = time.monotonic()
                left_s = (said - started) / max(done - len(tasks) + len(left), 1) * (len(tasks) - done)
                results.console().print(
                    f"{title}: {done} of {len(tasks)} cases, {left_s / 60.0:.0f} min left", markup=False
                )


def _answer(request: RunRequest, task: Task, stop: Callable[[], bool]) -> None:
    """Diagnose one case in a new process and keep what it says; if it refuses one way, ask for the rest in another."""
    left = [task]
    while left and not stop():
        with tempfile.TemporaryDirectory(prefix="jammkle_blind_") as name:
            folder = Path(name)
            write_questions(folder / _QUESTIONS, left[0].asked)
            code, said = _call(_command(request), folder, stop, functools.partial(_keep, request.folder, task, folder))
            _keep(request.folder, task, folder)
        left = missing(request.folder, left)
        if not left or stop():
            return
        if code < 0 or code == _EXIT_INTERRUPTED:
            msg = f"the diagnosis of case {task.case} was ended from outside (exit code {code}); run it again to go on"
            raise GraphError(msg)
        way = left[0].asked.ways[0]
        if code == 0:
            msg = f"the diagnosis of case {task.case} ended without an answer for {way.run.value}; run it again"
            raise GraphError(msg)
        _write_answer(request.folder, task, way, refused(said))
        left = missing(request.folder, left)


def _keep(trial: Path, task: Task, folder: Path) -> None:
    """Keep the answers that are there by now, and are not kept yet."""
    for way in task.asked.ways:
        made = said_file(folder, way.run)
        if made.exists():
            content = files.read_json(made, "answer", "see what the diagnosis printed")
            _write_answer(trial, task, way, {key: value for key, value in content.items() if key in _KEPT})
            made.unlink()


def _write_answer(trial: Path, task: Task, way: Way, content: Mapping[str, Any]) -> None:
    file = files.answer_file(trial, way.run.value, task.case)
    file.parent.mkdir(parents=True, exist_ok=True)
    files.write_json(file, content)


def _command(request: RunRequest) -> list[str]:
    words = processes.tied([sys.executable, "-m", "studies.blind"])
    words += ["answer", _QUESTIONS]
    return [*words, "--jobs", "1"] if request.scheduler is None else [*words, "--scheduler", request.scheduler]


def _call(
    command: Sequence[str], folder: Path, stop: Callable[[], bool], meanwhile: Callable[[], None]
) -> tuple[int, str]:
    """Return the exit code of a command, and the last line that it said to stderr."""
    with tempfile.TemporaryFile("w+", encoding="utf-8") as errors:
        # A session of its own: Ctrl-C would make the diagnosis end early with what it knows by then.
        process: Any = subprocess.Popen(  # noqa: S603 - this program itself
            command, cwd=folder, env=os.environ | _ONE_THREAD | {"PYTHONPATH": str(_ROOT)}, stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL, stderr=errors,
            start_new_session=True,
        )  # fmt: skip
        try:
            while process.poll() is None and not stop():
                time.sleep(_POLL_S)
                meanwhile()
        finally:
            process.kill()
            process.wait()
        errors.seek(0)
        lines = [line.strip() for line in errors if line.strip()]
    return int(process.returncode), (lines[-1] if lines else f"exit code {process.returncode}")
