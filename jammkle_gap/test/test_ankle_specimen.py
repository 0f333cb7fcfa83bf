"""References tell what the tendons of a machine are like, so that a change is told from how it was made."""

from __future__ import annotations

import dataclasses
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_gap.ankle.corrected import Correction
from jammkle_gap.ankle.effects import ankle_library
from jammkle_gap.ankle.instruments import TENSION, quantity_of
from jammkle_gap.ankle.parts import PartsSimulator
from jammkle_gap.ankle.runs import recording_of_run
from jammkle_gap.ankle.specimen import WithTendons, tendons_told_by
from jammkle_graph import names
from jammkle_sim.rigs.catalogue import RIGS, run_rig

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_gap.november.recording import Recording

LIBRARY = ankle_library()
PARTS = PartsSimulator(LIBRARY)
MACHINE = (("tendon_stiffness.scale", 1.3), ("pretension_achilles_pair.extension_m", -0.001))
TORN = "fibre_loss_peroneal_left.lost"


@lru_cache(maxsize=4)
def landing(effects: tuple[tuple[str, float], ...], seed: int) -> Recording:
    """Land with tendons that nobody is told of."""
    options = RIGS["landing"].options(slope_deg=40.0, seed=seed)
    run = run_rig("landing", options, lambda _: None, lambda: False, Correction(LIBRARY, dict(effects)))
    return recording_of_run(run, f"landing {seed}")


@lru_cache(maxsize=1)
def told() -> Mapping[str, float]:
    return tendons_told_by([landing(MACHINE, 1), landing(MACHINE, 2)])


def tension_gaps(recording: Recording, simulator: PartsSimulator | WithTendons, torn: float = 0.0) -> dict[str, float]:
    """Root mean square of what is left of each tension, in its noise."""
    simulated = simulator(recording, {TORN: torn} if torn else {})
    return {
        name: float(np.sqrt(np.mean(((recording.signal(name).values - values) / recording.signal(name).noise) ** 2)))
        for name, values in simulated.items()
        if quantity_of(name) == TENSION
    }


def test_the_law_of_a_machine_holds_in_a_run_that_told_nothing() -> None:
    """As built it is off by far."""
    fresh, machine = landing(MACHINE, 3), WithTendons(PARTS, LIBRARY, tuple(told().items()))
    assert max(tension_gaps(fresh, PARTS).values()) > 5.0
    assert max(tension_gaps(fresh, machine).values()) < 1.5


def test_what_is_told_is_what_the_machine_is_like() -> None:
    """Where the data show it; what they do not show stays as it is."""
    for name, value in MACHINE:
        assert told()[name] == pytest.approx(value, rel=0.1)
    assert told()["softening.loss"] < 0.03


def test_a_change_comes_on_top_of_what_the_machine_is_like() -> None:
    """Torn fibres of a stiff tendon are found at their size, in the tendon that has them."""
    recording = landing((*MACHINE, (TORN, 0.3)), 4)
    machine = WithTendons(PARTS, LIBRARY, tuple(told().items()))
    before, after = tension_gaps(recording, machine), tension_gaps(recording, machine, 0.3)
    assert max(before, key=lambda name: before[name]) == "peroneal_left/tension"
    assert before["peroneal_left/tension"] > 3.0
    assert max(after.values()) < 1.5


def test_a_machine_that_softens_softens_further() -> None:
    """A little more loss takes force off, never gives it back; the travel of no further loss changes nothing."""
    recording = landing((), 5)
    machine = WithTendons(PARTS, LIBRARY, (("softening.loss", 0.1), ("softening.travel_m", 0.05)))
    before = machine(recording, {})
    softer = machine(recording, {"softening.loss": 0.02, "softening.travel_m": 0.05})
    same = machine(recording, {"softening.travel_m": 0.2})
    for name in (name for name in before if quantity_of(name) == TENSION):
        assert np.array_equal(same[name], before[name])
        assert softer[name].max() < before[name].max()


def test_bodies_and_air_stay_as_they_are() -> None:
    recording = landing(MACHINE, 3)
    plain, machine = PARTS(recording, {}), WithTendons(PARTS, LIBRARY, tuple(told().items()))(recording, {})
    assert plain.keys() == machine.keys()
    assert all(np.array_equal(plain[name], machine[name]) for name in plain if quantity_of(name) != TENSION)


def test_where_nothing_is_told_parts_are_as_built() -> None:
    """Also with effects on, and where the release is that which the slide has seen."""
    landed = landing(MACHINE, 3)
    seen = dataclasses.replace(landed.inputs, release_s=1.01, release_seen_by=names.JOINT_STATES.name)
    counted = dataclasses.replace(landed, inputs=seen)
    values = {"joint_delay.delay_s": 0.02, TORN: 0.3}
    plain, machine = PARTS(counted, values), WithTendons(PARTS, LIBRARY, ())(counted, values)
    assert plain.keys() == machine.keys()
    assert all(np.array_equal(plain[name], machine[name]) for name in plain)


def test_without_tensions_nothing_is_told() -> None:
    """A recorder that knows no tendons says nothing of them, and no reference nothing at all."""
    recording = landing(MACHINE, 1)
    kept = tuple(each for each in recording.signals if quantity_of(each.name) != TENSION)
    assert tendons_told_by([dataclasses.replace(recording, signals=kept)]) == {}
    assert tendons_told_by([]) == {}
