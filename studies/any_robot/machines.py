"""Machines whose truth is known: three robots, what may be wrong with them, and what they record.

A machine is not the model that is diagnosed: its masses, lengths and gains lie within some per cent of it, it is
stepped twice as finely, its drives get commands late and by a clock with jitter, its encoders have steps. What is wrong
with it is done here by itself and not by the library that is on trial.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import mujoco  # type: ignore[import-untyped]  # carries no types
import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Sizes = dict[str, float]

_HEAD = '<compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/>'
ARM = f"""
<mujoco model="arm">{_HEAD}
  <worldbody><body name="base_link" pos="0 0 0.2">
    <inertial pos="0 0 0.05" mass="4" diaginertia="0.02 0.02 0.015"/>
    <joint name="pan" axis="0 0 1" damping="1" armature="0.2" frictionloss="0.5" range="-3 3"/>
    <body name="upper_arm" pos="0 0 0.1"><inertial pos="0 0 0.2" mass="4" diaginertia="0.06 0.06 0.01"/>
      <joint name="lift" axis="0 1 0" damping="1" armature="0.2" frictionloss="0.5" range="-3 3"/>
      <body name="forearm" pos="0 0 0.4"><inertial pos="0 0 0.17" mass="2" diaginertia="0.025 0.025 0.004"/>
        <joint name="elbow" axis="0 1 0" damping="0.6" armature="0.1" frictionloss="0.3" range="-3 3"/>
        <body name="wrist_1" pos="0 0 0.35"><inertial pos="0 0.02 0" mass="1" diaginertia="0.002 0.002 0.002"/>
          <joint name="wrist_1" axis="0 1 0" damping="0.2" armature="0.03" frictionloss="0.1" range="-3 3"/>
          <body name="wrist_2" pos="0 0.06 0"><inertial pos="0 0 0.02" mass="1" diaginertia="0.002 0.002 0.002"/>
            <joint name="wrist_2" axis="0 0 1" damping="0.2" armature="0.03" frictionloss="0.1" range="-3 3"/>
            <body name="tool" pos="0 0 0.08"><inertial pos="0.02 0 0.03" mass="0.6" diaginertia="0.001 0.001 0.001"/>
              <joint name="wrist_3" axis="0 1 0" damping="0.2" armature="0.03" frictionloss="0.1" range="-3 3"/>
              <site name="flange" pos="0 0 0.08"/>
  </body></body></body></body></body></body></worldbody>
  <actuator>
    <position name="pan" joint="pan" kp="900" kv="45" forcerange="-90 90"/>
    <position name="lift" joint="lift" kp="1200" kv="60" forcerange="-90 90"/>
    <position name="elbow" joint="elbow" kp="600" kv="30" forcerange="-60 60"/>
    <position name="wrist_1" joint="wrist_1" kp="150" kv="6" forcerange="-15 15"/>
    <position name="wrist_2" joint="wrist_2" kp="150" kv="6" forcerange="-15 15"/>
    <position name="wrist_3" joint="wrist_3" kp="150" kv="6" forcerange="-15 15"/>
  </actuator>
</mujoco>"""
LEG = f"""
<mujoco model="leg">{_HEAD}
  <worldbody><body name="hip" pos="0 0 0.8"><inertial pos="0 0.03 0" mass="0.7" diaginertia="0.001 0.001 0.001"/>
    <joint name="hip_roll" axis="1 0 0" damping="0.05" armature="0.01" frictionloss="0.1" range="-1 1"/>
    <body name="thigh" pos="0 0.08 0"><inertial pos="0 0 -0.04" mass="1.0" diaginertia="0.006 0.006 0.001"/>
      <joint name="hip_pitch" axis="0 1 0" damping="0.05" armature="0.01" frictionloss="0.1" range="-2 2"/>
      <body name="shank" pos="0 0 -0.22"><inertial pos="0 0 -0.1" mass="0.25" diaginertia="0.002 0.002 0.0001"/>
        <joint name="knee" axis="0 1 0" damping="0.05" armature="0.016" frictionloss="0.1" range="-2.7 2.7"/>
        <site name="foot" pos="0 0 -0.22"/>
  </body></body></body></worldbody>
  <actuator><motor name="hip_roll" joint="hip_roll"/><motor name="hip_pitch" joint="hip_pitch"/>
    <motor name="knee" joint="knee"/></actuator>
