"""The rigs as a simulator for the diagnosis: a recording's commands in the same rig, effects in it, no noise."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

from jammkle_common.parameters import ParameterError
from jammkle_gap.ankle.effects import (
    ankle_library,
    apply_effects,
    apply_to_inputs,
    machine_constants,
    run_scatter,
)
from jammkle_gap.ankle.inputs import drawing_of, rig_of
from jammkle_gap.ankle.readings import readings
from jammkle_gap.ankle.truth import inputs_of, truth_of
from jammkle_gap.core.effects import Library
from jammkle_gap.core.simulate import InfeasibleError
from jammkle_sim.rigs.simulation import UnstableSimulationError

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from numpy.typing import NDArray

    from jammkle_gap.ankle.inputs import AnkleInputs, Drawing
    from jammkle_gap.core.data import Recording
    from jammkle_sim.rigs.rig import Rig

    Values = tuple[tuple[str, float], ...]
    """By `effect.parameter`."""


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
        inputs = apply_to_inputs(given, _package(), dict(self.machine))
        inputs = apply_to_inputs(inputs, self._all, values)
        return recording if inputs is given else dataclasses.replace(recording, inputs=inputs)

    def rig(self, recording: Recording, values: Mapping[str, float]) -> Rig:
        """Return the rig of a recording with effects in it, those that change its inputs too."""
        return self._rig(inputs_of(self.recording(recording, values)), values)

    def _rig(self, inputs: AnkleInputs, values: Mapping[str, float]) -> Rig:
        drawn = {key: value for key, value in values.items() if key in _drawn_keys()}
        built = _built(drawing_of(inputs), self.machine, tuple(drawn.items()))
        return apply_effects(built, self.library, {key: each for key, each in values.items() if key not in drawn})

    @cached_property
    def _all(self) -> Library:
        return Library((*machine_constants(), *run_scatter(), *self.library))


@lru_cache(maxsize=1)
def _package() -> Library:
    """Return all that the package can change."""
    return Library((*machine_constants(), *run_scatter(), *ankle_library()))


@lru_cache(maxsize=1)
def _drawn_keys() -> frozenset[str]:
    """Return the parameters of the machine and of the run."""
    return frozenset(each.key(one) for each in (*machine_constants(), *run_scatter()) for one in each.parameters)


@lru_cache(maxsize=8)
def _built(drawing: Drawing, machine: Values, drawn: Values) -> Rig:
    """Return a rig as a machine and a run have it, kept, as a search has it the same in all of its runs.

    Args:
        drawing: Of the nominal rig.
        machine: What this very machine is like.
        drawn: Parameters of the machine and of the run that come on top.

    """
    built = apply_effects(rig_of(drawing), _package(), dict(machine))
    return apply_effects(built, _package(), dict(drawn))
