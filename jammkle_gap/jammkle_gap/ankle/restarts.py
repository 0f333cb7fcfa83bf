"""A recording run again from the measured state, again and again: an error at once is a force, one later a drift."""

from __future__ import annotations

import dataclasses
import enum
import itertools
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.ankle.inputs import moved_as_recorded
from jammkle_gap.ankle.measured import Measured
from jammkle_gap.ankle.readings import Truth, readings
from jammkle_gap.ankle.truth import air_of, inputs_of, steps_of, truth_of
from jammkle_graph.names import ANKLE_JOINTS, CARRIAGE_JOINT
from jammkle_sim.physics import kernels, records
from jammkle_sim.physics.pneumatics import vented_state
from jammkle_sim.physics.tendon import relaxed_state
from jammkle_sim.rigs import replay
from jammkle_sim.rigs.assembly import laws_of

if TYPE_CHECKING:
    from typing import Any

    from numpy.typing import NDArray

    from jammkle_gap.ankle.inputs import AnkleInputs
    from jammkle_gap.november.recording import Recording
    from jammkle_sim.rigs.rig import Rig


Pull = Callable[[replay.Bodies, int, int], replay.BodyTrack]
"""Goes on from a first step to before a last one."""


class Drive(enum.Enum):
    """What pulls between two restarts."""

    COMMANDED = "commanded"
    """The tendons' laws at the pressures that the commands make: the whole simulation."""
    MEASURED = "measured"
    """The measured tensions: the bodies alone."""


def restarted_readings(
    recording: Recording, rig: Rig, horizon_s: float, drive: Drive = Drive.COMMANDED
) -> dict[str, NDArray[np.float64]]:
    """Return what would have been measured, had the state been set to the measured one every `horizon_s`.

    Setting a state from samples makes errors of its own, most of all in contact. The same is therefore done to the
    rig's own run, whose true course is known, and what errors come out there are taken off.

    Signals of the air are left out where a pressure was not measured; those of the bodies where a joint was not, or the
    rig has a joint that nobody measures.

    Args:
        recording: What was measured.
        rig: With effects in it, or without.
        horizon_s: Time between two restarts, s; below the time between two samples it is that.
        drive: What pulls.

    Raises:
        UnstableSimulationError: the simulation blew up.

    """
    own = readings(recording, rig, truth_of(recording, rig))
    signals = tuple(dataclasses.replace(each, values=own.get(each.name, each.values)) for each in recording.signals)
    of_own = _restarted(dataclasses.replace(recording, signals=signals), rig, horizon_s, drive)
    of_measured = _restarted(recording, rig, horizon_s, drive)
    return {name: values - of_own[name] + own[name] for name, values in of_measured.items()}


def _restarted(recording: Recording, rig: Rig, horizon_s: float, drive: Drive) -> dict[str, NDArray[np.float64]]:
    inputs, steps = inputs_of(recording), steps_of(recording, rig)
    rig = moved_as_recorded(rig, inputs)
    measured = Measured(recording, rig, steps)
    tension_n = measured.tensions_n() if drive is Drive.MEASURED else None
    if drive is Drive.MEASURED and tension_n is None:
        return {}
    cuts = _cuts(recording, rig, steps, horizon_s)
    pressure_pa = _air(inputs, rig, measured, cuts)
    follows_pa = pressure_pa if pressure_pa is not None else air_of(recording, rig)
    pull = _commanded(rig, measured, follows_pa, cuts) if tension_n is None else _driven(tension_n)
    track, raw = _bodies(rig, measured, cuts, pull)
    truth = Truth(replay.timestep_s(rig), follows_pa, track, raw)
    made = readings(recording, rig, truth)
    return {name: values for name, values in made.items() if pressure_pa is not None or not name.endswith("/pressure")}


def _cuts(recording: Recording, rig: Rig, steps: int, horizon_s: float) -> list[int]:
    """Return the steps at which the state is set, and the end."""
    period_s = min(float(np.median(np.diff(each.time_s))) for each in recording.signals if len(each.time_s) > 1)
    every = max(round(max(horizon_s, period_s) / replay.timestep_s(rig)), 1)
    return [*range(0, steps, every), steps]


