"""Where the runs of a trial come from: the reality, or, on the lowest rung, the simulator that also diagnoses."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

from jammkle_common.parameters import from_mapping
from jammkle_gap.ankle.corrected import Correction
from jammkle_sim.rigs.catalogue import as_it_is, rig_kind, run_rig, scattered
from studies.blind.key import TrueEffect
from studies.blind.plan import FaultFact
from studies.blind.reality.faults import FaultSetting
from studies.blind.reality.record import RealRun, Track
from studies.blind.reality.run import RIGS as REAL_RIGS
from studies.blind.reality.run import run as run_reality
from studies.blind.reality.specimen import machine as specimen
from studies.blind.reality.table import FAULTS
from studies.blind.sizes import is_command

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_gap.core.effects import Effect, Library
    from studies.blind.reality.faults import Fault
    from studies.blind.reality.record import Plan

_LOCATIONS = {"air": ("pneumatics",), "sensing": ("sensing", "timing"), "timing": ("sensing", "timing")}
"""Subsystems of the library by those of the reality, where they are called otherwise. A delay is one of a sensor."""
_LOG_DELAY_S = (0.0005, 0.002)
"""From stamp to log in a bag of the lowest rung. Assumed."""
_DROPPED = 0.002
"""Share of the samples that a recorder of the lowest rung loses. Assumed, as in the reality."""


@dataclass(frozen=True)
class Wrong:
    """One thing that is wrong in a run."""

    fault: str
    values: Mapping[str, float]
    """By name of the parameter."""
    onset_s: float = 0.0
    """Since the start of the rig; 0: it was always there."""


@dataclass(frozen=True)
class SourceFault:
    """Something that can be wrong, as far as a trial has to know it."""

    fact: FaultFact
    location: tuple[str, ...]
    """Subsystems of the library that it may rightly be said to lie in."""
    ranges: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    """Null, minimum and maximum by name of the parameter."""

    def at(self, share: float, bounds: Mapping[str, float]) -> dict[str, float]:
        """Return its parameters at a share of the way from null to a bound each."""
        return {
            name: _within(null + share * (bounds[name] - null), minimum, maximum)
            for name, (null, minimum, maximum) in self.ranges.items()
        }

    def bounds(self, random: np.random.Generator) -> dict[str, float]:
        """Draw the direction in which it grows: some way to one of the bounds of every parameter."""
        found = {}
        for name, (null, minimum, maximum) in self.ranges.items():
            reach = np.array([null - minimum, maximum - null])
            # A bound next to null is no direction: `2 % more flow` where a fifth is left at the other end.
            sides = [side for side in range(2) if reach[side] > 0.2 * reach.max()]
            bound = (minimum, maximum)[int(random.choice(sides))]
            weight = 1.0 if len(self.ranges) == 1 else float(random.uniform(0.3, 1.0))
            found[name] = _within(null + weight * (bound - null), minimum, maximum)
        return found


def _within(value: float, minimum: float, maximum: float) -> float:
    """Return a value within a range that it may have left by rounding."""
    return min(max(value, minimum), maximum)


class Source(Protocol):
    """Makes runs."""

    @property
    def faults(self) -> Mapping[str, SourceFault]:
        """What can be wrong, by name."""

    @property
    def rigs(self) -> tuple[str, ...]:
        """What can be recorded."""

    def run(self, plan: Plan, machine: int, wrong: Sequence[Wrong], seed: int) -> RealRun:
        """Run a plan once on a specimen; the same seed gives the same noise, whatever is wrong."""

    def effects(self, wrong: Sequence[Wrong]) -> tuple[TrueEffect, ...]:
        """Return what the library calls it, as far as it does."""


class Reality:
    """The independent model."""

    def __init__(self) -> None:
        """Look at its table of faults."""
        self.faults: Mapping[str, SourceFault] = {name: _real_fault(fault) for name, fault in FAULTS.items()}
        self.rigs: tuple[str, ...] = tuple(REAL_RIGS)

    def run(self, plan: Plan, machine: int, wrong: Sequence[Wrong], seed: int) -> RealRun:
        """Run a plan once; see `Source`."""
        faults = [FaultSetting(each.fault, each.values, each.onset_s) for each in wrong]
        return run_reality(plan, specimen(machine), faults, seed)

    def effects(self, wrong: Sequence[Wrong]) -> tuple[TrueEffect, ...]:
        """Return what the library calls it; see `Source`."""
        found = []
        for each in wrong:
            fault = FAULTS[each.fault]
            if fault.effect is not None:
                values = fault.effect_values(each.values) if fault.effect_values is not None else {}
                found.append(TrueEffect(fault.effect, dict(values)))
        return tuple(found)


def _real_fault(fault: Fault) -> SourceFault:
    return SourceFault(
        FaultFact(fault.name, fault.effect, tuple(fault.rigs)),
        _LOCATIONS.get(fault.subsystem, (fault.subsystem,)),
        {name: (row.null, row.minimum, row.maximum) for name, row in fault.parameters.items()},
    )


class Simulator:
    """The simulator that also diagnoses, with effects of the library: the lowest rung."""

    def __init__(self, library: Library, rigs: Sequence[str]) -> None:
        """Take the library.

        Args:
            library: Effects of an ankle.
            rigs: What is recorded.

        """
        self._library = library
        self.rigs: tuple[str, ...] = tuple(rigs)
        self.faults: Mapping[str, SourceFault] = {effect.name: self._fault(effect) for effect in library}

    def run(self, plan: Plan, machine: int, wrong: Sequence[Wrong], seed: int) -> RealRun:
        """Run a plan once; see `Source`. What is wrong was always there."""
        values = {f"{each.fault}.{name}": value for each in wrong for name, value in each.values.items()}
        change = Correction(self._library, values) if values else as_it_is
        options = from_mapping(rig_kind(plan.rig).options, {**plan.options, "seed": machine})
        done = run_rig(plan.rig, scattered(plan.rig, options, seed), lambda _: None, lambda: False, change)
        random = np.random.default_rng([machine, seed])
        topics = {}
        for name, series in done.topics.items():
            count = len(series.time_s)
            log_s = np.maximum.accumulate(series.time_s + random.uniform(*_LOG_DELAY_S, count))
            kept = random.random(count) >= (0.0 if is_command(name) else _DROPPED)
            topics[name] = Track(series.columns, series.time_s[kept], log_s[kept], series.values[kept])
        return RealRun(plan, topics)

    def effects(self, wrong: Sequence[Wrong]) -> tuple[TrueEffect, ...]:
        """Return the effects; see `Source`."""
        return tuple(TrueEffect(each.fault, dict(each.values)) for each in wrong)

    def _fault(self, effect: Effect) -> SourceFault:
        ranges = {each.name: (each.null, each.minimum, each.maximum) for each in effect.parameters}
        location = _LOCATIONS.get(effect.subsystem, (effect.subsystem,))
        return SourceFault(FaultFact(effect.name, effect.name, self.rigs), location, ranges)
