"""What holds for every test: packages are imported first, examples are the same ones, the environment is given back."""

from __future__ import annotations

import contextlib
import importlib
import os
import signal
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from collections.abc import Iterator

for _library in ("OPENBLAS", "OMP", "MKL"):  # read as they are loaded, also by every process that a test starts
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")
"""Linear algebra in one thread: where others want the cores too, threads wait for one another."""

# Else pytest's importlib mode takes the folder of the same name around a package instead. What is not built is left
# out: `colcon test` may see no more than one package and what that depends on.
for _package in (
    "jammkle_common",
    "jammkle_msgs",
    "jammkle_driver",
    "jammkle_controller",
    "jammkle_sim",
    "jammkle_gap",
    "jammkle_view",
    "jammkle_bringup",
):
    with contextlib.suppress(ModuleNotFoundError):
        importlib.import_module(_package)


@pytest.hookimpl(tryfirst=True)
def pytest_configure() -> None:
    """Let hypothesis draw the same examples in every run, and count no time.

    A run that fails then fails again; whoever wants others gives `--hypothesis-profile=default`.
    """
    settings.register_profile("jammkle", derandomize=True, database=None, deadline=None)
    settings.load_profile("jammkle")


@pytest.fixture(autouse=True)
def _environment() -> Iterator[None]:
    """Give every test environment and handlers of signals back: a process of ours chooses its own when it starts."""
    before = dict(os.environ)
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    yield
    os.environ.clear()
    os.environ.update(before)
    for number, handler in handlers.items():
        if signal.getsignal(number) is not handler:
            signal.signal(number, handler)
