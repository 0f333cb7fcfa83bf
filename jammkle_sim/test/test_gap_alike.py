"""Which effects cannot be told apart by the sensors that are there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_sim.gap.alike import Alike, alike
from jammkle_sim.gap.effect import Effect, EffectParameter, Library
from jammkle_sim.gap.recording import Recording, Signal
from jammkle_sim.gap.residual import lay_out
from jammkle_sim.gap.runs import Runs
from jammkle_sim.gap.sensitivity import probe

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

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
