"""A simulator that remembers what it said, where the same recordings are diagnosed in several ways."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import numpy as np
    from numpy.typing import NDArray

    from jammkle_gap.november.recording import Recording
    from jammkle_gap.november.simulator import RestartingSimulator

MOST_BYTES = 400_000_000
"""What is remembered at most; after that runs are made again. The first ones are the probes, which all ways share."""

_Said = dict[str, "NDArray[np.float64]"]


class Remembering:
    """Fulfils `gap.simulator.RestartingSimulator`; a copy that is sent to another process begins with nothing."""

    def __init__(self, simulator: RestartingSimulator, most_bytes: int = MOST_BYTES) -> None:
        """Remember what a simulator says.

        Args:
            simulator: Says the same of the same signals, inputs and values, whatever noise they are given.
            most_bytes: What is remembered at most.

        """
        self._simulator = simulator
        self._most_bytes = most_bytes
        self._bytes = 0
        self._said: dict[tuple[str, float, frozenset[tuple[str, float]]], _Said] = {}
        self._known: dict[int, tuple[Recording, str]] = {}

    def __reduce__(self) -> tuple[type[Remembering], tuple[RestartingSimulator, int]]:
        """Leave behind what is remembered."""
        return type(self), (self._simulator, self._most_bytes)

    def __call__(self, recording: Recording, values: Mapping[str, float]) -> _Said:
        """Run a recording, if it was not run so before."""
        return self._remembered(recording, values, float("inf"), lambda: self._simulator(recording, values))

    def restarted(self, recording: Recording, values: Mapping[str, float], horizon_s: float) -> _Said:
        """Run a recording from the measured state again and again, if it was not run so before."""
        return self._remembered(
            recording, values, horizon_s, lambda: self._simulator.restarted(recording, values, horizon_s)
        )

    def _remembered(
        self,
        recording: Recording,
        values: Mapping[str, float],
        horizon_s: float,
        make: Callable[[], Mapping[str, NDArray[np.float64]]],
    ) -> _Said:
        key = self._told(recording), horizon_s, frozenset(values.items())
        if key in self._said:
            return dict(self._said[key])
        made = dict(make())
        size = sum(each.nbytes for each in made.values())
        if self._bytes + size <= self._most_bytes:
            self._bytes += size
            self._said[key] = made
        return dict(made)

    def _told(self, recording: Recording) -> str:
        """Return what tells a recording from others: all but what counts as its noise."""
        # The recording is kept too: else another one might come to have its id.
        known = self._known.get(id(recording))
        if known is None:
            digest = hashlib.blake2b(repr((recording.name, getattr(recording.inputs, "key", ""))).encode())
            for signal in recording.signals:
                digest.update(signal.name.encode())
                digest.update(signal.time_s.tobytes())
                digest.update(signal.values.tobytes())
            known = self._known[id(recording)] = recording, digest.hexdigest()
        return known[1]
