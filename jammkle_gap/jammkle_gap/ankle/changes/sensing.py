"""Changes to sensors, delays and clocks."""

from __future__ import annotations

import copy
import dataclasses
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_sim.rigs.rig import ACCELEROMETER, laws_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from jammkle_sim.rigs.rig import Rig

_ACCELERATION, _RATE = slice(0, 3), slice(3, 6)
"""Axes of the IMU."""


def offset_imu(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Let the accelerometer read `x_m_s2`, `y_m_s2` and `z_m_s2` too much."""
    return _with_imu(rig, lambda law: _add(law["offset"][_ACCELERATION], values, "m_s2"))


def offset_gyro(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Let the gyro read `x_rad_s`, `y_rad_s` and `z_rad_s` too much."""
    return _with_imu(rig, lambda law: _add(law["offset"][_RATE], values, "rad_s"))


def misalign_imu(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Turn the IMU on its mount by `roll_rad`, then `pitch_rad`, then `yaw_rad`, about the mount's axes."""
    turn = np.eye(3)
    for axis, name in enumerate(("roll_rad", "pitch_rad", "yaw_rad")):
        turn = _about(axis, values.get(name, 0.0)) @ turn

    def change(law: Any) -> None:
        law["turn"] = turn.T @ law["turn"]

    return _with_imu(rig, change)


def saturate_imu(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Scale the range of the accelerometer by `range_scale`."""

    def change(law: Any) -> None:
        law["limit"][_ACCELERATION] *= values["range_scale"]

    return _with_imu(rig, change)


def scale_load_cell(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Scale what the load cell reads by `gain`."""
    return _rewired(rig, load_cell_gain=rig.wiring.load_cell_gain * values["gain"])


def skew_clock(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Let the sensors' clock run faster by `skew`."""
    return _rewired(rig, clock_skew=rig.wiring.clock_skew + values["skew"])


def delay_commands(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Let commands arrive `delay_s` later."""
    return _rewired(rig, command_delay_s=rig.wiring.command_delay_s + values["delay_s"])


def delay_pressures(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Let pressures be read `delay_s` late."""
    return _later(rig, values, "pressure_delay_s")


def delay_imu(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Let the IMU be read `delay_s` late."""
    return _later(rig, values, "imu_delay_s")


def delay_joints(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Let joints and tendons be read `delay_s` late."""
    return _later(rig, values, "joint_delay_s")


def delay_load_cell(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Let the load cell be read `delay_s` late."""
    return _later(rig, values, "load_cell_delay_s")


def delay_sensors(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Let every sensor be read `delay_s` late."""
    return _later(rig, values, "pressure_delay_s", "imu_delay_s", "joint_delay_s", "load_cell_delay_s")


def _later(rig: Rig, values: Mapping[str, float], *fields: str) -> Rig:
    return _rewired(rig, **{field: getattr(rig.wiring, field) + values["delay_s"] for field in fields})


def _rewired(rig: Rig, **fields: float) -> Rig:
    return dataclasses.replace(rig, wiring=dataclasses.replace(rig.wiring, **fields))  # type: ignore[arg-type]  # all of them are numbers


def _with_imu(rig: Rig, change: Callable[[Any], None]) -> Rig:
    """Change the IMU's law, and take MuJoCo's own limit away, which acts before turn and offset."""
    law = laws_of(rig).imu.copy()
    change(law[0])
    sensor = rig.model.sensor(ACCELEROMETER).id
    if rig.model.sensor_cutoff[sensor] == 0.0:
        return dataclasses.replace(rig, imu_law=law)
    model = copy.copy(rig.model)
    model.sensor_cutoff[sensor] = 0.0
    return dataclasses.replace(rig, imu_law=law, model=model)


def _add(to: Any, values: Mapping[str, float], unit: str) -> None:
    to += [values[f"{axis}_{unit}"] for axis in "xyz"]


def _about(axis: int, angle_rad: float) -> Any:
    """Return the matrix that turns a vector about an axis."""
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[first, first] = turn[second, second] = cosine
    turn[first, second], turn[second, first] = -sine, sine
    return turn
