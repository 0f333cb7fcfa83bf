"""A machine on jamming ankles in simulated time: commands in, physics forward, sensors and truth out. No ROS.

    simulation = robot_simulation("leg", RobotOptions(behaviour="walk", imu="body"))
    for sample in simulation.samples(duration_s=5.0, rate_hz=500):
        ankle = sample.ankles["ankle"]
        ankle.imu.specific_force_m_s2, ankle.positions["ankle_pitch"], ankle.channel_pressures_pa["achilles"]
        ankle.foot.stands, ankle.foot.sliding_speed_m_s, ankle.foot.sliding_distance_m   # the truth
        simulation.ankles["ankle"].hold_vacuum({"achilles": 50e3})                       # a regulator like the driver's
        simulation.ankles["ankle"].set_solenoid("achilles", True)                        # or valves and pump by hand

A rig and a leg have one ankle, `ankle`; a quadruped `lf_ankle`, `rf_ankle`, `lh_ankle`, `rh_ankle`. What is commanded
between two samples acts from the next step on. The same machine, commands and seed give the same samples, bit by bit.
"""

from __future__ import annotations

import functools
import math
import operator
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common.names import CHANNELS
from jammkle_sim.physics import kernels, records
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.physics.sensors import Noise
from jammkle_sim.rigs.options import changed_text
from jammkle_sim.rigs.rig import GROUND, assembled_ankle, new_data
from jammkle_sim.rigs.vacuum import VacuumRegulator

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from numpy.typing import NDArray

    from jammkle_sim.rigs.rig import AnkleInModel, FootPlan, Machine

CONTROL_PERIOD_S = 0.002
"""How often a robot's joints get new targets: 500 Hz, as legged robots of this size do."""
REGULATION_PERIOD_S = 0.01
"""How often vacuum is regulated where a set point is held, as the driver does."""
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
"""All that a simulation goes on from."""
_FAR_M = 1.0
"""Clearances beyond it read as this."""


class UnstableSimulationError(RuntimeError):
    """The simulation blew up. The message names what was simulated and when."""


class OverloadError(UnstableSimulationError):
    """Something grew past what the rig can measure or a part can bear. The message names value, limit, way out."""


@dataclass(frozen=True)
class ImuSample:
    """What the IMU gives now, in its own frame."""

    specific_force_m_s2: tuple[float, float, float]
    """Acceleration less gravity: +g along z at rest."""
    angular_velocity_rad_s: tuple[float, float, float]


@dataclass(frozen=True)
class TendonSample:
    """One tendon, without noise."""

    name: str
    extension_m: float
    """Beyond the free length; negative when slack."""
    extension_rate_m_s: float
    tension_n: float
    broken: bool


@dataclass(frozen=True)
class FootTruth:
    """What the foot truly does on the ground. No robot can measure it."""

    stands: bool
    """Whether it presses on the ground with more than its own weight."""
    normal_force_n: float
    """Sum over its contacts."""
    sliding_speed_m_s: float
    """Tangential speed of its contacts on the ground, each by its share of the force; 0 where it does not stand."""
    sliding_distance_m: float
    """Way that it has slid since the start, whichever way and however often."""


@dataclass(frozen=True)
class BaseSample:
    """Pose and velocity of the body that carries a machine, at the start of the latest time step. Truth."""

    position_m: tuple[float, float, float]
    """Of its origin, in the world: z up, x where the toes point."""
    rotation: tuple[float, float, float, float]
    """From the base's frame to the world's, as a quaternion (w, x, y, z)."""
    linear_m_s: tuple[float, float, float]
    """Velocity of its origin, in its own frame."""
    angular_rad_s: tuple[float, float, float]
    """Angular velocity, in its own frame."""


@dataclass(frozen=True)
class AnkleSample:
    """All of one ankle at one time."""

    imu: ImuSample
    positions: Mapping[str, float]
    """Angles of the ankle, rad, and of the joints around it, rad or m."""
    velocities: Mapping[str, float]
    """Rates of the same."""
    efforts: Mapping[str, float]
    """Efforts of their servos, N m or N; 0 where there is none."""
    channel_pressures_pa: Mapping[str, float]
    """Absolute, Pa, as the sensors give them."""
    manifold_pressure_pa: float
    tendons: tuple[TendonSample, ...]
    foot: FootTruth
    plan: FootPlan | None
    """What the gait plans of this foot; None: there is no gait."""


