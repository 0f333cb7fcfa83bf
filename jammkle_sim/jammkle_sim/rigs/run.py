"""Run a rig or a robot without the graph, as fast as it can, and keep what it measured, topic by topic."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common import names
from jammkle_common.parameters import ParameterError
from jammkle_sim.rigs.recording import CONTROL_ROWS, GROUND_CLEARANCE, IMU_PERIOD_S, STATE_ROWS, Recorder, Series
from jammkle_sim.rigs.simulation import OverloadError, Simulation
from jammkle_sim.rigs.vacuum import VacuumKeeper

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from jammkle_common.parameters import ParameterClass
    from jammkle_sim.physics.ankle import AnkleParameters
    from jammkle_sim.physics.sensors import SensorParameters
    from jammkle_sim.rigs.rig import Rig
    from jammkle_sim.rigs.vacuum import VacuumStep

ROBOT_TOPICS = (names.IMU.name, names.JOINT_STATES.name, names.TENDON_STATES.name)
"""What a robot has sensors for, or a foot that is exercised, beside pressures and commands. Tendons are simulated."""
LEG_TOPICS = (*ROBOT_TOPICS, names.LOAD_CELL.name)
"""What a rig with a whole leg has sensors for, beside pressures and commands."""
PRESSURE_RATE_HZ = 100
"""Rate of every pressure of a robot and of what its gait plans, Hz, as on the graph."""
_LOOKS_PER_S = 10
"""How often progress is reported and it is asked whether to go on, per simulated second."""
_ACCELERATIONS = 3
"""Columns of the IMU that are accelerations; angular rates come after them."""
_CLIPPED_SHARE = 0.99
"""Of its range, from which on an IMU was clipped: its filter does not reach the end of it in a short blow. Chosen: four
standard deviations of its filtered noise are 0.0006 of it, and a blow that clips for some 3 ms reads 0.9992 of it."""
_ROUNDING_S = 1e-12
"""What a sum of time steps may differ by, s."""


class RigCancelledError(RuntimeError):
    """A run was cancelled before its end."""


@dataclass(frozen=True)
class TravelLimit:
    """How far a joint can go before its law means nothing any more; going further ends the run."""

    joint: str
    largest_m: float
    what: str
    """What is at its end, and why there: `squash ball is pressed until its walls meet`."""
    advice: str
    """What to change: `give --mass-kg of 5 or less`."""


@dataclass(frozen=True)
class Programme:
    """What a rig does and how long."""

    duration_s: float
    """Since the start of the rig."""
    vacuum: tuple[VacuumStep, ...]
    """Set points by rising time."""
    evaluate: Callable[[Mapping[str, Series]], dict[str, float]]
    """Makes the results of a run, SI units, from its topics, and from GROUND_CLEARANCE if anything is watched."""
    topics: tuple[str, ...]
    """Topics, of those that the rig could give, that it has sensors for, beside pressures and commands."""
    overload_advice: str = ""
    """What to change if a force grows past the range of the load cell, which ends the run; empty: it goes on, clipped,
    as where a blow is part of the test."""
    watched: tuple[str, ...] = ()
    """Geoms whose clearance from the ground the evaluation needs."""
    travel_limit: TravelLimit | None = None
    """A joint that may not go further than what it stands for can; none: all may."""


@dataclass(frozen=True)
class RigKind:
    """One rig as it is registered in `jammkle_sim.rigs.catalogue`."""

    name: str
    title: str
    """What it does, in one line."""
    options: type[ParameterClass]
    """Frozen dataclass made of `jammkle_common.parameters.parameter` fields."""
    build: Callable[..., tuple[Rig, Programme]]
    """Makes rig and programme from checked options, with another `ankle` if that is given too; raises ParameterError
    where they do not fit together."""
    scatter: Callable[[Any, tuple[float, float]], Any]
    """Makes the options of one repeat, from the options and two standard normal numbers."""
    ankle: AnkleParameters | None = None
    """Constants of the ankle that it is built with; None: it has none."""


@dataclass(frozen=True)
class RigRun:
    """One finished run of a rig, or of one ankle of a robot."""

    rig: str
    options: Any
    """The options dataclass of the rig."""
    topics: dict[str, Series]
    """By the name of the topic. Of a rig: IMU 1 kHz; joint states, tendon states, load cell 500 Hz; pressures 100 Hz;
    pump duty and solenoids at the start and on change."""
    description: dict[str, object]
    """Everything that was simulated, plain types."""
    results: dict[str, float]
    """Measured figures, SI units, by a name that ends in the unit."""
    broken: tuple[str, ...]
    """Tendons that tore."""
    clipped: tuple[str, ...]
    """What read the end of its range, as a plain phrase with the range: figures taken from it are too small."""
    robot_description: str = ""
    """URDF, of a robot."""
    left_out: tuple[str, ...] = ()
    """What of an effects file it goes without, by `constant.parameter`."""


def check_timestep(timestep_s: float) -> None:
    """Refuse a time step of which no whole number makes a row of the IMU.

    Raises:
        ParameterError: it does not divide the period of the IMU.

    """
    steps = round(IMU_PERIOD_S / timestep_s)
    if steps < 1 or abs(steps * timestep_s - IMU_PERIOD_S) > _ROUNDING_S:
        problem = f"it must divide {IMU_PERIOD_S:g} s, as 0.0005 or 0.00025 do"
        raise ParameterError(problem, "timestep_s", timestep_s)


def run(
    rig: Rig,
    programme: Programme,
    options: Any,
    on_progress: Callable[[float], None],
    cancelled: Callable[[], bool],
) -> RigRun:
    """Take a rig through its programme.

    Args:
        rig: What is simulated.
        programme: What it does.
        options: What both were made from; kept with the run.
        on_progress: Called with the share done, 0 to 1, every simulated tenth of a second or so.
        cancelled: Asked as often; true ends the run.

    Raises:
        RigCancelledError: it was cancelled.
        UnstableSimulationError: the simulation blew up; an OverloadError: past the range of the load cell, where the
            programme does not allow for it, or past its travel limit.
        ParameterError: the time step does not divide the period of the IMU.

    """
    check_timestep(float(rig.model.opt.timestep))
    simulation = Simulation(rig)
    recorder = Recorder(simulation, IMU_PERIOD_S)
    keeper = VacuumKeeper(programme.vacuum, rig.pneumatics.ambient_pa)
    limits = _Limits(rig, programme, simulation)
    (name,) = simulation.ankles
    rows = CONTROL_ROWS * max(1, round(programme.duration_s / (CONTROL_ROWS * IMU_PERIOD_S)))
    for row in range(0, rows, STATE_ROWS):
        if row % round(1.0 / (IMU_PERIOD_S * _LOOKS_PER_S)) == 0:
            on_progress(row / rows)
            if cancelled():
                msg = f"rig '{rig.name}' was cancelled after {simulation.elapsed_s:g} s of {programme.duration_s:g} s"
                raise RigCancelledError(msg)
        if row % CONTROL_ROWS == 0:
            _control(simulation, recorder, keeper)
        recorder.advance(STATE_ROWS)
        recorder.note_load_cell(programme.watched)
        limits.check()
    on_progress(1.0)
    topics = recorder.topics(name, programme.topics, state_rows=STATE_ROWS, wiring=rig.wiring)
    watched = {GROUND_CLEARANCE: recorder.clearance(name, programme.watched)} if programme.watched else {}
    return RigRun(
        rig=rig.name,
        options=options,
        topics=topics,
        description=rig.description(),
        results=programme.evaluate({**topics, **watched}),
        broken=tuple(tendon.name for tendon in simulation.ankle.tendons() if tendon.broken),
        clipped=_clipped(rig.sensors, topics),
        left_out=tuple(rig.left_out),
    )


def _control(simulation: Simulation, recorder: Recorder, keeper: VacuumKeeper) -> None:
    """Measure the pressures, and command pump and solenoids."""
    ((name, ankle),) = simulation.ankles.items()
    channels, manifold = ankle.channel_pressures_pa(), ankle.manifold_pressure_pa()
    commands = keeper.commands(simulation.elapsed_s, channels, manifold, CONTROL_ROWS * IMU_PERIOD_S)
    recorder.note_pressures()
    recorder.note_commands(name, commands.pump_duty, commands.energised, simulation.elapsed_s)
    ankle.set_pump_duty(commands.pump_duty)
    for channel, energised in zip(names.CHANNELS, commands.energised, strict=True):
        ankle.set_solenoid(channel, energised)


class _Limits:
    """Ends a run where its forces or ways mean nothing any more."""

    def __init__(self, rig: Rig, programme: Programme, simulation: Simulation) -> None:
        self._rig, self._programme, self._simulation = rig, programme, simulation
        self._start_m = self._height_m()

    def check(self) -> None:
        """Look at load cell and travel.

        Raises:
            OverloadError: past a limit.

        """
        programme, simulation, name = self._programme, self._simulation, self._rig.name
        if programme.overload_advice and simulation.ankle.is_load_cell_overloaded():
            descent_mm = 1e3 * (self._start_m - self._height_m())
            msg = (
                f"rig '{name}': the force passed {self._rig.sensors.load_cell_limit_n:g} N, the range of the "
                f"load cell, at a descent of {descent_mm:.1f} mm; {programme.overload_advice}"
            )
            raise OverloadError(msg)
        limit = programme.travel_limit
        if limit is not None and (travel_m := simulation.joint_position(limit.joint)) > limit.largest_m:
            msg = (
                f"rig '{name}': the {limit.what}: by {1e3 * travel_m:.1f} mm {simulation.elapsed_s:.3f} s after the "
                f"start, the limit is {1e3 * limit.largest_m:.1f} mm; {limit.advice}"
            )
            raise OverloadError(msg)

    def _height_m(self) -> float:
        return self._simulation.joint_position(names.CARRIAGE_JOINT)


def _clipped(sensors: SensorParameters, topics: Mapping[str, Series]) -> tuple[str, ...]:
    """Say which sensors were at the end of their range; the IMU's filter adds its noise to it."""
    found = []
    cell, imu = topics.get(names.LOAD_CELL.name), topics.get(names.IMU.name)
    if cell is not None:
        for column, largest_n in zip(cell.columns, np.abs(cell.values).max(axis=0).tolist(), strict=True):
            if largest_n >= sensors.load_cell_limit_n:
                found.append(f"{column} of the load cell at {sensors.load_cell_limit_n:g} N")
    if imu is not None:
        limit_m_s2 = sensors.acceleration_limit_m_s2
        if np.abs(imu.values[:, :_ACCELERATIONS]).max() >= _CLIPPED_SHARE * limit_m_s2:
            found.append(f"the IMU at {limit_m_s2:.2f} m/s^2 with gravity")
    return tuple(found)


