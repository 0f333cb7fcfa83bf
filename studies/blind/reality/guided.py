"""Exercises of a guided shank: cycle, press, shake and tilt. A hand or a hoist moves the shank, the foot follows.

The shank goes where it is guided, whatever the foot does; the three speeds of the foot are all that is free. What is
planned are angles and ways; what the hand makes of them differs a little, and is measured by IMU and slide.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]  # carries no types

from jammkle_common import names
from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_common.names import CHANNELS
from studies.blind.reality.air import PERIOD_S, SetPoint, breathe, together
from studies.blind.reality.bodies import FOOT, TENDONS, compiled, still
from studies.blind.reality.legs import Course, Stand, ankle_law, free_lengths_m, new_rows, note, pinned_m, truth
from studies.blind.reality.machine import PLAIN, Machine, stream
from studies.blind.reality.motion import advance_guided, lengths_and_rates
from studies.blind.reality.sensors import (
    BadPlanError,
    RealRun,
    Truth,
    encoder_track,
    imu_track,
    settings,
    tendon_track,
)
from studies.blind.reality.tendon import tendon_law, tendon_state, tendon_tension_n

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from studies.blind.reality.sensors import Option, Plan
    from studies.blind.reality.tendon import TendonState

    Floats = NDArray[np.float64]

_STEP_S = 5e-4
"""Of the tendons."""
_INNER = 20
"""Steps of the foot in each. Chosen: twice as many move no angle of a press by a tenth of an encoder's step."""
_SETTLING_S = 1.5
"""Time before the start in which the foot comes to hang on its tendons."""
_TIMES_HUNG = 4
"""Times that it does so with tendons that have relaxed where it hung before: a machine has stood for hours as it was
built. Chosen: with the peroneal tendons 3.6 mm short it then begins within 0.4 mrad of where it does after six times,
an encoder's step; without, it was 18 mrad off, and crept for as long as it was recorded."""
_JAM_S = 1.0
"""From the valves to the jammed half."""
_HAND = 0.02
"""Relative standard deviation of what a hand or a hoist makes of an angle, over runs. Assumed."""
_TREMOR_RAD, _TREMOR_HZ = math.radians(0.05), (0.7, 2.3, 5.1)
"""What it trembles by, at each frequency. Assumed."""
_TREMOR_GROWS_S = 0.3


@dataclass(frozen=True)
class _Motion:
    """How the shank is guided, and when all channels are jammed."""

    pitch_rad: Callable[[Floats], Floats]
    roll_rad: Callable[[Floats], Floats]
    height_m: Callable[[Floats], Floats]
    """Of the ankle's joint, were the shank upright."""
    schedule: tuple[SetPoint, ...]
    duration_s: float
    pivot_m: float = 0.0
    """From the ankle's joint up to what the shank turns about."""
    friction: float = 0.0
    touches: bool = False
    """Whether the height is measured, as the foot is to touch the ground."""
    is_by_hand: bool = True


def _corners(rows: Sequence[tuple[float, ...]]) -> tuple[Floats, Floats]:
    """Return rising times and places of corners; each row has how long the way there takes, and the place."""
    table = np.array(rows, dtype=float)
    return np.cumsum(table[:, 0]), table[:, 1:]


def _course(time_s: Floats, corner_s: Floats, place: Floats) -> Floats:
    """Return the way from corner to corner, at rest in each: a quintic, the least jerk."""
    index = np.clip(np.searchsorted(corner_s, time_s, side="right") - 1, 0, len(corner_s) - 2)
    share = np.clip((time_s - corner_s[index]) / (corner_s[index + 1] - corner_s[index]), 0.0, 1.0)
    way: Floats = place[index] + (place[index + 1] - place[index]) * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    return way


