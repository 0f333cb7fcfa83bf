"""The ankle as a problem for the diagnosis: its simulator, effects, nuisances, sensors and events."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from importlib import metadata, resources
from typing import TYPE_CHECKING

from jammkle_gap.ankle.conformity import known_nonconformity
from jammkle_gap.ankle.effects import ankle_library, machine_constants, run_scatter
from jammkle_gap.ankle.group import group_of
from jammkle_gap.ankle.priors import PriorParameter
from jammkle_gap.ankle.registrar import AnkleRegistrar
from jammkle_gap.ankle.sensing import AnkleSensing
from jammkle_gap.ankle.simulator import AnkleSimulator
from jammkle_gap.ankle.truth import inputs_of
from jammkle_gap.core.effects import Library, Nuisance
from jammkle_gap.core.simulate import Problem

if TYPE_CHECKING:
    from jammkle_gap.core.data import Recording

_BIN_S, _SLOW_BIN_S = 0.02, 0.05
"""Length of a bin, s, and on the slip rig, whose runs are slow."""


def ankle_problem(library: Library | None = None) -> Problem:
    """Return the problem.

    Args:
        library: Effects on offer; by default all of the package.

    """
    library = library or ankle_library()
    return Problem(
        simulator=AnkleSimulator(library),
        library=library,
        scatter=_nuisances(run_scatter()),
        constants=_nuisances(machine_constants()),
        sensing=AnkleSensing(library),
        registrar=AnkleRegistrar(),
        bin_s=bin_s,
        version=version(),
        group_of=group_of,
        conformity=known_nonconformity,
    )


def bin_s(recording: Recording) -> float:
    """Return the length of a bin for a recording's rig, s."""
    return _SLOW_BIN_S if inputs_of(recording).rig == "slip" else _BIN_S


@lru_cache(maxsize=1)
def version() -> str:
    """Return what tells this simulator from its other versions: a digest of its sources, and MuJoCo's version."""
    digest = hashlib.blake2b(metadata.version("mujoco").encode(), digest_size=16)
    for package in ("jammkle_sim.physics", "jammkle_sim.rigs", "jammkle_gap.ankle"):
        pending = [resources.files(package)]
        while pending:
            for each in sorted(pending.pop().iterdir(), key=lambda file: file.name):
                if each.is_dir():
                    pending.append(each)
                elif each.name.endswith((".py", ".yaml")):
                    digest.update(each.name.encode() + each.read_bytes())
    return digest.hexdigest()


def _nuisances(library: Library) -> tuple[Nuisance, ...]:
    return tuple(
        Nuisance(effect.key(each), each.unit, each.null, each.deviation, each.source, each.minimum, each.maximum)
        for effect in library
        for each in effect.parameters
        if isinstance(each, PriorParameter)
    )
