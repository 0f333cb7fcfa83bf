"""Grids, profiles, fits, and what a stopped search keeps."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest

from jammkle_common.command.errors import StopRequest
from jammkle_gap import Constants, Effect, EffectParameter, Library, Problem, Recording, Signal
from jammkle_gap.backend import backend
from jammkle_gap.core.calibrate import uncalibrated
from jammkle_gap.core.fit import Fit, Profiles
from jammkle_gap.core.joint import Machine, fit_jointly
from jammkle_gap.core.scatter import Whitener, difference_of, residuals_of, settings_of
from jammkle_gap.core.signatures import grid_of
from jammkle_gap.core.simulate import Runner, StoppedError, simulated

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from numpy.typing import NDArray

SIZE = 60
SHAPES = np.random.default_rng(2).normal(size=(4, SIZE))


def effect(name: str, parameters: int, most: float = 1.0, least: float = 0.0) -> Effect:
    """Return an effect with some parameters."""
    numbers = tuple(EffectParameter(f"p{i}", "1", 0.0, least, most, "assumed") for i in range(parameters))
    return Effect(name, "part", numbers, "Check it.")


EFFECTS = (effect("one", 1), effect("two", 2, least=-1.0), effect("other", 1))


def response(name: str, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what parameters make of the features: no straight line."""
    if name == "one":
        return 9.0 * (np.exp(values[0]) - 1.0) * SHAPES[0]
    if name == "two":
        return 8.0 * values[0] * SHAPES[1] + 5.0 * values[1] * (1.0 + values[0] ** 2) * SHAPES[2]
    return 7.0 * values[0] * (0.6 * SHAPES[0] + SHAPES[3])


GRIDS = {each.name: grid_of(each) for each in EFFECTS}
SIGNATURES = {name: np.array([response(name, point) for point in grid.points]) for name, grid in GRIDS.items()}


@pytest.mark.parametrize("name", ["one", "two", "other"])
def test_profiles_of_singles_agree_with_brute_force(name: str) -> None:
    """The gain on the mesh is that of the interpolated signatures, place by place."""
    difference = response("one", np.array([0.4])) + np.random.default_rng(1).normal(size=SIZE)
    found = Profiles(GRIDS, SIGNATURES, difference).single(name)
    mesh = GRIDS[name].weights @ SIGNATURES[name]
    gains = difference @ difference - np.square(difference - mesh).sum(axis=1)
    assert found.gain == pytest.approx(gains.max())
    assert found.values[0] == pytest.approx(GRIDS[name].mesh[int(np.argmax(gains))])


def test_profiles_of_pairs_agree_with_brute_force() -> None:
    """Alternating over the two halves ends where trying every pair of places does, to within a few per cent."""
    random = np.random.default_rng(5)
    for _ in range(10):
        difference = response("one", random.uniform(0.2, 0.9, 1)) + response("two", random.uniform(-0.9, 0.9, 2))
        difference += random.normal(size=SIZE)
        (found,) = Profiles({name: GRIDS[name] for name in ("one", "two")}, {
            name: SIGNATURES[name] for name in ("one", "two")
        }, difference).pairs(["one"], 1)  # fmt: skip
        meshes = [GRIDS[name].weights @ SIGNATURES[name] for name in ("one", "two")]
        left = min(float(np.square(difference - a - b).sum()) for a, b in product(*meshes))
        best = float(difference @ difference) - left
        assert 0.97 * best <= found.gain <= best * (1.0 + 1e-9)


def test_a_second_effect_is_found_beside_a_fitted_one() -> None:
    """Where the grids have the first effect wrong, what it leaves once fitted still shows the second."""
    target = response("one", np.array([0.4])) + response("two", np.array([0.5, 0.3]))
    wrong = {**SIGNATURES, "one": 3.0 * np.ones_like(SIGNATURES["one"])}
    fit = fitted(EFFECTS[0], target, {"one.p0": 0.2}, responding)
    first, *others = Profiles(GRIDS, wrong, fit.whitened).seconds(fit)
    assert first.names == ("one", "two")
    assert first.values[0] == pytest.approx([fit.values["one.p0"]])
    assert np.sign(first.values[1]) == pytest.approx([1.0, 1.0])
    assert first.gain > max(other.gain for other in others)


def test_the_mesh_holds_the_grid() -> None:
    """At a point of the grid the interpolated signature is the simulated one."""
    for name, grid in GRIDS.items():
        for point, signature in zip(grid.points, SIGNATURES[name], strict=True):
            at = int(np.argmin(np.abs(grid.mesh - point).sum(axis=1)))
            assert grid.mesh[at] == pytest.approx(point)
            assert grid.weights[at] @ SIGNATURES[name] == pytest.approx(signature)


def responding(values: Mapping[str, float]) -> NDArray[np.float64]:
    """Return what parameters by key make of the features."""
    (name,) = {key.partition(".")[0] for key in values}
    return response(name, np.array(list(values.values())))


