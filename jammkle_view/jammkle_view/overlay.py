"""The simulation that lies over a recording: of a rig every run again, of a robot the same from its start."""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common import names
from jammkle_common.bags.reading import opened
from jammkle_common.bags.times import BagTimes
from jammkle_common.command.errors import InputError
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.parameters import ParameterError
from jammkle_gap import BadEffectError, BadRecordingError, InfeasibleError, load_recordings, rerun
from jammkle_sim.rigs.simulation import Simulation, UnstableSimulationError
from jammkle_sim.robots.catalogue import robot
from jammkle_sim.robots.options import RobotOptions
from jammkle_view.core.models import described, known, setting_of
from jammkle_view.core.samples import Base, Imu, Joints, Pressure, Tendons
from jammkle_view.recorded import Collected, Motion, Track

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from jammkle_view.core.models import Naming
    from jammkle_view.core.samples import Sample
    from jammkle_view.recorded import Recorded

_UNSHOWN_NOTES = 3


@dataclass(frozen=True)
class Gap:
    """How far one signal of the simulation is from the recording."""

    signal: str
    unit: str
    rms: float
    """Root of the mean squared difference over all that was run again, in `unit`."""
    largest: float


@dataclass(frozen=True, kw_only=True)
class SimulatedRun(Motion):
    """One run again: what sensors would have read."""

    model: Any


@dataclass(frozen=True)
class Overlay:
    """All runs again of a bag, and how far they are off."""

    runs: tuple[SimulatedRun, ...]
    gaps: tuple[Gap, ...]
    notes: tuple[str, ...]
    """What was not known of the recording, and taken to be so."""

    def run_at(self, time_s: float) -> SimulatedRun | None:
        """Return the run that a time lies in, s since the start of the bag."""
        return next((run for run in self.runs if run.joints.covers(time_s)), None)


def overlay_of(path: Path, recorded: Recorded, rig: str | None, corrected: Path | None) -> Overlay:
    """Run again what a bag holds, of this rig if the bag does not say, corrected by an effects file or nominal.

    Raises:
        InputError: the effects file cannot be used, or the recording cannot be run again; the message says why.

    """
    try:
        recordings = load_recordings(path, rig, namespace=recorded.namespace)
        runs: list[SimulatedRun] = []
        off: dict[tuple[str, str], list[NDArray[np.float64]]] = defaultdict(list)
        for recording in recordings:
            again = rerun(recording, corrected)
            offset_s = again.began_s - recorded.start_s
            count = max((len(values) for values in again.joints.values()), default=0)
            time_s = offset_s + again.step_s * np.arange(1.0, count + 1.0)
            readings = {}
            for signal in recording.signals:
                if signal.name not in again.readings:
                    continue
                values = again.readings[signal.name]
                readings[signal.name] = Track(signal.time_s + offset_s, {signal.name: values})
                off[signal.name, signal.unit].append(values - signal.values)
            joints, tensions_n = Track(time_s, again.joints), Track(time_s, again.tensions_n)
            runs.append(SimulatedRun(model=again.model, joints=joints, tensions_n=tensions_n, readings=readings))
    except (BadEffectError, BadRecordingError, InfeasibleError) as error:
        raise InputError(str(error)) from error
    gaps = tuple(_gap(signal, unit, np.concatenate(parts)) for (signal, unit), parts in off.items())
    return Overlay(tuple(runs), gaps, recordings[0].notes[:_UNSHOWN_NOTES])


def _gap(signal: str, unit: str, off: NDArray[np.float64]) -> Gap:
    return Gap(signal, unit, float(np.sqrt(np.mean(off**2))), float(np.abs(off).max()))


LATEST_STAMP_S = 3600.0
"""A robot is simulated from its start on; an hour of a quadruped takes some ten minutes. A machine's clock is later."""
_IMU_PERIOD_S = 0.002
_STATE_TICKS = 5
"""IMU samples per sample of joints, pressures and tensions: 100 Hz, more than a page shows in a second."""
_MISSED_S = 0.05
"""Recordings that begin later get a note: what was commanded before is not in them."""
_UNITS = {
    "pressure": "Pa",
    "specific_force": "m/s^2",
    "angular_velocity": "rad/s",
    "position": "rad",
    "tension": "N",
}
"""By what a signal is, as the end of its name says, without the axis."""


