"""Recordings and effects that are at the edge of what a diagnosis is made for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_gap.november.diagnosis import diagnose
from jammkle_gap.november.effect import Effect, EffectParameter, Library
from jammkle_gap.november.experiments import Experiment
from jammkle_gap.november.recording import Recording, Signal
from jammkle_gap.november.verdict import Verdict

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

TIME_S = 0.01 * np.arange(600)
NOISE = 0.01


def effect(name: str, null: float, low: float, high: float) -> Effect:
    return Effect(name, "part", (EffectParameter("size", "1", null, low, high, "assumed"),), f"Check {name}.")


def recorded(number: int, inputs: float, values: NDArray[np.float64], *more: Signal) -> Recording:
    random = np.random.default_rng(number)
    signal = Signal("x", "m", TIME_S, values + random.normal(0.0, NOISE, TIME_S.size), NOISE)
    return Recording(f"run {number}", (signal, *more), inputs, regime=f"regime {number}")


def test_what_acts_only_far_out_is_found_in_every_recording() -> None:
    """A sensor that saturates clips a large swing at a small step, and a small one only much further on."""

    def clipped(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        most = 16.0 * values.get("saturation.size", 1.0)
        return {"x": np.clip(recording.inputs * np.sin(TIME_S), -most, most)}

    # A step of 15 % of the range goes down to 10: that clips 12, and not 7; the truth of 5 clips both.
    truth = {"saturation.size": 0.3125}
    runs = []
    for number, swing in enumerate((12.0, 7.0)):
        runs.append(recorded(number, swing, clipped(Recording("", (), swing), truth)["x"]))
    found = diagnose(runs, clipped, Library((effect("saturation", 1.0, 0.1, 2.5),)), jobs=1)
    assert found.verdict is Verdict.EFFECTS
    assert found.effects[0].parameters[0].value == pytest.approx(0.3125, rel=0.01)
    assert found.gap.with_effect < 1.2


def waves(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
    slow, fast = (values.get(f"{name}.size", 0.0) for name in ("slow", "fast"))
    x = recording.inputs + slow * np.sin(TIME_S) + fast * np.sin(3.0 * TIME_S)
    return {signal.name: x[: signal.values.size] for signal in recording.signals}


LIBRARY = Library((effect("slow", 0.0, -1.0, 1.0), effect("fast", 0.0, -1.0, 1.0)))


def test_a_signal_that_one_recording_alone_has_may_be_the_worst() -> None:
    """There is nothing to hold a formula out from, and still an answer."""
    random = np.random.default_rng(5)
    off = Signal("q", "m", TIME_S, 3.0 * np.sign(np.sin(7.0 * TIME_S)) + random.normal(0.0, NOISE, TIME_S.size), NOISE)
    quiet = np.zeros(TIME_S.size)
    runs = [recorded(0, 0.0, quiet, off), *(recorded(number, 0.0, quiet) for number in (1, 2, 3))]
    # Two and two of a regime, so that each recording is one block.
    runs = [Recording(each.name, each.signals, each.inputs, regime=f"{k // 2}") for k, each in enumerate(runs)]
    found = diagnose(runs, waves, LIBRARY, jobs=1)
    assert found.verdict is Verdict.UNKNOWN
    assert found.formula is None


def test_a_signal_of_one_sample_is_compared_like_any_other() -> None:
    """It has no rate, and neither helps nor hinders."""
    once = Signal("mass", "kg", np.array([0.0]), np.array([0.0]), 0.1)
    runs = [recorded(0, 0.0, 0.4 * np.sin(TIME_S), once)]
    found = diagnose(runs, waves, LIBRARY, jobs=1)
    assert [each.name for each in found.effects] == ["slow"]


def test_an_experiment_that_cannot_be_foretold_is_not_proposed() -> None:
    """The diagnosis that is done is not lost by a plan on which a candidate fails."""

    def same(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        if recording.name == "wild" and values.get("slow.size"):
            msg = "diverged"
            raise FloatingPointError(msg)
        size = values.get("slow.size", 0.0) + values.get("fast.size", 0.0)
        return {"x": recording.inputs + size * np.sin(TIME_S)}

    plan = Recording("wild", (Signal("x", "m", TIME_S, np.zeros(TIME_S.size), NOISE),), 0.0)
    runs = [recorded(number, 0.0, 0.3 * np.sin(TIME_S)) for number in (1, 2)]
    found = diagnose(runs, same, LIBRARY, experiments=[Experiment("wild", lambda: plan)], jobs=1)
    assert found.verdict is Verdict.AMBIGUOUS
    assert found.next_experiment is None


def test_the_order_of_recordings_does_not_matter_to_their_noise() -> None:
    """What a recording declares of its noise is that of the middle one, however they are ordered."""
    values = np.zeros(TIME_S.size)
    signals = [Signal("x", "m", TIME_S, values, noise, noise_time_s=time_s) for noise, time_s in NOISES]
    orders = ((0, 1, 2), (2, 0, 1), (1, 2, 0))
    found = [
        diagnose([Recording(f"{k}", (signals[k],), 1.0) for k in order], waves, LIBRARY, jobs=1).noise[0]
        for order in orders
    ]
    assert found[0] == found[1] == found[2]
    assert found[0].factor == pytest.approx(200.0)


NOISES = ((1.0, 0.0), (5.0, 2.0), (5.0, 2.0))
"""Standard deviation, and for how long it is correlated, s."""
