"""What it takes to run a recording of an ankle again: which rig, how it was set, what it was told, how it began."""

from __future__ import annotations

import dataclasses
import hashlib
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

from jammkle_common import names
from jammkle_common.parameters import ParameterError, from_mapping, rows
from jammkle_gap.core.data import BadRecordingError
from jammkle_sim.rigs.catalogue import rig_kind
from jammkle_sim.rigs.replay import following, let_go, started_at, true_time_s
from jammkle_sim.rigs.rig import ACCELEROMETER

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from numpy.typing import NDArray

    from jammkle_sim.rigs.replay import CommandTrack, Course
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
    ankle: Options = ()
    """Constants of the ankle that are not those of the rig: fields of AnkleParameters by name, sorted."""
    course: Course | None = None
    """How the carriage was driven, as its sensor read it; None: by the rig's own programme, or not at all."""
    release_s: float | None = None
    """When the carriage was let go, s, as the sensor that saw it read it; None: by the rig's programme, or never."""
    release_seen_by: str = ""
    """Topic of that sensor: if it is late, the carriage was let go earlier. Empty: nobody saw it, it was set."""
    began_s: float = 0.0
    """Stamp of the start of the rig, s: what the recording's times count from."""
    exact: bool = True
    """Commands have the times at which they were taken, by the clock of the measurements; else those of a recorder."""
    known: frozenset[str] = frozenset()
    """Options that bag, user or measurements have given; the others are the rig's defaults."""
    measured: frozenset[str] = frozenset()
    """Those that are as the recording shows them."""
    shown: Options = ()
    """What the recording shows of options, whether it was taken or what was told; sorted."""

    @cached_property
    def key(self) -> str:
        """Text that is the same for the same inputs."""
        parts = [repr((self.rig, self.options, self.ambient_pa, self.release_s, self.release_seen_by, self.ankle))]
        timelines = (self.commands.duty, *(each for _, each in sorted(self.commands.solenoids.items())))
        digest = hashlib.blake2b("".join((*parts, *sorted(self.commands.solenoids))).encode(), digest_size=16)
        for timeline in timelines:
            digest.update(timeline.time_s.tobytes())
            digest.update(timeline.values.tobytes())
        if self.start_pa is not None:
            digest.update(self.start_pa.tobytes())
        if self.course is not None:
            digest.update(self.course.time_s.tobytes())
            digest.update(self.course.position_m.tobytes())
        return digest.hexdigest()


class Drawing(NamedTuple):
    """What a nominal rig is built from; fields as those of AnkleInputs."""

    rig: str
    options: Options
    ankle: Options
    ambient_pa: float | None
    start_m: float | None
    """Where the carriage is at the start, m, where it is driven as recorded."""


def nominal_rig(inputs: AnkleInputs) -> Rig:
    """Return the rig as the simulator has it, built once per process. It must not be changed.

    What it does by itself is its own programme; `moved_as_recorded` makes it do what the recording's did.
    """
    return rig_of(drawing_of(inputs))


def drawing_of(inputs: AnkleInputs) -> Drawing:
    """Return which rig the inputs are of: the same for all that have the same nominal rig."""
    start_m = None if inputs.course is None else inputs.course.start_m
    return Drawing(inputs.rig, inputs.options, inputs.ankle, inputs.ambient_pa, start_m)


def moved_as_recorded(rig: Rig, inputs: AnkleInputs) -> Rig:
    """Return a rig that is driven and let go as the recording's was, whatever its sensors made of that.

    Args:
        rig: With effects in it, or without; not touched. A sensor of its that is late saw the motion late.
        inputs: What the sensors read.

    """
    wiring = rig.wiring
    if inputs.course is not None:
        return following(rig, inputs.course.as_read_by(wiring.joint_delay_s, wiring.clock_skew))
    if inputs.release_s is None:
        return rig
    if not inputs.release_seen_by:
        return let_go(rig, inputs.release_s)
    late_s = {names.JOINT_STATES.name: wiring.joint_delay_s, names.IMU.name: wiring.imu_delay_s}
    return let_go(rig, true_time_s(inputs.release_s, late_s[inputs.release_seen_by], wiring.clock_skew))


def motion_key(rig: Rig, inputs: AnkleInputs) -> str:
    """Return what tells the motion of a rig from that of others with the same inputs."""
    if inputs.course is None and not inputs.release_seen_by:
        return ""
    wiring = rig.wiring
    late_s = wiring.imu_delay_s if inputs.release_seen_by == names.IMU.name else wiring.joint_delay_s
    return repr((late_s, wiring.clock_skew))


def known_options(rig: str, given: Mapping[str, Any]) -> Options:
    """Return the options of a rig, those that it does not have left out.

    Raises:
        BadRecordingError: there is no such rig, or a value is out of range.

    """
    try:
        table = rig_kind(rig).options
        own = {row.name for row in rows(table)}
        options = from_mapping(table, {name: value for name, value in given.items() if name in own})
    except ParameterError as error:
        msg = f"the recording's rig cannot be built: {error}"
        raise BadRecordingError(msg) from error
    return tuple(sorted(dataclasses.asdict(options).items()))


@lru_cache(maxsize=32)
def rig_of(drawing: Drawing) -> Rig:
    """Return the nominal rig of a drawing; see `nominal_rig`."""
    built = _built(drawing.rig, drawing.options, drawing.ankle, drawing.start_m)
    if drawing.ambient_pa is None:
        return built
    pneumatics = dataclasses.replace(built.pneumatics, ambient_pa=drawing.ambient_pa)
    return dataclasses.replace(built, pneumatics=pneumatics)


@lru_cache(maxsize=32)
def _built(rig: str, options: Options, ankle: Options, start_m: float | None) -> Rig:
    kind = rig_kind(rig)
    other = {} if kind.ankle is None else {"ankle": dataclasses.replace(kind.ankle, **dict(ankle))}
    built, _ = kind.build(kind.options(**dict(options)), **other)
    if start_m is not None:
        built = started_at(built, start_m)
    # The IMU's law clips at the same limit; MuJoCo would do so before offsets and turns.
    built.model.sensor_cutoff[built.model.sensor(ACCELEROMETER).id] = 0.0
    return built
