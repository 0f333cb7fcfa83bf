"""What the gap monitor follows: each subsystem simulated beside the robot from what was measured at its inputs."""

from __future__ import annotations

import dataclasses
from collections import defaultdict, deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from jammkle_common import names
from jammkle_gap.ankle.bag import CARRIAGE
from jammkle_gap.ankle.sensors import (
    ACCELERATION,
    ANGLE,
    PRESSURE,
    RATE,
    SLIDE,
    TENSION,
    declared_bias,
    declared_noise,
    quantity_of,
)
from jammkle_sim.physics import kernels, records
from jammkle_sim.physics.pneumatics import state_at, vented_state
from jammkle_sim.physics.tendon import relaxed_state
from jammkle_sim.rigs.replay import Bodies, CommandTrack, Timeline, actuation, timestep_s
from jammkle_sim.rigs.rig import imu_at_rest, laws_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_sim.rigs.replay import BodyTrack
    from jammkle_sim.rigs.rig import Rig


@dataclass(frozen=True)
class Residual:
    """Measured less simulated of one signal in one phase of a stretch."""

    signal: str
    phase: str
    scaled: NDArray[np.float64]
    """In units of the noise, shape (n,)."""


def residual_of(
    signal: str,
    phase: str,
    samples: tuple[NDArray[np.float64], NDArray[np.float64]],
    grid_s: NDArray[np.floating[Any]],
    runs: Sequence[NDArray[np.float64]],
    noise: float,
) -> Residual:
    """Return the residual of a signal beside its simulation.

    Args:
        signal: Its name.
        phase: Of the stretch.
        samples: Times, s, and what was measured, each of shape (n,).
        grid_s: Times of the runs, s.
        runs: What was simulated, the most likely first; by how much the others differ from it counts as noise.
        noise: Standard deviation of a sample.

    """
    time_s, measured = samples
    made = [np.interp(time_s, grid_s, run) for run in runs]
    apart = np.max([np.abs(each - made[0]) for each in made], axis=0)
    return Residual(signal, phase, (measured - made[0]) / np.hypot(noise, apart))


@dataclass(frozen=True)
class Stretch:
    """A stretch of time on the robot's clock, s; the first moment is not part of it, the last one is."""

    begin_s: float
    end_s: float


class Follower(Protocol):
    """One subsystem, simulated from its measured inputs stretch after stretch."""

    subsystem: ClassVar[str]
    """Its name."""
    inputs: ClassVar[tuple[str, ...]]
    """Topics that it cannot do without."""

    def begin(self, tracks: Tracks, time_s: float) -> None:
        """Start from what is measured at a time, whatever was before."""

    def follow(self, tracks: Tracks, stretch: Stretch) -> list[Residual]:
        """Simulate a stretch, which begins where the last one ended, and compare. All inputs are there."""


_HOLE = 4.5
"""Missing time, in typical intervals between samples, from which on samples were lost. Assumed: a clock's jitter makes
less."""


_LOST = 50
"""Samples in a row without a number from which on something is no longer measured. Assumed: a tenth of a second of an
IMU of 500 Hz, a second of most other topics."""


