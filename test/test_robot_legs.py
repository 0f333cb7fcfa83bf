"""What the controller reads of a leg in the description of a simulated robot is what the robot was built from."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_common.command.main import main
from jammkle_controller.core.events import ContactKind
from jammkle_controller.core.leg import leg_of
from jammkle_controller.parameters import ControllerParameters
from jammkle_controller.recordings import read_bag, replay
from jammkle_sim.physics.ankle import AnkleParameters
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.robots.catalogue import robot
from jammkle_sim.robots.limb import LimbParameters, stance_back_m
from jammkle_sim.robots.options import RobotOptions
from jammkle_sim.robots.quadruped import CORNERS, QuadrupedParameters
from jammkle_sim.robots.urdf import robot_urdf

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize(("kind", "ankle"), [("leg", "ankle"), *(("quadruped", corner.ankle) for corner in CORNERS)])
def test_the_leg_is_that_of_the_model(kind: str, ankle: str) -> None:
    """Lengths, masses, sole and place are the figures of limb and body; the centre is that of MuJoCo."""
    made, limb, foot = robot(kind, RobotOptions()), LimbParameters(), AnkleParameters()
    hanging = replace(foot, hang_pitch_rad=math.radians(RobotOptions().hang_pitch_deg))
    prefix = ankle.removesuffix("ankle")
    leg = leg_of(robot_urdf(made), ControllerParameters(joint_prefix=prefix))
    assert (leg.thigh_m, leg.shank_m, leg.thigh_kg) == pytest.approx((limb.thigh_m, limb.shank_m, limb.thigh_kg))
    assert leg.shank_kg == pytest.approx(limb.shank_kg + foot.mass_kg)
    assert leg.lean_rad == pytest.approx(limb.lean_rad(stance_back_m(hanging)))
    sole = (foot.toe_m, foot.heel_m, foot.half_width_m, foot.sole_m)
    assert (leg.toe_m, leg.heel_m, leg.half_width_m, leg.sole_m) == pytest.approx(sole)
    assert ControllerParameters().armature_kg_m2 == limb.armature_kg_m2
    corner = next((each for each in CORNERS if each.ankle == ankle), None)
    if corner is not None:
        body = QuadrupedParameters()
        assert leg.abduction == "abduction"
        assert leg.hip_m == pytest.approx((corner.forward * body.forward_m, corner.left * body.left_m, 0.0))
        assert leg.offset_m == pytest.approx(corner.left * body.offset_m)
    else:
        assert (leg.abduction, leg.hip_m, leg.offset_m) == ("", pytest.approx((0.0, 0.0, 0.0)), 0.0)
    model, data = made.model, mujoco.MjData(made.model)
    data.joint(f"{ankle}/ankle_pitch").qpos[0] = 0.0  # as a description has it
    mujoco.mj_forward(model, data)
    shank = model.body(f"{prefix}shank").id
    way_m = data.xmat[shank].reshape(3, 3).T @ (data.subtree_com[shank] - data.xpos[shank])
    assert leg.shank_centre_m == pytest.approx(-way_m[2], abs=1e-6)
    assert np.abs(way_m[:2]).max() < 0.02  # the ankle leans: what the model of a rod leaves out


def test_a_walk_is_not_full_of_slips(tmp_path: Path) -> None:
    """On ground that grips, feet on giving ankles slide by millimetres as they step: no slip after the first steps."""
    walk = ["robot", "quadruped", "--behaviour", "walk", "--duration-s", "4"]
    assert main([*walk, "--vacuum-kpa", "20", "-o", str(tmp_path / "walk")]) == 0
    parameters = ControllerParameters(imu_mount="shank", hang_pitch_deg=RobotOptions().hang_pitch_deg)
    for corner in CORNERS:
        recording = read_bag(tmp_path / "walk", "", f"/{corner.ankle}", parameters)
        made = replay(recording.received, parameters, recording.leg)
        times_s = {kind: [each.time_ns * 1e-9 for each in made.events if each.kind is kind] for kind in ContactKind}
        assert len(times_s[ContactKind.LIFTOFF]) >= 4
        assert [each for each in times_s[ContactKind.SLIP] if each > times_s[ContactKind.LIFTOFF][1]] == []
