"""From recordings, references and a simulator to a diagnosis."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.core.calibrate import Discrepancy, calibrate, runnable, uncalibrated
from jammkle_gap.core.conclude import Evidence, Unreferenced, conclude
from jammkle_gap.core.constants import Constants
from jammkle_gap.core.data import BadRecordingError
from jammkle_gap.core.detect import classes_of
from jammkle_gap.core.fit import grid_features, grid_signatures, screen
from jammkle_gap.core.joint import Machine, explain
from jammkle_gap.core.scatter import difference_of, refuse_copies, residuals_of, settings_of
from jammkle_gap.core.search import search
from jammkle_gap.core.signatures import Dictionary, cache_folder, dictionary_of, grids_of, with_readings
from jammkle_gap.core.simulate import Runner, Task, on_one_thread

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from jammkle_gap.core.calibrate import Calibration
    from jammkle_gap.core.data import Recording
    from jammkle_gap.core.design import Experiment
    from jammkle_gap.core.fit import GridFeatures, Screening
    from jammkle_gap.core.result import Diagnosis
    from jammkle_gap.core.scatter import Difference, Residuals, Setting
    from jammkle_gap.core.search import Provisional
    from jammkle_gap.core.signatures import Dictionary
    from jammkle_gap.core.simulate import Problem, Progress, Stop


def diagnose(  # noqa: PLR0913 - every one is a choice of the user's
    recordings: Sequence[Recording],
    problem: Problem,
    *,
    references: Sequence[Recording] = (),
    experiments: Sequence[Experiment] = (),
    constants: Constants | None = None,
    folder: Path | None = None,
    jobs: int = -1,
    progress: Progress | None = None,
    provisional: Provisional | None = None,
    stop: Stop | None = None,
) -> Diagnosis:
    """Say where recordings and simulator disagree, which effect causes it, and how far the gap shrinks with it.

    Args:
        recordings: Of the machine in question; those of the same setting are repeats.
        problem: Simulator, library of effects, nuisances.
        references: Of the same machine in its past, in the same settings: then what has changed since is asked, and
            the simulator's own errors cancel. Without any, simulator and machine are compared.
        experiments: Runs that could be made, to split what cannot be distinguished.
        constants: Of the model; those not given are as derived.
        folder: Where signatures are kept; by default `$XDG_CACHE_HOME/jammkle`.
        jobs: Runs at a time, as joblib counts.
        progress: Reports long work.
        provisional: Reports the first answer, before anything is fitted.
        stop: Asked after every run; True ends the search with what is known by then.

    Raises:
        BadRecordingError: the recordings cannot be used.
        SimulatorError: the simulator failed; the message names the parameters.
        StoppedError: asked to stop before anything was known.

    """
    started = time.perf_counter()
    constants = constants or Constants()
    runner = Runner(problem, jobs, progress, stop)
    kept = folder or cache_folder()
    evidence = evidence_of(recordings, references, problem, runner, constants, kept, provisional)
    found = conclude(evidence, experiments, runner, constants)
    return replace(found, spent=replace(found.spent, wall_s=time.perf_counter() - started))


@on_one_thread
def evidence_of(
    recordings: Sequence[Recording],
    references: Sequence[Recording],
    problem: Problem,
    runner: Runner,
    constants: Constants,
    folder: Path | None,
    provisional: Provisional | None = None,
) -> Evidence:
    """Simulate, calibrate, whiten and fit.

    Raises:
        BadRecordingError: the recordings cannot be used.
        SimulatorError: the simulator failed.

    """
    if not recordings:
        msg = "there is no recording to diagnose; give one or more"
        raise BadRecordingError(msg)
    settings = settings_of(recordings, references, problem)
    refuse_copies(settings)
    if references and not any(setting.references for setting in settings):
        made_in = ", ".join(sorted({each.setting or each.name for each in references}))
        asked = ", ".join(setting.name for setting in settings)
        msg = f"no reference was made in the setting of a recording: references in {made_in}; recordings in {asked}"
        msg += "; record references in the same settings, or leave them out"
        raise BadRecordingError(msg)
    dictionaries = [
        dictionary_of((setting.references or setting.faulty)[0], problem, runner, constants, folder)
        for setting in settings
    ]
    nominal = residuals_of(settings, runner, {})
    residuals: Sequence[Residuals] = nominal
    settings = with_readings(settings, problem, runner)
    difference = _difference(settings, residuals, dictionaries, problem, runner, uncalibrated(problem), constants)
    slopes = [
        _laid(each.constants, each, setting, problem) for each, setting in zip(dictionaries, settings, strict=True)
    ]
    calibration = calibrate(
        settings, [each.scatter for each in difference.settings], slopes, problem, runner, constants
    )
    calibration, calibrated = runnable(calibration, settings, nominal, problem, runner)
    grids = grid_features(problem, settings, dictionaries)
    if not all(setting.references for setting in settings):
        # Where some settings have references, these have calibrated the constants; else drawings give their tolerances.
        raw, silent = tuple(each.difference for each in calibrated), _silent(problem, dictionaries, grids)
        prior = Machine(problem, settings, raw, calibration, silent)
        if calibration.values:
            difference = _difference(settings, calibrated, dictionaries, problem, runner, calibration, constants)
        return _jointly(prior, calibrated, difference, grids, runner, constants, provisional)
    signatures = grid_signatures(grids, difference)
    machine: Mapping[str, float] = {}
    if calibration.after < calibration.before:
        residuals, difference, machine, screening = _better_machine(
            settings, signatures, residuals, difference, calibrated, calibration.values, problem, runner
        )
    else:
        screening = screen(problem, settings, signatures, difference, machine, runner)
    if provisional is not None:
        length = max(float(difference.whitened @ difference.whitened), 1.0)
        shares = {name: min(max(gain / length, 0.0), 1.0) for name, gain in screening.gains.items()}
        provisional(sorted(shares.items(), key=lambda item: -item[1]))
    candidates = search(problem, settings, screening, difference, machine, runner, constants)
    classes = classes_of(grids_of(problem), signatures, constants)
    return Evidence(
        problem,
        settings,
        tuple(residuals),
        calibration,
        machine,
        difference,
        candidates.singles,
        candidates,
        classes,
        grids,
    )


def _silent(problem: Problem, dictionaries: Sequence[Dictionary], grids: GridFeatures) -> tuple[frozenset[str], ...]:
    """Return parameters and constants that move nothing in a setting, per setting."""
    found = []
    for k, dictionary in enumerate(dictionaries):
        still = np.flatnonzero(~dictionary.constants.any(axis=1)).tolist()
        names = {problem.constants[i].name for i in still}
        idle = [effect for effect in problem.library if not grids[effect.name][k].any()]
        found.append(frozenset(names.union(effect.key(each) for effect in idle for each in effect.parameters)))
    return tuple(found)


def _jointly(
    machine: Machine,
    residuals: Sequence[Residuals],
    difference: Difference,
    grids: GridFeatures,
    runner: Runner,
    constants: Constants,
    provisional: Provisional | None,
) -> Evidence:
    """Explain recordings of which some have no references, beside what is known of the machine's constants."""
    problem, settings = machine.problem, machine.settings
    found = explain(machine, residuals, difference, grids, runner, constants, provisional)
    return Evidence(
        problem,
        settings,
        tuple(residuals),
        machine.prior,
        machine.values(machine.mean),
        difference,
        found.noticed,
        found.candidates,
        classes_of(grids_of(problem), grid_signatures(grids, difference), constants),
        grids,
        Unreferenced(machine, found, Discrepancy(settings, residuals, difference, constants)),
    )


