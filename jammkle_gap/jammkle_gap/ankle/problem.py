"""The ankle as a problem for the diagnosis: its simulator, effects, nuisances, sensors, events and experiments."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from importlib import metadata, resources
from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_common.bags.run_sheet import RunSheet
from jammkle_common.parameters import from_mapping, option_name, rows, typed_value
from jammkle_gap.ankle.alignment import AnkleAlignment
from jammkle_gap.ankle.effects import (
    AnkleEffect,
    PriorParameter,
    ankle_library,
    apply_effects,
    machine_constants,
    run_scatter,
)
from jammkle_gap.ankle.inputs import inputs_of, nominal_rig
from jammkle_gap.ankle.recording import recording_of_run
from jammkle_gap.ankle.repeats import group_of
from jammkle_gap.ankle.sensors import (
    ACCELERATION,
    FORCE,
    PRESSURE,
    RATE,
    headline_set,
    largest_set,
    quantity_of,
    selected,
)
from jammkle_gap.ankle.simulator import AnkleSimulator
from jammkle_gap.core.design import Experiment
from jammkle_gap.core.effects import Library, Nuisance
from jammkle_gap.core.simulate import Problem
from jammkle_sim.rigs import cycle
from jammkle_sim.rigs.catalogue import EXERCISES, rig_kind, run_rig
from jammkle_sim.rigs.rig import laws_of

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence
    from typing import Any

    from numpy.typing import NDArray

    from jammkle_gap.ankle.sensors import SensorSet
    from jammkle_gap.core.data import Recording
    from jammkle_sim.rigs.rig import Rig

_BIN_S = 0.02
_SLOW_BIN_S = {"slip": 0.05, "cycle": 0.04, "press": 0.04, "shake": 0.04, "tilt": 0.04}
"""Length of a bin, s, and where runs are slow: an exercise moves by at most 6 Hz."""
_SEARCH_STEP_S = 2e-3
"""Time step of an exercise in a search: half the contact's time constant, the longest that MuJoCo takes it with."""
_SWITCHING_STEP_S = 1e-3
"""The same of a cycle, whose pressures show when valves switch."""
_ACCURACY = 0.01
"""Share of a signal's range that the simulator is off by when its constants are fitted. Learned on pressure cycles and
pulls of three healthy specimens in other equations (the second simulator of studies/blind, specimens 11 to 13), which
leave 0.8 to 1.4 % of a pressure and 2.1 to 2.4 % of the load cell: of all features together 0.65 of this."""


def ankle_problem(library: Library | None = None) -> Problem:
    """Return the problem.

    Args:
        library: Effects on offer; by default all of the package.

    """
    library = library or ankle_library()
    return Problem(
        simulator=AnkleSimulator(library),
        library=library,
        scatter=_nuisances(run_scatter()),
        constants=_nuisances(machine_constants()),
        sensing=AnkleSensing(library),
        alignment=AnkleAlignment(),
        accuracy=_ACCURACY,
        bin_s=bin_s,
        coarse=coarse,
        version=version(),
        group_of=group_of,
    )


def bin_s(recording: Recording) -> float:
    """Return the length of a bin for a recording's rig, s."""
    return _SLOW_BIN_S.get(inputs_of(recording).rig, _BIN_S)


def coarse(recording: Recording) -> Recording:
    """Return an exercise as it is run for signatures, derivatives and a search: in steps of 2 ms, of a cycle 1 ms.

    Measured with 50 parameters drawn from effects and constants: derivatives by them differ from those in steps of
    0.5 ms by 0.8 (tilt), 3.2 (shake), 3.9 (press) and 1.2 % (cycle) in the median, by 4, 10, 16 and 5 % in nine of ten.
    Those by the switching times of valves are off by 60 % in the first three, which hardly show them, and by 16 to 23 %
    in a cycle. A run costs a quarter, of a cycle half. Likely candidates are run in steps of 0.5 ms in the end. Rigs
    that drop, slip or pull stay as they are: a blow takes less than a millisecond.
    """
    inputs = inputs_of(recording)
    if inputs.rig not in EXERCISES:
        return recording
    step_s = _SWITCHING_STEP_S if inputs.rig == cycle.RIG.name else _SEARCH_STEP_S
    options = tuple(sorted({**dict(inputs.options), "timestep_s": step_s}.items()))
    return replace(recording, inputs=replace(inputs, options=options))


@lru_cache(maxsize=1)
def version() -> str:
    """Return what tells this simulator from its other versions: a digest of its sources, and MuJoCo's version."""
    digest = hashlib.blake2b(metadata.version("mujoco").encode(), digest_size=16)
    for package in ("jammkle_sim.physics", "jammkle_sim.rigs", "jammkle_gap.ankle"):
        pending = [resources.files(package)]
        while pending:
            for each in sorted(pending.pop().iterdir(), key=lambda file: file.name):
                if each.is_dir():
                    pending.append(each)
                elif each.name.endswith((".py", ".yaml")):
                    digest.update(each.name.encode() + each.read_bytes())
    return digest.hexdigest()