</mujoco>"""
CRANE = f"""
<mujoco model="crane">{_HEAD}
  <worldbody><body name="cart" pos="0 0 2"><inertial pos="0 0 0" mass="2" diaginertia="0.01 0.01 0.01"/>
    <joint name="rail" type="slide" axis="1 0 0" damping="2" armature="0.5" frictionloss="1" range="-2 2"/>
    <body name="pole"><inertial pos="0 0 -0.5" mass="0.8" diaginertia="0.02 0.02 0.001"/>
      <joint name="swing" axis="0 1 0" damping="0.01"/>
      <site name="hook" pos="0 0 -0.7"/>
  </body></body></worldbody>
  <actuator><velocity name="rail" joint="rail" kv="60"/></actuator>
</mujoco>"""


@dataclass(frozen=True)
class Kind:
    """A robot of the trial."""

    xml: str
    driven: tuple[str, ...]
    measured: tuple[str, ...]
    centre: tuple[float, ...]
    """About which it is moved, rad or m."""
    swing: tuple[float, ...]
    """Largest amplitude of set points, rad, or m/s of the crane."""
    gains: Mapping[str, tuple[float, float]]
    """kp and kd of a controller outside of the model."""
    command_hz: float
    record_hz: float
    step: float
    """Of encoders, rad or m."""
    effort_noise: float
    """Standard deviation, N m or N."""
    quantity: str = "position"


_WRISTS = ("wrist_1", "wrist_2", "wrist_3")
ROBOTS: Mapping[str, Kind] = {
    "arm": Kind(
        ARM, ("pan", "lift", "elbow", *_WRISTS), ("pan", "lift", "elbow", *_WRISTS),
        (0.0, 0.6, 1.0, 0.3, 0.0, 0.3), (0.7, 0.5, 0.6, 0.8, 0.8, 0.8), {}, 125.0, 125.0, 2e-4, 0.15,
    ),
    "leg": Kind(
        LEG, ("hip_roll", "hip_pitch", "knee"), ("hip_roll", "hip_pitch", "knee"), (0.0, 0.5, -1.0), (0.3, 0.5, 0.6),
        {"hip_roll": (40.0, 1.0), "hip_pitch": (40.0, 1.0), "knee": (40.0, 1.0)}, 200.0, 500.0, 4e-4, 0.08,
    ),
    "crane": Kind(
        CRANE, ("rail",), ("rail", "swing"), (0.0,), (0.5,), {}, 100.0, 100.0, 5e-4, 0.5, "velocity",
    ),
}  # fmt: skip


@dataclass
class Fault:
    """What is wrong with a machine: its model changed, and what no model says."""

    names: tuple[str, ...] = ()
    """In the library's words; empty for none, and for what the library has not."""
    label: str = "none"
    sizes: dict[str, dict[str, float]] = field(default_factory=dict)
    """By name, how large each is in the library's numbers, by `effect.parameter`."""
    stribeck: dict[str, tuple[float, float]] = field(default_factory=dict)
    load: dict[str, float] = field(default_factory=dict)
    slack: dict[str, float] = field(default_factory=dict)
    offset: dict[str, float] = field(default_factory=dict)
    scale: dict[str, float] = field(default_factory=dict)
    effort_scale: dict[str, float] = field(default_factory=dict)
    late_s: float = 0.0
    readings_late_s: float = 0.0
    lag_s: float = 0.0
    forward: float = 0.0
    cogging: dict[str, float] = field(default_factory=dict)
    spring: dict[str, float] = field(default_factory=dict)
    lost: float = 0.0
    """Share of the commands that never arrive."""
    fading: float = 0.0
    """Share of all torque that is lost by the end of a recording."""


SINGLES = (
    "friction", "damping", "stribeck", "load_friction", "armature", "torque_constant", "position_gain", "rate_gain",
    "torque_limit", "set_point_lag", "velocity_feed_forward", "backlash", "encoder_offset", "encoder_scale", "payload",
    "mass", "command_delay", "reading_delay", "base_tilt", "gravity_compensation",
)  # fmt: skip
OUTSIDE = ("cogging", "spring", "lost", "fading")
"""Torque that goes with the angle, a cable that pulls, commands that are lost, motors that fade."""


