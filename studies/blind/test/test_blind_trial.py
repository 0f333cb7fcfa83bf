"""The blind trial: sizes by the ideal observer, what is drawn, what the diagnosis gets, and the figures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from jammkle_gap import Constants, Library, ankle_library, ankle_problem, load_recordings
from studies.blind import observer as observing
from studies.blind import trial
from studies.blind.__main__ import figures, is_first, is_wrong
from studies.blind.observer import LANDINGS, NAMEABLE, Observer
from studies.blind.reality.faults import FAULTS, FaultSetting
from studies.blind.reality.sensors import Plan
from studies.blind.signals import DAY
from studies.blind.trial import Maker, Truth, asked_for, diagnosed, truth_of

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

_FAULTS = ("leak_achilles", "leak_manifold", "worn_pump", "late_valves", "sticky_valve_achilles", "load_cell_creeps")


@pytest.fixture(scope="module")
def observer(tmp_path_factory: pytest.TempPathFactory) -> Observer:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(observing, "DAY", DAY[:2])
        faults = {name: FAULTS[name] for name in _FAULTS}
        return Observer(tmp_path_factory.mktemp("observer"), [Plan("cycle", {})], faults, specimens=8)


def leak(diameter_m: float) -> FaultSetting:
    return FaultSetting("leak_achilles", {"diameter_m": diameter_m})


def test_a_larger_fault_is_further_from_its_rivals(observer: Observer) -> None:
    sizes = [observer.distances([leak(each)])["leak_achilles"] for each in (5e-5, 1e-4, 2e-4)]
    assert sizes == sorted(sizes)
    assert sizes[-1] > NAMEABLE
    assert observer.distances([leak(0.0)])["leak_achilles"] == pytest.approx(0.0, abs=1e-6)


def test_the_observer_has_the_noise_of_the_sensors() -> None:
    """Its signatures are of runs without noise, in which a gyroscope's offset of nothing would be seen."""
    layout = observing._layout("cycle", ())
    levels = dict(zip(layout.signals, observing._floor(Plan("cycle", {})).reshape(-1, layout.bins)[:, 0], strict=True))
    assert levels["imu/angular_velocity_x"] > 1e-4
    assert levels["imu/specific_force_z"] > 1e-3


def test_faults_of_sensors_that_no_exercise_has_are_not_drawn(observer: Observer) -> None:
    assert "load_cell_creeps" not in observer.faults
    assert "leak_achilles" in observer.reach
    assert set(observer.reach) <= set(observer.faults)


def test_kinds_hold_so_many_faults_and_a_seed_gives_the_same_case(observer: Observer) -> None:
    counts = {"single": 1, "pair": 2, "outside": 1, "none": 0}
    for seed in range(10):
        truth = truth_of(seed, observer)
        assert len(truth.faults) == counts[truth.kind]
        assert len(truth.effects) == (0 if truth.kind == "outside" else counts[truth.kind])
        assert len(truth.distances) == len(truth.faults)
    assert truth_of(3, observer) == truth_of(3, observer)


def test_a_bag_says_what_was_done_and_not_what_is_wrong(tmp_path: Path) -> None:
    truth = Truth(1, "single", 7, (("leak_achilles", {"diameter_m": 2e-4}),), ("line_leak_achilles",))
    maker = Maker(truth, tmp_path)
    (faulty,) = maker.record(Plan("cycle", {"vacuum_pa": 20e3}), 1)
    (healthy,) = maker.record_healthy(Plan("cycle", {}), 1)
    (one,), (other,) = load_recordings(faulty), load_recordings(healthy)
    assert dict(one.inputs.options)["vacuum_pa"] == pytest.approx(20e3)
    assert {signal.name for signal in one.signals} == {signal.name for signal in other.signals}
    assert "leak" not in faulty.name
    assert all("leak" not in note for note in one.notes)


def test_landings_are_recorded_as_they_were_planned(tmp_path: Path) -> None:
    """A robot that comes back from the field: the diagnosis reads what was landed on, and when it jammed."""
    maker = Maker(Truth(1, "none", 7), tmp_path)
    found = [load_recordings(maker.record(plan, 1)[0])[0] for plan in LANDINGS]
    assert [dict(each.inputs.options)["jam"] for each in found] == ["after", "before", "never"]
    assert [dict(each.inputs.options)["slope_deg"] for each in found] == [40.0, 40.0, 15.0]


