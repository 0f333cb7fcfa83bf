"""What an ideal detector sees: sizes from twin runs, whitened by healthy runs of the same machine."""

from __future__ import annotations

from functools import cache, lru_cache

import numpy as np
import pytest

from studies.blind.reality.faults import FaultSetting
from studies.blind.reality.machine import Machine
from studies.blind.reality.record import Plan, RealRun
from studies.blind.reality.run import run
from studies.blind.whitened import HEALTHY, NEEDED, IdealDetector, detectable_size, recording_of_real

PULL = Plan("tensile", {"speed_m_s": 0.1, "extension_m": 0.02})


@cache
def pulled(seed: int, gain: float = 1.0) -> RealRun:
    """Return a fast pull of the machine as drawn, its load cell off by a factor."""
    return run(PULL, Machine(), [FaultSetting("load_cell_gain", {"gain": gain})], seed)


@lru_cache(maxsize=1)
def detector() -> IdealDetector:
    return IdealDetector([pulled(seed) for seed in range(HEALTHY)])


def size(gain: float, seeds: range) -> float:
    twins = [detector().difference(pulled(seed), pulled(seed, gain)) for seed in seeds]
    return detectable_size([detector().gain(twins)], 2, 5)


def test_the_gain_that_is_needed_is_that_of_two_normal_quantiles() -> None:
    """One false alarm in a hundred and one miss in a hundred: twice 2.326 standard deviations."""
    assert pytest.approx((2.0 * 2.3263479) ** 2) == NEEDED
    assert detectable_size([NEEDED, 3.0 * NEEDED], 2, 2) == pytest.approx(2.0)


def test_a_size_grows_with_the_fault_and_is_the_same_for_other_twins() -> None:
    """Twice the error of a load cell is twice as large, whatever the day."""
    one, two = size(1.1, range(20, 22)), size(1.2, range(20, 22))
    assert two == pytest.approx(2.0 * one, rel=0.02)
    assert size(1.1, range(30, 32)) == pytest.approx(one, rel=0.1)
    assert one > 1.0


def test_what_differs_by_chance_has_no_size() -> None:
    """Differences of runs that have nothing in common but the machine cancel in products of different twins."""
    differences = [detector().difference(pulled(20 + i), pulled(30 + i)) for i in range(3)]
    lengths = [float(each @ each) / each.size for each in differences]
    assert all(0.3 < each < 10.0 for each in lengths)
    assert detector().gain(differences) < 0.1 * detector().gain([differences[0]] * 2)


def test_a_detector_sees_what_a_rig_measures_and_no_tendon() -> None:
    """Tension and extension of a tendon are for instrumented ones alone."""
    names = {signal.name for signal in recording_of_real(pulled(1), "").signals}
    assert {"load_cell/force_z", "carriage/position", "manifold/pressure"} <= names
    assert not any(name.endswith(("/tension", "/extension")) for name in names)


def test_a_fault_out_of_sight_has_no_size() -> None:
    """A load cell that reads as it should changes nothing at all."""
    assert np.abs(detector().difference(pulled(20), pulled(20, 1.0))).max() == 0.0
