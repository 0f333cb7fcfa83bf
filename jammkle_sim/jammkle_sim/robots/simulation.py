"""A robot in simulated time: commands in, physics forward, sensors and truth out. No ROS; the same every time.

    simulation = robot_simulation("leg", RobotOptions(behaviour="walk", imu="body"))
    for sample in simulation.samples(duration_s=5.0, rate_hz=500):
        ankle = sample.ankles["ankle"]
        ankle.imu.specific_force_m_s2, ankle.positions["ankle_pitch"], ankle.channel_pressures_pa["achilles"]
        ankle.foot.stands, ankle.foot.sliding_speed_m_s, ankle.foot.sliding_distance_m   # the truth
        simulation.ankles["ankle"].hold_vacuum({"achilles": 50e3})                       # a regulator like the driver's
        simulation.ankles["ankle"].set_solenoid("achilles", True)                        # or valves and pump by hand

A leg has one ankle, `ankle`; a quadruped `lf_ankle`, `rf_ankle`, `lh_ankle`, `rh_ankle`. What is commanded between two
samples acts from the next step on. The same robot, commands and seed give the same samples, bit by bit.
"""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_common.names import ANKLE_JOINTS
from jammkle_sim.physics import kernels, records
from jammkle_sim.physics.ankle import joint_law
from jammkle_sim.physics.engine import address_of_function, mujoco
from jammkle_sim.physics.pneumatics import pneumatic_law, vented_state
from jammkle_sim.physics.sensors import Noise, imu_law
from jammkle_sim.physics.tendon import relaxed_state
from jammkle_sim.rigs.assembly import imu_at_rest
from jammkle_sim.rigs.base import BaseSample, base_sample
from jammkle_sim.rigs.model import ankle_laws
from jammkle_sim.rigs.simulation import UnstableSimulationError
from jammkle_sim.robots.ankle_view import AnkleSample, AnkleView
from jammkle_sim.robots.attach import tendon_names
from jammkle_sim.robots.options import ImuPlace
from jammkle_sim.robots.servos import Servos

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray

    from jammkle_sim.robots.attach import AttachedAnkle
    from jammkle_sim.robots.gait import FootPlan
    from jammkle_sim.robots.robot import Robot

CONTROL_PERIOD_S = 0.002
"""How often the robot's joints get new targets: 500 Hz, as legged robots of this size do."""
REGULATION_PERIOD_S = 0.01
"""How often vacuum is regulated where a set point is held, as the driver does."""
_SEEDS_APART = 2**32
"""From one ankle's seed to the next one's: more than any seed that can be asked for, so that no two are the same."""


@dataclass(frozen=True)
class RobotSample:
    """All of a robot at one time."""

    time_s: float
    """Since the robot's start."""
    ankles: Mapping[str, AnkleSample]
    """By name."""
    base_position_m: tuple[float, float, float]
    """Of the base, in the world. Truth."""
    base_tilt_rad: float
    """Angle between the base's z axis and straight up. Truth."""
    base_velocity_m_s: tuple[float, float, float]
    """Of the base, in the world. Truth."""
    base: BaseSample
    """All of the body that carries the robot. Truth."""


