"""How specimens of the machine differ, and how one of them differs from run to run."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from studies.blind.reality.machine import Clock, Machine, Material, stream

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class SpecimenScatter:
    """Standard deviation over specimens; relative where no unit is given. Assumed where nothing is said."""

    pump_flow: float = 0.05
    """Data sheets of small diaphragm pumps state typical values; samples differ by a twentieth."""
    pump_vacuum: float = 0.05
    """As the flow."""
    valve_area: float = 0.05
    """Flow tolerance of small solenoid valves: a tenth either way at two standard deviations."""
    volume: float = 0.05
    """Hoses cut to length and cast channels: a twentieth."""
    leak: float = 0.3
    dead_s: float = 0.002
    """Small solenoids of one type have 5 to 10 ms."""
    lever: float = 0.1
    """No drawing of the ankle is published: builders scale its picture, to a tenth."""
    hung_rad: float = math.radians(5.0)
    """What a foot on four soft tendons is set to by eye."""
    foot_mass: float = 0.05
    """A printed part: infill and screws."""
    carriage_kg: float = 0.09
    """A twentieth of 1.8 kg: cables and screws."""
    release_s: float = 0.02
    """Magnets, latches and drives act within tens of milliseconds."""
    command_s: float = 0.01
    """A bus that is served 50 to 100 times a second."""
    print_batch: float = 0.03
    """Modulus of all tendons of one print."""
    fibre: float = 0.006
    """Modulus of one tendon beside the others of its print."""
    friction: float = 0.03
    relaxation: float = 0.02
    shorter_m: float = 5e-5
    pressure_offset_pa: float = 150.0
    """Declared."""
    gain: float = 0.002
    skew: float = 2e-5


@dataclass(frozen=True)
class RunScatter:
    """Standard deviation over runs of one specimen; relative where no unit is given."""

    ambient_pa: float = 150.0
    """Assumed: one day's weather."""
    pump_flow: float = 0.01
    """Assumed: supply voltage."""
    leak: float = 0.1
    dead_s: float = 0.0005
    offset_k: float = 0.04
    """Calibrated with `mounting_m` to row a30_atm, whose five repeats differ by 0.9 %; assumed: the room is kept."""
    mounting_m: float = 0.00012
    clamp_m_per_n: float = 1.3e-5
    """Calibrated to the rows of the multi-material and the stiff tendon, whose repeats differ by 2.6 to 8 %."""
    start_s: float = 0.002
    pressure_drift_pa: float = 20.0
    shorter_m: float = 2e-5


SPECIMENS = SpecimenScatter()
RUNS = RunScatter()


def machine(seed: int) -> Machine:
    """Return one specimen: drawn once, the same in all its runs.

    Args:
        seed: 0 or more.

    """
    draw, plain, scatter = stream(seed, "specimen"), Machine(), SPECIMENS
    pump = dataclasses.replace(
        plain.air.pump,
        free_flow_m3_s=plain.air.pump.free_flow_m3_s * _factor(draw, scatter.pump_flow),
        ultimate_vacuum_pa=plain.air.pump.ultimate_vacuum_pa * _factor(draw, scatter.pump_vacuum),
        stroke_hz=plain.air.pump.stroke_hz * _factor(draw, scatter.pump_flow),
    )
    lines = tuple(
        dataclasses.replace(
            line,
            valve_area_m2=line.valve_area_m2 * _factor(draw, scatter.valve_area),
            tube_volume_m3=line.tube_volume_m3 * _factor(draw, scatter.volume),
            tendon_volume_m3=line.tendon_volume_m3 * _factor(draw, scatter.volume),
            leak_area_m2=line.leak_area_m2 * _factor(draw, scatter.leak),
            dead_s=max(line.dead_s + scatter.dead_s * draw.standard_normal(), 0.0),
        )
        for line in plain.air.lines
    )
    air = dataclasses.replace(
        plain.air,
        pump=pump,
        lines=lines,
        manifold_volume_m3=plain.air.manifold_volume_m3 * _factor(draw, scatter.volume),
    )
    soft, stiff = _factor(draw, scatter.print_batch), _factor(draw, scatter.print_batch)
    tendons = tuple(
        dataclasses.replace(
            make,
            soft=_printed(make.soft, soft, draw),
            stiff=_printed(make.stiff, stiff, draw),
            contact_share=make.contact_share * _factor(draw, scatter.friction),
            shorter_m=scatter.shorter_m * draw.standard_normal(),
        )
        for make in plain.tendons
    )
    pressure = tuple(
        dataclasses.replace(sensor, offset=scatter.pressure_offset_pa * draw.standard_normal())
        for sensor in plain.sensors.pressure
    )
    cell, tension = (
        dataclasses.replace(sensor, gain=_factor(draw, scatter.gain))
        for sensor in (plain.sensors.load_cell, plain.sensors.tension)
    )
    clock = dataclasses.replace(Clock(), skew=scatter.skew * draw.standard_normal())
    sensors = dataclasses.replace(plain.sensors, pressure=pressure, load_cell=cell, tension=tension, clock=clock)
    rig = dataclasses.replace(plain.rig, speed_error=0.5 * scatter.gain * draw.standard_normal())
    made = dataclasses.replace(plain, air=air, tendons=tendons, sensors=sensors, rig=rig)
    return _built(made, stream(seed, "build"))


