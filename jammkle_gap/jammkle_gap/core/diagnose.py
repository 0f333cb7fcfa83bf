"""From recordings, references and a simulator to a diagnosis."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.core.calibrate import Discrepancy, calibrate, runnable, uncalibrated
from jammkle_gap.core.conclude import Evidence, conclude
from jammkle_gap.core.constants import Constants
from jammkle_gap.core.data import BadRecordingError
from jammkle_gap.core.detect import classes_of
from jammkle_gap.core.fit import grid_features, grid_signatures, screen
from jammkle_gap.core.scatter import difference_of, residuals_of, settings_of, with_discrepancy
from jammkle_gap.core.search import reweighed, search
from jammkle_gap.core.signatures import Dictionary, cache_folder, dictionary_of, grids_of, with_readings
from jammkle_gap.core.simulate import Runner, StoppedError, Task, UnrunnableError

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
    from jammkle_gap.core.search import Candidates, Provisional
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
        references: Of the same machine while healthy, in the same settings.
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
    machine: Mapping[str, float] = {}
    complete = all(setting.references for setting in settings)
    if not any(setting.references for setting in settings):
        residuals, difference, machine = _linearised(
            settings, residuals, difference, slopes, problem, runner, constants
        )
    elif not complete:
        # Where references are missing, what is known of the machine is all there is.
        residuals = calibrated
        difference = _difference(settings, residuals, dictionaries, problem, runner, calibration, constants)
        machine = calibration.values
    grids = grid_features(problem, settings, dictionaries)
    signatures = grid_signatures(grids, difference)
    classes = classes_of(grids_of(problem), signatures, constants)
    if complete and calibration.after < calibration.before:
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
    noticed = candidates
    own: dict[tuple[str, ...], float] = {}
    if not complete and candidates.finished:
        try:
            error = Discrepancy(settings, residuals, difference, constants)
            candidates, own = _search_with_discrepancy(
                problem, settings, error, grids, machine, candidates, runner, constants
            )
        except StoppedError:
            candidates = replace(candidates, finished=False)
    return Evidence(
        problem,
        settings,
        tuple(nominal),
        tuple(residuals),
        calibration,
        machine,
        difference,
        noticed,
        candidates,
        own,
        classes,
        grids,
    )


def _search_with_discrepancy(
    problem: Problem,
    settings: Sequence[Setting],
    error: Discrepancy,
    grids: GridFeatures,
    machine: Mapping[str, float],
    noticed: Candidates,
    runner: Runner,
    constants: Constants,
) -> tuple[Candidates, dict[tuple[str, ...], float]]:
    """Search again beside model discrepancy, and weigh what was found in both searches.

    Raises:
        StoppedError: asked to stop.

    """
    weighed = error.difference_with(())
    screening = screen(problem, settings, grid_signatures(grids, weighed), weighed, machine, runner)
    candidates = search(problem, settings, screening, weighed, machine, runner, constants)
    return reweighed(problem, settings, error, machine, (noticed, candidates), runner, constants)


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
    shared = _shared(settings, problem, runner, calibration)
    return difference_of(settings, residuals, nuisances, contact, shared, constants)


def _laid(rows: NDArray[np.float64], dictionary: Dictionary, setting: Setting, problem: Problem) -> NDArray[np.float64]:
    """Return differences of a dictionary as columns in the features of a setting, shape (n, differences)."""
    return np.ascontiguousarray(dictionary.laid(setting.layout, rows, problem, setting.faulty[0]).T)


def _linearised(
    settings: Sequence[Setting],
    residuals: Sequence[Residuals],
    difference: Difference,
    slopes: Sequence[NDArray[np.float64]],
    problem: Problem,
    runner: Runner,
    constants: Constants,
) -> tuple[list[Residuals], Difference, Mapping[str, float]]:
    """Take the machine's constants as linear about where the recordings themselves put them, without any reference.

    They keep their priors: a place to linearise at is no knowledge (as in an iterated Kalman filter; Bell and Cathey
    1993, IEEE Trans. Autom. Control 38:294). Residuals are those of the linear model at the nominal constants.

    Returns:
        Residuals, the difference whitened anew, and the constants at that place.

    """
    asked = [
        replace(setting, references=setting.faulty, reference_features=setting.faulty_features) for setting in settings
    ]
    found = calibrate(asked, [each.scatter for each in difference.settings], slopes, problem, runner, constants)
    if not found.values:
        return list(residuals), difference, {}
    try:
        made = residuals_of(settings, runner, found.values)
    except UnrunnableError:
        return list(residuals), difference, {}
    shared = _shared(settings, problem, runner, replace(uncalibrated(problem), values=found.values))
    place = np.array([found.deviations[each.name] for each in problem.constants])
    moved = [replace(each, faulty=each.faulty + columns @ place) for each, columns in zip(made, shared, strict=True)]
    none = [np.zeros(each.size) for each in difference.settings]
    parts = tuple(replace(each, shared=columns) for each, columns in zip(difference.settings, shared, strict=True))
    return moved, with_discrepancy(replace(difference, settings=parts), moved, none), found.values


def _shared(
    settings: Sequence[Setting], problem: Problem, runner: Runner, calibration: Calibration
) -> list[NDArray[np.float64]]:
    """Return columns of the machine's constants where references are missing, one posterior deviation each."""
    count = len(problem.constants)
    found = [np.zeros((setting.layout.size, count)) for setting in settings]
    # The matrix root of the posterior covariance turns one deviation of each constant into independent columns.
    root = np.linalg.cholesky(calibration.covariance) if count else np.zeros((0, 0))
    for k, setting in enumerate(settings):
        if setting.references or not count:
            continue
        tasks = [Task(setting.faulty[0], setting.layout, calibration.values)]
        for each in problem.constants:
            at = calibration.values.get(each.name, each.null)
            step = each.sigma if at + each.sigma <= each.maximum else -each.sigma
            tasks.append(Task(setting.faulty[0], setting.layout, {**calibration.values, each.name: at + step}))
        made = runner.features(tasks, "constants of the machine")
        signs = [np.sign(task.values[each.name] - calibration.values.get(each.name, each.null))
                 for task, each in zip(tasks[1:], problem.constants, strict=True)]  # fmt: skip
        derivatives = np.nan_to_num(np.array([each - made[0] for each in made[1:]])).T * np.array(signs)
        found[k] = derivatives @ root
    return found
