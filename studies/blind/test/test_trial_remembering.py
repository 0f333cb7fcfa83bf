"""What a case simulated is kept for its other ways of diagnosing."""

from __future__ import annotations

import pickle
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_gap import Recording, Signal
from studies.blind.remembering import Remembering

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

TIMES_S = 0.01 * np.arange(200)


class Counted:
    """A spring that bends as the square of its stiffness. Counts its runs."""

    def __init__(self) -> None:
        self.asked: list[dict[str, float]] = []

    def __call__(self, recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        del recording
        self.asked.append(dict(values))
        return {"way": np.sin(TIMES_S) / values.get("spring.stiffness", 1.0) ** 2}


def test_what_was_simulated_is_remembered_but_does_not_travel() -> None:
    """A run is made once; another process is not sent what is known."""
    simulator = Counted()
    remembering, recording = (
        Remembering(simulator),
        Recording("one", (Signal("way", "m", TIMES_S, np.sin(TIMES_S)),), setting="alone"),
    )
    remembering.know([recording])
    first, second = (remembering(recording, {"spring.stiffness": 1.1}) for _ in range(2))
    assert len(simulator.asked) == 1
    assert first["way"] == pytest.approx(second["way"])
    light, heavy = len(pickle.dumps(Remembering(Counted()))), len(pickle.dumps(remembering))
    assert heavy < light + len(pickle.dumps((recording, simulator.asked)))
