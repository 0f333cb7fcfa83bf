"""Landings, pushes and walks in the ways that are compared; and somebody else's robot on our ankles."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_sim.rigs.simulation import Simulation
from jammkle_sim.robots.options import RobotOptions
from studies.contact import mini_cheetah, stances
from studies.contact.benefit import measure
from studies.contact.ways import AUTO, JAMMED, RIGID, SOFT, robot_of

needs_the_package = pytest.mark.skipif(
    not mini_cheetah.is_installed(), reason="`make studies` installs the package of its model"
)


def test_auto_brakes_a_deep_fall_less_hard_than_a_soft_or_a_locked_ankle() -> None:
    """From 100 mm onto level ground, where a soft heel strikes."""
    landing = RobotOptions(behaviour="drop", imu="body", drop_height_m=0.1, friction=0.8)
    peaks_m_s2 = {}
    for way in (AUTO, SOFT, RIGID):
        measured = measure("leg", landing, way)
        assert measured is not None
        peaks_m_s2[way] = measured.peak_m_s2
    assert peaks_m_s2[AUTO] < 0.6 * peaks_m_s2[SOFT] < 0.6 * peaks_m_s2[RIGID]


def test_a_gentle_push_is_withstood_and_a_hard_one_tips(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a locked joint: 0.2 m/s to the side are nothing to a quadruped, 2.5 m/s throw it over."""
    pushed = []
    for push_m_s in (0.2, 2.5):
        monkeypatch.setattr(stances, "PUSH_M_S", (push_m_s, push_m_s))
        pushed.append(stances.push("quadruped", 5, RIGID))
    gentle, hard = pushed
    assert gentle is not None
    assert hard is not None
    assert gentle.push_m_s == pytest.approx(0.2)
    assert not gentle.fell
    assert gentle.tilt_rad < 0.1
    assert hard.fell


def test_the_push_that_half_withstand_is_found() -> None:
    """Of stances that fall from about 0.8 m/s on."""
    chance = np.random.default_rng(3)
    pushes = np.exp(chance.uniform(math.log(0.4), math.log(1.8), 400))
    fell = np.log(pushes) + 0.15 * chance.logistic(size=400) * 0.5 > math.log(0.8)
    made = [stances.Pushed(push, 2.0 if falls else 0.1, 0.0) for push, falls in zip(pushes, fell, strict=True)]
    found = stances.push_of_half_m_s(made)
    assert found is not None
    half_m_s, low_m_s, high_m_s = found
    assert low_m_s < 0.8 < high_m_s
    assert half_m_s == pytest.approx(0.8, rel=0.05)
    assert high_m_s - low_m_s < 0.1
    assert stances.push_of_half_m_s(made[:1]) is None


def test_a_walk_on_rough_ground_shakes_the_body() -> None:
    """The same walk twice gives the same figures, and roll and pitch of some hundredths of a radian."""
    walked = stances.walk("quadruped", 11, SOFT)
    assert walked == stances.walk("quadruped", 11, SOFT)
    assert walked is not None
    assert 0.003 < walked.roll_rad < 0.2
    assert 0.003 < walked.pitch_rad < 0.2
    assert not walked.fell


@needs_the_package
def test_mini_cheetah_stands_on_four_ankles_as_its_model_weighs() -> None:
    """Its own masses and four ankles; each foot bears a quarter of it, give or take, on level ground and on a slope."""
    for slope_deg in (0.0, 12.0):
        options = RobotOptions(imu="body", slope_deg=slope_deg, friction=1.2, reservoir_volume_m3=0.0)
        robot = robot_of("mini_cheetah", options)
        mass_kg = float(robot.model.body_mass.sum())
        assert mass_kg == pytest.approx(6.921 + 4 * (0.54 + 0.634 + 0.214 + 0.352), abs=0.01)
        *_, last = Simulation(robot).samples(2.0, 50)
        forces_n = [ankle.foot.normal_force_n for ankle in last.ankles.values()]
        weight_n = mass_kg * STANDARD_GRAVITY_M_S2
        assert sum(forces_n) == pytest.approx(weight_n * math.cos(math.radians(slope_deg)), rel=0.05)
        assert min(forces_n) > 0.1 * weight_n
        assert last.base_tilt_rad == pytest.approx(math.radians(slope_deg), abs=0.06)


@needs_the_package
def test_mini_cheetah_lands_softer_on_ankles() -> None:
    """A small fall: what the ankles take, the trunk does not feel; a payload is carried, and a locked joint is hard."""
    landing = RobotOptions(behaviour="drop", imu="body", drop_height_m=0.04, friction=0.8)
    bare = robot_of("mini_cheetah", landing).model.body_mass.sum()
    loaded = robot_of("mini_cheetah", dataclasses.replace(landing, payload_kg=2.0)).model.body_mass.sum()
    assert loaded - bare == pytest.approx(2.0)
    jammed, rigid = (measure("mini_cheetah", landing, way) for way in (JAMMED, RIGID))
    assert jammed is not None
    assert rigid is not None
    assert jammed.peak_m_s2 < 0.7 * rigid.peak_m_s2
    assert not jammed.fell
