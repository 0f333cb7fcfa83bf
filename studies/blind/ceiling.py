"""The second simulator in the words of the diagnosis: its signals, its constants and scatter, and the ceiling.

The ceiling is the same diagnosis with the second simulator in the place of the first, and its own faults as the
library. What it misses no better physics would find. It starts from the machine as drawn and calibrates it to the
references, as the diagnosis does; it knows of the machine at hand, of its day and of its noise no more than that.
"""

from __future__ import annotations

import dataclasses
import hashlib
import math
import re
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from jammkle_common.names import CHANNELS, PUMP_DUTY, SOLENOIDS, TENDONS
from jammkle_gap import (
    RESOLUTION,
    UNITS,
    AnkleInputs,
    Constants,
    Effect,
    EffectParameter,
    InfeasibleError,
    Library,
    Nuisance,
    Problem,
    Recording,
    Signal,
    ankle_problem,
    quantity_of,
)
from jammkle_sim.rigs.replay import CommandTrack, Timeline
from studies.blind import reality
from studies.blind.reality import drop, landing, pressure, slip, tensile
from studies.blind.reality.faults import FAULTS, FaultSetting, eras
from studies.blind.reality.machine import STILL, Machine, plus, times
from studies.blind.reality.run import RIGS
from studies.blind.reality.sensors import BadPlanError, Plan
from studies.blind.reality.specimen import RUNS, SPECIMENS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from studies.blind.reality.sensors import Option, RealRun

COMMANDS: Final = frozenset({PUMP_DUTY.name, *(topic.name for topic in SOLENOIDS.values())})
"""Topics of what was commanded, which is the same whatever is wrong, and never lost."""
INSTRUMENTED: Final = ("/tension", "/extension")
"""Ends of the names of signals that no robot measures."""
_COLUMNS: Final = (
    (re.compile(r"linear_acceleration_([xyz])_m_s2"), r"imu/specific_force_\1"),
    (re.compile(r"angular_velocity_([xyz])_rad_s"), r"imu/angular_velocity_\1"),
    (re.compile(r"force_z_n"), "load_cell/force_z"),
    (re.compile(r"(\w+)\.position"), r"\1/position"),
)
"""Columns of a run, and the signals that they are."""
CEILING_CONSTANTS: Final = Constants(contact_runs=20, refined=5, refined_pairs=5, fit_evaluations=3)
"""Fewer fits than the diagnosis makes: this simulator takes ten times as long as the first."""
_NAMED: Final = {fault.effect: fault for fault in FAULTS.values() if fault.effect is not None}
"""Faults by the name of the library's effect."""
_KEPT = 256
"""Runs that are remembered: repeats of a setting are the same here."""

Values = tuple[tuple[str, float], ...]
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


def recording_of_real(run: RealRun, setting: str) -> Recording:
    """Return what a rig's sensors recorded of a run: good for features, but it cannot be simulated again."""
    signals = tuple(each for each in signals_of(run) if not each.name.endswith(INSTRUMENTED))
    nothing = CommandTrack(Timeline(np.zeros(1), np.zeros(1)), {})
    return Recording(run.plan.rig, signals, AnkleInputs(run.plan.rig, (), nothing), setting=setting)


def signals_of(run: RealRun) -> list[Signal]:
    """Return what all sensors recorded of a run."""
    signals = []
    for topic, track in run.topics.items():
        if topic in COMMANDS:
            continue
        rising = np.concatenate([[True], np.diff(np.maximum.accumulate(track.stamp_s)) > 0.0])
        for i, column in enumerate(track.columns):
            name = _signal(topic, column)
            if name:
                quantity = quantity_of(name)
                values = np.asarray(track.values[rising, i], dtype=float)
                step = RESOLUTION.get(quantity, 0.0)
                signals.append(Signal(name, UNITS[quantity], track.stamp_s[rising], values, resolution=step))
    return signals


def _signal(topic: str, column: str) -> str:
    if column == "fluid_pressure_pa":
        return topic
    for pattern, template in _COLUMNS:
        match = pattern.fullmatch(column)
        if match is not None:
            return match.expand(template)
    return ""


@dataclasses.dataclass(frozen=True)
class CeilingSimulator:
    """The reality without noise; fulfils `core.simulate.Simulator`."""

    def __call__(self, recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        """Run the plan of a recording again; see `core.simulate.Simulator`."""
        inputs = recording.inputs
        planned = tuple((name, value) for name, value in inputs.options if name in SETTABLE[inputs.rig])
        made = _run(inputs.rig, planned, tuple(sorted(values.items())))
        return {
            signal.name: np.interp(signal.time_s, *made[signal.name])
            for signal in recording.signals
            if signal.name in made
        }


def ceiling_problem() -> Problem:
    """Return the problem that is handed to the diagnosis."""
    own = ankle_problem()
    return Problem(
        simulator=CeilingSimulator(),
        library=Library(tuple(_effect(name) for name in _NAMED)),
        scatter=DAY,
        constants=CONSTANTS,
        alignment=own.alignment,
        bin_s=own.bin_s,
        version=_version(),
        group_of=own.group_of,
    )


def _effect(name: str) -> Effect:
    fault = _NAMED[name]
    parameters = tuple(
        EffectParameter(key, row.unit, row.null, row.minimum, row.maximum, "the reality's")
        for key, row in fault.parameters.items()
    )
    return Effect(name, fault.subsystem, parameters, f"The reality's fault '{fault.name}'.")


@lru_cache(maxsize=_KEPT)
def _run(rig: str, planned: Values, values: Values) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return times and values by signal."""
    given = dict(values)
    options = with_planned(rig, dict(planned), given)
    by_fault: dict[str, dict[str, float]] = {}
    for key, value in given.items():
        effect, _, parameter = key.partition(".")
        if effect in _NAMED:
            fault = _NAMED[effect]
            row = fault.parameters[parameter]
            # A grid's end may lie beyond a bound by rounding.
            by_fault.setdefault(fault.name, {})[parameter] = min(max(value, row.minimum), row.maximum)
    faults = [FaultSetting(name, each) for name, each in by_fault.items()]
    try:
        made = RIGS[rig](Plan(rig, options), eras(built(given), faults, FAULTS), STILL)
    except (BadPlanError, FloatingPointError, ZeroDivisionError) as error:
        raise InfeasibleError(str(error)) from error
    return {signal.name: (signal.time_s, signal.values) for signal in signals_of(made)}


@lru_cache(maxsize=1)
def _version() -> str:
    digest = hashlib.blake2b(b"ceiling", digest_size=16)
    for each in (Path(__file__), *sorted(Path(next(iter(reality.__path__))).iterdir())):
        if each.is_file():
            digest.update(each.name.encode() + each.read_bytes())
    return digest.hexdigest()