def _better_machine(
    settings: Sequence[Setting],
    signatures: Mapping[str, NDArray[np.float64]],
    residuals: Sequence[Residuals],
    difference: Difference,
    calibrated: Sequence[Residuals],
    machine: Mapping[str, float],
    problem: Problem,
    runner: Runner,
) -> tuple[Sequence[Residuals], Difference, Mapping[str, float], Screening]:
    """Return residuals, difference, constants and screening of the calibrated machine, or of the nominal one.

    Two are on offer, as drawn and as calibrated: the one counts in which an effect explains more. Constants that were
    fitted to references take up what the simulator has wrong, and may leave more at other commands: of pulls with a
    clock that drifts 2.9 per feature, where the nominal machine leaves 1.0.

    Args:
        settings: Runs, all with references.
        signatures: Whitened, of every effect's grid points.
        residuals: Of the nominal machine.
        difference: Of the nominal machine.
        calibrated: Residuals of the calibrated machine.
        machine: Its constants.
        problem: Simulator and library.
        runner: Makes the runs.

    """
    other = replace(difference, whitened=difference.whiten([each.difference for each in calibrated]))
    screening = screen(problem, settings, signatures, other, machine, runner)
    nominal = screen(problem, settings, signatures, difference, {}, runner)
    if nominal.left < screening.left:
        return residuals, difference, {}, nominal
    return calibrated, other, machine, screening


def _difference(
    settings: Sequence[Setting],
    residuals: Sequence[Residuals],
    dictionaries: Sequence[Dictionary],
    problem: Problem,
    runner: Runner,
    calibration: Calibration,
    constants: Constants,
) -> Difference:
    pairs = list(zip(dictionaries, settings, strict=True))
    nuisances = [_laid(dictionary.scatter, dictionary, setting, problem) for dictionary, setting in pairs]
    contact = [_laid(dictionary.contact, dictionary, setting, problem) for dictionary, setting in pairs]
    shared = _shared(settings, dictionaries, problem, runner, calibration)
    return difference_of(settings, residuals, nuisances, contact, shared, constants)


def _laid(rows: NDArray[np.float64], dictionary: Dictionary, setting: Setting, problem: Problem) -> NDArray[np.float64]:
    """Return differences of a dictionary as columns in the features of a setting, shape (n, differences)."""
    return np.ascontiguousarray(dictionary.laid(setting.layout, rows, problem, setting.faulty[0]).T)


def _shared(
    settings: Sequence[Setting],
    dictionaries: Sequence[Dictionary],
    problem: Problem,
    runner: Runner,
    calibration: Calibration,
) -> list[NDArray[np.float64]]:
    """Return columns of the machine's constants where references are missing, one posterior deviation each."""
    count = len(problem.constants)
    found = [np.zeros((setting.layout.size, count)) for setting in settings]
    for k, (setting, dictionary) in enumerate(zip(settings, dictionaries, strict=True)):
        moving = np.flatnonzero(dictionary.constants.any(axis=1)).tolist()
        if setting.references or not moving:
            continue
        if not calibration.values:
            found[k] = _laid(dictionary.constants, dictionary, setting, problem)
            continue
        tasks, steps = [Task(setting.faulty[0], setting.layout, calibration.values)], []
        for i in moving:
            each = problem.constants[i]
            at = calibration.values.get(each.name, each.null)
            steps.append(each.step_from(at))
            values = {**calibration.values, each.name: at + steps[-1] * each.sigma}
            tasks.append(Task(setting.faulty[0], setting.layout, values))
        first, *others = runner.features(tasks, "constants of the machine")
        for i, step, made in zip(moving, steps, others, strict=True):
            found[k][:, i] = np.nan_to_num(made - first) / step
    # The matrix root of the posterior covariance turns one deviation of each constant into independent columns.
    root = np.linalg.cholesky(calibration.covariance)
    return [each @ root for each in found] if count else found