def _nuisances(library: Library) -> tuple[Nuisance, ...]:
    return tuple(
        Nuisance(effect.key(each), each.unit, each.null, each.deviation, each.source, each.minimum, each.maximum)
        for effect in library
        for each in effect.parameters
        if isinstance(each, PriorParameter)
    )


_CHANGES = frozenset({
    "delay_imu", "delay_joints", "delay_load_cell", "delay_pressures", "delay_sensors", "misalign_imu", "offset_gyro",
    "offset_imu", "offset_pressure", "saturate_imu", "scale_load_cell", "skew_clock",
})  # fmt: skip
"""Changes of the package that touch sensors alone."""
_OF_DRIVEN_MOTION = frozenset({"delay_imu", "delay_joints", "delay_sensors", "skew_clock"})
"""Those that the motion which drives a run is measured with as well, so that the simulator is given another one."""
_DELAYS_OF_COMMANDS = frozenset({"delay_commands"})
"""Changes that pressures answer as they answer a late sensor: air does the same, later. Assumed: that bodies move it by
their motion is left out, as it is little."""
_VOLUMES = (names.MANIFOLD_PRESSURE.name, *(names.PRESSURES[channel].name for channel in names.CHANNELS))
_IMU = {ACCELERATION: ("specific_force", slice(0, 3)), RATE: ("angular_velocity", slice(3, 6))}


@dataclass(frozen=True)
class AnkleSensing:
    """Fulfils `core.simulate.Sensing`."""

    library: Library
    changes: frozenset[str] = _CHANGES | _DELAYS_OF_COMMANDS
    """Functions of the effects that it knows."""

    @cached_property
    def effects(self) -> frozenset[str]:
        """Names of the effects that touch sensors alone, and of delays of all commands."""
        return self._by_change(self.changes)

    @cached_property
    def _delays_of_commands(self) -> frozenset[str]:
        return self._by_change(_DELAYS_OF_COMMANDS)

    def _by_change(self, changes: frozenset[str]) -> frozenset[str]:
        return frozenset(
            effect.name
            for effect in self.library
            if isinstance(effect, AnkleEffect) and not effect.file and effect.function in changes
        )

    def without_references(self) -> AnkleSensing:
        """Return it without the effects that a driven motion is measured with; see `core.simulate.Sensing`."""
        return replace(self, changes=self.changes - _OF_DRIVEN_MOTION)

    def knows(self, effect: str, signal: str) -> bool:
        """Return whether it says what an effect makes of a signal; see `core.simulate.Sensing`."""
        return effect not in self._delays_of_commands or quantity_of(signal) == PRESSURE

    def __call__(
        self, recording: Recording, measured: Mapping[str, NDArray[np.float64]], values: Mapping[str, float]
    ) -> dict[str, NDArray[np.float64]]:
        """Return what would have been read had the sensors been like this; see `core.simulate.Sensing`."""
        inputs = inputs_of(recording)
        before = nominal_rig(inputs)
        after = apply_effects(before, self.library, values)
        delays_s = _delays_s(before, after)
        turned = _turned(measured, before, after)
        skew = after.wiring.clock_skew - before.wiring.clock_skew
        found = {}
        for signal in recording.signals:
            if signal.name not in measured:
                continue
            quantity = quantity_of(signal.name)
            read = turned[signal.name] * (_gain(before, after) if quantity == FORCE else 1.0)
            delay_s = delays_s.get(quantity, delays_s[""])
            if delay_s or skew:
                read = np.interp(signal.time_s / (1.0 + skew) - delay_s, signal.time_s, read)
            if signal.name in _VOLUMES:
                i = _VOLUMES.index(signal.name)
                read = read + after.wiring.pressure_offset_pa[i] - before.wiring.pressure_offset_pa[i]
            found[signal.name] = read
        return found


def _delays_s(before: Rig, after: Rig) -> dict[str, float]:
    """Return by how much later each quantity is read, s; those not named as joints are."""
    old, new = before.wiring, after.wiring
    imu_s = new.imu_delay_s - old.imu_delay_s
    return {
        "": new.joint_delay_s - old.joint_delay_s,
        PRESSURE: new.pressure_delay_s - old.pressure_delay_s + new.command_delay_s - old.command_delay_s,
        ACCELERATION: imu_s,
        RATE: imu_s,
        FORCE: new.load_cell_delay_s - old.load_cell_delay_s,
    }


