"""Run a rig again from what was commanded: air, then bodies, then sensors, each from the one before, without noise."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common.names import CHANNELS
from jammkle_sim.physics import kernels, records
from jammkle_sim.physics.pneumatics import vented_state
from jammkle_sim.rigs.assembly import assembled, laws_of
from jammkle_sim.rigs.simulation import UnstableSimulationError
from jammkle_sim.rigs.timeline import valve_timeline

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from jammkle_sim.rigs.rig import Event, Rig
    from jammkle_sim.rigs.timeline import Timeline


@dataclass(frozen=True)
class CommandTrack:
    """What pump and solenoids were told, since the start of the rig."""

    duty: Timeline
    """0 to 1."""
    solenoids: Mapping[str, Timeline]
    """By channel, 0 or 1; a channel that is missing stays vented."""


@dataclass(frozen=True)
class BodyTrack:
    """What bodies and tendons did, after every time step; the first row is after the first step."""

    joints: tuple[str, ...]
    tendons: tuple[str, ...]
    rows: NDArray[np.float64]
    """Shape (n, records.row_width(joints, tendons)); the IMU's columns are raw."""

    @property
    def raw_imu(self) -> NDArray[np.float64]:
        """Specific force, m/s^2, and angular velocity, rad/s, shape (n, 6)."""
        return self.rows[:, : records.IMU_AXES]

    @property
    def load_cell_n(self) -> NDArray[np.float64]:
        """Force, N, shape (n, 3)."""
        return self.rows[:, records.IMU_AXES : records.IMU_AXES + records.LOAD_CELL_AXES]

    def position(self, joint: str) -> NDArray[np.float64]:
        """Angle, rad, or slide, m, shape (n,)."""
        return self.rows[:, records.IMU_AXES + records.LOAD_CELL_AXES + self.joints.index(joint)]

    def velocity(self, joint: str) -> NDArray[np.float64]:
        """Rate of the same, shape (n,)."""
        first = records.IMU_AXES + records.LOAD_CELL_AXES + len(self.joints)
        return self.rows[:, first + self.joints.index(joint)]

    def extension_m(self, tendon: str) -> NDArray[np.float64]:
        """Length beyond the free length, shape (n,), m."""
        return self.rows[:, self._tendon(tendon)]

    def tension_n(self, tendon: str) -> NDArray[np.float64]:
        """Pull, shape (n,), N."""
        return self.rows[:, self._tendon(tendon) + 2]

    def _tendon(self, tendon: str) -> int:
        first = records.IMU_AXES + records.LOAD_CELL_AXES + 2 * len(self.joints)
        return first + records.TENDON_COLUMNS * self.tendons.index(tendon)


def timestep_s(rig: Rig) -> float:
    """Time step of a rig, s."""
    return float(rig.model.opt.timestep)


def air(
    rig: Rig, commands: CommandTrack, steps: int, start_pa: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Run the air alone.

    Args:
        rig: Whose air.
        commands: What it is told.
        steps: Time steps.
        start_pa: Absolute pressures at the start, shape (VOLUMES,), Pa; without, all are vented.

    Returns:
        Absolute pressures, Pa, shape (steps + 1, VOLUMES): at the start, then after each step.

    """
    law = laws_of(rig).pneumatics
    state = vented_state(law)
    if start_pa is not None:
        state["pressure_pa"][0] = start_pa
        state["mass_kg"] = state["pressure_pa"] * law["volume_m3"] / law["specific_energy_j_kg"][:, np.newaxis]
    duty, drawing = actuation(rig, law, commands, steps)
    pressure_pa = np.zeros((steps + 1, records.VOLUMES))
    pressure_pa[0] = state["pressure_pa"][0]
    kernels.air_history(law, state, duty, drawing, pressure_pa[1:])
    return pressure_pa


def actuation(
    rig: Rig, law: NDArray[Any], commands: CommandTrack, steps: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the pump's duty, shape (steps,), and each valve's share of drawing, shape (steps, VALVES), per step."""
    step_s, delay_s = timestep_s(rig), rig.wiring.command_delay_s
    duty = commands.duty.later(delay_s).means(step_s, steps)
    drawing = np.zeros((steps, records.VALVES))
    for i, channel in enumerate(CHANNELS):
        if channel in commands.solenoids:
            command = commands.solenoids[channel].later(delay_s)
            dead_time_s = float(law["valve_dead_time_s"][0, i])
            drawing[:, i] = valve_timeline(command, dead_time_s, step_s).means(step_s, steps)
    return duty, drawing


class Bodies:
    """Bodies and tendons of one rig, from its start on, at pressures or tensions that are given."""

    def __init__(self, rig: Rig) -> None:
        """Put the rig together, in its pose.

        Args:
            rig: What is run.

        """
        self._rig = rig
        self.parts = assembled(rig)
        """What is advanced; its data may be changed."""
        self.states = records.States(*(part.copy() for part in self.parts.start))
        """Memory of the laws, which may be changed."""
        self.raw_imu_at_start = self.parts.body.raw_imu.copy()
        """Raw sample of the IMU before the first step, shape (6,)."""
        self._step = 0

    def follow(self, pressure_pa: NDArray[np.float64]) -> BodyTrack:
        """Take one step per row of pressures, those within each step, shape (n, VOLUMES), Pa.

        Raises:
            UnstableSimulationError: the simulation blew up.

        """
        parts = self.parts
        return self._run(
            pressure_pa,
            lambda given, rows: kernels.body_history(parts.laws, self.states, parts.body, parts.probe, given, rows),
        )

    def driven(self, tension_n: NDArray[np.float64]) -> BodyTrack:
        """Take one step per row of tensions, shape (n, tendons), N, the tendons' own laws being left out.

        Raises:
            UnstableSimulationError: the simulation blew up.

        """
        parts = self.parts
        return self._run(
            tension_n,
            lambda given, rows: kernels.driven_history(parts.laws, self.states, parts.body, parts.probe, given, rows),
        )

    def jump(self, step: int) -> None:
        """Go on as if at a later step: what the rig does before it is done, but no time passes."""
        for event in self._rig.events:
            if self._step <= event.step < step:
                event.act(self.parts.data)
        self._step = step

    def _run(self, given: NDArray[np.float64], advance: Callable[[Any, Any], int]) -> BodyTrack:
        if not self.parts.body.addresses.all():
            msg = "a recording cannot be run again here: MuJoCo's library cannot be called directly"
            raise UnstableSimulationError(msg)
        rows = np.zeros((len(given), records.row_width(len(self.parts.joints), len(self._rig.tendon_names))))
        begin, end = self._step, self._step + len(given)
        due: dict[int, list[Event]] = {begin: [], end: []}
        for event in self._rig.events:
            if begin <= event.step < end:
                due.setdefault(event.step, []).append(event)
        for first, last in itertools.pairwise(sorted(due)):
            for event in due[first]:
                event.act(self.parts.data)
            part = slice(first - begin, last - begin)
            self._step = first + advance(given[part], rows[part])
            if self._step != last:
                time_s = self._step * timestep_s(self._rig)
                msg = f"simulation of rig '{self._rig.name}' became unstable {time_s:g} s after its start"
                raise UnstableSimulationError(msg)
        return BodyTrack(self.parts.joints, self._rig.tendon_names, rows)
