"""Effects, the library that offers them, and nuisances: what may differ, and what nobody asks about."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


class BadEffectError(ValueError):
    """An entry of the library cannot be used; the message names it and says what is missing."""


@dataclass(frozen=True)
class EffectParameter:
    """One bounded number of an effect."""

    name: str
    unit: str
    null: float
    """Value at which the effect is off: the simulation is then exactly the nominal one."""
    minimum: float
    maximum: float
    source: str
    """Where the bounds come from."""
    shares: tuple[float, ...] = field(default=(), kw_only=True)
    """Parts of the way from null to a bound, rising to 1, at which a search simulates it; empty: few, about geometric.
    For an effect that is none until far from null."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            BadEffectError: a bound is missing, the bounds are the wrong way round, or the null value lies outside.

        """
        if not all(map(math.isfinite, (self.null, self.minimum, self.maximum))):
            msg = f"parameter '{self.name}' has no finite bounds ({self.minimum} to {self.maximum}, null {self.null})"
            msg = f"{msg}; give minimum, maximum and null"
            raise BadEffectError(msg)
        if self.minimum >= self.maximum:
            msg = f"parameter '{self.name}' has its minimum {self.minimum:g} not below its maximum {self.maximum:g}"
            msg = f"{msg}; give the smaller number as minimum"
            raise BadEffectError(msg)
        if not self.minimum <= self.null <= self.maximum:
            bounds = f"{self.minimum:g} to {self.maximum:g}"
            msg = f"parameter '{self.name}' is off at {self.null:g}, outside its bounds {bounds}"
            raise BadEffectError(msg)


@dataclass(frozen=True)
class Effect:
    """A possible cause of a gap."""

    name: str
    """Such as `line_leak_achilles`; lower case with underscores."""
    subsystem: str
    """Such as `pneumatics`."""
    parameters: tuple[EffectParameter, ...]
    """One to three."""
    sentence: str
    """What it is and what to check, for a technician."""

    def __post_init__(self) -> None:
        """Check that there is something to fit.

        Raises:
            BadEffectError: no parameters.

        """
        if not self.parameters:
            msg = f"effect '{self.name}' has no parameters; give one to three with bounds"
            raise BadEffectError(msg)

    @property
    def version(self) -> str:
        """What tells its simulation from another one's of this name, for what is kept on disk; empty: nothing does."""
        return ""

    def key(self, parameter: EffectParameter) -> str:
        """Return the name of a parameter among all effects: `effect.parameter`."""
        return f"{self.name}.{parameter.name}"


@dataclass(frozen=True)
class Nuisance:
    """A number of the simulator that nobody asks about, but that no run or no machine has quite the same.

    Either scatter from run to run (what a rig cannot set exactly), or a constant of the machine within the tolerances
    of its drawings and data sheets.
    """

    name: str
    """Key by which the simulator takes it, such as `start.time_s`."""
    unit: str
    null: float
    """Where the simulator stands."""
    sigma: float
    """Standard deviation of its prior, in `unit`."""
    source: str
    """Where `sigma` comes from."""
    minimum: float = -math.inf
    maximum: float = math.inf

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            BadEffectError: `sigma` is not a positive finite number, or `null` lies outside its bounds.

        """
        if not (math.isfinite(self.sigma) and self.sigma > 0.0):
            msg = f"nuisance '{self.name}' has the standard deviation {self.sigma}; give a finite number above 0"
            raise BadEffectError(msg)
        if not self.minimum <= self.null <= self.maximum:
            msg = f"nuisance '{self.name}' stands at {self.null:g}, outside {self.minimum:g} to {self.maximum:g}"
            raise BadEffectError(msg)

    def step_from(self, value: float) -> float:
        """Return a step of one standard deviation from a value that stays within the bounds: 1, or -1."""
        return 1.0 if value + self.sigma <= self.maximum else -1.0


@dataclass(frozen=True)
class Library:
    """Effects offered to a diagnosis, by unique names."""

    effects: tuple[Effect, ...]

    def __post_init__(self) -> None:
        """Check the names.

        Raises:
            BadEffectError: a name stands twice.

        """
        names = [effect.name for effect in self.effects]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            msg = f"effect '{twice[0]}' stands in the library twice; give every effect a name of its own"
            raise BadEffectError(msg)

    def __iter__(self) -> Iterator[Effect]:
        """Every effect, in order."""
        return iter(self.effects)

    def effect(self, name: str) -> Effect:
        """Return one effect.

        Raises:
            BadEffectError: there is none of this name.

        """
        for effect in self.effects:
            if effect.name == name:
                return effect
        msg = f"effect '{name}' is not in the library; it has: {', '.join(effect.name for effect in self.effects)}"
        raise BadEffectError(msg)

    def parameters(self, names: Iterable[str]) -> tuple[tuple[str, EffectParameter], ...]:
        """Return keys and parameters of some effects, in the order of the names.

        Raises:
            BadEffectError: there is no such effect.

        """
        effects = [self.effect(name) for name in names]
        return tuple((effect.key(each), each) for effect in effects for each in effect.parameters)

    def without(self, name: str) -> Library:
        """Return the library without one effect."""
        return Library(tuple(effect for effect in self.effects if effect.name != name))
