"""An ankle in parts: each effect is seen where it acts and nowhere else, also where a foot lands by chance."""

from __future__ import annotations

import dataclasses
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_gap.ankle.corrected import Correction
from jammkle_gap.ankle.effects import ankle_library
from jammkle_gap.ankle.instruments import PRESSURE, TENSION, quantity_of
from jammkle_gap.ankle.parts import PartsSimulator, prepared_for_parts, with_noise_of_restarts
from jammkle_gap.ankle.runs import recording_of_run
from jammkle_gap.ankle.simulator import AnkleSimulator
from jammkle_sim.rigs.catalogue import RIGS, run_rig

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from jammkle_gap.november.recording import Recording

LIBRARY = ankle_library()
PARTS = PartsSimulator(LIBRARY)
TORN = {"tendon_failure_peroneal_right.remaining": 0.85}


@lru_cache(maxsize=4)
def landing(effects: tuple[tuple[str, float], ...] = ()) -> Recording:
    """Land with effects that the recording does not tell."""
    options = RIGS["landing"].options(slope_deg=40.0)
    return recording_of_run(
        run_rig("landing", options, lambda _: None, lambda: False, Correction(LIBRARY, {**dict(effects)}))
    )


def gaps(recording: Recording, simulated: Mapping[str, NDArray[np.float64]]) -> dict[str, float]:
    """Root mean square of each signal in its noise, without what sensors may be off by throughout."""
    found = {}
    for name, values in simulated.items():
        signal = recording.signal(name)
        residual = signal.values - values
        residual -= np.clip(residual.mean(), -3.0 * signal.bias, 3.0 * signal.bias)
        found[name] = float(np.sqrt(np.mean((residual / signal.noise) ** 2)))
    return found


def test_a_torn_tendon_shows_in_its_own_tension_alone() -> None:
    """Its foot lands elsewhere, which a whole simulation makes much of; put in, nothing is left of it."""
    recording = with_noise_of_restarts(landing(tuple(TORN.items())))
    nominal, torn = (gaps(recording, PARTS(recording, values)) for values in ({}, TORN))
    assert max(nominal, key=lambda name: nominal[name]) == "peroneal_right/tension"
    assert nominal["peroneal_right/tension"] > 3.0
    assert torn["peroneal_right/tension"] < 1.5
    others = [name for name in nominal if quantity_of(name) == TENSION and name != "peroneal_right/tension"]
    assert max(nominal[name] for name in others) < 1.5


def test_in_good_order_every_part_lies_at_its_noise() -> None:
    """What restarts do in contact is taken off."""
    recording = landing()
    assert max(gaps(recording, PARTS(recording, {})).values()) < 1.5


@pytest.mark.parametrize(
    ("effect", "value", "moved"),
    [
        ("line_leak_achilles.conductance_dm3_s_bar", 0.005, {PRESSURE}),
        ("tendon_stiffness.scale", 1.2, {TENSION}),
        ("pretension_achilles_pair.extension_m", 0.001, {TENSION}),
    ],
)
def test_what_acts_in_one_part_leaves_the_others_as_they_were(effect: str, value: float, moved: set[str]) -> None:
    """To the last digit: the bodies are not even run again."""
    recording = landing()
    before, after = PARTS(recording, {}), PARTS(recording, {effect: value})
    changed = {quantity_of(name) for name in before if not np.array_equal(before[name], after[name])}
    assert changed == moved


def test_what_acts_on_the_bodies_moves_them() -> None:
    """A payload is seen in how the measured tensions move the leg, and in no tension."""
    recording = landing()
    before, after = PARTS(recording, {}), PARTS(recording, {"payload.mass_kg": 0.5})
    assert not np.array_equal(before["carriage/position"], after["carriage/position"])
    assert np.array_equal(before["achilles_left/tension"], after["achilles_left/tension"])


def test_a_part_whose_inputs_were_not_measured_goes_with_the_whole() -> None:
    """Without tensions and extensions there is nothing to feed bodies and tendons with."""
    recording = landing()
    kept = tuple(each for each in recording.signals if quantity_of(each.name) not in {TENSION, "extension"})
    blind = dataclasses.replace(recording, signals=kept)
    parts, whole = PARTS(blind, TORN), AnkleSimulator(LIBRARY)(blind, TORN)
    assert parts.keys() == whole.keys()
    assert all(np.array_equal(parts[name], whole[name]) for name in whole)


def test_repeats_are_told_by_their_commands_though_parts_are_fed_with_noise() -> None:
    """Two landings alike are one run, and another slope is not."""
    options = RIGS["landing"].options(slope_deg=30.0)
    other = recording_of_run(run_rig("landing", options, lambda _: None, lambda: False), "other")
    again = dataclasses.replace(landing(), name="again")
    recordings, references = prepared_for_parts([landing()], [again, other], LIBRARY)
    assert recordings[0].run == references[0].run
    assert references[1].run != references[0].run


def test_a_late_pressure_is_told_from_late_commands() -> None:
    """Tendons pull by the pressure that is there, not by the one that is read late."""
    recording = landing((("pressure_delay.delay_s", 0.05),))
    late = gaps(recording, PARTS(recording, {"pressure_delay.delay_s": 0.05}))
    commands = gaps(recording, PARTS(recording, {"command_delay.delay_s": 0.05}))
    assert max(late.values()) < 1.5
    assert max(commands[name] for name in commands if quantity_of(name) == PRESSURE) < 1.5
    assert max(commands[name] for name in commands if quantity_of(name) == TENSION) > 3.0


@pytest.mark.parametrize(("effect", "value"), [("joint_delay.delay_s", 0.05), ("clock_skew.skew", 0.01)])
def test_what_is_stamped_wrongly_is_put_right_before_it_is_fed(effect: str, value: float) -> None:
    """A part's input is late as well as its output: with the effect put in, both are where they were."""
    recording = with_noise_of_restarts(landing(((effect, value),)))
    assert max(gaps(recording, PARTS(recording, {})).values()) > 5.0
    assert max(gaps(recording, PARTS(recording, {effect: value})).values()) < 2.0
