"""Signatures: what each effect and each nuisance makes of the features of a setting, kept on disk.

A signature depends on the simulator, on the setting and on the grid, and hardly on the run: it is simulated once per
setting at the nominal machine, and found again by a digest of all that went into it. Another version of the simulator,
or other bounds of an effect, have another digest, so that an old dictionary is never used.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import svd  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.core.features import Layout, layout_of, registered_s
from jammkle_gap.core.grids import Grid, grid_of
from jammkle_gap.core.readings import known_features
from jammkle_gap.core.simulate import Task

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.data import Recording
    from jammkle_gap.core.effects import Effect
    from jammkle_gap.core.simulate import Problem, Runner

_FORMAT = 5
"""Of the files."""


@dataclass(frozen=True)
class Dictionary:
    """Signatures of one setting, in a layout of its own."""

    layout: Layout
    nominal: NDArray[np.float64]
    """Features of the nominal simulator, shape (n,)."""
    effects: Mapping[str, NDArray[np.float64]]
    """By effect, differences at the points of its grid, shape (points, n); effects of sensors are not in it."""
    scatter: NDArray[np.float64]
    """Differences for one standard deviation of each nuisance, shape (nuisances, n)."""
    contact: NDArray[np.float64]
    """What scattered runs differ by that is not linear in the nuisances, as columns, shape (columns, n)."""
    constants: NDArray[np.float64]
    """Differences for one standard deviation of each constant of the machine, shape (constants, n)."""

    def laid(
        self, layout: Layout, differences: NDArray[np.float64], problem: Problem, run: Recording
    ) -> NDArray[np.float64]:
        """Return differences of the dictionary in the layout of the runs at hand, events put where theirs are.

        Args:
            layout: Of the runs.
            differences: Shape (..., n of the dictionary).
            problem: Tells which signals follow which event.
            run: One of the runs.

        Returns:
            Shape (..., layout.size). Signals that the dictionary does not have are 0.

        """
        own = self.layout
        table = own.by_signal(differences)
        laid = np.zeros((*differences.shape[:-1], layout.size))
        out = layout.by_signal(laid)
        for i, name in enumerate(layout.signals):
            if name not in own.signals:
                continue
            asked = problem.registrar.events_of(run, name) if problem.registrar is not None else ()
            own_s = registered_s(layout.time_s, asked, layout.event_s, own.event_s)
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
    layout = layout_of([recording], problem.bin_s(recording), problem.registrar)
    # A group that has no name could be anything.
    kept = folder if problem.version and problem.group_of(recording) else None
    name = _digest(recording, layout, problem, constants)
    known = None if kept is None else _read(kept / f"{name}.npz", layout)
    if known is None:
        known = _scattered(recording, layout, problem, runner, constants)
        if kept is not None:
            _write(kept / f"{name}.npz", known)
    asked = [effect for effect in problem.library if not known_features(problem, layout, (effect.name,)).all()]
    tables = {each.name: None if kept is None else _read_table(_table_file(kept, name, each)) for each in asked}
    missing = [each for each in asked if tables[each.name] is None]
    for each, table in zip(missing, _simulated(recording, known.layout, missing, runner), strict=True):
        tables[each.name] = table
        if kept is not None:
            _write_table(_table_file(kept, name, each), table)
    found = {
        name: table.astype(float) for name, table in tables.items() if table is not None and np.abs(table).max() > 0.0
    }
    return dataclasses.replace(known, effects=found)


def cache_folder() -> Path:
    """Return where dictionaries are kept by default: `$XDG_CACHE_HOME/jammkle`, or `~/.cache/jammkle`."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "jammkle"


def _scattered(
    recording: Recording, layout: Layout, problem: Problem, runner: Runner, constants: Constants
) -> Dictionary:
    """Return a dictionary without effects: the nominal run, nuisances, constants of the machine, and scattered runs."""
    tasks = [Task(recording, layout, {})]
    singles = (*problem.scatter, *problem.constants)
    tasks += [Task(recording, layout, {each.name: each.null + each.sigma}) for each in singles]
    draws = np.random.default_rng(0).standard_normal((constants.contact_runs, len(problem.scatter)))
    for draw in draws.tolist():
        values = {each.name: each.null + each.sigma * x for each, x in zip(problem.scatter, draw, strict=True)}
        tasks.append(Task(recording, layout, values))
    features = np.array(runner.features(tasks, "signatures"))
    # A signal that the simulator does not give is NaN throughout, and not compared.
    nominal = features[0]
    differences = np.nan_to_num(features[1:] - nominal)
    scatter, machine, drawn = np.split(differences, [len(problem.scatter), len(singles)])
    contact = _contact(drawn, draws, scatter, layout, constants)
    return Dictionary(layout, nominal, {}, scatter, contact, machine)


def _simulated(
    recording: Recording, layout: Layout, effects: Sequence[Effect], runner: Runner
) -> list[NDArray[np.float64]]:
    """Return the differences that effects make at the points of their grids, shape (points, n) each."""
    if not effects:
        return []
    grids = [grid_of(effect).points for effect in effects]
    tasks = [Task(recording, layout, {})]
    for effect, points in zip(effects, grids, strict=True):
        keys = [effect.key(each) for each in effect.parameters]
        tasks += [Task(recording, layout, dict(zip(keys, point.tolist(), strict=True))) for point in points]
    features = np.array(runner.features(tasks, "signatures"))
    differences = np.nan_to_num(features[1:] - features[0])
    return np.split(differences, np.cumsum([len(points) for points in grids])[:-1])


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
    return hashlib.blake2b(json.dumps(parts).encode(), digest_size=16).hexdigest()


def _read(path: Path, layout: Layout) -> Dictionary | None:
    """Return what stands on disk; None where there is nothing that can be read."""
    try:
        with np.load(path) as stored:
            events = dict(zip(layout.event_s, stored["event_s"].tolist(), strict=True))
            bins = int(stored["bins"])
            own = Layout(layout.signals, layout.units, layout.bin_s, bins, events, stored["floor"])
            return Dictionary(own, stored["nominal"], {}, stored["scatter"], stored["contact"], stored["constants"])
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None


def _write(path: Path, dictionary: Dictionary) -> None:
    """Put a dictionary on disk, whole or not at all; a disk that is full or may not be written to is no error."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".part", delete=False) as file:
            events = np.array(list(dictionary.layout.event_s.values()))
            arrays: dict[str, Any] = {
                "bins": np.array(dictionary.layout.bins),
                "floor": dictionary.layout.floor,
                "event_s": events,
                "nominal": dictionary.nominal,
                "scatter": dictionary.scatter,
                "contact": dictionary.contact,
                "constants": dictionary.constants,
            }
            np.savez(file, **arrays)
        Path(file.name).replace(path)
    except OSError:
        return


def _table_file(folder: Path, name: str, effect: Effect) -> Path:
    """Return where the signatures of one effect are kept: whoever adds an effect simulates no other again."""
    points = json.dumps([effect.name, grid_of(effect).points.tolist()])
    return folder / name / f"{hashlib.blake2b(points.encode(), digest_size=16).hexdigest()}.npy"


def _read_table(path: Path) -> NDArray[np.float64] | None:
    """Return what stands on disk; None where there is nothing that can be read."""
    try:
        table: NDArray[np.float64] = np.load(path)
    except (OSError, ValueError, EOFError):
        return None
    return table


def _write_table(path: Path, table: NDArray[np.float64]) -> None:
    """Put signatures on disk, whole or not at all."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".part", delete=False) as file:
            np.save(file, table.astype(np.float32))
        Path(file.name).replace(path)
    except OSError:
        return
