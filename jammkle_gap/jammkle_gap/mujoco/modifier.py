"""Runs a corrected model in anybody's own loop, with the nonidealities that its MJCF cannot describe.

model = mujoco.MjModel.from_xml_path("out/corrected.xml")
data, modifier = mujoco.MjData(model), Modifier(model)
while True:
    modifier.control(data, {"joint1": 0.3, "joint2": -0.2})
    mujoco.mj_step(model, data)
    read = modifier.positions(data)
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.mujoco.drives import actuator_kind, joint_of, joints_of
from jammkle_gap.mujoco.nonideal import backlash_offset, nonidealities_of, update_friction
from jammkle_gap.mujoco.robot import SENSORS
from jammkle_gap.mujoco.runs import BadRobotError, Gains, Quantity
from jammkle_gap.mujoco.simulator import FORWARD_FROM_S
from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from jammkle_gap.mujoco.runs import Sense

    Array = NDArray[np.float64]


class Modifier:
    """Applies the nonidealities of a model to set points and readings of one run.

    Set points and readings are of joints and SI, as a controller of ROS would send and read them. A set point is held
    until the next. Its delay is never below 0: commands that a recorder stamped late were no earlier at the robot.
    Where efforts come before positions, positions are read later instead, and commands have so much less of a delay.

    A set point's rate that is fed forward is taken over the 20 ms before and after it, so far as a delay makes these
    known; without a delay it is 10 ms late.

    The model is changed: friction that changes within a run is written into it before every step, and an actuator of
    torque whose controller is outside of the model becomes that controller, a drive that takes set points. Its `ctrl`
    is a set point from then on, and its torque stays within its range. One model serves one modifier.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        """Read what the model says.

        Args:
            model: As `corrected.xml` has it; one without its text lets set points and readings through as they are.

        Raises:
            BadRobotError: the text in it is damaged, or of another model.

        """
        self._model = model
        self._nonideal, gains = nonidealities_of(model)
        self._step_s = float(model.opt.timestep)
        late_s, effort_late_s = self._nonideal.delay_s + self._nonideal.arrival_s, self._nonideal.effort_delay_s
        # Efforts that come before positions are there when positions are read later, and commands come earlier for it.
        self._lead_s = max(-effort_late_s, 0.0)
        self._late_s, self._effort_late_s = max(late_s - self._lead_s, 0.0), max(effort_late_s, 0.0)
        self._drives = _drives_of(model, gains)
        self._places = {name: (int(model.joint(name).qposadr[0]), int(model.joint(name).dofadr[0]))
                        for name in joints_of(model)}  # fmt: skip
        self._senses = _senses_of(model)
        self._friction_rows = self._nonideal.friction_rows(model)
        self._begin()

    def _begin(self) -> None:
        self._time_s = -math.inf
        self._points = {(joint, kind): _Held() for joint in self._drives for kind in ("point", "rate", "effort")}
        self._lagging: dict[str, float] = {}
        self._asked: dict[str, float] = {}
        self._seen: list[tuple[float, tuple[Array, ...]]] = []

    def _notice(self, data: mujoco.MjData) -> None:
        """Begin anew where time has gone back."""
        if data.time < self._time_s:
            self._begin()

    @property
    def drives(self) -> tuple[str, ...]:
        """Joints that take set points: with one actuator, of position, velocity or torque, and without a state."""
        return tuple(self._drives)

    def control(
        self,
        data: mujoco.MjData,
        set_points: Mapping[str, float],
        rates: Mapping[str, float] | None = None,
        efforts: Mapping[str, float] | None = None,
    ) -> None:
        """Write `ctrl`, and friction into the model; call it once before every step.

        Time that goes back begins a new run.

        Args:
            data: Of the model.
            set_points: By joint; positions, velocities or efforts, as its actuator takes; rad, rad/s, N m, or m, m/s,
                N. A joint that is not among them keeps its last; one that never was, its `ctrl`.
            rates: Velocities that a controller sends beside positions, as in the recordings, by joint, rad/s or m/s;
                they are fed forward.
            efforts: Those that it sends beside positions or velocities, N m or N; the same.

        Raises:
            BadRobotError: a joint has no drive, or a set point is not finite.

        """
        self._notice(data)
        is_first, self._time_s = self._time_s == -math.inf, float(data.time)
        if is_first:
            mujoco.mj_forward(self._model, data)  # what readings that come late begin with
        parts = (("point", set_points), ("rate", rates or {}), ("effort", efforts or {}))
        sent = [((joint, kind), value) for kind, part in parts for joint, value in part.items()]
        for (joint, _), value in sent:
            self._check(joint, value)
        for key, value in sent:
            self._points[key].put(self._time_s, float(value))
        if self._lead_s > 0.0 or self._effort_late_s > 0.0:
            self._keep(data)
        for joint, drive in self._drives.items():
            if not self._points[joint, "point"].times_s:
                continue
            asked = self._asked[joint] = self._made(joint, drive)
            # The motor turns against the load by half the backlash before it moves it.
            data.ctrl[drive.actuator] = drive.gear * (asked - self._backlash(joint, data))
        if is_first:
            mujoco.mj_forward(self._model, data)  # friction with load begins with a load
        friction = self._model.dof_frictionloss
        update_friction(self._friction_rows, friction, data.qfrc_actuator, data.qfrc_bias, data.qvel)

    def _check(self, joint: str, value: float) -> None:
        if joint not in self._drives:
            msg = f"a set point is of joint {joint}, which has no drive in the model"
            msg += f"; set points may be of: {', '.join(self._drives) or 'none'}"
            raise BadRobotError(msg)
        if not math.isfinite(value):
            msg = f"the set point of joint {joint} is {value}, which must be finite; leave it out to keep the last"
            raise BadRobotError(msg)

    def _made(self, joint: str, drive: _Drive) -> float:
        """Return what a drive makes of its set point, on the mean over the next step."""
        nonideal, step_s = self._nonideal, self._step_s
        point, rate, effort = (self._points[joint, kind] for kind in ("point", "rate", "effort"))
        begin_s = self._time_s - self._late_s
        asked = point.mean(begin_s, step_s)
        share = nonideal.forward_share.get(joint, 0.0)
        if share != 0.0:
            ahead_s = min(FORWARD_FROM_S, self._late_s)  # what comes later nobody knows yet
            risen = point.mean(begin_s + ahead_s, step_s) - point.mean(begin_s - FORWARD_FROM_S, step_s)
            asked += drive.lead_s * share * risen / (ahead_s + FORWARD_FROM_S)
        lag_s = nonideal.set_point_lag_s.get(joint, 0.0)
        if lag_s > 0.0:
            before = self._lagging.get(joint, asked) - asked
            left = math.exp(-step_s / lag_s)
            self._lagging[joint] = asked + left * before
            asked += before * (1.0 - left) * lag_s / step_s
        if rate.times_s:
            asked += drive.lead_s * rate.mean(begin_s, step_s)
        if effort.times_s:
            asked += drive.per_effort * nonideal.fed_share.get(joint, 1.0) * effort.mean(begin_s, step_s)
        for each in (point, rate, effort):
            each.forget(begin_s - FORWARD_FROM_S)
        if drive.quantity is Quantity.EFFORT:
            return asked
        # Drives regulate what their encoders read.
        zero = nonideal.offset.get(joint, 0.0) if drive.quantity is Quantity.POSITION else 0.0
        return (asked - zero) / nonideal.scale.get(joint, 1.0)

    def _backlash(self, joint: str, data: mujoco.MjData) -> float:
        width = self._nonideal.slack.get(joint, 0.0)
        if width == 0.0 or joint not in self._asked:
            return 0.0
        return backlash_offset(self._asked[joint], float(data.qpos[self._places[joint][0]]), 0.5 * width)

    def positions(self, data: mujoco.MjData) -> dict[str, float]:
        """Return what encoders read, by joint, rad or m."""
        return dict(zip(self._places, self._read(data, 0, self._lead_s).tolist(), strict=True))

    def efforts(self, data: mujoco.MjData) -> dict[str, float]:
        """Return efforts of the drives of each joint as they are read, N m or N; they are of the latest step."""
        return dict(zip(self._places, self._read(data, 1, self._effort_late_s).tolist(), strict=True))

    def sensors(self, data: mujoco.MjData) -> dict[str, Array]:
        """Return what sensors at sites read, by `site/acceleration`, `angular_velocity`, `force` or `torque`, (3,), SI.

        They are those of the model, and as MuJoCo's of the state before the latest step.
        """
        read = self._read(data, 2, self._lead_s)
        return {f"{site}/{sense.value}": read[k] for k, (site, sense, _) in enumerate(self._senses)}

    def stamp_s(self, data: mujoco.MjData) -> float:
        """Return the time that a reading of now is stamped with by its own clock, s."""
        return float(data.time) * (1.0 + self._nonideal.clock_rate)

    def _now(self, data: mujoco.MjData) -> tuple[Array, Array, Array]:
        """Return positions and efforts, shape (joints,), and readings of sensors at sites, shape (sensors, 3)."""
        nonideal = self._nonideal
        positions: list[float] = []
        efforts: list[float] = []
        for joint, (angle, dof) in self._places.items():
            effort = float(data.qfrc_actuator[dof])
            positions.append(
                nonideal.read_position(joint, float(data.qpos[angle]) + self._backlash(joint, data), effort)
            )
            efforts.append(nonideal.effort_scale.get(joint, 1.0) * effort)
        felt = [nonideal.read_sensor(site, sense, data.sensordata[at : at + 3]) for site, sense, at in self._senses]
        return np.array(positions), np.array(efforts), np.array(felt)

    def _keep(self, data: mujoco.MjData) -> None:
        """Keep readings of now for those that come late."""
        self._seen.append((self._time_s, self._now(data)))
        oldest_s = self._time_s - max(self._lead_s, self._effort_late_s)
        while len(self._seen) > 1 and self._seen[1][0] <= oldest_s:
            del self._seen[0]

    def _read(self, data: mujoco.MjData, kind: int, late_s: float) -> Array:
        """Return readings of one kind as they were some time ago, straight between two steps."""
        self._notice(data)
        time_s, now = float(data.time), self._now(data)[kind]
        rows = [(each_s, each[kind]) for each_s, each in self._seen if each_s < time_s] if late_s > 0.0 else []
        at_s = time_s - late_s
        if not rows or at_s <= rows[0][0]:
            return rows[0][1] if rows else now
        rows.append((time_s, now))
        after = bisect_left([each_s for each_s, _ in rows], at_s)
        (begin_s, first), (end_s, last) = rows[after - 1], rows[after]
        found: Array = first + (at_s - begin_s) / (end_s - begin_s) * (last - first)
        return found