_CYCLE: dict[str, Option] = {"vacuum_pa": 50e3, "jam_time_s": 1.5, "vent_time_s": 0.8}
_PRESS: dict[str, Option] = {
    "tilt_deg": 15.0,
    "turn_deg": 8.0,
    "sides": "yes",
    "way_time_s": 0.6,
    "friction": 0.55,
    "vacuum_pa": 20e3,
}
_SHAKE: dict[str, Option] = {"amplitude_deg": 12.0, "from_hz": 0.5, "to_hz": 6.0, "sweep_s": 5.0, "vacuum_pa": 50e3}
_TILT: dict[str, Option] = {"tilt_deg": 40.0, "hold_s": 1.0, "vacuum_pa": 50e3}
_HOIST_M = 1.0
"""Height at which the foot hangs where it is not pressed."""
_KNEE_M = 0.15
"""From the ankle up to the knee that a shank is shaken about."""


def cycle(plan: Plan, machine: Machine, seed: int) -> RealRun:
    """Jam and vent each channel of a hanging foot, then all. Raises BadPlanError for a setting that there is not."""
    chosen = settings(plan, _CYCLE)
    jam_s, vent_s = float(chosen["jam_time_s"]), float(chosen["vent_time_s"])
    groups, start_s = (*((each,) for each in CHANNELS), CHANNELS), 0.5
    schedule = [
        point
        for place, channels in enumerate(groups)
        for at_s, vacuum_pa in ((0.0, float(chosen["vacuum_pa"])), (jam_s, 0.0))
        for point in together(start_s + place * (jam_s + vent_s) + at_s, channels, vacuum_pa)
    ]
    duration_s = start_s + len(groups) * (jam_s + vent_s)
    motion = _Motion(np.zeros_like, np.zeros_like, _hoisted, tuple(schedule), duration_s, is_by_hand=False)
    return _run(plan, motion, machine, seed)


def tilt(plan: Plan, machine: Machine, seed: int) -> RealRun:
    """Hold the shank still in six poses, soft and then jammed. Raises BadPlanError as above."""
    chosen = settings(plan, _TILT)
    angle, hold_s = math.radians(float(chosen["tilt_deg"])) * _hand(seed), float(chosen["hold_s"])
    poses = [(0.0, 0.0), (angle, 0.0), (-angle, 0.0), (0.0, angle), (0.0, -angle), (angle, angle)]
    half = [row for pose in poses for row in ((0.6, *pose), (hold_s, *pose))]
    rows = [(0.0, 0.0, 0.0), *half, (_JAM_S, *poses[-1]), *half]
    corner_s, place = _corners(rows)
    jam_s = float(corner_s[len(half)])
    motion = _Motion(
        lambda time_s: _course(time_s, corner_s, place[:, 0]),
        lambda time_s: _course(time_s, corner_s, place[:, 1]),
        _hoisted,
        together(jam_s, CHANNELS, float(chosen["vacuum_pa"])),
        float(corner_s[-1]),
    )
    return _run(plan, motion, machine, seed)


def shake(plan: Plan, machine: Machine, seed: int) -> RealRun:
    """Rock the shank through a sweep, soft and then jammed. Raises BadPlanError as above."""
    chosen = settings(plan, _SHAKE)
    angle, sweep_s = math.radians(float(chosen["amplitude_deg"])) * _hand(seed), float(chosen["sweep_s"])
    slow, fast, rest_s = float(chosen["from_hz"]), float(chosen["to_hz"]), 0.5
    jam_s = 2.0 * rest_s + sweep_s
    starts_s = (rest_s, jam_s + _JAM_S)

    def swept(time_s: Floats, first: float, last: float) -> Floats:
        found = np.zeros_like(time_s)
        for start_s in starts_s:
            since = np.clip(time_s - start_s, 0.0, sweep_s)
            grows = math.log(last / first) / sweep_s
            cycles = first * np.expm1(grows * since) / grows
            window = np.sin(np.pi / 2.0 * np.clip(np.minimum(since, sweep_s - since) / 0.3, 0.0, 1.0)) ** 2
            found += angle * window * np.sin(2.0 * np.pi * cycles)
        return found

    motion = _Motion(
        lambda time_s: swept(time_s, slow, fast),
        lambda time_s: swept(time_s, fast, slow),
        _hoisted,
        together(jam_s, CHANNELS, float(chosen["vacuum_pa"])),
        starts_s[1] + sweep_s + rest_s,
        pivot_m=_KNEE_M,
    )
    return _run(plan, motion, machine, seed)