def able(robot: str, what: str) -> bool:
    """Return whether a robot can have a fault."""
    by_rate = ROBOTS[robot].quantity == "velocity"
    if by_rate and what in {"position_gain", "velocity_feed_forward", "backlash", "gravity_compensation", "base_tilt"}:
        return False
    return not (robot == "crane" and what in {"stribeck", "encoder_scale", "load_friction", "set_point_lag"})


@dataclass(frozen=True)
class _Draw:
    """A fault of one joint, of a drawn size."""

    fault: Fault
    model: Any
    robot: str
    joint: str
    sign: float
    size: float

    @property
    def dof(self) -> int:
        return int(self.model.joint(self.joint).dofadr[0])

    @property
    def actuator(self) -> Any:
        return self.model.actuator(self.joint)

    @property
    def torque(self) -> float:
        """Friction of the joint as drawn, N m or N."""
        return _FRICTION[self.robot][self.joint]


def _friction(draw: _Draw) -> Sizes:
    torque = 6.0 * draw.size * draw.torque
    draw.model.dof_frictionloss[draw.dof] += torque
    return {"torque": torque}


def _damping(draw: _Draw) -> Sizes:
    coefficient = 6.0 * draw.size * draw.torque
    draw.model.dof_damping[draw.dof] += coefficient
    return {"coefficient": coefficient}


def _stribeck(draw: _Draw) -> Sizes:
    torque, speed = 6.0 * draw.size * draw.torque, 0.1
    draw.fault.stribeck[draw.joint] = (torque, speed)
    return {"torque": torque, "speed": speed}


def _load_friction(draw: _Draw) -> Sizes:
    draw.fault.load[draw.joint] = 0.3 * draw.size
    return {"share": 0.3 * draw.size}


def _armature(draw: _Draw) -> Sizes:
    inertia = 2.0 * draw.size * float(draw.model.dof_armature[draw.dof])
    draw.model.dof_armature[draw.dof] += inertia
    return {"inertia": inertia}


def _torque_constant(draw: _Draw) -> Sizes:
    scale = 1.0 + draw.sign * 0.35 * draw.size
    draw.actuator.gainprm[:] *= scale
    draw.actuator.biasprm[:] *= scale
    draw.fault.effort_scale[draw.joint] = 1.0 / scale
    return {"scale": scale}


def _position_gain(draw: _Draw) -> Sizes:
    scale = 1.0 + draw.sign * 0.45 * draw.size
    draw.actuator.gainprm[0] *= scale
    draw.actuator.biasprm[1] *= scale
    return {"scale": scale}


def _rate_gain(draw: _Draw) -> Sizes:
    scale = 1.0 + draw.sign * 0.6 * draw.size
    draw.actuator.biasprm[2] *= scale
    if draw.actuator.biasprm[1] == 0.0:
        draw.actuator.gainprm[0] *= scale
    return {"scale": scale}


def _torque_limit(draw: _Draw) -> Sizes:
    draw.model.actuator_forcelimited[draw.actuator.id] = 1
    torque = (1.0 - 0.7 * draw.size) * _LARGEST[draw.robot][draw.joint]
    draw.actuator.forcerange[:] = np.array([-1.0, 1.0]) * torque
    return {"torque": torque}


def _backlash(draw: _Draw) -> Sizes:
    draw.fault.slack[draw.joint] = 0.04 * draw.size
    return {"width": 0.04 * draw.size}


def _encoder_offset(draw: _Draw) -> Sizes:
    offset = draw.sign * 0.07 * draw.size * (0.2 if draw.robot == "crane" else 1.0)
    draw.fault.offset[draw.joint] = offset
    return {"offset": offset}


def _encoder_scale(draw: _Draw) -> Sizes:
    draw.fault.scale[draw.joint] = 1.0 + draw.sign * 0.045 * draw.size
    return {"scale": draw.fault.scale[draw.joint]}


def _cogging(draw: _Draw) -> Sizes:
    draw.fault.cogging[draw.joint] = 8.0 * draw.size * draw.torque
    return {}


def _spring(draw: _Draw) -> Sizes:
    draw.fault.spring[draw.joint] = 12.0 * draw.size * draw.torque
    return {}


