"""What references are worth where the recordings went through other states than they did."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_gap.november.diagnosis import diagnose
from jammkle_gap.november.effect import Effect, EffectParameter, Library
from jammkle_gap.november.recording import Recording, Signal
from jammkle_gap.november.references import MOST_OFF, with_references
from jammkle_gap.november.verdict import Verdict

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

TIME_S = 0.01 * np.arange(800)
WHITE = 0.01
TRUE_GAIN = 1.25
LIBRARY = Library((Effect("push", "part", (EffectParameter("size", "1", 0.0, -1.0, 5.0, "assumed"),), "Look."),))


def simulate(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
    """A law that is fed with what was measured at its input, a swing of some size, and thinks of its gain as 1."""
    knock = np.exp(-(((TIME_S - 4.0) / 0.4) ** 2))
    return {"x": recording.inputs * np.sin(TIME_S) + values.get("push.size", 0.0) * knock}


def machine(sizes: Sequence[float], seed: int, push: float = 0.0, gain: float = TRUE_GAIN) -> list[Recording]:
    """Return one run again and again, of a machine with another gain, that went through swings of these sizes."""
    random, made = np.random.default_rng(seed), []
    for number, size in enumerate(sizes):
        own = Recording("", (), size)
        x = simulate(own, {"push.size": push})["x"] + (gain - 1.0) * size * np.sin(TIME_S)
        signal = Signal("x", "m", TIME_S, x + random.normal(0.0, WHITE, TIME_S.size), WHITE)
        made.append(Recording(f"{seed}.{number}", (signal,), size, run="the same"))
    return made


def test_what_references_take_off_is_not_trusted_in_other_states() -> None:
    """A swing half as large again is off by half as much again, which is no fault of the machine's."""
    references = machine((1.0, 1.0, 1.0), 1)
    assert diagnose(machine((1.5, 1.5), 2), simulate, LIBRARY, references=references, jobs=1).verdict is Verdict.NO_GAP
    found = diagnose(machine((1.5, 1.5), 3, push=2.0), simulate, LIBRARY, references=references, jobs=1)
    assert found.verdict is Verdict.EFFECTS
    assert found.candidates[0].names == ("push",)


def test_in_the_same_states_references_cost_nothing() -> None:
    """What would be lost beside other states is found."""
    references, recordings = machine((1.0, 1.0, 1.0), 4), machine((1.0, 1.0), 5, push=1.0)
    found = diagnose(recordings, simulate, LIBRARY, references=references, jobs=1)
    assert found.noise[0].noise == pytest.approx(WHITE * np.sqrt(1.0 + 1.0 / 3.0), rel=0.05)
    assert found.verdict is Verdict.EFFECTS


@pytest.mark.parametrize(("gain", "off"), [(1.0, 0.0), (TRUE_GAIN, 0.25), (3.0, MOST_OFF)])
def test_a_simulator_is_doubted_by_the_share_that_it_is_off(gain: float, off: float) -> None:
    """Of what it makes of the references; noise alone is no reason to doubt."""
    recordings, references = machine((1.0, 1.0), 6, gain=gain), machine((1.0, 1.0, 1.0), 7, gain=gain)
    nominal = [[simulate(each, {}) for each in batch] for batch in (recordings, references)]
    baseline = with_references(recordings, nominal[0], references, nominal[1])
    assert baseline.off["x"] == pytest.approx(off, rel=0.05, abs=0.01)


def test_what_goes_astray_between_references_is_not_trusted_further_out() -> None:
    """A simulator that makes something of inputs that the machine does not care for finds no gap where they differ."""

    def indifferent(inputs: Sequence[float], seed: int) -> list[Recording]:
        runs = machine([1.0] * len(inputs), seed, gain=1.0)
        return [dataclasses.replace(each, inputs=size) for each, size in zip(runs, inputs, strict=True)]

    references = indifferent((0.9, 1.0, 1.1), 8)
    found = diagnose(indifferent((1.5, 1.5), 9), simulate, LIBRARY, references=references, jobs=1)
    assert found.verdict is Verdict.NO_GAP


def test_a_part_is_judged_by_what_it_is_off_itself() -> None:
    """The whole is off by much, its part is not: beside references neither is to blame where nothing has changed."""

    def part(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        return {"x": TRUE_GAIN * simulate(recording, values)["x"]}

    references, recordings = machine((1.0, 1.0, 1.0), 6), machine((1.0, 1.0), 7)
    found = diagnose(recordings, simulate, LIBRARY, references=references, subsystems={"part": part}, jobs=1)
    (fed,) = found.where.subsystems
    assert not fed.to_blame
    assert fed.gap < 1.2
    changed = machine((1.0, 1.0), 8, push=1.0)
    found = diagnose(changed, simulate, LIBRARY, references=references, subsystems={"part": part}, jobs=1)
    assert found.where.subsystems[0].to_blame


def test_how_far_a_simulator_is_off_is_seen_through_the_noise() -> None:
    """A signal as large as its noise, of which the simulator makes a fifth too little: nine references tell."""
    references = machine((2.0 * WHITE,) * 9, 9)
    recordings = machine((2.0 * WHITE,) * 2, 10)
    made = [[simulate(each, {}) for each in some] for some in (recordings, references)]
    off = with_references(recordings, made[0], references, made[1]).off["x"]
    assert off == pytest.approx(TRUE_GAIN - 1.0, abs=0.1)
