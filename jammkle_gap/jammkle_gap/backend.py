"""Where the runs of a diagnosis happen: the cores of this machine, or a Dask cluster."""

from __future__ import annotations

import contextlib
import importlib
import os
import signal
import threading
import warnings
from typing import TYPE_CHECKING, Any

import joblib  # type: ignore[import-untyped]  # carries no types
from joblib.externals.loky import reusable_executor  # type: ignore[import-untyped]  # carries no types

from jammkle_common.command.errors import InputError
from jammkle_common.processes import end_with_parent

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

ANSWER_S = 10.0
"""How long a scheduler may take to answer."""
_ALL = -1


def check_jobs(jobs: int | None) -> None:
    """Refuse a number of processes that there cannot be.

    Raises:
        InputError: it is below 1.

    """
    if jobs is not None and jobs < 1:
        msg = f"--jobs {jobs} must be 1 or more"
        raise InputError(msg)


def in_stages(
    update: Callable[[float, str], None], stages: Mapping[str, tuple[float, float]]
) -> Callable[[str, float], None]:
    """Return what takes the share of a stage that is done, and reports that of the whole, which never falls."""
    furthest = 0.0

    def on_progress(stage: str, share: float) -> None:
        nonlocal furthest
        begin, end = stages.get(stage, (furthest, furthest))
        furthest = max(furthest, begin + share * (end - begin))
        update(furthest, stage)

    return on_progress


@contextlib.contextmanager
def backend(jobs: int | None, scheduler: str | None) -> Iterator[int]:
    """Have what joblib runs in the block run where it was asked for.

    Args:
        jobs: Processes; None: one per core.
        scheduler: Address of a Dask scheduler, such as tcp://10.0.0.2:8786; None takes this machine.

    Yields:
        The `jobs` to hand on to joblib.

    Raises:
        InputError: Dask is not installed, or the scheduler does not answer.

    """
    # Whoever stops on the way knows that not everything was done.
    warnings.filterwarnings("ignore", "[0-9]+ tasks (which were still|have been successfully)", UserWarning)
    # A worker that waited for long, or has grown, is replaced: nothing is lost, and nobody need do anything.
    warnings.filterwarnings("ignore", "A worker stopped while some jobs were given", UserWarning)
    if scheduler is None:
        config = joblib.parallel_config("loky", initializer=_start_worker, initargs=(os.getpid(),))
        with _without_complaints(), config:
            try:
                yield _ALL if jobs is None else jobs
            except BaseException:
                # Workers that still run at the end of the process leave complaints of its resource tracker. Not by
                # get_reusable_executor(): it waits for its thread under a lock that this may wait for as well.
                if (executor := reusable_executor._executor) is not None:  # noqa: SLF001 - see above
                    executor.shutdown(wait=True, kill_workers=True)
                raise
        return
    with _client(scheduler), joblib.parallel_config("dask"):
        yield _ALL if jobs is None else jobs


@contextlib.contextmanager
def _without_complaints() -> Iterator[None]:
    """Have joblib's thread that hands out runs say nothing as it dies of a stop: it looks for runs that are gone."""
    before = threading.excepthook

    def tell(died: threading.ExceptHookArgs) -> None:
        if died.thread is None or died.thread.name != "ExecutorManagerThread":
            before(died)

    threading.excepthook = tell
    try:
        yield
    finally:
        threading.excepthook = before


def _client(scheduler: str) -> Any:
    try:
        distributed = importlib.import_module("distributed")  # an extra that most users do not have
    except ImportError as error:
        msg = f"--scheduler {scheduler} needs Dask, which is not installed; run: pip install distributed"
        raise InputError(msg) from error
    try:
        return distributed.Client(scheduler, timeout=ANSWER_S)
    except (OSError, ValueError) as error:  # a timeout is an OSError
        msg = f"--scheduler {scheduler} does not answer; give the address that `dask scheduler` printed"
        raise InputError(msg) from error


def _start_worker(parent: int) -> None:
    # Ctrl-C reaches the whole group; the parent decides what becomes of it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent(parent)
