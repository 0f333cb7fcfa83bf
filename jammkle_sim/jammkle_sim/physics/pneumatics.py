"""Pump, manifold, three solenoids, channels: parameters, packing for the compiled law, and the state of the air.

One mass of air per volume, isothermal unless its walls are given a thermal time. A channel's 3/2 solenoid connects it
to the manifold when energised and to the atmosphere when not, so that an ankle without power is soft. No data of the
paper's pump could be found: the numbers below are assumed and declared, and a recording is what would replace them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common.constants import STANDARD_ATMOSPHERE_PA
from jammkle_common.names import CHANNELS, TENDONS_OF_CHANNEL
from jammkle_sim.physics import kernels, records

if TYPE_CHECKING:
    from numpy.typing import NDArray


MANIFOLD = "manifold"
"""Place of what concerns the volume that all channels share."""

_GAS_CONSTANT_J_KG_K = 287.05
"""Specific gas constant of dry air (ISO 2533)."""
REFERENCE_DENSITY_KG_M3 = 1.185
"""Density of air at the reference state of ISO 6358-1 (20 degC, 100 kPa, 65 %)."""
_CONDUCTANCE_UNIT = 1e-3 / 1e5
"""m^3/(s Pa) in one dm^3/(s bar), the unit of sonic conductance in data sheets."""
_STABLE_STEP = 0.9
"""Largest time step over shortest time constant. An explicit step does not overshoot below 1."""


@dataclass(frozen=True)
class PneumaticParameters:
    """Volumes, conductances, pump and valves of one ankle."""

    ambient_pa: float = STANDARD_ATMOSPHERE_PA
    """Pressure of the atmosphere, Pa. Assumed: the standard one."""
    temperature_k: float = 293.15
    """Temperature of all air, K. Assumed: 20 degC, as the tendon's constants are."""
    manifold_volume_m3: float = 15e-6
    """Manifold and the hose to the pump, m^3. Assumed."""
    reservoir_volume_m3: float = 0.0
    """Reservoir between pump and manifold, m^3; 0: none, as in the paper. Its port is wide beside the valves, so that
    it has the manifold's pressure."""
    tendon_volume_m3: float = 6e-6
    """Free air in one tendon with its share of tube, m^3. Assumed; does not change with extension."""
    valve_conductance_dm3_s_bar: float = 0.1
    """Sonic conductance of solenoid and tube in series, either way. Assumed."""
    leak_conductance_dm3_s_bar: float = 1e-4
    """Sonic conductance from the atmosphere into each volume. Assumed: a good membrane."""
    critical_ratio: float = 0.5
    """Pressure ratio below which an orifice chokes (`b` of ISO 6358). Assumed; data sheets say 0.2 to 0.5."""
    linear_ratio: float = 0.99
    """Pressure ratio above which an orifice is linear. Assumed; ISO 6358 leaves it to the user."""
    pump_free_flow_l_min: float = 6.0
    """Volume that the pump draws in at full duty without vacuum, l/min. Assumed; proportional to duty."""
    pump_ultimate_vacuum_pa: float = 80e3
    """Vacuum at which the pump stops drawing, at any duty, Pa. Assumed. Its valves let nothing back."""
    pump_filling: float = 0.0
    """Shape of the pump's curve. Assumed: 0, so that the volume that it draws in falls in proportion to the vacuum;
    with 1 the mass does, as data sheets of diaphragm pumps draw it and a dead volume whose air expands makes it."""
    valve_dead_time_s: float = 0.010
    """Time from command to movement, both ways, s. Assumed; small solenoids have 5 to 20 ms."""
    valve_crossover_s: float = 0.0
    """Time for which a valve that switches is as good as open from the atmosphere to the manifold, s, since all three
    ports of a seat valve are connected while its armature travels. Assumed: 0, none."""
    manifold_thermal_time_s: float = 0.0
    """Time in which air at the pressure of the room takes on the temperature of the manifold's walls, s. Assumed: 0,
    which is isothermal. 15 ml between 40 cm^2 of wall, at 5 to 15 W/(m^2 K), have 0.2 to 0.6 s."""
    tendon_thermal_time_s: float = 0.0
    """The same of tendons and tubes, s. Assumed: 0; among fibres a wall is nearer."""


def pneumatic_law(parameters: PneumaticParameters, timestep_s: float) -> NDArray[Any]:
    """Constants for one time step, shape (1,) of PNEUMATIC_LAW, with as many substeps as the smallest volume needs."""
    law = np.zeros(1, dtype=records.PNEUMATIC_LAW)
    record = law[0]
    energy_j_kg = _GAS_CONSTANT_J_KG_K * parameters.temperature_k
    tendons = [len(TENDONS_OF_CHANNEL[channel]) for channel in CHANNELS]
    manifold_m3 = parameters.manifold_volume_m3 + parameters.reservoir_volume_m3
    volumes_m3 = np.array([manifold_m3, *(parameters.tendon_volume_m3 * count for count in tendons)])
    valve_kg_s_pa = np.full(records.VALVES, conductance_kg_s_pa(parameters.valve_conductance_dm3_s_bar))
    leak_kg_s_pa = np.full(records.VOLUMES, conductance_kg_s_pa(parameters.leak_conductance_dm3_s_bar))
    free_flow_m3_s = parameters.pump_free_flow_l_min * 1e-3 / 60.0
    record["ambient_pa"] = parameters.ambient_pa
    record["specific_energy_j_kg"] = energy_j_kg
    record["volume_m3"] = volumes_m3
    record["valve_kg_s_pa"] = valve_kg_s_pa
    record["leak_kg_s_pa"] = leak_kg_s_pa
    record["critical_ratio"] = parameters.critical_ratio
    record["linear_ratio"] = parameters.linear_ratio
    record["pump_free_flow_m3_s"] = free_flow_m3_s
    record["pump_ultimate_vacuum_pa"] = parameters.pump_ultimate_vacuum_pa
    record["pump_filling"] = parameters.pump_filling
    record["valve_dead_time_s"] = parameters.valve_dead_time_s
    record["crossover_kg_s_pa"] = valve_kg_s_pa
    record["valve_crossover_s"] = parameters.valve_crossover_s
    record["thermal_time_s"] = parameters.tendon_thermal_time_s
    record["thermal_time_s"][0] = parameters.manifold_thermal_time_s
    record["step_s"] = timestep_s
    record["substeps"] = stable_substeps(law)
    return law


