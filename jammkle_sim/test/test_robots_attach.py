"""Attaching an ankle to a robot that is not ours: one call, its own units, joints and actuators left as they were."""

from __future__ import annotations

import numpy as np
import pytest

from jammkle_common.names import ACHILLES, CHANNELS
from jammkle_common.parameters import ParameterError
from jammkle_sim.physics.ankle import AnkleParameters
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.rigs.simulation import Simulation
from jammkle_sim.robots.options import ImuPlace
from jammkle_sim.robots.robot import AnkleFitting, attach_ankle, robot_of

BIPED = """
<mujoco model="biped">
  <compiler angle="degree"/>
  <option timestep="0.0005" integrator="implicitfast"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <body name="pelvis" pos="0 0 .4">
      <joint name="lift" type="slide" axis="0 0 1"/>
      <geom type="box" size=".1 .1 .05" mass="2" contype="0" conaffinity="0"/>
      <body name="left_shank" pos="0 .1 0">
        <joint name="left_knee" axis="0 1 0" range="-30 60" stiffness="50" damping="1"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02" mass=".5" contype="0" conaffinity="0"/>
      </body>
      <body name="right_shank" pos="0 -.1 0">
        <joint name="right_knee" axis="0 1 0" range="-30 60" stiffness="50" damping="1"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02" mass=".5" contype="0" conaffinity="0"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="left_motor" joint="left_knee"/></actuator>
</mujoco>
"""
"""Written for this test: hinges in degrees, a motor of its own before the ankles'."""
ANKLE_KG = 0.352


def biped() -> object:
    return mujoco.MjSpec.from_string(BIPED)


def test_two_calls_make_a_biped_stand_on_ankles_that_jam() -> None:
    """Its own joints keep their range, each ankle adds what it weighs, and each jams by itself."""
    spec = biped()
    bare_kg = spec.compile().body_mass.sum()
    ankles = [
        attach_ankle(spec, f"{side}_shank", f"{side}_ankle", position_m=(0.0, 0.0, -0.3)) for side in ("left", "right")
    ]
    robot = robot_of(spec, ankles)
    assert robot.model.body_mass.sum() == pytest.approx(bare_kg + 2 * ANKLE_KG)
    assert robot.model.joint("left_knee").range == pytest.approx(np.radians([-30.0, 60.0]))
    simulation = Simulation(robot)
    simulation.ankles["left_ankle"].hold_vacuum(dict.fromkeys(CHANNELS, 50e3))
    simulation.data.ctrl[robot.model.actuator("left_motor").id] = 0.1  # the user's own actuator is the user's
    *_, last = simulation.samples(1.5, 100)
    left, right = last.ankles["left_ankle"], last.ankles["right_ankle"]
    assert left.channel_pressures_pa[ACHILLES] == pytest.approx(51_325.0, abs=2e3)
    assert right.channel_pressures_pa[ACHILLES] == pytest.approx(101_325.0, abs=1e3)
    weight_n = 9.81 * robot.model.body_mass.sum()
    assert left.foot.normal_force_n + right.foot.normal_force_n == pytest.approx(weight_n, rel=0.02)
    assert simulation.data.ctrl[robot.model.actuator("left_motor").id] == 0.1


@pytest.mark.parametrize("hang_pitch_rad", [0.0, 0.52])
def test_a_foot_hangs_as_its_tendons_hold_it_and_a_load_presses_it_flat(hang_pitch_rad: float) -> None:
    """In the air at its pitch; a flat foot lands flat, one that hangs lands on its toe, and gives."""
    spec = biped()
    fitting = AnkleFitting(AnkleParameters(hang_pitch_rad=hang_pitch_rad))
    ankles = [
        attach_ankle(spec, f"{side}_shank", f"{side}_ankle", position_m=(0.0, 0.0, -0.3), fitting=fitting)
        for side in ("left", "right")
    ]
    robot = robot_of(spec, ankles)
    assert robot.model.neq == 0
    samples = list(Simulation(robot).samples(1.0, 1000))
    pitches_rad = [sample.ankles["left_ankle"].positions["ankle_pitch"] for sample in samples]
    falls = [sample.ankles["left_ankle"].foot.normal_force_n == 0.0 for sample in samples].index(False)
    assert pitches_rad[: falls - 1] == pytest.approx([hang_pitch_rad] * (falls - 1), abs=0.01)
    turned_rad = hang_pitch_rad - min(pitches_rad)
    assert turned_rad < 0.035 if hang_pitch_rad == 0.0 else turned_rad > 0.3
    assert 0.0 <= pitches_rad[-1] + 1e-3 <= hang_pitch_rad + 0.01


@pytest.mark.parametrize("compiler", ['settotalmass="30"', 'settotalmass="30" fusestatic="true"', 'boundmass="0.5"'])
@pytest.mark.filterwarnings("ignore:compiler attribute 'settotalmass'")
def test_foot_and_robot_weigh_what_they_do_whatever_the_compiler_is_told(compiler: str) -> None:
    """A total mass is the robot's without its ankles; a joint of its own has no fused body."""
    text = BIPED.replace("<compiler ", f"<compiler {compiler} ", 1)
    assert text != BIPED
    bare_kg = mujoco.MjSpec.from_string(text).compile().body_mass.sum()
    spec = mujoco.MjSpec.from_string(text)
    ankles = [attach_ankle(spec, f"{side}_shank", f"{side}_ankle") for side in ("left", "right")]
    model = robot_of(spec, ankles).model
    for ankle in ankles:
        assert model.body(ankle.foot).mass[0] == pytest.approx(ankle.parameters.foot_mass_kg)
    assert model.body_mass.sum() == pytest.approx(bare_kg + 2 * ANKLE_KG)


@pytest.mark.parametrize("place", list(ImuPlace))
def test_the_imu_is_where_it_was_asked_for(place: ImuPlace) -> None:
    """The site of the IMU moves with foot, shank or body."""
    spec = biped()
    fitting = AnkleFitting(imu=place, imu_body="pelvis")
    ankle = attach_ankle(spec, "left_shank", "a", position_m=(0.0, 0.0, -0.3), fitting=fitting)
    model = spec.compile()
    body = model.body(model.site("a/imu").bodyid[0]).name
    assert body == {ImuPlace.FOOT: ankle.foot, ImuPlace.SHANK: "a/mount", ImuPlace.BODY: "pelvis"}[place]


def test_what_cannot_be_attached_is_refused_in_one_line() -> None:
    """The error names what is wrong and what there is."""
    spec = biped()
    with pytest.raises(ParameterError, match=r"no body 'shin'; its bodies are: .*left_shank"):
        attach_ankle(spec, "shin", "a")
    ankle = attach_ankle(spec, "left_shank", "a")
    with pytest.raises(ParameterError, match="'a' is attached already"):
        attach_ankle(spec, "right_shank", "a")
    spec.option.timestep = 0.002
    with pytest.raises(ParameterError, match=r"timestep is 0.002 s; it must be 0.001 s or less"):
        robot_of(spec, [ankle])
    spec.option.timestep = 0.0005
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    with pytest.raises(ParameterError, match="RK4"):
        robot_of(spec, [ankle])
