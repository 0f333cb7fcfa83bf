"""Signatures: what each effect and each nuisance makes of the features of a setting, on grids, kept on disk.

A signature depends on the simulator, on the setting and on the grid, and hardly on the run: it is simulated once per
setting at the nominal machine, and found again by a digest of all that went into it. Another version of the simulator,
or other bounds of an effect, have another digest, so that an old dictionary is never used. Effects of sensors and
clocks act on what was measured instead of the simulator: exact however wrong that is.
"""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import json
import os
import tempfile
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import svd  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.core.features import Layout, aligned_s, features_of, layout_of, measured
from jammkle_gap.core.simulate import InfeasibleError, Made, Task, simulated

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.data import Recording
    from jammkle_gap.core.effects import Effect, EffectParameter
    from jammkle_gap.core.scatter import Setting
    from jammkle_gap.core.simulate import Problem, Runner

_SHARES = {1: (0.1, 0.4, 1.0), 2: (0.1, 1.0), 3: (0.3, 1.0)}
"""Shares of the way from null to a bound, by the number of parameters. Chosen: about geometric, and few: the grid says
which effects are promising, a fit with the simulator what size they have."""
_FINE = {1: 8, 2: 4, 3: 2}
"""Parts that the mesh cuts an interval of the grid into."""
_MOST_CROSSED = 2
"""Parameters up to which the grid holds every combination; beyond it, only the axes."""


@dataclass(frozen=True)
class Grid:
    """Points at which an effect is simulated, and the mesh between them."""

    points: NDArray[np.float64]
    """Shape (points, parameters), null itself left out."""
    mesh: NDArray[np.float64]
    """Shape (mesh, parameters)."""
    weights: NDArray[np.float64]
    """Of the points' signatures in that of each place of the mesh, shape (mesh, points)."""
    axes: tuple[tuple[int, ...], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]] | None = None
    """Where only axes are simulated: the point nearest to null on each, null, and least and largest parameters."""

    def straight(
        self, gram: NDArray[np.float64], overlap: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], float] | None:
        """Return weights, parameters and gain of the least-squares fit with the points nearest to null, if it has one.

        Args:
            gram: Of the points' signatures, shape (points, points).
            overlap: Of the points' signatures with the difference, shape (points,).

        """
        if self.axes is None:
            return None
        near, null, low, high = self.axes
        step = np.array([self.points[point, i] - null[i] for i, point in enumerate(near)])
        small, right = gram[np.ix_(near, near)], overlap[list(near)]
        shares = np.linalg.lstsq(small, right, rcond=1e-9)[0]
        values = np.clip(null + shares * step, low, high)
        shares = (values - null) / step
        weights = np.zeros(len(self.points))
        weights[list(near)] = shares
        return weights, values, float(2.0 * shares @ right - shares @ small @ shares)


def grid_of(effect: Effect) -> Grid:
    """Return the grid of an effect with one to three parameters."""
    count = len(effect.parameters)
    axes = [_axis(each, count) for each in effect.parameters]
    fine = [_between(nodes, _FINE[count]) for nodes in axes]
    null = np.array([each.null for each in effect.parameters])
    if count <= _MOST_CROSSED:
        points = np.array(list(itertools.product(*axes)))
        products = [np.array([1.0])]
        mesh = np.array(list(itertools.product(*(values for values, _ in fine))))
        for _, weights in fine:
            products = [np.einsum("ai,bj->abij", *map(np.atleast_2d, (products[0], weights)))]
            left, right, first, second = products[0].shape
            products = [products[0].reshape(left * right, first * second)]
        kept = ~(points == null).all(axis=1)
        return Grid(points[kept], mesh, products[0][:, kept])
    rows, columns = [], []
    for i, nodes in enumerate(axes):
        for j, value in enumerate(nodes):
            if value != null[i]:
                rows.append(np.where(np.arange(count) == i, value, null))
                columns.append((i, j))
    mesh_rows, weight_rows = [], []
    for place in itertools.product(*(range(len(values)) for values, _ in fine)):
        mesh_rows.append([fine[i][0][at] for i, at in enumerate(place)])
        weight_rows.append([fine[i][1][place[i], j] for i, j in columns])
    near = tuple(
        min((k for k, (axis, _) in enumerate(columns) if axis == i), key=lambda k: abs(rows[k][i] - null[i]))
        for i in range(count)
    )
    low = np.array([each.minimum for each in effect.parameters])
    high = np.array([each.maximum for each in effect.parameters])
    return Grid(np.array(rows), np.array(mesh_rows), np.array(weight_rows), (near, null, low, high))


