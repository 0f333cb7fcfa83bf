"""A rig in simulated time: commands in, physics forward, sensors out. The sim node and headless runs use only this."""

from __future__ import annotations

import dataclasses
import functools
import operator
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common.names import CARRIAGE_JOINT, CHANNELS
from jammkle_sim.physics import kernels, records
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.physics.sensors import Noise
from jammkle_sim.rigs.assembly import assembled, pose
from jammkle_sim.rigs.base import base_sample
from jammkle_sim.rigs.options import changed_text
from jammkle_sim.rigs.readout import channel_index, check_duty, imu_sample, tendon_samples
from jammkle_sim.rigs.rig import GROUND

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from jammkle_sim.rigs.base import BaseSample
    from jammkle_sim.rigs.readout import ImuSample, TendonSample
    from jammkle_sim.rigs.rig import Rig


_FAR_M = 1.0
"""Clearances beyond it read as this."""


class UnstableSimulationError(RuntimeError):
    """The simulation blew up. The message names what was simulated and when."""


class OverloadError(UnstableSimulationError):
    """Something grew past what the rig can measure or a part can bear. The message names value, limit, way out."""


class Simulation:
    """A rig, its tendons, its air and its sensors, advanced together."""

    def __init__(self, rig: Rig) -> None:
        """Start the rig: vented, pump off, at the pose of its model.

        Args:
            rig: What is simulated.

        """
        self._total_steps = 0
        self._put_together(rig)

    def _put_together(self, rig: Rig) -> None:
        """Take a rig, at its start."""
        self._rig = rig
        self._model = rig.model
        self.timestep_s = float(self._model.opt.timestep)
        """Time step, s."""
        assembly = assembled(rig)
        self._data, self._laws = assembly.data, assembly.laws
        self._body, self._probe = assembly.body, assembly.probe
        self._load_cell = assembly.probe.load_cell_n
        self._joints = {name: self._data.joint(name) for name in assembly.joints}
        self._noise = Noise(rig.sensors)
        self._start = assembly.start
        self._states = records.States(*(part.copy() for part in self._start))
        self._offset_pa = np.array(rig.wiring.pressure_offset_pa)
        self._waiting: list[tuple[int, Callable[[], None]]] = []
        self._rig_steps = 0

    @property
    def model(self) -> Any:
        """The mujoco.MjModel that is simulated, to look at."""
        return self._model

    @property
    def rig(self) -> Rig:
        """What is simulated."""
        return self._rig

    @property
    def time_s(self) -> float:
        """Simulated time since construction, s: a whole number of time steps, never set back."""
        return self._total_steps * self.timestep_s

    def set_pump_duty(self, duty: float) -> None:
        """Set the pump's duty, 0 to 1.

        Raises:
            ValueError: out of range or not a number.

        """
        check_duty(duty)
        self._obey("duty", (0,), duty)

    def set_solenoid(self, channel: str, energised: bool) -> None:  # noqa: FBT001  # the state of a coil, as Bool is
        """Energise or release a channel's solenoid.

        Raises:
            ValueError: there is no such channel.

        """
        self._obey("command", (0, channel_index(channel)), float(energised))

    def advance(self, steps: int) -> None:
        """Take `steps` time steps.

        Raises:
            ValueError: a negative number of steps.
            UnstableSimulationError: the state grew beyond all bounds; only a reset helps.

        """
        if steps < 0:
            msg = f"steps is {steps}; it must be 0 or more"
            raise ValueError(msg)
        end = self._rig_steps + steps
        for step, act in self._due_before(end):
            self._run(step - self._rig_steps)
            act()
        self._run(end - self._rig_steps)

    def reset(self) -> None:
        """Start the rig again, with the same noise; the time goes on."""
        pose(self._model, self._data)
        for part, start in zip(self._states, self._start, strict=True):
            part[:] = start
        self._noise.reset()
        self._rig_steps = 0
        self._waiting.clear()

    def exchange(self, rig: Rig) -> None:
        """Go on with another rig, at its start, commanded to nothing; the time goes on.

        Args:
            rig: With the same time step.

        Raises:
            ValueError: another time step, in which the time so far would be something else.

        """
        step_s = float(rig.model.opt.timestep)
        if step_s != self.timestep_s:
            msg = f"time step is {step_s:g} s; it must be that of the rig before, {self.timestep_s:g} s"
            raise ValueError(msg)
        self._put_together(rig)

    def record(self, rows: int, steps_per_row: int) -> NDArray[np.float64]:
        """Advance by `rows * steps_per_row` steps and write a row after every `steps_per_row`.

        Returns:
            Shape (rows, width), without the noise of the load cell; columns as `jammkle_sim.physics.records.row_width`
            tells, joints in the order of `joint_positions`.

        Raises:
            UnstableSimulationError: as `advance`.

        """
        written = np.zeros((rows, records.row_width(len(self._joints), len(self._rig.tendon_names))))
        done = 0
        while done < rows:
            left = self._rows_without_event(rows - done, steps_per_row)
            if left == 0 or not self._body.addresses.all():
                left = 1
                self.advance(steps_per_row)
                kernels.record_row(self._states, self._probe, written[done])
            else:
                white, part = self._noise.imu_white(left * steps_per_row), written[done : done + left]
                taken = kernels.advance_and_record(self._laws, self._states, self._body, self._probe, white, part)
                self._count(taken, len(white))
            done += left
        return written

    def imu(self) -> ImuSample:
        """Latest output of the IMU, noise, range and filter included."""
        return imu_sample(self._states)

    def channel_pressures_pa(self) -> dict[str, float]:
        """Absolute pressure per channel, Pa, as the sensors give it."""
        return dict(zip(CHANNELS, self._measured_pressures_pa()[1:], strict=True))

    def manifold_pressure_pa(self) -> float:
        """Absolute pressure in the manifold, Pa, as the sensor gives it."""
        return self._measured_pressures_pa()[0]

    def joint_positions(self) -> dict[str, float]:
        """Angles of the ankle, rad, if it has any, and position of the carriage, m."""
        return {name: float(joint.qpos[0]) for name, joint in self._joints.items()}

    def joint_velocities(self) -> dict[str, float]:
        """Rates of the same, rad/s and m/s."""
        return {name: float(joint.qvel[0]) for name, joint in self._joints.items()}

    def tendons(self) -> tuple[TendonSample, ...]:
        """Every tendon, in the order of the rig: TENDONS, where it has a whole ankle."""
        return tendon_samples(self._rig.tendon_names, self._states)

    def base(self) -> BaseSample:
        """Where the carriage is, on which the ankle's mount is fixed: the truth."""
        return base_sample(self._model, self._data, int(self._model.jnt_bodyid[self._model.joint(CARRIAGE_JOINT).id]))

    def joint_position(self, name: str) -> float:
        """Position of any joint with one degree of freedom, rad or m.

        Raises:
            KeyError: there is no such joint.

        """
        return float(self._data.joint(name).qpos[0])

    def ground_clearance_m(self, geom: str) -> float:
        """How far a geom's surface is off the ground, m, at the start of the latest step; negative: within it.

        Raises:
            KeyError: there is no such geom, or the rig has no ground.

        """
        ground, part = self._model.geom(GROUND).id, self._model.geom(geom).id
        return float(mujoco.mj_geomDistance(self._model, self._data, ground, part, _FAR_M, None))

    def load_cell_force_n(self) -> tuple[float, float, float]:
        """Force between rig and leg, N, as the cell gives it, clipped at its range: tension on z is positive."""
        limit_n = self._rig.sensors.load_cell_limit_n
        force_n = self._noise.load_cell_n(self._rig_steps)
        force_n[-len(self._load_cell) :] += self._rig.wiring.load_cell_gain * self._load_cell
        np.clip(force_n, -limit_n, limit_n, out=force_n)
        return (float(force_n[0]), float(force_n[1]), float(force_n[2]))

    def is_load_cell_overloaded(self) -> bool:
        """Whether the true force is beyond the range of the load cell on some axis."""
        return bool(np.abs(self._load_cell).max() > self._rig.sensors.load_cell_limit_n)

    def description(self) -> dict[str, object]:
        """Name of the rig and all its parameters, ready for YAML."""
        parts = {"options": self._rig.options, **self._rig.parts}
        plain = {name: dataclasses.asdict(part) for name, part in parts.items()}
        effects = {"effects": dict(self._rig.effects)} if self._rig.effects else {}
        return {"rig": self._rig.name, "timestep_s": self.timestep_s, **plain, **effects}

    @property
    def rig_time_s(self) -> float:
        """Simulated time since the latest start of the rig, s."""
        return self._rig_steps * self.timestep_s

    def _rows_without_event(self, rows: int, steps_per_row: int) -> int:
        """How many of the next rows can be taken before the rig does something."""
        coming = [event.step for event in self._rig.events if event.step >= self._rig_steps]
        coming += [step for step, _ in self._waiting]
        return min(rows, (min(coming) - self._rig_steps) // steps_per_row) if coming else rows

    def _measured_pressures_pa(self) -> list[float]:
        measured: list[float] = (
            self._states.pneumatics["pressure_pa"][0] + self._noise.pressure_pa(self._rig_steps) + self._offset_pa
        ).tolist()
        return measured

    def _obey(self, field: str, at: tuple[int, ...], value: float) -> None:
        """Tell the air something, after the wiring's delay, to the nearest step."""
        wait = round(self._rig.wiring.command_delay_s / self.timestep_s)
        if wait == 0:
            self._states.pneumatics[field][at] = value
        else:
            tell = functools.partial(operator.setitem, self._states.pneumatics[field], at, value)
            self._waiting.append((self._rig_steps + wait, tell))

    def _due_before(self, end: int) -> Iterator[tuple[int, Callable[[], None]]]:
        """Give what the rig does and what arrives before a step, in order; what arrives is no longer waited for."""
        due: list[tuple[int, Callable[[], None]]] = [
            (event.step, functools.partial(event.act, self._data))
            for event in self._rig.events
            if self._rig_steps <= event.step < end
        ]
        due += [(step, tell) for step, tell in self._waiting if step < end]
        self._waiting = [(step, tell) for step, tell in self._waiting if step >= end]
        yield from sorted(due, key=operator.itemgetter(0))

    def _run(self, steps: int) -> None:
        if steps == 0:
            return
        white = self._noise.imu_white(steps)
        if self._body.addresses.all():
            taken = kernels.advance_ankle(self._laws, self._states, self._body, white)
        else:
            taken = self._advance_from_python(white)
        self._count(taken, steps)

    def _count(self, taken: int, wanted: int) -> None:
        self._total_steps += taken
        self._rig_steps += taken
        if taken != wanted:
            raise UnstableSimulationError(self._unstable_text())

    def _advance_from_python(self, white: NDArray[np.float64]) -> int:
        """Do what `kernels.advance_ankle` does, more slowly, where MuJoCo's library cannot be called directly."""
        for step, row in enumerate(white):
            if not kernels.is_stable(self._body.speed):
                return step
            mujoco.mj_step1(self._model, self._data)
            kernels.act(self._laws, self._states, self._body)
            mujoco.mj_step2(self._model, self._data)
            kernels.filter_imu(self._laws.imu[0], self._states.imu[0], self._body.raw_imu, row)
        return len(white) if kernels.is_stable(self._body.speed) else len(white) - 1

    def _unstable_text(self) -> str:
        speed = float(np.abs(self._body.speed).max())
        return (
            f"simulation of rig '{self._rig.name}' (options: {changed_text(self._rig.options)}) became unstable "
            f"{self.rig_time_s:g} s after its start: a joint moves at {speed:g} rad/s or m/s, the limit is "
            f"{kernels.LARGEST_SPEED:g}; try a smaller timestep_s or milder options"
        )
