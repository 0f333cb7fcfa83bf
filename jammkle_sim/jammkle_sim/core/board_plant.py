"""What is wired to a board's pins: pump, valves and air, and the voltages that the sensors give."""

from __future__ import annotations

import numpy as np

from jammkle_common.names import CHANNELS
from jammkle_sim.physics.pneumatics import MANIFOLD, PneumaticParameters, Pneumatics
from jammkle_sim.physics.sensors import SensorParameters

TIMESTEP_S = 0.0005
REFERENCE_V = 5.0
"""Supply of sensors and converter, V: the sensors are ratiometric, so that it cancels."""
SUPPLY_V = 12.0
SUPPLY_DIVIDER = 0.25
"""Share of the supply at its analogue pin: 20 V give the reference."""

_SENSOR_PER_PA = 0.009e-3
_SENSOR_AT_VACUUM = -0.095
"""Transfer function of the MPX4115A class, as a share of its supply: 0.009 p/kPa - 0.095 (NXP data sheet MPX4115A)."""
_MICROVOLTS = 1e6


class BoardPlant:
    """The air of one ankle between a board's outputs and its analogue pins.

    Attributes:
        air: The air, whose lines can be pinched and punctured.
        supply_v: Voltage of the supply, V.

    """

    def __init__(self, parameters: PneumaticParameters | None = None, seed: int = 0) -> None:
        """Start vented, the supply on.

        Args:
            parameters: Volumes, conductances, pump and valves; None: the simulation's own.
            seed: Start of the sensors' noise, which is the simulation's.

        """
        built = parameters or PneumaticParameters()
        self.air = Pneumatics(built, TIMESTEP_S)
        self._noise = np.random.default_rng(seed)
        self._noise_pa = SensorParameters().pressure_noise_pa
        self._ahead_s = 0.0
        self._pressure_pa = np.full(1 + len(CHANNELS), built.ambient_pa)
        self.supply_v = SUPPLY_V

    @property
    def pressures_pa(self) -> dict[str, float]:
        """Absolute pressure of each channel and the manifold, Pa, without noise."""
        manifold, *channels = self._pressure_pa
        return {**dict(zip(CHANNELS, channels, strict=True)), MANIFOLD: float(manifold)}

    def sensed_pa(self) -> dict[str, float]:
        """Return what the sensors make of the pressures now, with their noise, Pa absolute."""
        noise_pa = self._noise_pa * self._noise.standard_normal(1 + len(CHANNELS))
        return {place: true + off for (place, true), off in zip(self.pressures_pa.items(), noise_pa, strict=True)}

    def drive(self, solenoids: int, duty: float) -> None:
        """Set what the pins do: solenoids in bits, in the order of the channels; duty 0 to 1."""
        first, second, third = (bool(solenoids >> bit & 1) for bit in range(len(CHANNELS)))
        self.air.command(duty, (first, second, third))

    def advance(self, elapsed_s: float) -> None:
        """Let time pass; what is less than a step is kept for the next call."""
        self._ahead_s += elapsed_s
        steps = int(self._ahead_s / TIMESTEP_S)
        if steps > 0:
            self._ahead_s -= steps * TIMESTEP_S
            self._pressure_pa = self.air.advance(steps)[-1]

    def pins_uv(self) -> list[int]:
        """Voltages at the analogue pins, uV: three channels, the manifold, the supply's divider."""
        sensed_pa = self.sensed_pa()
        return [*(sensor_uv(sensed_pa[place]) for place in (*CHANNELS, MANIFOLD)), self._supply_uv()]

    def _supply_uv(self) -> int:
        return round(self.supply_v * SUPPLY_DIVIDER * _MICROVOLTS)


def sensor_uv(pressure_pa: float) -> int:
    """Return a sensor's voltage at an absolute pressure, uV; it ends at its rails."""
    share = min(max(_SENSOR_PER_PA * pressure_pa + _SENSOR_AT_VACUUM, 0.0), 1.0)
    return round(share * REFERENCE_V * _MICROVOLTS)
