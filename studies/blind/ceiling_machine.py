"""What no two machines and no two days have the same in the reality, as constants and scatter of the ceiling."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Final

from jammkle_common.names import CHANNELS, TENDONS
from jammkle_gap.core.effects import Nuisance
from studies.blind.reality import drop, landing, pressure, slip, tensile
from studies.blind.reality.machine import Machine
from studies.blind.reality.places import plus, times
from studies.blind.reality.specimen import RUNS, SPECIMENS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from studies.blind.reality.record import Option

_SOURCE = "the reality's own"
_FACTORS: Final = {
    "machine.pump_flow": SPECIMENS.pump_flow,
    "machine.pump_vacuum": SPECIMENS.pump_vacuum,
    "machine.valve_area": SPECIMENS.valve_area,
    "machine.volume": SPECIMENS.volume,
    "machine.foot_mass": SPECIMENS.foot_mass,
    "machine.achilles_arm": SPECIMENS.lever,
    "machine.peroneal_forward": SPECIMENS.lever,
    "machine.toe": SPECIMENS.lever,
    "machine.heel": SPECIMENS.lever,
    "machine.modulus": SPECIMENS.print_batch,
    "machine.friction": SPECIMENS.friction,
}
_ADDED: Final = {
    "machine.hung": ("rad", SPECIMENS.hung_rad),
    "machine.carriage": ("kg", SPECIMENS.carriage_kg),
    "machine.late": ("s", SPECIMENS.release_s),
    "machine.command": ("s", SPECIMENS.command_s),
    "machine.dead": ("s", SPECIMENS.dead_s),
}
_NEVER_NEGATIVE: Final = {"machine.late", "machine.command"}
CONSTANTS: Final = (
    *(Nuisance(name, "1", 1.0, sigma, _SOURCE, 0.5, 1.6) for name, sigma in _FACTORS.items()),
    *(
        Nuisance(name, unit, 0.0, sigma, _SOURCE, 0.0 if name in _NEVER_NEGATIVE else -math.inf)
        for name, (unit, sigma) in _ADDED.items()
    ),
)
"""Calibrated to the references."""

PLANNED: Final = {
    "day.height": ("drop_height_m", 0.0005),
    "day.friction": ("friction", 0.01),
    "day.pretension": ("pretension_m", 0.0005),
    "day.slope": ("slope_deg", 0.2),
}
"""Options of a plan that a run does not meet exactly, with their standard deviations."""
_TODAY: Final = {
    "day.ambient": ("Pa", RUNS.ambient_pa),
    "day.pump_flow": ("1", RUNS.pump_flow),
    "day.leak": ("1", RUNS.leak),
    "day.room": ("K", RUNS.offset_k),
    "day.mounting": ("m", RUNS.mounting_m),
    "day.clamp": ("m/N", RUNS.clamp_m_per_n),
    "day.start": ("s", RUNS.start_s),
}
DAY: Final = (
    *(Nuisance(name, unit, 0.0, sigma, _SOURCE) for name, (unit, sigma) in _TODAY.items()),
    *(Nuisance(f"day.dead_{each}", "s", 0.0, RUNS.dead_s, _SOURCE) for each in CHANNELS),
    *(Nuisance(f"day.shorter_{each}", "m", 0.0, RUNS.shorter_m, _SOURCE) for each in TENDONS),
    *(Nuisance(f"day.zero_{i}", "Pa", 0.0, RUNS.pressure_drift_pa, _SOURCE) for i in range(1 + len(CHANNELS))),
    *(Nuisance(name, "1", 0.0, sigma, _SOURCE) for name, (_, sigma) in PLANNED.items()),
)
"""Scatter from run to run."""


SETTABLE: Final[Mapping[str, Mapping[str, Option]]] = {
    "drop": drop.DEFAULTS,
    "landing": landing.DEFAULTS,
    "pressure": pressure.DEFAULTS,
    "slip": slip.DEFAULTS,
    "tensile": tensile.DEFAULTS,
}
"""What can be set on each rig, and what it is otherwise."""


def with_planned(rig: str, options: Mapping[str, Option], values: Mapping[str, float]) -> dict[str, Option]:
    """Return the options of a plan as they are met on a day with deviations by name."""
    met = dict(options)
    for key, (option, _) in PLANNED.items():
        if key in values and option in SETTABLE[rig]:
            met[option] = float(met.get(option, SETTABLE[rig][option])) + values[key]
    return met


def built(values: Mapping[str, float]) -> Machine:
    """Return the machine as drawn, with constants and the day's deviations by name; others are not looked at."""

    def factor(name: str) -> float:
        return values.get(f"machine.{name}", 1.0)

    def more(name: str) -> float:
        return values.get(name, 0.0)

    plain = Machine()
    air = plain.air
    pump = times(
        air.pump,
        free_flow_m3_s=factor("pump_flow") * (1.0 + more("day.pump_flow")),
        ultimate_vacuum_pa=factor("pump_vacuum"),
        stroke_hz=factor("pump_flow"),
    )
    lines = tuple(
        plus(
            times(
                line,
                valve_area_m2=factor("valve_area"),
                tube_volume_m3=factor("volume"),
                tendon_volume_m3=factor("volume"),
                leak_area_m2=max(1.0 + more("day.leak"), 0.0),
            ),
            dead_s=max(more("machine.dead") + more(f"day.dead_{channel}"), -line.dead_s),
        )
        for channel, line in zip(CHANNELS, air.lines, strict=True)
    )
    air = dataclasses.replace(
        plus(times(air, manifold_volume_m3=factor("volume")), ambient_pa=more("day.ambient"), room_k=more("day.room")),
        pump=pump,
        lines=lines,
    )
    tendons = tuple(
        dataclasses.replace(
            plus(
                times(make, contact_share=factor("friction")),
                offset_k=more("day.room"),
                shorter_m=more(f"day.shorter_{name}"),
            ),
            soft=times(make.soft, modulus_pa=factor("modulus")),
            stiff=times(make.stiff, modulus_pa=factor("modulus")),
        )
        for name, make in zip(TENDONS, plain.tendons, strict=True)
    )
    ankle = times(
        plain.ankle,
        foot_kg=factor("foot_mass"),
        achilles_arm_m=factor("achilles_arm"),
        peroneal_forward_m=factor("peroneal_forward"),
    )
    leg = plus(
        times(plain.leg, toe_m=factor("toe"), dropped_toe_m=factor("toe"), heel_m=factor("heel")),
        hung_rad=more("machine.hung"),
        payload_kg=more("machine.carriage"),
    )
    rig = plus(
        plain.rig,
        late_s=more("machine.late"),
        start_jitter_s=more("day.start"),
        mounting_m=more("day.mounting"),
        clamp_m_per_n=max(more("day.clamp"), -plain.rig.clamp_m_per_n),
    )
    clock = plus(plain.sensors.clock, command_delay_s=more("machine.command"))
    zeroed = tuple(plus(each, offset=more(f"day.zero_{i}")) for i, each in enumerate(plain.sensors.pressure))
    sensors = dataclasses.replace(plain.sensors, clock=clock, pressure=zeroed)
    return dataclasses.replace(plain, air=air, tendons=tendons, ankle=ankle, leg=leg, rig=rig, sensors=sensors)
