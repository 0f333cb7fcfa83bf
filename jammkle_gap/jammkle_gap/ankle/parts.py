"""An ankle in parts, each fed with what was measured at its inputs, as one simulator.

A foot that lands, sticks and slips makes another run of the smallest difference, so that a whole simulation soon tells
of chance alone. In parts an error stays where it is made: the air follows the commands, the tendons what they were
really stretched by, and the bodies what really pulled them, from the measured state every 0.1 s.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.ankle.disagreement import with_disagreement
from jammkle_gap.ankle.inputs import nominal_rig
from jammkle_gap.ankle.instruments import PRESSURE, TENSION, quantity_of
from jammkle_gap.ankle.readings import Truth, readings
from jammkle_gap.ankle.restarts import pulled_bodies
from jammkle_gap.ankle.simulator import AnkleSimulator
from jammkle_gap.ankle.subsystems import MOTION_HORIZON_S, tensions_of
from jammkle_gap.ankle.truth import Stages, air_of, digest_of, inputs_of, model_key, steps_of, truth_of
from jammkle_gap.november.repeats import repeats
from jammkle_sim.rigs.replay import timestep_s

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.november.effect import Library
    from jammkle_gap.november.recording import Recording
    from jammkle_sim.rigs.rig import Rig

_KEPT = 16
"""Courses of bodies that a process keeps: of each recording of a case the nominal one and what restarts do to it."""


@dataclass(frozen=True)
class PartsSimulator:
    """Air from commands, tendons from extension and pressure, bodies from tension; fulfils `gap.simulator.Simulator`.

    A part whose inputs were not measured is simulated with the whole.
    """

    library: Library
    """Effects whose parameters it takes."""

    def __call__(self, recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        """Run every part; see `gap.simulator.Simulator`.

        Raises:
            BadEffectError: a parameter that no effect of the library has.
            UnstableSimulationError: the simulation blew up.

        """
        rig = AnkleSimulator(self.library).rig(recording, values)
        pulled = _pulled(recording, rig)
        if pulled is None:
            return readings(recording, rig, truth_of(recording, rig)) | tensions_of(recording, rig)
        found = readings(recording, rig, pulled)
        errors, tensions = _errors_of_restarts(recording), tensions_of(recording, rig)
        return {
            name: tensions[name] if quantity_of(name) == TENSION else made + errors.get(name, 0.0)
            for name, made in found.items()
            if quantity_of(name) != TENSION or name in tensions
        }

    def restarted(
        self, recording: Recording, values: Mapping[str, float], horizon_s: float
    ) -> dict[str, NDArray[np.float64]]:
        """Run the whole, set to the measured state every `horizon_s`; see `gap.simulator.RestartingSimulator`.

        Raises:
            BadEffectError: a parameter that no effect of the library has.
            UnstableSimulationError: the simulation blew up.

        """
        return AnkleSimulator(self.library).restarted(recording, values, horizon_s)


def prepared_for_parts(
    recordings: Sequence[Recording], references: Sequence[Recording], library: Library
) -> tuple[list[Recording], list[Recording]]:
    """Return recordings and references as a diagnosis in parts needs them.

    With the names of their runs, told by what the whole simulator makes of their commands: parts are fed with what was
    measured, and so differ between repeats. Without references, with a noise in which restarts are contained, and what
    machines in good order disagree by.

    Args:
        recordings: To be diagnosed.
        references: Of the same machine in good order.
        library: Of the simulator.

    Raises:
        UnstableSimulationError: the simulation blew up.

    """
    named = _with_runs([*recordings, *references], library)
    own = named[: len(recordings)]
    if not references:
        own = with_disagreement([with_noise_of_restarts(each) for each in own])
    return own, named[len(recordings) :]


def _with_runs(recordings: Sequence[Recording], library: Library) -> list[Recording]:
    simulator = AnkleSimulator(library)
    groups = repeats(recordings, [simulator(recording, {}) for recording in recordings])
    number_of = {index: number for number, group in enumerate(groups, start=1) for index in group}
    return [
        dataclasses.replace(each, run=f"run {number_of[index]} of {_setting(each)}")
        for index, each in enumerate(recordings)
    ]


def _setting(recording: Recording) -> str:
    """Return how the rig was set: two settings are two runs, however alike they look."""
    inputs = inputs_of(recording)
    return f"{inputs.rig} {[option for option in inputs.options if option[0] != 'seed']}"


def with_noise_of_restarts(recording: Recording) -> Recording:
    """Return the recording with a noise in which what restarts do to a signal is contained.

    For recordings without references, which would take it off: it is known at the nominal course alone, and where a
    foot lands otherwise it is another one of about the same size.
    """
    roots: dict[str, float] = {}
    for name, values in _errors_of_restarts(recording).items():
        # Of all axes alike: a landing that is straight in the simulation is not quite so otherwise.
        of_axis = float(np.sqrt(np.mean(values**2)))
        roots[quantity_of(name)] = max(of_axis, roots.get(quantity_of(name), 0.0))
    return recording.with_noise(
        {each.name: float(np.hypot(each.noise, roots.get(quantity_of(each.name), 0.0))) for each in recording.signals}
    )


def _pulled(recording: Recording, rig: Rig) -> Truth | None:
    """Return how the bodies move as they are pulled; kept for as long as only other parts are changed."""
    lengths = rig.tendon_laws["free_length_m"].tobytes()
    told = digest_of(
        inputs_of(recording).key, steps_of(recording, rig), rig.wiring.joint_delay_s, rig.wiring.clock_skew
    )
    key = digest_of(_measured(recording), lengths, told, model_key(recording, rig))
    pulled = _stages().get(f"pulled {key}", lambda: pulled_bodies(recording, rig, MOTION_HORIZON_S))
    if pulled is None:
        return None
    track, raw_imu = pulled
    return Truth(timestep_s(rig), air_of(recording, rig), track, raw_imu)


def _errors_of_restarts(recording: Recording) -> dict[str, NDArray[np.float64]]:
    """Return what setting the state from samples does to each signal of the bodies, to be added again.

    Most of all in contact. Told by the simulator's own nominal run, whose true course is known.
    """

    def make() -> dict[str, NDArray[np.float64]]:
        rig = nominal_rig(inputs_of(recording))
        own = readings(recording, rig, truth_of(recording, rig))
        signals = tuple(dataclasses.replace(each, values=own.get(each.name, each.values)) for each in recording.signals)
        again = dataclasses.replace(recording, signals=signals)
        pulled = _pulled(again, rig)
        made = {} if pulled is None else readings(again, rig, pulled)
        return {name: own[name] - values for name, values in made.items() if quantity_of(name) != PRESSURE}

    key = digest_of(
        _measured(recording), inputs_of(recording).key, steps_of(recording, nominal_rig(inputs_of(recording)))
    )
    errors: dict[str, NDArray[np.float64]] = _stages().get(f"errors {key}", make)
    return errors


def _measured(recording: Recording) -> bytes:
    """Return all that the bodies are fed with, and when."""
    fed = [signal for signal in recording.signals if quantity_of(signal.name) != PRESSURE]
    return b"".join(signal.time_s.tobytes() + signal.values.tobytes() for signal in fed)


@lru_cache(maxsize=1)
def _stages() -> Stages:
    """Return what this process keeps."""
    return Stages(_KEPT)