def is_robot(recorded: Recorded) -> bool:
    """Return whether a recording is of a simulated leg or quadruped."""
    return "robot" in described(recorded.description)


def robot_overlay(path: Path, recorded: Recorded, on_progress: Callable[[float], None]) -> Overlay:
    """Simulate what a bag of a robot holds: from the robot's start, without noise, commanded as its ankles were.

    Raises:
        InputError: it cannot be simulated again; the message says why.

    """
    end_s = recorded.start_s + recorded.duration_s
    if end_s > LATEST_STAMP_S:
        msg = (
            f"the recording ends at {end_s:.0f} s of its clock; a robot is simulated from its start on, to "
            f"{LATEST_STAMP_S:.0f} s at most. What was stamped by a machine's clock cannot be simulated again"
        )
        raise InputError(msg)
    simulation = _simulation(recorded)
    several = len(simulation.ankles) > 1
    above, _, own = recorded.namespace.rpartition("/") if several else (recorded.namespace, "", "")
    namespaces = {f"{above.rstrip('/')}/{name}" if several else recorded.namespace: name for name in simulation.ankles}
    shown = own if several else next(iter(simulation.ankles))
    commands = commands_of(path, namespaces)
    if not commands:
        msg = f"bag {path} holds no commands of {names.PUMP_DUTY.name} or a solenoid: nobody knows its commands"
        raise InputError(msg)
    collected, namings = Collected(), setting_of(recorded.description).ankles
    try:
        for tick, time_s in _ticks(simulation, commands, end_s):
            for sample in _samples(simulation, shown, namings, time_s, with_state=tick % _STATE_TICKS == 0):
                collected.take(sample)
            if tick % (100 * _STATE_TICKS) == 0:
                on_progress(time_s / end_s)
    except UnstableSimulationError as error:
        raise InputError(str(error)) from error
    run = SimulatedRun(model=simulation.model, **collected.motion(recorded.start_s))
    note = (
        f"simulated from the robot's start, {recorded.start_s:.1f} s before the recording; its commands until then "
        "are taken to be the first that were recorded, and a reset is not known"
    )
    return Overlay((run,), tuple(_gaps(recorded, run)), (note,) if recorded.start_s > _MISSED_S else ())


def _simulation(recorded: Recorded) -> Simulation:
    """Return the robot at its start, with sensors that have neither noise nor offset."""
    content = described(recorded.description)
    try:
        built = robot(str(content["robot"]), RobotOptions(**known(RobotOptions, content)))
    except (ParameterError, TypeError) as error:
        msg = f"robot '{content['robot']}' cannot be built as {names.SIM_PARAMETERS.name} says: {error}"
        raise InputError(msg) from error
    sensors = dataclasses.replace(
        built.sensors,
        acceleration_noise_m_s2_rthz=0.0,
        angular_rate_noise_rad_s_rthz=0.0,
        pressure_noise_pa=0.0,
        pressure_offset_pa=0.0,
    )
    return Simulation(dataclasses.replace(built, sensors=sensors))


def _ticks(simulation: Simulation, commands: Sequence[Command], end_s: float) -> Iterator[tuple[int, float]]:
    """Go on from one sample of the IMU to the next, with what is commanded in between; give number and time, s."""
    first: dict[tuple[str, str], Command] = {}
    for each in commands:
        first.setdefault((each.ankle, each.channel), each)
    for each in first.values():
        _command(simulation, each)
    step_s, tick_steps = simulation.timestep_s, round(_IMU_PERIOD_S / simulation.timestep_s)
    coming, taken = iter(commands), 0
    following = next(coming, None)
    for tick in range(1, round(end_s / _IMU_PERIOD_S) + 1):
        end = tick * tick_steps
        while following is not None and following.time_s < tick * _IMU_PERIOD_S:
            at = min(max(round(following.time_s / step_s), taken), end)
            simulation.advance(at - taken)
            taken = at
            _command(simulation, following)
            following = next(coming, None)
        simulation.advance(end - taken)
        taken = end
        yield tick, tick * _IMU_PERIOD_S


