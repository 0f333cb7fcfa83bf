"""What is simulated once is not simulated again, and what differs is."""

from __future__ import annotations

import dataclasses
import pickle
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_gap.november.recording import Recording, Signal
from jammkle_gap.november.remembering import Remembering

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

TIME_S = 0.01 * np.arange(100)


class Counting:
    """A simulator that counts how often it is asked."""

    def __init__(self) -> None:
        self.asked = 0

    def __call__(self, recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        self.asked += 1
        return {"x": float(values.get("push.size", 0.0)) + recording.signal("x").values}

    def restarted(
        self, recording: Recording, values: Mapping[str, float], horizon_s: float
    ) -> dict[str, NDArray[np.float64]]:
        self.asked += 1
        return {"x": horizon_s + self(recording, values)["x"]}


def run(offset: float = 0.0, name: str = "run") -> Recording:
    return Recording(name, (Signal("x", "m", TIME_S, TIME_S + offset, 0.01),))


@pytest.fixture
def counting() -> Counting:
    return Counting()


def test_the_same_is_asked_once(counting: Counting) -> None:
    simulator, recording = Remembering(counting), run()
    first = simulator(recording, {"push.size": 0.2})
    second = simulator(recording.with_noise({"x": 0.5}), {"push.size": 0.2})
    np.testing.assert_array_equal(first["x"], second["x"])
    assert counting.asked == 1


@pytest.mark.parametrize("other", [run(offset=1e-9), run(name="another"), dataclasses.replace(run(), inputs=None)])
def test_something_else_is_asked_anew(counting: Counting, other: Recording) -> None:
    simulator = Remembering(counting)
    simulator(run(), {})
    simulator(other, {"push.size": 0.1})
    simulator(other, {"push.size": 0.2})
    assert counting.asked == 3


def test_every_horizon_is_another_run(counting: Counting) -> None:
    simulator, recording = Remembering(counting), run()
    near, far = (simulator.restarted(recording, {}, horizon_s)["x"] for horizon_s in (0.1, 1.0))
    whole = simulator(recording, {})["x"]
    assert np.allclose(near - whole, 0.1)
    assert np.allclose(far - whole, 1.0)


def test_it_forgets_what_does_not_fit(counting: Counting) -> None:
    """And says the same all the same."""
    simulator, recording = Remembering(counting, most_bytes=TIME_S.nbytes), run()
    for size in (0.1, 0.2, 0.2, 0.1):
        assert np.allclose(simulator(recording, {"push.size": size})["x"], TIME_S + size)
    assert counting.asked == 3


def test_who_changes_an_answer_changes_no_other(counting: Counting) -> None:
    simulator, recording = Remembering(counting), run()
    simulator(recording, {}).clear()
    assert "x" in simulator(recording, {})


def test_a_copy_for_another_process_begins_with_nothing(counting: Counting) -> None:
    simulator = Remembering(counting)
    before = len(pickle.dumps(simulator))
    for size in range(20):
        simulator(run(), {"push.size": float(size)})
    # The counter itself grows by nothing: a number.
    assert len(pickle.dumps(simulator)) == before
