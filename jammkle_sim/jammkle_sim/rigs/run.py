"""Run a rig without the graph, as fast as it can, and keep what it measured, topic by topic."""

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

    from jammkle_sim.rigs.rig import Rig
    from jammkle_sim.rigs.vacuum import VacuumStep

__all__ = [
    "CONTROL_ROWS",
    "IMU_PERIOD_S",
    "LEG_TOPICS",
    "STATE_ROWS",
    "Programme",
    "RigCancelledError",
    "RigRun",
    "RunInProgress",
    "Series",
    "run",
    "steps_per_row",
]

LEG_TOPICS = (names.IMU.name, names.JOINT_STATES.name, names.TENDON_STATES.name, names.LOAD_CELL.name)
"""What a rig with a whole leg has sensors for, beside pressures and commands."""
_ACCELERATIONS = 3
"""Columns of the IMU that are accelerations; angular rates come after them."""
_IMU_NOISE_M_S2 = 0.05
"""How far below its range a clipped IMU still reads: four standard deviations of its filtered noise."""
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
class RigRun:
    """One finished run."""

    rig: str
    options: Any
    """The options dataclass of the rig."""
    topics: dict[str, Series]
    """By the name of the topic. IMU 1 kHz; joint states, tendon states, load cell 500 Hz; pressures 100 Hz; pump duty
    and solenoids at the start and on change."""
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


def steps_per_row(timestep_s: float) -> int:
    """Return how many time steps one row of the IMU takes.

    Raises:
        ParameterError: not a whole number.

    """
    steps = round(IMU_PERIOD_S / timestep_s)
    if steps < 1 or abs(steps * timestep_s - IMU_PERIOD_S) > _ROUNDING_S:
        problem = f"it must divide {IMU_PERIOD_S:g} s, as 0.0005 or 0.00025 do"
        raise ParameterError(problem, "timestep_s", timestep_s)
    return steps


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
    running = RunInProgress(rig, programme, options)
    while not running.is_finished:
        if running.rows_done % (CONTROL_ROWS * CONTROL_ROWS) == 0:
            on_progress(running.share_done)
            if cancelled():
                time_s = running.simulation.rig_time_s
                msg = f"rig '{rig.name}' was cancelled after {time_s:g} s of {programme.duration_s:g} s"
                raise RigCancelledError(msg)
        running.advance(STATE_ROWS)
    on_progress(1.0)
    return running.result()


