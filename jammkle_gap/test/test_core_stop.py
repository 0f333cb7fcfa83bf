"""A diagnosis that is asked to stop ends in the middle of a run, here and in other processes."""

from __future__ import annotations

import os
import signal
import time
from typing import TYPE_CHECKING, cast

import pytest

from jammkle_common.command.errors import StopRequest
from jammkle_gap.backend import backend
from jammkle_gap.core.simulate import Problem, Runner, StoppedError

if TYPE_CHECKING:
    from collections.abc import Iterator

LONG_S = 60.0


@pytest.fixture
def stop() -> Iterator[StopRequest]:
    """Return a request to stop, and give the signals back to the tests after."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(number) for number in numbers]
    yield StopRequest()
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_stop_ends_a_long_run_and_keeps_what_was_done(
    jobs: int, stop: StopRequest, capfd: pytest.CaptureFixture[str]
) -> None:
    """Without a word of whatever spread the runs. The third takes long, and Ctrl-C comes in its middle."""

    def run(number: int, asking: int) -> int:
        if number == 2:
            os.kill(asking, signal.SIGINT)
            time.sleep(LONG_S)
        return number

    began_s = time.monotonic()
    with backend(jobs, None), pytest.raises(StoppedError) as stopped:
        Runner(cast("Problem", _Sendable()), jobs, stop=stop).map(run, [(number, os.getpid()) for number in range(6)])
    assert time.monotonic() - began_s < LONG_S / 2.0
    done = stopped.value.done
    assert done == (0, 1)[: len(done)]  # what another process has done may be on its way yet
    assert jobs > 1 or len(done) == 2
    assert not capfd.readouterr().err


class _Sendable:
    simulator = alignment = None
