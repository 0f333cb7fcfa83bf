"""Change one part of a machine, such as one line or one tendon: the verbs that faults are made of."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any, TypeVar, cast

from jammkle_common.names import CHANNELS, TENDONS, TENDONS_OF_CHANNEL

if TYPE_CHECKING:
    from collections.abc import Callable

    from studies.blind.reality.instruments import Clock, Imu, Sensor, Sensors
    from studies.blind.reality.machine import Air, Line, Machine, Pump, TendonMake

P = TypeVar("P")

MANIFOLD = "manifold"
PAIRS = {
    "achilles_pair": TENDONS_OF_CHANNEL["achilles"],
    "peroneal_pair": (*TENDONS_OF_CHANNEL["peroneal_left"], *TENDONS_OF_CHANNEL["peroneal_right"]),
}
"""Tendons that are clamped together."""


def with_air(machine: Machine, change: Callable[[Air], Air]) -> Machine:
    """Return the machine with other air."""
    return dataclasses.replace(machine, air=change(machine.air))


def with_pump(machine: Machine, change: Callable[[Pump], Pump]) -> Machine:
    """Return the machine with another pump."""
    return with_air(machine, lambda air: dataclasses.replace(air, pump=change(air.pump)))


def with_lines(machine: Machine, channels: tuple[str, ...], change: Callable[[Line], Line]) -> Machine:
    """Return the machine with other lines of some channels."""

    def lines(air: Air) -> Air:
        changed = tuple(
            change(line) if channel in channels else line for channel, line in zip(CHANNELS, air.lines, strict=True)
        )
        return dataclasses.replace(air, lines=changed)

    return with_air(machine, lines)


def with_tendons(machine: Machine, place: str, change: Callable[[TendonMake], TendonMake]) -> Machine:
    """Return the machine with other tendons; no place means all of them, a place is one or a pair."""
    chosen = PAIRS.get(place, (place,)) if place else TENDONS
    changed = tuple(
        change(make) if name in chosen else make for name, make in zip(TENDONS, machine.tendons, strict=True)
    )
    return dataclasses.replace(machine, tendons=changed)


def with_sensors(machine: Machine, change: Callable[[Sensors], Sensors]) -> Machine:
    """Return the machine with other sensors."""
    return dataclasses.replace(machine, sensors=change(machine.sensors))


def with_imu(machine: Machine, change: Callable[[Imu], Imu]) -> Machine:
    """Return the machine with another IMU."""
    return with_sensors(machine, lambda sensors: dataclasses.replace(sensors, imu=change(sensors.imu)))


def with_clock(machine: Machine, change: Callable[[Clock], Clock]) -> Machine:
    """Return the machine with other clocks."""
    return with_sensors(machine, lambda sensors: dataclasses.replace(sensors, clock=change(sensors.clock)))


def with_pressure_sensor(machine: Machine, place: str, change: Callable[[Sensor], Sensor]) -> Machine:
    """Return the machine with another pressure sensor at the manifold or a channel."""
    index = (MANIFOLD, *CHANNELS).index(place)

    def swap(sensors: Sensors) -> Sensors:
        changed = tuple(change(each) if i == index else each for i, each in enumerate(sensors.pressure))
        return dataclasses.replace(sensors, pressure=changed)

    return with_sensors(machine, swap)


def plus(part: P, **additions: float) -> P:
    """Return a dataclass with something added to some fields."""
    changed = {name: getattr(part, name) + value for name, value in additions.items()}
    return cast("P", dataclasses.replace(cast("Any", part), **changed))


def times(part: P, **factors: float) -> P:
    """Return a dataclass with some fields multiplied."""
    changed = {name: getattr(part, name) * value for name, value in factors.items()}
    return cast("P", dataclasses.replace(cast("Any", part), **changed))
