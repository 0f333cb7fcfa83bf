"""One specimen of the machine: what it is made of, how specimens differ, and how one day differs from the next.

"Paper" is the Jammkle paper. "Calibrated" says to which of its rows; "declared" means that the paper has no number and
that the project's declared assumption is taken over, in physical units; "assumed" that nobody has said anything yet.
Scatter over specimens and days is assumed unless a row of the paper's table says how far five repeats differ.
"""

from __future__ import annotations

import dataclasses
import math
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from jammkle_common.constants import STANDARD_ATMOSPHERE_PA
from jammkle_common.names import CHANNELS, TENDONS, TENDONS_OF_CHANNEL
from studies.blind.reality.instruments import Sensors
from studies.blind.reality.leg import Leg

GAS_J_KG_K = 287.05
"""Specific gas constant of dry air, J/(kg K)."""
HEAT_RATIO = 1.4
"""Heat capacities of air, at constant pressure over at constant volume."""
ROOM_K = 293.15
"""Temperature at which the paper's tendons are taken to have been tested, K. Assumed: 20 degC."""
_CHOKED: float = math.sqrt(HEAT_RATIO / (GAS_J_KG_K * ROOM_K)) * (2.0 / (HEAT_RATIO + 1.0)) ** (
    (HEAT_RATIO + 1.0) / (2.0 * (HEAT_RATIO - 1.0))
)
"""Mass flow of a choked nozzle per area and upstream pressure at ROOM_K, s/m."""
_CONDUCTANCE_KG_S_PA = 1e-8 * 1.185
"""Mass flow per upstream pressure of a sonic conductance of 1 dm3/(s bar) (ISO 6358-1)."""


def nozzle_area_m2(conductance_dm3_s_bar: float) -> float:
    """Return the effective area of a nozzle that chokes at the mass flow of a sonic conductance."""
    return conductance_dm3_s_bar * (_CONDUCTANCE_KG_S_PA / _CHOKED)


def conductance_dm3_s_bar(area_m2: float) -> float:
    """Return the sonic conductance of a nozzle: the inverse of `nozzle_area_m2`."""
    return area_m2 / (_CONDUCTANCE_KG_S_PA / _CHOKED)


@dataclass(frozen=True)
class Pump:
    """A diaphragm pump with two heads."""

    free_flow_m3_s: float = 6.0e-3 / 60.0
    """Volume drawn in per time at full duty without vacuum. Declared: 6 l/min."""
    ultimate_vacuum_pa: float = 80e3
    """Vacuum at which it draws nothing. Declared."""
    bulge: float = -0.05
    """How far the flow lies above the straight line between the two: `1 + bulge x`, x the share of the ultimate vacuum;
    below 0 it sags. Calibrated to the declared times to -50 kPa: 0.24 s with one tendon, 0.48 s with all four."""
    ripple: float = 0.12
    """Share of the flow that comes and goes with the strokes. Assumed: two heads out of phase."""
    stroke_hz: float = 87.0
    """Strokes per second at full duty, falling with it. Assumed: 2600 per minute, both heads."""
    return_area_m2: float = 0.0
    """Area through which air flows back through its valves, m^2. Assumed: none when healthy."""


@dataclass(frozen=True)
class Line:
    """One channel: solenoid at the manifold, tube, tendon or pair of them with the pressure sensor at its fitting."""

    valve_area_m2: float = nozzle_area_m2(0.1) * 1.03
    """Effective area of each seat, m^2. Declared: 0.1 dm3/(s bar) for solenoid and tube; the tube takes 3 %."""
    laminar_per_m_s: float = 9.4e6
    """Laminar loss: pressure times density over mass flow. Half a metre of 2.5 mm bore, assumed (Hagen-Poiseuille)."""
    turbulent_per_m4: float = 1.56e11
    """Turbulent loss: pressure times density over mass flow squared. The same tube with its fittings."""
    tube_volume_m3: float = 1.5e-6
    """Air between solenoid and tendon. Declared: 6 ml per tendon with its share of tube."""
    tendon_volume_m3: float = 4.5e-6
    """Air in the tendons."""
    tube_wall_w_k: float = 0.02
    """Heat from the wall to the air of the tube per difference of temperature, W/K. Assumed: 10 W/(m2 K)."""
    tendon_wall_w_k: float = 0.25
    """The same of the tendons, whose 18 fibres have a large surface. Assumed."""
    leak_area_m2: float = nozzle_area_m2(1e-4)
    """Hole to the atmosphere at the tendon. Declared: 1e-4 dm3/(s bar)."""
    dead_s: float = 0.006
    """From the coil's current to the first movement. Declared with `travel_s`: half open after 10 ms."""
    travel_s: float = 0.008
    """From the first movement to the other seat."""
    dead_jitter_s: float = 0.0004
    """Standard deviation of `dead_s` from switch to switch. Assumed."""
    stick_share: float = 0.0
    """Share of the switches at which the armature sticks."""
    stick_s: float = 0.0
    """How long it then does."""
    slug_pa: float = 0.0
    """Pressure that a slug of water in the tube holds up before it moves, Pa."""


