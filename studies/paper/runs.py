"""What stands in for each row, claim and curve of the paper, a rig and its options, and running all of it."""

from __future__ import annotations

import concurrent.futures
import multiprocessing
import os
import signal
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common import names
from jammkle_common.command.errors import Interrupted
from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_common.parameters import from_mapping
from jammkle_common.processes import end_with_parent
from jammkle_sim.rigs.catalogue import rig_kind, run_rig, scattered
from jammkle_sim.rigs.model import hung
from jammkle_sim.rigs.recording import smoothed
from jammkle_sim.rigs.slip import Footing, SlipOptions
from studies.paper.tables import DROP_TEST, ROWS, SLIP_TEST, TENSILE_TEST

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from concurrent.futures import Future

    from numpy.typing import NDArray

    from jammkle_common.parameters import Value
    from jammkle_sim.rigs.run import RigRun

PARAMETER_SETS = ("fitted", "as_printed")
"""Both are run, in this order."""

MATERIALS = {"multi": "multi-material", "a30": "Shore A-30", "a85": "Shore A-85"}
"""What tendons were printed of, with a name for people."""

VACUUMS_KPA = (0, 10, 30, 50)
"""Vacuums of the paper's force-displacement curves."""

RIG_OF_TEST = {TENSILE_TEST: "tensile", DROP_TEST: "drop", SLIP_TEST: "slip"}
PEAK_OF_TEST = {TENSILE_TEST: "peak_force_n", DROP_TEST: "peak_deceleration_m_s2", SLIP_TEST: "peak_before_heel_n"}
"""Which of a rig's results stands beside the paper's number; in the slip test, beside what it claims."""

PEAK_OF_DESCENT, ENERGY = "peak_force_n", "energy_n_m"
"""The slip rig's other results: peak of the whole descent, N, and work of the push over it, J."""


@dataclass(frozen=True)
class Experiment:
    """One setting of one rig."""

    identifier: str
    """Of the row, where it stands for one."""
    test: str
    title: str
    values: Mapping[str, Value] = field(default_factory=dict)
    """Options of the rig that differ from its defaults."""

    @property
    def rig(self) -> str:
        """Name of the rig."""
        return RIG_OF_TEST[self.test]

    def options(self, parameter_set: str, seed: int) -> Any:
        """Return the options of the rig before scatter."""
        values = {**self.values, "parameter_set": parameter_set, "seed": seed}
        return from_mapping(rig_kind(self.rig).options, values)


ROW_EXPERIMENTS = tuple(Experiment(row.identifier, row.test, row.title, row.options) for row in ROWS)
"""One per row of the tables."""

SLIP_RIGID, SLIP_UNJAMMED, SLIP_JAMMED = (
    Experiment("slip_rigid_ankle", SLIP_TEST, "Rigid ankle", {"foot": "rigid_ankle"}),
    Experiment("slip_unjammed_ankle", SLIP_TEST, "Unjammed ankle", {"foot": "unjammed"}),
    Experiment("slip_jammed_ankle", SLIP_TEST, "Jammed ankle", {"foot": "jammed"}),
)
SLIP_EXPERIMENTS = (SLIP_RIGID, SLIP_UNJAMMED, SLIP_JAMMED)
"""What the claims of the slip test compare."""


@dataclass(frozen=True)
class HangingSlip:
    """The slip test on feet that hang toe-down, the rigid one fixed at it, with one friction for all three."""

    pitch_deg: float
    friction: float

    @property
    def wedges(self) -> bool:
        """Whether no force makes the rigid foot slide."""
        slip = SlipOptions()
        footing = Footing(slip.slope_deg, slip.leg_m, hung(None, self.pitch_deg))
        return self.friction >= footing.wedging_friction

    @property
    def experiments(self) -> tuple[Experiment, Experiment, Experiment]:
        """The rigid, the unjammed and the jammed foot."""
        pose = {
            "hang_pitch_deg": self.pitch_deg,
            "friction": self.friction,
            "edge_friction": self.friction,
        }
        rigid, unjammed, jammed = (
            Experiment(
                f"{flat.identifier}_{self.pitch_deg:g}_{self.friction:g}",
                SLIP_TEST,
                flat.title,
                {**flat.values, **pose},
            )
            for flat in SLIP_EXPERIMENTS
        )
        return rigid, unjammed, jammed

    @property
    def runs(self) -> tuple[Experiment, ...]:
        """Those that can be run."""
        return self.experiments[1:] if self.wedges else self.experiments


HANGING = (
    *(HangingSlip(40.0, friction) for friction in (0.30, 0.55, 0.58, 0.65)),
    *(HangingSlip(20.0, friction) for friction in (0.49, 0.60)),
)
"""The pitch of the drop rig, and half of it, below and beyond the friction that wedges a rigid foot. Each is run once,
with the fitted constants."""

CURVE_EXPERIMENTS = tuple(
    Experiment(
        f"{material}_vac{kpa}",
        TENSILE_TEST,
        f"{name[0].upper()}{name[1:]}, -{kpa} kPa",
        {"material": material, "vacuum_pa": kpa * 1e3},
    )
    for material, name in MATERIALS.items()
    if material != "multi"
    for kpa in VACUUMS_KPA
    if kpa and f"{material}_vac{kpa}" not in {row.identifier for row in ROWS}
)
"""Curves that belong to no row: run once each, without scatter."""


def curve_identifier(material: str, vacuum_kpa: int) -> str:
    """Return which experiment gives the curve of a material at a vacuum."""
    if vacuum_kpa:
        return f"{material}_vac{vacuum_kpa}"
    return "membrane_atm" if material == "multi" else f"{material}_atm"


