"""One specimen of the machine: what it is made of, its sensors and clocks, and the verbs that change one part of it."""

from __future__ import annotations

import dataclasses
import math
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from jammkle_common.constants import STANDARD_ATMOSPHERE_PA
from jammkle_common.names import CHANNELS, TENDONS, TENDONS_OF_CHANNEL
from studies.blind.reality.bodies import SOLE_N_M15, corners_m, turned_about_y

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Sensor:
    """A channel of measurement."""

    white: float
    """Standard deviation of the noise that has no memory."""
    slow: float
    """Standard deviation of the noise that has."""
    memory_s: float
    """How long it has."""
    step: float
    """Smallest step of the converter."""
    lag_s: float = 0.0
    """First-order lag before the converter."""
    delay_s: float = 0.0
    """From the quantity to the reading."""
    gain: float = 1.0
    offset: float = 0.0
    limit: float = math.inf
    """Largest reading, both ways."""


@dataclass(frozen=True)
class Imu:
    """Accelerometer and gyro."""

    acceleration: Sensor = Sensor(0.012, 0.004, 0.05, 0.0024, limit=71.02 + 9.80665)
    """Noise: declared 80 ug/rtHz over 225 Hz. Range: paper. 16 bits of 8 g."""
    rate: Sensor = Sensor(0.0013, 0.0004, 0.05, 0.00053, limit=math.radians(900.0))
    """Noise: declared 0.005 deg/s/rtHz. Range: declared."""
    bandwidth_hz: float = 225.0
    """Declared. Here a Butterworth filter of the second order."""
    offset_m_s2: tuple[float, float, float] = (0.0, 0.0, 0.0)
    offset_rad_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """How it sits on its mount: roll, then pitch, then yaw, about the mount's axes."""
    clip: float = 1.0
    """Factor on the range of the accelerometer."""
    delay_s: float = 0.0


@dataclass(frozen=True)
class Clock:
    """Stamps and the recorder."""

    skew: float = 0.0
    """How much faster the sensors' clock runs than the recorder's."""
    sample_jitter_s: float = 6e-5
    """Standard deviation of the moment of a sample. Assumed."""
    stamp_jitter_s: float = 2e-5
    """Standard deviation of its stamp. Assumed."""
    log_s: float = 0.0012
    """Shortest time from stamp to log. Assumed."""
    log_jitter_s: float = 0.0009
    """Mean of the exponential delay on top. Assumed."""
    dropped: float = 0.002
    """Share of the samples that are lost. Assumed."""
    command_delay_s: float = 0.0008
    """From a command to the coil. Assumed."""


@dataclass(frozen=True)
class Sensors:
    """All of them."""

    pressure: tuple[Sensor, ...] = (Sensor(40.0, 30.0, 0.03, 12.0, lag_s=0.0015),) * (1 + len(CHANNELS))
    """Manifold, then CHANNELS, Pa. Noise: declared 50 Pa."""
    load_cell: Sensor = Sensor(0.04, 0.03, 0.02, 0.015, lag_s=0.0012, limit=245.0)
    """Noise: declared 0.05 N. Range: paper. 15 bits."""
    tension: Sensor = Sensor(0.05, 0.03, 0.02, 0.02, lag_s=0.0012)
    """Gauge in the end plate of an instrumented tendon, N. Assumed: as the load cell."""
    extension: Sensor = Sensor(4e-6, 2e-6, 0.05, 2e-6)
    """Of a tendon, m. Assumed: a small linear encoder."""
    slide: Sensor = Sensor(3e-6, 1e-6, 0.05, 2.5e-6)
    """Crosshead or carriage, m. Assumed: a linear encoder."""
    angle: Sensor = Sensor(1.5e-4, 1e-4, 0.05, 2.0 * math.pi / 2**14)
    """Of a joint, rad. Assumed: 14 bits."""
    imu: Imu = dataclasses.field(default_factory=Imu)
    clock: Clock = dataclasses.field(default_factory=Clock)
    spikes_hz: float = 0.0
    """Electrical spikes on the load cell per second."""
    spike_n: float = 0.0
    """Size of a spike, N."""
    cell_creep: float = 0.0
    """Share by which the load cell reads on under a load that stays."""
    cell_creep_s: float = 2.0
    """Time in which it does."""