def press(plan: Plan, machine: Machine, seed: int) -> RealRun:
    """Press the foot onto the ground on toe, heel and sides, soft and then jammed. Raises BadPlanError as above."""
    chosen = settings(plan, _PRESS)
    angle, left = (math.radians(float(chosen[each])) for each in ("tilt_deg", "turn_deg"))
    if left >= angle:
        msg = f"'turn_deg' is {chosen['turn_deg']}; it must be less than the tilt, {chosen['tilt_deg']}"
        raise BadPlanError(msg)
    tilted, way_s = angle * _hand(seed), float(chosen["way_time_s"])
    sides = ((1.0, 0.3), (-1.0, -0.3), (0.3, 1.0), (-0.3, -1.0))
    half: list[tuple[float, ...]] = []
    for pitch, roll in sides if chosen["sides"] == "yes" else ((1.0, 0.0), (-1.0, 0.0)):
        # Whoever presses knows the drawing, and no more of what hangs there.
        above_m, below_m = (_touch_m(Machine(), share * pitch, share * roll) for share in (angle, angle - left))
        pose = (tilted * pitch, tilted * roll)
        half += [
            (0.6, *pose, above_m + 0.003),
            (way_s, *pose, below_m),
            (0.3, *pose, below_m),
            (way_s, *pose, above_m + 0.003),
            (0.4, *pose, above_m + 0.003),
        ]
    corner_s, place = _corners([(0.0, 0.0, 0.0, half[0][-1]), *half, (_JAM_S, *half[-1][1:]), *half])
    motion = _Motion(
        lambda time_s: _course(time_s, corner_s, place[:, 0]),
        lambda time_s: _course(time_s, corner_s, place[:, 1]),
        lambda time_s: _course(time_s, corner_s, place[:, 2]),
        together(float(corner_s[len(half)]), CHANNELS, float(chosen["vacuum_pa"])),
        float(corner_s[-1]),
        friction=float(chosen["friction"]),
        touches=True,
    )
    return _run(plan, motion, machine, seed)


def _hoisted(time_s: Floats) -> Floats:
    return np.full_like(time_s, _HOIST_M)


def _hand(seed: int) -> float:
    return 1.0 + _HAND * float(stream(seed, "hand").standard_normal())


def _touch_m(machine: Machine, pitch_rad: float, roll_rad: float) -> float:
    """Return the height of the ankle's joint at which a foot that is turned with its shank first touches."""
    centres = Rotation.from_euler("YX", (pitch_rad, roll_rad)).apply(machine.leg.corners_m(machine.leg.toe_m))
    return float(machine.leg.corner_radius_m - centres[:, 2].min())


