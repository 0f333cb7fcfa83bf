"""The last rung of the ladder: recordings of real machines, diagnosed by the examples of the documentation."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from jammkle_common.command.errors import InputError
from jammkle_gap.core.result import Verdict
from studies.blind.real import RealCase

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import ModuleType

    from jammkle_gap.core.result import Diagnosis

_EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "examples"


@dataclass(frozen=True)
class _Known:
    """One set of recordings, and what is known of it beforehand (the README beside the recordings)."""

    folder: str
    name: str
    example: str
    known: str
    is_so: Callable[[Diagnosis], bool]


def _named(*names: str) -> Callable[[Diagnosis], bool]:
    return lambda found: found.verdict is Verdict.EFFECTS and {each.name for each in found.effects} == set(names)


def _one_of(*names: str) -> Callable[[Diagnosis], bool]:
    return lambda found: (
        found.verdict is Verdict.AMBIGUOUS and {each.names for each in found.candidates} == {(name,) for name in names}
    )


def _leads(*names: str) -> Callable[[Diagnosis], bool]:
    return lambda found: {each.name for each in found.effects} == set(names)


_LEAKS, _TIGHT = ("Ultimaker_015", "Ultimaker_020"), "a small leak and a thermal transient tie within the noise"


def _known(examples: dict[str, ModuleType]) -> list[_Known]:
    leak_down = "gap_leak_down"
    found = [
        _Known("leak_down", name, leak_down, "a leak, no thermal transient", _named("leak"))
        if name in _LEAKS
        else _Known("leak_down", name, leak_down, _TIGHT, _one_of("leak", "cooling"))
        for name in examples[leak_down].CHAMBERS
    ]
    friction = "friction grows with pressure"
    pair = "the best single effect closes 4.8 %; load-dependent friction with a larger gain 43 %"
    return [
        *found,
        _Known("pressure_friction", "", "gap_pressure_friction", friction, _leads("pressure_friction")),
        _Known("servo_friction", "", "gap_servo_friction", pair, _leads("gain", "load_friction")),
    ]


def diagnose_real(data: Path) -> list[RealCase]:
    """Diagnose the real recordings in a folder.

    Args:
        data: With `leak_down`, `pressure_friction` and `servo_friction` in it.

    Raises:
        InputError: a set is missing, or the examples are.

    """
    names = ("gap_leak_down", "gap_pressure_friction", "gap_servo_friction")
    examples = {name: _example(name) for name in names}
    cases = []
    for each in _known(examples):
        folder = data / each.folder
        if not folder.is_dir():
            msg = f"real recordings are looked for in {folder}, which is no folder; give --real the folder above it"
            raise InputError(msg)
        found = examples[each.example].run(folder, *((each.name,) if each.name else ()))
        said = [" + ".join(candidate.names) or "no effect" for candidate in found.candidates]
        title = " ".join(filter(None, (each.folder, each.name)))
        cases.append(
            RealCase(title, each.known, found.verdict.value, " or ".join(said), found.gap.closed, each.is_so(found))
        )
    return cases


def _example(name: str) -> ModuleType:
    file = _EXAMPLES / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, file)
    if spec is None or spec.loader is None or not file.exists():
        msg = f"example {file} is missing; run this from a checkout of the project, or leave --real out"
        raise InputError(msg)
    module = importlib.util.module_from_spec(spec)
    # Dataclasses look their module up by name.
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module
