"""Detection, posterior, sets and equivalence classes, by algebra alone."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from jammkle_gap import Constants, Library, Problem
from jammkle_gap.core.conclude import _likeliest
from jammkle_gap.core.decide import (
    NONE_OF_THEM,
    Detection,
    Posterior,
    Seen,
    by_likelihood,
    by_signals,
    class_names,
    classes_of,
    credible_set,
    detect,
    posterior_of,
    probability_of_gap,
    spread_along,
    without_directions,
)
from jammkle_gap.core.discrepancy import Discrepancy, by_length
from jammkle_gap.core.fit import Fit
from jammkle_gap.core.scatter import (
    Difference,
    Residuals,
    Scatter,
    SettingScatter,
    difference_of,
    settings_of,
    whitened_difference,
)
from jammkle_gap.core.signatures import grid_of
from pendulums import LIBRARY, PROBLEM, TWIN, machine

CONSTANTS = Constants()
RANDOM = np.random.default_rng(0)
SHAPES = np.linalg.qr(RANDOM.normal(size=(250, 6)))[0].T
"""Signatures of length 1, at right angles to each other."""
SETTINGS = settings_of(machine(0).record(3), machine(0).record(5), PROBLEM)


def whitened(random: np.random.Generator, gap: float = 0.0) -> Difference:
    """Return the difference of healthy runs with white noise and some smooth scatter, and a gap along one signature."""
    residuals = []
    for setting in SETTINGS:
        size = setting.layout.size
        smooth = np.sin(np.arange(size) / 20.0)
        runs = random.normal(size=(8, size)) + 2.0 * random.normal(size=(8, 1)) * smooth
        runs *= setting.layout.floor
        runs[:3] += gap * np.sqrt(setting.factor) * SHAPES[0, :size] * setting.layout.floor / np.sqrt(len(SETTINGS) / 2)
        residuals.append(Residuals(runs[:3], runs[3:], np.zeros(size)))
    columns = [
        (np.sin(np.arange(setting.layout.size) / 20.0) * setting.layout.floor)[:, np.newaxis] for setting in SETTINGS
    ]
    none = [np.zeros((setting.layout.size, 0)) for setting in SETTINGS]
    return difference_of(SETTINGS, residuals, columns, none, none, CONSTANTS)


def fits(difference: Difference) -> list[Fit]:
    """Return straight fits of six signatures."""
    found = []
    for i, shape in enumerate(SHAPES):
        parts = [shape[: setting.layout.size] * setting.layout.floor for setting in SETTINGS]
        direction = difference.whiten(parts)
        share = float(direction @ difference.whitened / (direction @ direction))
        signature = share * direction
        left = float(np.square(difference.whitened - signature).sum())
        jacobian = direction[:, np.newaxis]
        found.append(Fit((f"e{i}",), {f"e{i}.p": share}, signature, left, jacobian, difference.whitened))
    return found


def squared(difference: Difference) -> float:
    """Return the squared length of a difference."""
    return float(difference.whitened @ difference.whitened)


def test_false_alarms_are_as_rare_as_stated() -> None:
    """Of 300 healthy machines no more than a binomial chance of one in a thousand allows."""
    random = np.random.default_rng(21)
    alarms = 0
    for _ in range(300):
        difference = whitened(random)
        alarms += detect(difference, squared(difference), fits(difference), CONSTANTS).gap
    assert alarms <= stats.binom.ppf(0.999, 300, CONSTANTS.false_alarm_rate)


def test_power_grows_with_the_size_of_the_gap() -> None:
    """From hardly ever to always."""
    power = []
    for gap in (1.0, 5.0, 9.0, 20.0):
        random = np.random.default_rng(22)
        cases = [whitened(random, gap) for _ in range(40)]
        power.append(np.mean([detect(each, squared(each), fits(each), CONSTANTS).gap for each in cases]))
    assert power == sorted(power)
    assert power[0] < 0.1
    assert power[-1] > 0.95


def test_an_effect_that_is_far_likelier_than_the_constants_alone_is_a_gap() -> None:
    """Though lengths show none; of gains by chance, of one and of two parameters, no more than the stated rate are."""
    nothing = Detection(1.0, gap=False, probability=0.0, ratio=1.0, explained=1.0, unexplained=1.0)
    assert by_likelihood(nothing, [(0.3, 1), (15.0, 1)], CONSTANTS).gap
    assert not by_likelihood(nothing, [(3.0, 1), (5.0, 2), (-2.0, 1)], CONSTANTS).gap
    assert not by_likelihood(nothing, [], CONSTANTS).gap
    assert by_likelihood(nothing, [(15.0, 1)], CONSTANTS).seen is Seen.ALONG_EFFECT
    random, alarms = np.random.default_rng(23), 0
    for _ in range(300):
        gains = [
            (0.5 * float(random.chisquare(count)), count) for count in (1, 2) for _ in range(CONSTANTS.tested_effects)
        ]
        alarms += by_likelihood(nothing, gains, CONSTANTS).gap
    assert alarms <= stats.binom.ppf(0.999, 300, CONSTANTS.false_alarm_rate)


def test_where_none_of_the_effects_is_the_answer_likelihoods_count_and_lengths_along_effects_do_not() -> None:
    """A torn tendon that leaves much, as a second fault of the machine does, is a gap beside none of them, too."""
    along = Detection(1e-9, gap=True, probability=1.0, ratio=1.0, explained=1e-9, unexplained=0.5)
    assert not without_directions(by_likelihood(along, [(4.0, 1)], CONSTANTS), CONSTANTS).gap
    assert without_directions(by_likelihood(along, [(9.0, 1)], CONSTANTS), CONSTANTS).gap
    left = Detection(1e-9, gap=True, probability=1.0, ratio=9.0, explained=1.0, unexplained=1e-9)
    assert without_directions(left, CONSTANTS).gap
    assert without_directions(left, CONSTANTS).seen is Seen.ALTOGETHER


def test_one_signal_that_is_far_off_is_a_gap_though_the_others_hide_it() -> None:
    """Machines differ in how far the signal is that is farthest off; no more than the stated rate of them are a gap."""
    quiet = Detection(1.0, gap=False, probability=0.0, ratio=0.2, explained=1.0, unexplained=1.0)
    assert not by_signals(quiet, 1.5, CONSTANTS).gap
    found = by_signals(quiet, 9.0, CONSTANTS)
    assert found.gap
    assert found.farthest == 3.0
    assert without_directions(found, CONSTANTS).gap
    p_values = [by_signals(quiet, ratio, CONSTANTS).p_value for ratio in (0.5, 1.0, 2.0, 4.0, 8.0)]
    assert p_values == sorted(p_values, reverse=True)
    random, machines = np.random.default_rng(24), 2000
    ratios = np.exp(CONSTANTS.signal_spread * random.standard_t(CONSTANTS.length_prior_freedom, machines))
    alarms = sum(by_signals(quiet, ratio, CONSTANTS).gap for ratio in ratios.tolist())
    assert alarms <= stats.binom.ppf(0.999, machines, CONSTANTS.false_alarm_rate)


def test_a_gap_that_no_effect_explains_is_seen_altogether() -> None:
    """Noise of twice the size everywhere, along no signature in particular."""
    difference = whitened(np.random.default_rng(23))
    doubled = replace(difference, whitened=2.0 * difference.whitened)
    found = detect(doubled, squared(doubled), fits(doubled), CONSTANTS)
    assert found.gap
    assert found.ratio == pytest.approx(4.0, rel=0.4)


def scattered_along(random: np.random.Generator, *spreads: float) -> Difference:
    """Return settings of eight healthy runs each that scatter along their first feature alone."""
    none, settings = np.zeros((2, 0)), []
    for spread in spreads:
        deviations = spread * random.normal(size=(8, 1)) * np.array([[1.0, 0.0]])
        settings.append(SettingScatter(1.0, 8, deviations, Scatter(np.ones(2), none, np.zeros(0)), none, none))
    return Difference(np.zeros(2 * len(spreads)), (), tuple(settings))


def test_a_setting_without_repeats_says_nothing_of_scatter() -> None:
    """Where half of a signature shows in one, healthy runs scatter along it as where they were repeated."""
    difference = scattered_along(np.random.default_rng(25), 3.0, 3.0)
    first, second = difference.settings
    alone = replace(difference, settings=(first, replace(second, freedom=0)))
    both, one = np.array([1.0, 0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0])
    expected = spread_along(difference, one, CONSTANTS).variance
    assert spread_along(alone, both, CONSTANTS).variance == pytest.approx(expected)


def test_scatter_in_one_setting_has_the_freedom_of_its_runs() -> None:
    """Runs of settings in which a signature does not show say nothing of how healthy runs scatter along it."""
    random = np.random.default_rng(24)
    prior = CONSTANTS.direction_prior_freedom
    both, first = np.array([1.0, 0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0])
    difference = scattered_along(random, 3.0, 3.0)
    assert spread_along(difference, first, CONSTANTS).freedom == pytest.approx(prior + 8.0)
    assert prior + 8.0 < spread_along(difference, both, CONSTANTS).freedom <= prior + 16.0
    uneven = scattered_along(random, 30.0, 0.3)
    assert spread_along(uneven, both, CONSTANTS).freedom == pytest.approx(prior + 8.0, rel=0.01)


@pytest.mark.parametrize("spreads", [(10.0, 10.0), (10.0, 1.0), (10.0, 0.1)])
def test_what_scatters_in_one_setting_alone_raises_no_more_alarms(spreads: tuple[float, float]) -> None:
    """Gains of healthy machines along a signature exceed the limit of 1 % in no more than 1 %, even or uneven.

    Without the prior, which takes the scatter to be about 1.
    """
    constants = replace(CONSTANTS, direction_prior_freedom=0.0)
    random = np.random.default_rng(25)
    signature = np.array([1.0, 0.0, 1.0, 0.0])
    trials, beyond = 3000, 0
    for _ in range(trials):
        spread = spread_along(scattered_along(random, *spreads), signature, constants)
        gain = np.square(random.normal(size=2) @ spreads) / 2.0
        beyond += bool(stats.f.sf(gain / spread.variance, 1, spread.freedom) < 0.01)
    assert beyond <= stats.binom.ppf(0.999, trials, 0.01)


def left_by(*lefts: float, names: tuple[str, ...] = ("one", "two", "three"), features: int = 400) -> list[Fit]:
    """Return candidates that leave so much."""
    blank = np.zeros(features)
    return [
        Fit((name,), {f"{name}.p": 1.0}, blank, left, blank[:, np.newaxis], blank)
        for name, left in zip(names, lefts, strict=False)
    ]


def posterior(length: float, fitted: list[Fit], classes: dict[str, str] | None = None):  # noqa: ANN201 - in a test
    """Return the posterior of candidates in four hundred features."""
    scores = by_length(length, 400.0, [fit.left for fit in fitted], 32.0, CONSTANTS)
    likelihoods = dict(zip((NONE_OF_THEM, *(fit.names for fit in fitted)), scores.tolist(), strict=True))
    return posterior_of(likelihoods, {fit.names: fit for fit in fitted}, classes or {}, CONSTANTS)


def test_the_larger_a_gap_the_more_a_second_effect_must_explain() -> None:
    """What one leaves of a small gap another must explain; a five hundredth of a huge one is the simulator's error."""

    def pair_over_single(length: float) -> float:
        (single,) = left_by(1000.0)
        pair = replace(single, names=("one", "two"), values={"one.p": 1.0, "two.p": 1.0}, left=600.0)
        found = posterior(length, [single, pair]).probabilities
        return found.get(("one", "two"), 0.0) / found["one",]

    assert pair_over_single(3000.0) > 1.0
    assert pair_over_single(3e5) == 0.0