class Track:
    """Samples of one topic, by rising time; of two of the same time the later one counts.

    A sample that is older than the last, or in which a reading is suddenly not finite, is left out. What is not finite
    for long, such as velocities that a driver fills with NaN, is not measured.
    """

    def __init__(self) -> None:
        """Begin with nothing."""
        self._samples: deque[tuple[float, Mapping[str, float]]] = deque()
        self._measured: dict[str, int] = {}
        """Samples in a row, by name, in which what was measured was not finite."""

    def add(self, time_s: float, values: Mapping[str, float]) -> None:
        """Take a sample."""
        finite = {name: value for name, value in values.items() if np.isfinite(value)}
        missing = {name: self._measured[name] + 1 for name in values if name in self._measured and name not in finite}
        known = {**self._measured, **missing, **dict.fromkeys(finite, 0)}
        self._measured = {name: count for name, count in known.items() if count < _LOST}
        is_lost = any(name in self._measured for name in missing)
        if not finite or is_lost or not np.isfinite(time_s) or time_s < self.last_s:
            return
        if time_s == self.last_s:
            self._samples.pop()
        self._samples.append((time_s, finite))

    @property
    def first_s(self) -> float:
        """Time of the oldest sample, s; infinite without any."""
        return self._samples[0][0] if self._samples else float("inf")

    @property
    def last_s(self) -> float:
        """Time of the newest sample, s; minus infinity without any."""
        return self._samples[-1][0] if self._samples else -float("inf")

    @property
    def columns(self) -> tuple[str, ...]:
        """Signals of the newest sample."""
        return tuple(self._samples[-1][1]) if self._samples else ()

    def forget_before(self, time_s: float) -> None:
        """Leave out what is older, but for one sample, from which on a value holds."""
        while len(self._samples) > 1 and self._samples[1][0] <= time_s:
            self._samples.popleft()

    def column(self, name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return times, s, and values of one signal, each of shape (n,)."""
        found = [(time_s, values[name]) for time_s, values in self._samples if name in values]
        table = np.array(found, dtype=np.float64).reshape(-1, 2)
        return table[:, 0], table[:, 1]

    def within(self, name: str, begin_s: float, end_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the samples of one signal after `begin_s` and up to `end_s`."""
        time_s, values = self.column(name)
        inside = (time_s > begin_s) & (time_s <= end_s)
        return time_s[inside], values[inside]

    def has_hole(self, begin_s: float, end_s: float) -> bool:
        """Tell whether samples are missing somewhere between the last one before `begin_s` and the first after `end_s`.

        A busy machine loses some, and what lies between two others far apart is anybody's guess.
        """
        times_s = np.array([time_s for time_s, _ in self._samples])
        touched = (times_s[1:] > begin_s) & (times_s[:-1] < end_s)
        return bool((np.diff(times_s)[touched] > _HOLE * self.interval_s).any())

    @property
    def interval_s(self) -> float:
        """Typical time between two samples, s; infinite with fewer than two."""
        times_s = [time_s for time_s, _ in self._samples]
        return float(np.median(np.diff(times_s))) if len(times_s) > 1 else float("inf")

    def at(self, name: str, time_s: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
        """Return one signal at given times, straight between samples; there must be one."""
        known_s, values = self.column(name)
        found: NDArray[np.float64] = np.interp(time_s, known_s, values)
        return found


Tracks = defaultdict[str, Track]
"""Samples of every topic, by its relative name; there may be none of one."""


STILL_M_S = 0.002
"""Speed of the slide below which it counts as standing still. Assumed: as in the diagnosis of recordings."""
_IMPACT_M_S = 0.2
"""Change of speed within a stretch that makes it an impact. Assumed: a fall from 2 mm."""


def phase_of_motion(tracks: Tracks, stretch: Stretch) -> str:
    """Return `still`, `moving` or `impact`; `unknown` where the slide is not measured."""
    time_s, way_m = tracks[names.JOINT_STATES.name].within(CARRIAGE, stretch.begin_s, stretch.end_s)
    if len(time_s) < 3:  # noqa: PLR2004 - two speeds
        return "unknown"
    speed_m_s = np.diff(way_m) / np.diff(time_s)
    if np.max(np.abs(speed_m_s)) < STILL_M_S:
        return "still"
    fastest_down = int(np.argmin(speed_m_s))
    return "impact" if np.max(speed_m_s[fastest_down:]) - speed_m_s[fastest_down] > _IMPACT_M_S else "moving"


_SOURCES = (names.MANIFOLD_PRESSURE, *(names.PRESSURES[channel] for channel in names.CHANNELS))
_DATA = "data"
_PRESSURE = "pressure"
_STEADY_PA_S = 20e3
"""Rate below which a pressure counts as steady. Assumed: a fifth of what the pump makes in the beginning."""
_LARGEST_OFFSET = 3.0
"""Offset of a sensor that is taken off, in standard deviations of what its kind has; what goes beyond is a gap."""
_VENTED_PA = 2e3
"""Vacuum below which a volume counts as vented, and friction between its fibres for nothing. Assumed: four times what
the sensors' offsets scatter."""


class AirFollower(Follower):
    """Runs the air open from the start on: every volume is drawn or vented, so that no error lasts.

    Commands carry no stamp, and reach robot and monitor at times that differ by some milliseconds. As long as the
    hardware does not say when it took them, the air is therefore run by earlier and by later commands as well, and what
    lies between the two counts as noise.

    What a sensor reads too much while it is vented is taken off, as one zeroes a gauge.
    """

    subsystem = "pneumatics"
    inputs = (
        names.PUMP_DUTY.name,
        *(topic.name for topic in names.SOLENOIDS.values()),
        *(topic.name for topic in _SOURCES),
    )

    def __init__(self, rig: Rig, command_jitter_s: float) -> None:
        """Take a rig.

        Args:
            rig: What is simulated.
            command_jitter_s: How far the times of commands may be off, either way, s.

        """
        self._rig = rig
        self._law = laws_of(rig).pneumatics
        self._noise_pa = declared_noise(rig, timestep_s(rig))[PRESSURE]
        self._largest_offset_pa = _LARGEST_OFFSET * declared_bias(rig)[PRESSURE]
        self._vented_sum_pa = np.zeros(len(_SOURCES))
        self._vented_samples = np.zeros(len(_SOURCES))
        self._shifts_s: tuple[float, ...] = (0.0, -command_jitter_s, command_jitter_s)
        self._states = [vented_state(self._law) for _ in self._shifts_s]
        self._time_s = 0.0

    def trust_commands(self) -> None:
        """Take the times of commands as they are from now on: the hardware has acknowledged them."""
        self._shifts_s, self._states = self._shifts_s[:1], self._states[:1]

    def begin(self, tracks: Tracks, time_s: float) -> None:
        """Start from the pressures measured at a time."""
        self._time_s = time_s
        found = [tracks[topic.name].at(_PRESSURE, np.array([time_s]))[0] for topic in _SOURCES] - self._offsets_pa()
        self._states = [state_at(self._law, np.array(found)) for _ in self._states]

    def follow(self, tracks: Tracks, stretch: Stretch) -> list[Residual]:
        """Simulate a stretch in whole time steps, and compare it with the samples of every pressure."""
        step_s = timestep_s(self._rig)
        steps = round((stretch.end_s - self._time_s) / step_s)
        runs = [self._run(tracks, shift_s, state, steps)
                for shift_s, state in zip(self._shifts_s, self._states, strict=True)]  # fmt: skip
        grid_s = self._time_s + step_s * np.arange(steps + 1)
        self._time_s = float(grid_s[-1])
        residuals: list[Residual] = []
        for i, topic in enumerate(_SOURCES):
            time_s, measured_pa = tracks[topic.name].within(_PRESSURE, stretch.begin_s, stretch.end_s)
            if not len(time_s):
                continue
            own = [run[:, i] for run in runs]
            phase = self._phase(own[0], steps * step_s)
            if phase == "still":
                self._vented_sum_pa[i] += float((measured_pa - np.interp(time_s, grid_s, own[0])).sum())
                self._vented_samples[i] += len(time_s)
            samples = time_s, measured_pa - self._offsets_pa()[i]
            residuals.append(residual_of(topic.name, phase, samples, grid_s, own, self._noise_pa))
        return residuals

    def _offsets_pa(self) -> NDArray[np.float64]:
        """Return what each sensor reads too much, Pa, shape (VOLUMES,)."""
        mean_pa = self._vented_sum_pa / np.maximum(self._vented_samples, 1.0)
        return np.clip(mean_pa, -self._largest_offset_pa, self._largest_offset_pa)

    def _run(self, tracks: Tracks, shift_s: float, state: NDArray[Any], steps: int) -> NDArray[np.float64]:
        """Return absolute pressures at the start and after each step, Pa, shape (steps + 1, VOLUMES)."""
        begin_s = self._time_s - shift_s
        track = CommandTrack(
            _timeline(tracks[names.PUMP_DUTY.name], begin_s),
            {channel: _timeline(tracks[topic.name], begin_s) for channel, topic in names.SOLENOIDS.items()},
        )
        duty, drawing = actuation(self._rig, self._law, track, steps)
        pressure_pa = np.zeros((steps + 1, records.VOLUMES))
        pressure_pa[0] = state["pressure_pa"][0]
        kernels.air_history(self._law, state, duty, drawing, pressure_pa[1:])
        return pressure_pa

    def _phase(self, pressure_pa: NDArray[np.float64], length_s: float) -> str:
        rate_pa_s = float(pressure_pa[-1] - pressure_pa[0]) / length_s
        if abs(rate_pa_s) > _STEADY_PA_S:
            return "evacuating" if rate_pa_s < 0.0 else "venting"
        ambient_pa = float(self._law["ambient_pa"][0])
        return "holding" if pressure_pa[-1] < ambient_pa - _VENTED_PA else "still"


def _timeline(track: Track, begin_s: float) -> Timeline:
    time_s, values = track.column(_DATA)
    return Timeline(time_s - begin_s, values)


class TendonFollower(Follower):
    """Takes every tendon's law through what was measured; it remembers from one stretch to the next.

    A jammed tendon pulls by the way that it has come. Where samples of a motion were lost nobody knows that way, and
    nothing is compared until the tendons were vented and still.
    """

    subsystem = "tendon"
    inputs = (names.TENDON_STATES.name, *(topic.name for topic in names.PRESSURES.values()))

    def __init__(self, rig: Rig) -> None:
        """Take a rig."""
        self._rig = rig
        self._step_s = timestep_s(rig)
        self._noise_n = declared_noise(rig, self._step_s)[TENSION]
        self._ambient_pa = float(laws_of(rig).pneumatics["ambient_pa"][0])
        self._states = [relaxed_state(rig.tendon_laws[i : i + 1], 0.0) for i in range(len(rig.tendon_names))]
        self._time_s = 0.0
        self._is_lost = False

    def begin(self, tracks: Tracks, time_s: float) -> None:
        """Start as if every tendon had been as long as it is for long."""
        self._time_s, self._is_lost = time_s, False
        track = tracks[names.TENDON_STATES.name]
        for i, tendon in enumerate(self._rig.tendon_names):
            if f"{tendon}/extension" in track.columns:
                extension_m = float(track.at(f"{tendon}/extension", np.array([time_s]))[0])
                self._states[i] = relaxed_state(self._rig.tendon_laws[i : i + 1], extension_m)

    def follow(self, tracks: Tracks, stretch: Stretch) -> list[Residual]:
        """Simulate a stretch in whole time steps, and compare it with the samples of every tension."""
        steps = round((stretch.end_s - self._time_s) / self._step_s)
        grid_s = self._time_s + self._step_s * np.arange(1, steps + 1)
        self._time_s = float(grid_s[-1])
        track = tracks[names.TENDON_STATES.name]
        residuals: list[Residual] = []
        phase = phase_of_motion(tracks, stretch)
        has_hole = track.has_hole(stretch.begin_s, stretch.end_s)
        self._is_lost |= has_hole and phase != "still"
        for i, tendon in enumerate(self._rig.tendon_names):
            if f"{tendon}/extension" not in track.columns:
                continue
            law = self._rig.tendon_laws[i : i + 1]
            channel = tracks[names.PRESSURES[names.CHANNELS[int(law["channel"][0])]].name]
            vacuum_pa = np.maximum(self._ambient_pa - channel.at("pressure", grid_s), 0.0)
            tension_n = np.zeros(steps)
            kernels.tendon_history(law, self._states[i], track.at(f"{tendon}/extension", grid_s), vacuum_pa, tension_n)
            name = f"{tendon}/tension"
            samples = track.within(name, stretch.begin_s, stretch.end_s)
            if len(samples[0]):
                residuals.append(residual_of(name, phase, samples, grid_s, [tension_n], self._noise_n))
        if not has_hole and not self._is_lost:
            return residuals
        if self._is_lost and phase == "still" and self._is_vented(tracks, self._time_s):
            self.begin(tracks, self._time_s)
        return []

    def _is_vented(self, tracks: Tracks, time_s: float) -> bool:
        readings = [tracks[topic.name].at("pressure", np.array([time_s]))[0] for topic in names.PRESSURES.values()]
        return bool(min(readings) > self._ambient_pa - _VENTED_PA)


_JOINT_NOISE = {ANGLE: 5e-4, SLIDE: 2e-5}
"""Scatter of single readings, rad and m. Assumed: the rounding of a 12-bit encoder and of a linear scale of 0.05 mm, a
little more than step / sqrt(12); a diagnosis takes the steps themselves, since it averages over many readings."""
_HELD_M = 0.002
"""Distance from the height at which the rig holds its slide, within which a slide counts as held. Assumed."""


class BodyFollower(Follower):
    """Puts the bodies where they were measured at the start of every stretch, and pulls as was measured.

    Forces are not compared: in contact they follow the smallest error of a measured height. In an impact the pull
    changes within one interval between two samples; the bodies are then also run by one that comes half an interval
    earlier and later, and what lies between counts as noise.
    """

    subsystem = "mechanics"
    inputs = (names.JOINT_STATES.name, names.TENDON_STATES.name)

    def __init__(self, rig: Rig) -> None:
        """Take a rig whose slide is held and let go."""
        self._rig = rig
        self._step_s = timestep_s(rig)
        # What the rig does by itself, and when, is not the twin's: it sees whether the slide is held.
        self._bodies = Bodies(dataclasses.replace(rig, events=()))
        self._joints = self._bodies.parts.joints
        self._start_m = float(self._bodies.parts.data.joint(names.CARRIAGE_JOINT).qpos[0])
        self._hold = self._bodies.parts.data.eq_active.copy()

    def begin(self, tracks: Tracks, time_s: float) -> None:
        """Begin; every stretch starts from what is measured anyway."""

    def follow(self, tracks: Tracks, stretch: Stretch) -> list[Residual]:
        """Simulate a stretch from its first measured state, and compare the joints."""
        joints, tendons = tracks[names.JOINT_STATES.name], tracks[names.TENDON_STATES.name]
        wanted = [f"{name}/position" for name in self._joints]
        pulls = [f"{tendon}/tension" for tendon in self._rig.tendon_names]
        speeds = [f"{name}/velocity" for name in self._joints]
        if not {*wanted, *speeds} <= set(joints.columns) or not set(pulls) <= set(tendons.columns):
            return []
        if joints.has_hole(stretch.begin_s, stretch.end_s) or tendons.has_hole(stretch.begin_s, stretch.end_s):
            return []
        begin, steps = np.array([stretch.begin_s]), round((stretch.end_s - stretch.begin_s) / self._step_s)
        phase = phase_of_motion(tracks, stretch)
        height_m = float(joints.at(f"{names.CARRIAGE_JOINT}/position", begin)[0])
        at_hold = abs(height_m - self._start_m) < _HELD_M
        if at_hold and phase != "still":
            return []  # it is let go, and nobody says when
        grid_s = stretch.begin_s + self._step_s * np.arange(1, steps + 1)
        shift_s = 0.5 * tendons.interval_s
        runs: list[BodyTrack] = []
        for late_s in (0.0, -shift_s, shift_s) if phase == "impact" else (0.0,):
            data = self._bodies.parts.data
            for name in self._joints:
                data.joint(name).qpos[0] = joints.at(f"{name}/position", begin)[0]
                data.joint(name).qvel[0] = joints.at(f"{name}/velocity", begin)[0]
            data.eq_active[:] = self._hold if at_hold else 0
            pull_n = np.maximum(np.column_stack([tendons.at(pull, grid_s - late_s) for pull in pulls]), 0.0)
            runs.append(self._bodies.driven(pull_n))
        residuals: list[Residual] = []
        for name, signal in zip(self._joints, wanted, strict=True):
            samples = joints.within(signal, stretch.begin_s, stretch.end_s)
            if len(samples[0]):
                noise = _JOINT_NOISE[SLIDE if quantity_of(signal) == SLIDE else ANGLE]
                own = [run.position(name) for run in runs]
                residuals.append(residual_of(signal, phase, samples, grid_s, own, noise))
        return residuals


_SETTLE_S = 0.1
"""How long after a motion nothing is said of the IMU. Assumed: twice as long as anything rings."""
_AXES = tuple(f"specific_force_{axis}" for axis in "xyz") + tuple(f"angular_velocity_{axis}" for axis in "xyz")


class SensingFollower(Follower):
    """Compares the IMU with gravity while the slide, which carries it, stands still."""

    subsystem = "sensing"
    inputs = (names.IMU.name, names.JOINT_STATES.name)

    def __init__(self, rig: Rig) -> None:
        """Take a rig."""
        raw = np.array([0.0, 0.0, -float(rig.model.opt.gravity[2]), 0.0, 0.0, 0.0])
        self._at_rest = imu_at_rest(laws_of(rig).imu, raw)["second"][0]
        noise = declared_noise(rig, timestep_s(rig))
        self._noise = [noise[ACCELERATION]] * 3 + [noise[RATE]] * 3
        self._still_since_s = float("inf")

    def begin(self, tracks: Tracks, time_s: float) -> None:
        """Begin; nothing is remembered."""
        del tracks
        self._still_since_s = time_s

    def follow(self, tracks: Tracks, stretch: Stretch) -> list[Residual]:
        """Compare a stretch; one in motion, or soon after, says nothing of the sensor."""
        if phase_of_motion(tracks, stretch) != "still":
            self._still_since_s = stretch.end_s
            return []
        if stretch.begin_s < self._still_since_s + _SETTLE_S:
            return []
        track = tracks[names.IMU.name]
        residuals: list[Residual] = []
        for axis, expected, noise in zip(_AXES, self._at_rest.tolist(), self._noise, strict=True):
            _, measured = track.within(axis, stretch.begin_s, stretch.end_s)
            if len(measured):
                signal = f"{names.IMU.name.split('/')[0]}/{axis}"
                residuals.append(Residual(signal, "still", (measured - expected) / noise))
        return residuals
