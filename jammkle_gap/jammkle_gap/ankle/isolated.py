"""Air, tendons and IMU alone, each fed with what was measured at its inputs, as one simulator.

A foot that sticks and slips makes another run of the smallest difference. Here that does not count: motion and pressure
are taken as they were measured, and what is left is judged by the noise of the instruments, at a small part of the
cost. Effects of mechanics cannot be seen so; those of air only where the hardware said when it took its commands.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_gap.ankle.inputs import nominal_rig
from jammkle_gap.ankle.instruments import declared_noise, quantity_of
from jammkle_gap.ankle.subsystems import Subsystem, SubsystemSimulator
from jammkle_gap.ankle.truth import inputs_of
from jammkle_sim.rigs.replay import timestep_s

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from numpy.typing import NDArray

    from jammkle_gap.november.effect import Library
    from jammkle_gap.november.recording import Recording, Signal

_SUBSYSTEMS = (Subsystem.PNEUMATICS, Subsystem.TENDON, Subsystem.SENSING)
_INPUTS_ONLY = ("position", "extension", "force_x", "force_y", "force_z")
_ROUNDING = 1e-6


@dataclass(frozen=True)
class IsolatedSimulator:
    """Air from commands, tendons from measured extension and pressure, IMU from gravity where nothing moves."""

    library: Library
    """Effects whose parameters it takes."""

    def __call__(self, recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        """Run every subsystem; see `gap.simulator.Simulator`. Signals that are inputs only are left out.

        Raises:
            BadEffectError: a parameter that no effect of the library has.

        """
        found: dict[str, NDArray[np.float64]] = {}
        for subsystem in _SUBSYSTEMS:
            found |= SubsystemSimulator(self.library, subsystem)(recording, values)
        return {name: made for name, made in found.items() if name.rpartition("/")[2] not in _INPUTS_ONLY}


def with_instruments_noise(recording: Recording) -> Recording:
    """Return the recording with the noise of its instruments alone: what contact adds does not count here."""
    rig = nominal_rig(inputs_of(recording))
    noise = declared_noise(rig, timestep_s(rig))
    return recording.with_noise({signal.name: noise[quantity_of(signal.name)] for signal in recording.signals})


def thinned(recording: Recording, rate_hz: float) -> Recording:
    """Return the recording with every n-th sample of what is compared, for at most about `rate_hz`; inputs stay."""
    signals = tuple(
        signal if signal.name.rpartition("/")[2] in _INPUTS_ONLY else _thinned(signal, rate_hz)
        for signal in recording.signals
    )
    return dataclasses.replace(recording, signals=signals)


def _thinned(signal: Signal, rate_hz: float) -> Signal:
    length_s = float(signal.time_s[-1] - signal.time_s[0])
    every = max(int((len(signal.time_s) - 1) / (length_s * rate_hz) + _ROUNDING), 1) if length_s > 0.0 else 1
    return dataclasses.replace(signal, time_s=signal.time_s[::every].copy(), values=signal.values[::every].copy())