def test_probabilities_add_to_one_and_follow_what_is_left() -> None:
    """Less left is more probable; nothing is left out."""
    found = posterior(5000.0, left_by(420.0, 460.0, 3000.0))
    assert sum(found.probabilities.values()) == pytest.approx(1.0)
    assert NONE_OF_THEM in found.probabilities
    values = [found.probabilities[name,] for name in ("one", "two", "three")]
    assert values == sorted(values, reverse=True)
    assert next(iter(found.probabilities)) == ("one",)


def test_equivalents_share_and_stand_for_each_other() -> None:
    """Two that leave the same have the same probability; of a class the set names one."""
    fitted = left_by(420.0, 420.0, 4000.0)
    found = posterior(5000.0, fitted)
    assert found.probabilities["one",] == pytest.approx(found.probabilities["two",])
    assert set(found.credible) == {("one",), ("two",)}
    as_class = posterior(5000.0, fitted, class_names([("one", "two")]))
    assert as_class.credible == (("one",),)


def test_none_of_them_wins_where_all_leave_most_of_the_gap() -> None:
    """And not where one explains it."""
    assert next(iter(posterior(9000.0, left_by(8800.0, 8900.0, 8990.0)).probabilities)) == NONE_OF_THEM
    assert next(iter(posterior(9000.0, left_by(500.0, 8900.0, 8990.0)).probabilities)) == ("one",)


