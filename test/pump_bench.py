"""A pump bench: the air of one simulated ankle on its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jammkle_common.names import CHANNELS
from jammkle_sim.physics import kernels, pneumatics, records

if TYPE_CHECKING:
    from numpy.typing import NDArray


class Pneumatics:
    """Pump, manifold, solenoids and channels, with nothing behind them."""

    def __init__(self, parameters: pneumatics.PneumaticParameters, timestep_s: float) -> None:
        """Start vented, pump off.

        Args:
            parameters: Volumes, conductances, pump and valves.
            timestep_s: Time step, s.

        """
        self._built = pneumatics.pneumatic_law(parameters, timestep_s)
        self._law = self._built.copy()
        self._state = pneumatics.vented_state(self._law)

    def command(self, duty: float, energised: tuple[bool, bool, bool]) -> None:
        """Set pump duty, 0 to 1, and the solenoids, in the order of CHANNELS."""
        self._state["duty"] = duty
        self._state["command"] = energised

    def pinch(self, channel: str, share: float) -> None:
        """Leave a share, 0 to 1, of the conductance of a channel's line."""
        self._law["valve_kg_s_pa"][0, CHANNELS.index(channel)] *= share

    def puncture(self, place: str, conductance_dm3_s_bar: float) -> None:
        """Make a hole into a channel, or into the `MANIFOLD`, of this sonic conductance."""
        volume = 0 if place == pneumatics.MANIFOLD else 1 + CHANNELS.index(place)
        self._law["leak_kg_s_pa"][0, volume] += pneumatics.conductance_kg_s_pa(conductance_dm3_s_bar)
        self._law["substeps"] = pneumatics.stable_substeps(self._law)

    def repair(self) -> None:
        """Undo every pinch and puncture; the air stays as it is."""
        self._law[:] = self._built

    def advance(self, steps: int) -> NDArray[np.float64]:
        """Advance and return absolute pressures after each step, Pa, shape (steps, 4): manifold, then channels."""
        pressure_pa = np.zeros((steps, records.VOLUMES))
        law, state = self._law[0], self._state[0]
        for row_pa in pressure_pa:
            kernels.advance_pneumatics(law, state)
            row_pa[:] = state["pressure_pa"]
        return pressure_pa

    @property
    def mass_kg(self) -> float:
        """Air in all volumes, kg."""
        return float(self._state["mass_kg"].sum())

    @property
    def exchanged_kg(self) -> float:
        """Air that came in through vents and leaks less what the pump took out, since the start, kg."""
        return float(self._state["admitted_kg"][0] - self._state["pumped_kg"][0])
