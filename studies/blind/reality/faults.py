"""What can be wrong with the machine: every fault changes constants of a specimen, and at null changes nothing.

A fault names the effect of the library that it corresponds to, as plain text, or none where the library has no name for
it. Sizes are in the machine's own terms; `effect_values` says what the effect's parameters would be, where that has a
meaning. All of them are rows of one table, `_TABLE`.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

from jammkle_common.names import CHANNELS, TENDONS
from studies.blind.reality.machine import (
    MANIFOLD,
    PAIRS,
    conductance_dm3_s_bar,
    nozzle_area_m2,
    plus,
    times,
    with_air,
    with_clock,
    with_imu,
    with_lines,
    with_pressure_sensor,
    with_pump,
    with_sensors,
    with_tendons,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from studies.blind.reality.machine import Machine

    Sizes = Mapping[str, float]
    Change = Callable[[str, Machine, Sizes], Machine]
    """Changes a machine at a place, by the sizes of a fault."""


class BadFaultError(ValueError):
    """There is no such fault, or its size is out of range. The message names value, limit and way out."""


@dataclass(frozen=True)
class FaultParameter:
    """One size of a fault."""

    unit: str
    null: float
    """Where the machine is in order."""
    minimum: float
    maximum: float


@dataclass(frozen=True)
class Fault:
    """Something that can be wrong."""

    name: str
    subsystem: str
    """Air, tendon, mechanics, sensing or timing."""
    rigs: tuple[str, ...]
    """Where it can show at all."""
    effect: str | None
    """Name of the library's effect, or None where the library has none."""
    parameters: Mapping[str, FaultParameter]
    change: Callable[[Machine, Mapping[str, float]], Machine]
    effect_values: Callable[[Mapping[str, float]], Mapping[str, float]] | None = None
    """Makes the effect's parameters from the fault's, where the two can be compared."""

    def applied(self, machine: Machine, values: Mapping[str, float]) -> Machine:
        """Return the machine with this fault; the very same machine where every size is null.

        Raises:
            BadFaultError: a size that the fault does not have, or out of its range.

        """
        for name, value in values.items():
            if name not in self.parameters:
                msg = f"fault '{self.name}' has no '{name}'; it has {', '.join(self.parameters)}"
                raise BadFaultError(msg)
            row = self.parameters[name]
            if not row.minimum <= value <= row.maximum:
                msg = f"'{name}' of fault '{self.name}' is {value:g}; it must be {row.minimum:g} to {row.maximum:g}"
                msg = f"{msg} {row.unit}"
                raise BadFaultError(msg)
        sizes = {name: float(values.get(name, row.null)) for name, row in self.parameters.items()}
        if all(size == self.parameters[name].null for name, size in sizes.items()):
            return machine
        return self.change(machine, sizes)


@dataclass(frozen=True)
class FaultSetting:
    """One fault as it is in a run."""

    fault: str
    values: Mapping[str, float] = field(default_factory=dict)
    """By name of the parameter; those not given are null."""


def with_faults(machine: Machine, settings: Sequence[FaultSetting]) -> Machine:
    """Return the machine with faults, each applied to what those before it have made of it.

    Raises:
        BadFaultError: there is no such fault, or its size is out of range.

    """
    for setting in settings:
        if setting.fault not in FAULTS:
            msg = f"fault '{setting.fault}' does not exist; known are: {', '.join(sorted(FAULTS))}"
            raise BadFaultError(msg)
        machine = FAULTS[setting.fault].applied(machine, setting.values)
    return machine


def _with(part: str, place: str, machine: Machine, change: Callable[[Any], Any]) -> Machine:
    """Change one part of a machine: a line or tendon by its place, others by their name."""
    placed = {
        "lines": lambda: with_lines(machine, (place,) if place else CHANNELS, change),
        "tendons": lambda: with_tendons(machine, place, change),
        "pressure": lambda: with_pressure_sensor(machine, place, change),
        "air": lambda: with_air(machine, change),
        "pump": lambda: with_pump(machine, change),
        "sensors": lambda: with_sensors(machine, change),
        "imu": lambda: with_imu(machine, change),
        "clock": lambda: with_clock(machine, change),
        "load_cell": lambda: with_sensors(
            machine, lambda each: dataclasses.replace(each, load_cell=change(each.load_cell))
        ),
    }
    return placed[part]() if part in placed else dataclasses.replace(machine, **{part: change(getattr(machine, part))})


