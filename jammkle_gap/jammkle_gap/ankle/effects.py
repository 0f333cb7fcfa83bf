"""Effects of an ankle: what the core fits, and the change to a rig that each one makes.

They are read from YAML: the package's own files in `library`, and a file of the user's. An entry is

    line_leak:
      subsystem: pneumatics
      places: [manifold, achilles]          # optional: one effect each, line_leak_manifold, line_leak_achilles
      sentence: The {place} line leaks: check its push-fit.
      change: leak                          # a function of `changes`, or FILE.py:FUNCTION beside a user's file
      parameters:
        conductance_dm3_s_bar: {unit: dm3/(s bar), null: 0, minimum: 0, maximum: 0.02, source: a slack push-fit}

and `change(rig, values, place)` returns the changed `jammkle_sim.rigs.rig.Rig`; it must not touch the one that it gets.
"""

from __future__ import annotations

import copy
import dataclasses
import importlib
import importlib.util
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from jammkle_gap.november.effect import BadEffectError, Effect, EffectParameter, Library
from jammkle_sim.rigs.rig import Rig

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    Change = Callable[[Rig, Mapping[str, float], str], Rig]

_FIELDS = {"subsystem", "sentence", "change", "parameters"}
_PARAMETER_FIELDS = {"unit", "null", "minimum", "maximum", "source"}
_MOST_PARAMETERS = 3
_CHANGES = "jammkle_gap.ankle.changes"


