"""What was measured: signals, phases and recordings."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


class BadRecordingError(ValueError):
    """A recording cannot be used; the message says what is wrong and what to record instead."""


@dataclass(frozen=True)
class Signal:
    """One measured quantity over time."""

    name: str
    """Unique within its recording, such as `achilles/pressure`."""
    unit: str
    time_s: NDArray[np.float64]
    """Since the start of the recording, rising, shape (n,), s."""
    values: NDArray[np.float64]
    """Shape (n,), in `unit`."""
    noise: float = 0.0
    """Standard deviation from sample to sample by the data sheet, in `unit`. 0, and no resolution: estimated from
    neighbouring samples."""
    resolution: float = 0.0
    """Smallest step of the sensor, in `unit`; 0: fine enough not to matter. Averaging does not remove its error."""

    @property
    def deviation(self) -> float:
        """Standard deviation of one reading, in `unit`: noise and rounding; 0 where neither is known."""
        return math.hypot(self.noise, self.resolution / math.sqrt(12.0))

    def __post_init__(self) -> None:
        """Check the shapes.

        Raises:
            BadRecordingError: empty, of different lengths, not finite, or time that does not rise.

        """
        if self.time_s.ndim != 1 or self.time_s.shape != self.values.shape or self.time_s.size == 0:
            msg = f"signal '{self.name}' has times of shape {self.time_s.shape} and values of shape {self.values.shape}"
            msg = f"{msg}; both must be (n,) with n of 1 or more"
            raise BadRecordingError(msg)
        if not (np.isfinite(self.time_s).all() and np.isfinite(self.values).all()):
            bad = int(np.argmax(~(np.isfinite(self.time_s) & np.isfinite(self.values))))
            msg = f"signal '{self.name}' is not a finite number at sample {bad}; leave such samples out"
            raise BadRecordingError(msg)
        if (np.diff(self.time_s) <= 0.0).any():
            bad = int(np.argmax(np.diff(self.time_s) <= 0.0)) + 1
            msg = f"signal '{self.name}' has a time that does not rise at sample {bad} ({self.time_s[bad]:g} s)"
            raise BadRecordingError(msg)


@dataclass(frozen=True)
class Phase:
    """A stretch of a recording with a name, such as `evacuating`; phases may not overlap within a signal."""

    name: str
    start_s: float
    end_s: float
    signals: tuple[str, ...] = ()
    """Signals that it applies to; empty: all."""


@dataclass(frozen=True)
class Recording:
    """One run of one machine."""

    name: str
    signals: tuple[Signal, ...]
    inputs: Any = None
    """What the simulator needs to run it again: commands, start, options. The core never looks at it."""
    phases: tuple[Phase, ...] = ()
    setting: str = ""
    """What the machine was made to do. Recordings of the same setting are repeats; empty: a setting of its own."""
    notes: tuple[str, ...] = field(default=())
    """What the reader should know: signals that are missing, things that were repaired."""

    def signal(self, name: str) -> Signal:
        """Return one signal.

        Raises:
            KeyError: there is none of this name.

        """
        for signal in self.signals:
            if signal.name == name:
                return signal
        raise KeyError(name)

    @property
    def duration_s(self) -> float:
        """Time of the last sample of any signal, s."""
        return max(float(signal.time_s[-1]) for signal in self.signals)
