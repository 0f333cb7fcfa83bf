"""Effects of an ankle: what the core fits, and the change to a rig or to its inputs that each one makes.

They are read from YAML: the package's own files in `library`, and a file of the user's. So are the constants of the
machine and what scatters from run to run. An entry is

    line_leak:
      subsystem: pneumatics
      places: [manifold, achilles]          # optional: one effect each, line_leak_manifold, line_leak_achilles;
                                            # "" is all of them, line_leak
      sentence: The {place} line leaks: check its push-fit.
      change: leak                          # a function of `changes`, or FILE.py:FUNCTION beside a user's file
      parameters:
        conductance_dm3_s_bar: {unit: dm3/(s bar), null: 0, minimum: 0, maximum: 0.02, source: a slack push-fit}

and `change(rig, values, place)` returns the changed `jammkle_sim.rigs.rig.Rig`; it must not touch the one that it gets.
What acts on the inputs of a recording, its commands or how the rig was set, is named by `inputs`, beside `change` or in
its place: `inputs(inputs, values, place)` returns the changed `inputs.AnkleInputs`, from which the rig is built.

The files MACHINE and RUN hold no effects but constants of the machine and what scatters from run to run. Each of their
parameters has a `deviation`, the standard deviation of its prior, and its bounds may be left out.
"""

from __future__ import annotations

import copy
import dataclasses
import hashlib
import importlib
import importlib.util
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import yaml

from jammkle_common.command.errors import InputError
from jammkle_common.yaml_text import read_file
from jammkle_gap.ankle.inputs import AnkleInputs
from jammkle_gap.core.effects import BadEffectError, Effect, EffectParameter, Library
from jammkle_sim.rigs.rig import Rig

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

REACH = 5.0
"""Standard deviations between null and the bounds, where an entry gives none: what lies beyond is no scatter."""


@dataclass(frozen=True)
class PriorParameter(EffectParameter):
    """A number with a normal prior around its null; its source tells where the deviation comes from."""

    deviation: float
    """Standard deviation of the prior, in `unit`."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            BadEffectError: bounds as for any parameter, or a deviation that is not above 0.

        """
        super().__post_init__()
        if not 0.0 < self.deviation < float("inf"):
            msg = f"parameter '{self.name}' has a deviation of {self.deviation}; give a number above 0"
            raise BadEffectError(msg)


MACHINE, RUN = "machine.yaml", "run.yaml"
"""Files of the package that hold constants of the machine, and what scatters from run to run."""

_FIELDS = {"subsystem", "sentence", "parameters"}
_CHANGING = ("change", "inputs")
"""Fields that name a change; an entry has at least one of them."""
_PARAMETER_FIELDS = {"unit", "null", "minimum", "maximum", "source"}
_MOST_PARAMETERS = 3
_PACKAGE = "jammkle_gap.ankle"
_CHANGES = f"{_PACKAGE}.changes"


def read_yaml(file: Path, what: str) -> Any:
    """Return what stands in a YAML file.

    Args:
        file: To be read.
        what: What it is, for the messages: `library`.

    Raises:
        BadEffectError: it cannot be read, or is not YAML.

    """
    try:
        return read_file(file, f"{what} {file}")
    except InputError as error:
        raise BadEffectError(str(error)) from error


def _effects_of(file: Path | None, table: Any, *, with_priors: bool = False) -> Iterator[AnkleEffect]:
    """Give the effect of every entry of a table, once per place.

    Args:
        file: Where it was read; None for the package's own.
        table: What was read.
        with_priors: Whether parameters have a deviation.

    Raises:
        BadEffectError: an entry is not complete, or names a change that is not there.

    """
    if not isinstance(table, dict) or not table:
        msg = f"library {file} holds no effects; write NAME: {{subsystem, sentence, change, parameters}}"
        raise BadEffectError(msg)
    for family, entry in table.items():
        needed = {*_FIELDS, _CHANGING[0]} if not _has_change(entry) else _FIELDS
        missing = sorted(needed - set(entry)) if isinstance(entry, dict) else sorted(needed)
        if missing:
            msg = f"effect '{family}' has no '{missing[0]}'; an effect needs {', '.join(sorted(needed))}"
            raise BadEffectError(msg)
        source, changes = _changes_of(str(family), file, entry)
        places = entry.get("places") or [""]
        if not isinstance(places, list):
            msg = f"effect '{family}' has places '{places}'; write a list, such as [{places}]"
            raise BadEffectError(msg)
        for place in map(str, places):
            yield AnkleEffect(
                name=f"{family}_{place}" if place else str(family),
                subsystem=str(entry["subsystem"]),
                parameters=_parameters(str(family), entry["parameters"], with_priors=with_priors),
                sentence=_sentence(str(entry["sentence"]), place),
                family=str(family),
                place=place,
                file=source,
                function=changes["change"],
                input_function=changes["inputs"],
            )


@lru_cache(maxsize=256)
def change_of(file: str, function: str) -> Callable[..., Any]:
    """Return a change by its name.

    Args:
        file: Python file that holds it; empty for the package's own.
        function: Its name there.

    """
    if not file:
        change: Callable[..., Any] = getattr(importlib.import_module(_CHANGES), function)
        return change
    spec = importlib.util.spec_from_file_location(f"jammkle_user_effects_{abs(hash(file))}", file)
    if spec is None or spec.loader is None:
        msg = f"{file} is no Python file"
        raise ImportError(msg)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    found: Callable[..., Any] = getattr(module, function)
    return found