@dataclass(frozen=True)
class Leg:
    """Leg, foot, floor and slide of one machine. The paper gives the ankle's mass, no drawing; the rest is declared."""

    ankle_kg: float = 0.352
    """Ankle with its foot. Paper."""
    toe_m: float = 0.060
    """Forward of the joint. Assumed."""
    dropped_toe_m: float = 0.0506
    """The same where a foot lands toe-down on level ground: the rounded toe touches behind its tip. Chosen for the drop
    test."""
    heel_m: float = 0.045
    """Behind the joint. Assumed."""
    half_width_m: float = 0.030
    """Assumed."""
    hung_rad: float = 0.0
    """How much further toe-down than planned the foot hangs on its tendons."""
    sole_m: float = 0.020
    """Joint above sole. Assumed."""
    corner_radius_m: float = 0.005
    """Assumed."""
    sole_n_m15: float = SOLE_N_M15
    """Of one corner, force over depth to the power of 1.5."""
    grip: float = 1.0
    """Factor on the friction of the floor that is planned."""
    payload_kg: float = 0.0
    """On the carriage, beyond what is planned."""
    mat_m_n: float = 0.0
    """How far a mat on the floor gives under each corner, per force."""
    floor_rad: float = 0.0
    """How much steeper the floor is than planned, toe uphill."""
    pin_play_m: float = 0.0
    """How far the pins that hold the tendons can slide in worn holes."""
    cramped_rad: float = 0.0
    """How much earlier than drawn foot and leg meet."""
    bent_rad: float = 0.0
    """How far the toe is bent up."""
    twisted_rad: float = 0.0
    """How far the toe is twisted to the left."""
    plate_gap_m: float = 0.0
    """How far a loose plate on the foot can move; 0: it is screwed on."""
    rail_n: float = 0.0
    """Sliding friction of the carriage's rail. The paper: "no resistance against the platform's freefall"."""
    rail_tight_m: float = 0.0
    """Where the rail rubs."""
    rail_width_m: float = 0.0
    """How far that reaches; 0: all the way."""
    cable_n: float = 0.0
    """Upward pull of a cable on the carriage as the foot touches the floor."""
    cable_n_m: float = 0.0
    """By how much more it pulls per way down."""
    mount_s2: float = 0.0
    """How soft the IMU is mounted: way that it gives per acceleration."""

    def as_built(self) -> Leg:
        """Return the leg before its foot was bent: what the rig was set up with."""
        return dataclasses.replace(self, bent_rad=0.0, twisted_rad=0.0)

    def corners_m(self, toe_m: float) -> Floats:
        """Return the centres of the sole's corners: toe left, right, heel left, right, shape (4, 3)."""
        down, wide = self.corner_radius_m - self.sole_m, self.half_width_m
        up = toe_m * math.tan(self.bent_rad)
        twist = wide * math.tan(self.twisted_rad)
        toes = ((toe_m, wide, down + up + twist), (toe_m, -wide, down + up - twist))
        return corners_m(*toes, (-self.heel_m, wide, down), (-self.heel_m, -wide, down))

    def foot_inertia_kg_m2(self, foot_kg: float) -> Floats:
        """Return that of a plate of the foot's size about its centre, shape (3,)."""
        length, width, height = self.toe_m + self.heel_m, 2.0 * self.half_width_m, self.sole_m
        return foot_kg / 12.0 * np.array([width**2 + height**2, length**2 + height**2, length**2 + width**2])

    def touch_height_m(self, toe_m: float, pitch_rad: float, slope_rad: float) -> float:
        """Return how high the joint stands, straight above the floor, as the first corner of the foot touches it.

        Args:
            toe_m: Lever of the toe.
            pitch_rad: Of the foot, toe-down.
            slope_rad: Of the floor as planned, toe uphill.

        """
        centres = self.corners_m(toe_m) @ turned_about_y(pitch_rad).T
        out = np.array([-math.sin(slope_rad), 0.0, math.cos(slope_rad)])
        return float((self.corner_radius_m - centres @ out).max() / out[2])