class RobotSimulation:
    """A robot, its ankles' tendons, air and sensors, advanced together."""

    def __init__(self, robot: Robot) -> None:
        """Start the robot: every ankle vented, its pump off, in the pose of its model.

        Args:
            robot: What is simulated.

        """
        self._total_steps = 0
        self._put_together(robot)

    def _put_together(self, robot: Robot) -> None:
        self._robot = robot
        self._model = robot.model
        self._model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        self.data = mujoco.MjData(self._model)
        """The mujoco.MjData. Its `ctrl` is the user's where the robot has no control of its own."""
        self.timestep_s = float(self._model.opt.timestep)
        """Time step, s."""
        self._addresses = np.array(
            [
                address_of_function("mj_step1"),
                address_of_function("mj_step2"),
                self._model._address,  # noqa: SLF001  # the bindings' own way to hand a model to C
                self.data._address,  # noqa: SLF001  # as above
            ],
            dtype=np.intp,
        )
        self._friction = self._model.geom_friction.copy()
        self._servos = Servos(self._model, self.data)
        self._pose()
        self._parts = tuple(_parts(robot, ankle, self.data) for ankle in robot.ankles)
        self._start = tuple(_copies(parts) for parts in self._parts)
        seeds = [robot.sensors.seed + index * _SEEDS_APART for index in range(len(robot.ankles))]
        self.ankles: dict[str, AnkleView] = {}
        """Every ankle, by name: to command, and to look at."""
        for ankle, parts, seed in zip(robot.ankles, self._parts, seeds, strict=True):
            sensors = dataclasses.replace(robot.sensors, seed=seed)
            plan = functools.partial(self._plan, ankle.name)
            self.ankles[ankle.name] = AnkleView(ankle, parts, self.data, sensors, Noise(sensors), plan, self._servos)
        self._base = self.data.body(robot.base)
        self._control_steps = max(1, round(CONTROL_PERIOD_S / self.timestep_s))
        self._regulation_steps = max(1, round(REGULATION_PERIOD_S / self.timestep_s))
        self._one_imu = all(ankle.imu is ImuPlace.BODY for ankle in robot.ankles)
        self._robot_steps = 0

    @property
    def robot(self) -> Robot:
        """What is simulated."""
        return self._robot

    @property
    def model(self) -> Any:
        """The mujoco.MjModel that is simulated, to look at."""
        return self._model

    @property
    def time_s(self) -> float:
        """Simulated time since construction, s: a whole number of time steps, never set back."""
        return self._total_steps * self.timestep_s

    @property
    def robot_time_s(self) -> float:
        """Simulated time since the latest start of the robot, s."""
        return self._robot_steps * self.timestep_s

    def advance(self, steps: int) -> None:
        """Take `steps` time steps; the result does not depend on the portions.

        Raises:
            ValueError: a negative number of steps.
            UnstableSimulationError: the state grew beyond all bounds; only a reset helps.

        """
        if steps < 0:
            msg = f"steps is {steps}; it must be 0 or more"
            raise ValueError(msg)
        end = self._robot_steps + steps
        while self._robot_steps < end:
            self._act()
            self._run(min(self._next_act(), end) - self._robot_steps)

    def samples(self, duration_s: float, rate_hz: int) -> Iterator[RobotSample]:
        """Go on for a time, and give a sample at a rate; commands given between two act from there on.

        Args:
            duration_s: How long, simulated, s.
            rate_hz: Samples per second; must divide the step rate.

        Raises:
            ValueError: the rate does not divide the step rate.
            UnstableSimulationError: as `advance`.

        """
        steps = 1.0 / (rate_hz * self.timestep_s)
        if steps < 1 or abs(steps - round(steps)) > 1e-9 * steps:
            msg = f"a rate of {rate_hz} Hz does not fit a time step of {self.timestep_s:g} s"
            raise ValueError(msg)
        for _ in range(round(duration_s * rate_hz)):
            self.advance(round(steps))
            yield self.sample()

    def sample(self) -> RobotSample:
        """Return all of the robot now."""
        position, upright = self._base.xpos.tolist(), float(self._base.xmat[8])
        velocity = np.zeros(6)
        body = mujoco.mjtObj.mjOBJ_XBODY
        mujoco.mj_objectVelocity(self._model, self.data, body, self._base.id, velocity, 0)
        return RobotSample(
            self.robot_time_s,
            {name: view.sample() for name, view in self.ankles.items()},
            (position[0], position[1], position[2]),
            float(np.arccos(np.clip(upright, -1.0, 1.0))),
            (float(velocity[3]), float(velocity[4]), float(velocity[5])),
            self.base(),
        )

    def base(self) -> BaseSample:
        """Where the body that carries the robot is, and how it moves: the truth."""
        return base_sample(self._model, self.data, int(self._model.body_rootid[self._base.id]))

    def reset(self) -> None:
        """Start the robot again, with the same noise; the time goes on."""
        self._pose()
        for parts, start in zip(self._parts, self._start, strict=True):
            for part, first in zip((*parts.states, parts.truth), start, strict=True):
                part[:] = first
        for view in self.ankles.values():
            view.restart()
        self._robot_steps = 0

    def exchange(self, robot: Robot) -> None:
        """Go on with another robot, at its start, commanded to nothing; the time goes on.

        Args:
            robot: With the same time step.

        Raises:
            ValueError: another time step, in which the time so far would be something else.

        """
        step_s = float(robot.model.opt.timestep)
        if step_s != self.timestep_s:
            msg = f"time step is {step_s:g} s; it must be that of the robot before, {self.timestep_s:g} s"
            raise ValueError(msg)
        self._put_together(robot)

    def description(self) -> dict[str, object]:
        """Name of the robot and all its parameters, ready for YAML."""
        robot = self._robot
        parts = {"tendon": robot.tendon, "pneumatics": robot.pneumatics, "sensors": robot.sensors, **robot.parts}
        if robot.options is not None:
            parts = {"options": robot.options, **parts}
        plain = {name: dataclasses.asdict(part) for name, part in parts.items()}
        return {"robot": robot.name, "timestep_s": self.timestep_s, "ankles": list(self.ankles), **plain}

    def _plan(self, ankle: str) -> FootPlan | None:
        return self._robot.control.plan(ankle, self.robot_time_s)

    def _pose(self) -> None:
        self._model.geom_friction[:] = self._friction
        mujoco.mj_resetData(self._model, self.data)
        if self._model.nkey:
            mujoco.mj_resetDataKeyframe(self._model, self.data, 0)
        self._robot.control.command(0.0, self.data)
        mujoco.mj_forward(self._model, self.data)
        self._servos.retarget()

    def _act(self) -> None:
        """Do what is due at this step: events, targets of the joints, vacuum."""
        for event in self._robot.events:
            if event.step == self._robot_steps:
                event.act(self.data)
        if self._robot_steps % self._control_steps == 0:
            self._robot.control.command(self.robot_time_s, self.data)
            self._servos.retarget()
        if self._robot_steps % self._regulation_steps == 0:
            for view in self.ankles.values():
                view.regulate(REGULATION_PERIOD_S)

    def _next_act(self) -> int:
        """Return the next step at which something may be due."""
        coming = [event.step for event in self._robot.events if event.step > self._robot_steps]
        return min([self._robot_steps + self._control_steps - self._robot_steps % self._control_steps, *coming])

    def _run(self, steps: int) -> None:
        views = list(self.ankles.values())
        if self._one_imu:  # one IMU for all: the same noise
            own = views[0].white(steps)
            white = np.stack([own, *(_skipped(view, steps, own) for view in views[1:])])
        else:
            white = np.stack([view.white(steps) for view in views])
        if self._addresses.all():
            taken = kernels.advance_robot(self._parts, self._addresses, self.data.qvel, white)
        else:
            taken = self._advance_from_python(white)
        self._total_steps += taken
        self._robot_steps += taken
        if taken != steps:
            msg = (
                f"simulation of robot '{self._robot.name}' became unstable {self.robot_time_s:g} s after its start: a "
                f"joint moves at more than {kernels.LARGEST_SPEED:g} rad/s or m/s; try a smaller timestep_s"
            )
            raise UnstableSimulationError(msg)

    def _advance_from_python(self, white: NDArray[np.float64]) -> int:
        """Do what `kernels.advance_robot` does, more slowly, where MuJoCo's library cannot be called directly."""
        for step in range(white.shape[1]):
            if not kernels.is_stable(self.data.qvel):
                return step
            mujoco.mj_step1(self._model, self.data)
            for parts in self._parts:
                kernels.act(parts.laws, parts.states, parts.body)
            mujoco.mj_step2(self._model, self.data)
            for parts, row in zip(self._parts, white[:, step], strict=True):
                kernels.filter_imu(parts.laws.imu[0], parts.states.imu[0], parts.body.raw_imu, row)
                kernels.watch_foot(parts.contacts, parts.truth[0])
        return len(white[0]) if kernels.is_stable(self.data.qvel) else len(white[0]) - 1


