"""Effects of an ankle: what the core fits, and the change to a rig or to its inputs that each one makes.

They are read from YAML, as are the constants of the machine and what scatters from run to run; how an entry is written
stands in `entries`.
"""

from __future__ import annotations

import copy
import dataclasses
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeVar

from jammkle_gap.ankle.entries import MACHINE, RUN, Entry, change_of, effect_files, entries_of, own_table, read_yaml
from jammkle_gap.ankle.inputs import AnkleInputs
from jammkle_gap.core.effects import BadEffectError, Effect, Library
from jammkle_sim.rigs.rig import Rig

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

T = TypeVar("T", Rig, AnkleInputs)


@dataclass(frozen=True)
class AnkleEffect(Effect):
    """An effect that changes a rig, or what it is given. Picklable, as it names its changes instead of holding them."""

    family: str
    """The entry that it comes from: `line_leak` of `line_leak_achilles`."""
    place: str
    """Where it acts, such as `achilles`; empty where there is only one place."""
    file: str
    """Python file with the changes; empty for the package's own."""
    function: str
    """Name there of the change to the rig; empty if it makes none."""
    input_function: str = ""
    """Name there of the change to the inputs; empty if it makes none."""

    def change(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        """Return the rig with the effect in it; the very same rig where all values are null.

        Args:
            rig: What is changed; not touched.
            values: By name of the parameter; those not given are null.

        Raises:
            BadEffectError: a user's change fails.

        """
        own = self._values(values)
        if not own or not self.function:
            return rig
        if self.file:
            # A user's change may touch what it gets by mistake, and the nominal simulator must not know.
            rig = dataclasses.replace(rig, model=copy.copy(rig.model), tendon_laws=rig.tendon_laws.copy())
        return self._made(self.function, rig, own)

    def change_inputs(self, inputs: AnkleInputs, values: Mapping[str, float]) -> AnkleInputs:
        """Return the inputs with the effect in them; the very same inputs where all values are null.

        Args:
            inputs: What is changed; not touched.
            values: By name of the parameter; those not given are null.

        Raises:
            BadEffectError: a user's change fails.

        """
        own = self._values(values)
        return self._made(self.input_function, inputs, own) if own and self.input_function else inputs

    def _values(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return all values by name; none where all are null."""
        own = {each.name: float(values.get(each.name, each.null)) for each in self.parameters}
        return own if any(own[each.name] != each.null for each in self.parameters) else {}

    def _made(self, function: str, given: T, values: dict[str, float]) -> T:
        """Make one of the changes, and put a name to what a user's does wrong."""
        if not self.file:
            made: T = change_of("", function)(given, values, self.place)
            return made
        try:
            changed: Any = change_of(self.file, function)(given, values, self.place)
        except Exception as error:  # whatever a user's function may raise
            raise BadEffectError(self._broken(function, f"fails with {type(error).__name__}: {error}")) from error
        if not isinstance(changed, type(given)):
            how = f"returns {type(changed).__name__} instead of a {type(given).__name__}"
            raise BadEffectError(self._broken(function, how))
        return changed

    def _broken(self, function: str, how: str) -> str:
        return f"change '{function}' of effect '{self.name}' {how}; mend it in {self.file}"


def ankle_library(file: Path | None = None) -> Library:
    """Return every effect of the package, and those of a file.

    Args:
        file: The user's own effects, in YAML.

    Raises:
        BadEffectError: an entry is not complete, or a name stands twice.

    """
    effects = list(_own_effects())
    if file is not None:
        effects += map(_effect, entries_of(file, read_yaml(file, "library")))
    return Library(tuple(effects))


@lru_cache(maxsize=1)
def machine_constants() -> Library:
    """Return the simulator's own constants, with priors: what a machine may have otherwise than they were drawn.

    Every parameter is a `priors.PriorParameter`; its null is the simulator's constant.
    """
    return Library(tuple(map(_effect, entries_of(None, own_table(MACHINE), with_priors=True))))


@lru_cache(maxsize=1)
def run_scatter() -> Library:
    """Return what a rig cannot set, or a machine does not do, the same twice, with the scatter of one run.

    Every parameter is a `priors.PriorParameter`.
    """
    return Library(tuple(map(_effect, entries_of(None, own_table(RUN), with_priors=True))))


def apply_effects(rig: Rig, library: Library, values: Mapping[str, float]) -> Rig:
    """Return a rig with effects in it, in the order of the library; the same rig where none is on.

    Args:
        rig: What is changed; not touched.
        library: Effects, of which all must be AnkleEffects.
        values: By `effect.parameter`.

    Raises:
        BadEffectError: a name that the library does not have.

    """
    for effect, own in _chosen(library, values):
        rig = effect.change(rig, own)
    return rig


def apply_to_inputs(inputs: AnkleInputs, library: Library, values: Mapping[str, float]) -> AnkleInputs:
    """Return inputs with effects in them, in the order of the library; the same inputs where none is on.

    Args:
        inputs: What is changed; not touched.
        library: Effects, of which all must be AnkleEffects.
        values: By `effect.parameter`.

    Raises:
        BadEffectError: a name that the library does not have.

    """
    for effect, own in _chosen(library, values):
        inputs = effect.change_inputs(inputs, own)
    return inputs


def try_changes(library: Library, rig: Rig) -> None:
    """Make every change of a user's at both ends of its bounds, so that a broken one is told before anything is fitted.

    Args:
        library: Effects; those of the package are not tried.
        rig: What is changed; not touched.

    Raises:
        BadEffectError: a change fails.

    """
    for effect in library:
        if isinstance(effect, AnkleEffect) and effect.file:
            effect.change(rig, {each.name: each.minimum for each in effect.parameters})
            effect.change(rig, {each.name: each.maximum for each in effect.parameters})


def _chosen(library: Library, values: Mapping[str, float]) -> Iterator[tuple[AnkleEffect, dict[str, float]]]:
    """Give every effect of which values are given, with its own by name of the parameter."""
    left = dict(values)
    names = {key.partition(".")[0] for key in left}
    for effect in library:
        if effect.name not in names:
            continue
        own = {each.name: left.pop(effect.key(each)) for each in effect.parameters if effect.key(each) in left}
        if own and isinstance(effect, AnkleEffect):
            yield effect, own
    if left:
        msg = f"'{next(iter(left))}' is no parameter of any effect in the library"
        msg += "; write EFFECT.PARAMETER, such as line_leak_achilles.conductance_dm3_s_bar"
        raise BadEffectError(msg)


@lru_cache(maxsize=1)
def _own_effects() -> tuple[AnkleEffect, ...]:
    tables = [own_table(file) for file in effect_files()]
    return tuple(_effect(entry) for table in tables for entry in entries_of(None, table))


def _effect(entry: Entry) -> AnkleEffect:
    return AnkleEffect(
        name=f"{entry.family}_{entry.place}" if entry.place else entry.family,
        subsystem=entry.subsystem,
        parameters=entry.parameters,
        sentence=entry.sentence,
        family=entry.family,
        place=entry.place,
        file=entry.file,
        function=entry.function,
        input_function=entry.input_function,
    )
