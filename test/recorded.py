"""Short runs of the rigs as bags and recordings, and how far the simulator is off them."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_gap.ankle.effects import ankle_library
from jammkle_gap.ankle.recording import bag_of_run
from jammkle_gap.ankle.sensors import PRESSURE, quantity_of
from jammkle_gap.ankle.simulator import AnkleSimulator
from jammkle_sim.physics.sensors import SensorParameters
from jammkle_sim.rigs.catalogue import RIGS, run_rig

if TYPE_CHECKING:
    from jammkle_gap import Recording, Signal
    from jammkle_gap.ankle.bag import Bag
    from jammkle_sim.rigs.run import RigRun


SIMULATOR = AnkleSimulator(ankle_library())
ACHILLES = names.PRESSURES[names.ACHILLES].name


@lru_cache(maxsize=8)
def run(rig: str, **options: object) -> RigRun:
    """Run a rig once."""
    return run_rig(rig, RIGS[rig].options(**options), lambda _: None, lambda: False)


def bag() -> Bag:
    """Jam and vent an ankle once."""
    return bag_of_run(run("pressure", cycles=1))


def bias_of(signal: Signal) -> float:
    """Return the standard deviation of a sensor's constant offset, in its unit: pressures have one."""
    return SensorParameters().pressure_offset_pa if quantity_of(signal.name) == PRESSURE else 0.0


def unbiased(signal: Signal, simulated: np.ndarray) -> np.ndarray:
    """Measured less simulated, less what the sensor may be off by throughout."""
    residual = signal.values - simulated
    return residual - np.clip(residual.mean(), -3.0 * bias_of(signal), 3.0 * bias_of(signal))


def worst_gap(recording: Recording) -> float:
    """Largest difference of measured and nominal over the signals, root mean square in noise."""
    simulated = SIMULATOR(recording, {})
    assert set(simulated) == {signal.name for signal in recording.signals}
    return max(
        float(np.sqrt(np.mean((unbiased(each, simulated[each.name]) / each.deviation) ** 2)))
        for each in recording.signals
    )