def test_how_far_a_leg_falls_differs_from_landing_to_landing_and_not_from_exercise_to_exercise() -> None:
    higher, landing = ("drop_height_m", 5e-4), LANDINGS[0]
    assert not np.array_equal(observing._features(landing), observing._features(landing, day=higher))
    cycle = Plan("cycle", {})
    assert np.array_equal(observing._features(cycle), observing._features(cycle, day=higher))


def test_experiments_are_read_as_the_command_reads_them() -> None:
    assert asked_for("exercise tilt ") == Plan("tilt", {})
    shake = Plan("shake", {"amplitude_deg": 20, "to_hz": 4})
    assert asked_for("exercise shake -p amplitude_deg:=20 -p to_hz:=4") == shake


@pytest.mark.slow
def test_a_large_leak_is_found_and_effects_are_ranked_by_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    few = Library(tuple(ankle_library().effect(name) for name in ("line_leak_achilles", "pump_wear", "payload")))
    monkeypatch.setattr(trial, "ankle_problem", lambda: ankle_problem(few))
    monkeypatch.setattr(trial, "Constants", lambda: Constants(derivatives_s=0.0))
    truth = Truth(2, "single", 14, (("leak_achilles", {"diameter_m": 2e-4}),), ("line_leak_achilles",))
    maker = Maker(truth, tmp_path)
    answers = diagnosed(
        maker.record(Plan("cycle", {}), 2), [], lambda *_: pytest.fail("nothing is to be asked for"), 0, -1
    )
    assert "line_leak_achilles" in answers[-1].first  # another may stand for what the simulator has wrong
    assert answers[-1].verdict in {"EFFECTS", "AMBIGUOUS"}
    # In units of the sensors' noise a leaking membrane, a constant, takes up most of the leak.
    assert sorted(answers[-1].rms) == sorted(each.name for each in few)
    assert answers[-1].rms[-1] == "payload"
    assert answers[-1].closed > 0.25  # about half of the gap is where the two simulators differ without any fault


def case(kind: str, truth: list[str], verdict: str, first: list[str], **more: Any) -> Mapping[str, Any]:
    known = {"kind": kind, "effects": truth, "distances": [10.0] * max(len(truth), kind == "outside")}
    known |= {"values": {"a.size": 1.0}, "location": ["air"]}
    answer = {"verdict": verdict, "first": first, "named": [first], "rms": ["b"], "closed": 0.9, "cpu_s": 100.0}
    answer |= {"subsystem": "air", "estimates": {"a.size": (1.1, 0.9, 1.3)}}
    return {"truth": known, "answers": [answer | more]}


def test_figures_count_what_is_right_wrong_and_left_out() -> None:
    cases = [
        case("single", ["a"], "EFFECTS", ["a"]),
        case("single", ["a"], "AMBIGUOUS", ["b"], named=[["b"], ["a"]]),
        case("single", ["a"], "EFFECTS", ["b"]),
        case("single", ["a"], "NO_GAP", []),
        case("pair", ["a", "c"], "EFFECTS", ["a", "c"]),
        case("pair", ["a", "c"], "EFFECTS", ["a"]),
        case("outside", [], "UNKNOWN", []),
        case("none", [], "NO_GAP", []),
        case("none", [], "EFFECTS", ["b"]),
    ]
    small = case("single", ["a"], "EFFECTS", ["a"])
    small["truth"]["distances"] = [1.0]
    table = figures([*cases, small])
    rows = {row.split("|")[1].strip(): row.split("|")[2].strip() for row in table.splitlines()[2:]}
    assert rows["single effects, first after them"] == "1 of 4"
    assert rows["single effects, a gap was seen"] == "3 of 4"
    assert rows["truth in the set, of single effects with a set"] == "2 of 3"
    assert rows["named for certain and wrong, of all that were"] == "2 of 6"
    assert rows["pairs, both named first"] == "1 of 2"
    assert rows["outside the library, something else"] == "1 of 1"
    assert rows["nothing wrong, no gap"] == "1 of 2"
    assert rows["90 % intervals that hold the truth"] == "1 of 1"
    assert rows["not nameable by the ideal observer, and left out above"] == "1"


def test_a_member_of_the_same_class_is_not_wrong() -> None:
    declared = case("single", ["a"], "EFFECTS", ["b"], named=[["b"], ["a"]])
    assert not is_first(declared)
    assert not is_wrong(declared)


def test_a_fault_is_never_drawn_beyond_its_range(observer: Observer) -> None:
    random = np.random.default_rng(0)
    for _ in range(20):
        for name in observer.reach:
            drawn = trial._drawn(name, random)
            for key, row in FAULTS[name].parameters.items():
                assert row.minimum <= drawn.values[key] <= row.maximum