def _added(part: str, **fields: str) -> Change:
    """Return the change that adds sizes, by name, to fields of a part."""
    return lambda place, machine, sizes: _with(
        part, place, machine, lambda each: plus(each, **{name: sizes[size] for name, size in fields.items()})
    )


def _scaled(part: str, **fields: str) -> Change:
    """Return the change that multiplies fields of a part by sizes, by name."""
    return lambda place, machine, sizes: _with(
        part, place, machine, lambda each: times(each, **{name: sizes[size] for name, size in fields.items()})
    )


def _put(part: str, fields: Callable[[Sizes], Mapping[str, float]]) -> Change:
    """Return the change that puts what is made of sizes into fields of a part."""
    return lambda place, machine, sizes: _with(
        part, place, machine, lambda each: dataclasses.replace(each, **fields(sizes))
    )


def _shifted(part: str, vector: str, names: Sequence[str]) -> Change:
    """Return the change that adds sizes, by name, to a vector of a part."""

    def change(place: str, machine: Machine, sizes: Sizes) -> Machine:
        more = [sizes[name] for name in names]
        return _with(part, place, machine, lambda each: dataclasses.replace(
            each, **{vector: tuple(a + b for a, b in zip(getattr(each, vector), more, strict=True))}
        ))  # fmt: skip

    return change


def _same(sizes: Sizes) -> Sizes:
    """The effect has the same parameters."""
    return dict(sizes)


def _hole_m2(sizes: Sizes) -> float:
    return _DISCHARGE * math.pi / 4.0 * sizes["diameter_m"] ** 2


def _leak(place: str, machine: Machine, sizes: Sizes) -> Machine:
    if place == MANIFOLD:
        return with_air(machine, lambda air: plus(air, manifold_leak_area_m2=_hole_m2(sizes)))
    return with_lines(machine, (place,), lambda line: plus(line, leak_area_m2=_hole_m2(sizes)))


def _return(_place: str, machine: Machine, sizes: Sizes) -> Machine:
    return with_pump(machine, lambda pump: plus(pump, return_area_m2=_hole_m2(sizes)))


def _kink(place: str, machine: Machine, sizes: Sizes) -> Machine:
    """A tube that is bent shut: the loss of a hole of what is left open, on top of what a line in order loses."""
    loss = 0.5 / ((1.0 - sizes["closed"]) * _PATH_M2) ** 2 - 0.5 / _PATH_M2**2
    return with_lines(machine, (place,), lambda line: plus(line, turbulent_per_m4=loss))


def _hose(place: str, machine: Machine, sizes: Sizes) -> Machine:
    if place == MANIFOLD:
        return with_air(machine, lambda air: plus(air, manifold_volume_m3=sizes["volume_m3"]))
    return with_lines(machine, (place,), lambda line: plus(line, tube_volume_m3=sizes["volume_m3"]))


def _pulsate(_place: str, machine: Machine, sizes: Sizes) -> Machine:
    """One head works against a stuck leaf: strokes half as often, each felt in the manifold."""
    more = sizes["ripple"]
    return with_pump(machine, lambda pump: times(plus(pump, ripple=more), stroke_hz=1.0 - 0.5 * more))


def _recured(_place: str, machine: Machine, sizes: Sizes) -> Machine:
    """Another cure of the print: more or less relaxation, all of it earlier or later in time."""

    def change(make: Any) -> Any:
        # t^-a, slowed down by a factor s, is s^a t^-a; the glassy end moves as well.
        gain = sizes["gain"] * sizes["slower"] ** make.exponent
        soft, stiff = times(make.soft, relaxation=gain), times(make.stiff, relaxation=gain)
        return dataclasses.replace(make, soft=soft, stiff=stiff, shortest_s=make.shortest_s * sizes["slower"])

    return with_tendons(machine, "", change)


def _stiffer(_place: str, machine: Machine, sizes: Sizes) -> Machine:
    def change(make: Any) -> Any:
        soft, stiff = times(make.soft, modulus_pa=sizes["stiffer"]), times(make.stiff, modulus_pa=sizes["stiffer"])
        return dataclasses.replace(make, soft=soft, stiff=stiff)

    return with_tendons(machine, "", change)


