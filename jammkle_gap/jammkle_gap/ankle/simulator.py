"""The rigs as a simulator for the diagnosis: a recording's commands in the same rig, effects in it, no noise."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_gap.ankle.effects import ankle_library, apply_effects
from jammkle_gap.ankle.inputs import nominal_rig
from jammkle_gap.ankle.readings import readings
from jammkle_gap.ankle.restarts import restarted_readings
from jammkle_gap.ankle.truth import inputs_of, truth_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from numpy.typing import NDArray

    from jammkle_gap.november.effect import Library
    from jammkle_gap.november.recording import Recording
    from jammkle_sim.rigs.rig import Rig


@dataclass(frozen=True)
class AnkleSimulator:
    """Runs a recording of an ankle again; fulfils `gap.simulator.Simulator`, and can be pickled."""

    library: Library
    """Effects whose parameters it takes."""
    machine: tuple[tuple[str, float], ...] = ()
    """What this very machine is like, by parameters of the package's effects: those of a call come on top."""

    def __call__(self, recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        """Run again what was commanded; see `gap.simulator.Simulator`.

        Raises:
            BadEffectError: a parameter that no effect of the library has.
            UnstableSimulationError: the simulation blew up.

        """
        rig = self.rig(recording, values)
        return readings(recording, rig, truth_of(recording, rig))

    def restarted(
        self, recording: Recording, values: Mapping[str, float], horizon_s: float
    ) -> dict[str, NDArray[np.float64]]:
        """As a call, set to the measured state every `horizon_s`; see `gap.simulator.RestartingSimulator`.

        Raises:
            BadEffectError: a parameter that no effect of the library has.
            UnstableSimulationError: the simulation blew up.

        """
        return restarted_readings(recording, self.rig(recording, values), horizon_s)

    def rig(self, recording: Recording, values: Mapping[str, float]) -> Rig:
        """Return the rig of a recording with effects in it."""
        inputs = inputs_of(recording)
        machine = apply_effects(nominal_rig(inputs), ankle_library(), dict(self.machine))
        rig = apply_effects(machine, self.library, values)
        return _counted_from_motion(rig) if inputs.starts_by_motion else rig


def _counted_from_motion(rig: Rig) -> Rig:
    """Return the rig as it looks where times count from when the slide was seen to move off.

    What the joints are read late by is not seen in themselves, but in all else, which comes earlier by as much.
    """
    wiring = rig.wiring
    late_s = wiring.joint_delay_s
    if late_s == 0.0:
        return rig
    counted = dataclasses.replace(
        wiring,
        command_delay_s=wiring.command_delay_s + late_s,
        pressure_delay_s=wiring.pressure_delay_s - late_s,
        imu_delay_s=wiring.imu_delay_s - late_s,
        load_cell_delay_s=wiring.load_cell_delay_s - late_s,
        joint_delay_s=0.0,
    )
    return dataclasses.replace(rig, wiring=counted)
