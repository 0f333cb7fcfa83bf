"""From a model and recordings to a diagnosis: `diagnose_mujoco`.

The library of a robot with seven joints has more than a hundred effects. The most promising are handed to the
diagnosis, which fits them and their pairs with the simulator.
"""

from __future__ import annotations

import itertools
import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_gap.core.data import BadRecordingError
from jammkle_gap.core.decide import NONE_OF_THEM
from jammkle_gap.core.diagnose import diagnose
from jammkle_gap.core.effects import Library
from jammkle_gap.core.result import Candidate, Verdict
from jammkle_gap.core.simulate import Problem, on_one_thread
from jammkle_gap.mujoco.bags import run_of_bag
from jammkle_gap.mujoco.corrected import closing_of, corrected_of, share_left
from jammkle_gap.mujoco.drives import joint_of
from jammkle_gap.mujoco.library import robot_library
from jammkle_gap.mujoco.robot import load, match
from jammkle_gap.mujoco.runs import BadRobotError, Run, in_model_terms, read_map, run_of_csv
from jammkle_gap.mujoco.screening import BIN_S, left_by, promising, refitted
from jammkle_gap.mujoco.simulator import RobotSimulator, run, scale_of
from jammkle_gap.mujoco.windows import lifted, recordings_of, repeats_of
from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_gap.core.data import Recording
    from jammkle_gap.core.result import Diagnosis
    from jammkle_gap.mujoco.corrected import Corrected, SignalClosing
    from jammkle_gap.mujoco.library import RobotLibrary
    from jammkle_gap.mujoco.robot import Robot
    from jammkle_gap.mujoco.runs import RobotMap

_LOG = logging.getLogger(__name__)
WINDOW_S = 2.0
"""Length of a window, s."""
SEARCH_S = 15.0
"""How much of all recordings together the search looks at, s; the answer is tried on the rest."""
CORRECTED_NAME = "corrected.xml"


@dataclass(frozen=True)
class RobotDiagnosis:
    """What was found of a robot."""

    diagnosis: Diagnosis
    robot: Robot
    library: Library
    """All effects that were screened."""
    shared: Mapping[str, tuple[str, ...]]
    """By effect that joints share, those of single joints."""
    problem: Problem
    """With those that were fitted; its simulator has them all."""
    recordings: tuple[Recording, ...]
    """What was compared."""
    tried: tuple[Recording, ...]
    """What the corrected model was tried on."""
    corrected: Corrected
    closing: tuple[SignalClosing, ...]
    """What the corrected model closes when it is loaded: in recordings that were held out, else in windows that were
    not fitted, and in those that were where the search looked at everything."""