_OF_JOINTS = {
    "friction": _friction, "damping": _damping, "stribeck": _stribeck, "load_friction": _load_friction,
    "armature": _armature, "torque_constant": _torque_constant, "position_gain": _position_gain,
    "rate_gain": _rate_gain, "torque_limit": _torque_limit, "backlash": _backlash, "encoder_offset": _encoder_offset,
    "encoder_scale": _encoder_scale, "cogging": _cogging, "spring": _spring,
}  # fmt: skip
_TIMES = {
    "set_point_lag": ("lag_s", 0.0, 0.08), "velocity_feed_forward": ("forward", 0.0, 1.0),
    "command_delay": ("late_s", 0.015, 0.05), "reading_delay": ("readings_late_s", 0.01, 0.035),
    "lost": ("lost", 0.2, 0.6), "fading": ("fading", 0.0, 0.5),
}  # fmt: skip
"""Fields of a fault, the least of it, and what a size of 1 adds."""
_LIBRARY_NAMES = {"command_delay": "delay", "reading_delay": "delay"}
"""Where faults are one effect in the library: what is recorded is the same, only later."""
_SHARING = 0.25
"""Share of faults of a wrist that all wrists have."""


def put_fault(fault: Fault, model: Any, robot: str, what: str, random: np.random.Generator) -> None:
    """Put a fault of a random size into a machine."""
    kind, sign, size = ROBOTS[robot], float(random.choice([-1.0, 1.0])), float(random.uniform(0.25, 0.8))
    name, sizes = _LIBRARY_NAMES.get(what, what), {}
    if what in _OF_JOINTS:
        joints: tuple[str, ...] = (str(random.choice(kind.driven)),)
        name = f"{what}_{joints[0]}"
        if joints[0] in _WRISTS and what in {"friction", "damping", "load_friction"} and random.uniform() < _SHARING:
            joints, name = _WRISTS, f"{what}_wrist"
        for joint in joints:
            own = _OF_JOINTS[what](_Draw(fault, model, robot, joint, sign, size))
            sizes.update({f"{what}_{joint}.{key}": value for key, value in own.items()})
    elif what in _TIMES:
        field_name, least, more = _TIMES[what]
        setattr(fault, field_name, least + more * size)
        sizes = {f"{name}.{'share' if what == 'velocity_feed_forward' else 'time'}": least + more * size}
    elif what == "gravity_compensation":
        model.body_gravcomp[:] = size
        sizes = {"gravity_compensation.share": size}
        for joint in kind.driven:
            model.jnt_actgravcomp[model.joint(joint).id] = 1
    elif what == "base_tilt":
        turn = sign * 0.09 * size
        model.opt.gravity[:] = 9.81 * np.array([np.sin(turn), 0.0, -np.cos(turn)])
        sizes = {"base_tilt.pitch": turn}
    elif what == "payload":
        sizes = {"payload.mass": _load(model, 0.15 * size)}
    else:
        body = model.body(int(random.integers(1, model.nbody)))
        name = f"mass_{body.name}"
        scale = 1.0 + (0.8 * size if sign > 0.0 else -0.45 * size)
        body.mass[:] *= scale
        body.inertia[:] *= scale
        sizes = {f"{name}.scale": scale}
    if what in SINGLES:
        fault.names = (*fault.names, name)
        fault.sizes[name] = sizes
    fault.label = name if fault.label == "none" else f"{fault.label}+{name}"


def _load(model: Any, share: float) -> float:
    """Hang a share of all mass on the tip, as a point, and return it, kg."""
    body = model.body(model.nbody - 1)
    tip, mass = model.site_pos[0], float(model.body_mass[1:].sum()) * share
    own = float(body.mass[0])
    away = tip - body.ipos
    body.inertia[:] += own * mass / (own + mass) * (away @ away - away**2)
    body.ipos[:] = (own * body.ipos + mass * tip) / (own + mass)
    body.mass[:] = own + mass
    return mass


