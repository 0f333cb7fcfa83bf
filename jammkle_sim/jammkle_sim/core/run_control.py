"""Whether simulated time moves: running, paused, stepping or failed, and which wishes are refused when."""

from __future__ import annotations

import enum

MAX_STEPS = 100_000
"""Most steps of one request, as jammkle_msgs/Step says; 50 s of simulated time at 0.5 ms."""


class RunState(enum.Enum):
    """What simulated time does."""

    RUNNING = "running"
    PAUSED = "paused"
    STEPPING = "stepping"
    """Paused, and taking a number of steps that somebody asked for."""
    FAILED = "failed"
    """Paused because the simulation became unstable; only a reset helps."""


class RefusedError(Exception):
    """A wish that cannot be granted now. The message names the state, or the value and its limit, and the way out."""


class RunControl:
    """State machine of the simulated time."""

    def __init__(self, *, start_paused: bool) -> None:
        """Start running, or paused."""
        self._state = RunState.PAUSED if start_paused else RunState.RUNNING
        self._steps_left = 0
        self._failure = ""

    @property
    def state(self) -> RunState:
        """What simulated time does."""
        return self._state

    @property
    def steps_left(self) -> int:
        """Steps still to take while stepping, else 0."""
        return self._steps_left

    @property
    def failure(self) -> str:
        """Why the simulation failed, in one line; empty if it did not."""
        return self._failure

    def pause(self) -> None:
        """Stop simulated time; nothing changes if it stands already.

        Raises:
            RefusedError: steps are being taken, which ends in a pause anyway.

        """
        self._refuse_while_stepping("pause")
        if self._state is RunState.RUNNING:
            self._state = RunState.PAUSED

    def resume(self) -> None:
        """Let simulated time run; nothing changes if it runs already.

        Raises:
            RefusedError: steps are being taken, or the simulation has failed.

        """
        self._refuse_while_stepping("resume")
        self._refuse_after_failure("resume")
        self._state = RunState.RUNNING

    def begin_steps(self, steps: int) -> None:
        """Take steps while paused.

        Args:
            steps: How many, 1 to MAX_STEPS.

        Raises:
            RefusedError: the number is out of range, or simulated time is not paused.

        """
        self._refuse_while_stepping("step")
        self._refuse_after_failure("step")
        if self._state is RunState.RUNNING:
            msg = "cannot step while running; pause first with ~/set_paused"
            raise RefusedError(msg)
        if not 1 <= steps <= MAX_STEPS:
            msg = f"steps is {steps}; it must be 1 to {MAX_STEPS}; ask several times for more"
            raise RefusedError(msg)
        self._steps_left = steps
        self._state = RunState.STEPPING

    def steps_taken(self, steps: int) -> None:
        """Note that steps were taken; the last one ends in a pause."""
        if self._state is RunState.STEPPING:
            self._steps_left -= steps
            if self._steps_left <= 0:
                self._steps_left = 0
                self._state = RunState.PAUSED

    def fail(self, why: str) -> None:
        """Stop simulated time for good, until a reset."""
        self._state = RunState.FAILED
        self._steps_left = 0
        self._failure = why

    def reset(self) -> None:
        """Forget a failure, and stay paused after it; else go on as before.

        Raises:
            RefusedError: steps are being taken.

        """
        self._refuse_while_stepping("reset")
        if self._state is RunState.FAILED:
            self._state = RunState.PAUSED
        self._failure = ""

    def _refuse_while_stepping(self, wish: str) -> None:
        if self._state is RunState.STEPPING:
            msg = f"cannot {wish} while {self._steps_left} steps are still to take; wait for the answer of ~/step"
            raise RefusedError(msg)

    def _refuse_after_failure(self, wish: str) -> None:
        if self._state is RunState.FAILED:
            msg = f"cannot {wish}: {self._failure}; call ~/reset"
            raise RefusedError(msg)