PLAIN = Leg()
"""As drawn."""


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
"""Seed of a run in which nothing is left to chance: no noise, no jitter, nothing lost, every setting as planned."""


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


P = TypeVar("P")

MANIFOLD = "manifold"
PAIRS = {
    "achilles_pair": TENDONS_OF_CHANNEL["achilles"],
    "peroneal_pair": (*TENDONS_OF_CHANNEL["peroneal_left"], *TENDONS_OF_CHANNEL["peroneal_right"]),
}
"""Tendons that are clamped together."""


def with_air(machine: Machine, change: Callable[[Air], Air]) -> Machine:
    """Return the machine with other air."""
    return dataclasses.replace(machine, air=change(machine.air))


def with_pump(machine: Machine, change: Callable[[Pump], Pump]) -> Machine:
    """Return the machine with another pump."""
    return with_air(machine, lambda air: dataclasses.replace(air, pump=change(air.pump)))


def with_lines(machine: Machine, channels: tuple[str, ...], change: Callable[[Line], Line]) -> Machine:
    """Return the machine with other lines of some channels."""

    def lines(air: Air) -> Air:
        changed = tuple(
            change(line) if channel in channels else line for channel, line in zip(CHANNELS, air.lines, strict=True)
        )
        return dataclasses.replace(air, lines=changed)

    return with_air(machine, lines)


def with_tendons(machine: Machine, place: str, change: Callable[[TendonMake], TendonMake]) -> Machine:
    """Return the machine with other tendons; no place means all of them, a place is one or a pair."""
    chosen = PAIRS.get(place, (place,)) if place else TENDONS
    changed = tuple(
        change(make) if name in chosen else make for name, make in zip(TENDONS, machine.tendons, strict=True)
    )
    return dataclasses.replace(machine, tendons=changed)


def with_sensors(machine: Machine, change: Callable[[Sensors], Sensors]) -> Machine:
    """Return the machine with other sensors."""
    return dataclasses.replace(machine, sensors=change(machine.sensors))


def with_imu(machine: Machine, change: Callable[[Imu], Imu]) -> Machine:
    """Return the machine with another IMU."""
    return with_sensors(machine, lambda sensors: dataclasses.replace(sensors, imu=change(sensors.imu)))


def with_clock(machine: Machine, change: Callable[[Clock], Clock]) -> Machine:
    """Return the machine with other clocks."""
    return with_sensors(machine, lambda sensors: dataclasses.replace(sensors, clock=change(sensors.clock)))


def with_pressure_sensor(machine: Machine, place: str, change: Callable[[Sensor], Sensor]) -> Machine:
    """Return the machine with another pressure sensor at the manifold or a channel."""
    index = (MANIFOLD, *CHANNELS).index(place)

    def swap(sensors: Sensors) -> Sensors:
        changed = tuple(change(each) if i == index else each for i, each in enumerate(sensors.pressure))
        return dataclasses.replace(sensors, pressure=changed)

    return with_sensors(machine, swap)


def plus(part: P, **additions: float) -> P:
    """Return a dataclass with something added to some fields."""
    changed = {name: getattr(part, name) + value for name, value in additions.items()}
    return cast("P", dataclasses.replace(cast("Any", part), **changed))


def times(part: P, **factors: float) -> P:
    """Return a dataclass with some fields multiplied."""
    changed = {name: getattr(part, name) * value for name, value in factors.items()}
    return cast("P", dataclasses.replace(cast("Any", part), **changed))