@dataclass(frozen=True)
class Sample:
    """All of a machine at one time."""

    time_s: float
    """Since its start."""
    ankles: Mapping[str, AnkleSample]
    """By name."""
    base_position_m: tuple[float, float, float]
    """Of the base, in the world. Truth."""
    base_tilt_rad: float
    """Angle between the base's z axis and straight up. Truth."""
    base_velocity_m_s: tuple[float, float, float]
    """Of the base, in the world. Truth."""
    base: BaseSample
    """All of the body that carries the machine. Truth."""


class Ankle:
    """One ankle of a simulation: commands in, sensors and truth out."""

    def __init__(
        self, simulation: Simulation, ankle: AnkleInModel, parts: records.Ankle, load_cell_n: NDArray[np.float64]
    ) -> None:
        """Look at an ankle.

        Args:
            simulation: Takes it forward.
            ankle: Which.
            parts: Its constants and memory.
            load_cell_n: Where its load cell reads the true force; of shape (0,) without one.

        """
        self._simulation = simulation
        self._ankle = ankle
        self._parts = parts
        self._load_cell_n = load_cell_n
        self._noise = Noise(ankle.sensors)
        self._regulator: VacuumRegulator | None = None
        self._wanted_pa = dict.fromkeys(CHANNELS, 0.0)
        self._offset_pa = np.array(ankle.wiring.pressure_offset_pa)
        self._joints = {name: simulation.data.joint(joint) for name, joint in ankle.joints.items()}

    def set_pump_duty(self, duty: float) -> None:
        """Set the pump's duty, 0 to 1, and end any set point.

        Raises:
            ValueError: out of range or not a number.

        """
        if not 0.0 <= duty <= 1.0:
            msg = f"pump duty is {duty}; it must be 0 to 1"
            raise ValueError(msg)
        self._regulator = None
        self._command("duty", (0,), duty)

    def set_solenoid(self, channel: str, energised: bool) -> None:  # noqa: FBT001  # the state of a coil, as Bool is
        """Energise or release a channel's solenoid, and end any set point.

        Raises:
            ValueError: there is no such channel.

        """
        index = _channel_index(channel)
        self._regulator = None
        self._command("command", (0, index), float(energised))

    def hold_vacuum(self, vacuum_pa: Mapping[str, float]) -> None:
        """Let a regulator like the driver's hold these channels at a vacuum from now on.

        The others keep their set point; where none has been given since pump or solenoids were set by hand they vent.

        Args:
            vacuum_pa: By channel, Pa below ambient; 0 vents.

        Raises:
            ValueError: there is no such channel, or a vacuum is negative or not finite.

        """
        for channel, value_pa in vacuum_pa.items():
            _channel_index(channel)
            if not 0.0 <= value_pa < math.inf:
                msg = f"vacuum of {channel} is {value_pa} Pa; it must be 0 or more"
                raise ValueError(msg)
        if self._regulator is None:
            self._wanted_pa = dict.fromkeys(CHANNELS, 0.0)
            self._regulator = VacuumRegulator(float(self._parts.laws.pneumatics["ambient_pa"][0]))
        self._wanted_pa.update(vacuum_pa)

    @property
    def is_regulated(self) -> bool:
        """Whether a vacuum is held."""
        return self._regulator is not None

    def regulate(self, elapsed_s: float) -> None:
        """Command pump and solenoids for the set points, if there are any."""
        if self._regulator is None:
            return
        manifold_pa, *channels_pa = self._pressures_pa()
        measured_pa = dict(zip(CHANNELS, channels_pa, strict=True))
        commands = self._regulator.commands(self._wanted_pa, measured_pa, manifold_pa, elapsed_s)
        self._parts.states.pneumatics["duty"][0] = commands.pump_duty
        self._parts.states.pneumatics["command"][0] = commands.energised

    @property
    def pump_duty(self) -> float:
        """What the pump is commanded to, 0 to 1."""
        return float(self._parts.states.pneumatics["duty"][0])

    @property
    def energised(self) -> tuple[bool, ...]:
        """What the solenoids are commanded to, in the order of CHANNELS."""
        return tuple(bool(command > 0.0) for command in self._parts.states.pneumatics["command"][0])

    def imu(self) -> ImuSample:
        """Latest output of the IMU, noise, range and filter included."""
        x, y, z, roll, pitch, yaw = self._parts.states.imu["second"][0].tolist()
        return ImuSample((x, y, z), (roll, pitch, yaw))

    def channel_pressures_pa(self) -> dict[str, float]:
        """Absolute pressure per channel, Pa, as the sensors give it."""
        return dict(zip(CHANNELS, self._pressures_pa()[1:], strict=True))

    def manifold_pressure_pa(self) -> float:
        """Absolute pressure in the manifold, Pa, as the sensor gives it."""
        return self._pressures_pa()[0]

    def joint_positions(self) -> dict[str, float]:
        """Angles of the ankle, rad, if it has any, and positions of the joints around it, rad or m."""
        return {name: float(joint.qpos[0]) for name, joint in self._joints.items()}

    def joint_velocities(self) -> dict[str, float]:
        """Rates of the same, rad/s and m/s."""
        return {name: float(joint.qvel[0]) for name, joint in self._joints.items()}

    def joint_efforts(self) -> dict[str, float] | None:
        """Efforts of the same, N m and N, in the mean since the latest targets, 0 without a servo; None: of a rig."""
        servos = self._simulation.servos
        return None if servos is None else {name: servos.effort(joint.name) for name, joint in self._joints.items()}

    def tendons(self) -> tuple[TendonSample, ...]:
        """Every tendon, in the order of TENDONS, where there is a whole ankle."""
        return tuple(
            TendonSample(
                name,
                float(state["extension_m"]),
                float(state["rate_m_s"]),
                float(state["tension_n"]),
                bool(state["broken"] > 0.0),
            )
            for name, state in zip(self._ankle.tendons, self._parts.states.tendons, strict=True)
        )

    def load_cell_force_n(self) -> tuple[float, float, float]:
        """Force between rig and leg, N, as the cell gives it, clipped at its range: tension on z is positive."""
        cell, limit_n = self._load_cell_n, self._ankle.sensors.load_cell_limit_n
        force_n = self._noise.load_cell_n(self._simulation.steps)
        force_n[-len(cell) :] += self._ankle.wiring.load_cell_gain * cell
        np.clip(force_n, -limit_n, limit_n, out=force_n)
        return (float(force_n[0]), float(force_n[1]), float(force_n[2]))

    def is_load_cell_overloaded(self) -> bool:
        """Whether the true force is beyond the range of the load cell on some axis."""
        return bool(np.abs(self._load_cell_n).max() > self._ankle.sensors.load_cell_limit_n)

    def foot(self) -> FootTruth:
        """What the foot truly does on the ground; nothing, where no contacts are looked at."""
        truth = self._parts.truth[0]
        normal_n = float(truth["normal_force_n"])
        return FootTruth(
            bool(normal_n > truth["bearing_n"]),
            normal_n,
            float(truth["sliding_speed_m_s"]),
            float(truth["sliding_distance_m"]),
        )

    def plan(self) -> FootPlan | None:
        """What the gait plans of the foot now; None: there is no gait."""
        control = self._simulation.machine.control
        return None if control is None else control.plan(self._ankle.name, self._simulation.elapsed_s)

    def sample(self) -> AnkleSample:
        """Return all of it."""
        pressures_pa = self._pressures_pa()
        return AnkleSample(
            imu=self.imu(),
            positions=self.joint_positions(),
            velocities=self.joint_velocities(),
            efforts=self.joint_efforts() or {},
            channel_pressures_pa=dict(zip(CHANNELS, pressures_pa[1:], strict=True)),
            manifold_pressure_pa=pressures_pa[0],
            tendons=self.tendons(),
            foot=self.foot(),
            plan=self.plan(),
        )

    def imu_white(self, steps: int) -> NDArray[np.float64]:
        """Next standard normal numbers of the IMU, shape (steps, 6)."""
        return self._noise.imu_white(steps)

    def restart(self) -> None:
        """Forget set points, and start the noise again."""
        self._regulator = None
        self._wanted_pa = dict.fromkeys(CHANNELS, 0.0)
        self._noise.reset()

    def _pressures_pa(self) -> list[float]:
        true_pa, error_pa = (
            self._parts.states.pneumatics["pressure_pa"][0],
            self._noise.pressure_pa(self._simulation.steps),
        )
        measured: list[float] = (true_pa + error_pa + self._offset_pa).tolist()
        return measured

    def _command(self, field: str, at: tuple[int, ...], value: float) -> None:
        """Command pump or valve, after the wiring's delay, to the nearest step."""
        wait = round(self._ankle.wiring.command_delay_s / self._simulation.timestep_s)
        arrive = functools.partial(operator.setitem, self._parts.states.pneumatics[field], at, value)
        self._simulation.after(wait, arrive)