@on_one_thread
def diagnose_mujoco(  # noqa: PLR0913 - every one is a choice of the user's
    model: Path | str,
    bags: Sequence[Path | str | Run],
    joints: Mapping[str, Any] | Path | None = None,
    *,
    since: Sequence[Path | str | Run] = (),
    held_out: Sequence[Path | str | Run] = (),
    only: Sequence[str] = (),
    without: Sequence[str] = (),
    folder: Path | str = "runs/gap",
    search_s: float = SEARCH_S,
    window_s: float = WINDOW_S,
    jobs: int = -1,
    **options: Any,
) -> RobotDiagnosis:
    """Say where a robot and its model disagree, and why, and write the corrected model.

    What was decided for want of a word in the map is logged (`jammkle_gap.mujoco.diagnosing`, INFO) before the search,
    and stands in the notes of the diagnosis.

    Args:
        model: MJCF, or a URDF that MuJoCo loads.
        bags: Bags, CSV files (`run_of_csv`) or arrays (`run_of_arrays`).
        joints: What recordings and model call differently, as a map (`runs`) or a file with it.
        since: The same of the same machine at an earlier time: what has changed since? Each must be commanded as one of
            the bags.
        held_out: The same, that nothing is fitted to: what does the corrected model close there?
        only: Effects on offer, and no others; empty: all.
        without: Effects that are not on offer.
        folder: Where `corrected.xml` goes.
        search_s: How much of all recordings together is fitted, s.
        window_s: Length of a window, s.
        jobs: Processes, as joblib counts.
        options: Of `diagnose`: `progress`, `provisional`, `stop`.

    Raises:
        BadRobotError: model, map and recordings do not fit.
        BadRecordingError: a recording cannot be used.
        BadEffectError: there is no effect of such a name.
        InputError: a bag cannot be read.

    """
    progress = options.get("progress") or (lambda _what, _share: None)
    runs, robot = matched(Path(model), [*bags, *since, *held_out], joints)
    parts = np.cumsum([len(bags), len(since)]).tolist()
    compared, kept = recordings_of(robot, runs[: parts[0]], window_s, search_s)
    references = repeats_of(robot, compared, runs[parts[0] : parts[1]])
    tried, where = (kept, "windows that were not fitted") if kept else (compared, "windows that were fitted")
    if held_out:
        tried, _ = recordings_of(robot, runs[parts[1] :], window_s, np.inf)
        where = "recordings that were held out"
    every = robot_library(robot, compared)
    offered = [every.effects.effect(name) for name in dict.fromkeys(only)] or list(every.effects)
    excluded = {every.effects.effect(name).name for name in without}
    offer = Library(tuple(effect for effect in offered if effect.name not in excluded))
    simulator = RobotSimulator(robot, every.changes)
    decided = [
        *robot.notes,
        *dict.fromkeys(note for run in runs for note in run.notes),
        *_check_efforts(simulator, compared),
        *_coarse(simulator, compared),
    ]
    for note in decided:
        _LOG.info(note)
    library = promising(simulator, every, offer, compared, jobs, progress)
    problem = Problem(simulator, library, every.scatter, every.constants, bin_s=lambda _: BIN_S)
    found = diagnose(compared, problem, references=references, jobs=jobs, **options)
    progress("closing the gap", 0.0)
    tries = [refitted(simulator, every, compared, start, jobs) for start in _starts(every, found)]
    values = min(tries, key=lambda each: left_by(simulator, kept or compared, each)) if len(tries) > 1 else tries[0]
    target = Path(folder) / CORRECTED_NAME
    target.parent.mkdir(parents=True, exist_ok=True)
    corrected = corrected_of(robot, simulator.machine(values), values, target.parent)
    target.write_text(corrected.xml, encoding="utf-8")
    closing = closing_of(robot, target, runs, tried)
    if tried is not compared:
        found = _doubted(found, share_left(closing), where)
    constants = {each.name for each in every.constants}
    within = list(dict.fromkeys(key.partition(".")[0] for key in values if key not in constants))
    notes = (
        *decided,
        f"{len(offer.effects)} effects were screened, and the {len(library.effects)} most promising fitted",
        f"{CORRECTED_NAME} has in it the constants of the machine{_beside(within, found)}",
        f"{CORRECTED_NAME}, loaded again, leaves {_sentence(closing)}, in {where}",
    )
    found = replace(found, notes=(*notes, *(note for note in found.notes if note not in notes)))
    return RobotDiagnosis(
        diagnosis=found,
        robot=robot,
        library=offer,
        shared={name: each for name, each in every.members.items() if name not in excluded},
        problem=problem,
        recordings=tuple(compared),
        tried=tuple(tried),
        corrected=corrected,
        closing=closing,
    )


def _check_efforts(simulator: RobotSimulator, recordings: Sequence[Recording]) -> list[str]:
    """Refuse efforts that are of another unit or sign than the model's, as currents are; note those that may be."""
    robot = simulator.robot
    made = [simulator(each, {}) for each in recordings]
    found: dict[str, float] = {}
    unclear = []
    for joint in robot.efforts:
        name = f"{joint}/effort"
        read = np.concatenate([each.signal(name).values for each in recordings])
        model = np.concatenate([each[name] for each in made])
        share = float(read @ model) / max(float(model @ model), 1e-12)
        correlation = float(read @ model) / max(float(np.linalg.norm(read) * np.linalg.norm(model)), 1e-12)
        if abs(correlation) < _CORRELATED:
            unclear.append(joint)
        elif not 1.0 / _DOUBTED < share < _DOUBTED:
            found[joint] = share
    if not found:
        return []
    shares = ", ".join(f"{share:.3g} (joint {joint})" for joint, share in found.items())
    constants = ", ".join(f"{joint}: {1.0 / share:.3g}" for joint, share in found.items())
    msg = f"efforts are {shares} of what the model takes for the same motion; if they are currents, or of another sign"
    msg += f", write 'torque_constants: {{{constants}}}' into a map (N m/A)"
    msg += f", with those of {', '.join(unclear)}, which this motion does not show" if unclear else ""
    if all(1.0 / _OTHER_UNIT < share < _OTHER_UNIT for share in found.values()):
        return [f"{msg}; a load, or another gain, does the same, and is diagnosed"]
    raise BadRobotError(msg)


