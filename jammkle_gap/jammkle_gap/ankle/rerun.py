"""A recording run again in its simulator, to be seen beside it: how it moves, and what its sensors would have read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from jammkle_common.parameters import ParameterError
from jammkle_gap.ankle.corrected import Correction, load_correction
from jammkle_gap.ankle.readings import readings
from jammkle_gap.ankle.simulator import AnkleSimulator
from jammkle_gap.ankle.truth import inputs_of, truth_of
from jammkle_gap.core.effects import Library
from jammkle_gap.core.simulate import InfeasibleError
from jammkle_sim.rigs.simulation import UnstableSimulationError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from jammkle_gap.core.data import Recording


@dataclass(frozen=True)
class Rerun:
    """What the simulator does when it is told what a recording's machine was told."""

    began_s: float
    """Stamp at which the recording's times begin, s."""
    step_s: float
    """Between two rows of `joints` and `tensions_n`, the first of which is one step after the start."""
    model: Any
    """The mujoco.MjModel."""
    joints: Mapping[str, NDArray[np.float64]]
    """Positions by name, rad or m, shape (n,)."""
    tensions_n: Mapping[str, NDArray[np.float64]]
    """By tendon, shape (n,), N."""
    readings: Mapping[str, NDArray[np.float64]]
    """What the sensors would have read, by the names of the recording's signals, at their times."""


def rerun(recording: Recording, corrected: Path | None = None) -> Rerun:
    """Run a recording again.

    Args:
        recording: Of an ankle, from `load_recordings`.
        corrected: Effects file that the simulator is corrected by, as `jammkle gap diagnose` writes it; None: as it is.

    Raises:
        BadEffectError: the file cannot be used with this rig.
        InfeasibleError: the simulation blew up, or a rig cannot be built so.

    """
    correction = Correction(Library(()), {}) if corrected is None else load_correction(corrected)
    simulator = AnkleSimulator(correction.library)
    changed = simulator.recording(recording, correction.values)
    try:
        rig = simulator.rig(recording, correction.values)
        truth = truth_of(changed, rig)
    except (UnstableSimulationError, ParameterError) as error:
        raise InfeasibleError(str(error)) from error
    bodies = truth.bodies
    return Rerun(
        began_s=inputs_of(recording).began_s,
        step_s=truth.step_s,
        model=rig.model,
        joints={} if bodies is None else {name: bodies.position(name) for name in bodies.joints},
        tensions_n={} if bodies is None else {name: bodies.tension_n(name) for name in bodies.tendons},
        readings=readings(changed, rig, truth),
    )