def conductance_kg_s_pa(conductance_dm3_s_bar: float) -> float:
    """Return a sonic conductance, dm^3/(s bar), as the mass flow per pressure that the law has, kg/(s Pa)."""
    return conductance_dm3_s_bar * (_CONDUCTANCE_UNIT * REFERENCE_DENSITY_KG_M3)


def stable_substeps(law: NDArray[Any]) -> int:
    """Return how many parts each time step needs, so that no volume overshoots.

    Args:
        law: Shape (1,) of PNEUMATIC_LAW; its substeps are not looked at.

    """
    record = law[0]
    # Steepest mass flow per pressure difference of each orifice, then rates (1/s) of each volume. Two volumes that
    # exchange air approach each other at no more than the sum of their rates.
    ellipse = (record["linear_ratio"] - record["critical_ratio"]) / (1.0 - record["critical_ratio"])
    slope = math.sqrt(1.0 - ellipse**2) / (1.0 - record["linear_ratio"])
    per_volume = record["specific_energy_j_kg"] / record["volume_m3"]
    channel_rates = slope * (record["valve_kg_s_pa"] + record["leak_kg_s_pa"][1:]) * per_volume[1:]
    pump_rate = record["pump_free_flow_m3_s"] / record["volume_m3"][0]
    pump_rate *= record["ambient_pa"] / record["pump_ultimate_vacuum_pa"]
    through = record["valve_kg_s_pa"].sum() + record["crossover_kg_s_pa"].sum() + record["leak_kg_s_pa"][0]
    manifold_rate = slope * through * per_volume[0] + pump_rate
    # Adiabatic volumes are as much stiffer. Others, and valves without crossover, take as many parts, so that pressures
    # do not jump where either begins.
    fastest = kernels.HEAT_CAPACITY_RATIO * float(manifold_rate + channel_rates.max())
    return max(1, math.ceil(float(record["step_s"]) * fastest / _STABLE_STEP))


def vented_state(law: NDArray[Any]) -> NDArray[Any]:
    """Everything at ambient pressure, pump off, solenoids released; shape (1,) of PNEUMATIC_STATE."""
    state = state_at(law, np.full(records.VOLUMES, law["ambient_pa"][0]))
    state["settled"] = 0.0
    return state


def state_at(law: NDArray[Any], pressure_pa: NDArray[np.float64]) -> NDArray[Any]:
    """Air at rest at absolute pressures, Pa, shape (VOLUMES,), however the valves stand; shape as of `vented_state`."""
    state = np.zeros(1, dtype=records.PNEUMATIC_STATE)
    state["pressure_pa"] = pressure_pa
    state["mass_kg"] = state["pressure_pa"] * law["volume_m3"] / law["specific_energy_j_kg"][:, np.newaxis]
    state["settled"] = records.UNKNOWN
    return state


BORE_M = 0.0025
"""Inner diameter of a hose, m: polyurethane of 4/2.5 mm, the common size for valves of 0.1 dm^3/(s bar). Data sheet."""
_SOUND_M_S = 343.0
"""Speed of sound in air of 20 degC; in a hose a change of pressure travels with it."""
_TUBE, _INLET = 0.029, 510.0
"""Conductance of a tube by its bore D and length L, both in m: 0.029 D^2 / sqrt(L / D^1.25 + 510), m^3/(s Pa). From
Eckersten, as in Beater, Pneumatic Drives, 2007, for the turbulent flow of ISO 6358; 510 is its inlet."""


def hose_volume_m3(length_m: float) -> float:
    """Return the air in a hose, m^3."""
    return math.pi / 4.0 * BORE_M**2 * length_m


def hose_travel_s(length_m: float) -> float:
    """Return how long a change of pressure takes to its end, s."""
    return length_m / _SOUND_M_S


def conductance_behind_hose(conductance_m3_s_pa: float, length_m: float) -> float:
    """Return the sonic conductance, m^3/(s Pa), of a valve with so much more hose behind it.

    In series the inverse cubes of conductances add up (ISO 6358-3); the inlet of the hose is the valve's own.

    Args:
        conductance_m3_s_pa: Of the valve with what is behind it already.
        length_m: More hose, m.

    """
    bare, long = (_INLET + part / BORE_M**1.25 for part in (0.0, length_m))
    narrower = (long**1.5 - bare**1.5) / (_TUBE * BORE_M**2) ** 3
    together: float = (conductance_m3_s_pa**-3 + narrower) ** (-1.0 / 3.0)
    return together