def _coarse(simulator: RobotSimulator, recordings: Sequence[Recording]) -> list[str]:
    """Note where half of the model's step makes another run of it: what a step makes is taken for physics."""
    if not simulator.robot.drives:
        return []
    fine = simulator.machine({})
    step_s = float(fine.model.opt.timestep)
    fine.model.opt.timestep = 0.5 * step_s
    found: dict[str, float] = {}
    for each in recordings:
        plain, finer = simulator(each, {}), run(fine, each)
        for signal in each.signals:
            off = float(np.sqrt(np.square(finer[signal.name] - plain[signal.name]).mean())) / scale_of(signal)
            found[signal.name] = max(found.get(signal.name, 0.0), off)
    most = max(found, key=lambda name: found[name])
    if found[most] < 1.0:
        return []
    note = f"the model's step of {step_s:g} s changes {most} by {found[most]:.2g} times its noise, beside half of it"
    return [f"{note}; give the model a smaller timestep, or that is taken for physics"]


_CORRELATED = 0.8
"""Correlation from which on an effort is taken for the model's in another unit."""
_OTHER_UNIT = 3.0
"""How many times an effort may be the model's. Chosen: no effect on offer makes half of that."""
_DOUBTED = 1.25
"""The same from which on the notes ask whether it is a current. Chosen: torque constants are known within a tenth."""


def _doubted(found: Diagnosis, left: float, where: str) -> Diagnosis:
    """Return a diagnosis in which none of the effects is as likely, if the corrected model closes too little."""
    if found.verdict not in {Verdict.EFFECTS, Verdict.AMBIGUOUS} or left <= _TOO_MUCH_LEFT:
        return found
    lead = next(each for each in found.candidates if each.names)
    before = found.posterior.get(NONE_OF_THEM, 0.0)
    none = max(before, lead.probability)
    total = 1.0 - before + none
    posterior = {names: share / total for names, share in {**found.posterior, NONE_OF_THEM: none}.items()}
    others = [replace(each, probability=each.probability / total) for each in found.candidates if each.names]
    second = Candidate(NONE_OF_THEM, none / total, 0.0, ())
    reason = f"with the corrected model {100.0 * left:.0f} % of the gap is left in {where}"
    return replace(
        found,
        verdict=Verdict.AMBIGUOUS,
        reasons=(*found.reasons, f"{reason}, so that none of the effects is as likely"),
        candidates=(*others[:1], second, *others[1:]),
        posterior=dict(sorted(posterior.items(), key=lambda item: -item[1])),
        subsystems={name: share / total for name, share in found.subsystems.items()},
    )


_TOO_MUCH_LEFT = 0.5
"""Share of the gap that is left where nothing was fitted, from which on nothing is certain. Chosen: half, with the real
servo known, whose wrong pair leaves 0.69."""


def _starts(every: RobotLibrary, found: Diagnosis) -> list[dict[str, float]]:
    """Return where the fit of the corrected model begins: with the best candidate, and without where none is certain.

    Where none of the effects is most likely, the likeliest is a lead. The corrected model has it if that leaves less
    where nothing was fitted.
    """
    # Earlier recordings have calibrated the constants, later ones are explained beside them.
    constants = {each.name: each.null + found.calibration.get(each.name, 0.0) * each.sigma for each in every.constants}
    constants.update({each.name: each.value for each in found.constants})
    if found.verdict is Verdict.NO_GAP:
        return [constants]
    fitted = {f"{effect.name}.{each.name}": each.value for effect in found.effects for each in effect.parameters}
    if found.verdict is not Verdict.UNKNOWN:
        return [{**constants, **fitted}]
    lead = next((names for names in found.posterior if names), ())
    begun = {key: each.null + _BEGIN * ((each.maximum if each.maximum > each.null else each.minimum) - each.null)
             for key, each in every.effects.parameters(lead)}  # fmt: skip
    return [{**constants, **(fitted or begun)}, constants]


