"""What it takes to run a recording of an ankle again: rig, options, commands, how it was driven and how it began."""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from jammkle_common import names
from jammkle_common.constants import STANDARD_ATMOSPHERE_PA
from jammkle_common.parameters import ParameterError, from_mapping, rows
from jammkle_gap.ankle.sensors import pressure_signals
from jammkle_gap.ankle.shank import moved_as_read
from jammkle_gap.core.data import BadRecordingError
from jammkle_sim.rigs.catalogue import rig_kind
from jammkle_sim.rigs.replay import Course, Timeline, following, let_go, started_at, true_time_s
from jammkle_sim.rigs.rig import ACCELEROMETER, laws_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from jammkle_gap.ankle.bag import Samples
    from jammkle_gap.ankle.shank import ShankMotion
    from jammkle_gap.core.data import Recording, Signal
    from jammkle_sim.rigs.replay import CommandTrack
    from jammkle_sim.rigs.rig import Rig
    from jammkle_sim.rigs.run import Programme

FALLING_RIGS = ("drop", "landing")
"""Rigs whose carriage is let go."""
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
    shank: ShankMotion | None = None
    """How a guided shank moved, by its IMU; None: by the rig's own programme, or it is not guided."""
    release_s: float | None = None
    """When the carriage was let go, s, as the sensor that saw it read it; None: by the rig's programme, or never."""
    release_seen_by: str = ""
    """Topic of that sensor: if it is late, the carriage was let go earlier. Empty: nobody saw it, it was set."""
    began_s: float = 0.0
    """Stamp of the start of the rig, s: what the recording's times count from."""
    exact: bool = True
    """Commands have the times at which they were taken, by the clock of the measurements; else those of a recorder."""
    known: frozenset[str] = frozenset()
    """Options that are on the run sheet; the others are the rig's defaults."""

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
        if self.shank is not None:
            digest.update(self.shank.digest)
        return digest.hexdigest()


def inputs_of(recording: Recording) -> AnkleInputs:
    """Return the inputs of a recording.

    Raises:
        TypeError: it is not one of an ankle.

    """
    if not isinstance(recording.inputs, AnkleInputs):
        msg = f"recording '{recording.name}' has inputs of type {type(recording.inputs).__name__}, not AnkleInputs"
        raise TypeError(msg)
    return recording.inputs


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
    if inputs.shank is not None:
        return moved_as_read(rig, inputs.shank)
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
    wiring = rig.wiring
    if inputs.shank is not None:
        return repr((wiring.imu_delay_s, wiring.joint_delay_s, wiring.clock_skew, laws_of(rig).imu.tobytes()))
    if inputs.course is None and not inputs.release_seen_by:
        return ""
    late_s = wiring.imu_delay_s if inputs.release_seen_by == names.IMU.name else wiring.joint_delay_s
    return repr((late_s, wiring.clock_skew))


def first_command_s(inputs: AnkleInputs) -> float:
    """Return when a solenoid first draws in the rig's own programme, s since its start; 0 where none does."""
    _, programme = _made(inputs.rig, inputs.options, inputs.ankle)
    return min((step.time_s for step in programme.vacuum if step.vacuum_pa > 0.0), default=0.0)


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
    built, _ = _made(rig, options, ankle)
    if start_m is not None:
        built = started_at(built, start_m)
    # The IMU's law clips at the same limit; MuJoCo would do so before offsets and turns.
    built.model.sensor_cutoff[built.model.sensor(ACCELEROMETER).id] = 0.0
    return built


def _made(rig: str, options: Options, ankle: Options) -> tuple[Rig, Programme]:
    kind = rig_kind(rig)
    other = {} if kind.ankle is None else {"ankle": dataclasses.replace(kind.ankle, **dict(ankle))}
    return kind.build(kind.options(**dict(options)), **other)