_FRICTION = {
    "arm": {"pan": 0.5, "lift": 0.5, "elbow": 0.3, "wrist_1": 0.1, "wrist_2": 0.1, "wrist_3": 0.1},
    "leg": {"hip_roll": 0.1, "hip_pitch": 0.1, "knee": 0.1},
    "crane": {"rail": 1.0},
}
"""Of the models, N m or N."""
_LARGEST = {
    "arm": {"pan": 15.0, "lift": 50.0, "elbow": 22.0, "wrist_1": 5.0, "wrist_2": 1.5, "wrist_3": 1.2},
    "leg": {"hip_roll": 2.0, "hip_pitch": 3.5, "knee": 1.2},
    "crane": {"rail": 6.0},
}
"""Torque, N m or N, that the motions of the trial take, roughly."""


def machine_of(robot: str, tolerance: float, random: np.random.Generator) -> Any:
    """Return a model whose masses, lengths and gains lie within a tolerance, stepped twice as finely."""
    kind = ROBOTS[robot]
    spec = mujoco.MjSpec.from_string(kind.xml)
    for body in spec.bodies[1:]:
        body.gravcomp = 1e-12  # or MuJoCo leaves it out for good
    for actuator in spec.actuators:
        if actuator.name in kind.gains:
            kp, kd = kind.gains[actuator.name]
            actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
            gain, bias = np.zeros_like(actuator.gainprm), np.zeros_like(actuator.biasprm)
            gain[0], bias[1], bias[2] = kp, -kp, -kd
            actuator.gainprm, actuator.biasprm = gain, bias
    model = spec.compile()
    model.opt.timestep *= 0.5
    for number in range(1, model.nbody):
        mass, length = 1.0 + random.uniform(-tolerance, tolerance, 2)
        length = 1.0 + 0.5 * (length - 1.0)
        model.body_mass[number] *= mass
        model.body_inertia[number] *= mass * length**2
        model.body_ipos[number] *= length
        model.body_pos[model.body_parentid == number] *= length
    for number in range(model.nu):
        scale = 1.0 + random.uniform(-tolerance, tolerance)
        model.actuator_gainprm[number] *= scale
        model.actuator_biasprm[number] *= scale
    return model


def motion(robot: str, duration_s: float, random: np.random.Generator) -> tuple[Array, Array]:
    """Return times, s, and set points of a motion: sines and ramps, shape (n, driven)."""
    kind = ROBOTS[robot]
    time_s = np.arange(0.0, duration_s, 1.0 / kind.command_hz)
    columns = []
    for centre, swing in zip(kind.centre, kind.swing, strict=True):
        hertz, phase, size = random.uniform(0.2, 0.9), random.uniform(0.0, 6.3), swing * random.uniform(0.5, 1.0)
        wave = np.sin(2.0 * np.pi * hertz * time_s + phase)
        if random.uniform() < 0.4:  # noqa: PLR2004 - ramps now and then
            wave = 2.0 / np.pi * np.arcsin(wave)
        columns.append(centre + size * wave)
    grown = np.minimum(time_s / 0.5, 1.0)[:, np.newaxis]
    return time_s, np.column_stack(columns) * grown