class Simulation:
    """A machine, its ankles' tendons, air and sensors, advanced together."""

    def __init__(self, machine: Machine) -> None:
        """Start the machine: every ankle vented, its pump off, in the pose of its model.

        Args:
            machine: What is simulated.

        """
        self._total_steps = 0
        self._put_together(machine)

    def _put_together(self, machine: Machine) -> None:
        """Take a machine, at its start."""
        self.machine = machine
        """What is simulated."""
        self.model = machine.model
        """The mujoco.MjModel, to look at."""
        self.timestep_s = float(self.model.opt.timestep)
        """Time step, s."""
        self.data = new_data(self.model)
        """The mujoco.MjData. Its `ctrl` is the user's where a robot has no control of its own."""
        self.servos = None if machine.control is None else Servos(self.model, self.data)
        """What the servos give; None: there are none."""
        self.steps = 0
        """Time steps since the latest start."""
        self._friction = self.model.geom_friction.copy()
        self._waiting: list[tuple[int, Callable[[], None]]] = []
        self._control_steps = max(1, round(CONTROL_PERIOD_S / self.timestep_s))
        self._regulation_steps = max(1, round(REGULATION_PERIOD_S / self.timestep_s))
        self._pose()
        in_model = machine.in_model()
        assembled = [assembled_ankle(self.model, self.data, ankle) for ankle in in_model]
        self._parts = tuple(parts for parts, _ in assembled)
        self._probes = tuple(probe for _, probe in assembled)
        self._start = tuple(tuple(part.copy() for part in (*parts.states, parts.truth)) for parts in self._parts)
        # A guided ankle starts as if it had hung for long, which is found as it is assembled.
        self._hanging = np.zeros(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, self.data, self._hanging, _STATE)
        self.ankles = {
            ankle.name: Ankle(self, ankle, parts, probe.load_cell_n)
            for ankle, (parts, probe) in zip(in_model, assembled, strict=True)
        }
        """Every ankle, by name: to command, and to look at."""
        self._base = self.data.body(machine.base)

    @property
    def ankle(self) -> Ankle:
        """The only ankle of a rig or a leg; of several the first."""
        return next(iter(self.ankles.values()))

    @property
    def time_s(self) -> float:
        """Simulated time since construction, s: a whole number of time steps, never set back."""
        return self._total_steps * self.timestep_s

    @property
    def elapsed_s(self) -> float:
        """Simulated time since the latest start of the machine, s."""
        return self.steps * self.timestep_s

    def advance(self, steps: int) -> None:
        """Take `steps` time steps; the result does not depend on the portions.

        Raises:
            ValueError: a negative number of steps.
            UnstableSimulationError: the state grew beyond all bounds; only a reset helps.

        """
        if steps < 0:
            msg = f"steps is {steps}; it must be 0 or more"
            raise ValueError(msg)
        end = self.steps + steps
        while self.steps < end:
            self._act()
            self._run(min(self._next_due(self.steps + 1), end) - self.steps)

    def record(self, rows: int, steps_per_row: int) -> dict[str, NDArray[np.float64]]:
        """Advance by `rows * steps_per_row` steps and write a row of every ankle after every `steps_per_row`.

        Returns:
            By ankle, shape (rows, width), without the noise of the load cell; columns as
            `jammkle_sim.physics.records.row_width` has them, joints in the order of `joint_positions`.

        Raises:
            UnstableSimulationError: as `advance`.

        """
        widths = [
            records.row_width(len(probe.position_index), len(parts.states.tendons))
            for parts, probe in zip(self._parts, self._probes, strict=True)
        ]
        written = np.zeros((len(widths), rows, max(widths)))
        done = 0
        while done < rows:
            free = min(rows - done, (self._next_due(self.steps) - self.steps) // steps_per_row)
            part = written[:, done : done + max(free, 1)]
            if free == 0 or not self._parts[0].body.addresses.all():
                self.advance(steps_per_row)
                for parts, probe, row in zip(self._parts, self._probes, part[:, 0], strict=True):
                    kernels.record_row(parts.states, probe, row)
            else:
                white = self._white(free * steps_per_row)
                self._count(kernels.advance_and_record(self._parts, self._probes, white, part), white.shape[1])
            done += part.shape[1]
        return {name: rows_of[:, :width] for name, rows_of, width in zip(self.ankles, written, widths, strict=True)}

    def samples(self, duration_s: float, rate_hz: int) -> Iterator[Sample]:
        """Go on for a time, and give a sample at a rate; commands given between two act from there on.

        Args:
            duration_s: How long, simulated, s.
            rate_hz: Samples per second; must divide the step rate.

        Raises:
            ValueError: the rate does not divide the step rate.
            UnstableSimulationError: as `advance`.

        """
        steps = self.steps_per(rate_hz)
        for _ in range(round(duration_s * rate_hz)):
            self.advance(steps)
            yield self.sample()

    def steps_per(self, rate_hz: int) -> int:
        """Return the steps between two samples at a rate.

        Raises:
            ValueError: the rate does not divide the step rate.

        """
        steps = 1.0 / (rate_hz * self.timestep_s)
        if steps < 1 or abs(steps - round(steps)) > 1e-9 * steps:
            msg = f"a rate of {rate_hz} Hz does not fit a time step of {self.timestep_s:g} s"
            raise ValueError(msg)
        return round(steps)

    def sample(self) -> Sample:
        """Return all of the machine now."""
        x, y, z = self._base.xpos.tolist()
        velocity = self._velocity(self._base.id, in_own_frame=False)
        return Sample(
            self.elapsed_s,
            {name: ankle.sample() for name, ankle in self.ankles.items()},
            (x, y, z),
            float(np.arccos(np.clip(float(self._base.xmat[8]), -1.0, 1.0))),
            (velocity[3], velocity[4], velocity[5]),
            self.base(),
        )

    def base(self) -> BaseSample:
        """Where the body that carries the machine is, and how it moves: the truth."""
        root = int(self.model.body_rootid[self._base.id])
        roll, pitch, yaw, forward, left, up = self._velocity(root, in_own_frame=True)
        x, y, z = self.data.xpos[root].tolist()
        qw, qx, qy, qz = self.data.xquat[root].tolist()
        return BaseSample((x, y, z), (qw, qx, qy, qz), (forward, left, up), (roll, pitch, yaw))

    def joint_position(self, name: str) -> float:
        """Position of any joint of the model with one degree of freedom, rad or m.

        Raises:
            KeyError: there is no such joint.

        """
        return float(self.data.joint(name).qpos[0])

    def ground_clearance_m(self, geom: str) -> float:
        """How far a geom's surface is off the ground, m, at the start of the latest step; negative: within it.

        Raises:
            KeyError: there is no such geom, or no ground.

        """
        ground, part = self.model.geom(GROUND).id, self.model.geom(geom).id
        return float(mujoco.mj_geomDistance(self.model, self.data, ground, part, _FAR_M, None))

    def reset(self) -> None:
        """Start the machine again, with the same noise; the time goes on."""
        self._pose()
        if any(len(parts.body.guide) for parts in self._parts):
            mujoco.mj_setState(self.model, self.data, self._hanging, _STATE)
            mujoco.mj_forward(self.model, self.data)
        for parts, start in zip(self._parts, self._start, strict=True):
            for part, first in zip((*parts.states, parts.truth), start, strict=True):
                part[:] = first
            parts.body.guide_at[:] = 0
        for ankle in self.ankles.values():
            ankle.restart()
        self.steps = 0
        self._waiting.clear()

    def exchange(self, machine: Machine) -> None:
        """Go on with another machine, at its start, commanded to nothing; the time goes on.

        Args:
            machine: With the same time step.

        Raises:
            ValueError: another time step, in which the time so far would be something else.

        """
        step_s = float(machine.model.opt.timestep)
        if step_s != self.timestep_s:
            msg = f"time step is {step_s:g} s; it must be that of what was simulated before, {self.timestep_s:g} s"
            raise ValueError(msg)
        self._put_together(machine)

    def after(self, steps: int, act: Callable[[], None]) -> None:
        """Do something after so many steps; at once after none."""
        if steps == 0:
            act()
        else:
            self._waiting.append((self.steps + steps, act))

    def _pose(self) -> None:
        model, data = self.model, self.data
        model.geom_friction[:] = self._friction
        mujoco.mj_resetData(model, data)
        if model.nkey:
            mujoco.mj_resetDataKeyframe(model, data, 0)
        if self.machine.control is not None:
            self.machine.control.command(0.0, data)
        mujoco.mj_forward(model, data)
        if self.servos is not None:
            self.servos.retarget()

    def _act(self) -> None:
        """Do what is due at this step: events, delayed commands, targets of the joints, vacuum."""
        for event in self.machine.events:
            if event.step == self.steps:
                event.act(self.data)
        if self._waiting:
            for _, act in [each for each in self._waiting if each[0] == self.steps]:
                act()
            self._waiting = [each for each in self._waiting if each[0] > self.steps]
        if self.servos is not None and self.machine.control is not None and self.steps % self._control_steps == 0:
            self.machine.control.command(self.elapsed_s, self.data)
            self.servos.retarget()
        if self.steps % self._regulation_steps == 0:
            for ankle in self.ankles.values():
                ankle.regulate(REGULATION_PERIOD_S)

    def _next_due(self, step: int) -> int:
        """Return the first step, from this one on, at which something is due."""
        due = sys.maxsize if self.servos is None else -(-step // self._control_steps) * self._control_steps
        if any(ankle.is_regulated for ankle in self.ankles.values()):
            due = min(due, -(-step // self._regulation_steps) * self._regulation_steps)
        for event in self.machine.events:
            if step <= event.step < due:
                due = event.step
        for at, _ in self._waiting:
            if step <= at < due:
                due = at
        return due

    def _run(self, steps: int) -> None:
        white = self._white(steps)
        if self._parts[0].body.addresses.all():
            taken = kernels.advance(self._parts, white, 0, steps)
        else:
            taken = self._advance_from_python(white)
        self._count(taken, steps)

    def _white(self, steps: int) -> NDArray[np.float64]:
        """Return standard normal numbers of all IMUs, shape (ankles, steps, 6)."""
        first, *others = self.ankles.values()
        white = first.imu_white(steps)
        if not others:
            return white[np.newaxis]
        # one IMU for all: the same noise
        return np.stack([white, *(white if self.machine.one_imu else each.imu_white(steps) for each in others)])

    def _count(self, taken: int, wanted: int) -> None:
        self._total_steps += taken
        self.steps += taken
        if taken != wanted:
            raise UnstableSimulationError(self._unstable_text())

    def _advance_from_python(self, white: NDArray[np.float64]) -> int:
        """Do what `kernels.advance` does, more slowly, where MuJoCo's library cannot be called directly."""
        for step in range(white.shape[1]):
            if not kernels.is_stable(self.data.qvel):
                return step
            for parts in self._parts:
                kernels.guide(parts.body)
            mujoco.mj_step1(self.model, self.data)
            for parts in self._parts:
                kernels.act(parts.laws, parts.states, parts.body)
            mujoco.mj_step2(self.model, self.data)
            for parts, row in zip(self._parts, white[:, step], strict=True):
                kernels.filter_imu(parts.laws.imu[0], parts.states.imu[0], parts.body.raw_imu, row)
                kernels.watch_foot(parts.contacts, parts.truth[0])
        steps: int = white.shape[1]
        return steps if kernels.is_stable(self.data.qvel) else steps - 1

    def _velocity(self, body: int, *, in_own_frame: bool) -> list[float]:
        velocity = np.zeros(6)
        kind = mujoco.mjtObj.mjOBJ_XBODY
        mujoco.mj_objectVelocity(self.model, self.data, kind, body, velocity, int(in_own_frame))
        found: list[float] = velocity.tolist()
        return found

    def _unstable_text(self) -> str:
        machine, speed = self.machine, float(np.abs(self.data.qvel).max())
        options = "" if machine.options is None else f" (options: {changed_text(machine.options)})"
        return (
            f"simulation of {'rig' if self.servos is None else 'robot'} '{machine.name}'{options} became unstable "
            f"{self.elapsed_s:g} s after its start: a joint moves at {speed:g} rad/s or m/s, the limit is "
            f"{kernels.LARGEST_SPEED:g}; try a smaller timestep_s or milder options"
        )


class Servos:
    """Efforts of a robot's joints, as drives report them.

    Targets come in steps, and so do the efforts; a drive reports its current low-passed. Of a spring and a damper
    toward a target that holds, the mean effort since then is that at the mean place and at the way made by the time.
    The places that count are those at which steps began, half a step before the mean of the way.
    """

    def __init__(self, model: Any, data: Any) -> None:
        """Look at the servos of a model: actuators that act on one hinge or slide, with a fixed gain."""
        self._data, self._half_step_s = data, 0.5 * float(model.opt.timestep)
        on_joint = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)
        steady = model.actuator_gaintype == int(mujoco.mjtGain.mjGAIN_FIXED)
        self._at = np.flatnonzero(on_joint & steady)
        joints = model.actuator_trnid[self._at, 0]
        self._joints = {model.joint(int(joint)).name: i for i, joint in enumerate(joints)}
        self._places = model.jnt_qposadr[joints]
        self._gear = model.actuator_gear[self._at, 0]
        self._gain = model.actuator_gainprm[self._at, 0]
        self._bias = model.actuator_biasprm[self._at, :3].T
        limited = model.actuator_forcelimited[self._at].astype(bool)
        self._limit = np.where(limited[:, None], model.actuator_forcerange[self._at], (-np.inf, np.inf)).T
        self.retarget()

    def retarget(self) -> None:
        """Note where the joints are as new targets come."""
        self._first = self._gear * self._data.qpos[self._places]
        self._first_s = float(self._data.time)

    def effort(self, joint: str) -> float:
        """Return the effort on a joint, N m or N, in the mean since the latest targets; 0 where it has no servo."""
        i = self._joints.get(joint)
        elapsed_s = float(self._data.time) - self._first_s
        if i is None or elapsed_s <= 0.0:
            return 0.0 if i is None else float(self._gear[i] * self._data.actuator_force[self._at[i]])
        first, now = float(self._first[i]), float(self._gear[i] * self._data.qpos[self._places[i]])
        constant, spring, damper = self._bias[:, i].tolist()
        rate = (now - first) / elapsed_s
        mean = (first + now) / 2.0 - rate * self._half_step_s
        force = self._gain[i] * self._data.ctrl[self._at[i]] + constant + spring * mean + damper * rate
        return float(self._gear[i] * min(max(force, self._limit[0, i]), self._limit[1, i]))


def _channel_index(channel: str) -> int:
    if channel not in CHANNELS:
        msg = f"channel '{channel}' does not exist; known are: {', '.join(CHANNELS)}"
        raise ValueError(msg)
    return CHANNELS.index(channel)
