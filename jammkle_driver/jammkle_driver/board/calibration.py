"""Two-point calibration of every sensor: numbers at ambient pressure and at a vacuum that somebody reads on a gauge."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import yaml

from jammkle_driver.core.registers import register_list

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from jammkle_driver.board.line import Line
    from jammkle_driver.board.wiring import Wiring

LEAST_VACUUM_PA = 20e3
"""Two points that lie closer make a line that is wrong at its far end by several times their own error."""

_LEAST_STEPS = 10.0

AIR_PA = (50e3, 110e3)
"""Pressures of the air that can be, Pa absolute: from 5500 m to below the sea, as for the driver's parameter."""


class CalibrationError(ValueError):
    """Two points that make no line. One line of text."""


@dataclass(frozen=True)
class SensorLine:
    """A sensor's straight line through two points.

    Attributes:
        low: Smaller number of its register, and the pressure there, Pa.
        high: Larger number, and the pressure there, Pa.

    """

    low: tuple[float, float]
    high: tuple[float, float]

    @property
    def scale(self) -> float:
        """Pa per step."""
        return (self.high[1] - self.low[1]) / (self.high[0] - self.low[0])

    @property
    def offset_pa(self) -> float:
        """Pa at number 0."""
        return self.low[1] - self.scale * self.low[0]


def sensor_lines(
    first: Mapping[str, float], first_pa: float, second: Mapping[str, float], second_pa: float
) -> dict[str, SensorLine]:
    """Return each sensor's line from its numbers at two pressures, Pa.

    Raises:
        CalibrationError: a pressure cannot be, they are too close, or a sensor does not follow.

    """
    if not AIR_PA[0] <= first_pa <= AIR_PA[1]:
        low_kpa, high_kpa = AIR_PA[0] / 1e3, AIR_PA[1] / 1e3
        msg = f"the air is at {first_pa / 1e3:g} kPa; it must be {low_kpa:g} to {high_kpa:g} kPa, absolute"
        raise CalibrationError(msg)
    if not 0.0 <= second_pa <= AIR_PA[1]:
        msg = f"the gauge leaves {second_pa / 1e3:g} kPa of the air; it reads vacuum in kPa, less than the air itself"
        raise CalibrationError(msg)
    if abs(first_pa - second_pa) < LEAST_VACUUM_PA:
        msg = (
            f"the two points are {abs(first_pa - second_pa) / 1e3:.1f} kPa apart; at least {LEAST_VACUUM_PA / 1e3:.0f}"
        )
        raise CalibrationError(msg)
    lines = {}
    for place, number in first.items():
        if abs(number - second[place]) < _LEAST_STEPS:
            msg = f"sensor {place} reads {number:.0f} at both pressures: it does not measure"
            raise CalibrationError(msg)
        low, high = sorted(((number, first_pa), (second[place], second_pa)))
        lines[place] = SensorLine(low, high)
    return lines


async def raw_numbers(line: Line, wiring: Wiring) -> dict[str, int]:
    """Return what the converter of the project's firmware reads for each sensor, before any calibration."""
    registers = register_list()
    first = registers.input("pressure_1").address
    numbers = await line.read("input", registers.input("raw_1").address, len(registers.tables["coils"]) + 1)
    return {place: numbers[sensor.register - first] for place, sensor in wiring.sensors.items()}


async def store(line: Line, wiring: Wiring, lines: Mapping[str, SensorLine]) -> None:
    """Write the points to a board with the project's firmware, which keeps them over a reset."""
    registers = register_list()
    for place, found in lines.items():
        sensor = wiring.sensors[place].register - registers.input("pressure_1").address + 1
        first = registers.holding(f"sensor_{sensor}_raw_low")
        pressure = registers.holding(f"sensor_{sensor}_pressure_low")
        points = [first.steps(found.low[0]), pressure.steps(found.low[1])]
        points += [first.steps(found.high[0]), pressure.steps(found.high[1])]
        await line.write(first.address, points)
    await line.write_register(registers.holding("store").address, 1)


def write_board_file(source: Path, target: Path, lines: Mapping[str, SensorLine]) -> None:
    """Write a copy of a board file with new scale and offset of each sensor; comments do not come along.

    Raises:
        OSError: it cannot be written.

    """
    content: dict[str, Any] = yaml.safe_load(source.read_text(encoding="utf-8"))
    for place, found in lines.items():
        content["sensors"][place] |= {"scale": found.scale, "offset_pa": found.offset_pa, "vacuum": False}
    target.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
