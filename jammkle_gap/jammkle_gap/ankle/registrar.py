"""Events that an ankle's runs are registered at: the touch-down of what falls."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.ankle.instruments import PRESSURE, quantity_of
from jammkle_gap.ankle.phases import FALLING_RIGS
from jammkle_gap.ankle.truth import inputs_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from jammkle_gap.core.data import Recording

TOUCH_DOWN = "touch_down"
_FALLING_M_S2, _LANDED_M_S2 = 3.0, 15.0


class AnkleRegistrar:
    """Fulfils `core.features.Registrar`: pressures go by the clock of the commands, all else by the touch-down."""

    def events(self, recording: Recording, values: Mapping[str, NDArray[np.float64]]) -> dict[str, float]:
        """Return the touch-down of a run, s; see `core.features.Registrar`."""
        name = "imu/specific_force_z"
        if inputs_of(recording).rig not in FALLING_RIGS or name not in values:
            return {}
        time_s, force = recording.signal(name).time_s, np.asarray(values[name])
        fall = np.flatnonzero(force < _FALLING_M_S2)
        if not len(fall):
            return {}
        hit = np.flatnonzero(force[fall[0] :] > _LANDED_M_S2)
        return {TOUCH_DOWN: float(time_s[fall[0] + hit[0]])} if len(hit) else {}

    def event_of(self, recording: Recording, signal: str) -> str:
        """Return the event that a signal is registered at; see `core.features.Registrar`."""
        return "" if quantity_of(signal) == PRESSURE or inputs_of(recording).rig not in FALLING_RIGS else TOUCH_DOWN