def _parts(robot: Robot, ankle: AttachedAnkle, data: Any) -> records.Ankle:
    """Return constants and memory of an ankle, and the views of MuJoCo's arrays that it reads and writes."""
    model = robot.model
    step_s = float(model.opt.timestep)
    laws = records.Laws(
        pneumatic_law(robot.pneumatics, step_s),
        ankle_laws(robot.tendon, ankle.parameters, step_s),
        imu_law(robot.sensors, step_s),
        joint_law(step_s),
    )
    names = tendon_names(ankle)
    tendon, actuator = model.tendon(names[0]).id, model.actuator(names[0]).id
    imu, contacts = int(model.sensor(ankle.accelerometer).adr[0]), int(model.sensor(ankle.contacts).adr[0])
    body = records.Body(
        addresses=np.zeros(0, dtype=np.intp),
        length_m=data.ten_length[tendon : tendon + len(names)],
        rate_m_s=data.ten_velocity[tendon : tendon + len(names)],
        pull_n=data.ctrl[actuator : actuator + len(names)],
        speed=data.qvel,
        applied_n_m=data.qfrc_applied,
        joint_index=np.array([model.joint(ankle.named(name)).dofadr[0] for name in ANKLE_JOINTS], dtype=np.intp),
        raw_imu=data.sensordata[imu : imu + records.IMU_AXES],
    )
    states = records.States(
        vented_state(laws.pneumatics),
        np.concatenate(
            [
                relaxed_state(law, extension_m)
                for law, extension_m in zip(
                    np.split(laws.tendons, len(names)),
                    (body.length_m - laws.tendons["free_length_m"]).tolist(),
                    strict=True,
                )
            ]
        ),
        imu_at_rest(laws.imu, body.raw_imu),
        np.zeros(1, dtype=records.JOINT_STATE),
    )
    truth = np.zeros(1, dtype=records.FOOT_TRUTH)
    truth["bearing_n"] = STANDARD_GRAVITY_M_S2 * ankle.parameters.foot_mass_kg
    truth["step_s"] = step_s
    width = records.CONTACT_SLOTS * records.CONTACT_COLUMNS
    return records.Ankle(laws, states, body, data.sensordata[contacts : contacts + width], truth)


def _copies(parts: records.Ankle) -> tuple[NDArray[Any], ...]:
    return tuple(part.copy() for part in (*parts.states, parts.truth))


def _skipped(view: AnkleView, steps: int, own: NDArray[np.float64]) -> NDArray[np.float64]:
    """Let an ankle's own noise go by, and return the one that counts."""
    view.white(steps)
    return own
