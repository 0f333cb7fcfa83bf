"""Every rig by name: its options, how it is built, how repeats scatter; and how to run one or write its model.

options = from_mapping(RIGS["tensile"].options, {"material": "a85", "vacuum_pa": 50e3})
run = run_rig("tensile", scattered("tensile", options, repeat=0), print, lambda: False)
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from jammkle_common.parameters import ParameterError
from jammkle_sim.physics.ankle import AnkleParameters
from jammkle_sim.rigs import drop, landing_run, pressure, slip, tensile
from jammkle_sim.rigs.options import checked
from jammkle_sim.rigs.run import RigRun, RunInProgress, run, steps_per_row
from jammkle_sim.rigs.scatter import scatter_numbers, scatter_seed

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from jammkle_common.parameters import ParameterClass
    from jammkle_sim.rigs.rig import Rig
    from jammkle_sim.rigs.run import Programme


@dataclass(frozen=True)
class RigKind:
    """One rig of the catalogue."""

    name: str
    title: str
    """What it does, in one line."""
    options: type[ParameterClass]
    """Frozen dataclass made of `jammkle_common.parameters.parameter` fields."""
    build: Callable[..., tuple[Rig, Programme]]
    """Makes rig and programme from checked options, with another `ankle` if that is given too; raises ParameterError
    where they do not fit together."""
    scatter: Callable[[Any, tuple[float, float]], Any]
    """Makes the options of one repeat, from the options and two standard normal numbers."""
    ankle: AnkleParameters | None = None
    """Constants of the ankle that it is built with; None: it has none."""


NOT_IN_MJCF = (
    "Bodies, joints, contacts and sensors alone. Not in this file: the law of the tendons (each actuator of a tendon's "
    "name pulls with its control, N, which is 0 here, so that the tendons are without force), the air (pump, "
    "solenoids, vacuum), and what the rig does by itself (release of a held carriage, speed of a driven one)."
)
"""What somebody must know who opens a saved model; it stands at the top of the file."""

RIGS: dict[str, RigKind] = {
    kind.name: kind
    for kind in (
        RigKind(
            "tensile",
            "pull one tendon at constant speed and come back",
            tensile.TensileOptions,
            tensile.tensile_rig,
            tensile.scattered,
        ),
        RigKind(
            "pressure",
            "jam and vent the channels of a hanging ankle",
            pressure.PressureOptions,
            pressure.pressure_rig,
            pressure.scattered,
            AnkleParameters(),
        ),
        RigKind(
            "drop",
            "drop a leg on level ground, with one of five feet",
            drop.DropOptions,
            drop.drop_rig,
            drop.scattered,
            drop.DROP_ANKLE,
        ),
        RigKind(
            "slip",
            "push a leg down onto a slope until it slides",
            slip.SlipOptions,
            slip.slip_rig,
            slip.scattered,
            AnkleParameters(),
        ),
        RigKind(
            "landing",
            "drop a leg onto a slope; the demo's rig",
            landing_run.LandingRunOptions,
            landing_run.landing_rig,
            landing_run.scattered,
            AnkleParameters(),
        ),
    )
}
"""Rigs by name."""


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


def begin_run(name: str, options: Any) -> RunInProgress:
    """Start one run of a rig, for somebody who takes it forward step by step; as `run_rig` otherwise.

    Args:
        name: Rig.
        options: Its options dataclass.

    Raises:
        ParameterError: as `run_rig`.

    """
    rig, programme = _built(name, options)
    return RunInProgress(rig, programme, options)


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
    steps_per_row(in_range.timestep_s)
    return kind.build(in_range)
