"""Recordings that cannot be used, recognised by what is in them; each error says what to record instead."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_common.bags.run_sheet import FILE_NAME
from jammkle_gap.ankle.bag import CARRIAGE
from jammkle_gap.ankle.inputs import FALLING_RIGS
from jammkle_gap.ankle.sensors import ANGLE, PRESSURE, quantity_of
from jammkle_gap.core.data import BadRecordingError
from jammkle_sim.rigs.replay import has_ground, is_guided

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from numpy.typing import NDArray

    from jammkle_gap.ankle.bag import Samples
    from jammkle_gap.ankle.inputs import AnkleInputs
    from jammkle_gap.core.data import Signal
    from jammkle_sim.rigs.replay import CommandTrack, Timeline
    from jammkle_sim.rigs.rig import Rig

SHORTEST_S = 1.0
"""Shortest recording that is taken. Assumed: less holds nothing to test a fit on."""
_LARGEST_ANGLE_RAD = 2.0
"""Largest angle of an ankle; the joint meets its limit at 1.2 rad."""
_LOWEST_PA, _HIGHEST_PA = 15e3, 130e3
"""What a channel may read, absolute: from more vacuum than the pump makes to the highest atmosphere and some offset."""
_LARGEST_START_M = 0.05
"""Largest distance between the slide's start and that of the rig."""
_LARGEST_PULL_M = 0.2
"""Largest way of a crosshead. Assumed: three times the extension at which a tendon breaks."""
_FALLS_PA = 3e3
"""Fall of a pressure that only a command can make. Assumed: twenty times the scatter of the sensors' offsets."""
_RECEIVED_S = 0.05
"""How much later than the valves a recorder may receive a command. Assumed: five times what a busy machine takes."""
_LONGEST_PAUSE_S = 0.5
"""Longest time for which a recording may hold nothing at all. Assumed: the slowest topic comes a hundred times a
second, and a command may be lost within."""
_LONGEST_GAP_IN_MOTION_S = 0.1
"""The same of the IMU that says how a shank moved. Chosen: half a period of 5 Hz, near the fastest that one is shaken
with; an IMU of 20 Hz still counts."""
_UNITS_PA = {"kPa": 1e3, "mbar or hPa": 1e2, "bar": 1e5, "psi": 6894.76}
_VENTED_PA = (6e4, 1.1e5)
"""Lowest and highest atmosphere that a vented channel may have."""


def check_commands_from_start(bag: str, signals: Mapping[str, Signal], commands: CommandTrack) -> None:
    """Refuse pressures that fall before the command for it is in the recording.

    Raises:
        BadRecordingError: as said.

    """
    lines: dict[str, tuple[str, Timeline | None]] = {
        names.PRESSURES[channel].name: (topic.name, commands.solenoids.get(channel))
        for channel, topic in names.SOLENOIDS.items()
    }
    lines[names.MANIFOLD_PRESSURE.name] = (names.PUMP_DUTY.name, commands.duty)
    for pressure, (command, line) in lines.items():
        signal, first_s = signals.get(pressure), np.inf if line is None else float(line.time_s[0])
        before = np.zeros(0) if signal is None else signal.values[signal.time_s < first_s - _RECEIVED_S]
        if len(before) and before[0] - before.min() > _FALLS_PA:
            when = "without any" if line is None else f"before the first at {first_s:.3g} s"
            msg = f"{pressure} in bag {bag} falls by {before[0] - before.min():.0f} Pa {when} {command}"
            msg += "; record the commands too, from before the first one is given"
            raise BadRecordingError(msg)


class TooShortError(BadRecordingError):
    """A run is too short to hold anything out."""


def check_signals(bag: str, signals: Mapping[str, Signal], solenoids: Mapping[str, Timeline]) -> None:
    """Refuse signals of a run that cannot be right, or that are not enough.

    Raises:
        BadRecordingError: as said; a TooShortError, if that is all.

    """
    if not signals:
        msg = f"bag {bag} holds no sample in its run"
        raise TooShortError(msg + "; record from before the motion on until it is over")
    check_numbers(bag, signals.values())
    check_alive(bag, signals, solenoids)
    check_length(bag, signals)
    check_pauses(bag, signals.values())


def refuse_no_release(bag: str, rig: str) -> None:
    """Refuse a run of a rig that lets go in which nothing falls.

    Raises:
        BadRecordingError: always.

    """
    msg = f"bag {bag} holds no release: neither {names.CARRIAGE_JOINT} nor {names.IMU.name} falls from rest for 0.03 s"
    msg += f"; record from before the release on, or name another rig than '{rig}' with --rig"
    raise BadRecordingError(msg)