def fitted(
    chosen: Effect,
    target: NDArray[np.float64],
    start: Mapping[str, float],
    makes: Callable[[Mapping[str, float]], NDArray[np.float64]],
) -> Fit:
    """Return an effect fitted to features with white noise of 1, without constants of the machine."""
    constants = Constants()
    time_s = np.arange(SIZE + 1) + 0.5  # the last begins a bin that is not full

    def simulate(_recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        return {"x": np.append(makes(values) if values else np.zeros(SIZE), 0.0)}

    problem = Problem(simulate, Library((chosen,)), bin_s=lambda _: 1.0)
    run = Recording("run", (Signal("x", "1", time_s, np.append(target, 0.0), 1.0),), setting="one")
    settings = settings_of([run], (), problem)
    (setting,) = residuals = residuals_of(settings, Runner(problem, 1), {})
    none = [np.zeros((SIZE, 0))]
    difference = difference_of(settings, residuals, none, none, none, constants)
    difference = replace(difference, whitened=setting.difference, whiteners=(Whitener(np.ones(SIZE), none[0]),))
    machine = Machine(problem, settings, (setting.difference,), uncalibrated(problem), (frozenset(),))
    blank = np.zeros(0)
    fit = Fit((chosen.name,), start, blank, np.inf, np.zeros((0, 0)), blank)
    for _ in range(constants.reweighings):
        fit = fit_jointly(machine, difference, fit, machine.signatures(), constants)
    return fit


def from_mesh(name: str, truth: tuple[float, ...]) -> Mapping[str, float]:
    """Return parameters from profile and fit, as the search does it."""
    target = response(name, np.array(truth))
    chosen = next(each for each in EFFECTS if each.name == name)
    place = Profiles(GRIDS, SIGNATURES, target).single(name)
    keys = [chosen.key(each) for each in chosen.parameters]
    return fitted(chosen, target, dict(zip(keys, place.values[0].tolist(), strict=True)), responding).values


@pytest.mark.parametrize("truth", [(0.07,), (0.5,), (0.93,)])
def test_gauss_newton_finds_one_parameter(truth: tuple[float, ...]) -> None:
    """From the nearest place of the mesh, without noise, to a thousandth."""
    assert from_mesh("one", truth)["one.p0"] == pytest.approx(truth[0], rel=1e-3)


def test_gauss_newton_finds_two_parameters() -> None:
    """Of an effect whose parameters act on each other."""
    found = from_mesh("two", (0.37, -0.61))
    assert [found["two.p0"], found["two.p1"]] == pytest.approx([0.37, -0.61], rel=0.01)


def test_an_effect_far_smaller_than_its_bounds_is_found() -> None:
    """A leak of a ten-thousandth, where bounds reach to three tenths."""
    time_s = np.arange(SIZE) * 2.0
    leak = Effect("leak", "air", (EffectParameter("rate", "1/s", 0.0, 0.0, 0.3, "assumed"),), "Check it.")

    def leaking(values: Mapping[str, float]) -> NDArray[np.float64]:
        return 7000.0 * (np.exp(-values["leak.rate"] * time_s) - 1.0)

    found = fitted(leak, leaking({"leak.rate": 1e-4}), {"leak.rate": 0.0}, leaking)
    assert found.values["leak.rate"] == pytest.approx(1e-4, rel=0.01)


def test_derivatives_are_those_of_the_features() -> None:
    """Intervals rest on them."""
    found = fitted(EFFECTS[2], response("other", np.array([0.4])), {"other.p0": 0.3}, responding)
    assert found.slopes[0][:, 0] == pytest.approx(7.0 * (0.6 * SHAPES[0] + SHAPES[3]), rel=1e-6)


LONG_S = 60.0


@pytest.fixture
def stop() -> Iterator[StopRequest]:
    """Return a request to stop, and give the signals back to the tests after."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(number) for number in numbers]
    yield StopRequest()
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_stop_ends_a_long_run_and_keeps_what_was_done(
    jobs: int, stop: StopRequest, capfd: pytest.CaptureFixture[str]
) -> None:
    """Without a word of whatever spread the runs. The third takes long, and Ctrl-C comes in its middle."""

    def run(number: int, asking: int) -> int:
        if number == 2:
            os.kill(asking, signal.SIGINT)
            time.sleep(LONG_S)
        return number

    began_s = time.monotonic()
    with backend(jobs, None), pytest.raises(StoppedError) as stopped:
        Runner(cast("Problem", _Sendable()), jobs, stop=stop).map(run, [(number, os.getpid()) for number in range(6)])
    assert time.monotonic() - began_s < LONG_S / 2.0
    done = stopped.value.done
    assert done == (0, 1)[: len(done)]  # what another process has done may be on its way yet
    assert jobs > 1 or len(done) == 2
    assert not capfd.readouterr().err


class _Sendable:
    simulator = alignment = None


def test_a_stop_within_a_run_is_no_failure_of_the_simulator() -> None:
    """A signal may come while the simulator is at work."""

    def stopped(_recording: Recording, _values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        raise StoppedError

    blank = Recording("run", (Signal("angle", "rad", np.arange(3.0), np.zeros(3), 0.1),), None)
    with pytest.raises(StoppedError):
        simulated(stopped, blank, {})