def _tacky(_place: str, machine: Machine, sizes: Sizes) -> Machine:
    """Fibres hold more at rest than sliding, and the faster the less."""
    more = sizes["striction"]
    return with_tendons(machine, "", lambda make: times(plus(make, striction=more), stribeck_m_s=1.0 + 4.0 * more))


def _slope(place: str, machine: Machine, sizes: Sizes) -> Machine:
    """A pressure sensor with a wrong slope, right at the atmosphere of a standard day."""
    gain = sizes["gain"]
    return with_pressure_sensor(
        machine, place, lambda sensor: plus(times(sensor, gain=gain), offset=101_325.0 * (1.0 - gain))
    )


def _late(*fields: str) -> Change:
    """Return the change that lets sensors read what was, as behind a filter."""

    def change(_place: str, machine: Machine, sizes: Sizes) -> Machine:
        def later(sensors: Any) -> Any:
            changed: dict[str, Any] = {}
            for name in fields:
                each = getattr(sensors, name)
                one = partial(plus, delay_s=sizes["delay_s"])
                changed[name] = tuple(map(one, each)) if isinstance(each, tuple) else one(each)
            return dataclasses.replace(sensors, **changed)

        return with_sensors(machine, later)

    return change


_DISCHARGE = 0.8
"""Effective over real area of a hole."""
_PATH_M2 = nozzle_area_m2(0.1)
"""Effective area of a whole line in order."""
_FIBRES = 18
"""Of a tendon."""
_ALL = ("tensile", "pressure", "drop", "slip", "landing")
_PULLED, _MOVED = ("tensile", "slip", "drop", "landing"), ("drop", "slip", "landing")
_TURNED, _FALLEN = ("pressure", *_MOVED), ("drop", "landing")
_JOINTS = ("tension", "extension", "slide", "angle")
_SENSED = (MANIFOLD, *CHANNELS)
_ANYWHERE = ("",)
_IMU_M_S2, _IMU_RAD_S = [f"{axis}_m_s2" for axis in "xyz"], [f"{axis}_rad_s" for axis in "xyz"]
_IMU_RAD = [f"{angle}_rad" for angle in ("roll", "pitch", "yaw")]
_DELAY = {"delay_s": ("s", 0.0, 0.0, 0.15)}