def run_robot(
    simulation: Simulation,
    duration_s: float,
    rate_hz: int,
    on_progress: Callable[[float], None],
    cancelled: Callable[[], bool],
    urdf: str = "",
) -> dict[str, RigRun]:
    """Let a robot go on for a time, and return what every ankle measured, by its name.

    Args:
        simulation: The robot, at its start, with whatever its ankles were commanded.
        duration_s: How long, simulated, s.
        rate_hz: Rate of IMU, joints, tendons and the truth; a multiple of 100 that divides the step rate.
        on_progress: Called with the share done, 0 to 1.
        cancelled: Asked as often; true ends the run.
        urdf: Its description, kept with the runs.

    Raises:
        ValueError: the rate does not fit.
        RigCancelledError: it was cancelled.
        UnstableSimulationError: the simulation blew up.

    """
    if rate_hz % PRESSURE_RATE_HZ:
        msg = f"a rate of {rate_hz} Hz does not fit the pressures' {PRESSURE_RATE_HZ} Hz; it must be a multiple"
        raise ValueError(msg)
    machine = simulation.machine
    recorder = Recorder(simulation, simulation.steps_per(rate_hz) * simulation.timestep_s)
    for index in range(1, round(duration_s * rate_hz) + 1):
        began_s = simulation.elapsed_s
        recorder.advance(1)
        for name, ankle in simulation.ankles.items():  # they are regulated as a row begins
            recorder.note_commands(name, ankle.pump_duty, ankle.energised, began_s)
        recorder.note_contacts()
        if index % (rate_hz // PRESSURE_RATE_HZ) == 0:
            recorder.note_pressures()
            recorder.note_base_and_plans()
        if index % (rate_hz // _LOOKS_PER_S) == 0:
            on_progress(simulation.elapsed_s / duration_s)
            if cancelled():
                msg = f"robot '{machine.name}' was cancelled after {simulation.elapsed_s:g} s of {duration_s:g} s"
                raise RigCancelledError(msg)
    description, runs = machine.description(), {}
    sensors = {ankle.name: ankle.sensors for ankle in machine.in_model()}
    for name, ankle in simulation.ankles.items():
        topics = recorder.topics(name, ROBOT_TOPICS)
        broken = tuple(tendon.name for tendon in ankle.tendons() if tendon.broken)
        figures, clipped = _robot_figures(topics), _clipped(sensors[name], topics)
        runs[name] = RigRun(machine.name, machine.options, topics, description, figures, broken, clipped, urdf)
    return runs


def _robot_figures(topics: Mapping[str, Series]) -> dict[str, float]:
    truth = topics[names.TRUE_CONTACT.name]
    force_m_s2 = np.linalg.norm(topics[names.IMU.name].values[:, :_ACCELERATIONS], axis=1)
    stands = truth.column("stands")
    return {
        "peak_specific_force_m_s2": float(force_m_s2.max()),
        "peak_normal_force_n": float(truth.column("normal_force_n").max()),
        "standing_share": float(stands.mean()),
        "touch_downs": float((np.diff(stands) > 0.0).sum()),
        "sliding_distance_m": float(truth.column("sliding_distance_m")[-1]),
        "peak_sliding_speed_m_s": float(truth.column("sliding_speed_m_s").max()),
    }