def _axis(parameter: EffectParameter, count: int) -> NDArray[np.float64]:
    """Return the nodes of one parameter, null among them, rising."""
    shares = parameter.shares or _SHARES[count]
    ends = [end for end in (parameter.minimum, parameter.maximum) if end != parameter.null]
    nodes = [parameter.null + share * (end - parameter.null) for end in ends for share in shares]
    return np.array(sorted({parameter.null, *nodes}))


def _between(nodes: NDArray[np.float64], parts: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a finer axis, and the weights of the nodes at each of its places, shape (fine, nodes)."""
    at = np.arange((len(nodes) - 1) * parts + 1) / parts
    whole = np.arange(len(nodes))
    weights = np.maximum(1.0 - np.abs(at[:, np.newaxis] - whole), 0.0)
    return weights @ nodes, weights


_REFERENCES = 2
"""References whose readings are taken. Chosen: their own scatter is far below an effect."""


def with_readings(settings: Sequence[Setting], problem: Problem, runner: Runner) -> tuple[Setting, ...]:
    """Return the settings with what healthy sensors would have read in the first faulty run of each.

    Args:
        settings: Runs. Without references what is simulated stands for them: of noisy readings a gain would be fitted
            that scales their noise away.
        problem: Simulator and sensing; without sensing nothing is done.
        runner: Counts the runs.

    Raises:
        SimulatorError: the simulator failed.

    """
    if problem.sensing is None:
        return tuple(settings)
    found = []
    for setting in settings:
        run, references = setting.faulty[0], setting.references[:_REFERENCES]
        try:
            made, *others = (simulated(problem.simulator, each, {}) for each in (run, *references))
        except InfeasibleError:
            made, others, references = {}, [], ()
        runner.count([Made(1, each.duration_s) for each in (run, *references)])
        readings = [{**measured(run), **made}]
        if references:
            readings = [
                _healthy(problem, run, made, reference, other)
                for reference, other in zip(references, others, strict=True)
            ]
        features = np.array([features_of(setting.layout, run, each, problem.alignment) for each in readings])
        found.append(replace(setting, readings=tuple(readings), reading_features=features))
    return tuple(found)


def _healthy(
    problem: Problem,
    run: Recording,
    made: Mapping[str, NDArray[np.float64]],
    reference: Recording,
    other: Mapping[str, NDArray[np.float64]],
) -> dict[str, NDArray[np.float64]]:
    """Return what healthy sensors would have read in a run, by signal, at its times.

    Args:
        problem: Says which signals are aligned at events; a difference of simulations would double an impact that
            comes a little later, so that these are as in the reference.
        run: At whose inputs.
        made: Its simulation.
        reference: Whose readings are taken.
        other: Its simulation.

    """
    readings = measured(run)
    for signal in run.signals:
        name = signal.name
        if name not in measured(reference):
            continue
        known = reference.signal(name)
        by_clock = problem.alignment is None or not problem.alignment.events_of(run, name)
        if by_clock and name in made and name in other:
            left = np.interp(signal.time_s, known.time_s, known.values - other[name])
            readings[name] = made[name] + left
        else:
            readings[name] = np.interp(signal.time_s, known.time_s, known.values)
    return readings


def known_features(problem: Problem, layout: Layout, effects: Iterable[str]) -> NDArray[np.bool_]:
    """Return which features sensing says for any of some effects, and the simulator does not, shape (n,).

    Args:
        problem: With or without sensing.
        layout: Of the features. Events are sensing's where all signals are.
        effects: By name.

    """
    known = np.zeros(layout.size, dtype=bool)
    for effect in effects:
        if problem.sensing is None or effect not in problem.sensing.effects:
            continue
        signals = np.array([problem.sensing.knows(effect, name) for name in layout.signals])
        known[: layout.bins * len(signals)] |= np.repeat(signals, layout.bins)
        known[layout.bins * len(signals) :] |= signals.all()
    return known


def sensed_difference(problem: Problem, setting: Setting, values: Mapping[str, float]) -> NDArray[np.float64]:
    """Return what sensing's effects change in the features of a setting that it knows, shape (n,).

    Args:
        problem: With or without sensing.
        setting: With readings.
        values: Parameters by key; those of other effects are passed over.

    """
    if problem.sensing is None:
        return np.zeros(setting.layout.size)
    values = {key: value for key, value in values.items() if key.partition(".")[0] in problem.sensing.effects}
    if not values:
        return np.zeros(setting.layout.size)
    found, run = [], setting.faulty[0]
    for before, features in zip(setting.readings, setting.reading_features, strict=True):
        after = problem.sensing(run, before, values)
        found.append(features_of(setting.layout, run, after, problem.alignment) - features)
    mean: NDArray[np.float64] = np.nan_to_num(np.mean(found, axis=0))
    return mean


_FORMAT = 7
"""Of the files."""


@dataclass(frozen=True)
class Dictionary:
    """Signatures of one setting, in a layout of its own."""

    layout: Layout
    effects: Mapping[str, NDArray[np.float64]]
    """By effect, differences at the points of its grid, shape (points, n); effects of sensors are not in it."""
    scatter: NDArray[np.float64]
    """Differences for one standard deviation of each nuisance, shape (nuisances, n)."""
    contact: NDArray[np.float64]
    """What scattered runs differ by that is not linear in the nuisances, as columns, shape (columns, n)."""
    constants: NDArray[np.float64]
    """Differences for one standard deviation of each constant of the machine, shape (constants, n)."""

    def laid(self, layout: Layout, problem: Problem, run: Recording) -> Dictionary:
        """Return the dictionary in the layout of the runs at hand, events put where theirs are.

        Signals that it does not have are 0.

        Args:
            layout: Of the runs.
            problem: Tells which signals follow which event.
            run: One of the runs.

        """

        def relaid(differences: NDArray[np.float64]) -> NDArray[np.float64]:
            own, table = self.layout, self.layout.by_signal(differences)
            laid = np.zeros((*differences.shape[:-1], layout.size))
            out = layout.by_signal(laid)
            for i, name in enumerate(layout.signals):
                if name not in own.signals:
                    continue
                asked = problem.alignment.events_of(run, name) if problem.alignment is not None else ()
                own_s = aligned_s(layout.time_s, asked, layout.event_s, own.event_s)
                at = np.clip(own_s / own.bin_s - 0.5, 0.0, own.bins - 1.0)
                low = np.floor(at).astype(int)
                high = np.minimum(low + 1, own.bins - 1)
                row = table[..., own.signals.index(name), :]
                out[..., i, :] = row[..., low] * (1.0 - (at - low)) + row[..., high] * (at - low)
            for i, name in enumerate(layout.event_s):
                if name in own.event_s:
                    at_own = len(own.signals) * own.bins + list(own.event_s).index(name)
                    laid[..., len(layout.signals) * layout.bins + i] = differences[..., at_own]
            return laid

        effects = {name: relaid(table) for name, table in self.effects.items()}
        return Dictionary(layout, effects, relaid(self.scatter), relaid(self.contact), relaid(self.constants))


def grids_of(problem: Problem) -> dict[str, Grid]:
    """Return the grid of every effect of the library."""
    return {effect.name: grid_of(effect) for effect in problem.library}


def dictionary_of(
    recording: Recording, problem: Problem, runner: Runner, constants: Constants, folder: Path | None
) -> Dictionary:
    """Return the dictionary of a recording's setting: from disk, or simulated and put there.

    Args:
        recording: Whose inputs are taken.
        problem: Simulator, library and nuisances.
        runner: Makes the runs.
        constants: Of the model.
        folder: Where dictionaries are kept; None: nowhere.

    """
    layout, recording = layout_of([recording], problem.bin_s(recording), problem.alignment), problem.coarse(recording)
    # A group that has no name could be anything.
    kept = folder if problem.version and problem.group_of(recording) else None
    name = _digest(recording, layout, problem, constants)
    stored = _read(kept, name)
    if stored is None or len(stored["event_s"]) != len(layout.event_s):
        stored = _scattered(recording, layout, problem, runner, constants)
        _write(kept, name, stored)
    events = dict(zip(layout.event_s, stored["event_s"].tolist(), strict=True))
    layout = dataclasses.replace(layout, bins=int(stored["bins"]), event_s=events, floor=stored["floor"])
    asked = [effect for effect in problem.library if not known_features(problem, layout, (effect.name,)).all()]
    # Whoever adds an effect simulates no other again.
    files = {each.name: f"{name}/{_hash([each.name, each.version, grid_of(each).points.tolist()])}" for each in asked}
    tables = {each.name: _read(kept, files[each.name]) for each in asked}
    missing = [each for each in asked if tables[each.name] is None]
    for each, table in zip(missing, _simulated(recording, layout, missing, runner), strict=True):
        tables[each.name] = {"table": table}
        _write(kept, files[each.name], {"table": table.astype(np.float32)})
    effects = {name: read["table"].astype(float) for name, read in tables.items() if read and read["table"].any()}
    return Dictionary(layout, effects, stored["scatter"], stored["contact"], stored["constants"])


def cache_folder() -> Path:
    """Return where dictionaries are kept by default: `$XDG_CACHE_HOME/jammkle`, or `~/.cache/jammkle`."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "jammkle"


def _scattered(
    recording: Recording, layout: Layout, problem: Problem, runner: Runner, constants: Constants
) -> dict[str, NDArray[np.float64]]:
    """Return what a dictionary holds beside effects, from runs: nuisances, constants of the machine, and a contact."""
    tasks = [Task(recording, layout, {})]
    singles = (*problem.scatter, *problem.constants)
    steps = [each.step_from(each.null) for each in singles]
    tasks += [
        Task(recording, layout, {each.name: each.null + step * each.sigma})
        for each, step in zip(singles, steps, strict=True)
    ]
    # Without a contact the features are as good as linear in what scatters.
    count = constants.contact_runs if layout.event_s else 0
    draws = np.random.default_rng(0).standard_normal((count, len(problem.scatter)))
    for draw in draws.tolist():
        values = {each.name: each.null + each.sigma * x for each, x in zip(problem.scatter, draw, strict=True)}
        tasks.append(Task(recording, layout, values))
    features = np.array(runner.features(tasks, "signatures"))
    # A signal that the simulator does not give is NaN throughout, and not compared.
    differences = np.nan_to_num(features[1:] - features[0])
    differences[: len(steps)] /= np.array(steps)[:, np.newaxis]
    scatter, machine, drawn = np.split(differences, [len(problem.scatter), len(singles)])
    return {
        "bins": np.array(layout.bins),
        "floor": layout.floor,
        "event_s": np.array(list(layout.event_s.values())),
        "scatter": scatter,
        "contact": _contact(drawn, draws, scatter, layout, constants),
        "constants": machine,
    }


def _simulated(
    recording: Recording, layout: Layout, effects: Sequence[Effect], runner: Runner
) -> list[NDArray[np.float64]]:
    """Return the differences that effects make at the points of their grids, shape (points, n) each."""
    if not effects:
        return []
    grids = [grid_of(effect).points for effect in effects]
    ends = [_ends(effect, points) for effect, points in zip(effects, grids, strict=True)]
    first = _features(recording, layout, effects, [points[at] for points, at in zip(grids, ends, strict=True)], runner)
    nominal, probes = first[0], np.split(first[1:], np.cumsum([len(at) for at in ends])[:-1])
    # What moves nothing at its bounds moves nothing between them, and is not simulated there.
    moving = [
        not len(each) or not np.array_equal(each, np.broadcast_to(nominal, each.shape), equal_nan=True)
        for each in probes
    ]
    rest = [
        np.delete(points, at, axis=0) if moves else points[:0]
        for points, at, moves in zip(grids, ends, moving, strict=True)
    ]
    second = _features(recording, layout, effects, rest, runner)[1:] if any(map(len, rest)) else first[:0]
    found = []
    for points, at, moves, probe, more in zip(
        grids, ends, moving, probes, np.split(second, np.cumsum([len(points) for points in rest])[:-1]), strict=True
    ):
        table = np.zeros((len(points), layout.size))
        if moves:
            between = np.setdiff1d(np.arange(len(points)), at)
            table[at], table[between] = np.nan_to_num(probe - nominal), np.nan_to_num(more - nominal)
        found.append(table)
    return found


def _ends(effect: Effect, points: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return which points of a grid lie at bounds, or at null, in every parameter."""
    ends = np.array([(each.minimum, each.null, each.maximum) for each in effect.parameters])
    # A grid is made from shares of the span, and its ends are rounded.
    near = np.abs(points[:, :, np.newaxis] - ends) <= _ROUNDED * np.ptp(ends, axis=1)[:, np.newaxis]
    return np.flatnonzero(near.any(axis=2).all(axis=1))


_ROUNDED = 1e-9
"""Share of a parameter's span within which a point of its grid is at a bound. Chosen: far above rounding."""


def _features(
    recording: Recording,
    layout: Layout,
    effects: Sequence[Effect],
    points: Sequence[NDArray[np.float64]],
    runner: Runner,
) -> NDArray[np.float64]:
    """Return the features of the nominal run, and of every effect at some points, one after the other."""
    tasks = [Task(recording, layout, {})]
    for effect, rows in zip(effects, points, strict=True):
        keys = [effect.key(each) for each in effect.parameters]
        tasks += [Task(recording, layout, dict(zip(keys, row.tolist(), strict=True))) for row in rows]
    return np.array(runner.features(tasks, "signatures"))


def _contact(
    runs: NDArray[np.float64],
    draws: NDArray[np.float64],
    scatter: NDArray[np.float64],
    layout: Layout,
    constants: Constants,
) -> NDArray[np.float64]:
    """Return the leading directions of what scattered runs leave of a linear model, scaled by their deviation."""
    if not len(scatter) or not len(runs):
        return np.zeros((0, layout.size))
    scaled = (runs - draws @ scatter) / layout.floor
    # LAPACK's faster divide and conquer has failed to converge on finite numbers, once in some hundred dictionaries.
    _, values, rows = svd(scaled - scaled.mean(axis=0), full_matrices=False, lapack_driver="gesvd")
    count = constants.contact_columns
    found: NDArray[np.float64] = rows[:count] * (values[:count, np.newaxis] / np.sqrt(len(runs) - 1)) * layout.floor
    return found


def _digest(recording: Recording, layout: Layout, problem: Problem, constants: Constants) -> str:
    parts = [_FORMAT, problem.version, problem.group_of(recording), layout.signals, layout.bin_s, list(layout.event_s)]
    parts += [[each.name, each.null, each.sigma] for each in (*problem.scatter, *problem.constants)]
    parts += [constants.contact_runs, constants.contact_columns]
    return _hash(parts)


def _hash(parts: list[Any]) -> str:
    return hashlib.blake2b(json.dumps(parts).encode(), digest_size=16).hexdigest()


def _read(folder: Path | None, name: str) -> dict[str, NDArray[np.float64]] | None:
    """Return what stands on disk; None where there is nothing that can be read."""
    if folder is None:
        return None
    try:
        with np.load(folder / f"{name}.npz") as stored:
            return dict(stored)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile):
        return None


def _write(folder: Path | None, name: str, arrays: Mapping[str, Any]) -> None:
    """Put a file on disk, whole or not at all; a disk that is full or may not be written to is no error."""
    if folder is None:
        return
    path = folder / f"{name}.npz"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".part", delete=False) as file:
            np.savez(file, **arrays)
        Path(file.name).replace(path)
    except OSError:
        return