_LEAST_NOISE_M = 1e-7
"""Noise that is always allowed for. Assumed: no scale of a test machine resolves less."""
_NOISE_OF_MEDIAN = 1.4826
"""Standard deviation over median absolute deviation of normal numbers."""
_IS_NOISE = 2.5
"""Largest sum of what is left in a row, in standard deviations of the sum of all, that noise makes: 1.95 in one of a
thousand stretches of white noise (Kolmogorov); the rest is for noise with some memory."""
_FEWEST = 4
"""Readings of the shortest line."""
_STRAIGHT_S = 0.3
"""Shortest stretch that counts as straight, s. Assumed: a crosshead holds its speed for longer."""
_AVERAGED_S = 0.02
"""Time that readings are averaged over where a course bends, s. Chosen: the bin of the features; a bend of 0.4 m/s^2,
as 10 mm at 1 Hz has, moves the mean by 7 um."""
_SMOOTHED = 5
"""Readings that a bend is looked for by the mean of, so that noise alone does not say where."""


def course_of(time_s: NDArray[np.float64], position_m: NDArray[np.float64]) -> Course:
    """Return the course that readings show.

    Args:
        time_s: Rising, shape (n,), s.
        position_m: Shape (n,), m.

    """
    if len(time_s) < 2 * _FEWEST:
        return Course(time_s, position_m)
    noise_m = reading_noise_m(position_m)
    cuts = _cuts(time_s, position_m, noise_m)
    lines = [_line(time_s[first:last], position_m[first:last]) for first, last in itertools.pairwise(cuts)]
    corners_s, corners_m = [float(time_s[0])], [_on(lines[0], float(time_s[0]))]
    for place, cut in enumerate(cuts[1:-1]):
        one, two = lines[place], lines[place + 1]
        here_s = 0.5 * float(time_s[cut - 1] + time_s[cut])
        reach_s = 0.5 * float(min(time_s[cut] - time_s[cuts[place]], time_s[cuts[place + 2] - 1] - time_s[cut]))
        corner_s = _crossing_s(one, two, here_s, reach_s)
        if corner_s > corners_s[-1]:
            corners_s.append(corner_s)
            corners_m.append(0.5 * (_on(one, corner_s) + _on(two, corner_s)))
    corners_s.append(float(time_s[-1]))
    corners_m.append(_on(lines[-1], float(time_s[-1])))
    return _with_bends(Course(np.array(corners_s), np.array(corners_m)), cuts, time_s, position_m)


def reading_noise_m(position_m: NDArray[np.float64]) -> float:
    """Return the standard deviation from reading to reading, m: by second differences, and by the scale's own steps."""
    bends_m = np.diff(position_m, 2)
    scatter_m = _NOISE_OF_MEDIAN * float(np.median(np.abs(bends_m - np.median(bends_m)))) / np.sqrt(6.0)
    levels_m = np.diff(np.unique(position_m))
    # Rounding to steps of q leaves q / sqrt(12).
    step_m = float(levels_m.min()) if len(levels_m) else 0.0
    return float(max(scatter_m, step_m / np.sqrt(12.0), _LEAST_NOISE_M))


def _cuts(time_s: NDArray[np.float64], position_m: NDArray[np.float64], noise_m: float) -> list[int]:
    """Return where lines begin and end, rising, the number of readings last."""
    found, open_ = [0], [(0, len(time_s))]
    while open_:
        first, last = open_.pop()
        times, values = time_s[first:last], position_m[first:last]
        count = last - first
        if count < 2 * _FEWEST or _is_line(times, values, noise_m):
            found.append(last)
            continue
        cut = first + min(max(_bend(times, values), _FEWEST), count - _FEWEST)
        # The earlier part is looked at first, so that what is found is in order.
        open_ += [(cut, last), (first, cut)]
    return found


def _is_line(time_s: NDArray[np.float64], position_m: NDArray[np.float64], noise_m: float) -> bool:
    left_m = position_m - _on(_line(time_s, position_m), time_s)
    return float(np.abs(np.cumsum(left_m)).max()) <= _IS_NOISE * noise_m * float(np.sqrt(len(left_m)))


