"""Nonidealities of a robot that MJCF cannot describe: delays, backlash, errors of encoders and other sensors.

A corrected model has them in a text of its own. Their formulas stand here once, for the simulator that diagnoses and
for the `Modifier` of a corrected model.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, field, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.mujoco.drives import joints_of
from jammkle_gap.mujoco.runs import BadRobotError, Gains
from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.mujoco.runs import Sense

    Array = NDArray[np.float64]

TEXT_NAME = "jammkle"
"""Of the text of a model that has them, as JSON."""
_GAINS = "gains"
"""Its key of controllers outside of the model."""
_LENGTHS = {"stribeck": 2, "sensor_offset": 3, "sensor_turn": 3}
"""Of fields that have several numbers each."""
_BY_SENSOR = ("sensor_offset", "sensor_scale", "sensor_turn")
_POSITIVE = ("scale",)
_NOT_NEGATIVE = ("set_point_lag_s", "slack", "compliance")


@dataclass(kw_only=True)
class Nonidealities:
    """What of drives, sensors and clocks MJCF cannot describe."""

    delay_s: float = 0.0
    """Of commands, or of all readings: no recording tells which. Without drives: of positions behind efforts. s."""
    arrival_s: float = 0.0
    """By which commands arrive later than they are stamped, s."""
    effort_delay_s: float = 0.0
    """Of efforts behind positions of the same stamp, s."""
    clock_rate: float = 0.0
    """By which share the clock of the readings runs faster than that of the commands."""
    set_point_lag_s: dict[str, float] = field(default_factory=dict)
    """By joint, as what follows."""
    forward_share: dict[str, float] = field(default_factory=dict)
    """Of the set point's rate that the drive feeds forward."""
    slack: dict[str, float] = field(default_factory=dict)
    """Width of a backlash."""
    compliance: dict[str, float] = field(default_factory=dict)
    """Of a transmission, rad/(N m) or m/N."""
    offset: dict[str, float] = field(default_factory=dict)
    """Reading of an encoder where the joint is at 0, rad or m."""
    scale: dict[str, float] = field(default_factory=dict)
    """Reading of an encoder per motion of the joint."""
    reading_offset: dict[str, float] = field(default_factory=dict)
    """Of the positions that are recorded, beside what the drive itself regulates, rad or m."""
    fed_share: dict[str, float] = field(default_factory=dict)
    """Of a commanded effort that arrives at the joint, as torque constant and transmission have it."""
    effort_scale: dict[str, float] = field(default_factory=dict)
    """Reading of an effort per effort."""
    stribeck: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Friction at rest beyond that in motion, N m or N, and the speed at which it is gone."""
    load_friction: dict[str, float] = field(default_factory=dict)
    """Friction per transmitted effort."""
    sensor_offset: dict[str, tuple[float, ...]] = field(default_factory=dict)
    """By signal of a sensor without its axis, along all axes."""
    sensor_scale: dict[str, float] = field(default_factory=dict)
    """By the same."""
    sensor_turn: dict[str, tuple[float, ...]] = field(default_factory=dict)
    """By site, vector by which the sensor there is turned in its place, rad."""

    def read_position(self, joint: str, position: Any, effort: Any) -> Any:
        """Return what is read of a joint, rad or m.

        Args:
            joint: Whose encoder it is.
            position: Of the motor, behind a backlash; a number, or an array of any shape; rad or m.
            effort: That the transmission carries, of the same shape; it counts where there is a compliance; N m or N.

        """
        if joint in self.compliance:
            position = position + self.compliance[joint] * effort
        zero = self.offset.get(joint, 0.0) + self.reading_offset.get(joint, 0.0)
        return self.scale.get(joint, 1.0) * position + zero

    def read_sensor(self, site: str, sense: Sense, own: Array) -> Array:
        """Return what a sensor at a site reads, from what it would without errors; shapes (..., 3)."""
        name = f"{site}/{sense.value}"
        if site in self.sensor_turn:
            own = own @ Rotation.from_rotvec(self.sensor_turn[site]).as_matrix()
        zero = np.array(self.sensor_offset.get(name, (0.0, 0.0, 0.0)))
        found: Array = self.sensor_scale.get(name, 1.0) * own + zero
        return found

    def friction_rows(self, model: mujoco.MjModel) -> list[tuple[int, float, float, float, float]]:
        """Return what `update_friction` needs of joints whose friction changes within a run."""
        found = []
        for joint in dict.fromkeys((*self.stribeck, *self.load_friction)):
            dof = int(model.joint(joint).dofadr[0])
            still, speed = self.stribeck.get(joint, (0.0, 1.0))
            found.append((dof, float(model.dof_frictionloss[dof]), still, speed, self.load_friction.get(joint, 0.0)))
        return found


def update_friction(
    rows: Sequence[tuple[int, float, float, float, float]], friction: Array, driving: Array, bias: Array, rates: Array
) -> None:
    """Write the friction of the next step.

    Args:
        rows: Of `Nonidealities.friction_rows`.
        friction: The model's, which is written, shape (degrees of freedom,), as what follows; N m or N.
        driving: Efforts of drives.
        bias: Efforts of gravity and of what turns.
        rates: Velocities, rad/s or m/s.

    """
    for dof, dry, still, speed, share in rows:
        rubs = dry + share * 0.5 * abs(driving[dof] + bias[dof])
        if still > 0.0:
            rubs += still * math.exp(-((rates[dof] / speed) ** 2))
        friction[dof] = rubs


def backlash_offset(asked: float, angle: float, half: float) -> float:
    """Return by how much a motor turns against its load: by half the backlash before it moves it; rad or m."""
    return min(max(asked - angle, -half), half)


def text_of(rest: Mapping[str, Any], gains: Mapping[str, Gains]) -> str:
    """Return the text for a model; empty where there is nothing to say."""
    table = {**rest, **({_GAINS: {joint: asdict(each) for joint, each in gains.items()}} if gains else {})}
    return json.dumps(table) if table else ""


def nonidealities_of(model: mujoco.MjModel) -> tuple[Nonidealities, dict[str, Gains]]:
    """Return what the text of a model says, and the gains of controllers outside of it; nothing without a text.

    Raises:
        BadRobotError: the text is damaged, or of another model.

    """
    number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TEXT, TEXT_NAME)
    if number < 0:
        return Nonidealities(), {}
    start = int(model.text_adr[number])
    written = bytes(model.text_data[start : start + int(model.text_size[number])]).rstrip(b"\0")
    try:
        table = dict(json.loads(written.decode()))
        gains = {}
        for joint, each in table.pop(_GAINS, {}).items():
            _check_key(model, _GAINS, joint)
            gains[joint] = Gains(*(_number(f"{name} of joint {joint}", each[name]) for name in ("kp", "kd")))
        return Nonidealities(**{name: _field(model, name, value) for name, value in table.items()}), gains
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        msg = f"text {TEXT_NAME} of the model cannot be used: {' '.join(str(error).split())}"
        msg += "; load the corrected model as it was written, or delete this text in it"
        raise BadRobotError(msg) from error


def _field(model: mujoco.MjModel, name: str, value: Any) -> Any:
    """Return the value of a field as `Nonidealities` has it."""
    known = {each.name: each for each in fields(Nonidealities)}
    if name not in known:
        msg = f"it has the key '{name}'; it may have: {', '.join((*known, _GAINS))}"
        raise ValueError(msg)
    if known[name].default == 0.0:
        return _number(name, value)
    found: dict[str, Any] = {}
    for key, own in value.items():
        _check_key(model, name, key)
        if name not in _LENGTHS:
            found[key] = _number(name, own, f" of {key}")
            continue
        if len(own) != _LENGTHS[name]:
            msg = f"{name} of {key} is {own}, which must have {_LENGTHS[name]} numbers"
            raise ValueError(msg)
        found[key] = tuple(_number(name, each, f" of {key}") for each in own)
        if name == "stribeck" and found[key][1] <= 0.0:
            msg = f"the speed of {name} of {key} is {found[key][1]:g}, which must be above 0"
            raise ValueError(msg)
    return found


def _number(name: str, value: Any, whose: str = "") -> float:
    limit = "above 0" if name in _POSITIVE else "at least 0" if name in _NOT_NEGATIVE else "finite"
    good = isinstance(value, (int, float)) and math.isfinite(value)
    if not good or (name in _POSITIVE and value <= 0.0) or (name in _NOT_NEGATIVE and value < 0.0):
        msg = f"{name}{whose} is {value!r}, which must be a number, {limit}"
        raise ValueError(msg)
    return float(value)


def _check_key(model: mujoco.MjModel, name: str, key: str) -> None:
    """Refuse a joint or a site that the model has not."""
    if name in _BY_SENSOR:
        what, known = "site", [model.site(k).name for k in range(model.nsite)]
        key = key if name == "sensor_turn" else key.rpartition("/")[0]
    else:
        what, known = "joint", joints_of(model)
    if key not in known:
        msg = f"{name} names {what} {key}, which the model has not; it has: {', '.join(known) or 'none'}"
        raise ValueError(msg)
