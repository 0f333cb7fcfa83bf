"""A rig that is driven along a course or let go at a time does so, and starts where the course does."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_common import names
from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_sim.rigs import replay
from jammkle_sim.rigs.catalogue import RIGS
from jammkle_sim.rigs.replay import Course, following, is_driven, let_go, started_at
from jammkle_sim.rigs.rig import assembled

if TYPE_CHECKING:
    from jammkle_sim.rigs.rig import Rig

AMBIENT_PA = 101_325.0


def built(rig: str, **options: object) -> Rig:
    """Build a rig."""
    found, _ = RIGS[rig].build(RIGS[rig].options(**options))
    return found


def carriage_m(rig: Rig, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Run a vented rig and return times and where its carriage was."""
    step_s = replay.timestep_s(rig)
    pressure_pa = np.full((round(seconds / step_s), 4), AMBIENT_PA)
    track = replay.Bodies(rig).follow(pressure_pa)
    return step_s * np.arange(1, len(pressure_pa) + 1), track.position(names.CARRIAGE_JOINT)


def test_rigs_with_a_drive_are_known() -> None:
    """Crosshead and slip carriage are driven, the others held, let go or left alone."""
    assert {name for name in RIGS if is_driven(built(name))} == {"tensile", "slip"}


@pytest.mark.parametrize("shape", ["pulls", "sine"])
def test_a_carriage_follows_any_course(shape: str) -> None:
    """Several pulls of different length and speed, or a sine; at a corner the servo lags for a moment."""
    time_s = np.arange(0.0, 3.0, 0.002)
    pulls = np.interp(time_s, [0.2, 0.6, 1.0, 1.2, 1.25, 2.0], [0.001, 0.015, 0.002, 0.01, 0.01, 0.0])
    course = Course(time_s, pulls if shape == "pulls" else 0.005 * (1.0 - np.cos(7.0 * time_s)))
    rig = built("tensile")
    at_s, found_m = carriage_m(following(started_at(rig, course.start_m), course), 3.0)
    assert np.abs(found_m - course.at(at_s)).max() < 5e-5
    assert np.abs(found_m - course.at(at_s)).mean() < 2e-6


def test_a_driven_rig_starts_on_its_course_with_its_tendon_at_rest() -> None:
    """Begun in the middle of a test, the tendon is as long as it then was, and has relaxed."""
    rig = started_at(built("tensile"), 0.01)
    parts = assembled(rig)
    assert parts.data.joint(names.CARRIAGE_JOINT).qpos[0] == pytest.approx(0.01)
    law, state = parts.ankle.laws.tendons[0], parts.ankle.states.tendons[0]
    assert parts.ankle.body.length_m[0] - law["free_length_m"] == pytest.approx(0.01, abs=1e-6)
    assert state["static_n"] > 1.0
    course = Course(np.array([0.0, 1.0]), np.array([0.01, 0.01]))
    _, found_m = carriage_m(following(rig, course), 0.5)
    assert np.abs(found_m - 0.01).max() < 1e-5
    assert started_at(rig, 0.01) is rig


def test_a_course_ends_where_it_ends() -> None:
    """Before its first corner and after its last a carriage stands still."""
    course = Course(np.array([0.5, 1.0]), np.array([0.0, 0.004]))
    at_s, found_m = carriage_m(following(built("tensile"), course), 2.0)
    assert np.abs(found_m[at_s < 0.5]).max() < 1e-6
    assert np.abs(found_m[at_s > 1.05] - 0.004).max() < 2e-6


def test_a_late_sensor_saw_a_course_that_was_earlier() -> None:
    """What is read 20 ms late by a clock that runs 1 % fast happened then."""
    course = Course(np.array([1.01, 2.02]), np.array([0.0, 0.01]))
    true = course.as_read_by(0.02, 0.01)
    assert true.time_s == pytest.approx([0.98, 1.98])
    assert np.array_equal(true.position_m, course.position_m)


@pytest.mark.parametrize("rig", ["drop", "landing"])
def test_a_carriage_is_let_go_when_asked(rig: str) -> None:
    """It hangs still until then, and falls freely after."""
    at_s, found_m = carriage_m(let_go(built(rig), 0.3), 0.38)
    held, falling = at_s < 0.3, at_s > 0.3
    assert np.ptp(found_m[held]) < 1e-5
    fallen_m = 0.5 * STANDARD_GRAVITY_M_S2 * (at_s[falling] - 0.3) ** 2
    assert np.abs(found_m[0] - found_m[falling] - fallen_m).max() < 4e-4
