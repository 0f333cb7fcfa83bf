"""What following one subsystem gives, and what is asked of those that follow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from jammkle_gap.monitor.core.subsystem import Subsystem
    from jammkle_gap.monitor.core.tracks import Tracks


@dataclass(frozen=True)
class Residual:
    """Measured less simulated of one signal in one phase of a stretch."""

    signal: str
    phase: str
    scaled: NDArray[np.float64]
    """In units of the noise, shape (n,)."""


@dataclass(frozen=True)
class Stretch:
    """A stretch of time on the robot's clock, s; the first moment is not part of it, the last one is."""

    begin_s: float
    end_s: float


class Follower(Protocol):
    """One subsystem, simulated from its measured inputs stretch after stretch."""

    @property
    def subsystem(self) -> Subsystem:
        """Which one."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """Topics that it cannot do without."""

    def begin(self, tracks: Tracks, time_s: float) -> None:
        """Start from what is measured at a time, whatever was before."""

    def follow(self, tracks: Tracks, stretch: Stretch) -> list[Residual]:
        """Simulate a stretch, which begins where the last one ended, and compare. All inputs are there."""