@dataclass(frozen=True)
class _Drive:
    """An actuator that takes set points of a joint."""

    actuator: int
    quantity: Quantity
    gear: float
    """Of `ctrl`, per set point of the joint."""
    lead_s: float
    """By which a set point's rate is fed forward: kd over kp, s."""
    per_effort: float
    """Set point per effort that is fed forward: rad/(N m), rad/(s N m), or of metres and newtons."""


def _drives_of(model: mujoco.MjModel, gains: Mapping[str, Gains]) -> dict[str, _Drive]:
    """Return the drives by joint, after controllers outside of the model have become theirs."""
    targets = [joint_of(model, number) for number in range(model.nu)]
    found = {}
    for number, joint in enumerate(targets):
        actuator = model.actuator(number)
        gear = float(actuator.gear[0])
        if joint in gains and gear != 0.0:
            _become_drive(model, number, gains[joint], gear)
        quantity = actuator_kind(actuator)
        if targets.count(joint) > 1 or joint not in joints_of(model) or quantity is None or gear == 0.0:
            continue
        gain = float(actuator.gainprm[0])
        if gain == 0.0:
            continue
        lead_s = -float(actuator.biasprm[2]) / gain if quantity is Quantity.POSITION else 0.0
        if quantity is Quantity.EFFORT:
            found[joint] = _Drive(number, quantity, 1.0 / (gear * gain), lead_s, 1.0)
        else:
            found[joint] = _Drive(number, quantity, gear, lead_s, 1.0 / (gear**2 * gain))
    return found