_BEGIN = 0.1
"""Share of the way to a bound that a lead which was not fitted begins at."""


def _beside(names: Sequence[str], found: Diagnosis) -> str:
    if not names:
        return " alone"
    return f" and {' and '.join(names)}" + (
        ", which is a lead" if NONE_OF_THEM in (each.names for each in found.candidates) else ""
    )


def _sentence(closing: Sequence[SignalClosing]) -> str:
    order = sorted(closing, key=lambda one: one.corrected / max(one.nominal, 1e-12))
    worse = [each for each in order[_SAID:] if each.corrected > _WORSE * each.nominal][-1:]
    said = [f"{each.corrected:.3g} {each.unit} of {each.nominal:.3g} in {each.signal}" for each in order[:_SAID]]
    said += [f"but {each.corrected:.3g} {each.unit} of {each.nominal:.3g} in {each.signal}" for each in worse]
    return ", ".join(said)


_WORSE = 1.2
"""How much more of a signal the corrected model must leave to be said."""
_SAID = 4
"""Signals that the note on the corrected model names: those that it closes most of."""


def _check_names(given: RobotMap, runs: Sequence[Run], model: mujoco.MjModel) -> None:
    """Refuse a map of joints that no recording, or no model, has."""
    commanded = (joint for run in runs for joint, _ in run.commands)
    recorded = list(dict.fromkeys((*(joint for run in runs for joint in run.joints()), *commanded)))
    known = [model.joint(k).name for k in range(model.njnt)]
    for name, asked in given.joints.items():
        if name not in recorded:
            msg = f"the map names joint {name}, which no recording has; they have: {', '.join(recorded)}"
            raise BadRobotError(msg)
        if asked.model not in known:
            msg = f"the map takes joint {name} for {asked.model}, which the model has not"
            msg += f"; write one of {', '.join(known)}, or 'locked' or 'measured'"
            raise BadRobotError(msg)


def matched(
    model: Path, bags: Sequence[Path | str | Run], joints: Mapping[str, Any] | Path | None = None
) -> tuple[list[Run], Robot]:
    """Read recordings, in the model's terms, and match the model with them.

    Raises:
        BadRobotError: model, map and recordings do not fit.
        BadRecordingError: a recording cannot be used.
        InputError: a bag cannot be read.

    """
    given = read_map(joints)
    if not bags:
        msg = "there is no recording to diagnose; give one or more"
        raise BadRecordingError(msg)
    _, nominal = load(model)
    order = [joint for k in range(nominal.nu) if (joint := joint_of(nominal, k))]
    if not nominal.nu:  # a URDF has no actuators: its joints are what is commanded
        moving = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
        order = [nominal.joint(k).name for k in range(nominal.njnt) if int(nominal.jnt_type[k]) in moving]
    runs = []
    for bag in bags:
        if isinstance(bag, Run):
            runs.append(bag)
        elif Path(bag).suffix == ".csv":
            runs.append(run_of_csv(Path(bag)))
        else:
            runs.append(run_of_bag(Path(bag), given, order))
    for first, second in itertools.combinations(runs, 2):
        if first.measured.keys() == second.measured.keys() and all(
            np.array_equal(track.values, second.measured[key].values) for key, track in first.measured.items()
        ):
            msg = f"recordings {first.name} and {second.name} hold the same readings; give each of them once"
            raise BadRecordingError(msg)
    _check_names(given, runs, nominal)
    slides = [nominal.joint(k).name for k in range(nominal.njnt) if nominal.jnt_type[k] == mujoco.mjtJoint.mjJNT_SLIDE]
    runs = [in_model_terms(run, given, slides) for run in runs]
    names = [run.name for run in runs]
    runs = [
        replace(run, name=f"{run.name} ({k})") if names.count(run.name) > 1 else run for k, run in enumerate(runs, 1)
    ]
    robot = match(model, runs, given)
    return [lifted(robot, run) for run in runs], robot
