"""Every rig by name: its options, how it is built, how repeats scatter; and how to run one or write its model.

options = from_mapping(RIGS["tensile"].options, {"material": "a85", "vacuum_pa": 50e3})
run = run_rig("tensile", scattered("tensile", options, repeat=0), print, lambda: False)
"""

from __future__ import annotations

import dataclasses
import statistics
import zlib
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common.parameters import ParameterError
from jammkle_sim.rigs import cycle, drop, landing, press, pressure, shake, slip, tensile, tilt
from jammkle_sim.rigs.options import checked
from jammkle_sim.rigs.run import check_timestep, run

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from jammkle_sim.rigs.rig import Rig
    from jammkle_sim.rigs.run import Programme, RigKind, RigRun


NOT_IN_MJCF = (
    "Bodies, joints, contacts and sensors alone. Not in this file: the law of the tendons (each actuator of a tendon's "
    "name pulls with its control, N, which is 0 here, so that the tendons are without force), the air (pump, "
    "solenoids, vacuum), and what the rig does by itself (release of a held carriage, speed of a driven one)."
)
"""What somebody must know who opens a saved model; it stands at the top of the file."""

EXERCISES = {kind.name: kind for kind in (cycle.RIG, press.RIG, shake.RIG, tilt.RIG)}
"""Rigs whose motion a robot can make with its own means, by name."""
RIGS = {kind.name: kind for kind in (tensile.RIG, pressure.RIG, drop.RIG, slip.RIG, landing.RIG)} | EXERCISES
"""Rigs by name. One more: a module with its `RIG`, and its place here."""


def rig_kind(name: str) -> RigKind:
    """Return a rig of the catalogue.

    Raises:
        ParameterError: there is no such rig.

    """
    if name not in RIGS:
        msg = f"rig '{name}' does not exist; known are: {', '.join(RIGS)}"
        raise ParameterError(msg)
    return RIGS[name]


def as_it_is(rig: Rig) -> Rig:
    """Return the rig: the change that is none."""
    return rig


def run_rig(
    name: str,
    options: Any,
    on_progress: Callable[[float], None],
    cancelled: Callable[[], bool],
    change: Callable[[Rig], Rig] = as_it_is,
) -> RigRun:
    """Run a rig once, without the graph, faster than real time.

    Args:
        name: Rig.
        options: Its options dataclass.
        on_progress: Called with the share done, 0 to 1.
        cancelled: Asked now and then; true ends the run.
        change: Makes the rig that is run from the one that the options make.

    Raises:
        ParameterError: unknown rig, or options out of range or that do not fit together.
        RigCancelledError: cancelled.
        UnstableSimulationError: the simulation blew up; the message says what was simulated.

    """
    rig, programme = _built(name, options)
    return run(change(rig), programme, options, on_progress, cancelled)


def scattered(name: str, options: Any, repeat: int) -> Any:
    """Return the options of one repeat: what the rig cannot set exactly differs, drawn from (seed, repeat).

    The seed of the sensors differs too. The same options and repeat always give the same.

    Args:
        name: Rig.
        options: Its options dataclass.
        repeat: Which repeat, 0 or more.

    Raises:
        ParameterError: unknown rig.

    """
    kind = rig_kind(name)
    changed = kind.scatter(options, scatter_numbers(name, options.seed, repeat))
    return dataclasses.replace(changed, seed=scatter_seed(options.seed, repeat))


def save_mjcf(name: str, options: Any, path: Path) -> None:
    """Write the model of a rig as MJCF, which MuJoCo's own viewer opens. What is not in it stands at its top.

    Raises:
        ParameterError: as `run_rig`.
        OSError: the file cannot be written.

    """
    rig, _ = _built(name, options)
    path.write_text(f"<!-- Rig {name}. {NOT_IN_MJCF} -->\n{rig.spec.to_xml()}")


def _built(name: str, options: Any) -> tuple[Rig, Programme]:
    kind = rig_kind(name)
    if not isinstance(options, kind.options):
        msg = f"options of rig '{name}' must be {kind.options.__name__}, not {type(options).__name__}"
        raise ParameterError(msg)
    in_range: Any = checked(options)
    check_timestep(in_range.timestep_s)
    return kind.build(in_range)


_STEPS = (0.7548776662466927, 0.5698402909980532)
"""Steps of the two-dimensional golden-ratio sequence (Roberts' R2): 1/p and 1/p^2 with p^3 = p + 1."""
_EDGE = 1e-3
"""Numbers stay within 3.1 standard deviations."""


def scatter_numbers(name: str, seed: int, repeat: int) -> tuple[float, float]:
    """Return two standard normal numbers for one repeat.

    They walk along a sequence of low discrepancy from a start that the seed draws, so they are not independent: over
    seeds the mean of five scatters by 0.35 (first number) and 0.31 (second) of a standard deviation, where that of
    independent numbers would by 0.45. The spread within five is that of the distribution, so a standard error computed
    from them as if they were independent (0.46) does not tell how far their mean is off.

    Args:
        name: Rig; rigs scatter independently.
        seed: 0 or more.
        repeat: 0 or more.

    """
    start = np.random.default_rng([seed, zlib.crc32(name.encode())]).random(2).tolist()
    shares = [(first + repeat * step) % 1.0 for first, step in zip(start, _STEPS, strict=True)]
    normal = statistics.NormalDist()
    one, other = (normal.inv_cdf(min(max(share, _EDGE), 1.0 - _EDGE)) for share in shares)
    return one, other


def scatter_seed(seed: int, repeat: int) -> int:
    """Return the seed of the sensors' noise in one repeat."""
    return int(np.random.default_rng([seed, repeat]).integers(2**31))
