"""Features: means over bins, aligned at events, and the noise that they have."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_gap import BadRecordingError, Recording, Signal
from jammkle_gap.core.features import (
    aligned_s,
    features_of,
    layout_of,
    measured,
    new_readings,
    noise_of,
    refuse_unknown_noise,
    stuck_in,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    Motion = Callable[[NDArray[np.float64], np.random.Generator], NDArray[np.float64]]

TIMES_S = 0.002 * np.arange(500)


@dataclass(frozen=True)
class Peak:
    """Registers `force` at its peak; `tank` keeps to the clock."""

    def events(self, recording: Recording, values: Mapping[str, NDArray[np.float64]]) -> Mapping[str, float]:
        force = values["force"]
        return {"peak": float(recording.signal("force").time_s[int(np.argmax(force))])} if force.max() > 0.5 else {}

    def events_of(self, recording: Recording, signal: str) -> tuple[str, ...]:
        del recording
        return ("peak",) if signal == "force" else ()


def landing(peak_s: float) -> Recording:
    """Return a force with a bump, and a pressure that knows nothing of it."""
    force = np.exp(-np.square((TIMES_S - peak_s) / 0.05))
    return Recording("run", (Signal("force", "N", TIMES_S, force), Signal("tank", "Pa", TIMES_S, 1e5 * TIMES_S)))


def test_a_run_that_lands_later_differs_by_the_event_alone() -> None:
    """Signals are laid over each other; the time is a feature of its own."""
    runs = [landing(0.4), landing(0.46)]
    layout = layout_of(runs, 0.02, Peak())
    early, late = (features_of(layout, run, measured(run), Peak()) for run in runs)
    count = 2 * layout.bins
    assert early[:count] == pytest.approx(late[:count], rel=1e-3, abs=1e-3)
    assert late[count] - early[count] == pytest.approx(0.06)
    unregistered = layout_of(runs, 0.02, None)
    apart = [features_of(unregistered, run, measured(run), None) for run in runs]
    assert np.abs(apart[0] - apart[1]).max() > 0.5


def test_a_simulation_without_the_event_says_nothing_of_its_time() -> None:
    """A foot that never lands shows so in its force; a time that it does not have is no number."""
    run = landing(0.4)
    layout = layout_of([run], 0.02, Peak())
    never = features_of(layout, run, {"force": np.zeros(500), "tank": 1e5 * TIMES_S}, Peak())
    assert np.isnan(never[-1])
    assert np.isfinite(never[:-1]).all()


def test_time_is_stretched_between_events_and_shifted_outside() -> None:
    """Two events on two clocks; one that comes in the wrong order, or that a run lacks, is passed over."""
    own_s, common_s = {"touch": 1.0, "slip": 2.0}, {"touch": 1.5, "slip": 3.5}
    times_s = np.array([0.0, 1.0, 1.5, 2.0, 2.4])
    assert aligned_s(times_s, ("touch", "slip"), own_s, common_s) == pytest.approx([0.5, 1.5, 2.5, 3.5, 3.9])
    assert aligned_s(times_s, ("slip", "touch"), own_s, common_s) == pytest.approx(times_s + 1.5)
    assert aligned_s(times_s, ("touch", "slip"), {"touch": 1.0}, common_s) == pytest.approx(times_s + 0.5)
    assert aligned_s(times_s, (), own_s, common_s) is times_s


def test_bins_are_means_and_those_without_samples_are_interpolated() -> None:
    """A signal of 20 Hz in bins of 20 ms."""
    time_s = 0.05 * np.arange(40)
    run = Recording("slow", (Signal("level", "m", time_s, 2.0 * time_s),))
    layout = layout_of([run], 0.02, None)
    found = layout.by_signal(features_of(layout, run, measured(run), None))[0]
    assert found == pytest.approx(2.0 * (layout.time_s - 0.01), abs=0.04)
    assert np.isfinite(found).all()


def test_a_signal_that_the_simulator_does_not_give_stays_open() -> None:
    """It is not compared, rather than compared with 0."""
    run = landing(0.4)
    layout = layout_of([run], 0.02, None)
    found = layout.by_signal(features_of(layout, run, {"tank": 1e5 * TIMES_S}, None))
    assert np.isnan(found[0]).all()
    assert np.isfinite(found[1]).all()


def test_runs_that_hardly_overlap_or_share_no_signal_are_refused() -> None:
    """The message says what to do."""
    short = Recording("short", (Signal("force", "N", TIMES_S[:20], np.zeros(20)),))
    with pytest.raises(BadRecordingError, match="record longer"):
        layout_of([landing(0.4), short], 0.02, None)
    other = Recording("other", (Signal("heat", "K", TIMES_S, np.zeros(500)),))
    with pytest.raises(BadRecordingError, match="no signal in common"):
        layout_of([landing(0.4), other], 0.02, None)
    grams = Recording("grams", (Signal("force", "kN", TIMES_S, np.zeros(500)),))
    with pytest.raises(BadRecordingError, match="give 'force' in N and kN; convert"):
        layout_of([landing(0.4), grams], 0.02, None)
    absolute = Recording("absolute", (Signal("force", "N", 1e9 + TIMES_S, np.sin(TIMES_S)),))
    with pytest.raises(BadRecordingError, match="times count from the start"):
        layout_of([absolute], 0.02, None)


def test_noise_is_that_of_every_run_at_its_own_rate() -> None:
    """Of a fast and a slow run in any order: the variance of a bin is the mean of both."""
    runs = [
        Recording("run", (Signal("force", "N", times, np.sin(times), 0.1),))
        for times in (np.arange(0.0, 10.0, 1e-3), np.arange(0.0, 10.0, 2e-2))
    ]
    fast, slow, both, turned = (
        layout_of(chosen, 0.02, None).floor[0] ** 2 for chosen in (runs[:1], runs[1:], runs, runs[::-1])
    )
    assert both == pytest.approx(turned)
    assert both == pytest.approx((fast + slow) / 2.0, rel=0.05)


@pytest.mark.parametrize("noise", [0.01, 0.3])
def test_white_noise_is_found_below_a_motion(noise: float) -> None:
    """Within a fifth, though the motion is a hundred times larger and jumps twice."""
    random = np.random.default_rng(1)
    motion = np.sin(3.0 * TIMES_S) + (TIMES_S > 0.3) - 2.0 * (TIMES_S > 0.7)
    found, _ = noise_of(Signal("angle", "rad", TIMES_S, motion + random.normal(0.0, noise, 500)))
    assert found == pytest.approx(noise, rel=0.2)


def test_steps_of_a_coarse_sensor_are_its_resolution() -> None:
    """At rest a coarse sensor shows no noise, and is not exact for that."""
    values = 0.25 * np.round(np.linspace(0.0, 3.0, 500) / 0.25)
    assert noise_of(Signal("angle", "rad", TIMES_S, values))[1] == pytest.approx(0.25)


def test_what_is_declared_counts() -> None:
    """Nothing is estimated beside a data sheet."""
    signal = Signal("angle", "rad", TIMES_S, np.random.default_rng(0).normal(size=500), noise=0.01)
    assert noise_of(signal) == (0.01, 0.0)


STEP, BIN_S, DURATION_S = 0.1, 0.02, 2.0


def still(time_s: NDArray[np.float64], random: np.random.Generator) -> NDArray[np.float64]:
    """Return a machine that stands anywhere between two codes."""
    return np.full(time_s.shape, random.uniform(-STEP, STEP))


def ramp(steps_per_bin: float) -> Motion:
    """Return a steady motion, of so many steps in a bin or a tenth more or less."""

    def motion(time_s: NDArray[np.float64], random: np.random.Generator) -> NDArray[np.float64]:
        speed = steps_per_bin * random.uniform(0.9, 1.1) * STEP / BIN_S
        return speed * time_s + random.uniform(-STEP, STEP)

    return motion


def swing(steps: float) -> Motion:
    """Return an oscillation of 1 Hz, which turns on a code or between two."""

    def motion(time_s: NDArray[np.float64], random: np.random.Generator) -> NDArray[np.float64]:
        phase, middle = random.uniform(0.0, 2.0 * np.pi), random.uniform(-STEP, STEP)
        return steps * STEP * np.sin(2.0 * np.pi * time_s + phase) + middle

    return motion


def release(time_s: NDArray[np.float64], random: np.random.Generator) -> NDArray[np.float64]:
    """Return a machine that stands still and then falls."""
    return random.uniform(-STEP, STEP) - 5.0 * np.square(np.maximum(time_s - 1.0, 0.0))


@pytest.mark.parametrize("rate_hz", [100.0, 500.0])
@pytest.mark.parametrize("noise", [0.0, 0.1, 0.25, 0.5, 2.0])
@pytest.mark.parametrize(
    "motion", [still, ramp(0.1), ramp(0.5), ramp(1.5), ramp(7.3), swing(0.8), swing(30.0), release]
)
@pytest.mark.parametrize("repeats", [1, 7])
def test_the_floor_bounds_the_error_of_a_bin_and_is_at_most_three_times_that(
    motion: Motion, noise: float, rate_hz: float, repeats: int
) -> None:
    """Constant, steady and swinging, with noise of none, a part of, and several steps.

    A tenth is for chance. Without noise the readings of a steady motion are spread more evenly than by chance.
    """
    random = np.random.default_rng(0)
    time_s = np.arange(0.0, DURATION_S, 1.0 / rate_hz)
    errors, floors = [], []
    for _ in range(112 // repeats):
        truths = [motion(time_s, random) for _ in range(repeats)]
        reads = [STEP * np.round((each + random.normal(0.0, noise * STEP, each.shape)) / STEP) for each in truths]
        runs = [
            Recording("run", (Signal("angle", "rad", time_s, read, noise=noise * STEP, resolution=STEP),))
            for read in reads
        ]
        layout = layout_of(runs, BIN_S, None)
        for run, truth in zip(runs, truths, strict=True):
            found, true = (features_of(layout, run, values, None) for values in (measured(run), {"angle": truth}))
            errors.append(np.square(found - true))
        floors.append(np.square(layout.floor))
    assert 0.9 * np.mean(errors) < np.mean(floors) < 3.0 * np.mean(errors)


def test_a_machine_that_stands_until_it_falls_keeps_the_error_of_its_code() -> None:
    """What moves after a release says nothing of the readings before it."""
    random = np.random.default_rng(1)
    time_s = np.arange(0.0, DURATION_S, 0.002)
    read = STEP * np.round(release(time_s, random) / STEP)
    layout = layout_of([Recording("run", (Signal("angle", "rad", time_s, read, resolution=STEP),))], BIN_S, None)
    centre_s = layout.time_s
    assert layout.floor[centre_s < 1.0] == pytest.approx(STEP / np.sqrt(12.0), rel=0.01)
    per_bin = BIN_S / 0.002
    assert layout.floor[centre_s > 1.8] == pytest.approx(STEP / np.sqrt(12.0 * per_bin), rel=0.1)


def test_a_signal_that_never_changes_is_as_noisy_as_others_in_its_unit() -> None:
    """Unless its accuracy is declared. Without any noise it would decide all, and a seized joint shall be seen."""
    random, run = np.random.default_rng(4), landing(0.4)
    still = Signal("still", "N", TIMES_S, np.full(TIMES_S.size, 0.2))
    noisy = Signal("noisy", "N", TIMES_S, random.normal(0.0, 0.01, TIMES_S.size))
    runs = [dataclasses.replace(run, signals=(noisy, still))]
    assert stuck_in(runs) == ("still",)
    layout = layout_of(runs, 0.02, None)
    assert layout.signals == ("noisy", "still")
    noise, taken = layout.by_signal(layout.floor)
    assert taken == pytest.approx(noise)
    declared = [dataclasses.replace(run, signals=(noisy, dataclasses.replace(still, noise=0.001)))]
    assert stuck_in(declared) == ()
    with pytest.raises(BadRecordingError, match=r"still never changes .* in N .* declare its noise"):
        refuse_unknown_noise([Recording("run", (still,))])


def published(time_s: NDArray[np.float64], read: NDArray[np.float64], how: str) -> tuple[NDArray[np.float64], ...]:
    """Return when readings were published, and what: as they are, repeated, or put on a finer clock, rounded or not."""
    at_s = np.arange(0.0, time_s[-1], 0.003)
    if how == "repeated":
        return at_s, read[np.searchsorted(time_s, at_s, side="right") - 1]
    between = np.interp(at_s, time_s, read)
    return {"plain": (time_s, read), "between": (at_s, between), "rounded": (at_s, between.round(4))}[how]


@pytest.mark.parametrize("rate_hz", [8.0, 20.0, 50.0])
@pytest.mark.parametrize("how", ["plain", "repeated", "between", "rounded"])
@pytest.mark.parametrize("declared", [True, False])
def test_a_reading_counts_once_however_often_it_is_published(rate_hz: float, how: str, *, declared: bool) -> None:
    """What is fitted to the features of a sensor, slower than bins or than its messages, is as sure as it is said.

    The size of a slow motion is fitted to many recordings of it: it scatters by what their floor promises.
    """
    random = np.random.default_rng(1)
    time_s = np.arange(0.0, 30.0, 1.0 / rate_hz)
    off = []
    for _ in range(60):
        noise = random.normal(0.0, 0.05, time_s.size)
        (at_s, values), (_, quiet) = (published(time_s, np.sin(time_s) + each, how) for each in (noise, 0.0 * noise))
        run = Recording("run", (Signal("angle", "rad", at_s, values, noise=0.05 if declared else 0.0),))
        layout = layout_of([run], 0.02, None)
        found, shape = (features_of(layout, run, {"angle": each}, None) for each in (values, quiet))
        weights = shape / layout.floor**2
        off.append(float(weights @ (found - shape)) / float(np.sqrt(weights @ shape)))
    assert 0.75 < np.std(off) < 1.3


@pytest.mark.parametrize("noise", [0.0, 0.1, 0.5, 3.0])
@pytest.mark.parametrize("motion", [still, ramp(0.1), ramp(0.5), ramp(1.5), ramp(7.3), ramp(70.0), swing(0.8), release])
def test_readings_of_a_coarse_sensor_are_new(motion: Motion, noise: float) -> None:
    """Rounding repeats them, too, and leaves straight lines."""
    random = np.random.default_rng(2)
    time_s = np.arange(0.0, DURATION_S, 0.002)
    read = STEP * np.round((motion(time_s, random) + random.normal(0.0, noise * STEP, time_s.shape)) / STEP)
    assert len(new_readings(read)) == len(read)


@pytest.mark.parametrize("noise", [0.0, 0.3])
@pytest.mark.parametrize("frequency_hz", [1.0, 2.0, 5.0])
@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 200.0])
def test_readings_of_a_joint_that_swings_evenly_are_new(rate_hz: float, frequency_hz: float, noise: float) -> None:
    """An encoder of 14 bits: between two turns the line is straight, as often as the motion comes back."""
    random, step = np.random.default_rng(3), 2.0 * np.pi / 2**14
    time_s = np.arange(0.0, 30.0, 1.0 / rate_hz)
    angle_rad = 0.5 * np.sin(2.0 * np.pi * frequency_hz * time_s) + random.normal(0.0, noise * step, time_s.shape)
    read = step * np.round(angle_rad / step)
    assert len(new_readings(read)) == len(read)
