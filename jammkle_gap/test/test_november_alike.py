"""What cannot be told apart by the sensors that are there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_gap.november.alike import Alike, alike
from jammkle_gap.november.diagnosis import diagnose
from jammkle_gap.november.effect import Effect, EffectParameter, Library
from jammkle_gap.november.explanations import set_around
from jammkle_gap.november.fitting import Fit
from jammkle_gap.november.limits import Limits
from jammkle_gap.november.recording import Recording, Signal
from jammkle_gap.november.residual import lay_out
from jammkle_gap.november.runs import Runs
from jammkle_gap.november.scoring import Score
from jammkle_gap.november.sensitivity import probe, space_of
from jammkle_gap.november.verdict import Criteria, Verdict

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from jammkle_gap.november.diagnosis import Diagnosis

TIME_S = 0.01 * np.arange(400)
SHAPES = {
    "ramp": {"x": TIME_S, "y": 0.0 * TIME_S},
    "steeper": {"x": 3.0 * TIME_S, "y": 0.0 * TIME_S},
    "nearly": {"x": TIME_S + 0.05 * np.sin(5.0 * TIME_S), "y": 0.0 * TIME_S},
    "wave": {"x": np.sin(5.0 * TIME_S), "y": 0.0 * TIME_S},
    "elsewhere": {"x": 0.0 * TIME_S, "y": TIME_S},
    "silent": {"x": 0.0 * TIME_S, "y": 0.0 * TIME_S},
}
LIBRARY = Library(
    tuple(Effect(name, "part", (EffectParameter("size", "1", 0.0, -1.0, 1.0, "assumed"),), "Look.") for name in SHAPES)
)


def simulate(_: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
    return {
        name: sum((values.get(f"{each}.size", 0.0) * shape[name] for each, shape in SHAPES.items()), 0.0 * TIME_S)
        for name in ("x", "y")
    }


@pytest.fixture(scope="module")
def found() -> dict[frozenset[str], Alike]:
    recording = Recording("one", tuple(Signal(name, "m", TIME_S, 0.0 * TIME_S, 0.01) for name in ("x", "y")))
    runs = Runs(simulate, [recording], jobs=1)
    nominal = runs.nominal()
    layout = lay_out([recording], nominal, {"x": 0.01, "y": 0.01})
    pairs = alike(probe(LIBRARY, runs, layout, layout.residual(nominal)), layout)
    assert [each.apart for each in pairs] == sorted(each.apart for each in pairs)
    return {frozenset({each.first, each.second}): each for each in pairs}


def test_what_differs_in_size_alone_is_the_same(found: dict[frozenset[str], Alike]) -> None:
    """A steeper ramp is a larger ramp; one with a ripple of a few percent is not told apart either."""
    for name in ("steeper", "nearly"):
        pair = found[frozenset({"ramp", name})]
        assert not pair.told_apart
        assert pair.same_signals


def test_other_shapes_and_other_signals_are_told_apart(found: dict[frozenset[str], Alike]) -> None:
    """By shape where the signals are the same, by structure where they are not."""
    wave, elsewhere = found[frozenset({"ramp", "wave"})], found[frozenset({"ramp", "elsewhere"})]
    assert wave.told_apart
    assert wave.same_signals
    assert elsewhere.apart == pytest.approx(1.0)
    assert not elsewhere.same_signals


def test_what_moves_nothing_is_compared_with_nothing(found: dict[frozenset[str], Alike]) -> None:
    """It cannot be seen at all, which is said elsewhere."""
    assert not any("silent" in pair for pair in found)


SWING = np.sin(1.3 * TIME_S)


def swinging(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
    """Add effects to a swing, which every recording has."""
    made = simulate(recording, values)
    return {**made, "x": made["x"] + SWING}


def diagnosed(shape: str, swing: float) -> Diagnosis:
    """Diagnose four runs of a machine with one effect, beside two references, by a simulator that swings by 1.

    Args:
        shape: Of the effect, fifty times the noise.
        swing: By which the machine really swings.

    """
    random = np.random.default_rng(3)

    def run(name: str, size: float) -> Recording:
        made = {"x": size * SHAPES[shape]["x"] + swing * SWING, "y": size * SHAPES[shape]["y"]}
        noisy = {each: values + random.normal(0.0, 0.01, TIME_S.size) for each, values in made.items()}
        return Recording(name, tuple(Signal(each, "m", TIME_S, values, 0.01) for each, values in noisy.items()))

    offered = Library(tuple(LIBRARY.effect(name) for name in ("ramp", "nearly", "wave")))
    recordings = [run(str(number), 0.5 / float(np.std(SHAPES[shape]["x"]))) for number in range(4)]
    references = [run("healthy", 0.0), run("as healthy", 0.0)]
    return diagnose(recordings, swinging, offered, references=references, jobs=1)


def test_a_simulator_that_is_a_fifth_off_does_not_tell_a_ripple() -> None:
    """Thousands of samples do, but what it foretells of either effect is no better than that."""
    found = diagnosed("ramp", 1.2)
    assert found.verdict is Verdict.AMBIGUOUS
    assert [each.names for each in found.candidates] == [("ramp",), ("nearly",)]
    assert all(sum(name in reason for reason in found.reasons) == 1 for name in ("ramp", "nearly"))


@pytest.mark.parametrize(("shape", "swing"), [("ramp", 1.0), ("wave", 1.2)])
def test_a_good_simulator_tells_a_ripple_and_any_tells_another_shape(shape: str, swing: float) -> None:
    """Where references show nothing, scores alone decide; and a wave is no ramp, whatever they show."""
    found = diagnosed(shape, swing)
    assert found.verdict is Verdict.EFFECTS
    assert [each.names for each in found.candidates] == [(shape,)]


def test_of_what_closes_as_much_the_simplest_comes_first() -> None:
    """A ripple of a few hundredths of the noise makes an effect with one more parameter foretell a little better."""
    ripple = np.sin(5.0 * TIME_S)
    parameters = [EffectParameter(name, "1", 0.0, -1.0, 1.0, "assumed") for name in ("size", "ripple")]
    offered = Library(
        (Effect("bent", "part", tuple(parameters), "Look."), Effect("ramp", "part", (parameters[0],), "Look."))
    )

    def bending(_: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        size = values.get("bent.size", 0.0) + values.get("ramp.size", 0.0)
        return {"x": size * TIME_S + values.get("bent.ripple", 0.0) * ripple}

    random = np.random.default_rng(5)
    recordings = []
    for number in range(4):
        values = 0.3 * TIME_S + 0.0009 * ripple + random.normal(0.0, 0.01, TIME_S.size)
        recordings.append(Recording(str(number), (Signal("x", "m", TIME_S, values, 0.01),)))
    found = diagnose(recordings, bending, offered, jobs=1)
    nats = dict(found.ranking)
    assert nats["bent",] > nats["ramp",]
    assert found.verdict is Verdict.AMBIGUOUS
    assert [each.names for each in found.candidates] == [("ramp",), ("bent",)]


def test_a_small_effect_elsewhere_is_named_beside_a_large_one() -> None:
    """It closes little of all, but without it a signal would be off that it brings back to what counts as none."""
    names = ("x", "y", *(f"quiet_{number}" for number in range(10)))
    sizes = {"x": 0.2, "y": 0.0195}
    size = EffectParameter("size", "1", 0.0, -1.0, 1.0, "assumed")
    offered = Library(tuple(Effect(name, "part", (size,), "Look.") for name in "xy"))
    shape = np.sqrt(2.0) * np.sin(5.0 * TIME_S)

    def simulated(_: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        return {name: values.get(f"{name}.size", 0.0) * shape for name in names}

    random = np.random.default_rng(7)
    recordings = [
        Recording(
            str(number),
            tuple(
                Signal(name, "m", TIME_S, sizes.get(name, 0.0) * shape + random.normal(0.0, 0.01, TIME_S.size), 0.01)
                for name in names
            ),
        )
        for number in range(4)
    ]
    found = diagnose(recordings, simulated, offered, jobs=1)
    assert found.verdict is Verdict.EFFECTS
    assert [each.names for each in found.candidates] == [("x", "y")]


def test_what_leaves_less_stays_beside_what_scores_better() -> None:
    """A robust score forgives a short knock that is missed by far; what is left of the gap does not."""
    recording = Recording("one", (Signal("x", "m", TIME_S, TIME_S, 0.01),))
    layout = lay_out([recording], [{"x": 0.0 * TIME_S}], {"x": 0.01})

    def scored(left: float, nats: float, *names: str) -> Score:
        residual = np.full(TIME_S.size, left)
        space = space_of([LIBRARY.effect(name) for name in names])
        fit = Fit(space, space.null, residual, np.zeros((residual.size, len(names))), 0.0)
        segments = np.linspace(0.9, 1.1, layout.block_of_segment.size) * nats / layout.block_of_segment.size
        return Score(fit, segments, residual, np.zeros((len(layout.blocks), len(names))))

    nominal, best = scored(30.0, 0.0), scored(2.5, 900.0, "wave")
    less, more = scored(2.0, 600.0, "ramp"), scored(3.5, 600.0, "nearly")
    limits = Limits(1.5, {"x": 1.5})
    found = set_around(layout, best, [best], [best, less, more, nominal], Criteria(), limits)
    assert [each.names for each in found] == [("ramp",), ("wave",)]
