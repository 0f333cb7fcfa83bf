"""From recordings, references and a simulator to a diagnosis."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.core.calibrate import calibrate, runnable, uncalibrated
from jammkle_gap.core.conclude import Evidence, conclude
from jammkle_gap.core.constants import Constants
from jammkle_gap.core.data import BadRecordingError
from jammkle_gap.core.decide import classes_of
from jammkle_gap.core.discrepancy import Discrepancy
from jammkle_gap.core.explain import explain, least_left
from jammkle_gap.core.fit import grid_features, grid_signatures
from jammkle_gap.core.joint import FORWARD, Machine, blank_of, slopes_in
from jammkle_gap.core.scatter import difference_of, refuse_copies, residuals_of, settings_of, whitened_difference
from jammkle_gap.core.signatures import Dictionary, cache_folder, dictionary_of, grids_of, with_readings
from jammkle_gap.core.simulate import Runner, on_one_thread

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from jammkle_gap.core.data import Recording
    from jammkle_gap.core.design import Experiment
    from jammkle_gap.core.explain import Provisional
    from jammkle_gap.core.fit import GridFeatures
    from jammkle_gap.core.result import Diagnosis
    from jammkle_gap.core.scatter import Difference, Residuals
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
    if problem.sensing is not None and not references:
        problem = replace(problem, sensing=problem.sensing.without_references())
    dictionaries = [
        # A regulator answers a fault: at the commands of a healthy run signatures would mislead.
        dictionary_of(each.faulty[0], problem, runner, constants, folder).laid(each.layout, problem, each.faulty[0])
        for each in settings
    ]
    nominal = residuals_of(settings, runner, {})
    settings = with_readings(settings, problem, runner)

    def differing(residuals: Sequence[Residuals], shared: Sequence[NDArray[np.float64]]) -> Difference:
        """Return the difference; constants of the machine are columns of it where there are no references."""
        own = [np.zeros_like(each) if k.references else each for k, each in zip(settings, shared, strict=True)]
        nuisances, contact = [each.scatter.T for each in dictionaries], [each.contact.T for each in dictionaries]
        return difference_of(settings, residuals, nuisances, contact, own, constants)

    slopes = [each.constants.T for each in dictionaries]
    difference = differing(nominal, slopes)
    grids = grid_features(problem, settings, dictionaries)
    raw = tuple(each.difference for each in nominal)
    drawn = Machine(problem, settings, raw, uncalibrated(problem), _silent(problem, dictionaries, grids))
    scatter = [each.scatter for each in difference.settings]
    calibration = calibrate(settings, scatter, slopes, problem, runner, constants)
    calibration, calibrated = runnable(calibration, settings, nominal, problem, runner)
    machine = replace(drawn, raw=tuple(each.difference for each in calibrated), prior=calibration)
    if all(setting.references for setting in settings):
        held = [each.held() for each in (machine, drawn)]
        bare = [replace(each, shared=each.shared[:, :0]) for each in difference.settings]
        errors = [Discrepancy(settings, each.raw, whitened_difference(bare, each.raw), constants) for each in held]
        # Constants that were fitted to references take up what the simulator has wrong, and may leave more at other
        # commands, of pulls with a clock that drifts 2.9 per feature where the nominal machine leaves 1.0: those count
        # beside which an effect explains more.
        if not calibration.after < calibration.before or (
            least_left(held[1], errors[1], grids, runner, constants)
            < least_left(held[0], errors[0], grids, runner, constants)
        ):
            held, errors, calibrated = held[::-1], errors[::-1], nominal
            calibration = replace(uncalibrated(problem), before=calibration.before, after=calibration.before)
        machine, error = held[0], errors[0]
    else:
        if calibration.values:
            # Settings with references have calibrated the constants; else drawings give their tolerances.
            blank = blank_of(difference, [each @ machine.root for each in slopes])
            work = [(k, machine, difference, blank, FORWARD) for k in range(len(settings))]
            answers = runner.map(slopes_in, work, "constants of the machine")
            runner.count(made for _, made in answers)
            difference = differing(calibrated, [each @ machine.root for each, _ in answers])
        error = Discrepancy(settings, machine.raw, difference, constants)
    explained = explain(machine, error, grids, runner, constants, provisional)
    classes = classes_of(grids_of(problem), grid_signatures(grids, error.difference), constants)
    return Evidence(problem, settings, calibration, machine, tuple(calibrated), error, explained, classes, grids)


def _silent(problem: Problem, dictionaries: Sequence[Dictionary], grids: GridFeatures) -> tuple[frozenset[str], ...]:
    """Return parameters and constants that move nothing in a setting, per setting."""
    found = []
    for k, dictionary in enumerate(dictionaries):
        still = np.flatnonzero(~dictionary.constants.any(axis=1)).tolist()
        names = {problem.constants[i].name for i in still}
        idle = [effect for effect in problem.library if not grids[effect.name][k].any()]
        found.append(frozenset(names.union(effect.key(each) for effect in idle for each in effect.parameters)))
    return tuple(found)