def _become_drive(model: mujoco.MjModel, number: int, gains: Gains, gear: float) -> None:
    """Make an actuator `kp (set point - q) - kd dq`, or `kd (set point - dq)` without a kp; its range stays."""
    model.actuator_gaintype[number] = int(mujoco.mjtGain.mjGAIN_FIXED)
    model.actuator_biastype[number] = int(mujoco.mjtBias.mjBIAS_AFFINE)
    model.actuator_dyntype[number] = int(mujoco.mjtDyn.mjDYN_NONE)
    model.actuator_actadr[number], model.actuator_actnum[number] = -1, 0
    model.actuator_ctrllimited[number] = 0
    model.actuator_gainprm[number], model.actuator_biasprm[number] = 0.0, 0.0
    model.actuator_gainprm[number, 0] = (gains.kp or gains.kd) / gear**2
    model.actuator_biasprm[number, 1:3] = np.array([-gains.kp, -gains.kd]) / gear**2


def _senses_of(model: mujoco.MjModel) -> list[tuple[str, Sense, int]]:
    """Return the sensors at sites: site, what they read, and where in `sensordata`."""
    senses = {int(kind): sense for sense, kind in SENSORS.items()}
    return [
        (model.site(int(model.sensor_objid[k])).name, senses[int(model.sensor_type[k])], int(model.sensor_adr[k]))
        for k in range(model.nsensor)
        if int(model.sensor_type[k]) in senses
    ]


class _Held:
    """A number that stays as it is until the next, and at first is as the first was before."""

    def __init__(self) -> None:
        self.times_s: list[float] = []
        self._values: list[float] = []

    def put(self, time_s: float, value: float) -> None:
        """Take a number for what comes from a time on, which is not before the last."""
        if not self._values or value != self._values[-1]:
            self.times_s.append(time_s)
            self._values.append(value)

    def mean(self, begin_s: float, width_s: float) -> float:
        """Return the mean over a stretch."""
        if begin_s >= self.times_s[-1]:
            return self._values[-1]
        end_s = begin_s + width_s
        first, last = (max(bisect_right(self.times_s, at_s) - 1, 0) for at_s in (begin_s, end_s))
        ends = [begin_s, *self.times_s[first + 1 : last + 1], end_s]
        spans = zip(ends, ends[1:], self._values[first : last + 1], strict=False)
        return sum((until - since) * value for since, until, value in spans) / width_s

    def forget(self, time_s: float) -> None:
        """Forget what was before a time."""
        while len(self.times_s) > 1 and self.times_s[1] <= time_s:
            del self.times_s[0], self._values[0]
