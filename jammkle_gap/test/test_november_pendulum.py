"""The gap diagnosis on a pendulum whose reality is not its simulator: other integrator, friction, delay and noise."""

from __future__ import annotations

import math
import sys
from typing import TYPE_CHECKING

import cloudpickle
import numpy as np
import pytest
from numba import njit

from jammkle_gap.november.diagnosis import diagnose
from jammkle_gap.november.effect import Effect, EffectParameter, Library
from jammkle_gap.november.experiments import Experiment
from jammkle_gap.november.recording import Phase, Recording, Signal
from jammkle_gap.november.result import as_dict
from jammkle_gap.november.verdict import Verdict

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from jammkle_gap.november.diagnosis import Diagnosis

STEP_S = 0.01
SAMPLES = 500
NOISE = {"angle": 0.004, "torque": 0.02}
RUNS = ("sweep", "steps", "sine", "two")


def command(kind: str) -> NDArray[np.float64]:
    """Give what the pendulum is told, rad."""
    time_s = STEP_S * np.arange(SAMPLES)
    if kind == "sweep":
        return 0.5 * np.sin(2.0 * np.pi * (0.3 * time_s + 0.12 * time_s**2))
    if kind == "steps":
        return 0.4 * np.sign(np.sin(2.0 * np.pi * 0.4 * time_s)) * (time_s > 0.6)
    if kind == "sine":
        return 0.8 * np.sin(2.0 * np.pi * 0.7 * time_s)
    return 0.4 * (np.sin(2.0 * np.pi * 0.5 * time_s) + 0.4 * np.sin(2.0 * np.pi * 1.7 * time_s))


@njit
def swing(late, gain, mass, damping, coulomb):  # noqa: ANN001, ANN201  # compiled
    """Semi-implicit Euler, four steps a sample, friction as a hyperbolic tangent."""
    inertia, weight, small = mass * 0.04 + 0.002, mass * 9.81 * 0.2, STEP_S / 4
    angle = rate = 0.0
    angles, torques = np.empty_like(late), np.empty_like(late)
    for k in range(late.size):
        angles[k], torques[k] = angle, gain * (late[k] - angle) - 0.05 * rate
        for _ in range(4):
            torque = gain * (late[k] - angle) - 0.05 * rate
            torque -= damping * rate + coulomb * math.tanh(rate / 0.02) + weight * math.sin(angle)
            rate += small * torque / inertia
            angle += small * rate
    return angles, torques