def _command(simulation: Simulation, command: Command) -> None:
    view = simulation.ankles[command.ankle]
    if command.channel:
        view.set_solenoid(command.channel, command.value > 0.0)
    else:
        view.set_pump_duty(min(max(command.value, 0.0), 1.0))


def _samples(
    simulation: Simulation, shown: str, namings: Mapping[str, Naming], time_s: float, *, with_state: bool
) -> Iterator[Sample]:
    """Give a sample of the shown ankle's IMU, and of everything else where it is due."""
    view, imu = simulation.ankles[shown], simulation.ankles[shown].imu()
    yield Imu(time_s, imu.specific_force_m_s2, imu.angular_velocity_rad_s)
    if not with_state:
        return
    base = simulation.base()
    yield Base(time_s, base.position_m, base.rotation)
    yield Pressure(time_s, names.MANIFOLD_PRESSURE.name, view.manifold_pressure_pa())
    for channel, pressure_pa in view.channel_pressures_pa().items():
        yield Pressure(time_s, names.PRESSURES[channel].name, pressure_pa)
    tensions_n = (tendon.tension_n for tendon in view.tendons())
    yield Tendons(time_s, dict(zip(names.TENDONS, tensions_n, strict=True)), frozenset())
    joints = dict(view.joint_positions())  # plots know them by the ankle's own names, the model by its
    for name, ankle in simulation.ankles.items():
        naming = namings[name if len(simulation.ankles) > 1 else ""]
        joints |= {naming.get(joint, joint): value for joint, value in ankle.joint_positions().items()}
    yield Joints(time_s, joints)


def _gaps(recorded: Recorded, run: SimulatedRun) -> Iterator[Gap]:
    """Give how far the shown signals are off, at the times at which they were measured."""
    for signal, (time_s, measured) in recorded.signals.items():
        if signal not in run.signals:
            continue
        simulated_s, simulated = run.signals[signal]
        inside = (time_s >= simulated_s[0]) & (time_s <= simulated_s[-1])
        off = np.interp(time_s[inside], simulated_s, simulated) - measured[inside]
        off = off[np.isfinite(off)]
        if len(off):
            what = signal.rpartition("/")[2]
            yield _gap(signal, _UNITS[what if what in _UNITS else what.rpartition("_")[0]], off)


@dataclass(frozen=True)
class Command:
    """A command of the pump or a solenoid of an ankle, from a time on, s. `channel` is empty for the pump."""

    time_s: float
    ankle: str
    channel: str
    value: float


def commands_of(path: Path, namespaces: Mapping[str, str]) -> list[Command]:
    """Return the commands of pumps and solenoids of ankles, by the namespaces in which they are, in order.

    Where the hardware has said when it took its commands (`actuator_states`), that counts, and the commands do not.
    """
    asked: dict[str, list[Command]] = {name: [] for name in namespaces.values()}
    taken: dict[str, list[Command]] = {name: [] for name in namespaces.values()}
    topics: dict[str, tuple[str, str]] = {}
    for namespace, ankle in namespaces.items():
        inside = namespace.rstrip("/")
        topics |= {f"{inside}/{names.SOLENOIDS[channel].name}": (ankle, channel) for channel in names.CHANNELS}
        topics[f"{inside}/{names.PUMP_DUTY.name}"] = (ankle, "")
        topics[f"{inside}/{names.ACTUATOR_STATES.name}"] = (ankle, names.ACTUATOR_STATES.name)
    with opened(path) as reader:
        for connection, time_ns, _, data in BagTimes(reader).messages(reader.on(topics)):
            time_s = time_ns / NANOSECONDS_PER_SECOND
            ankle, what = topics[connection.topic]
            message: Any = reader.deserialize(data, connection.msgtype)
            if what == names.ACTUATOR_STATES.name:
                taken[ankle].append(Command(time_s, ankle, "", float(message.pump_duty)))
                pairs = zip(message.channels, message.energised, strict=True)
                taken[ankle] += [Command(time_s, ankle, channel, float(on)) for channel, on in pairs]
            else:
                asked[ankle].append(Command(time_s, ankle, what, float(message.data)))
    found = [each for ankle in asked for each in (taken[ankle] or asked[ankle])]
    return sorted(found, key=lambda each: each.time_s)
