"""What can be wrong with sensors, clocks, links and firmware."""

from __future__ import annotations

import dataclasses
from functools import partial
from typing import TYPE_CHECKING

from jammkle_common.names import CHANNELS
from studies.blind.reality.faults import Fault, FaultParameter
from studies.blind.reality.places import MANIFOLD, plus, times, with_clock, with_imu, with_pressure_sensor, with_sensors

if TYPE_CHECKING:
    from collections.abc import Mapping

    from studies.blind.reality.instruments import Sensor, Sensors
    from studies.blind.reality.machine import Machine

_ALL = ("tensile", "pressure", "drop", "slip", "landing")
_PULLED = ("tensile", "slip", "drop", "landing")
_MOVED = ("drop", "slip", "landing")
_PLACES = (MANIFOLD, *CHANNELS)
_JOINTS = ("tension", "extension", "slide", "angle")


def _pressure_offset(place: str, machine: Machine, values: Mapping[str, float]) -> Machine:
    return with_pressure_sensor(machine, place, lambda sensor: plus(sensor, offset=values["offset_pa"]))


def _later(sensors: Sensors, fields: tuple[str, ...], delay_s: float) -> Sensors:
    """Let sensors read what was, as behind a filter."""
    changed = {name: plus(getattr(sensors, name), delay_s=delay_s) for name in fields}
    return dataclasses.replace(sensors, **changed)


def _late_pressures(machine: Machine, values: Mapping[str, float]) -> Machine:
    def change(sensors: Sensors) -> Sensors:
        late = tuple(plus(each, delay_s=values["delay_s"]) for each in sensors.pressure)
        return dataclasses.replace(sensors, pressure=late)

    return with_sensors(machine, change)


def _late(fields: tuple[str, ...], machine: Machine, values: Mapping[str, float]) -> Machine:
    return with_sensors(machine, lambda sensors: _later(sensors, fields, values["delay_s"]))


def _late_all(machine: Machine, values: Mapping[str, float]) -> Machine:
    return _late((*_JOINTS, "load_cell", "imu"), _late_pressures(machine, values), values)


def _late_commands(machine: Machine, values: Mapping[str, float]) -> Machine:
    return with_clock(machine, lambda clock: plus(clock, command_delay_s=values["delay_s"]))


def _skewed(machine: Machine, values: Mapping[str, float]) -> Machine:
    return with_clock(machine, lambda clock: plus(clock, skew=values["skew"]))


def _gain(machine: Machine, values: Mapping[str, float]) -> Machine:
    return with_sensors(machine, lambda each: dataclasses.replace(each, load_cell=times(each.load_cell, **values)))


def _spikes(machine: Machine, values: Mapping[str, float]) -> Machine:
    """Sparks of a motor beside the cable."""
    return with_sensors(machine, lambda each: dataclasses.replace(each, spikes_hz=8.0, spike_n=values["spike_n"]))


def _creep(machine: Machine, values: Mapping[str, float]) -> Machine:
    """A badly glued strain gauge."""
    return with_sensors(machine, lambda each: plus(each, cell_creep=values["creep"]))


def _lost(machine: Machine, values: Mapping[str, float]) -> Machine:
    """A link that loses samples of all sensors."""
    return with_clock(machine, lambda clock: plus(clock, dropped=values["dropped"]))


def _hasty(machine: Machine, values: Mapping[str, float]) -> Machine:
    """Firmware with another gain: it commands otherwise, and the machine obeys."""
    return dataclasses.replace(machine, regulator=times(machine.regulator, gain_per_pa=values["gain"]))


def _pressure_gain(place: str, machine: Machine, values: Mapping[str, float]) -> Machine:
    """A pressure sensor with a wrong slope, right at the atmosphere of a standard day."""

    def change(sensor: Sensor) -> Sensor:
        return plus(times(sensor, gain=values["gain"]), offset=101_325.0 * (1.0 - values["gain"]))

    return with_pressure_sensor(machine, place, change)


def _imu_offset(machine: Machine, values: Mapping[str, float]) -> Machine:
    more = tuple(values[f"{axis}_m_s2"] for axis in "xyz")
    return with_imu(machine, lambda imu: dataclasses.replace(imu, offset_m_s2=_sum(imu.offset_m_s2, more)))


def _gyro_offset(machine: Machine, values: Mapping[str, float]) -> Machine:
    more = tuple(values[f"{axis}_rad_s"] for axis in "xyz")
    return with_imu(machine, lambda imu: dataclasses.replace(imu, offset_rad_s=_sum(imu.offset_rad_s, more)))


