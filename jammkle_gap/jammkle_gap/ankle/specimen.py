"""What the tendons of this very machine are like, told by references, before it is asked what has changed.

No two tendons are alike: a print comes out stiffer, a clamp sits a millimetre off. What references show the law to be
off by is trusted only where a recording goes through the same states. A law that fits the machine is right elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.ankle.effects import ankle_library
from jammkle_gap.ankle.simulator import AnkleSimulator
from jammkle_gap.ankle.subsystems import tensions_of
from jammkle_gap.november.fitting import ROBUST

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.november.effect import Library
    from jammkle_gap.november.recording import Recording
    from jammkle_gap.november.simulator import RestartingSimulator

_FRICTION = "jamming_friction.scale"
_FRICTIONS = (1.0, 0.4)
"""Where fits begin: fibres that never slide tell nothing of the force at which they would. The second is near where
fits to development landings ended."""
_LAW = (
    "tendon_stiffness.scale",
    "viscoelasticity.gain_scale",
    "viscoelasticity.time_scale",
    _FRICTION,
    "pretension_achilles_pair.extension_m",
    "pretension_peroneal_pair.extension_m",
    "softening.loss",
)
"""Parameters of effects that tendons in good order differ by. A membrane's stiffness is left out: beside the fibres' it
would make one of two laws that no data tell apart, and an effect on either would mean something else."""
_PULL = 3.0
"""Weight of the law as it is: samples of noise that a parameter costs at a distance of its whole range. Assumed: what
references do not show stays."""
_EVERY = 4
"""Samples of which one is looked at: tensions are slow."""
_EVALUATIONS = 40
_INWARDS = 1e-4
_DIFFERENCE = 0.01


def tendons_told_by(references: Sequence[Recording]) -> dict[str, float]:
    """Return the values of the library's parameters that bring the tendons' law nearest to what references measured.

    Args:
        references: Of the machine in good order; those without tensions, or extensions and pressures, tell nothing.

    """
    every = {effect.key(each): each for effect in ankle_library() for each in effect.parameters}
    parameters = {key: every[key] for key in _LAW}
    null = np.array([each.null for each in parameters.values()])
    low = np.array([each.minimum for each in parameters.values()])
    span = np.array([each.maximum for each in parameters.values()]) - low

    def values(place: NDArray[np.float64]) -> dict[str, float]:
        return {key: float(value) for key, value in zip(parameters, null + (place - 1.0) * span, strict=True)}

    def residual(place: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.concatenate([_residual(references, values(place)), _PULL * (place - 1.0)])

    # Shares of the ranges around 1, as scipy's differences are shares of where it stands.
    bounds = 1.0 + (low - null) / span, 1.0 + (low + span - null) / span
    if not _residual(references, {}).size:
        return {}
    found = []
    for friction in _FRICTIONS:
        start = np.clip(np.ones(null.size), bounds[0] + _INWARDS, bounds[1] - _INWARDS)
        start[_LAW.index(_FRICTION)] += (friction - 1.0) / span[_LAW.index(_FRICTION)]
        found.append(
            least_squares(
                residual,
                start,
                bounds=bounds,
                loss="soft_l1",
                f_scale=ROBUST,
                diff_step=_DIFFERENCE,
                max_nfev=_EVALUATIONS,
            )
        )
    return values(min(found, key=lambda each: each.cost).x)


def _residual(references: Sequence[Recording], values: Mapping[str, float]) -> NDArray[np.float64]:
    """Return measured less simulated tensions, in their noise, shape (n,)."""
    found = [np.zeros(0)]
    for each in references:
        rig = AnkleSimulator(ankle_library()).rig(each, values)
        for name, tension_n in tensions_of(each, rig).items():
            signal = each.signal(name)
            found.append(((signal.values - tension_n) / signal.noise)[::_EVERY])
    return np.concatenate(found)


@dataclass(frozen=True)
class WithTendons:
    """A simulator in parts whose tendons are those of a machine; fulfils `gap.simulator.RestartingSimulator`.

    Effects change what the machine is like. The bodies are pulled by what was measured, and so are as they were.
    """

    simulator: RestartingSimulator
    library: Library
    """Effects whose parameters it takes."""
    told: tuple[tuple[str, float], ...]
    """As `tendons_told_by` says."""

    def __call__(self, recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        """Run every part; see `gap.simulator.Simulator`."""
        tensions = tensions_of(recording, AnkleSimulator(self.library, self.told).rig(recording, values))
        return {name: tensions.get(name, made) for name, made in self.simulator(recording, values).items()}

    def restarted(
        self, recording: Recording, values: Mapping[str, float], horizon_s: float
    ) -> Mapping[str, NDArray[np.float64]]:
        """Run the whole as it is; see `gap.simulator.RestartingSimulator`."""
        return self.simulator.restarted(recording, values, horizon_s)