def _line(channel: str) -> Line:
    count = len(TENDONS_OF_CHANNEL[channel])
    plain = Line()
    return dataclasses.replace(
        plain,
        tube_volume_m3=count * plain.tube_volume_m3,
        tendon_volume_m3=count * plain.tendon_volume_m3,
        tube_wall_w_k=count * plain.tube_wall_w_k,
        tendon_wall_w_k=count * plain.tendon_wall_w_k,
    )


@dataclass(frozen=True)
class Air:
    """Pump, manifold and lines on one day."""

    ambient_pa: float = STANDARD_ATMOSPHERE_PA
    room_k: float = ROOM_K
    manifold_volume_m3: float = 15e-6
    """Declared."""
    manifold_wall_w_k: float = 0.06
    """Assumed: 15 W/(m2 K)."""
    manifold_leak_area_m2: float = nozzle_area_m2(1e-4)
    """Declared."""
    pump: Pump = dataclasses.field(default_factory=Pump)
    lines: tuple[Line, ...] = dataclasses.field(default_factory=lambda: tuple(_line(each) for each in CHANNELS))
    """In the order of CHANNELS."""


@dataclass(frozen=True)
class Material:
    """A printed elastomer."""

    modulus_pa: float
    """Initial shear modulus after endless time, Pa."""
    limit: float
    """Gent's limit of `I1 - 3`, at which the chains are straight."""
    relaxation: float
    """Gain of the power-law relaxation over the long-term stress at 1 s."""
    softening_per_k: float
    """Relative fall of the modulus per kelvin."""


@dataclass(frozen=True)
class TendonMake:
    """One tendon: two groups of fibres mirrored about the middle, that slide along each other."""

    soft: Material = Material(modulus_pa=155.3e3, limit=2.41, relaxation=1.051, softening_per_k=0.139)
    """Shore A-30. Modulus and limit calibrated to rows a30_atm and membrane_atm; relaxation to the declared rates
    (19.0 N at 0.5 mm/s to 50.6 N at 1 m/s); temperature: falls fourfold from 20 to 30 degC (declared)."""
    stiff: Material = Material(modulus_pa=1.887e6, limit=60.0, relaxation=0.736, softening_per_k=0.05)
    """Shore A-85. Modulus calibrated to row a85_atm; the rest assumed."""
    exponent: float = 0.193
    """Exponent of the relaxation over time. Calibrated to the declared rates."""
    shortest_s: float = 0.0005
    """Time below which the material is glass and relaxes no more. Assumed."""
    area_m2: float = 18 * math.pi * 1e-6
    """Cross-section of 18 fibres of 2 mm. Paper."""
    soft_length_m: float = 0.030
    """Paper."""
    length_m: float = 0.080
    """Free fibre between the end plates. Paper; read: 5 mm of the stiff section sits in the plate."""
    friction_soft: float = 0.75
    """Coefficient of soft on stiff. Paper."""
    friction_stiff: float = 0.99
    """Coefficient of stiff on stiff, in the overlap. Paper."""
    contact_share: float = 0.685
    """Share of the vacuum that presses fibre on fibre. Calibrated to rows multi_vac10, multi_vac30, multi_vac50."""
    contact_onset_pa: float = 8.83e3
    """Vacuum that the membrane itself takes up before it presses. Calibrated to the same rows."""
    bristle_m: float = 0.0003
    """Slip after which a contact at 50 kPa slides. Assumed. The loss of a jammed cycle comes out at 43 %, where 32 % is
    declared; no slip that keeps the tensile table brings it below 41 %."""
    striction: float = 0.08
    """How much more a contact holds at rest than sliding, relative. Assumed."""
    stribeck_m_s: float = 0.002
    """Speed of slip at which that is gone. Assumed."""
    confinement: float = 0.115
    """Relative gain of the fibres' stress at full vacuum, squeezed by the membrane. Calibrated to rows a30_vac50 and
    a85_vac50."""
    confinement_pa: float = 20e3
    """Vacuum at which two thirds of that are there. Assumed."""
    plate_area_m2: float = 31.5e-6
    """Area by which the vacuum pulls the end plates together. Calibrated to the same rows."""
    plate_travel_m: float = 0.0015
    """Extension over which the fibres hand that pull over to the clamps. Assumed."""
    membrane_n_m: float = 0.0
    """Stiffness of the membrane beyond what is calibrated in the fibres, N/m."""
    break_m: float = 0.055
    """Paper."""
    left: float = 1.0
    """Share of the fibres that are whole."""
    end_share: float = 1.0
    """Share of the end fitting that still holds."""
    damage: float = 0.0
    """Share of the stress that stretching on and on takes away."""
    damage_stretch: float = 1.0
    """Stretch done, summed up, after which two thirds of that are gone."""
    shorter_m: float = 0.0
    """How much shorter than drawn it is, m."""
    warming_k_s: float = 0.0
    """How fast it warms up, K/s."""
    offset_k: float = 0.0
    """Warmer than ROOM_K, K."""