def simulate(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
    """The simulator that is diagnosed."""
    time_s = STEP_S * np.arange(SAMPLES)
    angles, torques = swing(
        np.interp(time_s - values.get("delay.time", 0.0), time_s, recording.inputs),
        3.0 * values.get("gain.scale", 1.0),
        0.5 + values.get("payload.mass", 0.0),
        0.02 + values.get("damping.torque", 0.0),
        values.get("coulomb.torque", 0.0),
    )
    return {"angle": angles + values.get("offset.angle", 0.0), "torque": torques}


@njit
def acceleration(angle, rate, target, gain, mass, damping, coulomb, drag):  # noqa: ANN001, ANN201  # compiled
    """Other friction: an arcus tangent with a bump at rest, and air drag."""
    rub = coulomb * 2.0 / math.pi * math.atan(rate / 0.01) * (1.0 + 0.1 * math.exp(-((rate / 0.1) ** 2)))
    torque = gain * (target - angle) - 0.05 * rate - damping * rate - rub - drag * rate * abs(rate)
    return (torque - mass * 9.81 * 0.2 * math.sin(angle)) / (mass * 0.04 + 0.002)


@njit
def swing_really(late, gain, mass, damping, coulomb, drag):  # noqa: ANN001, ANN201  # compiled
    """Runge-Kutta of fourth order, seven steps a sample."""
    angle = rate = 0.0
    h = STEP_S / 7
    angles, torques = np.empty_like(late), np.empty_like(late)
    for k in range(late.size):
        u = late[k]
        angles[k], torques[k] = angle, gain * (u - angle) - 0.05 * rate
        for _ in range(7):
            a1 = acceleration(angle, rate, u, gain, mass, damping, coulomb, drag)
            r2 = rate + h / 2 * a1
            a2 = acceleration(angle + h / 2 * rate, r2, u, gain, mass, damping, coulomb, drag)
            r3 = rate + h / 2 * a2
            a3 = acceleration(angle + h / 2 * r2, r3, u, gain, mass, damping, coulomb, drag)
            r4 = rate + h * a3
            a4 = acceleration(angle + h * r3, r4, u, gain, mass, damping, coulomb, drag)
            angle += h / 6 * (rate + 2 * r2 + 2 * r3 + r4)
            rate += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    return angles, torques


def measure(kind: str, truth: Mapping[str, float], random: np.random.Generator) -> Recording:
    """The reality: jittered delay, coloured noise."""
    time_s = STEP_S * np.arange(SAMPLES)
    delay_s = truth.get("delay.time", 0.0) * (1.0 + 0.1 * random.standard_normal(SAMPLES))
    angles, torques = swing_really(
        np.interp(time_s - delay_s, time_s, command(kind)),
        3.0 * truth.get("gain.scale", 1.0),
        0.5 + truth.get("payload.mass", 0.0),
        0.02 + truth.get("damping.torque", 0.0),
        truth.get("coulomb.torque", 0.0),
        truth.get("drag", 0.0),
    )
    clean = {"angle": angles + truth.get("offset.angle", 0.0), "torque": torques}
    units = {"angle": "rad", "torque": "N m"}
    signals = []
    for name, values in clean.items():
        white = random.standard_normal(SAMPLES + 1)
        coloured = (white[1:] + 0.4 * white[:-1]) / math.hypot(1.0, 0.4)
        signals.append(Signal(name, units[name], time_s, values + NOISE[name] * coloured))
    phases = (Phase("early", 0.0, 2.5), Phase("late", 2.5, 5.0))
    return Recording(kind, tuple(signals), command(kind), phases, regime=kind)


def effect(name: str, subsystem: str, parameter: tuple[str, str, float, float, float]) -> Effect:
    """Make an effect of one parameter."""
    return Effect(name, subsystem, (EffectParameter(*parameter, "assumed"),), f"Check {name}.")


LIBRARY = Library(
    (
        effect("damping", "mechanics", ("torque", "N m s", 0.0, 0.0, 0.2)),
        effect("coulomb", "mechanics", ("torque", "N m", 0.0, 0.0, 0.5)),
        effect("delay", "timing", ("time", "s", 0.0, 0.0, 0.06)),
        effect("gain", "drive", ("scale", "1", 1.0, 0.5, 2.0)),
        effect("payload", "mechanics", ("mass", "kg", 0.0, 0.0, 0.3)),
        effect("offset", "sensing", ("angle", "rad", 0.0, -0.1, 0.1)),
    )
)


def trial(truth: Mapping[str, float], seed: int, library: Library = LIBRARY, *, references: bool = True) -> Diagnosis:
    """Measure and diagnose, with references of the same machine in good order by default."""
    random = np.random.default_rng(seed)
    recordings = [measure(kind, truth, random) for kind in RUNS]
    good = [measure(kind, {}, random) for kind in RUNS] if references else []
    return diagnose(recordings, simulate, library, references=good, jobs=1)


SINGLES = (
    {"damping.torque": 0.03},
    {"damping.torque": 0.12},
    {"coulomb.torque": 0.04},
    {"coulomb.torque": 0.2},
    {"delay.time": 0.008},
    {"delay.time": 0.03},
    {"gain.scale": 0.8},
    {"gain.scale": 1.1},
    {"payload.mass": 0.03},
    {"payload.mass": 0.15},
    {"offset.angle": 0.015},
    {"offset.angle": -0.06},
)


@pytest.mark.parametrize("truth", SINGLES, ids=str)
def test_a_single_effect_is_named_with_its_size(truth: dict[str, float]) -> None:
    """At a small and a large size, the right name alone; the value lies in the interval; most of the gap closes."""
    found = trial(truth, 11)
    ((key, value),) = truth.items()
    assert found.verdict is Verdict.EFFECTS, found.reasons
    assert [each.name for each in found.effects] == [key.split(".")[0]]
    (parameter,) = found.effects[0].parameters
    assert parameter.interval[0] <= value <= parameter.interval[1]
    assert found.gap.closed > 0.85
    assert found.probabilities[found.effects[0].name] > 0.7
    assert sum(found.probabilities.values()) == pytest.approx(1.0)


@pytest.mark.parametrize(
    "truth",
    [
        {"coulomb.torque": 0.08, "offset.angle": 0.02},
        {"payload.mass": 0.06, "gain.scale": 1.4},
        {"delay.time": 0.02, "damping.torque": 0.05},
    ],
    ids=str,
)
def test_a_pair_is_named_as_a_pair(truth: dict[str, float]) -> None:
    """Two effects at once, also where they nearly make up for each other."""
    found = trial(truth, 21)
    assert found.verdict is Verdict.EFFECTS, found.reasons
    assert {each.name for each in found.effects} == {key.split(".")[0] for key in truth}


def test_without_references_the_simulators_own_faults_are_no_finding() -> None:
    """The same machine, without references: still the right name and nothing else beside it."""
    found = trial({"coulomb.torque": 0.1}, 31, references=False)
    assert found.verdict is Verdict.EFFECTS, found.reasons
    assert [each.name for each in found.effects] == ["coulomb"]


def test_no_gap_is_no_false_alarm() -> None:
    """Not one of 30 machines in good order is given a name, with references or without."""
    verdicts = [trial({}, 100 + seed, references=seed % 3 > 0).verdict for seed in range(30)]
    assert verdicts.count(Verdict.NO_GAP) == len(verdicts), verdicts


@pytest.mark.parametrize("truth", SINGLES[1::2], ids=str)
def test_what_is_not_in_the_library_gets_no_wrong_name(truth: dict[str, float]) -> None:
    """With the true effect taken out of the library, nothing else is named instead."""
    (key,) = truth
    found = trial(truth, 41, LIBRARY.without(key.split(".")[0]))
    assert found.verdict in {Verdict.UNKNOWN, Verdict.AMBIGUOUS}, (found.effects, found.reasons)


def test_air_drag_is_unknown_and_gets_a_formula_or_none_but_no_name() -> None:
    """A friction that no effect has, as the square of the rate, is real and has no name."""
    found = trial({"drag": 0.05}, 51)
    assert found.verdict is Verdict.UNKNOWN
    assert found.probabilities["unknown"] > 0.5


def simulate_twin(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
    """As the simulator, with a second effect that does on these runs what the payload does."""
    mass = values.get("payload.mass", 0.0) + values.get("twin.mass", 0.0) * (0.0 if recording.name == "tell" else 1.0)
    return simulate(recording, {**values, "payload.mass": mass})


def test_twins_are_ambiguous_and_the_experiment_that_splits_them_is_named() -> None:
    """Two effects that do the same are both in the set; of the runs on offer, the one in which they differ is named."""
    random = np.random.default_rng(61)
    recordings = [measure(kind, {"payload.mass": 0.1}, random) for kind in RUNS]
    library = Library((*LIBRARY.effects, effect("twin", "mechanics", ("mass", "kg", 0.0, 0.0, 0.3))))
    blank = measure("sine", {}, random)
    plans = [
        Experiment("same again", lambda: blank),
        Experiment("tell", lambda: Recording("tell", blank.signals, blank.inputs)),
    ]
    found = diagnose(recordings, simulate_twin, library, experiments=plans, jobs=1)
    assert found.verdict is Verdict.AMBIGUOUS, found.reasons
    assert {each.names for each in found.candidates} == {("payload",), ("twin",)}
    assert found.next_experiment is not None
    assert found.next_experiment.name == "tell"
    assert found.next_experiment.difference > 2.0


@pytest.mark.parametrize("by_value", [True, False])
def test_two_processes_give_the_same_answer(by_value: bool) -> None:  # noqa: FBT001  # a parameter of the test
    """Side by side or not, the result is the same; also where the processes cannot import the simulator."""
    module = sys.modules[simulate.__module__]
    if by_value:
        cloudpickle.register_pickle_by_value(module)
    random = np.random.default_rng(71)
    recordings = [measure(kind, {"payload.mass": 0.1}, random) for kind in RUNS]
    one, two = (diagnose(recordings, simulate, LIBRARY, jobs=jobs) for jobs in (1, 2))
    if by_value:
        cloudpickle.unregister_pickle_by_value(module)
    assert one.effects == two.effects
    assert one.spent.runs == two.spent.runs


def test_a_stop_keeps_what_is_done() -> None:
    """Stopped among the pairs, there still is a diagnosis, and it says that it is not finished."""
    random = np.random.default_rng(81)
    recordings = [measure(kind, {"payload.mass": 0.1, "coulomb.torque": 0.1}, random) for kind in RUNS]
    stages: list[str] = []
    found = diagnose(
        recordings,
        simulate,
        LIBRARY,
        on_progress=lambda stage, _, __: stages.append(stage),
        stop=lambda: any("combinations" in stage for stage in stages),
        jobs=1,
    )
    assert not found.finished
    assert {"payload", "coulomb"} & set(found.ranking[0][0])


def test_it_says_where_and_fits_into_json() -> None:
    """Shares over signals and phases add up to one; subsystems at the floor are not blamed; a file has it all."""
    random = np.random.default_rng(91)
    recordings = [measure(kind, {"offset.angle": 0.05}, random) for kind in RUNS]

    def sensing(recording: Recording, _: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        return {"angle": simulate(recording, {})["angle"]}

    def drive(recording: Recording, _: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        return {"torque": simulate(recording, {})["torque"]}

    found = diagnose(recordings, simulate, LIBRARY, subsystems={"sensing": sensing, "drive": drive}, jobs=1)
    assert sum(place.share for place in found.where.places) == pytest.approx(1.0)
    assert {(place.signal, place.phase) for place in found.where.places[:2]} == {("angle", "early"), ("angle", "late")}
    assert {each.name: each.to_blame for each in found.where.subsystems} == {"sensing": True, "drive": False}
    assert found.signatures[0].kind == "offset"
    assert found.signatures[0].value == pytest.approx(0.05, abs=0.002)
    plain = as_dict(found)
    assert set(plain) >= {"verdict", "effects", "set", "probabilities", "where", "gap", "next_experiment", "runtime"}
    assert plain["gap"]["signals"]["angle"]["nominal_physical"] == pytest.approx(0.05, rel=0.05)
