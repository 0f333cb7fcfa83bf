"""The simulator of an ankle: plays a recording's inputs into its rig, and gives what its sensors would have read."""

from __future__ import annotations

import dataclasses
import hashlib
from collections import OrderedDict
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common import names
from jammkle_common.parameters import ParameterError
from jammkle_gap.ankle.corrected import Correction, load_correction
from jammkle_gap.ankle.effects import apply_effects, apply_to_inputs, machine_constants, run_scatter
from jammkle_gap.ankle.inputs import (
    AnkleInputs,
    drawing_of,
    inputs_of,
    motion_key,
    moved_as_recorded,
    nominal_rig,
    rig_of,
)
from jammkle_gap.ankle.sensors import ACCELERATION, ANGLE, EXTENSION, FORCE, PRESSURE, RATE, SLIDE, quantity_of
from jammkle_gap.core.effects import Library
from jammkle_gap.core.simulate import InfeasibleError
from jammkle_sim.physics import kernels
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.rigs import replay
from jammkle_sim.rigs.rig import imu_at_rest, laws_of
from jammkle_sim.rigs.simulation import UnstableSimulationError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from jammkle_gap.ankle.inputs import Drawing
    from jammkle_gap.core.data import Recording, Signal
    from jammkle_sim.rigs.replay import BodyTrack
    from jammkle_sim.rigs.rig import Rig

    Values = tuple[tuple[str, float], ...]
    """By `effect.parameter`."""

_AXES = ("specific_force_x", "specific_force_y", "specific_force_z", "angular_velocity_x", "angular_velocity_y",
         "angular_velocity_z")  # fmt: skip
_KEPT = 4
"""Truths kept per process; one of a 10 s recording takes 6 MB."""


@dataclass(frozen=True)
class AnkleSimulator:
    """Runs a recording of an ankle again; fulfils `core.simulate.Simulator`, and can be pickled.

    Its values may be of the library, of `machine_constants` and of `run_scatter`, all in one call. Changes to the
    inputs come first, then those to the rig: machine, run, library.
    """

    library: Library
    """Effects whose parameters it takes, beside those of the machine and of the run."""

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
        inputs = apply_to_inputs(given, self._all, values)
        return recording if inputs is given else dataclasses.replace(recording, inputs=inputs)

    def rig(self, recording: Recording, values: Mapping[str, float]) -> Rig:
        """Return the rig of a recording with effects in it, those that change its inputs too."""
        return self._rig(inputs_of(self.recording(recording, values)), values)

    def _rig(self, inputs: AnkleInputs, values: Mapping[str, float]) -> Rig:
        drawn = {key: value for key, value in values.items() if key in _drawn_keys()}
        built = _built(drawing_of(inputs), tuple(drawn.items()))
        return apply_effects(built, self.library, {key: each for key, each in values.items() if key not in drawn})

    @cached_property
    def _all(self) -> Library:
        known = {effect.name for effect in _drawn()}
        # A correction brings the constants of the machine with it.
        return Library((*_drawn(), *(effect for effect in self.library if effect.name not in known)))


@lru_cache(maxsize=1)
def _drawn() -> Library:
    """Return what no two machines and no two runs have the same."""
    return Library((*machine_constants(), *run_scatter()))


@lru_cache(maxsize=1)
def _drawn_keys() -> frozenset[str]:
    return frozenset(each.key(one) for each in _drawn() for one in each.parameters)


@lru_cache(maxsize=8)
def _built(drawing: Drawing, drawn: Values) -> Rig:
    """Return a rig as a machine and a run have it, kept, as a search has it the same in all of its runs."""
    return apply_effects(rig_of(drawing), _drawn(), dict(drawn))


@dataclass(frozen=True)
class Rerun:
    """What the simulator does with a recording's inputs."""

    began_s: float
    """Stamp at which the recording's times begin, s."""
    step_s: float
    """Between two rows of `joints` and `tensions_n`, the first of which is one step after the start."""
    model: Any
    """The mujoco.MjModel."""
    joints: Mapping[str, NDArray[np.float64]]
    """Positions by name, rad or m, shape (n,)."""
    tensions_n: Mapping[str, NDArray[np.float64]]
    """By tendon, shape (n,), N."""
    readings: Mapping[str, NDArray[np.float64]]
    """What the sensors would have read, by the names of the recording's signals, at their times."""


