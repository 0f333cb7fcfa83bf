"""Parts of the gap diagnosis: noise, independent samples, held-out scores, probes, bad input."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jammkle_gap.november.closing import closed_share
from jammkle_gap.november.diagnosis import diagnose
from jammkle_gap.november.effect import BadEffectError, Effect, EffectParameter, Library
from jammkle_gap.november.explanations import material
from jammkle_gap.november.fitting import Fit
from jammkle_gap.november.limits import Limits, limits_of
from jammkle_gap.november.noise import Hanging, NoiseSource, find_noise, still_noise
from jammkle_gap.november.recording import BadRecordingError, Recording, Signal
from jammkle_gap.november.residual import Layout, Weighting, autocorrelation_factor, lay_out
from jammkle_gap.november.runs import Runs
from jammkle_gap.november.scoring import Score, best_set, score
from jammkle_gap.november.sensitivity import probe, space_of
from jammkle_gap.november.verdict import Criteria, Verdict, judge

TIME_S = 0.01 * np.arange(600)


def parameter(name: str = "size", *, low: float = -1.0, high: float = 1.0) -> EffectParameter:
    return EffectParameter(name, "1", 0.0, low, high, "assumed")


def shapes() -> dict[str, np.ndarray]:
    """Waves that effects may add."""
    return {name: np.sin((k + 1) * TIME_S) for k, name in enumerate(("slow", "middle", "fast"))}


def linear(recording: Recording, values: dict[str, float]) -> dict[str, np.ndarray]:
    """A simulator whose effects add waves."""
    added = sum((values.get(f"{name}.size", 0.0) * wave for name, wave in shapes().items()), np.zeros(TIME_S.size))
    return {"x": recording.inputs + added}


LIBRARY = Library(tuple(Effect(name, "part", (parameter(),), f"Check {name}.") for name in shapes()))


def record(values: np.ndarray, name: str = "run", noise: float = 0.0) -> Recording:
    return Recording(name, (Signal("x", "m", TIME_S, values, noise),), np.zeros(TIME_S.size))


@pytest.mark.parametrize("size", [0.001, 0.1, 10.0])
def test_noise_is_told_from_motion_at_any_size(size: float) -> None:
    """White noise on a signal that moves and rests comes out within a fifth, whatever its unit."""
    random = np.random.default_rng(1)
    values = 100.0 * size * np.clip(np.sin(TIME_S), 0.0, 0.7) + random.normal(0.0, size, TIME_S.size)
    assert still_noise(Signal("x", "m", TIME_S, values)) == pytest.approx(size, rel=0.2)


def test_noise_is_not_below_the_rounding() -> None:
    """A sensor of few digits has the noise of its rounding, also where it stands still."""
    values = np.round(np.sin(TIME_S) / 0.05) * 0.05
    assert 0.9 < still_noise(Signal("x", "m", TIME_S, values)) / (0.05 / np.sqrt(12.0)) < 1.5


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (np.sin(3.0 * TIME_S), "never rests"),
        (np.full(TIME_S.size, 7.0), "7 m throughout"),
        (np.zeros(10), "too few"),
    ],
)
def test_noise_that_cannot_be_told_is_refused(values: np.ndarray, said: str) -> None:
    """A signal that never rests, never moves or is too short gets a line that says what to record instead."""
    with pytest.raises(BadRecordingError, match=said):
        still_noise(Signal("x", "m", TIME_S[: values.size], values))


def test_repeats_show_what_stretches_hide() -> None:
    """Runs that drift apart slowly have the noise of the drift, and their samples count as few."""
    random = np.random.default_rng(2)
    runs = [record(random.normal() * TIME_S + random.normal(0.0, 0.01, TIME_S.size), f"run {k}") for k in range(6)]
    sources, _ = find_noise((runs, [linear(run, {}) for run in runs]))
    assert "repeats" in sources["x"].source
    assert sources["x"].noise > 1.0
    assert sources["x"].factor > 50.0


@settings(max_examples=20, deadline=None)
@given(st.integers(1, 30))
def test_samples_that_stand_for_each_other_count_once(times: int) -> None:
    """White noise held for n samples has n samples to the independent one."""
    values = np.repeat(np.random.default_rng(times).standard_normal(60000 // times), times)
    assert autocorrelation_factor(values) == pytest.approx(times, rel=0.3, abs=0.2)


def test_the_limit_grows_as_less_is_known_of_the_noise() -> None:
    """A noise from few runs that drift lets more pass than one that is declared; never less than the base."""
    recording = record(np.zeros(TIME_S.size))
    limits = []
    for known_from in (float("inf"), 1e4, 50.0, 5.0):
        source = NoiseSource("x", "m", 1.0, "repeats", 100.0, Hanging(1.0, 100.0, known_from))
        layout = lay_out([recording], [{"x": np.zeros(TIME_S.size)}], {"x": 1.0}, factors={"x": source.factor})
        limits.append(limits_of(layout, {"x": source}, 1.2).of_signal["x"])
    assert limits[0] == 1.2
    assert limits == sorted(limits)
    assert limits[-1] > 2.0


def test_an_offset_counts_as_one_sample() -> None:
    """A constant has no independent samples but one."""
    assert autocorrelation_factor(np.ones(500)) == pytest.approx(500.0, rel=0.05)


def test_a_probe_without_effect_is_dropped_and_said_so() -> None:
    """An effect that moves nothing is not a candidate; the diagnosis names it."""
    random = np.random.default_rng(3)
    recording = record(0.3 * shapes()["slow"] + random.normal(0.0, 0.01, TIME_S.size), noise=0.01)
    library = Library((*LIBRARY.effects, Effect("nothing", "part", (parameter(),), "Check nothing.")))
    found = diagnose([recording], linear, library, jobs=1)
    assert list(found.dropped) == ["nothing"]
    assert "moves no signal" in found.dropped["nothing"]
    assert [each.name for each in found.effects] == ["slow"]


def test_a_parameter_that_is_silent_alone_is_stepped_with_the_others() -> None:
    """A time constant does nothing without a strength; together they are alive."""

    def decay(recording: Recording, values: dict[str, float]) -> dict[str, np.ndarray]:
        fade = 1.0 - np.exp(-TIME_S / values.get("creep.time", 1.0))
        return {"x": recording.inputs + values.get("creep.size", 0.0) * fade}

    creep = Effect("creep", "part", (parameter(), EffectParameter("time", "s", 1.0, 0.1, 5.0, "assumed")), "Check.")
    recording = record(np.zeros(TIME_S.size), noise=0.01)
    runs = Runs(decay, [recording], jobs=1)
    nominal = runs.nominal()
    layout = lay_out([recording], nominal, {"x": 0.01})
    (found,) = probe(Library((creep,)), runs, layout, layout.residual(nominal))
    assert found.alive
    assert np.abs(found.jacobian).max(axis=0).min() > 0.0
    assert np.abs(found.alone[:, 1]).max() == 0.0


def test_a_pair_is_found_though_its_halves_are_worth_nothing() -> None:
    """Two effects that hide one another are found together: singles do not decide which pairs are tried."""
    rough, smooth = np.sign(np.sin(5.0 * TIME_S)), np.sign(np.sin(5.0 * TIME_S)) + 0.2 * np.sin(0.9 * TIME_S)

    def hiding(recording: Recording, values: dict[str, float]) -> dict[str, np.ndarray]:
        pair = values.get("rough.size", 0.0) * rough + values.get("smooth.size", 0.0) * smooth
        return {"x": linear(recording, values)["x"] + pair}

    library = Library((*LIBRARY.effects, *(Effect(n, "part", (parameter(),), "Check.") for n in ("rough", "smooth"))))
    random = np.random.default_rng(4)
    truth = 0.5 * (smooth - rough)
    recording = record(truth + random.normal(0.0, 0.01, TIME_S.size), noise=0.01)
    found = diagnose([recording], hiding, library, jobs=1)
    assert ("rough", "smooth") in {each.names for each in found.candidates}, found.reasons


def test_what_one_recording_alone_shows_is_not_foretold_by_the_others() -> None:
    """A number that one block decides falls back to null when that block is held out: nothing of it is closed."""

    def stepped(recording: Recording, values: dict[str, float]) -> dict[str, np.ndarray]:
        bent = np.tanh(3.0 * values.get("slow.size", 0.0)) * shapes()["slow"]
        return {"x": recording.inputs[0] + (bent if recording.inputs[1] else 0.0)}

    random = np.random.default_rng(5)
    runs = []
    for shows in (False, False, False, True):
        inputs = (np.sin((5.0 + len(runs)) * TIME_S), shows)
        truth = stepped(Recording("truth", (), inputs), {"slow.size": 0.4})["x"]
        signal = Signal("x", "m", TIME_S, truth + random.normal(0.0, 0.01, TIME_S.size), 0.01)
        runs.append(Recording(f"run {len(runs)}", (signal,), inputs, regime="the same"))
    found = diagnose(runs, stepped, LIBRARY, jobs=1)
    assert found.verdict is Verdict.UNKNOWN
    assert found.gap.with_effect > 0.9 * found.gap.nominal


def test_what_one_recording_of_its_regime_shows_is_held_out_in_parts() -> None:
    """An effect that only one run can show is named, if each third of that run shows it."""

    def landed(recording: Recording, values: dict[str, float]) -> dict[str, np.ndarray]:
        bent = np.tanh(3.0 * values.get("fast.size", 0.0)) * shapes()["fast"]
        return {"x": bent if recording.inputs else np.zeros(TIME_S.size)}

    random = np.random.default_rng(6)
    runs = []
    for shows in (False, False, False, True):
        truth = landed(Recording("truth", (), shows), {"fast.size": 0.4})["x"]
        signal = Signal("x", "m", TIME_S, truth + random.normal(0.0, 0.01, TIME_S.size), 0.01)
        runs.append(Recording(f"run {len(runs)}", (signal,), shows, regime=f"regime {len(runs)}"))
    found = diagnose(runs, landed, LIBRARY, jobs=1)
    assert found.verdict is Verdict.EFFECTS
    assert [effect.name for effect in found.effects] == ["fast"]
    assert found.effects[0].parameters[0].value == pytest.approx(0.4, rel=0.05)


def test_no_run_is_spent_on_a_recording_that_an_effect_leaves_alone() -> None:
    """A recording that no probe of an effect changes is not run again for it."""

    def one_sided(recording: Recording, values: dict[str, float]) -> dict[str, np.ndarray]:
        return {"x": values.get("slow.size", 0.0) * shapes()["slow"] * recording.inputs}

    runs = [Recording(f"run {k}", record(np.zeros(TIME_S.size)).signals, float(k)) for k in range(2)]
    counted = Runs(one_sided, runs, jobs=1)
    nominal = counted.nominal()
    layout = lay_out(runs, nominal, {"x": 0.01})
    probe(Library((LIBRARY.effects[0],)), counted, layout, layout.residual(nominal))
    before = counted.spent.runs
    counted.evaluate([{"slow.size": 0.1}, {"slow.size": 0.2}])
    assert counted.spent.runs - before == 2


def test_without_a_gap_nothing_is_fitted() -> None:
    """Where there is nothing to explain, no more than the probes is run."""
    random = np.random.default_rng(7)
    found = diagnose([record(random.normal(0.0, 0.01, TIME_S.size), noise=0.01)], linear, LIBRARY, jobs=1)
    assert found.verdict is Verdict.NO_GAP
    assert found.spent.runs == 1 + len(LIBRARY.effects)
    assert found.probabilities["no_gap"] > 0.9


def test_a_run_is_made_once_and_counted() -> None:
    """The same point is not simulated again."""
    runs = Runs(linear, [record(np.zeros(TIME_S.size))], jobs=1)
    for _ in range(3):
        runs.evaluate([{}, {"slow.size": 0.1}])
    assert runs.spent.runs == 2
    assert runs.spent.simulated_s == pytest.approx(2 * TIME_S[-1])


def test_a_simulator_that_cannot_be_sent_runs_here() -> None:
    """One that holds a lock cannot be pickled, and is run in this process."""
    import threading  # noqa: PLC0415  # only to have something that cannot be pickled

    lock = threading.Lock()

    def locked(recording: Recording, values: dict[str, float]) -> dict[str, np.ndarray]:
        with lock:
            return linear(recording, values)

    runs = Runs(locked, [record(np.zeros(TIME_S.size))], jobs=2)
    assert len(runs.evaluate([{}, {"slow.size": 0.1}])) == 2


def test_a_declared_offset_of_a_sensor_is_no_gap() -> None:
    """What the data sheet allows is taken off; what exceeds it is not."""
    random = np.random.default_rng(5)
    noise = random.normal(0.0, 0.01, TIME_S.size)
    for offset, verdict in ((0.08, Verdict.NO_GAP), (0.5, Verdict.UNKNOWN)):
        signal = Signal("x", "m", TIME_S, noise + offset, 0.01, bias=0.05)
        recording = Recording("run", (signal,), np.zeros(TIME_S.size))
        assert diagnose([recording], linear, LIBRARY, jobs=1).verdict is verdict


def test_every_run_may_have_a_sensor_offset_of_its_own() -> None:
    """Runs that lie off to either side are no gap; an effect beside them is named, alone, also with references."""
    random = np.random.default_rng(9)

    def runs(size: float, offsets: tuple[float, ...]) -> list[Recording]:
        wave = size * shapes()["slow"]
        return [
            Recording(
                f"run {offset}",
                (Signal("x", "m", TIME_S, wave + offset + random.normal(0.0, 0.01, TIME_S.size), 0.01, bias=0.05),),
                np.zeros(TIME_S.size),
                regime=f"at {offset}",
            )
            for offset in offsets
        ]

    offsets = (0.08, -0.08, 0.03)
    assert diagnose(runs(0.0, offsets), linear, LIBRARY, jobs=1).verdict is Verdict.NO_GAP
    for references in ([], runs(0.0, (-0.05, 0.06))):
        found = diagnose(runs(0.3, offsets), linear, LIBRARY, references=references, jobs=1)
        assert found.verdict is Verdict.EFFECTS, found.reasons
        assert [each.name for each in found.effects] == ["slow"]
        assert found.effects[0].parameters[0].value == pytest.approx(0.3, abs=0.01)


def test_subsystems_and_horizons_are_not_blamed_for_a_sensor_offset() -> None:
    """What the data sheet allows is taken off there too, of each run by itself, also where only some runs tell."""

    class Restarting:
        """Restarts on the first run only."""

        def __call__(self, recording: Recording, values: dict[str, float]) -> dict[str, np.ndarray]:
            return linear(recording, values)

        def restarted(self, recording: Recording, *_: object) -> dict[str, np.ndarray]:
            return linear(recording, {}) if recording.name == "first" else {}

    random = np.random.default_rng(10)
    recordings = [
        Recording(
            name,
            (Signal("x", "m", TIME_S, offset + random.normal(0.0, 0.01, TIME_S.size), 0.01, bias=0.05),),
            np.zeros(TIME_S.size),
        )
        for name, offset in (("first", 0.08), ("second", -0.08))
    ]
    simulator = Restarting()
    found = diagnose(recordings, simulator, LIBRARY, subsystems={"part": simulator.restarted}, jobs=1)
    assert not found.where.subsystems[0].to_blame
    assert all(each.gaps["x"] == pytest.approx(1.0, abs=0.1) for each in found.where.horizons)


def test_a_recording_as_its_own_reference_is_refused() -> None:
    """A reference must be another run."""
    recording = record(np.random.default_rng(6).standard_normal(TIME_S.size))
    with pytest.raises(BadRecordingError, match="run of its own"):
        diagnose([recording], linear, LIBRARY, references=[recording], jobs=1)


def test_bad_input_gets_one_line_that_says_what_to_do() -> None:
    """Nothing at all, too short, an unknown signal, a wrong shape, a nominal run that fails."""
    good = record(np.random.default_rng(7).standard_normal(TIME_S.size), noise=1.0)
    short = Recording("blink", (Signal("x", "m", TIME_S[:40], np.zeros(40), 1.0),), np.zeros(40))
    with pytest.raises(BadRecordingError, match="give at least one"):
        diagnose([], linear, LIBRARY)
    with pytest.raises(BadRecordingError, match="'blink' is too short to hold anything out"):
        diagnose([short], lambda recording, _: {"x": recording.inputs}, LIBRARY)
    with pytest.raises(BadRecordingError, match="gives 'y', which recording 'run' does not have"):
        diagnose([good], lambda *_: {"y": np.zeros(3)}, LIBRARY)
    with pytest.raises(BadRecordingError, match=r"must be \(600,\)"):
        diagnose([good], lambda *_: {"x": np.zeros(3)}, LIBRARY)
    with pytest.raises(BadRecordingError, match="not a number"):
        diagnose([good], lambda *_: {"x": np.full(TIME_S.size, np.nan)}, LIBRARY)
    with pytest.raises(BadEffectError, match="no finite bounds"):
        EffectParameter("size", "1", 0.0, -np.inf, 1.0, "nowhere")


def test_a_run_that_diverges_is_a_bad_candidate_and_no_crash() -> None:
    """A simulator that fails at some values keeps the diagnosis going."""
    random = np.random.default_rng(8)

    def touchy(recording: Recording, values: dict[str, float]) -> dict[str, np.ndarray]:
        if abs(values.get("fast.size", 0.0)) > 0.05:
            msg = "diverged"
            raise FloatingPointError(msg)
        return linear(recording, values)

    recording = record(0.3 * shapes()["slow"] + random.normal(0.0, 0.01, TIME_S.size), noise=0.01)
    found = diagnose([recording], touchy, LIBRARY, jobs=1)
    assert [each.name for each in found.effects] == ["slow"]


def graded(left: dict[tuple[str, ...], float]) -> tuple[Layout, list[Score]]:
    """Scores of candidates that leave so much of one signal's gap, beside five signals that lie far below theirs."""
    names = ("x", "a", "b", "c", "d", "e")
    zeros = np.zeros(TIME_S.size)
    recording = Recording("run", tuple(Signal(name, "m", TIME_S, zeros, 1.0) for name in names))
    layout = lay_out([recording], [dict.fromkeys(names, zeros)], dict.fromkeys(names, 1.0))
    wave = (layout.signal_of == layout.names.index("x")) * np.where(np.arange(layout.measured.size) % 2, 1.0, -1.0)
    scores = []
    for effects, gap in left.items():
        space = space_of([LIBRARY.effect(name) for name in effects])
        jacobian = np.zeros((wave.size, len(space.keys)))
        fit = Fit(space, space.null, gap * wave, jacobian, 0.0)
        scores.append(score(fit, layout, Weighting(np.ones(len(names)), np.ones(len(names)))))
    return layout, scores