_LOOK_S = 0.2
"""How often a request to stop is looked for."""
_STRETCHES = 250
"""Parts of a slow curve of which two points each are drawn: more cannot be seen."""
_MM_PER_M = 1e3
_BEGUN_MM = 0.05
_ARRIVED_MM = 0.1
"""How near to its start and end a carriage counts as being there, mm."""
_FALLING_M_S2 = 5.0
"""Specific force below which the leg falls."""
_BEFORE_S, _AFTER_S = 0.12, 0.6
"""Part of a drop that is drawn, around the touch-down."""


@dataclass(frozen=True)
class Task:
    """One run to do. `repeat` is None for the options as they are, without scatter."""

    experiment: Experiment
    parameter_set: str
    seed: int
    repeat: int | None


@dataclass(frozen=True)
class Curve:
    """What is drawn of a run. Tensile: mm and N; drop: s from the touch-down and m/s^2 net; slip: mm and N."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]


@dataclass(frozen=True)
class Outcome:
    """What one run gave."""

    task: Task
    results: dict[str, float]
    broken: tuple[str, ...]
    curve: Curve


def run_task(task: Task) -> Outcome:
    """Do one run.

    Raises:
        ParameterError: the options do not fit together.
        UnstableSimulationError: the simulation blew up.

    """
    rig = task.experiment.rig
    options = task.experiment.options(task.parameter_set, task.seed)
    if task.repeat is not None:
        options = scattered(rig, options, task.repeat)
    run = run_rig(rig, options, lambda _: None, lambda: False)
    return Outcome(task, run.results, run.broken, _curve(task.experiment.test, run))


def run_all(
    tasks: Sequence[Task], on_done: Callable[[int, Task], None], asked_to_stop: Callable[[], bool], workers: int = 0
) -> tuple[Outcome, ...]:
    """Do all runs, in processes of their own, and return their outcomes in the order of the tasks.

    Args:
        tasks: What to run.
        on_done: Called after each run with the number that is done and what it was.
        asked_to_stop: Asked now and then; true ends the work after the runs that are on their way.
        workers: Processes; 0 takes one per core that this process may use.

    Raises:
        Interrupted: asked to stop.
        ParameterError: options of a task do not fit together.
        UnstableSimulationError: a simulation blew up.

    """
    count = min(workers or len(os.sched_getaffinity(0)), len(tasks))
    # A fresh interpreter per worker: a fork would copy whatever threads and compiled state this process holds.
    context = multiprocessing.get_context("spawn")
    pool = concurrent.futures.ProcessPoolExecutor(count, context, _start_worker, (os.getpid(),))
    try:
        futures = [pool.submit(run_task, task) for task in tasks]
        task_of = dict(zip(futures, tasks, strict=True))
        _wait(futures, lambda future, done: on_done(done, task_of[future]), asked_to_stop)
        return tuple(future.result() for future in futures)
    finally:  # without this the runs that nobody waits for any more would all be done
        pool.shutdown(cancel_futures=True)


def _wait(
    futures: Sequence[Future[Outcome]],
    on_done: Callable[[Future[Outcome], int], None],
    asked_to_stop: Callable[[], bool],
) -> None:
    left = set(futures)
    while left:
        done, left = concurrent.futures.wait(left, _LOOK_S, concurrent.futures.FIRST_COMPLETED)
        for future in done:
            future.result()
            on_done(future, len(futures) - len(left))
        if asked_to_stop():
            raise Interrupted


def _start_worker(parent: int) -> None:
    # Ctrl-C reaches the whole group; the parent decides what becomes of it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent(parent)


def _curve(test: str, run: RigRun) -> Curve:
    if test == DROP_TEST:
        return _shock(run)
    joints, cell = run.topics[names.JOINT_STATES.name], run.topics[names.LOAD_CELL.name]
    position_m = joints.column(f"{names.CARRIAGE_JOINT}.position")
    travel_mm = np.abs(position_m - position_m[0]) * _MM_PER_M
    force_n = smoothed(cell.column("force_z_n"))
    begin, end = _first(travel_mm > _BEGUN_MM), _first(travel_mm > travel_mm.max() - _ARRIVED_MM)
    if test == TENSILE_TEST:
        back = end + _first(travel_mm[end:] < _BEGUN_MM)
        return _thinned(travel_mm[begin:back], force_n[begin:back])
    # The cell carries the leg before the touch, and the push on the slope takes from that.
    return _thinned(travel_mm[begin:end], float(np.median(force_n[:begin])) - force_n[begin:end])


def _shock(run: RigRun) -> Curve:
    imu = run.topics[names.IMU.name]
    upward_m_s2 = imu.column("linear_acceleration_z_m_s2")
    falls = upward_m_s2 < _FALLING_M_S2
    released = _first(falls)
    landed = released + _first(~falls[released:])
    time_s = imu.time_s - imu.time_s[landed]
    shown = (time_s > -_BEFORE_S) & (time_s < _AFTER_S)
    return Curve(time_s[shown], upward_m_s2[shown] - STANDARD_GRAVITY_M_S2)


def _thinned(x: NDArray[np.float64], y: NDArray[np.float64]) -> Curve:
    """Keep the lowest and the highest point of each short stretch, so that no peak is lost."""
    stretch = max(1, len(x) // _STRETCHES)
    kept: set[int] = {0, len(x) - 1}
    for start in range(0, len(x), stretch):
        part = y[start : start + stretch]
        kept |= {start + int(part.argmin()), start + int(part.argmax())}
    chosen = np.array(sorted(kept))
    return Curve(x[chosen], y[chosen])


def _first(happens: NDArray[np.bool_]) -> int:
    """Return the first index at which something happens; the last one if it never does."""
    return int(happens.argmax()) if happens.any() else len(happens) - 1