def _gain(before: Rig, after: Rig) -> float:
    return after.wiring.load_cell_gain / before.wiring.load_cell_gain


def _turned(measured: Mapping[str, NDArray[np.float64]], before: Rig, after: Rig) -> dict[str, NDArray[np.float64]]:
    """Return all signals, those of the IMU turned on its mount, with its offsets, and clipped at its range."""
    old, new = laws_of(before).imu[0], laws_of(after).imu[0]
    turn = new["turn"] @ old["turn"].T
    found = dict(measured)
    for column, axes in _IMU.values():
        signals = [f"{names.IMU.name.partition('/')[0]}/{column}_{axis}" for axis in "xyz"]
        if not all(signal in measured for signal in signals):
            continue
        rows = turn @ np.array([measured[signal] for signal in signals])
        rows = rows + (new["offset"][axes] - old["offset"][axes])[:, np.newaxis]
        limit = np.minimum(new["limit"][axes], np.inf)[:, np.newaxis]
        rows = np.clip(rows, -limit, limit)
        found |= dict(zip(signals, rows, strict=True))
    return found


_BUILT = ("hang_pitch_deg", "reservoir_volume_m3", "sides")
"""Options that say how the machine is built and what it can do: those of the recordings hold for the next one, too."""
_ON_RIGS = (
    RunSheet("pressure", {"jam_time_s": 4.0, "vent_time_s": 1.0, "cycles": 2}),
    RunSheet("pressure", {"vacuum_pa": 20e3, "cycles": 3}),
    RunSheet("tensile", {"vacuum_pa": 50e3}),
    RunSheet("tensile", {"vacuum_pa": 0.0, "speed_m_s": 0.1}),
    RunSheet("drop", {"foot": "unjammed"}),
    RunSheet("drop", {"foot": "jammed"}),
    RunSheet("slip", {"foot": "unjammed", "speed_m_s": 0.02}),
)
"""Slow and fast, soft and jammed, in the air and on the ground: what parts most pairs of effects. Assumed."""
_EXERCISES = (
    RunSheet("cycle", {"vacuum_pa": 20e3}),
    RunSheet("cycle", {"jam_time_s": 4.0, "vent_time_s": 2.0}),
    RunSheet("press", {"vacuum_pa": 10e3}),
    RunSheet("press", {"vacuum_pa": 40e3}),
    RunSheet("press", {"way_time_s": 2.0}),
    RunSheet("shake", {"vacuum_pa": 20e3}),
    RunSheet("shake", {"amplitude_deg": 20.0, "to_hz": 4.0}),
    RunSheet("tilt", {"vacuum_pa": 20e3}),
)
"""The same of what a robot does with its own means, apart from the defaults. Assumed."""


def plans(rigs: Collection[str]) -> dict[str, RunSheet]:
    """Return runs that could be made of a machine that was recorded on these rigs, by the command that makes them.

    Where all of them are test rigs these are on offer, else exercises.
    """
    if set(rigs) <= {each.rig for each in _ON_RIGS}:
        return {f"rig {each.rig} {_typed(each)}": each for each in _ON_RIGS}
    return {f"exercise {each.rig} {_given(each)}": each for each in _EXERCISES}


def experiments(recordings: Sequence[Recording]) -> tuple[Experiment, ...]:
    """Return the runs on offer; each is planned only when a diagnosis asks for it.

    An exercise is planned with the sensors that the recordings have, a test rig with its load cell as well.
    """
    built = {name: value for each in recordings for name, value in each.inputs.options if name in _BUILT}
    offered = plans({each.inputs.rig for each in recordings})
    sensors = largest_set(recordings)
    return tuple(Experiment(command, partial(_planned, sheet, built, sensors)) for command, sheet in offered.items())


def _typed(sheet: RunSheet) -> str:
    typed = {option_name(name): typed_value(name, value) for name, value in sheet.options.items()}
    shown = {name: f"{value:g}" if isinstance(value, float) else value for name, value in typed.items()}
    return " ".join(f"{name} {value}" for name, value in shown.items())


def _given(sheet: RunSheet) -> str:
    return " ".join(f"-p {name}:={value:g}" for name, value in sheet.options.items())


def _planned(sheet: RunSheet, built: Mapping[str, Any], sensors: SensorSet) -> Recording:
    """Return the recording as it would be with nothing wrong."""
    kind = rig_kind(sheet.rig)
    known = {row.name for row in rows(kind.options)}
    given = {name: value for name, value in built.items() if name in known}
    options = from_mapping(kind.options, {**given, **sheet.options})
    plan = recording_of_run(run_rig(sheet.rig, options, lambda _: None, lambda: False), sheet.rig)
    return selected(plan, sensors if sheet.rig in EXERCISES else max(sensors, headline_set(plan)))