@compiled
def _go(  # noqa: PLR0913, PLR0917  # plain numbers keep the door to compiled code cheap
    laws: Any,
    states: Any,
    tendon_laws: Any,
    tendon_states: Any,
    free_m: Any,
    pin_play_m: Any,
    pin_m: Any,
    vacuum_pa: Any,
    turns: Any,
    height_m: Any,
    speeds: Any,
    step_s: float,
    rows: Any,
) -> None:
    """Advance a guided leg by as many tendon steps as there are rows.

    Args:
        laws: `Law.packed`.
        states: Changed, shape (1,) of STATE.
        tendon_laws: One per tendon, for this step; a tuple.
        tendon_states: One per tendon, changed; a tuple.
        free_m: Lengths at which the tendons begin to pull, shape (TENDONS,).
        pin_play_m: How far the pin of each tendon can slide, shape (TENDONS,).
        pin_m: How far it has, changed, shape (TENDONS,).
        vacuum_pa: In each tendon at each row, shape (n, TENDONS).
        turns: Of the leg at the start of each row, shape (n + 1, 3, 3).
        height_m: Of the carriage there, shape (n + 1,).
        speeds: Of carriage and leg there, shape (n + 1, FOOT).
        step_s: Of the tendons.
        rows: Written, from `new_rows`.

    """
    state = states[0]
    pull_n, length_m, rate_m_s = np.zeros(TENDONS), np.zeros(TENDONS), np.zeros(TENDONS)
    change = np.zeros(FOOT)
    for row in range(rows.shape[0]):
        state.height_m = height_m[row]
        for i in range(3):
            for j in range(3):
                state.leg_turn[i, j] = turns[row, i, j]
        for i in range(FOOT):
            state.speed[i] = speeds[row, i]
            change[i] = (speeds[row + 1, i] - speeds[row, i]) / step_s
        lengths_and_rates(laws, states, length_m, rate_m_s)
        for i in range(TENDONS):
            pin_m[i] = pinned_m(pin_m[i], pin_play_m[i], pull_n[i], step_s)
            extension_m = length_m[i] - free_m[i] - pin_m[i]
            pull_n[i] = tendon_tension_n(tendon_laws[i], tendon_states[i], extension_m, vacuum_pa[row, i])
        advance_guided(laws, states, pull_n, _INNER, step_s / _INNER, speeds[row], change)
        lengths_and_rates(laws, states, length_m, rate_m_s)
        note(state, length_m, rate_m_s, pull_n, rows[row])


@dataclass(frozen=True)
class _Way:
    """Where shank and carriage are on even steps, from before the start on."""

    time_s: Floats
    """Shape (n,), below 0 while the foot comes to hang."""
    turn: Rotation
    """From the shank's frame to the world's, n of them."""
    height_m: Floats
    """Of the carriage, shape (n,)."""
    speeds: Floats
    """Of the carriage and of the shank's turning about the world's axes, shape (n, FOOT)."""
    felt: Floats
    """Specific force at the ankle's joint and angular velocity, in the shank's frame, shape (n, 6)."""
    start: int
    """Step at which the run begins."""

    @property
    def run_s(self) -> Floats:
        """Times at the end of every step of the run."""
        return self.time_s[self.start + 1 :]


def _run(plan: Plan, motion: _Motion, machine: Machine, seed: int) -> RealRun:
    """Guide the shank, and return what was recorded."""
    duration_s = math.ceil(round(motion.duration_s / PERIOD_S, 6)) * PERIOD_S
    air = breathe(machine, motion.schedule, duration_s, seed)
    free_m = free_lengths_m(machine.ankle, machine.leg.hung_rad, machine.ankle.achilles_pretension_m)
    way = _guided(motion, duration_s, seed)
    channel = [index for index, name in enumerate(CHANNELS) for _ in names.TENDONS_OF_CHANNEL[name]]
    vacuum_pa = np.column_stack([np.interp(way.time_s, air.time_s, air.vacuum_pa[:, each]) for each in channel])
    course = _moved(motion, way, machine, vacuum_pa, free_m)
    joints: tuple[str, ...] = names.ANKLE_JOINTS
    places = course.angle_rad
    encoders = (machine.sensors.angle,) * len(joints)
    if motion.touches:
        joints = (*joints, names.CARRIAGE_JOINT)
        places = np.column_stack([places, way.height_m[way.start + 1 :]])
        encoders = (*encoders, machine.sensors.slide)
    felt = Truth(way.run_s, way.felt[way.start + 1 :])
    topics = {
        **air.topics,
        names.IMU.name: imu_track(machine, seed, felt, duration_s),
        names.JOINT_STATES.name: encoder_track(machine, seed, joints, Truth(way.run_s, places), duration_s, encoders),
        names.TENDON_STATES.name: tendon_track(
            machine,
            seed,
            names.TENDONS,
            Truth(way.run_s, course.extension_m),
            Truth(way.run_s, course.tension_n),
            Truth(way.run_s, course.torn),
            duration_s,
        ),
    }
    return RealRun(plan, topics)