def test_a_pair_has_to_be_worth_its_second_effect() -> None:
    """One that explains more than either half is on offer; one whose second half is idle is not."""
    single, other = left_by(900.0, 430.0, names=("one", "two"))
    pair = replace(other, names=("one", "two"), values={"one.p": 1.0, "two.p": 1.0})
    assert next(iter(posterior(5000.0, [single, pair]).probabilities)) == ("one", "two")
    idle = replace(pair, left=899.0)
    assert ("one", "two") not in posterior(5000.0, [single, idle]).probabilities


@pytest.mark.parametrize("share", [0.5, 0.9, 0.95, 0.999])
def test_a_credible_set_is_the_smallest_that_holds_its_share(share: float) -> None:
    """Without its last member it would not."""
    for seed in range(20):
        weights = np.sort(np.random.default_rng(seed).dirichlet(np.full(8, 0.4)))[::-1]
        ranked = {(f"e{i}",): float(each) for i, each in enumerate(weights)}
        found = credible_set(ranked, {}, share)
        held = [ranked[names] for names in found]
        assert sum(held) >= share - 1e-12
        assert sum(held[:-1]) < share


def test_classes_are_those_that_do_the_same_and_no_others() -> None:
    """A twin of the load is found from simulated signatures; nothing else is taken for anything else."""
    problem = Problem(PROBLEM.simulator, Library((*LIBRARY, TWIN)), PROBLEM.scatter)
    run = machine(1).run("slow", {})
    angles = problem.simulator(run, {})["angle"]
    signatures = {}
    for effect in problem.library:
        key = effect.key(effect.parameters[0])
        points = [problem.simulator(run, {key: float(point[0])})["angle"] for point in grid_of(effect).points]
        signatures[effect.name] = (np.array(points) - angles) / 0.004
    grids = {effect.name: grid_of(effect) for effect in problem.library}
    assert classes_of(grids, signatures, CONSTANTS) == (("load", "twin"),)
    alone = {name: each for name, each in signatures.items() if name != "twin"}
    assert classes_of(grids, alone, CONSTANTS) == ()


