"""What really happens when a recording's commands are played into a rig: air, then bodies, each kept for its own."""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_gap.ankle.inputs import AnkleInputs, motion_key, moved_as_recorded, nominal_rig
from jammkle_gap.ankle.readings import Truth
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.rigs import replay
from jammkle_sim.rigs.rig import laws_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from jammkle_gap.core.data import Recording
    from jammkle_sim.rigs.rig import Rig

_KEPT = 4
"""Truths kept per process; one of a 10 s recording takes 6 MB."""


def truth_of(recording: Recording, rig: Rig) -> Truth:
    """Return what really happens when a recording's commands are played into a rig, whatever its sensors make of it.

    Kept per stage, as most effects change only a part: sensors cost nothing, tendons and bodies leave the air as is.

    Raises:
        UnstableSimulationError: the simulation blew up.

    """
    pressure_pa = air_of(recording, rig)
    inputs = inputs_of(recording)
    body_key = digest_of(
        _air_key(recording, rig),
        rig.tendon_laws.tobytes(),
        _joint_key(rig),
        model_key(recording, rig),
        motion_key(rig, inputs),
    )

    def run_bodies() -> Truth:
        bodies = replay.Bodies(moved_as_recorded(rig, inputs))
        return Truth(replay.timestep_s(rig), pressure_pa, bodies.follow(pressure_pa[1:]), bodies.raw_imu_at_start)

    truth: Truth = _stages().get(f"body {body_key}", run_bodies)
    return truth


def _joint_key(rig: Rig) -> bytes:
    return b"" if rig.joint_law is None else rig.joint_law.tobytes()


def digest_of(*parts: Any) -> str:
    """Return a key of numbers, texts and bytes."""
    digest = hashlib.blake2b(digest_size=16)
    for part in parts:
        digest.update(part if isinstance(part, bytes) else repr(part).encode())
        digest.update(b"|")
    return digest.hexdigest()


def model_key(recording: Recording, rig: Rig) -> bytes:
    """Return what tells the bodies of a rig from those of others; nothing where they are as built."""
    return _model_bytes(rig, nominal_rig(inputs_of(recording)))


def inputs_of(recording: Recording) -> AnkleInputs:
    """Return the inputs of a recording.

    Raises:
        TypeError: it is not one of an ankle.

    """
    if not isinstance(recording.inputs, AnkleInputs):
        msg = f"recording '{recording.name}' has inputs of type {type(recording.inputs).__name__}, not AnkleInputs"
        raise TypeError(msg)
    return recording.inputs


def steps_of(recording: Recording, rig: Rig) -> int:
    """Return how many time steps it takes to reach the end of a recording."""
    end_s = max(float(signal.time_s[-1]) for signal in recording.signals)
    return int(np.ceil(end_s / replay.timestep_s(rig))) + 1


def air_of(recording: Recording, rig: Rig) -> NDArray[np.float64]:
    """Return the pressures in a rig that is told what the recording was told; see `replay.air`."""
    inputs, steps = inputs_of(recording), steps_of(recording, rig)
    pressure_pa: NDArray[np.float64] = _stages().get(
        f"air {_air_key(recording, rig)}", lambda: replay.air(rig, inputs.commands, steps, _start_pa(inputs, rig))
    )
    return pressure_pa


def _start_pa(inputs: AnkleInputs, rig: Rig) -> NDArray[np.float64] | None:
    """Return the pressures at the start, shape (4,), Pa: as measured, less what the sensors read too much."""
    return None if inputs.start_pa is None else inputs.start_pa - np.array(rig.wiring.pressure_offset_pa)


class Stages:
    """Keeps the latest results of each stage, for as long as the process lives."""

    def __init__(self, most: int) -> None:
        """Keep up to `most` results."""
        self._most = most
        self._kept: OrderedDict[str, Any] = OrderedDict()

    def get(self, key: str, make: Callable[[], Any]) -> Any:
        """Return what was made under a key, made now if it is not there."""
        found = self._kept.get(key)
        if found is None:
            found = make()
            self._kept[key] = found
        self._kept.move_to_end(key)
        while len(self._kept) > self._most:
            self._kept.popitem(last=False)
        return found


@lru_cache(maxsize=1)
def _stages() -> Stages:
    """Return the store of this process; a simulator that travels between processes takes nothing with it."""
    return Stages(2 * _KEPT)


def _air_key(recording: Recording, rig: Rig) -> str:
    inputs, law = inputs_of(recording), laws_of(rig).pneumatics.tobytes()
    start_pa = _start_pa(inputs, rig)
    began = b"" if start_pa is None else start_pa.tobytes()
    return digest_of(inputs.key, steps_of(recording, rig), law, rig.wiring.command_delay_s, began)


def _model_bytes(rig: Rig, nominal: Rig) -> bytes:
    if rig.model is nominal.model:
        return b""
    buffer = np.zeros(mujoco.mj_sizeModel(rig.model), dtype=np.uint8)
    mujoco.mj_saveModel(rig.model, None, buffer)
    return buffer.tobytes()