def _crooked(machine: Machine, values: Mapping[str, float]) -> Machine:
    more = tuple(values[f"{angle}_rad"] for angle in ("roll", "pitch", "yaw"))
    return with_imu(machine, lambda imu: dataclasses.replace(imu, turn_rad=_sum(imu.turn_rad, more)))


def _clipped(machine: Machine, values: Mapping[str, float]) -> Machine:
    return with_imu(machine, lambda imu: times(imu, clip=values["range"]))


def _sum(one: tuple[float, ...], other: tuple[float, ...]) -> tuple[float, float, float]:
    x, y, z = (a + b for a, b in zip(one, other, strict=True))
    return x, y, z


def _same(values: Mapping[str, float]) -> Mapping[str, float]:
    """The effect has the same parameters."""
    return dict(values)


def _faults() -> list[Fault]:
    delay = {"delay_s": FaultParameter("s", 0.0, 0.0, 0.15)}
    found = [
        Fault(
            f"pressure_reads_off_{place}",
            "sensing",
            _ALL,
            f"pressure_sensor_offset_{place}",
            {"offset_pa": FaultParameter("Pa", 0.0, -4.5e3, 4.5e3)},
            partial(_pressure_offset, place),
            _same,
        )
        for place in _PLACES
    ]
    found += [
        Fault(
            f"pressure_slope_{place}",
            "sensing",
            _ALL,
            None,
            {"gain": FaultParameter("1", 1.0, 0.85, 1.15)},
            partial(_pressure_gain, place),
        )
        for place in _PLACES
    ]
    found += [
        Fault("late_commands", "timing", _ALL, "command_delay", delay, _late_commands, _same),
        Fault("late_pressures", "timing", _ALL, "pressure_delay", delay, _late_pressures, _same),
        Fault("late_joints", "timing", _ALL, "joint_delay", delay, partial(_late, _JOINTS), _same),
        Fault("late_load_cell", "timing", _PULLED, "load_cell_delay", delay, partial(_late, ("load_cell",)), _same),
        Fault("late_imu", "timing", _MOVED, "imu_delay", delay, partial(_late, ("imu",)), _same),
        Fault("late_sensors", "timing", _ALL, "sensor_delay", delay, _late_all, _same),
        Fault(
            "clocks_drift",
            "timing",
            _ALL,
            "clock_skew",
            {"skew": FaultParameter("1", 0.0, -0.018, 0.018)},
            _skewed,
            _same,
        ),
        Fault(
            "load_cell_gain",
            "sensing",
            _PULLED,
            "load_cell_gain",
            {"gain": FaultParameter("1", 1.0, 0.55, 1.45)},
            _gain,
            _same,
        ),
        Fault(
            "imu_offset",
            "sensing",
            _MOVED,
            "imu_offset",
            {f"{axis}_m_s2": FaultParameter("m/s2", 0.0, -2.7, 2.7) for axis in "xyz"},
            _imu_offset,
            _same,
        ),
        Fault(
            "gyro_offset",
            "sensing",
            _MOVED,
            "gyro_offset",
            {f"{axis}_rad_s": FaultParameter("rad/s", 0.0, -0.45, 0.45) for axis in "xyz"},
            _gyro_offset,
            _same,
        ),
        Fault(
            "crooked_imu",
            "sensing",
            _MOVED,
            "imu_misalignment",
            {f"{angle}_rad": FaultParameter("rad", 0.0, -0.3, 0.3) for angle in ("roll", "pitch", "yaw")},
            _crooked,
            _same,
        ),
        Fault(
            "imu_clips",
            "sensing",
            _MOVED,
            "imu_saturation",
            {"range": FaultParameter("1", 1.0, 0.12, 2.4)},
            _clipped,
            lambda values: {"range_scale": values["range"]},
        ),
        Fault("load_cell_spikes", "sensing", _PULLED, None, {"spike_n": FaultParameter("N", 0.0, 0.0, 20.0)}, _spikes),
        Fault("load_cell_creeps", "sensing", _PULLED, None, {"creep": FaultParameter("1", 0.0, -0.2, 0.2)}, _creep),
        Fault("lost_samples", "timing", _ALL, None, {"dropped": FaultParameter("1", 0.0, 0.0, 0.5)}, _lost),
        Fault("hasty_regulator", "timing", _ALL, None, {"gain": FaultParameter("1", 1.0, 0.1, 6.0)}, _hasty),
    ]
    return found


SENSING_FAULTS: Mapping[str, Fault] = {fault.name: fault for fault in _faults()}
"""By name."""
