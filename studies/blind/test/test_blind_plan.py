"""Which cases a blind trial has, and how large their effects are made."""

from __future__ import annotations

import collections

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jammkle_common.parameters import from_mapping
from jammkle_gap import ankle_library
from jammkle_sim.rigs.catalogue import rig_kind
from studies.blind.cases import SIZES, Kind, Rung
from studies.blind.make import Reality, SourceFault
from studies.blind.plan import (
    DEVELOPMENT_SEEDS,
    RIGS,
    STANDARD_CASES,
    STANDARD_SEED,
    FaultFact,
    plan_cases,
    regime,
    settings_of,
)
from studies.blind.size import share_for

SMALL_SEED = 7
FAULTS = (
    *(FaultFact(f"inside_{k}", f"effect_{k}", ("pressure", "drop")) for k in range(6)),
    FaultFact("only_tensile", "effect_t", ("tensile",)),
    *(FaultFact(f"outside_{k}", None, ("tensile", "pressure")) for k in range(3)),
)
KNOWN = tuple(FaultFact(f"effect_{k}", f"effect_{k}", ("pressure",)) for k in range(6))


def test_the_standard_trial_has_what_was_promised() -> None:
    """At least 200 cases, 100 healthy, every size about as often as any other, every kind, every rig healthy."""
    cases = plan_cases(STANDARD_SEED, STANDARD_CASES, RIGS, FAULTS, KNOWN)
    kinds = collections.Counter(case.kind for case in cases)
    assert len(cases) >= 200
    assert kinds[Kind.NONE] >= 100
    assert set(kinds) == set(Kind)
    assert {case.rung for case in cases} == {Rung.WITHHELD, Rung.KNOWN}
    singles = [case for case in cases if case.kind is Kind.SINGLE and case.rung is Rung.WITHHELD]
    sizes = collections.Counter(case.wanted for case in singles)
    assert set(sizes) == set(SIZES)
    assert max(sizes.values()) - min(sizes.values()) <= 0.3 * max(sizes.values())
    calm = collections.Counter(case.rigs[0] for case in cases if case.kind is Kind.NONE)
    assert max(calm.values()) - min(calm.values()) <= 1
    assert len({case.machine for case in cases}) == len(cases)


@given(st.integers(0, 2**20), st.integers(1, 400), st.sets(st.sampled_from(RIGS), min_size=1))
def test_any_trial_can_be_planned(seed: int, count: int, recorded: set[str]) -> None:
    """As many cases as asked for, each of faults that fit its kind and that the rigs recorded can show."""
    by_name = {fault.name: fault for fault in (*FAULTS, *KNOWN)}
    cases = plan_cases(seed, count, sorted(recorded), FAULTS, KNOWN)
    assert [case.name for case in cases] == [f"{k + 1:04d}" for k in range(count)]
    for case in cases:
        chosen = [by_name[name] for name in case.faults]
        assert len(chosen) == {Kind.NONE: 0, Kind.PAIR: 2}.get(case.kind, 1)
        assert all(set(case.rigs) <= set(fault.rigs) & recorded for fault in chosen)
        assert case.rigs
        assert all((fault.effect is None) is (case.kind is Kind.OUTSIDE) for fault in chosen)


def test_the_same_seed_plans_the_same_trial() -> None:
    """And another seed another one."""
    first, again, other = (plan_cases(seed, 40, RIGS, FAULTS, KNOWN) for seed in (5, 5, 6))
    assert first == again
    assert first != other


def test_what_is_tuned_on_is_not_what_is_judged_on() -> None:
    """The standard trial has a seed of its own, and no rig is set in it as in development."""
    assert SMALL_SEED < DEVELOPMENT_SEEDS <= STANDARD_SEED
    assert regime(SMALL_SEED) != regime(STANDARD_SEED)
    for rig in RIGS:
        assert not any(each in settings_of(SMALL_SEED, rig) for each in settings_of(STANDARD_SEED, rig))


@pytest.mark.parametrize("seed", [SMALL_SEED, STANDARD_SEED])
def test_every_setting_is_one_that_the_rig_takes(seed: int) -> None:
    """The options have the names and ranges of `jammkle rig`, so that the diagnosis can run them."""
    for rig in RIGS:
        for settings in settings_of(seed, rig):
            from_mapping(rig_kind(rig).options, dict(settings))


def test_every_fault_of_the_reality_has_a_name_that_the_library_knows() -> None:
    """Effects and their parameters are those of the library, or the score would count right answers as wrong."""
    library = {effect.name: {each.name for each in effect.parameters} for effect in ankle_library()}
    reality = Reality()
    random = np.random.default_rng(1)
    for fault in reality.faults.values():
        if fault.fact.effect is not None:
            assert fault.fact.effect in library
        bounds = fault.bounds(random)
        assert all(fault.ranges[name][1] <= value <= fault.ranges[name][2] for name, value in bounds.items())
        assert fault.at(0.0, bounds) == {name: null for name, (null, _, _) in fault.ranges.items()}


def test_a_fault_grows_to_the_far_side() -> None:
    """A parameter whose range ends next to its null value on one side grows to the other."""
    fault = SourceFault(FaultFact("a", "a", ("drop",)), (), {"x": (1.0, 0.2, 1.1)})
    drawn = {fault.bounds(np.random.default_rng(seed))["x"] for seed in range(20)}
    assert sorted(drawn) == pytest.approx([0.2])


@given(st.floats(0.1, 3.0), st.floats(0.5, 20.0), st.sampled_from(SIZES))
def test_a_size_is_found_whatever_the_law(power: float, largest: float, wanted: float) -> None:
    """Within a twentieth where the range reaches it; the end of the range and its size where it does not."""
    calls = 0

    def size_at(share: float) -> float:
        nonlocal calls
        calls += 1
        return largest * share**power

    share, size = share_for(size_at, wanted)
    assert calls <= 13
    assert size == pytest.approx(largest * share**power)
    if largest <= wanted:
        assert share == 1.0
    elif (wanted / largest) ** (1.0 / power) > 2e-4:
        assert size == pytest.approx(wanted, rel=0.051)
