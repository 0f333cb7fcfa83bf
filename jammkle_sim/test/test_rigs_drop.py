"""The drop rig against the paper's table, and what a drop must show."""

from __future__ import annotations

import dataclasses
import functools
import math
import re
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_common.parameters import from_mapping, in_si, typed_name
from jammkle_sim.physics.feet import JAMMED, RIGID_ANKLE, SQUASH_BALL, STANDARD, UNJAMMED, SquashBallParameters
from jammkle_sim.rigs.catalogue import run_rig, scattered
from jammkle_sim.rigs.drop import FEET, DropOptions
from jammkle_sim.rigs.simulation import OverloadError

if TYPE_CHECKING:
    from jammkle_sim.rigs.run import RigRun

REPEATS = 5
CLIPPED_M_S2 = 71.02


def drop(repeat: int | None = None, **values: object) -> RigRun:
    """One drop, scattered if a repeat is given."""
    options = from_mapping(DropOptions, values)
    if repeat is not None:
        options = scattered("drop", options, repeat)
    return run_rig("drop", options, lambda _: None, lambda: False)


@functools.cache
def peaks_m_s2(foot: str, seed: int = 0) -> tuple[float, ...]:
    """Peaks of five scattered drops."""
    return tuple(drop(i, foot=foot, seed=seed).results["peak_deceleration_m_s2"] for i in range(REPEATS))


# Mean peak and its standard error over five drops: the paper's table.
@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize(
    ("foot", "mean_m_s2", "error_m_s2"),
    [(SQUASH_BALL, 60.602, 0.230), (JAMMED, 42.520, 0.314), (UNJAMMED, 31.259, 0.451)],
)
def test_unclipped_means_are_the_papers(foot: str, mean_m_s2: float, error_m_s2: float, seed: int) -> None:
    """The three feet that do not clip come out within 2 standard errors."""
    assert np.mean(peaks_m_s2(foot, seed)) == pytest.approx(mean_m_s2, abs=2.0 * error_m_s2)


@pytest.mark.parametrize("foot", [RIGID_ANKLE, STANDARD])
def test_hard_feet_clip_the_imu(foot: str) -> None:
    """Every drop on a hard foot reads the range of the IMU, 71.02 m/s^2 net, but for its noise."""
    assert peaks_m_s2(foot) == pytest.approx([CLIPPED_M_S2] * REPEATS, abs=0.06)


def test_feet_are_ordered_as_in_the_paper() -> None:
    """Hard feet shock most, then the ball, then the jammed ankle, then the unjammed one, in every repeat."""
    hard, ball, jammed, unjammed = (peaks_m_s2(foot) for foot in (STANDARD, SQUASH_BALL, JAMMED, UNJAMMED))
    assert min(hard) > max(ball)
    assert min(ball) > max(jammed)
    assert min(jammed) > max(unjammed)


@pytest.mark.parametrize("foot", FEET)
def test_half_the_time_step_moves_no_peak(foot: str) -> None:
    """No peak moves by 1 %."""
    coarse, fine = drop(foot=foot), drop(foot=foot, timestep_s=0.00025)
    peak = "peak_deceleration_m_s2"
    assert fine.results[peak] == pytest.approx(coarse.results[peak], rel=0.01)


@pytest.mark.parametrize("foot", FEET)
def test_falls_free_for_50_mm(foot: str) -> None:
    """From the release at 1 s to the first touch it takes sqrt(2 h / g), within 4 ms."""
    imu = drop(foot=foot).topics["imu/data"]
    after = imu.time_s > 1.02
    touched = after & (imu.column("linear_acceleration_z_m_s2") > 2.0)
    assert imu.time_s[np.argmax(touched)] - 1.0 == pytest.approx(0.101, abs=0.004)


def test_hard_feet_bounce_and_a_squash_ball_hardly() -> None:
    """On a ball the leg rises again by 22 % of its fall, over its first touch; a hard foot bounces in the air."""
    ball = drop(foot=SQUASH_BALL).topics["joint_states"].column("carriage.position")
    after = ball[np.argmin(ball) :]
    assert (after.max() - 0.040) / 0.05 == pytest.approx(0.22, abs=0.02)
    assert drop(foot=STANDARD).results["rebound_m"] > 0.005


def test_heel_never_strikes_and_no_tendon_breaks() -> None:
    """The unjammed ankle takes the whole drop on its toe, in every repeat."""
    for repeat in range(REPEATS):
        run = drop(repeat, foot=UNJAMMED)
        assert run.topics["joint_states"].column("ankle_pitch.position").min() > 0.0
        assert not run.broken


def test_jammed_ankle_holds_its_vacuum_when_it_lands() -> None:
    """All three channels are within 2 kPa of -50 kPa at the release."""
    run = drop(foot=JAMMED)
    for channel in ("peroneal_left", "peroneal_right", "achilles"):
        series = run.topics[f"{channel}/pressure"]
        landed = int(np.searchsorted(series.time_s, 1.1))
        assert series.values[landed, 0] == pytest.approx(101_325.0 - 50e3, abs=2e3)


@pytest.mark.parametrize(("mass_kg", "height_m"), [(20.0, 0.5), (5.0, 0.1), (20.0, 0.0)])
def test_a_ball_pressed_flat_ends_the_run_with_a_way_out(mass_kg: float, height_m: float) -> None:
    """Where its walls meet the run ends with one line that names squash and limit; each value it advises is borne."""
    with pytest.raises(OverloadError, match=r"walls meet: by \d+\.\d mm .*limit is 28\.9 mm; give ") as caught:
        drop(foot=SQUASH_BALL, mass_kg=mass_kg, drop_height_m=height_m)
    line = str(caught.value)
    assert "\n" not in line
    ways = re.findall(r"--([a-z-]+) of ([\d.]+)", line)
    assert ways
    names = {typed_name(field.name): field.name for field in dataclasses.fields(DropOptions)}
    for typed, value in ways:
        name = names[typed]
        drop(**{"foot": SQUASH_BALL, "mass_kg": mass_kg, "drop_height_m": height_m, name: in_si(name, float(value))})


def test_a_ball_as_heavy_as_the_rules_ask_is_hollow() -> None:
    """Its walls meet before it is as flat as two sheets: they are some millimetres of rubber, as heavy as the ball."""
    ball = SquashBallParameters()
    wall_m = ball.radius_m - ball.largest_squash_m / 2.0
    rubber_m3 = 4.0 / 3.0 * math.pi * (ball.radius_m**3 - (ball.radius_m - wall_m) ** 3)
    assert 0.003 < wall_m < 0.008
    assert rubber_m3 * ball.rubber_density_kg_m3 == pytest.approx(ball.mass_kg)


def test_printed_constants_miss() -> None:
    """With the constants as printed the unjammed ankle is far too soft: the heel strikes."""
    run = drop(foot=UNJAMMED, parameter_set="as_printed")
    assert run.results["peak_deceleration_m_s2"] > 45.0