def check_course_is_known(bag: str, inputs: AnkleInputs) -> None:
    """Refuse a run of a driven rig without its carriage, unless the run sheet says how it was driven.

    Raises:
        BadRecordingError: as said.

    """
    needed = sorted({"speed_m_s", "extension_m", "descent_m"} & {name for name, _ in inputs.options})
    missing = [name for name in needed if name not in inputs.known]
    if missing:
        msg = f"bag {bag} does not say how the carriage of rig '{inputs.rig}' was driven"
        msg += f"; record '{names.CARRIAGE_JOINT}' in {names.JOINT_STATES.name}"
        msg += f", or write {missing[0]} into {FILE_NAME}"
        raise BadRecordingError(msg)


def check_guide_is_known(bag: str, rig: Rig, topics: Mapping[str, Samples]) -> None:
    """Refuse an exercise of which nobody can say how its shank moved.

    Raises:
        BadRecordingError: there is no IMU, or over the ground no height.

    """
    joints = topics.get(names.JOINT_STATES.name)
    missing = ""
    if names.IMU.name not in topics:
        missing = f"{names.IMU.name}, of an IMU on the shank"
    elif has_ground(rig) and (joints is None or CARRIAGE not in joints.columns):
        missing = f"'{names.CARRIAGE_JOINT}' in {names.JOINT_STATES.name}, the height of the ankle over the ground"
    if missing:
        msg = f"bag {bag} does not say how the shank moved in the exercise '{rig.name}'; record {missing}"
        raise BadRecordingError(msg)


def check_motion_is_whole(bag: str, sensor: str, stamp_s: NDArray[np.float64], start_s: float, end_s: float) -> None:
    """Refuse a motion that was recorded with gaps, or not from start to end: it is an input, and is not guessed.

    Args:
        bag: Name of the bag.
        sensor: The IMU's topic, or a joint, that says how something moved.
        stamp_s: Of its readings, rising, s.
        start_s: Of what is replayed.
        end_s: Of what is replayed.

    Raises:
        BadRecordingError: as said.

    """
    longest_s = _LONGEST_GAP_IN_MOTION_S if sensor == names.IMU.name else _LONGEST_PAUSE_S
    edges_s = np.array([start_s, *stamp_s[(stamp_s > start_s) & (stamp_s < end_s)], end_s])
    gaps_s = np.diff(edges_s)
    if gaps_s.max() > longest_s:
        at = int(np.argmax(gaps_s))
        msg = f"bag {bag} holds nothing of {sensor}, which says how it moved, between {edges_s[at] - start_s:.3f} and "
        msg += f"{edges_s[at + 1] - start_s:.3f} s after its start, at most {longest_s:g} s; record it without a pause"
        raise BadRecordingError(msg)


def check_length(bag: str, signals: Mapping[str, Signal]) -> None:
    """Refuse what is too short to hold anything out.

    Raises:
        BadRecordingError: as said.

    """
    length_s = max(float(signal.time_s[-1] - signal.time_s[0]) for signal in signals.values())
    if length_s < SHORTEST_S:
        msg = f"bag {bag} lasts {length_s:.2g} s, too short to hold anything out"
        msg += f"; record at least {SHORTEST_S:g} s, better ten, or several runs"
        raise TooShortError(msg)


def check_pauses(bag: str, signals: Iterable[Signal]) -> None:
    """Refuse a recording that was interrupted: what was commanded meanwhile is not known.

    Raises:
        BadRecordingError: as said.

    """
    time_s = np.unique(np.concatenate([signal.time_s for signal in signals]))
    pauses_s = np.diff(time_s)
    if len(pauses_s) and pauses_s.max() > _LONGEST_PAUSE_S:
        at = int(np.argmax(pauses_s))
        msg = f"bag {bag} holds nothing between {time_s[at]:.3f} and {time_s[at + 1]:.3f} s"
        msg += f", at most {_LONGEST_PAUSE_S:g} s; record without a pause, or give the parts as recordings of their own"
        raise BadRecordingError(msg)


def check_numbers(bag: str, signals: Iterable[Signal]) -> None:
    """Refuse units that cannot be right.

    Raises:
        BadRecordingError: angles in degrees, pressures that are not absolute Pa.

    """
    for signal in signals:
        largest, start = float(np.abs(signal.values).max()), float(np.median(signal.values[:20]))
        quantity = quantity_of(signal.name)
        if quantity == ANGLE and largest > _LARGEST_ANGLE_RAD:
            msg = f"{signal.name} in bag {bag} reaches {largest:.3g}; no ankle turns beyond {_LARGEST_ANGLE_RAD:g} rad"
            msg += "; it looks like degrees: record rad"
            raise BadRecordingError(msg)
        if quantity == PRESSURE:
            _check_pressure(bag, signal.name, start, float(signal.values.max()), float(signal.values.min()))


