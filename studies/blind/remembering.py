"""A simulator that remembers: all diagnoses of a case ask for the same runs, again and by different sensors."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from numpy.typing import NDArray

    from jammkle_gap.core.data import Recording
    from jammkle_gap.core.simulate import Simulator


class Remembering:
    """Runs every recording with all of its signals, and keeps what came of it."""

    def __init__(self, simulator: Simulator) -> None:
        """Take the simulator; `know` tells it the recordings."""
        self._simulator = simulator
        self._whole: dict[str, Recording] = {}
        self._known: dict[tuple[str, tuple[tuple[str, float], ...]], dict[str, NDArray[np.float32]]] = {}

    def __getstate__(self) -> dict[str, object]:
        """Travel to other processes without what is known: it would be sent with every run."""
        return self.__dict__ | {"_known": {}}

    def know(self, recordings: Iterable[Recording]) -> None:
        """Take recordings with all of their signals; their names differ."""
        self._whole |= {each.name: each for each in recordings}

    def __call__(self, recording: Recording, values: Mapping[str, float]) -> Mapping[str, NDArray[np.float64]]:
        """Run again what was commanded; see `core.simulate.Simulator`."""
        whole = self._whole.get(recording.name)
        if whole is None:
            return self._simulator(recording, values)
        place = (recording.name, tuple(sorted(values.items())))
        if place not in self._known:
            made = self._simulator(whole, values)
            # Single precision rounds to a ten-millionth: far below the noise of any sensor.
            self._known[place] = {name: np.asarray(each, dtype=np.float32) for name, each in made.items()}
        return {name: each.astype(float) for name, each in self._known[place].items()}
