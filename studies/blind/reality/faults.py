"""What can be wrong with the machine: every fault changes constants of a specimen, and at null changes nothing.

A fault names the effect of the library that it corresponds to, as plain text, or none where the library has no name for
it. Sizes are in the machine's own terms; `effect_values` says what the effect's parameters would be, where that has a
meaning. Faults of air, tendons, sensors and rig stand in `table`; those of bodies and floor elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from studies.blind.reality.machine import Machine

    Change = Callable[[Machine, Mapping[str, float]], Machine]
    Translation = Callable[[Mapping[str, float]], Mapping[str, float]]


class BadFaultError(ValueError):
    """There is no such fault, or its size is out of range. The message names value, limit and way out."""


@dataclass(frozen=True)
class FaultParameter:
    """One size of a fault."""

    unit: str
    null: float
    """Where the machine is in order."""
    minimum: float
    maximum: float


@dataclass(frozen=True)
class Fault:
    """Something that can be wrong."""

    name: str
    subsystem: str
    """Air, tendon, mechanics, sensing or timing."""
    rigs: tuple[str, ...]
    """Where it can show at all."""
    effect: str | None
    """Name of the library's effect, or None where the library has none."""
    parameters: Mapping[str, FaultParameter]
    change: Change
    effect_values: Translation | None = None
    """Makes the effect's parameters from the fault's, where the two can be compared."""

    def applied(self, machine: Machine, values: Mapping[str, float]) -> Machine:
        """Return the machine with this fault; the very same machine where every size is null.

        Raises:
            BadFaultError: a size that the fault does not have, or out of its range.

        """
        for name, value in values.items():
            if name not in self.parameters:
                msg = f"fault '{self.name}' has no '{name}'; it has {', '.join(self.parameters)}"
                raise BadFaultError(msg)
            row = self.parameters[name]
            if not row.minimum <= value <= row.maximum:
                msg = f"'{name}' of fault '{self.name}' is {value:g}; it must be {row.minimum:g} to {row.maximum:g}"
                msg = f"{msg} {row.unit}"
                raise BadFaultError(msg)
        sizes = {name: float(values.get(name, row.null)) for name, row in self.parameters.items()}
        if all(size == self.parameters[name].null for name, size in sizes.items()):
            return machine
        return self.change(machine, sizes)


@dataclass(frozen=True)
class FaultSetting:
    """One fault as it is in a run."""

    fault: str
    values: Mapping[str, float] = field(default_factory=dict)
    """By name of the parameter; those not given are null."""
    onset_s: float = 0.0
    """When it sets in, s since the start of the rig; 0 or less: it was always there."""


@dataclass(frozen=True)
class Era:
    """From a time on the machine is like this."""

    start_s: float
    machine: Machine


def eras(machine: Machine, settings: Sequence[FaultSetting], table: Mapping[str, Fault]) -> tuple[Era, ...]:
    """Return what the machine is like over a run, by rising start, the first at minus endless time.

    Raises:
        BadFaultError: there is no such fault, or its size is out of range.

    """
    for setting in settings:
        if setting.fault not in table:
            msg = f"fault '{setting.fault}' does not exist; known are: {', '.join(sorted(table))}"
            raise BadFaultError(msg)
    starts_s = [float("-inf"), *sorted({each.onset_s for each in settings if each.onset_s > 0.0})]
    found: list[Era] = []
    for start_s in starts_s:
        current = machine
        for setting in settings:
            if setting.onset_s <= max(start_s, 0.0):
                current = table[setting.fault].applied(current, setting.values)
        if not found or current != found[-1].machine:
            found.append(Era(start_s, current))
    return tuple(found)


def era_at(periods: Sequence[Era], time_s: float) -> Machine:
    """Return the machine as it is at a time."""
    current = periods[0].machine
    for period in periods:
        if period.start_s <= time_s:
            current = period.machine
    return current