class RunInProgress:
    """One run, taken forward in rows of the IMU, so that others can look at it between two of them."""

    def __init__(self, rig: Rig, programme: Programme, options: Any) -> None:
        """Start the rig.

        Args:
            rig: What is simulated.
            programme: What it does.
            options: What both were made from; kept with the run.

        Raises:
            ParameterError: the time step does not divide the period of the IMU.

        """
        self._rig = rig
        self._programme = programme
        self._options = options
        self._simulation = Simulation(rig)
        self._recorder = Recorder(rig, self._simulation, programme.watched)
        self._keeper = VacuumKeeper(programme.vacuum, rig.pneumatics.ambient_pa)
        self._steps = steps_per_row(self._simulation.timestep_s)
        self._rows = CONTROL_ROWS * max(1, round(programme.duration_s / (CONTROL_ROWS * IMU_PERIOD_S)))
        self._done = 0
        self._start_m = self._height_m()

    @property
    def simulation(self) -> Simulation:
        """What is simulated, to look at."""
        return self._simulation

    @property
    def topics(self) -> tuple[str, ...]:
        """Topics, beside pressures and commands, that the rig has sensors for; tendon_states only with a tendon."""
        has_tendons = bool(self._rig.tendon_names)
        return tuple(topic for topic in self._programme.topics if has_tendons or topic != names.TENDON_STATES.name)

    @property
    def rows_done(self) -> int:
        """Rows of the IMU, IMU_PERIOD_S each, taken so far."""
        return self._done

    @property
    def share_done(self) -> float:
        """How much of the run is done, 0 to 1."""
        return self._done / self._rows

    @property
    def is_finished(self) -> bool:
        """Whether the programme is at its end."""
        return self._done >= self._rows

    def advance(self, rows: int) -> None:
        """Go on by rows of the IMU, however many there are left; the result does not depend on the portions.

        Raises:
            UnstableSimulationError: the simulation blew up; an OverloadError: past the range of the load cell, where
                the programme does not allow for it, or past its travel limit.

        """
        while rows > 0 and not self.is_finished:
            if self._done % CONTROL_ROWS == 0:
                self._control()
            portion = min(rows, STATE_ROWS - self._done % STATE_ROWS)
            self._recorder.record_rows(portion, self._steps)
            self._done += portion
            rows -= portion
            if self._done % STATE_ROWS == 0:
                self._recorder.note_load_cell()
                self._check_load()
                self._check_travel()

    def result(self) -> RigRun:
        """Return what was measured; to be asked when the run is finished."""
        topics = self._recorder.topics(self._programme.topics)
        watched = {GROUND_CLEARANCE: self._recorder.clearance()} if self._programme.watched else {}
        return RigRun(
            rig=self._rig.name,
            options=self._options,
            topics=topics,
            description=self._simulation.description(),
            results=self._programme.evaluate({**topics, **watched}),
            broken=tuple(tendon.name for tendon in self._simulation.tendons() if tendon.broken),
            clipped=self._clipped(topics),
        )

    def _clipped(self, topics: Mapping[str, Series]) -> tuple[str, ...]:
        """Say which sensors were at the end of their range; the IMU's filter adds its noise to it."""
        sensors, found = self._rig.sensors, []
        cell, imu = topics.get(names.LOAD_CELL.name), topics.get(names.IMU.name)
        if cell is not None and np.abs(cell.values).max() >= sensors.load_cell_limit_n:
            found.append(f"the load cell at {sensors.load_cell_limit_n:g} N")
        if imu is not None:
            limit_m_s2 = sensors.acceleration_limit_m_s2
            if np.abs(imu.values[:, :_ACCELERATIONS]).max() >= limit_m_s2 - _IMU_NOISE_M_S2:
                found.append(f"the IMU at {limit_m_s2:.2f} m/s^2 with gravity")
        return tuple(found)

    def _height_m(self) -> float:
        return self._simulation.joint_positions()[names.CARRIAGE_JOINT]

    def _check_load(self) -> None:
        """End the run where its forces mean nothing any more."""
        if self._programme.overload_advice and self._simulation.is_load_cell_overloaded():
            descent_mm = 1e3 * (self._start_m - self._height_m())
            msg = (
                f"rig '{self._rig.name}': the force passed {self._rig.sensors.load_cell_limit_n:g} N, the range of the "
                f"load cell, at a descent of {descent_mm:.1f} mm; {self._programme.overload_advice}"
            )
            raise OverloadError(msg)

    def _check_travel(self) -> None:
        """End the run where a joint went further than what it stands for can."""
        limit = self._programme.travel_limit
        if limit is None:
            return
        travel_m = self._simulation.joint_position(limit.joint)
        if travel_m > limit.largest_m:
            msg = (
                f"rig '{self._rig.name}': the {limit.what}: by {1e3 * travel_m:.1f} mm "
                f"{self._simulation.rig_time_s:.3f} s after the start, the limit is {1e3 * limit.largest_m:.1f} mm; "
                f"{limit.advice}"
            )
            raise OverloadError(msg)

    def _control(self) -> None:
        """Measure the pressures, and command pump and solenoids."""
        simulation = self._simulation
        channels, manifold = simulation.channel_pressures_pa(), simulation.manifold_pressure_pa()
        commands = self._keeper.commands(simulation.rig_time_s, channels, manifold, CONTROL_ROWS * IMU_PERIOD_S)
        self._recorder.note_pressures((manifold, *channels.values()))
        self._recorder.note_commands(commands)
        simulation.set_pump_duty(commands.pump_duty)
        for channel, energised in zip(names.CHANNELS, commands.energised, strict=True):
            simulation.set_solenoid(channel, energised)
