"""Take a leg through a run, over all that changes on the way, and record it."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import signal as filters  # type: ignore[import-untyped]  # carries no types

from jammkle_common import names
from studies.blind.reality.bodies import TENDONS, still
from studies.blind.reality.breathing import breathe
from studies.blind.reality.course import Truth as Course
from studies.blind.reality.course import go, new_rows, truth
from studies.blind.reality.faults import era_at
from studies.blind.reality.motion import lengths_and_rates
from studies.blind.reality.record import RealRun
from studies.blind.reality.sensors import Truth, encoder_track, imu_track, load_cell_track, tendon_track
from studies.blind.reality.tendon import tendon_state
from studies.blind.reality.tendon_law import tendon_law

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from studies.blind.reality.bodies import Law
    from studies.blind.reality.faults import Era
    from studies.blind.reality.machine import Machine
    from studies.blind.reality.record import Plan
    from studies.blind.reality.regulator import SetPoint

    Floats = NDArray[np.float64]

_BODY_S = 2e-5
"""Step of the bodies. Chosen: half of it moves no peak of a drop by 0.1 %."""
_COARSE_S = 1e-3
"""Step of the tendons while the carriage is held, and what all times are rounded to."""
_MOUNT_DAMPING = 0.06
"""Of a soft mount of the IMU. Assumed: rubber."""


@dataclass(frozen=True)
class Scene:
    """One run of a leg, but for what is wrong with it."""

    law: Callable[[Machine], Law]
    height_m: float
    """Where the carriage starts."""
    leg_pitch_rad: float
    """How the leg hangs."""
    foot_pitch_rad: float
    """How the foot hangs, against the leg."""
    free_m: Floats
    """Lengths at which the tendons begin to pull, shape (TENDONS,)."""
    has_tendons: bool
    schedule: tuple[SetPoint, ...]
    duration_s: float
    """A whole number of hundredths of a second."""
    release_s: float
    """When the carriage is let go."""
    drive_m: Callable[[Floats], Floats] | None
    """Where the spindle is at a time, if there is one."""
    step_s: float
    """Of the tendons, once released."""


def move(plan: Plan, scene: Scene, periods: Sequence[Era], seed: int) -> RealRun:
    """Run a scene, and return what was recorded.

    Args:
        plan: Kept with the run.
        scene: What is set up.
        periods: The machine over time, on the day of the run.
        seed: Of the run.

    """
    air = breathe(periods, scene.schedule, scene.duration_s, seed)
    course = _course(scene, periods, air.time_s, air.vacuum_pa)
    time_s, duration_s = course.time_s, scene.duration_s
    force = _mounted(periods, course)
    imu = imu_track(periods, seed, Truth(time_s, np.column_stack([force, np.zeros_like(force)])), duration_s)
    joints: tuple[str, ...] = (names.CARRIAGE_JOINT,)
    places = course.height_m[:, None]
    choices: tuple[Callable[[Machine], object], ...] = (lambda machine: machine.sensors.slide,)
    topics = {
        **air.topics,
        names.IMU.name: imu,
        names.LOAD_CELL.name: load_cell_track(periods, seed, Truth(time_s, course.cell_n), duration_s),
    }
    if scene.has_tendons:
        joints = (*names.ANKLE_JOINTS, *joints)
        places = np.column_stack([course.angle_rad, places])
        choices = ((lambda machine: machine.sensors.angle),) * len(names.ANKLE_JOINTS) + choices
        topics[names.TENDON_STATES.name] = tendon_track(
            periods,
            seed,
            names.TENDONS,
            Truth(time_s, course.extension_m),
            Truth(time_s, course.tension_n),
            Truth(time_s, course.torn),
            duration_s,
        )
    topics[names.JOINT_STATES.name] = encoder_track(
        periods,
        seed,
        joints,
        Truth(time_s, places),
        duration_s,
        choices,  # type: ignore[arg-type]  # all of them are sensors
    )
    return RealRun(plan, topics)


def _course(scene: Scene, periods: Sequence[Era], air_s: Floats, vacuum_pa: Floats) -> Course:
    """Advance the leg, stretch by stretch: what is held is stepped coarsely, and what changes begins a new one."""
    inner = max(1, round(scene.step_s / _BODY_S))
    stops_s = {0.0, scene.release_s, scene.duration_s}
    stops_s |= {period.start_s for period in periods[1:] if 0.0 < period.start_s < scene.duration_s}
    stops = sorted({round(each / _COARSE_S) for each in stops_s})
    channel = [index for index, name in enumerate(names.CHANNELS) for _ in names.TENDONS_OF_CHANNEL[name]]
    state = still(scene.height_m, scene.leg_pitch_rad, scene.leg_pitch_rad + scene.foot_pitch_rad)
    first = scene.law(periods[0].machine).packed()
    length_m, rate_m_s = np.zeros(TENDONS), np.zeros(TENDONS)
    lengths_and_rates(first, state, length_m, rate_m_s)
    makes = periods[0].machine.tendons
    tendons = tuple(
        tendon_state(tendon_law(make, _COARSE_S), float(length))
        for make, length in zip(makes, length_m - scene.free_m, strict=True)
    )
    pin_m = np.zeros(TENDONS)
    stretches: list[tuple[Floats, Floats]] = []
    before = periods[0].machine
    for start, end in itertools.pairwise(stops):
        start_s = start * _COARSE_S
        machine = era_at(periods, start_s + _COARSE_S / 2.0)
        if machine is not before:
            for each in tendons:  # what warms up does so since the change
                each.more[0] = 0.0
        before = machine
        is_held = start_s < scene.release_s - _COARSE_S / 2.0
        step_s = _COARSE_S if is_held else scene.step_s
        count = round((end - start) * _COARSE_S / step_s)
        time_s: Floats = start_s + step_s * np.arange(count + 1, dtype=np.float64)
        held_pa = np.column_stack([np.interp(time_s[1:], air_s, vacuum_pa[:, each]) for each in channel])
        rows = new_rows(count)
        go(
            scene.law(machine).packed(),
            state,
            tuple(tendon_law(make, step_s) for make in machine.tendons),
            tendons,
            scene.free_m,
            np.full(TENDONS, machine.leg.pin_play_m),
            pin_m,
            held_pa,
            round(step_s / _BODY_S) if is_held else inner,
            step_s,
            is_held,
            np.zeros(count + 1) if scene.drive_m is None else scene.drive_m(time_s),
            scene.has_tendons,
            rows,
        )
        stretches.append((time_s[1:], rows))
    even_s = scene.step_s * np.arange(1, round(scene.duration_s / scene.step_s) + 1, dtype=np.float64)
    return truth(_even(stretches, even_s, scene), scene.free_m, even_s)


def _even(stretches: Sequence[tuple[Floats, Floats]], even_s: Floats, scene: Scene) -> Floats:
    """Return rows at even times; those of coarse stretches, in which next to nothing moves, are filled in."""
    parts = []
    for time_s, rows in stretches:
        start_s = time_s[0] - (time_s[1] - time_s[0]) if len(time_s) > 1 else time_s[0] - scene.step_s
        chosen = even_s[(even_s > start_s + 1e-9) & (even_s < time_s[-1] + 1e-9)]
        if len(chosen) == len(time_s):
            parts.append(rows)
        else:
            parts.append(np.column_stack([np.interp(chosen, time_s, column) for column in rows.T]))
    return np.concatenate(parts)


def _mounted(periods: Sequence[Era], course: Course) -> Floats:
    """Return what the IMU feels: what the carriage does, through its mount where that is soft."""
    found = course.specific_force_m_s2
    step_s = float(course.time_s[1] - course.time_s[0])
    for place, period in enumerate(periods):
        softness = period.machine.leg.mount_s2
        if softness <= 0.0:
            continue
        damping = 2.0 * _MOUNT_DAMPING * math.sqrt(softness)
        numerator, denominator = filters.bilinear([damping, 1.0], [softness, damping, 1.0], 1.0 / step_s)
        level = course.specific_force_m_s2[0]
        swung = level + filters.lfilter(numerator, denominator, course.specific_force_m_s2 - level, axis=0)
        end_s = periods[place + 1].start_s if place + 1 < len(periods) else math.inf
        chosen = (course.time_s > period.start_s) & (course.time_s <= end_s)
        found = np.where(chosen[:, None], swung, found)
    return found
