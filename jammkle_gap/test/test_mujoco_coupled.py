"""Joints that nobody measured and that equalities couple to measured ones: mimic joints and closed chains."""

from __future__ import annotations

from typing import TYPE_CHECKING

import mujoco
import numpy as np
import pytest

from jammkle_gap import run_of_arrays
from jammkle_gap.mujoco.coupled import Equalities
from jammkle_gap.mujoco.diagnosing import matched
from jammkle_gap.mujoco.simulator import RobotSimulator
from jammkle_gap.mujoco.windows import recordings_of

if TYPE_CHECKING:
    from pathlib import Path

    from jammkle_gap import Run

_GRIPPER = """
<mujoco model="gripper">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="left" pos="0.05 0 0"><joint name="left" axis="0 1 0" damping="0.02" armature="0.002"/>
      <geom type="capsule" fromto="0 0 0 0.1 0 -0.1" size="0.01" mass="0.2"/></body>
    <body name="right" pos="-0.05 0 0"><joint name="right" axis="0 1 0" damping="0.02"/>
      <geom type="capsule" fromto="0 0 0 -0.1 0 -0.2" size="0.01" mass="0.5"/></body>
  </worldbody>
  <equality><joint joint1="right" joint2="left" polycoef="0 -1.5 0.2 0 0"/></equality>
  <actuator><position name="left" joint="left" kp="30" kv="0.6"/></actuator>
</mujoco>"""

_FOUR_BAR = """
<mujoco model="four bar">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="crank"><joint name="crank" axis="0 1 0" damping="0.02" armature="0.002"/>
      <geom type="capsule" fromto="0 0 0 0 0 0.1" size="0.01" mass="0.2"/>
      <body name="coupler" pos="0 0 0.1"><joint axis="0 1 0" damping="0.005"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0.1" size="0.01" mass="0.4"/></body></body>
    <body name="rocker" pos="0.3 0 0"><joint type="ball" damping="0.005"/>
      <geom type="capsule" fromto="0 0 0 0 0 0.2" size="0.01" mass="0.6"/></body>
  </worldbody>
  <equality><connect body1="coupler" body2="rocker" anchor="0.3 0 0.1"/></equality>
  <actuator><position name="crank" joint="crank" kp="30" kv="0.6"/></actuator>
</mujoco>"""

_MODELS = {"mimic": (_GRIPPER, "left"), "chain": (_FOUR_BAR, "crank")}


def _recorded(file: Path, joint: str, *, commands: bool) -> Run:
    """Return 4 s of a robot that is as its model says, with noise, commanded and read at every step of it."""
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    random = np.random.default_rng(4)
    at, dof = int(model.joint(joint).qposadr[0]), int(model.joint(joint).dofadr[0])
    time_s, rows = 0.002 * np.arange(2000), []
    asked = 0.5 * np.sin(4.0 * time_s) * np.minimum(time_s, 1.0)
    for command in asked:
        effort = float(data.qfrc_actuator[dof])
        rows.append((data.qpos[at] + random.normal(0.0, 1e-4), effort + random.normal(0.0, 2e-3)))
        data.ctrl[0] = command
        mujoco.mj_step(model, data)
    table = np.array(rows)
    given = {f"{joint}.position": asked} if commands else {}
    return run_of_arrays("run", time_s, {f"{joint}.position": table[:, 0], f"{joint}.effort": table[:, 1]}, given)


def test_chain_that_closes_in_two_ways_keeps_to_its_ranges() -> None:
    """A parallelogram that is stretched in the model's own pose closes as the range of its rocker lets it."""
    stretched = """
    <mujoco><compiler angle="radian" autolimits="true"/><worldbody>
      <body name="crank"><joint name="crank" axis="0 1 0"/><geom size="0.02" mass="0.2"/>
        <body name="rod" pos="0.1 0 0"><joint name="rod" axis="0 1 0"/><geom size="0.02" mass="0.2"/></body></body>
      <body name="rocker" pos="0.3 0 0"><joint name="rocker" axis="0 1 0" range="RANGE"/>
        <geom size="0.02" mass="0.2"/></body></worldbody>
      <equality><connect body1="rod" body2="rocker" anchor="0.3 0 0"/></equality></mujoco>"""
    for limits, side in (("-2.5 -0.2", -1.0), ("0.2 2.5", 1.0)):
        model = mujoco.MjModel.from_xml_string(stretched.replace("RANGE", limits))
        equalities = Equalities(model, [1, 2])
        pose = model.qpos0.copy()
        pose[0] = side * 1.2
        found = equalities.placed(pose)
        assert found[2] == pytest.approx(side * 1.2, abs=1e-6)
        assert np.abs(equalities.rows(found)[1]).max() < 1e-6


@pytest.mark.parametrize("kind", list(_MODELS))
@pytest.mark.parametrize("commands", [True, False], ids=["forward", "backward"])
def test_coupled_joints_follow_and_load_the_measured_one(tmp_path: Path, kind: str, *, commands: bool) -> None:
    """Angles and efforts are those of the whole mechanism, run forward or backward, from a measured state."""
    text, joint = _MODELS[kind]
    file = tmp_path / "robot.xml"
    file.write_text(text)
    run = _recorded(file, joint, commands=commands)
    runs, robot = matched(file, [run])
    assert len(robot.followers) == {"mimic": 1, "chain": 2}[kind]
    assert robot.locked == ()
    assert any("equalities say where they are" in note for note in robot.notes)
    compared, kept = recordings_of(robot, runs, 1.0, 2.0)
    simulator = RobotSimulator(robot, {})
    for recording in (*compared, *kept):
        made = simulator(recording, {})
        for signal in recording.signals:
            left = np.sqrt(np.square(signal.values - made[signal.name]).mean())
            assert left < 0.05 * np.std(signal.values)
