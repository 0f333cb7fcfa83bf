"""Effects of sensors, clocks and late commands, applied to what was measured: exact, however wrong the simulator is."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_gap.ankle.effects import AnkleEffect, apply_effects
from jammkle_gap.ankle.inputs import nominal_rig
from jammkle_gap.ankle.instruments import ACCELERATION, FORCE, PRESSURE, RATE, quantity_of
from jammkle_gap.ankle.truth import inputs_of
from jammkle_sim.rigs.rig import laws_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from jammkle_gap.core.data import Recording
    from jammkle_gap.core.effects import Library
    from jammkle_sim.rigs.rig import Rig

_CHANGES = frozenset({
    "delay_imu", "delay_joints", "delay_load_cell", "delay_pressures", "delay_sensors", "misalign_imu", "offset_gyro",
    "offset_imu", "offset_pressure", "saturate_imu", "scale_load_cell", "skew_clock",
})  # fmt: skip
"""Changes of the package that touch sensors alone."""
_DELAYS_OF_COMMANDS = frozenset({"delay_commands"})
"""Changes that pressures answer as they answer a late sensor: air does the same, later. Assumed: that bodies move it by
their motion is left out, as it is little."""
_VOLUMES = (names.MANIFOLD_PRESSURE.name, *(names.PRESSURES[channel].name for channel in names.CHANNELS))
_IMU = {ACCELERATION: ("specific_force", slice(0, 3)), RATE: ("angular_velocity", slice(3, 6))}


@dataclass(frozen=True)
class AnkleSensing:
    """Fulfils `core.simulate.Sensing`."""

    library: Library

    @cached_property
    def effects(self) -> frozenset[str]:
        """Names of the effects that touch sensors alone, and of delays of all commands."""
        return self._by_change(_CHANGES | _DELAYS_OF_COMMANDS)

    @cached_property
    def _delays_of_commands(self) -> frozenset[str]:
        return self._by_change(_DELAYS_OF_COMMANDS)

    def _by_change(self, changes: frozenset[str]) -> frozenset[str]:
        return frozenset(
            effect.name
            for effect in self.library
            if isinstance(effect, AnkleEffect) and not effect.file and effect.function in changes
        )

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