def _air(inputs: AnkleInputs, rig: Rig, measured: Measured, cuts: list[int]) -> NDArray[np.float64] | None:
    given_pa = measured.pressures_pa()
    if given_pa is None:
        return None
    law = laws_of(rig).pneumatics
    state = vented_state(law)
    duty, drawing = replay.actuation(rig, law, inputs.commands, cuts[-1])
    pressure_pa = np.zeros((cuts[-1] + 1, records.VOLUMES))
    pressure_pa[0] = state["pressure_pa"][0]
    offset_pa = np.array(rig.wiring.pressure_offset_pa)
    for first, last in itertools.pairwise(cuts):
        if first > 0:
            state["pressure_pa"][0] = given_pa[first - 1] - offset_pa
            state["mass_kg"] = state["pressure_pa"] * law["volume_m3"] / law["specific_energy_j_kg"][:, np.newaxis]
        kernels.air_history(law, state, duty[first:last], drawing[first:last], pressure_pa[first + 1 : last + 1])
    return pressure_pa


def pulled_bodies(
    recording: Recording, rig: Rig, horizon_s: float
) -> tuple[replay.BodyTrack, NDArray[np.float64]] | None:
    """Return how the bodies move if pulled by the measured tensions, from the measured state every `horizon_s`.

    Args:
        recording: What was measured.
        rig: With effects in it, or without.
        horizon_s: Time between two restarts, s; below the time between two samples it is that.

    Returns:
        The bodies after each step, and the raw sample of the IMU at the start, shape (6,). None where a tension was not
        measured, or the rig has a joint that nobody measures.

    Raises:
        UnstableSimulationError: the simulation blew up.

    """
    steps = steps_of(recording, rig)
    rig = moved_as_recorded(rig, inputs_of(recording))
    measured = Measured(recording, rig, steps)
    tension_n = measured.tensions_n()
    if tension_n is None:
        return None
    track, raw = _bodies(rig, measured, _cuts(recording, rig, steps, horizon_s), _driven(tension_n))
    return None if track is None or raw is None else (track, raw)


def _commanded(rig: Rig, measured: Measured, pressure_pa: NDArray[np.float64], cuts: list[int]) -> Pull:
    """Pull by the tendons' laws, which remember what they have been taken through."""
    memories = _tendon_memories(rig, measured, pressure_pa, cuts)
    place_of = {cut: place for place, cut in enumerate(cuts)}

    def pull(bodies: replay.Bodies, first: int, last: int) -> replay.BodyTrack:
        for i, memory in enumerate(memories):
            if memory is not None and first > 0:
                bodies.states.tendons[i] = memory[place_of[first]]
        return bodies.follow(pressure_pa[first + 1 : last + 1])

    return pull


def _driven(tension_n: NDArray[np.float64]) -> Pull:
    """Pull with tensions that are given."""
    return lambda bodies, first, last: bodies.driven(tension_n[first:last])


def _bodies(
    rig: Rig, measured: Measured, cuts: list[int], pull: Pull
) -> tuple[replay.BodyTrack | None, NDArray[np.float64] | None]:
    bodies = replay.Bodies(rig)
    data, model = bodies.parts.data, rig.model
    hinges = [model.joint(i).name for i in range(model.njnt)]
    states = {name: measured.joint(name) for name in hinges}
    free = [name for name in hinges if states[name] is None and name not in ANKLE_JOINTS]
    if free or CARRIAGE_JOINT not in hinges:
        return None, None
    rows = []
    for first, last in itertools.pairwise(cuts):
        if first > 0:
            for name, state in states.items():
                # An ankle's angle that was left out stood still.
                position, rate = (0.0, 0.0) if state is None else (state[0][first - 1], state[1][first - 1])
                data.joint(name).qpos[0], data.joint(name).qvel[0] = position, rate
        rows.append(pull(bodies, first, last).rows)
    return replay.BodyTrack(bodies.parts.joints, rig.tendon_names, np.concatenate(rows)), bodies.raw_imu_at_start


def _tendon_memories(
    rig: Rig, measured: Measured, pressure_pa: NDArray[np.float64], cuts: list[int]
) -> list[NDArray[Any] | None]:
    """Return what each tendon remembers at each cut, taken through the measured extension; None where not measured."""
    ambient_pa = laws_of(rig).pneumatics["ambient_pa"][0]
    memories: list[NDArray[Any] | None] = []
    for i, tendon in enumerate(rig.tendon_names):
        law, extension_m = rig.tendon_laws[i : i + 1], measured.extension_m(tendon)
        if extension_m is None:
            memories.append(None)
            continue
        vacuum_pa = np.maximum(ambient_pa - pressure_pa[1:, int(law["channel"][0]) + 1], 0.0)
        state = relaxed_state(law, float(extension_m[0]))
        kept = np.repeat(state, len(cuts) - 1)
        tension_n = np.zeros(cuts[-1])
        for place, (first, last) in enumerate(itertools.pairwise(cuts)):
            kept[place] = state[0]
            inside = slice(first, last)
            kernels.tendon_history(law, state, extension_m[inside], vacuum_pa[inside], tension_n[inside])
        memories.append(kept)
    return memories
