"""A diagnosis from end to end: settings, references, errors, the dictionary on disk, workers, notes."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_gap import (
    BadRecordingError,
    Experiment,
    Library,
    Nuisance,
    Problem,
    Recording,
    Signal,
    SimulatorError,
    Verdict,
    as_dict,
    diagnose,
)
from jammkle_gap.core.scatter import settings_of
from jammkle_gap.core.signatures import grid_of
from pendulums import CONSTANTS as PENDULUM_CONSTANTS
from pendulums import (
    LIBRARY,
    NOISE_RAD,
    PROBLEM,
    SCATTER,
    STEPS,
    TIMES_S,
    TWIN,
    Sensed,
    effect,
    infeasible,
    machine,
    simulate,
)

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

LOAD = {"load.share": 0.15}


class Counted:
    """The pendulum's simulator, which counts its runs."""

    def __init__(self) -> None:
        self.runs = 0
        self.asked: list[dict[str, float]] = []

    def __call__(self, recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        self.runs += 1
        self.asked.append(dict(values))
        return simulate(recording, values)


def test_the_cause_is_named_with_its_size() -> None:
    """A heavier arm: its name, its number in its interval, where it shows, and how far the gap closes."""
    made = machine(3)
    found = diagnose(made.record(3, LOAD), PROBLEM, references=made.record(5), jobs=1)
    assert found.verdict is Verdict.EFFECTS
    (cause,) = found.effects
    assert cause.name == "load"
    assert cause.parameters[0].value == pytest.approx(0.15, rel=0.1)
    assert found.gap.nominal > 2.0
    assert found.gap.closed > 0.9
    assert found.where[0].signal == "angle"
    assert sum(place.share for place in found.where) == pytest.approx(1.0)
    assert {each.setting for each in found.held_out} == {"slow", "fast"}
    assert as_dict(found)["effects"][0]["name"] == "load"


@pytest.mark.parametrize("most", [0.5, 0.152])
def test_an_interval_says_whether_a_bound_of_the_library_cuts_it(most: float) -> None:
    """What lies at 0.15 and may be at most 0.152 has no interval of the posterior's."""
    made = machine(3)
    problem = replace(PROBLEM, library=Library((effect("load", "share", "1", most),)))
    (cause,) = diagnose(made.record(3, LOAD), problem, references=made.record(5), jobs=1).effects
    (share,) = cause.parameters
    assert share.is_cut is (most == share.interval[1])
    assert share.is_cut is (most < 0.2)


def test_a_healthy_machine_has_no_gap() -> None:
    """Though its constants are not the simulator's."""
    made = machine(5)
    found = diagnose(made.record(3), PROBLEM, references=made.record(5), jobs=1)
    assert found.verdict is Verdict.NO_GAP
    assert found.candidates == ()


def test_a_pair_is_found() -> None:
    """Two effects at once, each with its name."""
    made = machine(6)
    faults = {"rubbing.torque": 0.08, "delay.time": 0.02}
    found = diagnose(made.record(4, faults), PROBLEM, references=made.record(5), jobs=1)
    assert set(found.candidates[0].names) == {"rubbing", "delay"}


def test_an_effect_outside_the_library_is_unknown() -> None:
    """A spring that pulls to one side: nothing on offer does."""

    def pulled(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        aside = 0.3 * np.tanh(TIMES_S) * values.get("spring.torque", 0.0)
        return {"angle": simulate(recording, values)["angle"] + aside}

    made = machine(7)
    runs = [
        replace(run, signals=(replace(run.signals[0], values=run.signals[0].values + 0.3 * np.tanh(TIMES_S)),))
        for run in made.record(3)
    ]
    references = made.record(5)
    missing = diagnose(runs, PROBLEM, references=references, jobs=1)
    assert missing.verdict is Verdict.UNKNOWN
    assert missing.candidates[0].names == ()
    known = replace(PROBLEM, simulator=pulled, library=Library((*LIBRARY, effect("spring", "torque", "N m", 3.0))))
    assert [each.name for each in diagnose(runs, known, references=references, jobs=1).effects] == ["spring"]


def test_equivalent_effects_are_named_as_one() -> None:
    """A twin of the load does the same: the verdict names one, and says what it cannot be distinguished from."""
    made = machine(8)
    problem = replace(PROBLEM, library=Library((*LIBRARY, TWIN)))
    found = diagnose(made.record(3, LOAD), problem, references=made.record(5), jobs=1)
    assert found.classes == (("load", "twin"),)
    assert found.verdict is Verdict.EFFECTS
    first = found.candidates[0]
    assert {*first.names, *first.equivalents} == {"load", "twin"}
    assert found.posterior["load",] == pytest.approx(found.posterior["twin",], rel=0.05)
    assert first.probability == pytest.approx(found.posterior["load",] + found.posterior["twin",])
    assert as_dict(found)["set"][0]["probability"] == pytest.approx(first.probability)
    assert f"probability {first.probability:.2f} with all of its equivalence class" in found.reasons[1]


def test_an_effect_that_moves_nothing_is_silent() -> None:
    """It is listed, and never named."""
    problem = replace(PROBLEM, library=Library((*LIBRARY, effect("elsewhere", "size", "1", 1.0))))
    made = machine(9)
    found = diagnose(made.record(2, LOAD), problem, references=made.record(3), jobs=1)
    assert found.silent == ("elsewhere",)
    assert all("elsewhere" not in names for names in found.posterior)


def test_an_error_of_a_users_simulator_reaches_the_user() -> None:
    """With the recording and the parameters that caused it."""

    def broken(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        if values.get("load.share", 0.0) > 0.1:
            msg = "no root"
            raise ValueError(msg)
        return simulate(recording, values)

    with pytest.raises(SimulatorError, match=r"'slow'.*load\.share=0\.\d+.*ValueError: no root") as raised:
        diagnose(machine(1).record(2), replace(PROBLEM, simulator=broken), references=machine(1).record(2), jobs=1)
    assert isinstance(raised.value.__cause__, ValueError)


def test_parameters_that_cannot_be_simulated_are_no_explanation() -> None:
    """Where a simulator blows up, the answer is found among what it can run."""
    limited = infeasible(lambda _, values: values.get("load.share", 0.0) > 0.4 or values.get("oil.drag", 0.0) > 0.0)
    made = machine(10)
    problem = replace(PROBLEM, simulator=limited)
    found = diagnose(made.record(3, LOAD), problem, references=made.record(5), jobs=1)
    assert [each.name for each in found.effects] == ["load"]


def test_a_simulator_that_cannot_run_a_recording_at_all_is_refused() -> None:
    """Rather than taken for one that agrees with it."""
    never = infeasible(lambda _recording, _values: True)
    with pytest.raises(SimulatorError, match="without any effect"):
        diagnose(machine(1).record(1), replace(PROBLEM, simulator=never), jobs=1)
    with pytest.raises(SimulatorError, match="angle"):
        diagnose(machine(1).record(1), replace(PROBLEM, simulator=lambda _recording, _values: {}), jobs=1)

    for wrong, message in ((np.nan, "to a finite end"), (None, r"'angle' of recording.*no effect has shape \(\d+,\)")):

        def broken(
            recording: Recording, values: Mapping[str, float], wrong: float | None = wrong
        ) -> dict[str, NDArray[np.float64]]:
            angle = simulate(recording, values)["angle"]
            return {"angle": angle[:-1] if wrong is None else np.where(np.arange(angle.size) < 50, angle, wrong)}

        with pytest.raises(SimulatorError, match=message):
            diagnose(machine(1).record(1), replace(PROBLEM, simulator=broken), jobs=1)


def test_a_second_diagnosis_does_not_simulate_the_grid_again(tmp_path: Path) -> None:
    """Nor does one of other runs in the same setting; the answer is the same."""
    counted = Counted()
    problem = replace(PROBLEM, simulator=counted, version="1")
    made = machine(11)
    runs, references = made.record(3, LOAD), made.record(5)

    def spent(asked: Problem) -> tuple[int, float]:
        before = counted.runs
        found = diagnose(runs, asked, references=references, folder=tmp_path, jobs=1)
        return counted.runs - before, found.effects[0].parameters[0].value

    grid = sum(len(grid_of(each).points) for each in LIBRARY)
    cold, warm = spent(problem), spent(problem)
    assert cold[0] - warm[0] >= grid
    assert warm[1] == pytest.approx(cold[1], rel=1e-3)
    # Another version of the simulator, other bounds of an effect, or no name for the setting: never the old one.
    assert spent(replace(problem, version="2"))[0] == cold[0]
    wider = Library((effect("rubbing", "torque", "N m", 0.5), *LIBRARY.effects[1:]))
    counted.asked.clear()
    assert spent(replace(problem, library=wider))[0] < cold[0]
    first, *others = [
        [{each.key(each.parameters[0]): value} in counted.asked for value in grid_of(each).points[:, 0].tolist()]
        for each in wider
    ]
    assert all(first)
    assert not any(map(all, others))
    assert spent(replace(problem, group_of=lambda _: ""))[0] == cold[0]
    assert spent(replace(problem, version=""))[0] == cold[0]


def test_a_truncated_dictionary_is_built_anew(tmp_path: Path) -> None:
    """A disk that was full once does no harm later."""
    problem = replace(PROBLEM, version="1")
    made = machine(11)
    runs, references = made.record(2, LOAD), made.record(3)
    first = diagnose(runs, problem, references=references, folder=tmp_path, jobs=1)
    files = [each for each in tmp_path.rglob("*") if each.is_file()]
    assert files
    for file in files:
        file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    again = diagnose(runs, problem, references=references, folder=tmp_path, jobs=1)
    assert again.posterior == pytest.approx(first.posterior, rel=1e-2, abs=1e-6)
    assert all(np.load(file) is not None for file in files)


def test_runs_of_other_settings_are_no_repeats() -> None:
    """Two runs that did different things, without a name for it, say nothing of each other's noise."""
    made = machine(12)
    runs = made.record(1)
    named = diagnose([replace(run, setting="") for run in runs], PROBLEM, jobs=1)
    assert named.verdict is Verdict.NO_GAP
    assert {trace.setting for trace in named.traces} == {"run 1", "run 2"}


def test_settings_may_be_mixed_in_one_call() -> None:
    """One with references, one without: both count, and the notes say which has none."""
    made = machine(13)
    references = [run for run in made.record(5) if run.setting == "slow"]
    found = diagnose(made.record(3, LOAD), PROBLEM, references=references, jobs=1)
    assert {trace.setting for trace in found.traces} == {"slow", "fast"}
    assert any("'fast' has no reference" in note for note in found.notes)
    assert not any("'slow' has" in note for note in found.notes)
    assert found.candidates[0].names == ("load",)


def test_references_of_another_setting_are_refused() -> None:
    """The message names both settings."""
    made = machine(14)
    slow, fast = made.record(1)
    with pytest.raises(BadRecordingError, match=r"references in fast; recordings in slow"):
        diagnose([slow], PROBLEM, references=[fast], jobs=1)
    with pytest.raises(BadRecordingError, match="no recording"):
        diagnose([], PROBLEM, jobs=1)


def test_workers_and_the_order_of_recordings_change_nothing() -> None:
    """One process or two, forwards or backwards."""
    made = machine(15)
    runs, references = made.record(3, {"oil.drag": 0.05}), made.record(4)
    first = diagnose(runs, PROBLEM, references=references, jobs=1)
    for other in (
        diagnose(runs, PROBLEM, references=references, jobs=2),
        diagnose(runs[::-1], PROBLEM, references=references[::-1], jobs=1),
    ):
        assert other.verdict is first.verdict
        assert other.p_value == pytest.approx(first.p_value, rel=1e-3)
        assert other.posterior["oil",] == pytest.approx(first.posterior["oil",], abs=0.02)
        assert other.effects[0].parameters[0].value == pytest.approx(first.effects[0].parameters[0].value, rel=0.02)


def test_without_references_constants_of_the_machine_are_no_fault() -> None:
    """An arm that is heavier than drawn, within its tolerance, is no gap; a heavier load still is."""
    made = machine(16)
    made.constants = {"arm.mass": 1.05, "servo.stiffness": 0.96}
    healthy = diagnose(made.record(4), PROBLEM, jobs=1)
    assert healthy.verdict is Verdict.NO_GAP
    strict = diagnose(made.record(4), replace(PROBLEM, constants=()), jobs=1)
    assert strict.verdict is not Verdict.NO_GAP
    faulty = diagnose(made.record(4, {"rubbing.torque": 0.1}), PROBLEM, jobs=1)
    assert "rubbing" in faulty.candidates[0].names


def test_constants_far_from_nominal_are_linearised_where_the_recordings_are() -> None:
    """Little more than half the stiffness of the data sheet: the cause is named nevertheless, if not its size."""
    wide = tuple(replace(each, sigma=0.3, minimum=0.3, maximum=2.0) for each in PENDULUM_CONSTANTS)
    made = machine(17)
    made.constants = {"arm.mass": 1.0, "servo.stiffness": 0.6}
    problem = replace(PROBLEM, constants=wide)
    found = diagnose(made.record(4, {"rubbing.torque": 0.1}), problem, jobs=1)
    assert "rubbing" in found.candidates[0].names


def test_calibration_is_told_and_needs_references() -> None:
    """Constants that moved by more than a standard deviation are in the answer."""
    made = machine(18)
    made.constants = {"arm.mass": 1.12, "servo.stiffness": 1.0}
    found = diagnose(made.record(3, LOAD), PROBLEM, references=made.record(5), jobs=1)
    assert found.calibration["arm.mass"] == pytest.approx(2.4, abs=0.7)
    assert any("arm.mass" in note for note in found.notes)
    assert diagnose(made.record(3, LOAD), PROBLEM, jobs=1).calibration == {}


def test_a_constant_that_cannot_be_simulated_is_stepped_around() -> None:
    """A simulator that blows up at a lighter arm is calibrated all the same."""
    made = machine(19)
    made.constants = {"arm.mass": 1.0, "servo.stiffness": 1.1}
    problem = replace(PROBLEM, simulator=infeasible(lambda _, values: values.get("arm.mass", 1.0) > 1.04))
    found = diagnose(made.record(3, LOAD), problem, references=made.record(5), jobs=1)
    assert found.calibration.get("servo.stiffness", 0.0) > 1.0
    assert np.isfinite(found.references_left)


def test_effects_of_sensors_act_on_what_was_measured() -> None:
    """An encoder that is turned on its shaft is found however wrong the simulator is."""
    encoder = Sensed("encoder", lambda angle, values: angle + values.get("encoder.turn", 0.0))
    made = machine(23)
    runs = [
        replace(run, signals=(replace(run.signals[0], values=run.signals[0].values + 0.02),)) for run in made.record(3)
    ]
    library = Library((*LIBRARY, effect("encoder", "turn", "rad", 0.1)))
    wrong = replace(PROBLEM, simulator=lambda recording, values: {"angle": 0.8 * simulate(recording, values)["angle"]})
    problem = replace(wrong, library=library, sensing=encoder)
    found = diagnose(runs, problem, references=made.record(5), jobs=1)
    assert [each.name for each in found.effects] == ["encoder"]
    assert found.effects[0].parameters[0].value == pytest.approx(0.02, rel=0.1)


def test_an_experiment_is_named_that_would_split_a_set() -> None:
    """At a slow command a gain and one that comes with a lead look much the same; a fast swing separates them."""

    def still() -> Recording:
        return Recording("still", (Signal("angle", "rad", TIMES_S, np.zeros(STEPS), NOISE_RAD),), np.zeros(STEPS))

    def quick() -> Recording:
        return replace(still(), name="quick", inputs=0.5 * np.sin(8.0 * TIMES_S))

    made = machine(24)
    command = 0.3 + 0.05 * np.sin(2.0 * TIMES_S)
    problem = replace(PROBLEM, library=Library((effect("one", "share", "1", 0.5), effect("two", "share", "1", 0.5))))

    def either(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        shown = simulate(recording, {})["angle"] * (1.0 + values.get("one.share", 0.0) + values.get("two.share", 0.0))
        return {"angle": shown + 80.0 * values.get("two.share", 0.0) * np.gradient(recording.inputs)}

    noise = made.random.normal(0.0, NOISE_RAD, (8, STEPS))
    blank = Recording("held", (), command, setting="held")
    runs = [
        replace(
            blank,
            signals=(Signal("angle", "rad", TIMES_S, either(blank, {"one.share": share})["angle"] + row, NOISE_RAD),),
        )
        for row, share in zip(noise, [0.02] * 3 + [0.0] * 5, strict=True)
    ]
    offered = [Experiment("rest", still), Experiment("swing", quick)]
    whole = replace(problem, simulator=either, scatter=(), constants=())
    found = diagnose(runs[:3], whole, references=runs[3:], experiments=offered, jobs=1)
    assert found.verdict is Verdict.AMBIGUOUS
    assert found.next_experiment is not None
    assert found.next_experiment.name == "swing"

    # Stopped while the next run is planned, it keeps what is known by then.
    stages: list[str] = []
    stopped = diagnose(
        runs[:3],
        whole,
        references=runs[3:],
        experiments=offered,
        jobs=1,
        progress=lambda stage, _share: stages.append(stage),
        stop=lambda: stages[-1:] == ["planning the next run"],
    )
    assert (stopped.posterior, stopped.finished, stopped.next_experiment) == (found.posterior, False, None)


def test_a_nuisance_without_a_spread_is_refused() -> None:
    """And one that stands outside its own bounds."""
    with pytest.raises(ValueError, match="standard deviation"):
        Nuisance("x", "1", 0.0, 0.0, "assumed")
    with pytest.raises(ValueError, match="outside"):
        Nuisance("x", "1", 2.0, 1.0, "assumed", 0.0, 1.0)
    assert all(each.sigma > 0.0 for each in SCATTER)


def test_a_copy_is_no_repeat() -> None:
    """The same samples under two names show no scatter; they are refused by name."""
    runs = machine(25).record(2)
    copies = [runs[0], replace(runs[0], name="again")]
    with pytest.raises(BadRecordingError, match=r"again is a copy of .*leave it out, or give a run of its own"):
        diagnose(copies, PROBLEM, jobs=1)


def test_what_one_signal_cuts_short_is_said() -> None:
    """A topic that ends early leaves less of all to be compared: the notes name it, and how much that is."""
    runs = machine(5).record(2)
    short = Signal("temperature", "K", TIMES_S[:60], np.random.default_rng(1).normal(20.0, 0.1, 60), 0.1)
    runs = [replace(run, signals=(*run.signals, short)) for run in runs]

    def warm(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        return {**simulate(recording, values), "temperature": np.full(60, 20.0)}

    found = diagnose(runs, replace(PROBLEM, simulator=warm), jobs=1)
    said = f"{TIMES_S[59]:.3g} of {TIMES_S[-1]:.3g} s are compared, as temperature of"
    assert any(said in note for note in found.notes)


def test_a_setting_may_be_called_as_runs_without_one_are() -> None:
    """A run that names no setting is no repeat of one whose setting is `run 2`."""
    first, second, *_ = machine(6).record(2)
    given = [replace(first, setting="run 2"), replace(second, setting="")]
    assert [len(each.faulty) for each in settings_of(given, (), PROBLEM)] == [1, 1]


def test_an_effect_that_is_small_is_not_at_a_bound() -> None:
    """A delay of 1.8 ms out of 200 ms is near where it is off, beyond which there is nothing."""
    library = Library((effect("delay", "time", "s", 0.2),))
    made = machine(7)
    made.constants = {}
    late = replace(PROBLEM, library=library, constants=())
    runs = [replace(run, setting="") for run in made.record(1, {"delay.time": 0.0018})]
    found = diagnose(runs, late, jobs=1)
    (parameter,) = found.candidates[0].effects[0].parameters
    assert 0.0 < parameter.value < 0.004
    assert not parameter.at_bound
