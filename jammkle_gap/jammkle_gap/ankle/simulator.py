"""The rigs as a simulator for the diagnosis: a recording's commands in the same rig, effects in it, no noise."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from jammkle_gap.ankle.effects import (
    ankle_library,
    apply_effects,
    apply_to_inputs,
    machine_constants,
    run_scatter,
)
from jammkle_gap.ankle.inputs import nominal_rig
from jammkle_gap.ankle.readings import readings
from jammkle_gap.ankle.truth import inputs_of, truth_of
from jammkle_gap.core.effects import Library
from jammkle_gap.core.simulate import InfeasibleError
from jammkle_graph.parameters import ParameterError
from jammkle_sim.rigs.simulation import UnstableSimulationError

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from numpy.typing import NDArray

    from jammkle_gap.ankle.inputs import AnkleInputs
    from jammkle_gap.core.data import Recording
    from jammkle_sim.rigs.rig import Rig


@dataclass(frozen=True)
class AnkleSimulator:
    """Runs a recording of an ankle again; fulfils `core.simulate.Simulator`, and can be pickled.

    Its values may be of the library, of `machine_constants` and of `run_scatter`, all in one call. Changes to the
    inputs come first, then those to the rig: machine, run, library.
    """

    library: Library
    """Effects whose parameters it takes, beside those of the machine and of the run."""
    machine: tuple[tuple[str, float], ...] = ()
    """What this very machine is like, by parameters of the package's effects and of the machine: those of a call come
    on top."""

    def __call__(self, recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        """Run again what was commanded; see `core.simulate.Simulator`.

        Raises:
            BadEffectError: a parameter that no effect of the library has.
            InfeasibleError: the simulation blew up, or a rig cannot be built so.

        """
        changed = self.recording(recording, values)
        try:
            rig = self._rig(inputs_of(changed), values)
            return readings(changed, rig, truth_of(changed, rig))
        except (UnstableSimulationError, ParameterError) as error:
            raise InfeasibleError(str(error)) from error

    def recording(self, recording: Recording, values: Mapping[str, float]) -> Recording:
        """Return a recording with effects in its inputs; the same recording where none changes them."""
        given = inputs_of(recording)
        inputs = apply_to_inputs(given, self._package, dict(self.machine))
        inputs = apply_to_inputs(inputs, self._all, values)
        return recording if inputs is given else dataclasses.replace(recording, inputs=inputs)

    def rig(self, recording: Recording, values: Mapping[str, float]) -> Rig:
        """Return the rig of a recording with effects in it, those that change its inputs too."""
        return self._rig(inputs_of(self.recording(recording, values)), values)

    def _rig(self, inputs: AnkleInputs, values: Mapping[str, float]) -> Rig:
        machine = apply_effects(nominal_rig(inputs), self._package, dict(self.machine))
        return apply_effects(machine, self._all, values)

    @cached_property
    def _all(self) -> Library:
        return Library((*machine_constants(), *run_scatter(), *self.library))

    @cached_property
    def _package(self) -> Library:
        return Library((*machine_constants(), *run_scatter(), *ankle_library()))
