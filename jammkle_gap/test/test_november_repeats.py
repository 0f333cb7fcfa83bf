"""What repeats of a run tell of its noise: how much, over how many samples, and how well it is known."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_gap.november.diagnosis import diagnose
from jammkle_gap.november.effect import Effect, EffectParameter, Library
from jammkle_gap.november.limits import limits_of
from jammkle_gap.november.noise import NoiseSource, find_noise
from jammkle_gap.november.recording import Recording, Signal
from jammkle_gap.november.repeats import leaders, repeats
from jammkle_gap.november.residual import doubt_of, lay_out
from jammkle_gap.november.runs import Runs
from jammkle_gap.november.verdict import Verdict

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

TIME_S = 0.01 * np.arange(800)
KNOCK = np.exp(-(((TIME_S - 4.0) / 0.4) ** 2))
WHITE = 0.01


def run(inputs: float, values: NDArray[np.float64], name: str) -> Recording:
    return Recording(name, (Signal("x", "m", TIME_S, values, WHITE),), inputs)


def simulate(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
    """A slow swing of the input's size, with a knock in the middle that an effect moves."""
    return {"x": recording.inputs * np.sin(TIME_S) + (1.0 + values.get("push.size", 0.0)) * KNOCK}


def measured(late_s: Sequence[float], seed: int, push: float = 0.0) -> list[Recording]:
    """Return repeats whose knock comes a little early or late."""
    random = np.random.default_rng(seed)
    made = []
    for number, late in enumerate(late_s):
        knock = (1.0 + push) * np.interp(TIME_S - late, TIME_S, KNOCK)
        values = np.sin(TIME_S) + knock + random.normal(0.0, WHITE, TIME_S.size)
        made.append(run(1.0, values, f"{seed}.{number}"))
    return made


LIBRARY = Library((Effect("push", "part", (EffectParameter("size", "1", 0.0, -1.0, 5.0, "assumed"),), "Look."),))


def noise_of(*batches: Sequence[Recording]) -> NoiseSource:
    found, _ = find_noise(*((batch, [simulate(each, {}) for each in batch]) for batch in batches))
    return found["x"]


def test_runs_that_differ_by_one_curve_count_once() -> None:
    """A knock that comes early or late is known from as many values as there are repeats to spare, bumps or not."""
    hanging = noise_of(measured((-0.05, 0.0, 0.05), 1), measured((0.04, -0.04), 2)).hanging
    assert hanging.share > 0.5
    assert hanging.known_from == pytest.approx(3.0, rel=0.3)


def test_noise_that_is_new_in_every_sample_is_known_well() -> None:
    """White noise has no hanging part, and its limit is the base."""
    recordings = measured((0.0, 0.0, 0.0), 3)
    source = noise_of(recordings)
    layout = lay_out(recordings, [simulate(each, {}) for each in recordings], {"x": source.noise})
    assert source.hanging.share < 0.1
    assert limits_of(layout, {"x": source}, 1.2).of_signal["x"] == pytest.approx(1.2, abs=0.05)


def test_what_differs_between_machines_is_no_noise() -> None:
    """References and recordings are each compared among themselves."""
    healthy, pushed = measured((0.0, 0.0, 0.0), 4), measured((0.0, 0.0), 5, push=1.0)
    assert noise_of(healthy, pushed).noise == pytest.approx(WHITE, rel=0.1)


def test_a_run_that_is_late_is_no_gap_and_an_effect_beside_it_is_named() -> None:
    """With references that are early and late as well; the effect is large beside that."""
    references = measured((-0.05, 0.01, 0.05, -0.03, 0.02), 6)
    late = diagnose(measured((0.06, -0.03), 7), simulate, LIBRARY, references=references, jobs=1)
    assert late.verdict is Verdict.NO_GAP, late.reasons
    found = diagnose(measured((0.03, -0.03), 8, push=2.0), simulate, LIBRARY, references=references, jobs=1)
    assert [each.name for each in found.effects] == ["push"], found.reasons


def test_repeats_are_told_by_most_of_their_signals() -> None:
    """One signal of three that slips elsewhere does not make another run; other inputs do."""
    names = ("a", "b", "c")
    recordings = [Recording(name, tuple(Signal(each, "m", TIME_S, np.sin(TIME_S)) for each in names)) for name in "pqr"]
    swing = np.sin(TIME_S)
    simulated = [{"a": swing, "b": swing, "c": factor * swing} for factor in (1.0, -1.0)]
    simulated.append(dict.fromkeys(names, 2.0 * swing))
    assert repeats(recordings, simulated) == ((0, 1), (2,))


def test_a_simulator_is_doubted_where_it_changes_something() -> None:
    """By a share of the change, and nowhere else."""
    recordings = measured((0.0, 0.0), 9)
    layout = lay_out(recordings, [simulate(each, {}) for each in recordings], {"x": WHITE})
    change = np.where(layout.time_s < TIME_S[400], 0.0, 50.0)
    doubt = doubt_of(layout, change)
    assert np.all(doubt[layout.time_s < TIME_S[300]] == 0.0)
    assert doubt.max() == pytest.approx(5.0)


def test_one_repeat_is_run_for_all_that_hardly_differ() -> None:
    """An effect is run once for both; what is said of the other is what a run of its own would say."""
    one, same, other = (run(size, size * np.sin(TIME_S), str(size)) for size in (1.0, 1.004, 1.04))
    recordings = [one, same, other]
    simulated = [simulate(each, {}) for each in recordings]
    led = leaders(recordings, simulated, {"x": WHITE})
    assert led == (0, 0, 2), "the third is the same run, too, but differs by more than half of the noise"
    runs = Runs(simulate, recordings, jobs=1)
    runs.nominal()
    runs.lead(led)
    before = runs.spent.runs
    (found,) = runs.evaluate([{"push.size": 2.0}])
    assert runs.spent.runs - before == 2
    for recording, signals in zip(recordings, found, strict=True):
        assert signals is not None
        np.testing.assert_allclose(signals["x"], simulate(recording, {"push.size": 2.0})["x"], atol=1e-12)


def test_repeats_with_other_signals_are_run_for_themselves() -> None:
    """A sensor that only one of them has is not foretold by the other."""
    swing = np.sin(TIME_S)
    recordings = [run(1.0, swing, name) for name in "pq"]
    assert leaders(recordings, [{"x": swing}, {"x": swing, "y": swing}], {"x": WHITE, "y": WHITE}) == (0, 1)