def _check_pressure(bag: str, name: str, start_pa: float, highest_pa: float, lowest_pa: float) -> None:
    units = [unit for unit, pa in _UNITS_PA.items() if _VENTED_PA[0] <= pa * highest_pa <= _VENTED_PA[1]]
    if units and lowest_pa > 0.0:
        guess = units[0]
    elif highest_pa > _HIGHEST_PA:
        guess = "neither gauge nor absolute"
    elif lowest_pa < _LOWEST_PA:
        guess = "gauge"
    else:
        return
    msg = f"{name} in bag {bag} lies between {lowest_pa:.4g} and {highest_pa:.4g} Pa and starts at {start_pa:.4g}"
    msg += f"; it looks like {guess}: record absolute pressure in Pa (vented: about 101325)"
    raise BadRecordingError(msg)


def check_alive(bag: str, signals: Mapping[str, Signal], solenoids: Mapping[str, Timeline]) -> None:
    """Refuse a pressure that stands still while its solenoid switches, and a recording in which nothing moves.

    Raises:
        BadRecordingError: as said.

    """
    for channel, solenoid in solenoids.items():
        signal = signals.get(names.PRESSURES[channel].name)
        drawn_s = float(np.clip(np.diff(solenoid.time_s), 0.0, None).max(initial=0.0))
        if signal is not None and solenoid.values.max() > 0.0 and drawn_s > 0.0 and np.ptp(signal.values) == 0.0:
            msg = f"{signal.name} in bag {bag} is {signal.values[0]:g} Pa throughout while its solenoid switches"
            msg += "; check that sensor and record again"
            raise BadRecordingError(msg)
    if all(np.ptp(signal.values) == 0.0 for signal in signals.values()):
        msg = f"no signal of bag {bag} changes at all"
        msg += "; record live sensors while the ankle is moved or jammed"
        raise BadRecordingError(msg)


def check_rig(
    bag: str, rig: Rig, signals: Mapping[str, Signal], joints: tuple[str, ...], start_m: float, *, is_known: bool
) -> None:
    """Refuse a rig that cannot have made the recording, or not from its release on.

    Args:
        bag: Name of the bag.
        rig: As it was named.
        signals: What was measured.
        joints: Joints of the rig.
        start_m: Where the rig's slide starts, m.
        is_known: Whether the bag itself names the rig.

    Raises:
        BadRecordingError: other tendons, other joints, another start, or one after the release.

    """
    tendons = {name.split("/")[0] for name in signals if name.endswith("/tension")}
    measured = {name.split("/")[0] for name in signals if name.endswith("/position")}
    problem = ""
    if tendons - set(rig.tendon_names):
        problem = f"it has no tendon {min(tendons - set(rig.tendon_names))}"
    elif (measured & set(names.ANKLE_JOINTS)) - set(joints):
        problem = f"it has no joint {min(measured - set(joints))}"
    elif not measured & set(joints) and measured:
        problem = f"it has no joint {min(measured)}"
    else:
        slide = signals.get(CARRIAGE)
        if rig.name == "tensile" and slide is not None and np.abs(slide.values).max() > _LARGEST_PULL_M:
            furthest_m = float(slide.values[np.argmax(np.abs(slide.values))])
            problem = f"its slide stays within {_LARGEST_PULL_M:g} m of where the tendon is free"
            problem += f", the recording's is at {furthest_m:.3f} m"
        elif slide is not None and not is_guided(rig) and abs(float(slide.values[0]) - start_m) > _LARGEST_START_M:
            first_m = float(slide.values[0])
            problem = f"its slide starts at {start_m:.3f} m, the recording's at {first_m:.3f} m"
            if is_known and rig.name in FALLING_RIGS and first_m < start_m:
                msg = f"bag {bag} begins after the release: {problem}; record rig '{rig.name}' from its start on"
                msg += ", as `jammkle up --record` does"
                raise BadRecordingError(msg)
    if problem:
        msg = f"bag {bag} cannot be from rig '{rig.name}': {problem}"
        msg += f"; name the rig that it was recorded on with --rig, and write how it was set into {FILE_NAME}"
        raise BadRecordingError(msg)
