"""What it takes to run a recording of an ankle again: which rig, how it was set, what it was told, how it began."""

from __future__ import annotations

import dataclasses
import hashlib
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

from jammkle_gap.core.data import BadRecordingError
from jammkle_graph.parameters import ParameterError, from_mapping, rows
from jammkle_sim.rigs.catalogue import rig_kind
from jammkle_sim.rigs.rig import ACCELEROMETER

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from numpy.typing import NDArray

    from jammkle_sim.rigs.replay import CommandTrack
    from jammkle_sim.rigs.rig import Rig

Options = tuple[tuple[str, Any], ...]
"""Options of a rig by name, sorted."""


@dataclass(frozen=True)
class AnkleInputs:
    """Inputs of one recording; its times count from the start of the rig."""

    rig: str
    options: Options
    commands: CommandTrack
    start_pa: NDArray[np.float64] | None = None
    """Absolute pressures at the start, shape (4,), Pa, where it was not vented."""
    ambient_pa: float | None = None
    """Pressure of the atmosphere, Pa, where it is not that of the rig's options."""
    starts_by_motion: bool = False
    """The start of the rig was told by its slide: if joints are read late, times count from later."""
    ankle: Options = ()
    """Constants of the ankle that are not those of the rig: fields of AnkleParameters by name, sorted."""

    @cached_property
    def key(self) -> str:
        """Text that is the same for the same inputs."""
        parts = [repr((self.rig, self.options, self.ambient_pa, self.starts_by_motion, self.ankle))]
        timelines = (self.commands.duty, *(each for _, each in sorted(self.commands.solenoids.items())))
        digest = hashlib.blake2b("".join((*parts, *sorted(self.commands.solenoids))).encode(), digest_size=16)
        for timeline in timelines:
            digest.update(timeline.time_s.tobytes())
            digest.update(timeline.values.tobytes())
        if self.start_pa is not None:
            digest.update(self.start_pa.tobytes())
        return digest.hexdigest()


def nominal_rig(inputs: AnkleInputs) -> Rig:
    """Return the rig as the simulator has it, built once per process. It must not be changed."""
    return _in_the_weather(inputs.rig, inputs.options, inputs.ankle, inputs.ambient_pa)


def known_options(rig: str, given: Mapping[str, Any]) -> Options:
    """Return the options of a rig, those that it does not have left out.

    Raises:
        BadRecordingError: there is no such rig, or a value is out of range.

    """
    try:
        table = rig_kind(rig).options
        names = {row.name for row in rows(table)}
        options = from_mapping(table, {name: value for name, value in given.items() if name in names})
    except ParameterError as error:
        msg = f"the recording's rig cannot be built: {error}"
        raise BadRecordingError(msg) from error
    return tuple(sorted(dataclasses.asdict(options).items()))


@lru_cache(maxsize=32)
def _in_the_weather(rig: str, options: Options, ankle: Options, ambient_pa: float | None) -> Rig:
    built = _built(rig, options, ankle)
    if ambient_pa is None:
        return built
    return dataclasses.replace(built, pneumatics=dataclasses.replace(built.pneumatics, ambient_pa=ambient_pa))


@lru_cache(maxsize=32)
def _built(rig: str, options: Options, ankle: Options) -> Rig:
    kind = rig_kind(rig)
    other = {} if kind.ankle is None else {"ankle": dataclasses.replace(kind.ankle, **dict(ankle))}
    built, _ = kind.build(kind.options(**dict(options)), **other)
    # The IMU's law clips at the same limit; MuJoCo would do so before offsets and turns.
    built.model.sensor_cutoff[built.model.sensor(ACCELEROMETER).id] = 0.0
    return built
