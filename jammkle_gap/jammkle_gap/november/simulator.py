"""What the diagnosis asks of a simulator."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from numpy.typing import NDArray

    from jammkle_gap.november.recording import Recording


class Simulator(Protocol):
    """Runs a recording again. Must be picklable if runs are to be spread over processes."""

    def __call__(self, recording: Recording, values: Mapping[str, float]) -> Mapping[str, NDArray[np.float64]]:
        """Run again what was commanded, and return what would have been measured, without noise.

        Args:
            recording: What was measured; its `inputs` say what to run.
            values: Parameters of effects by `effect.parameter`; those not named are at their null value.

        Returns:
            By signal name, at the times of the recording's signal. A signal that the simulator does not know is left
            out, and so not compared.

        """


class RestartingSimulator(Simulator, Protocol):
    """A simulator that can be set to the measured state again and again."""

    def restarted(
        self, recording: Recording, values: Mapping[str, float], horizon_s: float
    ) -> Mapping[str, NDArray[np.float64]]:
        """As a call, restarted from the measured state every `horizon_s`; signals without such a state are left out."""
