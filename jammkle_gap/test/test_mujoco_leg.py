"""Hip and knee of our leg, from the same exercise as its ankle, with the model that the command prints."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_gap import Verdict, diagnose_mujoco
from jammkle_gap.mujoco.diagnosing import matched
from jammkle_gap.mujoco.runs import BadRobotError, Quantity, Run, Sense, Track
from jammkle_sim.rigs.simulation import Simulation
from jammkle_sim.robots.catalogue import robot as robot_of_ours
from jammkle_sim.robots.options import RobotOptions
from jammkle_sim.robots.robot import FollowingControl, JointCourse
from jammkle_sim.robots.urdf import robot_mjcf

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from jammkle_sim.physics.engine import mujoco

    Change = Callable[[mujoco.MjModel], None]

JOINTS = ("hip", "knee")
FEW = ("friction_hip", "friction_knee", "damping_knee")
"""Effects on offer where the whole library would only take time."""
HANGING = RobotOptions(behaviour="hang")


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write the model of the leg as it hangs."""
    file = tmp_path_factory.mktemp("leg") / "leg.xml"
    file.write_text(robot_mjcf(robot_of_ours("leg", HANGING)))
    return file


def shaken(change: Change | None = None, kind: str = "leg") -> Run:
    """Rock the shanks of a robot that hangs, and jam its ankles halfway; commands and joint states at 100 Hz."""
    built = robot_of_ours(kind, HANGING)
    if change is not None:
        change(built.model)
    simulation = Simulation(replace(built, control=FollowingControl(built.model, built.control)))
    ankles = {name.removesuffix("ankle"): ankle for name, ankle in simulation.ankles.items()}
    own = ("abduction", "hip", "knee") if kind == "quadruped" else JOINTS

    def read() -> dict[tuple[str, Quantity], float]:
        found = {}
        for leg, ankle in ankles.items():
            efforts = ankle.joint_efforts() or {}
            found |= {(leg + name, Quantity.POSITION): value for name, value in ankle.joint_positions().items()}
            found |= {(leg + name, Quantity.EFFORT): efforts[name] for name in own}
        return found

    joints = tuple(leg + name for leg in ankles for name in own)
    time_s = 0.02 * np.arange(1, 210)
    swing = 0.2 * np.minimum(time_s, 1.0) * np.sin(2.0 * np.pi * (0.5 * time_s + 0.4 * time_s**2))
    read_s, rows = 0.01 * np.arange(420), []
    start = np.array([read()[name, Quantity.POSITION] for name in joints])
    asked = start + np.column_stack([swing if name.endswith("knee") else 0.0 * swing for name in joints])
    simulation.machine.control.follow(JointCourse(joints, time_s, asked))
    for at_s in read_s.tolist():
        if at_s == 2.0:
            for ankle in ankles.values():
                ankle.hold_vacuum({"achilles": 40e3, "peroneal_left": 40e3, "peroneal_right": 40e3})
        rows.append(read())
        simulation.advance(20)
    measured = {key: Track(read_s, np.array([row[key] for row in rows])) for key in rows[0]}
    whole_s, way = np.append(0.0, time_s), np.vstack([start, asked])
    commands = {(name, Quantity.POSITION): Track(whole_s, way[:, k]) for k, name in enumerate(joints)}
    return Run("shake", measured, commands)


def rubbing(model: mujoco.MjModel) -> None:
    model.dof_frictionloss[model.joint("knee").dofadr[0]] = 0.3


def test_ankle_moves_as_measured(model: Path) -> None:
    """Tendons that nobody commands leave the ankle to what was measured; hip and knee are compared."""
    _, robot = matched(model, [shaken()])
    assert robot.joints == JOINTS
    assert set(robot.prescribed) == {"ankle_pitch", "ankle_roll", "ankle_yaw"}
    assert [each.joint for each in robot.drives] == [*JOINTS]
    assert not robot.locked  # the model itself holds the slides of the base


def test_imu_may_be_left_out(model: Path) -> None:
    """Readings at a site are compared, unless the map says none: the model knows no filter of an IMU."""
    run = shaken()
    still = Track(np.array([0.0, 4.0]), np.zeros(2))
    sensed = replace(run, sensed={("ankle/imu", Sense.RATE): (still, still, still)})
    assert matched(model, [sensed])[1].senses
    assert not matched(model, [sensed], {"sensors": "none"})[1].senses


@pytest.mark.slow
def test_friction_of_the_knee_is_named(model: Path, tmp_path: Path) -> None:
    """From the exercise that diagnoses the ankle, with its size; a healthy leg has none."""
    found = diagnose_mujoco(model, [shaken(rubbing)], only=FEW, folder=tmp_path, jobs=1)
    assert found.diagnosis.verdict is Verdict.EFFECTS
    assert [each.name for each in found.diagnosis.effects] == ["friction_knee"]
    assert found.corrected.values["friction_knee.torque"] == pytest.approx(0.3, abs=0.02)
    healthy = diagnose_mujoco(model, [shaken()], only=FEW, folder=tmp_path, jobs=1)
    assert healthy.diagnosis.verdict is Verdict.NO_GAP


@pytest.mark.slow
def test_friction_of_one_knee_of_four_is_named(tmp_path: Path) -> None:
    """A quadruped that hangs is diagnosed in the same way, beside its four ankles."""
    file = tmp_path / "quadruped.xml"
    file.write_text(robot_mjcf(robot_of_ours("quadruped", HANGING)))

    def rub(model: mujoco.MjModel) -> None:
        model.dof_frictionloss[model.joint("rf_knee").dofadr[0]] = 0.3

    found = diagnose_mujoco(file, [shaken(rub, "quadruped")], folder=tmp_path, jobs=2)
    assert found.diagnosis.verdict is Verdict.EFFECTS
    assert [each.name for each in found.diagnosis.effects] == ["friction_rf_knee"]
    assert found.corrected.values["friction_rf_knee.torque"] == pytest.approx(0.3, abs=0.03)


def test_leg_without_commands_is_refused(model: Path) -> None:
    """One line that says what to record."""
    run = shaken()
    positions = {key: track for key, track in run.measured.items() if key[1] is Quantity.POSITION}
    with pytest.raises(BadRobotError, match="record the topic of the commands") as error:
        matched(model, [replace(run, measured=positions, commands={})])
    assert "\n" not in str(error.value)