def _guided(motion: _Motion, duration_s: float, seed: int) -> _Way:
    """Return where a hand brings the shank: as planned, but for its tremor."""
    start, count = round(_SETTLING_S / _STEP_S), round(duration_s / _STEP_S)
    time_s = _STEP_S * np.arange(-start, count + 1, dtype=np.float64)
    since_s = np.maximum(time_s, 0.0)
    tremor = np.zeros((2, len(since_s)))
    if motion.is_by_hand:
        phases = stream(seed, "tremor").uniform(0.0, 2.0 * np.pi, (len(_TREMOR_HZ), 2, 1))
        for hertz, phase in zip(_TREMOR_HZ, phases, strict=True):
            tremor += _TREMOR_RAD * np.sin(2.0 * np.pi * hertz * since_s + phase)
        tremor *= np.clip(since_s / _TREMOR_GROWS_S, 0.0, 1.0) ** 2
    turn = Rotation.from_euler("YX", np.column_stack([motion.pitch_rad(since_s), motion.roll_rad(since_s)]) + tremor.T)
    height_m, matrix = motion.height_m(since_s), turn.as_matrix()
    spin = np.gradient(matrix, _STEP_S, axis=0) @ np.swapaxes(matrix, 1, 2)
    turning = np.column_stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]])
    ankle_m = turn.apply((0.0, 0.0, -motion.pivot_m))
    ankle_m[:, 2] += height_m
    force = np.gradient(np.gradient(ankle_m, _STEP_S, axis=0), _STEP_S, axis=0)
    force[:, 2] += STANDARD_GRAVITY_M_S2
    back = turn.inv()
    return _Way(
        time_s,
        turn,
        height_m,
        np.column_stack([np.gradient(height_m, _STEP_S), turning]),
        np.column_stack([back.apply(force), back.apply(turning)]),
        start,
    )


def _moved(motion: _Motion, way: _Way, machine: Machine, vacuum_pa: Floats, free_m: Floats) -> Course:
    """Let the foot settle, then move it."""
    state = still(float(way.height_m[0]), 0.0, machine.leg.hung_rad)
    stand = Stand(PLAIN.ankle_kg + 1.0, machine.leg.toe_m, motion.friction, 0.0, 0.0, motion.pivot_m)
    law, laws = ankle_law(machine, stand).packed(), tuple(tendon_law(make, _STEP_S) for make in machine.tendons)
    pin_play_m, pin_m, length_m = np.full(TENDONS, machine.leg.pin_play_m), np.zeros(TENDONS), np.zeros(TENDONS)
    last, turns = len(way.time_s) - 1, way.turn.as_matrix()
    rows = new_rows(last)

    def go(tendons: tuple[TendonState, ...], start: int, end: int) -> None:
        _go(
            law,
            state,
            laws,
            tendons,
            free_m,
            pin_play_m,
            pin_m,
            vacuum_pa[start + 1 : end + 1],
            turns[start : end + 1],
            way.height_m[start : end + 1],
            way.speeds[start : end + 1],
            _STEP_S,
            rows[start:end],
        )

    for _ in range(1 + _TIMES_HUNG):
        lengths_and_rates(law, state, length_m, np.zeros(TENDONS))
        extension_m = length_m - (free_m + pin_m)
        tendons = tuple(tendon_state(each, float(by_m)) for each, by_m in zip(laws, extension_m, strict=True))
        go(tendons, 0, way.start)
    go(tendons, way.start, last)
    return truth(rows[way.start :], free_m, way.run_s)