def rerun(recording: Recording, corrected: Path | None = None) -> Rerun:
    """Run a recording again.

    Args:
        recording: Of an ankle, from `load_recordings`.
        corrected: Effects file that the simulator is corrected by, as `jammkle gap diagnose` writes it; None: as it is.

    Raises:
        BadEffectError: the file cannot be used with this rig.
        InfeasibleError: the simulation blew up, or a rig cannot be built so.

    """
    correction = Correction(Library(()), {}) if corrected is None else load_correction(corrected)
    simulator = AnkleSimulator(correction.library)
    changed = simulator.recording(recording, correction.values)
    try:
        rig = simulator.rig(recording, correction.values)
        truth = truth_of(changed, rig)
    except (UnstableSimulationError, ParameterError) as error:
        raise InfeasibleError(str(error)) from error
    bodies = truth.bodies
    return Rerun(
        began_s=inputs_of(recording).began_s,
        step_s=truth.step_s,
        model=rig.model,
        joints={} if bodies is None else {name: bodies.position(name) for name in bodies.joints},
        tensions_n={} if bodies is None else {name: bodies.tension_n(name) for name in bodies.tendons},
        readings=readings(changed, rig, truth),
    )


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
        b"" if rig.joint_law is None else rig.joint_law.tobytes(),
        _model_bytes(rig, nominal_rig(inputs)),
        motion_key(rig, inputs),
    )

    def run_bodies() -> Truth:
        bodies = replay.Bodies(_moved(rig, inputs))
        return Truth(replay.timestep_s(rig), pressure_pa, bodies.follow(pressure_pa[1:]), bodies.raw_imu_at_start)

    truth: Truth = _stages().get(f"body {body_key}", run_bodies)
    return truth


def _moved(rig: Rig, inputs: AnkleInputs) -> Rig:
    """Return a rig that moves as the recording's did; how a shank was guided is worked out once for all effects."""
    if inputs.shank is None:
        return moved_as_recorded(rig, inputs)
    key = digest_of(inputs.shank.digest, replay.timestep_s(rig), motion_key(rig, inputs))
    return dataclasses.replace(rig, guide=_guides().get(key, lambda: moved_as_recorded(rig, inputs).guide))


def digest_of(*parts: Any) -> str:
    """Return a key of numbers, texts and bytes."""
    digest = hashlib.blake2b(digest_size=16)
    for part in parts:
        digest.update(part if isinstance(part, bytes) else repr(part).encode())
        digest.update(b"|")
    return digest.hexdigest()


def steps_of(recording: Recording, rig: Rig) -> int:
    """Return how many time steps it takes to reach the end of a recording."""
    end_s = max(float(signal.time_s[-1]) for signal in recording.signals)
    return int(np.ceil(end_s / replay.timestep_s(rig))) + 1


def air_of(recording: Recording, rig: Rig) -> NDArray[np.float64]:
    """Return the pressures in a rig that gets the recording's commands; see `replay.air`."""
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


@lru_cache(maxsize=1)
def _guides() -> Stages:
    """Return the motions of guided shanks that this process keeps; one of 20 s takes 3 MB."""
    return Stages(2 * _KEPT)


def _air_key(recording: Recording, rig: Rig) -> str:
    inputs, law = inputs_of(recording), laws_of(rig).pneumatics.tobytes()
    start_pa = _start_pa(inputs, rig)
    began = b"" if start_pa is None else start_pa.tobytes()
    return digest_of(inputs.key, steps_of(recording, rig), law, rig.wiring.command_delay_s, began)


def _model_bytes(rig: Rig, nominal: Rig) -> bytes:
    """Return what tells the bodies of a rig from those of others; nothing where they are as built."""
    if rig.model is nominal.model:
        return b""
    buffer = np.zeros(mujoco.mj_sizeModel(rig.model), dtype=np.uint8)
    mujoco.mj_saveModel(rig.model, None, buffer)
    return buffer.tobytes()


@dataclass(frozen=True)
class Truth:
    """What really happens in a run, at every time step."""

    step_s: float
    pressure_pa: NDArray[np.float64]
    """Absolute, shape (n + 1, 4), Pa: at the start, then after each step."""
    bodies: BodyTrack | None
    """After each step; None where only the air was run."""
    raw_imu_at_start: NDArray[np.float64] | None = None
    """Raw sample of the IMU before the first step, shape (6,), where its filter begins."""