class _Plant:
    """A machine that runs: drives, friction and torque beside its model."""

    def __init__(self, kind: Kind, model: Any, fault: Fault) -> None:
        self.model, self.kind, self.fault = model, kind, fault
        self.data = mujoco.MjData(model)
        mujoco.mj_setConst(model, self.data)
        self.angles = [int(model.joint(name).qposadr[0]) for name in kind.measured]
        self.driven = [kind.measured.index(name) for name in kind.driven]
        self.turned = [self.angles[k] for k in self.driven]
        self.dofs = [int(model.joint(name).dofadr[0]) for name in kind.driven]
        self.actuators = [int(model.actuator(name).id) for name in kind.driven]
        self.scale = self._by(kind.measured, fault.scale, 1.0)
        self.offset = self._by(kind.measured, fault.offset, 0.0)
        self.half = 0.5 * self._by(kind.driven, fault.slack, 0.0)
        self.load = self._by(kind.driven, fault.load, 0.0)
        self.cogging = self._by(kind.driven, fault.cogging, 0.0)
        self.spring = self._by(kind.driven, fault.spring, 0.0)
        self.still = np.array([fault.stribeck.get(name, (0.0, 1.0)) for name in kind.driven])
        self.dry = model.dof_frictionloss[self.dofs].copy()
        self.gain, self.bias = model.actuator_gainprm.copy(), model.actuator_biasprm.copy()

    @staticmethod
    def _by(names: tuple[str, ...], given: Mapping[str, float], otherwise: float) -> Array:
        return np.array([given.get(name, otherwise) for name in names])

    def step(self, set_point: Array, rate: Array, share: float) -> tuple[Array, Array]:
        """Take a step and return what encoders read before it, and efforts; `share`: of the recording that is over."""
        model, data, fault = self.model, self.data, self.fault
        lost = np.zeros(len(self.dofs))
        if self.kind.quantity == "position":
            forward = -fault.forward * rate * self.bias[self.actuators, 2] / self.gain[self.actuators, 0]
            set_point = (set_point + forward - self.offset[self.driven]) / self.scale[self.driven]
            lost = np.clip(set_point - data.qpos[self.turned], -self.half, self.half)
        left = 1.0 - fault.fading * share
        model.actuator_gainprm[:], model.actuator_biasprm[:] = self.gain * left, self.bias * left
        carried = 0.5 * np.abs(data.qfrc_actuator[self.dofs] + data.qfrc_bias[self.dofs])
        falling = self.still[:, 0] * np.exp(-np.square(data.qvel[self.dofs] / self.still[:, 1]))
        model.dof_frictionloss[self.dofs] = self.dry + falling + self.load * carried
        here = data.qpos[self.turned]
        pull = self.spring * (here - np.array(self.kind.centre))
        data.qfrc_applied[self.dofs] = self.cogging * np.sin(12.0 * here) - pull
        position = self.scale * data.qpos[self.angles] + self.offset
        position[self.driven] += lost
        effort = data.qfrc_actuator[self.dofs].copy()
        data.ctrl[self.actuators] = set_point - lost
        mujoco.mj_step(model, data)
        return position, effort


def record(robot: str, model: Any, fault: Fault, duration_s: float, random: np.random.Generator) -> dict[str, Array]:
    """Return what a machine records of a motion: `time_s`, `JOINT.position`, `JOINT.effort`, `command.JOINT.*`.

    Commands stand at the times of the readings, as they were in force when they were issued.
    """
    kind = ROBOTS[robot]
    issued_s, asked = motion(robot, duration_s, random)
    arrives_s = np.maximum.accumulate(issued_s + fault.late_s + random.uniform(0.0, 0.002, issued_s.size))
    arrived = random.uniform(size=issued_s.size) >= fault.lost
    plant = _Plant(kind, copy.copy(model), fault)
    step_s = float(model.opt.timestep)
    count = int(duration_s / step_s)
    position, effort = np.empty((count, len(kind.measured))), np.empty((count, len(kind.driven)))
    place, smooth, target, rate = 0, asked[0].copy(), asked[0].copy(), np.zeros(len(kind.driven))
    for k in range(count):
        while place + 1 < issued_s.size and arrives_s[place + 1] <= k * step_s:
            place += 1
            if arrived[place]:
                rate = (asked[place] - target) * kind.command_hz
                target = asked[place].copy()
        smooth += (target - smooth) * (1.0 if fault.lag_s == 0.0 else step_s / fault.lag_s)
        position[k], effort[k] = plant.step(smooth, rate, k / count)
    # What a recorder writes of a reading and of a command that are made in one cycle stands at one time.
    times = np.arange(10, int(kind.record_hz * (duration_s - 0.05))) / kind.record_hz
    taken = times + random.uniform(-0.0005, 0.0005, times.size) - fault.readings_late_s
    ticks = step_s * np.arange(count)
    found = {"time_s": times}
    for column, name in enumerate(kind.measured):
        read = np.interp(taken, ticks, position[:, column]) + random.normal(0.0, 0.3 * kind.step, times.size)
        found[f"{name}.position"] = np.round(read / kind.step) * kind.step
    last = np.clip(np.searchsorted(issued_s, times + 1e-6, side="right") - 1, 0, None)
    for column, name in enumerate(kind.driven):
        read = np.interp(taken, ticks, effort[:, column]) * fault.effort_scale.get(name, 1.0)
        found[f"{name}.effort"] = read + random.normal(0.0, kind.effort_noise, times.size)
        found[f"command.{name}.{kind.quantity}"] = asked[last, column]
    return found
