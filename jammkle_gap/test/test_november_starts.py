"""Where fits begin: over the range of a parameter, and from the parts of what has been fitted."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_gap.november.diagnosis import diagnose
from jammkle_gap.november.effect import Effect, EffectParameter, Library
from jammkle_gap.november.fitting import loss_of, uncalibrated
from jammkle_gap.november.recording import Recording, Signal
from jammkle_gap.november.residual import lay_out, weigh
from jammkle_gap.november.runs import Runs, StoppedError
from jammkle_gap.november.sensitivity import probe
from jammkle_gap.november.starts import Starts
from jammkle_gap.november.verdict import Verdict

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

TIME_S = 0.01 * np.arange(600)
NOISE = 0.02
NULL_HZ, TRUE_HZ = 0.5, 2.0


def effect(name: str, null: float, low: float, high: float) -> Effect:
    return Effect(name, "part", (EffectParameter("size", "1", null, low, high, "assumed"),), f"Check {name}.")


LIBRARY = Library((effect("tone", NULL_HZ, 0.2, 2.2), effect("slope", 0.0, -1.0, 1.0), effect("step", 0.0, -2.0, 2.0)))


def sing(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
    """A tone whose frequency is far off from every other: the fit of one to another has many valleys."""
    tone = np.sin(2.0 * np.pi * values.get("tone.size", NULL_HZ) * TIME_S)
    slope = values.get("slope.size", 0.0) * TIME_S / TIME_S[-1]
    step = values.get("step.size", 0.0) * (TIME_S > 3.0)  # half-way
    return {"x": recording.inputs * tone + slope + step}


def heard(seed: int) -> list[Recording]:
    random = np.random.default_rng(seed)
    made = []
    for name, size in (("quiet", 1.0), ("loud", 2.0)):
        inputs = np.full(TIME_S.size, size)
        clean = sing(Recording(name, (), inputs), {"tone.size": TRUE_HZ})["x"]
        values = clean + random.normal(0.0, NOISE, TIME_S.size)
        made.append(Recording(name, (Signal("x", "m", TIME_S, values, NOISE),), inputs))
    return made


def test_a_cause_in_a_far_valley_is_found_by_a_scan() -> None:
    """No derivative at the null value points to it, yet it is named, alone, with its value."""
    found = diagnose(heard(3), sing, LIBRARY, jobs=1)
    assert found.verdict is Verdict.EFFECTS, found.reasons
    assert [each.name for each in found.effects] == ["tone"]
    assert found.effects[0].parameters[0].value == pytest.approx(TRUE_HZ, abs=2e-3)


def test_the_part_of_a_pair_that_does_all_is_fitted_from_where_the_pair_ended() -> None:
    """A single that was stuck elsewhere is taken up again there; one that is worse there is left as it was."""
    recordings = heard(4)
    runs = Runs(sing, recordings, jobs=1)
    nominal = runs.nominal()
    layout = lay_out(recordings, nominal, {"x": NOISE})
    residual = layout.residual(nominal)
    probes = {each.effect.name: each for each in probe(LIBRARY, runs, layout, residual)}
    starts = Starts(layout, runs, probes, uncalibrated(residual))
    loss = loss_of(layout, weigh(layout, residual))
    fits = {(name,): starts.of([name], {}, loss) for name in probes}
    pair = starts.of(["step", "tone"], fits, loss)
    place = np.array([(TRUE_HZ - 0.2) / 2.0 if key == "tone.size" else 0.5 for key in pair.space.keys])
    whole = replace(pair, point=place)
    better = starts.of_parts([whole], fits, loss)
    assert [each.names for each in better] == [("tone",)]
    assert better[0].space.values(better[0].point)["tone.size"] == pytest.approx(TRUE_HZ)
    assert layout.gap(better[0].residual) == pytest.approx(1.0, abs=0.1)


def test_a_wish_to_stop_is_heard_within_a_batch() -> None:
    """A large batch over several processes ends early."""
    asked: list[int] = []

    def stop() -> bool:
        asked.append(len(asked))
        return len(asked) > 2  # once before the batch, once after its first portion

    runs = Runs(sing, heard(5), jobs=2, stop=stop)
    with pytest.raises(StoppedError):
        runs.evaluate([{"slope.size": 0.001 * k} for k in range(200)])
    assert len(asked) == 3