def _folder() -> Any:
    return resources.files(_PACKAGE) / "library"


def _own_table(file: str) -> Any:
    return yaml.safe_load((_folder() / file).read_text(encoding="utf-8"))


def _sentence(text: str, place: str) -> str:
    return " ".join(text.replace("{place}", place.replace("_", " ")).split())


def _has_change(entry: Any) -> bool:
    return isinstance(entry, dict) and any(each in entry for each in _CHANGING)


def _parameters(family: str, table: Any, *, with_priors: bool) -> tuple[EffectParameter, ...]:
    if not isinstance(table, dict) or not 1 <= len(table) <= _MOST_PARAMETERS:
        msg = f"effect '{family}' must have one to three parameters, by name"
        raise BadEffectError(msg)
    return tuple(_parameter(family, str(name), entry, with_priors=with_priors) for name, entry in table.items())


def _parameter(family: str, name: str, entry: Any, *, with_priors: bool) -> EffectParameter:
    # YAML reads a bare null as nothing.
    fields = {"null" if key is None else str(key): value for key, value in _mapping(entry).items()}
    given = set(fields)
    known, bounds = set(_PARAMETER_FIELDS), {"minimum", "maximum"}
    if with_priors:
        known |= {"deviation"}
        given |= bounds
    if given != known:
        wrong = min(given ^ known)
        verb = "cannot have" if wrong in given else "lacks"
        msg = f"parameter '{name}' of effect '{family}' {verb} '{wrong}'; it needs {', '.join(sorted(known))}"
        raise BadEffectError(msg)
    try:
        numbers: dict[str, Any] = {
            key: float(fields[key]) for key in sorted(known - {"unit", "source"}) if key in fields
        }
    except (TypeError, ValueError) as error:
        msg = f"parameter '{name}' of effect '{family}' has a bound that is no number: {error}"
        raise BadEffectError(msg) from error
    if fields["unit"] in {None, ""}:
        msg = f"parameter '{name}' of effect '{family}' has an empty unit; write 1 for a plain number"
        raise BadEffectError(msg)
    unit, source = str(fields["unit"]), str(fields["source"])
    if not with_priors:
        return EffectParameter(name, unit, source=source, **numbers)
    reach = REACH * numbers["deviation"]
    numbers = {"minimum": numbers["null"] - reach, "maximum": numbers["null"] + reach, **numbers}
    return PriorParameter(name, unit, source=source, **numbers)


def _mapping(entry: Any) -> dict[Any, Any]:
    return entry if isinstance(entry, dict) else {}


def _changes_of(family: str, file: Path | None, entry: dict[str, Any]) -> tuple[str, dict[str, str]]:
    """Return the file of an entry's changes, empty for the package's own, and their names by field; they are there."""
    found = {field: _change_of(family, file, str(entry[field])) for field in _CHANGING if field in entry}
    sources = sorted({source for source, _ in found.values()})
    if len(sources) > 1:
        msg = f"effect '{family}' has its changes in two files, {' and '.join(sources)}; put them into one"
        raise BadEffectError(msg)
    return sources[0], {field: found[field][1] if field in found else "" for field in _CHANGING}


def _change_of(family: str, file: Path | None, text: str) -> tuple[str, str]:
    """Return the file, empty for the package's own, and the name of a change; it is there."""
    source, _, function = text.rpartition(":")
    if source:
        path = (file.parent if file else Path()) / source
        source = str(path.resolve())
    try:
        found = change_of(source, function)
    except Exception as error:  # whatever a user's file may raise
        why = f"{type(error).__name__}: {error}"
        msg = f"effect '{family}' names the change '{text}', which cannot be loaded ({why})"
        msg += f"; give a function of {_CHANGES}, or FILE.py:FUNCTION"
        raise BadEffectError(msg) from error
    if not callable(found):
        msg = f"effect '{family}' names the change '{text}', which is no function"
        raise BadEffectError(msg)
    return source, function


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

    @property
    def version(self) -> str:
        """Its place and changes, and a digest of a user's file that holds them; not of what that file imports."""
        source = hashlib.blake2b(Path(self.file).read_bytes(), digest_size=16).hexdigest() if self.file else ""
        return f"{self.place}|{self.function}|{self.input_function}|{source}"

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
        effects += _effects_of(file, read_yaml(file, "library"))
    return Library(tuple(effects))


@lru_cache(maxsize=1)
def machine_constants() -> Library:
    """Return the simulator's own constants, with priors: what a machine may have otherwise than they were drawn.

    Every parameter is a `priors.PriorParameter`; its null is the simulator's constant.
    """
    return Library(tuple(_effects_of(None, _own_table(MACHINE), with_priors=True)))


@lru_cache(maxsize=1)
def run_scatter() -> Library:
    """Return what a rig cannot set, or a machine does not do, the same twice, with the scatter of one run.

    Every parameter is a `priors.PriorParameter`.
    """
    return Library(tuple(_effects_of(None, _own_table(RUN), with_priors=True)))


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
    """Make every change of a user's at both ends of its bounds, so that a broken one is reported before any fit.

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
    files = {file.name for file in _folder().iterdir() if file.name.endswith(".yaml")} - {MACHINE, RUN}
    return tuple(effect for file in sorted(files) for effect in _effects_of(None, _own_table(file)))
