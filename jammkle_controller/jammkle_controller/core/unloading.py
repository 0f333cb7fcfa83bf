"""Lift-off as a body feels it whose legs never all leave the ground: pushed up, then let down."""

from __future__ import annotations

from dataclasses import dataclass

from jammkle_graph.constants import NANOSECONDS_PER_SECOND

PUSH = 1.15
"""Load of a push-off, in units of gravity: a body that is to leave must first be thrown up."""
PUSH_VALID_S = 0.35
"""How long ago the push may be, s: a stance of a slow trot."""
WALKING_S = 1.5
"""A body walks if it was hit twice within this time without a flight in between, s: two strides of 0.7 s. One that
stands and sways, or rebounds from a landing, is not vented."""

HITS = 2


@dataclass(frozen=True)
class UnloadingSettings:
    """Load, in units of gravity, below which a walking body is unloaded, and for how long, s."""

    unloaded_load: float
    unloading_confirm_s: float


class UnloadingDetector:
    """Reports that the legs of a walking body carry little: between two impacts, after a push."""

    def __init__(self, settings: UnloadingSettings) -> None:
        """Make a detector that has seen nothing."""
        self.settings = settings
        self._pushed_ns: int | None = None
        self._since_ns: int | None = None
        self._hits_ns: tuple[int, ...] = ()

    def hit(self, time_ns: int, *, flew: bool) -> None:
        """Note an impact, and whether it ended a free fall."""
        self._hits_ns = () if flew else (*self._hits_ns[-1:], time_ns)

    def forget(self) -> None:
        """Forget all: the time line is another one."""
        self._hits_ns = ()
        self.restart()

    def restart(self) -> None:
        """Forget the push."""
        self._pushed_ns = self._since_ns = None

    def on_ground(self, time_ns: int, load: float) -> float | None:
        """Take the next load, in units of gravity; return for how long it is unloaded, s.

        None: it is not, or it is no lift-off.
        """
        if load > PUSH:
            self._pushed_ns = time_ns
        if load > self.settings.unloaded_load:
            self._since_ns = None
            return None
        if self._since_ns is None:
            self._since_ns = time_ns
        unloaded_s = (time_ns - self._since_ns) / NANOSECONDS_PER_SECOND
        if unloaded_s < self.settings.unloading_confirm_s or len(self._hits_ns) < HITS or self._pushed_ns is None:
            return None
        walks = (time_ns - self._hits_ns[0]) / NANOSECONDS_PER_SECOND < WALKING_S
        pushed = (self._since_ns - self._pushed_ns) / NANOSECONDS_PER_SECOND < PUSH_VALID_S
        return unloaded_s if walks and pushed else None