@dataclass(frozen=True)
class AnkleEffect(Effect):
    """An effect that changes a rig. Picklable, as it names its change instead of holding it."""

    family: str
    """The entry that it comes from: `line_leak` of `line_leak_achilles`."""
    place: str
    """Where it acts, such as `achilles`; empty where there is only one place."""
    file: str
    """Python file with the change; empty for the package's own."""
    function: str
    """Its name there."""

    def change(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        """Return the rig with the effect in it; the very same rig where all values are null.

        Args:
            rig: What is changed; not touched.
            values: By name of the parameter; those not given are null.

        Raises:
            BadEffectError: a user's change fails.

        """
        own = {each.name: float(values.get(each.name, each.null)) for each in self.parameters}
        if all(own[each.name] == each.null for each in self.parameters):
            return rig
        if not self.file:
            return _function("", self.function)(rig, own, self.place)
        # A user's change may touch what it gets by mistake, and the nominal simulator must not know.
        given = dataclasses.replace(rig, model=copy.copy(rig.model), tendon_laws=rig.tendon_laws.copy())
        try:
            changed = _function(self.file, self.function)(given, own, self.place)
        except Exception as error:  # whatever a user's function may raise
            raise BadEffectError(self._broken(f"fails with {type(error).__name__}: {error}")) from error
        if not isinstance(changed, Rig):
            raise BadEffectError(self._broken(f"returns {type(changed).__name__} instead of a Rig"))
        return changed

    def _broken(self, how: str) -> str:
        return f"change '{self.function}' of effect '{self.name}' {how}; mend it in {self.file}"


def ankle_library(file: Path | None = None) -> Library:
    """Return every effect of the package, and those of a file.

    Args:
        file: The user's own effects, in YAML.

    Raises:
        BadEffectError: an entry is not complete, or a name stands twice.

    """
    effects = list(_own_effects())
    if file is not None:
        effects += _effects_of(file, read_yaml(file, "library"))
    return Library(tuple(effects))


def apply_effects(rig: Rig, library: Library, values: Mapping[str, float]) -> Rig:
    """Return a rig with effects in it, in the order of the library; the same rig where none is on.

    Args:
        rig: What is changed; not touched.
        library: Effects, of which all must be AnkleEffects.
        values: By `effect.parameter`.

    Raises:
        BadEffectError: a name that the library does not have.

    """
    left = dict(values)
    for effect in library:
        own = {each.name: left.pop(effect.key(each)) for each in effect.parameters if effect.key(each) in left}
        if own and isinstance(effect, AnkleEffect):
            rig = effect.change(rig, own)
    if left:
        msg = f"'{next(iter(left))}' is no parameter of any effect in the library"
        msg += "; write EFFECT.PARAMETER, such as line_leak_achilles.conductance_dm3_s_bar"
        raise BadEffectError(msg)
    return rig


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


def read_yaml(file: Path, what: str) -> Any:
    """Return what stands in a YAML file.

    Args:
        file: To be read.
        what: What it is, for the messages: `library`.

    Raises:
        BadEffectError: it cannot be read, or is not YAML.

    """
    try:
        return yaml.safe_load(file.read_text(encoding="utf-8"))
    except OSError as error:
        msg = f"{what} {file} cannot be read: {error.strerror}"
        raise BadEffectError(msg) from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        msg = f"{what} {file} is not YAML: {' '.join(str(error).split())}"
        raise BadEffectError(msg) from error


@lru_cache(maxsize=1)
def _own_effects() -> tuple[AnkleEffect, ...]:
    folder = resources.files("jammkle_gap.ankle") / "library"
    files = sorted((file for file in folder.iterdir() if file.name.endswith(".yaml")), key=lambda file: file.name)
    entries = {file.name: yaml.safe_load(file.read_text(encoding="utf-8")) for file in files}
    return tuple(effect for table in entries.values() for effect in _effects_of(None, table))


def _effects_of(file: Path | None, table: Any) -> Iterator[AnkleEffect]:
    if not isinstance(table, dict) or not table:
        msg = f"library {file} holds no effects; write NAME: {{subsystem, sentence, change, parameters}}"
        raise BadEffectError(msg)
    for family, entry in table.items():
        missing = sorted(_FIELDS - set(entry)) if isinstance(entry, dict) else sorted(_FIELDS)
        if missing:
            msg = f"effect '{family}' has no '{missing[0]}'; an effect needs {', '.join(sorted(_FIELDS))}"
            raise BadEffectError(msg)
        source, function = _change_of(str(family), file, str(entry["change"]))
        places = entry.get("places") or [""]
        if not isinstance(places, list):
            msg = f"effect '{family}' has places '{places}'; write a list, such as [{places}]"
            raise BadEffectError(msg)
        for place in places:
            yield AnkleEffect(
                name=f"{family}_{place}" if place else str(family),
                subsystem=str(entry["subsystem"]),
                parameters=_parameters(str(family), entry["parameters"]),
                sentence=" ".join(str(entry["sentence"]).split()).replace("{place}", str(place).replace("_", " ")),
                family=str(family),
                place=str(place),
                file=source,
                function=function,
            )


def _parameters(family: str, table: Any) -> tuple[EffectParameter, ...]:
    if not isinstance(table, dict) or not 1 <= len(table) <= _MOST_PARAMETERS:
        msg = f"effect '{family}' must have one to three parameters, by name"
        raise BadEffectError(msg)
    found = []
    for name, entry in table.items():
        # YAML reads a bare null as nothing.
        fields = {"null" if key is None else str(key): value for key, value in _mapping(entry).items()}
        given = set(fields)
        if given != _PARAMETER_FIELDS:
            wrong = min(given ^ _PARAMETER_FIELDS)
            verb = "cannot have" if wrong in given else "lacks"
            msg = f"parameter '{name}' of effect '{family}' {verb} '{wrong}'"
            msg += f"; it needs {', '.join(sorted(_PARAMETER_FIELDS))}"
            raise BadEffectError(msg)
        try:
            numbers = {key: float(fields[key]) for key in ("null", "minimum", "maximum")}
        except (TypeError, ValueError) as error:
            msg = f"parameter '{name}' of effect '{family}' has a bound that is no number: {error}"
            raise BadEffectError(msg) from error
        if fields["unit"] in {None, ""}:
            msg = f"parameter '{name}' of effect '{family}' has an empty unit; write 1 for a plain number"
            raise BadEffectError(msg)
        found.append(EffectParameter(str(name), str(fields["unit"]), source=str(fields["source"]), **numbers))
    return tuple(found)


def _mapping(entry: Any) -> dict[Any, Any]:
    return entry if isinstance(entry, dict) else {}


def _change_of(family: str, file: Path | None, text: str) -> tuple[str, str]:
    """Return the file, empty for the package's own, and the name of a change; it is there."""
    source, _, function = text.rpartition(":")
    if source:
        path = (file.parent if file else Path()) / source
        source = str(path.resolve())
    try:
        found = _function(source, function)
    except Exception as error:  # whatever a user's file may raise
        why = f"{type(error).__name__}: {error}"
        msg = f"effect '{family}' names the change '{text}', which cannot be loaded ({why})"
        msg += f"; give a function of {_CHANGES}, or FILE.py:FUNCTION"
        raise BadEffectError(msg) from error
    if not callable(found):
        msg = f"effect '{family}' names the change '{text}', which is no function"
        raise BadEffectError(msg)
    return source, function


@lru_cache(maxsize=256)
def _function(file: str, function: str) -> Change:
    if not file:
        change: Change = getattr(importlib.import_module(_CHANGES), function)
        return change
    spec = importlib.util.spec_from_file_location(f"jammkle_user_effects_{abs(hash(file))}", file)
    if spec is None or spec.loader is None:
        msg = f"{file} is no Python file"
        raise ImportError(msg)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    found: Change = getattr(module, function)
    return found