@dataclass(frozen=True)
class Regulator:
    """The firmware that keeps the vacuum."""

    gain_per_pa: float = 2.5e-4
    """Duty per missing pascal. Declared: the driver's."""
    integral_s: float = 0.5
    """Declared: the driver's."""
    lead_pa: float = 2e3
    """How much deeper the manifold may be than the set point. Declared: the driver's."""
    duty_steps: int = 255
    """Of the pump's pulse width."""


@dataclass(frozen=True)
class Ankle:
    """Lever arms and masses. Declared: the project's drawing, as the paper has none."""

    foot_kg: float = 0.120
    foot_inertia_kg_m2: tuple[float, float, float] = (4.0e-5, 1.15e-4, 1.46e-4)
    """About x, y, z through the joint."""
    foot_centre_m: tuple[float, float, float] = (0.008, 0.0, -0.008)
    achilles_arm_m: float = 0.0374
    achilles_spread_m: float = 0.015
    peroneal_forward_m: float = 0.025
    peroneal_spread_m: float = 0.030
    tendon_length_m: float = 0.118
    achilles_pretension_m: float = 0.0015
    joint_viscous_n_m_s: float = 0.005
    """Chosen for the drop test, with the sole's contact: the means of both ankles."""
    joint_dry_n_m: float = 0.001
    """Assumed: a printed ball in its socket."""


@dataclass(frozen=True)
class Rig:
    """The test machine."""

    speed_error: float = 0.0
    """Relative error of the crosshead's speed."""
    late_s: float = 0.0
    """How late a drive starts or a latch lets go, always, s."""
    start_jitter_s: float = 0.0
    """How late the crosshead starts today, s."""
    ramp_m_s2: float = 0.5
    """Acceleration of the crosshead. Assumed."""
    clamp_m_per_n: float = 2.2e-5
    """Give of the clamps. Assumed; its scatter makes the stiff tendons' repeats differ as in the paper."""
    mounting_m: float = 0.0
    """How far off the tendon is clamped today, m."""


@dataclass(frozen=True)
class Machine:
    """One specimen on one day. Tendons in the order of TENDONS."""

    air: Air = dataclasses.field(default_factory=Air)
    tendons: tuple[TendonMake, ...] = dataclasses.field(default_factory=lambda: (TendonMake(),) * len(TENDONS))
    sensors: Sensors = dataclasses.field(default_factory=Sensors)
    regulator: Regulator = dataclasses.field(default_factory=Regulator)
    ankle: Ankle = dataclasses.field(default_factory=Ankle)
    leg: Leg = dataclasses.field(default_factory=Leg)
    rig: Rig = dataclasses.field(default_factory=Rig)


STILL = -1
"""Seed of a run in which nothing is left to chance: no noise, no jitter, nothing lost, every setting as told."""


class _Middle(np.random.Generator):
    """Random numbers that are all in the middle of what they could be."""

    def standard_normal(self, size: Any = None, dtype: Any = None, out: Any = None) -> Any:
        del dtype, out
        return 0.0 if size is None else np.zeros(size)

    def random(self, size: Any = None, dtype: Any = None, out: Any = None) -> Any:
        del dtype, out
        return 0.5 if size is None else np.full(size, 0.5)

    def exponential(self, scale: Any = 1.0, size: Any = None) -> Any:
        return scale if size is None else np.full(size, scale)


def stream(seed: int, name: str) -> np.random.Generator:
    """Return the random numbers of one purpose: none depends on how many another one took."""
    if seed == STILL:
        return _Middle(np.random.PCG64(0))
    return np.random.default_rng([seed, zlib.crc32(name.encode())])