def _built(machine: Machine, draw: np.random.Generator) -> Machine:
    """Return a specimen with the levers, the pose, the masses and the delays that its builder gave it."""
    scatter, ankle, leg = SPECIMENS, machine.ankle, machine.leg
    foot, toe = _factor(draw, scatter.foot_mass), _factor(draw, scatter.lever)
    x, y, z = ankle.foot_inertia_kg_m2
    ankle = dataclasses.replace(
        ankle,
        foot_kg=ankle.foot_kg * foot,
        foot_inertia_kg_m2=(x * foot, y * foot, z * foot),
        achilles_arm_m=ankle.achilles_arm_m * _factor(draw, scatter.lever),
        achilles_spread_m=ankle.achilles_spread_m * _factor(draw, scatter.lever),
        peroneal_forward_m=ankle.peroneal_forward_m * _factor(draw, scatter.lever),
        peroneal_spread_m=ankle.peroneal_spread_m * _factor(draw, scatter.lever),
    )
    leg = dataclasses.replace(
        leg,
        toe_m=leg.toe_m * toe,
        dropped_toe_m=leg.dropped_toe_m * toe,
        heel_m=leg.heel_m * _factor(draw, scatter.lever),
        hung_rad=scatter.hung_rad * draw.standard_normal(),
        payload_kg=scatter.carriage_kg * draw.standard_normal(),
    )
    rig = dataclasses.replace(machine.rig, late_s=abs(scatter.release_s * draw.standard_normal()))
    clock = machine.sensors.clock
    clock = dataclasses.replace(
        clock, command_delay_s=clock.command_delay_s + abs(scatter.command_s * draw.standard_normal())
    )
    sensors = dataclasses.replace(machine.sensors, clock=clock)
    return dataclasses.replace(machine, ankle=ankle, leg=leg, rig=rig, sensors=sensors)


def today(specimen: Machine, seed: int) -> Machine:
    """Return a specimen as it is in one run: room, weather, supply, and how things were clamped this time.

    Args:
        specimen: What `machine` made, faults or none.
        seed: Of the run; `machine.STILL` leaves the specimen as it was made.

    """
    draw, scatter, air = stream(seed, "day"), RUNS, specimen.air
    offset_k = scatter.offset_k * draw.standard_normal()
    pump = dataclasses.replace(air.pump, free_flow_m3_s=air.pump.free_flow_m3_s * _factor(draw, scatter.pump_flow))
    lines = tuple(
        dataclasses.replace(
            line,
            leak_area_m2=line.leak_area_m2 * _factor(draw, scatter.leak),
            dead_s=max(line.dead_s + scatter.dead_s * draw.standard_normal(), 0.0),
        )
        for line in air.lines
    )
    air = dataclasses.replace(
        air,
        ambient_pa=air.ambient_pa + scatter.ambient_pa * draw.standard_normal(),
        room_k=air.room_k + offset_k,
        pump=pump,
        lines=lines,
    )
    tendons = tuple(
        dataclasses.replace(
            make,
            offset_k=make.offset_k + offset_k,
            shorter_m=make.shorter_m + scatter.shorter_m * draw.standard_normal(),
        )
        for make in specimen.tendons
    )
    pressure = tuple(
        dataclasses.replace(sensor, offset=sensor.offset + scatter.pressure_drift_pa * draw.standard_normal())
        for sensor in specimen.sensors.pressure
    )
    rig = dataclasses.replace(
        specimen.rig,
        start_jitter_s=abs(scatter.start_s * draw.standard_normal()),
        clamp_m_per_n=max(specimen.rig.clamp_m_per_n + scatter.clamp_m_per_n * draw.standard_normal(), 0.0),
        mounting_m=scatter.mounting_m * draw.standard_normal(),
    )
    sensors = dataclasses.replace(specimen.sensors, pressure=pressure)
    return dataclasses.replace(specimen, air=air, tendons=tendons, sensors=sensors, rig=rig)


def _printed(material: Material, batch: float, draw: np.random.Generator) -> Material:
    return dataclasses.replace(
        material,
        modulus_pa=material.modulus_pa * batch * _factor(draw, SPECIMENS.fibre),
        relaxation=material.relaxation * _factor(draw, SPECIMENS.relaxation),
    )


def _factor(draw: np.random.Generator, spread: float) -> float:
    """Return a factor around 1, always positive."""
    return float((1.0 + spread**2) ** -0.5 * math.exp(spread * draw.standard_normal()))