def test_the_simulators_own_error_leaves_scatter_and_constants_their_priors() -> None:
    """A large error in one block does not make room for a nuisance of many times its prior."""
    settings = settings_of(machine(2).record(1), (), PROBLEM)
    sizes = [setting.layout.size for setting in settings]
    floors = [setting.layout.floor for setting in settings]
    columns = [10.0 * floor[:, np.newaxis] for floor in floors]
    none = [np.zeros((size, 0)) for size in sizes]

    def scores(height: float, error: float) -> list[float]:
        """Return the log-likelihood of no effect, and of an offset that is explained in full."""
        rows = [
            height * floor + error * floor * (np.arange(size) < size // 8)
            for size, floor in zip(sizes, floors, strict=True)
        ]
        residuals = [Residuals(row[np.newaxis], np.zeros((0, len(row))), row) for row in rows]
        difference = difference_of(settings, residuals, columns, none, none, CONSTANTS)
        own = Discrepancy(settings, [each.difference for each in residuals], difference, CONSTANTS)
        explained = tuple(height * floor for floor in floors)
        blank = np.zeros(sum(sizes))
        fit = Fit(("offset",), {"offset.p": height}, blank, 0.0, blank[:, np.newaxis], blank, explained)
        nothing = Fit(
            ("nothing",), {"nothing.p": 0.0}, blank, 0.0, blank[:, np.newaxis], blank, tuple(map(np.zeros, sizes))
        )
        return own.scores(nothing, [fit, nothing], 1)[1:]

    for error in (0.0, 300.0):
        typical, beyond = (np.subtract(*scores(height, error)) for height in (10.0, 60.0))
        assert abs(typical) < 3.0
        assert beyond > 10.0


def test_the_simulators_own_error_hides_no_effect_elsewhere_and_is_none_itself() -> None:
    """A step in a quarter of the blocks is named beside an error in all of them; a tenth of that error is not."""
    settings = settings_of(machine(2).record(1), (), PROBLEM)
    floors = [setting.layout.floor for setting in settings]
    none = [np.zeros((len(floor), 0)) for floor in floors]
    blank = np.zeros(sum(map(len, floors)))
    random = np.random.default_rng(3)
    error = [30.0 * floor * random.normal(size=len(floor)) for floor in floors]
    step = [1000.0 * floor * (np.arange(len(floor)) < len(floor) // 4) for floor in floors]
    rows = [one + two for one, two in zip(error, step, strict=True)]
    residuals = [Residuals(row[np.newaxis], np.zeros((0, len(row))), row) for row in rows]
    difference = difference_of(settings, residuals, none, none, none, CONSTANTS)
    own = Discrepancy(settings, rows, difference, CONSTANTS)

    def explaining(features: list[np.ndarray]) -> Fit:
        return Fit(("e",), {"e.p": 1.0}, blank, 0.0, blank[:, np.newaxis], blank, tuple(features))

    nothing = explaining([0.0 * each for each in step])
    offered = [explaining(step), explaining([0.1 * each for each in error])]
    unknown, right, chance = own.scores(nothing, offered, 60)
    assert right > unknown + 3.0
    assert chance < unknown - 3.0


def test_beside_no_error_the_difference_is_as_it_was() -> None:
    """A discrepancy of 0 changes nothing."""
    difference = whitened(np.random.default_rng(5))
    residuals = []
    for setting, own in zip(SETTINGS, difference.settings, strict=True):
        size = own.size
        runs = np.random.default_rng(size).normal(size=(8, size)) * setting.layout.floor
        residuals.append(Residuals(runs[:3], runs[3:], runs[0]))
    found = whitened_difference(difference.settings, [each.difference for each in residuals])
    assert found.whitened == pytest.approx(difference.whiten([each.difference for each in residuals]))
    wider = whitened_difference(
        difference.settings,
        [each.difference for each in residuals],
        [np.full(each.size, 1.0) for each in difference.settings],
    )
    pairs = itertools.pairwise([found.whitened @ found.whitened, wider.whitened @ wider.whitened])
    assert all(later < earlier for earlier, later in pairs)


def test_the_probability_of_a_gap_falls_with_the_p_value() -> None:
    """Even odds turn where gaps and healthy machines give a p-value as often: below it a gap is likelier."""
    chances = np.logspace(-12, 0, 40)
    found = [probability_of_gap(float(each), CONSTANTS) for each in chances]
    assert (np.diff(found) < 0.0).all()
    even = CONSTANTS.gap_shape ** (1.0 / (1.0 - CONSTANTS.gap_shape))
    assert probability_of_gap(even, CONSTANTS) == pytest.approx(0.5)
    assert found[0] > 0.999
    assert found[-1] < 0.1


def test_an_equivalence_class_counts_with_all_of_its_members() -> None:
    """Two that no data can tell apart, 0.3 each, outweigh *none of them* with 0.4: the first of them is named."""
    posterior = Posterior({NONE_OF_THEM: 0.4, ("one",): 0.31, ("two",): 0.29}, (NONE_OF_THEM, ("one",)))
    assert _likeliest(posterior, {"one": "one", "two": "one"}) == ("one",)
    assert _likeliest(posterior, {}) == NONE_OF_THEM