def _bend(time_s: NDArray[np.float64], position_m: NDArray[np.float64]) -> int:
    """Return which reading lies furthest from the chord between the ends."""
    padded_m = np.pad(position_m, _SMOOTHED // 2, mode="edge")
    smooth_m = np.convolve(padded_m, np.full(_SMOOTHED, 1.0 / _SMOOTHED), "valid")
    smooth_m[:2], smooth_m[-2:] = smooth_m[2], smooth_m[-3]
    chord_m = np.interp(time_s, time_s[[0, -1]], smooth_m[[0, -1]])
    return int(np.argmax(np.abs(smooth_m - chord_m)))


def _with_bends(
    course: Course, cuts: list[int], time_s: NDArray[np.float64], position_m: NDArray[np.float64]
) -> Course:
    """Return the course with what its lines leave, averaged, put on top where they are short."""
    lengths = np.diff(cuts)
    starts_s, ends_s = time_s[cuts[:-1]], time_s[np.array(cuts[1:]) - 1]
    curved = np.repeat(ends_s - starts_s < _STRAIGHT_S, lengths)
    between_s = float(np.median(np.diff(time_s)))
    around = 2 * round(0.5 * _AVERAGED_S / between_s) + 1
    left_m = np.convolve(np.pad(position_m - course.at(time_s), around // 2, mode="edge"), np.ones(around), "valid")
    every = max(round(0.5 * _AVERAGED_S / between_s), 1)
    corners_s = np.concatenate((course.time_s, time_s[np.flatnonzero(curved)[::every]]))
    on_top_m = np.interp(corners_s, time_s, np.where(curved, left_m / around, 0.0))
    corners_s, place = np.unique(corners_s, return_index=True)
    return Course(corners_s, course.at(corners_s) + on_top_m[place])


Line = tuple[float, float, float]
"""Time about which it is given, s, place there, m, and speed, m/s."""


def _line(time_s: NDArray[np.float64], position_m: NDArray[np.float64]) -> Line:
    """Return the straight line with the least squares."""
    about_s = float(time_s.mean())
    since_s = time_s - about_s
    return about_s, float(position_m.mean()), float(since_s @ position_m) / max(float(since_s @ since_s), 1e-30)


def _on(line: Line, time_s: Any) -> Any:
    about_s, place_m, speed_m_s = line
    return place_m + speed_m_s * (time_s - about_s)


def _crossing_s(one: Line, two: Line, here_s: float, reach_s: float) -> float:
    """Return when two lines cross, s, or `here_s` where that is further than `reach_s` from it."""
    turn_m_s = two[2] - one[2]
    if turn_m_s == 0.0:
        return here_s
    cross_s = here_s + (_on(one, here_s) - _on(two, here_s)) / turn_m_s
    return float(cross_s) if abs(cross_s - here_s) <= reach_s else here_s


NOT_VENTED_PA = 3e3
"""Distance from the atmosphere from which on a channel counts as evacuated at the start. Assumed: twenty times the
scatter of the sensors' offsets."""
_ALTITUDE_PA = 2e3
"""Distance from the standard atmosphere from which on a bag that describes its rig is not taken at its word. Assumed:
no weather at sea level does more, 200 m of height do."""
_VENTED_S = 0.5
"""Time after its solenoid let go at which a channel has vented. Assumed: five times its time constant."""
_SOURCES = {"manifold": names.MANIFOLD_PRESSURE, **names.PRESSURES}
"""Topics of the pressures by volume, in the order of the simulation."""
_AT_START = 5
"""Readings that the pressure at the start is taken from."""
_HIGHEST = 99.0
"""Percentile of the pressure that a vented channel stands at: the readings' noise is above it."""


def weather_pa(topics: Mapping[str, Samples], *, described: bool = False) -> float | None:
    """Return the pressure of the atmosphere, Pa, by the channels that stood vented for a while; None if none did.

    Args:
        topics: Of the whole bag, commands among them.
        described: The bag says what its rig was built with: None, but far from there.

    """
    found = []
    for channel, topic in names.PRESSURES.items():
        pressure, solenoid = topics.get(topic.name), topics.get(names.SOLENOIDS[channel].name)
        if pressure is None or not len(pressure.stamp_s):
            continue
        vented = np.ones(len(pressure.stamp_s), dtype=bool)
        if solenoid is not None:
            drawing = np.concatenate(([0.0], solenoid.columns["data"])) > 0.0
            for back_s in (0.0, _VENTED_S):
                at = np.searchsorted(solenoid.log_s, pressure.stamp_s - back_s, side="right")
                vented &= ~drawing[at]
        if vented.any():
            found.append(float(np.median(pressure.columns["pressure"][vented])))
    weather = float(np.median(found)) if found else None
    is_as_described = weather is None or abs(weather - STANDARD_ATMOSPHERE_PA) <= _ALTITUDE_PA
    return None if described and is_as_described else weather


def begins_vented(topics: Mapping[str, Samples]) -> bool:
    """Tell whether nothing was evacuated when a bag begins.

    Args:
        topics: Of the whole bag, commands among them.

    """
    begun = [(each, topics[topic.name]) for each, topic in _SOURCES.items() if topic.name in topics]
    solenoids = {
        channel: Timeline(topics[topic.name].log_s, topics[topic.name].columns["data"])
        for channel, topic in names.SOLENOIDS.items()
        if topic.name in topics
    }
    weather = weather_pa(topics)
    ambient_pa = STANDARD_ATMOSPHERE_PA if weather is None else weather
    return not any(
        _is_evacuated(where, each.stamp_s, each.columns["pressure"], solenoids, ambient_pa)
        for where, each in begun
        if len(each.stamp_s)
    )


def with_air(
    inputs: AnkleInputs, weather: float | None, signals: Mapping[str, Signal], ambient_pa: float, notes: list[str]
) -> AnkleInputs:
    """Return inputs with the atmosphere, and with the start pressures of a run that does not begin vented.

    Args:
        inputs: Of the run, with its commands.
        weather: Pressure of the atmosphere that the run was made in, Pa; None: that which the rig is built with.
        signals: Of the run.
        ambient_pa: Pressure of the atmosphere that the rig is built with, Pa.
        notes: What the reader should know is added.

    """
    if weather is not None:
        inputs = dataclasses.replace(inputs, ambient_pa=weather)
        if abs(weather - ambient_pa) > _ALTITUDE_PA:
            notes.append(f"atmosphere taken from the vented pressures: {weather:.0f} Pa")
        ambient_pa = weather
    begun = {where: signals[name] for where, name in pressure_signals(signals).items()}
    solenoids = inputs.commands.solenoids
    evacuated = [
        where for where, each in begun.items() if _is_evacuated(where, each.time_s, each.values, solenoids, ambient_pa)
    ]
    if not evacuated:
        return inputs
    notes.append(f"not vented at the start, and begun from the pressures measured then: {', '.join(evacuated)}")
    first_pa = {where: _first_pa(each.time_s, each.values, solenoids) for where, each in begun.items()}
    start_pa = np.array([first_pa.get(where, ambient_pa) for where in _SOURCES])
    return dataclasses.replace(inputs, start_pa=start_pa)


def _is_evacuated(
    where: str,
    time_s: NDArray[np.float64],
    pressure_pa: NDArray[np.float64],
    solenoids: Mapping[str, Timeline],
    ambient_pa: float,
) -> bool:
    """Tell whether a volume is evacuated as its readings begin: below what it reads later, or drawn by a solenoid.

    A sensor that only reads low reads as low when its channel is vented.
    """
    first_pa = _first_pa(time_s, pressure_pa, solenoids)
    if first_pa < float(np.percentile(pressure_pa, _HIGHEST)) - NOT_VENTED_PA:
        return True
    lines = [line for channel, line in solenoids.items() if where in {channel, "manifold"}]
    is_drawn = any(line.at(float(time_s[0])) > 0.0 for line in lines)
    return is_drawn and first_pa < ambient_pa - NOT_VENTED_PA


def _first_pa(
    time_s: NDArray[np.float64], pressure_pa: NDArray[np.float64], solenoids: Mapping[str, Timeline]
) -> float:
    """Return what a sensor reads as its readings begin, Pa: the median of a few, none after the first switching."""
    switched_s = [float(line.time_s[line.time_s > time_s[0]].min(initial=np.inf)) for line in solenoids.values()]
    count = int(np.searchsorted(time_s, min(switched_s, default=np.inf)))
    return float(np.median(pressure_pa[: max(min(count, _AT_START), 1)]))