def readings(recording: Recording, rig: Rig, truth: Truth) -> dict[str, NDArray[np.float64]]:
    """Return what would have been measured, by the names of the recording's signals, at their times.

    Args:
        recording: Which signals, and when; those that the rig does not have are left out.
        rig: Its sensors and wiring.
        truth: What really happens.

    """
    maker = _Readings(rig, truth)
    found: dict[str, NDArray[np.float64]] = {}
    for signal in recording.signals:
        values = maker.reading(signal)
        if values is not None:
            found[signal.name] = values
    return found


class _Readings:
    """Makes readings of one run, the filtered IMU once for all its axes."""

    def __init__(self, rig: Rig, truth: Truth) -> None:
        self._rig = rig
        self._truth = truth
        self._start_s: NDArray[np.float64] = truth.step_s * np.arange(len(truth.pressure_pa), dtype=np.float64)
        self._pressures = (names.MANIFOLD_PRESSURE.name, *(names.PRESSURES[each].name for each in names.CHANNELS))

    def reading(self, signal: Signal) -> NDArray[np.float64] | None:
        """Return one signal; None where the rig has no such sensor."""
        quantity = quantity_of(signal.name)
        if quantity == PRESSURE:
            return self._pressure(signal)
        bodies = self._truth.bodies
        if bodies is None:
            return None
        if quantity in (ACCELERATION, RATE):
            return self._imu(signal)
        if quantity == FORCE:
            return self._force(signal, bodies)
        owner = signal.name.rpartition("/")[0]
        if owner not in (bodies.joints if quantity in (ANGLE, SLIDE) else bodies.tendons):
            return None
        columns = {ANGLE: bodies.position, SLIDE: bodies.position, EXTENSION: bodies.extension_m}
        values = columns.get(quantity, bodies.tension_n)(owner)
        return self._at(signal, self._start_s[1:], values, self._rig.wiring.joint_delay_s)

    def _pressure(self, signal: Signal) -> NDArray[np.float64] | None:
        if signal.name not in self._pressures:
            return None
        i, wiring = self._pressures.index(signal.name), self._rig.wiring
        values = self._at(signal, self._start_s, self._truth.pressure_pa[:, i], wiring.pressure_delay_s)
        return values + wiring.pressure_offset_pa[i]

    def _imu(self, signal: Signal) -> NDArray[np.float64] | None:
        column = signal.name.rpartition("/")[2]
        if column not in _AXES:
            return None
        values = self._filtered[:, _AXES.index(column)]
        return self._at(signal, self._start_s[1:], values, self._rig.wiring.imu_delay_s)

    def _force(self, signal: Signal, bodies: BodyTrack) -> NDArray[np.float64]:
        limit_n, wiring = self._rig.sensors.load_cell_limit_n, self._rig.wiring
        force_n = bodies.load_cell_n[:, "xyz".index(signal.name[-1])]
        cell_n = wiring.load_cell_gain * self._at(signal, self._start_s[1:], force_n, wiring.load_cell_delay_s)
        clipped: NDArray[np.float64] = np.clip(cell_n, -limit_n, limit_n)
        return clipped

    def _at(
        self, signal: Signal, time_s: NDArray[np.float64], values: NDArray[np.float64], delay_s: float
    ) -> NDArray[np.float64]:
        """Return values at the true times of a signal's samples."""
        true_s = signal.time_s / (1.0 + self._rig.wiring.clock_skew) - delay_s
        found: NDArray[np.float64] = np.interp(true_s, time_s, values)
        return found

    @cached_property
    def _filtered(self) -> NDArray[np.float64]:
        """All axes of the IMU after each step, shape (n, 6)."""
        bodies, at_start = self._truth.bodies, self._truth.raw_imu_at_start
        raw = np.zeros((1, 6)) if bodies is None else np.ascontiguousarray(bodies.raw_imu)
        law = laws_of(self._rig).imu
        filtered = np.zeros(raw.shape)
        kernels.imu_history(law, imu_at_rest(law, raw[0] if at_start is None else at_start), raw, filtered)
        return filtered