@pytest.mark.parametrize(("pair", "named"), [(1.59, ("slow",)), (1.2, ("fast", "slow"))])
def test_an_effect_that_closes_next_to_nothing_is_not_named(pair: float, named: tuple[str, ...]) -> None:
    """However sure the scores are, it must close a share of the gap; also where quiet signals pull the gap below 1."""
    layout, scores = graded({(): 2.5, ("slow",): 1.6, ("fast",): 2.4, ("fast", "slow"): pair})
    assert layout.gap(scores[0].held_out) == pytest.approx(2.5 / np.sqrt(6.0))
    (kept,) = material(layout, best_set(scores, 1), scores, Criteria(), Limits(1.5, dict.fromkeys(layout.names, 1.5)))
    assert kept.names == named


@pytest.mark.parametrize(("pair", "lead"), [(4.99, "slow"), (3.0, "fast + slow")])
def test_a_lead_holds_no_effect_that_closes_next_to_nothing(pair: float, lead: str) -> None:
    """Also with UNKNOWN, where nothing is clearly better, what is handed on is only what closes something."""
    layout, scores = graded({(): 8.0, ("slow",): 5.0, ("fast",): 7.9, ("fast", "slow"): pair})
    found = judge(layout, scores[:1], scores, Criteria(), Limits(1.5, dict.fromkeys(layout.names, 1.5)))
    assert found.verdict is Verdict.UNKNOWN
    assert " + ".join(found.chosen[0].names) == lead
    assert f"as a lead: {lead} would close" in found.reasons[-1]


def test_closing_is_nothing_where_there_was_no_gap() -> None:
    """All of it is 1, none is 0, and without a gap there is no number."""
    assert closed_share(5.0, 1.0) == 1.0
    assert closed_share(5.0, 5.0) == 0.0
    assert np.isnan(closed_share(1.01, 1.0))