# fmt: off
_TABLE: tuple[tuple[Sequence[str], Sequence[tuple[Any, ...]]], ...] = (
    # Places; at each: name, subsystem, rigs, effect, sizes (unit, null, minimum, maximum), change, effect's parameters.
    (_SENSED, [
        # A hole to the atmosphere.
        ("leak_{}", "pneumatics", _ALL, "line_leak_{}", {"diameter_m": ("m", 0.0, 0.0, 0.26e-3)}, _leak,
         lambda sizes: {"conductance_dm3_s_bar": conductance_dm3_s_bar(_hole_m2(sizes))}),
    ]),
    (_ANYWHERE, [
        # A torn diaphragm draws less; worn valves end at less vacuum.
        ("worn_pump", "pneumatics", _ALL, "pump_wear",
         {"flow": ("1", 1.0, 0.25, 1.25), "vacuum": ("1", 1.0, 0.55, 1.15)},
         _scaled("pump", free_flow_m3_s="flow", ultimate_vacuum_pa="vacuum"),
         lambda sizes: {"flow_scale": sizes.get("flow", 1.0), "vacuum_scale": sizes.get("vacuum", 1.0)}),
        # Dirt in the armatures: all of them begin to move later.
        ("late_valves", "pneumatics", _ALL, "valve_dead_time", {"later_s": ("s", 0.0, 0.0, 0.09)},
         _added("lines", dead_s="later_s"), lambda sizes: {"extra_s": sizes["later_s"]}),
    ]),
    (CHANNELS, [
        ("kink_{}", "pneumatics", _ALL, "line_restriction_{}", {"closed": ("1", 0.0, 0.0, 0.97)}, _kink,
         lambda sizes: {"conductance_scale": 1.0 - sizes["closed"]}),
        # Water in the tube: a slug that only moves when pushed hard enough.
        ("water_{}", "pneumatics", _ALL, None, {"slug_pa": ("Pa", 0.0, 0.0, 8e3)}, _added("lines", slug_pa="slug_pa")),
        # An armature that sticks at some of its switches.
        ("sticky_valve_{}", "pneumatics", _ALL, None, {"stuck_s": ("s", 0.0, 0.0, 0.3)},
         _put("lines", lambda sizes: {"stick_share": 0.6, "stick_s": sizes["stuck_s"]})),
        # A weak spring: the armature creeps from seat to seat, and both are open meanwhile.
        ("slow_valve_{}", "pneumatics", _ALL, None, {"longer_s": ("s", 0.0, 0.0, 0.3)},
         _added("lines", travel_s="longer_s")),
    ]),
    (_SENSED, [
        # A longer hose or a big fitting: more air to draw.
        ("long_hose_{}", "pneumatics", _ALL, "trapped_volume_{}", {"volume_m3": ("m3", 0.0, 0.0, 35e-6)}, _hose,
         lambda sizes: {"volume_m3": sizes["volume_m3"]}),
    ]),
    (_ANYWHERE, [
        ("pulsating_pump", "pneumatics", _ALL, None, {"ripple": ("1", 0.0, 0.0, 0.85)}, _pulsate),
        # Leaf valves that do not close: air comes back through the pump.
        ("pump_lets_back", "pneumatics", _ALL, None, {"diameter_m": ("m", 0.0, 0.0, 0.3e-3)}, _return),
        # A fan or a door: the room's pressure is another one.
        ("room_pressure", "pneumatics", _ALL, None, {"pressure_pa": ("Pa", 0.0, -2e3, 2e3)},
         _added("air", ambient_pa="pressure_pa")),
        ("recured", "tendon", _ALL, "viscoelasticity",
         {"gain": ("1", 1.0, 0.1, 2.5), "slower": ("1", 1.0, 0.25, 4.0)}, _recured),
        # Dust, talc or moisture between the fibres: other coefficients of friction.
        ("dusty_fibres", "tendon", _ALL, "jamming_friction", {"friction": ("1", 1.0, 0.1, 2.5)},
         _scaled("tendons", friction_soft="friction", friction_stiff="friction"),
         lambda sizes: {"scale": sizes["friction"]}),
        # Moduli of both materials, by one factor.
        ("stiffer_print", "tendon", _ALL, "tendon_stiffness", {"stiffer": ("1", 1.0, 0.45, 2.2)}, _stiffer,
         lambda sizes: {"scale": sizes["stiffer"]}),
        ("membrane_pulls", "tendon", _ALL, "membrane_stiffness", {"membrane_n_m": ("N/m", 0.0, 0.0, 380.0)},
         _added("tendons", membrane_n_m="membrane_n_m"), lambda sizes: {"stiffness_n_m": sizes["membrane_n_m"]}),
        # Each slice of a fibre loses stress as it is stretched on and on (Mullins).
        ("tired_fibres", "tendon", _ALL, "softening",
         {"damage": ("1", 0.0, 0.0, 0.55), "stretch": ("1", 1.0, 0.2, 5.0)},
         _put("tendons", lambda sizes: {"damage": sizes["damage"], "damage_stretch": sizes["stretch"]})),
        # A lamp or a motor close by: the tendons warm up during the run.
        ("warming_tendons", "tendon", _ALL, None, {"warming_k_s": ("K/s", 0.0, -0.5, 0.5)},
         _added("tendons", warming_k_s="warming_k_s")),
        ("tacky_fibres", "tendon", _ALL, None, {"striction": ("1", 0.0, 0.0, 2.0)}, _tacky),
        # A thick membrane: it takes up more of the vacuum before it presses the fibres.
        ("thick_membrane", "tendon", _ALL, None, {"onset_pa": ("Pa", 0.0, -5e3, 2e4)},
         _added("tendons", contact_onset_pa="onset_pa")),
    ]),
    (tuple(PAIRS), [
        # Clamped at another length than drawn.
        ("clamped_short_{}", "tendon", _ALL, "pretension_{}", {"shorter_m": ("m", 0.0, -0.0045, 0.0045)},
         _added("tendons", shorter_m="shorter_m"), lambda sizes: {"extension_m": sizes["shorter_m"]}),
    ]),
    (TENDONS, [
        # Fibres that carry nothing and rub nothing.
        ("torn_fibres_{}", "tendon", _ALL, "fibre_loss_{}", {"fibres": ("1", 0.0, 0.0, 16.0)},
         lambda place, machine, sizes: with_tendons(
             machine, place, lambda make: times(make, left=1.0 - sizes["fibres"] / _FIBRES)),
         lambda sizes: {"lost": sizes["fibres"] / _FIBRES}),
        # An end fitting that has come off in part.
        ("torn_end_{}", "tendon", _ALL, "tendon_failure_{}", {"off": ("1", 0.0, 0.0, 1.0)},
         lambda place, machine, sizes: with_tendons(
             machine, place, lambda make: times(make, end_share=1.0 - sizes["off"])),
         lambda sizes: {"remaining": 1.0 - sizes["off"]}),
    ]),
    (_SENSED, [
        ("pressure_reads_off_{}", "sensing", _ALL, "pressure_sensor_offset_{}",
         {"offset_pa": ("Pa", 0.0, -4.5e3, 4.5e3)}, _added("pressure", offset="offset_pa"), _same),
    ]),
    (_SENSED, [
        ("pressure_slope_{}", "sensing", _ALL, None, {"gain": ("1", 1.0, 0.85, 1.15)}, _slope),
    ]),
    (_ANYWHERE, [
        ("late_commands", "timing", _ALL, "command_delay", _DELAY, _added("clock", command_delay_s="delay_s"), _same),
        ("late_pressures", "timing", _ALL, "pressure_delay", _DELAY, _late("pressure"), _same),
        ("late_joints", "timing", _ALL, "joint_delay", _DELAY, _late(*_JOINTS), _same),
        ("late_load_cell", "timing", _PULLED, "load_cell_delay", _DELAY, _late("load_cell"), _same),
        ("late_imu", "timing", _MOVED, "imu_delay", _DELAY, _late("imu"), _same),
        ("late_sensors", "timing", _ALL, "sensor_delay", _DELAY,
         _late("pressure", *_JOINTS, "load_cell", "imu"), _same),
        ("clocks_drift", "timing", _ALL, "clock_skew", {"skew": ("1", 0.0, -0.018, 0.018)},
         _added("clock", skew="skew"), _same),
        ("load_cell_gain", "sensing", _PULLED, "load_cell_gain", {"gain": ("1", 1.0, 0.55, 1.45)},
         _scaled("load_cell", gain="gain"), _same),
        ("imu_offset", "sensing", _MOVED, "imu_offset", dict.fromkeys(_IMU_M_S2, ("m/s2", 0.0, -2.7, 2.7)),
         _shifted("imu", "offset_m_s2", _IMU_M_S2), _same),
        ("gyro_offset", "sensing", _MOVED, "gyro_offset", dict.fromkeys(_IMU_RAD_S, ("rad/s", 0.0, -0.45, 0.45)),
         _shifted("imu", "offset_rad_s", _IMU_RAD_S), _same),
        ("crooked_imu", "sensing", _MOVED, "imu_misalignment", dict.fromkeys(_IMU_RAD, ("rad", 0.0, -0.3, 0.3)),
         _shifted("imu", "turn_rad", _IMU_RAD), _same),
        ("imu_clips", "sensing", _MOVED, "imu_saturation", {"range": ("1", 1.0, 0.12, 2.4)},
         _scaled("imu", clip="range"), lambda sizes: {"range_scale": sizes["range"]}),
        # Sparks of a motor beside the cable.
        ("load_cell_spikes", "sensing", _PULLED, None, {"spike_n": ("N", 0.0, 0.0, 20.0)},
         _put("sensors", lambda sizes: {"spikes_hz": 8.0, "spike_n": sizes["spike_n"]})),
        # A badly glued strain gauge.
        ("load_cell_creeps", "sensing", _PULLED, None, {"creep": ("1", 0.0, -0.2, 0.2)},
         _added("sensors", cell_creep="creep")),
        # A link that loses samples of all sensors.
        ("lost_samples", "timing", _ALL, None, {"dropped": ("1", 0.0, 0.0, 0.5)}, _added("clock", dropped="dropped")),
        # Firmware with another gain: it commands otherwise, and the machine obeys.
        ("hasty_regulator", "timing", _ALL, None, {"gain": ("1", 1.0, 0.1, 6.0)},
         _scaled("regulator", gain_per_pa="gain")),
        ("payload", "mechanics", _FALLEN, "payload", {"more_kg": ("kg", 0.0, -0.7, 2.7)},
         _added("leg", payload_kg="more_kg"), lambda sizes: {"mass_kg": sizes["more_kg"]}),
        # Grit or dried grease in the ball joint.
        ("gritty_joint", "mechanics", _TURNED, "ankle_joint_friction",
         {"dry_n_m": ("N m", 0.0, 0.0, 0.45), "viscous_n_m_s": ("N m s", 0.0, 0.0, 0.09)},
         _added("ankle", joint_dry_n_m="dry_n_m", joint_viscous_n_m_s="viscous_n_m_s"),
         lambda sizes: {"coulomb_n_m": sizes["dry_n_m"], "viscous_n_m_s": sizes["viscous_n_m_s"]}),
        # Dust, water or rubber between sole and floor.
        ("floor_grip", "mechanics", _MOVED, "floor_friction", {"grip": ("1", 1.0, 0.25, 1.9)},
         _scaled("leg", grip="grip"), lambda sizes: {"scale": sizes["grip"]}),
        ("mat_on_floor", "mechanics", _MOVED, "floor_compliance", {"give_m_n": ("m/N", 0.0, 0.0, 5e-4)},
         _added("leg", mat_m_n="give_m_n")),
        ("worn_pins", "mechanics", _MOVED, "backlash", {"play_m": ("m", 0.0, 0.0, 0.0045)},
         _added("leg", pin_play_m="play_m"), lambda sizes: {"play_m": sizes["play_m"]}),
        ("loose_foot_plate", "mechanics", _MOVED, None, {"gap_m": ("m", 0.0, 0.0, 0.004)},
         _added("leg", plate_gap_m="gap_m")),
        # A rail that rubs all the way, and holds more at rest.
        ("rail_rubs", "mechanics", _FALLEN, None, {"rub_n": ("N", 0.0, 0.0, 8.0)},
         _put("leg", lambda sizes: {"rail_n": sizes["rub_n"], "rail_width_m": 0.0})),
        # A dent in the rail, somewhere on the way down.
        ("dented_rail", "mechanics", _FALLEN, None, {"rub_n": ("N", 0.0, 0.0, 30.0), "at_m": ("m", 0.0, 0.0, 0.2)},
         _put("leg", lambda sizes: {"rail_n": sizes["rub_n"], "rail_tight_m": sizes["at_m"], "rail_width_m": 0.008})),
        # A cable too short, which pulls the more the lower the carriage.
        ("cable_pulls", "mechanics", _FALLEN, None, {"pull_n": ("N", 0.0, 0.0, 8.0)},
         _put("leg", lambda sizes: {"cable_n": sizes["pull_n"], "cable_n_m": 8.0 * sizes["pull_n"]})),
        ("soft_imu_mount", "sensing", _FALLEN, None, {"softness_s2": ("s2", 0.0, 0.0, 2e-5)},
         _added("leg", mount_s2="softness_s2")),
        ("bent_toe", "mechanics", _MOVED, None, {"bent_rad": ("rad", 0.0, -0.15, 0.15)},
         _added("leg", bent_rad="bent_rad")),
        ("twisted_foot", "mechanics", _MOVED, None, {"twisted_rad": ("rad", 0.0, -0.15, 0.15)},
         _added("leg", twisted_rad="twisted_rad")),
        ("cramped_ankle", "mechanics", ("slip", "landing"), None, {"cramped_rad": ("rad", 0.0, 0.0, 1.0)},
         _added("leg", cramped_rad="cramped_rad")),
        ("crooked_floor", "mechanics", _MOVED, None, {"steeper_rad": ("rad", 0.0, -0.1, 0.1)},
         _added("leg", floor_rad="steeper_rad")),
        # A sole that was printed from another batch or has worn.
        ("other_sole", "mechanics", _MOVED, None, {"stiffer": ("1", 1.0, 0.3, 5.0)},
         _scaled("leg", sole_n_m15="stiffer")),
    ]),
)
# fmt: on


def _fault(place: str, row: tuple[Any, ...]) -> Fault:
    name, subsystem, rigs, effect, sizes, change, *values = row
    parameters = {size: FaultParameter(*numbers) for size, numbers in sizes.items()}
    named = effect and effect.format(place)
    return Fault(name.format(place), subsystem, rigs, named, parameters, partial(change, place), *values)


FAULTS: Mapping[str, Fault] = {
    fault.name: fault for fault in (_fault(place, row) for places, rows in _TABLE for place in places for row in rows)
}
"""By name."""
