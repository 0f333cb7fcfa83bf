"""URDF made from the models: read back by MuJoCo it weighs, moves and is called as what it was made from."""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from jammkle_common.command.main import main
from jammkle_common.names import ANKLE_JOINTS, CHANNELS, FOOT_FRAME, IMU_FRAME, MANIFOLD_FRAME, QUADRUPED_ANKLES
from jammkle_common.parameters import ParameterError
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.robots.catalogue import ankle_alone, robot
from jammkle_sim.robots.options import ROBOTS, RobotOptions
from jammkle_sim.robots.robot import Robot, attach_ankle, robot_of
from jammkle_sim.robots.urdf import BETWEEN_SHARE, UrdfNames, robot_mjcf, robot_urdf

if TYPE_CHECKING:
    from pathlib import Path

FOOT_INERTIA_KG_M2 = 1.3e-4
"""Largest of the foot about its joint."""
LEG_JOINTS = {"leg": ("hip", "knee"), "quadruped": ("abduction", "hip", "knee"), "ankle": ()}


def own_robot() -> Robot:
    """A robot of somebody else: leaning mount, a slide, a turned inertia, a prefix of its own for the joint."""
    spec = mujoco.MjSpec.from_string(
        """<mujoco model="walker"><option timestep="0.0005"/><worldbody><body name="pelvis" pos="0 0 1"><freejoint/>
        <geom type="box" size=".1 .2 .05" mass="3" euler="20 30 40" pos=".1 0 0"/>
        <body name="shin" pos="0 .1 -.1" euler="10 -20 30">
        <joint name="lift" type="slide" axis="0 0.6 0.8" range="-.1 .1"/>
        <geom type="capsule" fromto="0 0 0 .1 0 -.3" size=".02" mass=".5"/></body></body></worldbody></mujoco>"""
    )
    return robot_of(spec, [attach_ankle(spec, "shin", "right_ankle", position_m=(0.1, 0.0, -0.3), pitch_rad=0.3)])


ROBOTS_MADE = {
    "ankle": ankle_alone,
    "leg": lambda: robot("leg", RobotOptions(payload_kg=0.5, imu="body")),
    "quadruped": lambda: robot("quadruped", RobotOptions()),
    "walker": own_robot,
}


@pytest.fixture(params=ROBOTS_MADE)
def made(request: pytest.FixtureRequest) -> Robot:
    return ROBOTS_MADE[request.param]()


def loaded(text: str) -> object:
    """The model that MuJoCo reads, with every link as a body of its own."""
    spec = mujoco.MjSpec.from_string(text)
    spec.compiler.fusestatic = False
    return spec.compile()


def test_mjcf_is_the_model(made: Robot) -> None:
    """Masses, drives and start of what is simulated, and joints called as in joint_states."""
    names, model, found = UrdfNames(made), made.model, mujoco.MjModel.from_xml_string(robot_mjcf(made))
    for field in ("body_mass", "body_inertia", "dof_armature", "actuator_gainprm", "actuator_biasprm", "qpos0"):
        assert getattr(found, field) == pytest.approx(getattr(model, field), rel=1e-5, abs=1e-6), field
    for index in range(model.njnt):
        assert found.joint(index).name == names.joint(model.joint(index).name)


def moments(model: object, data: object, bodies: list[int]) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre of mass and inertia about it of some bodies together, in the world, by Steiner's theorem."""
    mass_kg = sum(model.body_mass[body] for body in bodies)
    centre_m = sum(model.body_mass[body] * data.xipos[body] for body in bodies) / mass_kg
    inertia = np.zeros((3, 3))
    for body in bodies:
        turn, way_m = data.ximat[body].reshape(3, 3), data.xipos[body] - centre_m
        inertia += turn @ np.diag(model.body_inertia[body]) @ turn.T
        inertia += model.body_mass[body] * (way_m @ way_m * np.eye(3) - np.outer(way_m, way_m))
    return float(mass_kg), centre_m, inertia


def test_every_link_weighs_what_its_body_does(made: Robot) -> None:
    """Mass, centre and inertia of each body, and of all that hangs on it, are those of the links that stand for it."""
    names, model, found = UrdfNames(made), made.model, loaded(robot_urdf(made))
    data, read = mujoco.MjData(model), mujoco.MjData(found)
    for ankle in made.ankles:  # which starts as it hangs
        data.joint(ankle.named("ankle_pitch")).qpos[0] = 0.0
    mujoco.mj_forward(model, data)
    mujoco.mj_forward(found, read)
    root = int(model.body_rootid[model.body(made.base).id])
    # the world of the URDF is where its root is: bring the model there
    offset_m, turn = data.xpos[root].copy(), data.xmat[root].reshape(3, 3).copy()
    of_link = {found.body(index).name: index for index in range(1, found.nbody)}
    for body in range(root, model.nbody):
        link = names.link(model.body(body).name)
        parts = [of_link[link], *(of_link.get(f"{link}_{word}", -1) for word in ("pitch", "roll"))]
        below = [index for index in range(model.nbody) if body in ancestors(model, index)]
        below_link = [index for index in range(found.nbody) if set(parts) & set(ancestors(found, index))]
        alone = [([body], [index for index in parts if index >= 0])] if model.body_mass[body] else []
        for ours, theirs in (*alone, (below, below_link)):
            mass_kg, centre_m, inertia = moments(model, data, ours)
            mass_read_kg, centre_read_m, inertia_read = moments(found, read, theirs)
            assert mass_read_kg == pytest.approx(mass_kg, rel=1e-6)
            assert centre_read_m == pytest.approx(turn.T @ (centre_m - offset_m), abs=1e-7)
            assert inertia_read == pytest.approx(turn.T @ inertia @ turn, rel=1e-5, abs=1e-9)


def ancestors(model: object, body: int) -> list[int]:
    """A body and all that it hangs on."""
    chain = [body]
    while chain[-1]:
        chain.append(int(model.body_parentid[chain[-1]]))
    return chain


def test_every_joint_moves_what_it_moves_in_the_model(made: Robot) -> None:
    """With the same random angles every link is where its body is, and the joints feel the same inertia."""
    names, model, found = UrdfNames(made), made.model, loaded(robot_urdf(made))
    data, read = mujoco.MjData(model), mujoco.MjData(found)
    random = np.random.default_rng(5)
    pairs = []
    for index in range(found.njnt):
        name = found.joint(index).name
        ours = next(model.joint(each) for each in range(model.njnt) if names.joint(model.joint(each).name) == name)
        theirs = found.joint(index)
        assert theirs.range == pytest.approx(ours.range)
        assert theirs.damping == pytest.approx(ours.damping)
        data.qpos[ours.qposadr] = read.qpos[theirs.qposadr] = random.uniform(*ours.range) / 2.0
        pairs.append((int(ours.dofadr[0]), int(theirs.dofadr[0])))
    mujoco.mj_forward(model, data)
    mujoco.mj_forward(found, read)
    root = int(model.body_rootid[model.body(made.base).id])
    offset_m, turn = data.xpos[root], data.xmat[root].reshape(3, 3)
    for body in range(root, model.nbody):
        link = names.link(model.body(body).name)
        assert read.body(link).xpos == pytest.approx(turn.T @ (data.xpos[body] - offset_m), abs=1e-8)
        assert read.body(link).xmat.reshape(3, 3) == pytest.approx(turn.T @ data.xmat[body].reshape(3, 3), abs=1e-8)
    ours, theirs = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
    whole, whole_read = np.zeros((model.nv, model.nv)), np.zeros((found.nv, found.nv))
    mujoco.mj_fullM(model, data, whole)
    mujoco.mj_fullM(found, read, whole_read)
    without_motors = whole - np.diag(model.dof_armature)
    expected = without_motors[np.ix_(ours, ours)]
    # of a foot two shares turn with its first or first two hinges alone
    lost = 3.0 * BETWEEN_SHARE
    assert whole_read[np.ix_(theirs, theirs)] == pytest.approx(expected, rel=lost, abs=lost * FOOT_INERTIA_KG_M2)


@pytest.mark.parametrize("kind", ["ankle", *ROBOTS])
def test_names_are_those_on_the_graph(kind: str) -> None:
    """Every frame of a message is a link; joints are called as joint_states has them, of several legs by leg."""
    tree = ET.fromstring(robot_urdf(ROBOTS_MADE[kind](), "/stage"))  # noqa: S314 - our own text
    links = {link.attrib["name"] for link in tree.iter("link")}
    ankles = QUADRUPED_ANKLES if kind == "quadruped" else ("",)
    frames = (FOOT_FRAME, IMU_FRAME, MANIFOLD_FRAME, *CHANNELS)
    assert {"/".join(part for part in ("stage", ankle, name) if part) for ankle in ankles for name in frames} <= links
    moving = {joint.attrib["name"] for joint in tree.findall("joint") if joint.attrib["type"] != "fixed"}
    own = (*ANKLE_JOINTS, *LEG_JOINTS[kind])
    if kind == "quadruped":
        own = tuple(f"{leg}_{joint}" for leg in ("lf", "rf", "lh", "rh") for joint in own)
    assert moving == set(own)
    controlled = {joint.attrib["name"] for joint in tree.iterfind("ros2_control/joint")}
    assert controlled == moving
    channels = {gpio.attrib["name"] for gpio in tree.iterfind("ros2_control/gpio")}
    assert channels == {"_".join(part for part in (ankle, channel) if part) for ankle in ankles for channel in CHANNELS}
    topic = tree.findtext("ros2_control/hardware/param[@name='joint_states_topic']")
    assert topic == "/stage/joint_states"


def test_what_urdf_has_no_word_for_is_refused() -> None:
    """A ball joint inside the robot ends in one line, not in a robot that cannot move."""
    spec = mujoco.MjSpec.from_string(
        """<mujoco><option timestep="0.0005"/><worldbody><body name="hip"><geom size=".1" mass="1"/><body name="shank">
        <joint name="socket" type="ball"/><geom size=".1" mass="1"/></body></body></worldbody></mujoco>"""
    )
    made = robot_of(spec, [attach_ankle(spec, "shank", "ankle")])
    with pytest.raises(ParameterError, match="joint 'socket' has no counterpart in URDF"):
        robot_urdf(made)


def test_the_command_prints_what_was_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing but the URDF goes to the screen; what does not exist or does not fit is refused in a line."""
    files = {"laden.yaml": "payload_kg: 1", "overladen.yaml": "payload_kg: 9", "body.yaml": "imu: body"}
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    assert main(["robot", "leg", "--urdf", "--params", str(tmp_path / "laden.yaml")]) == 0
    assert loaded(capsys.readouterr().out).body_mass.sum() == pytest.approx(1.8 + 1.0)
    assert main(["robot", "ankle", "--urdf", "--namespace", "lf_ankle"]) == 0
    printed = capsys.readouterr().out
    assert loaded(printed).body_mass.sum() == pytest.approx(0.352)
    assert 'link name="lf_ankle/foot"' in printed
    for words, why in (
        ("robot biped --urdf", "ROBOT 'biped' does not exist; it must be ankle, leg, quadruped"),
        (
            f"robot leg --urdf --params {tmp_path}/overladen.yaml",
            "overladen.yaml: payload_kg is 9; it must be 0 to 4 kg",
        ),
        (f"robot ankle --urdf --params {tmp_path}/body.yaml", "body.yaml: imu body needs ROBOT leg or quadruped"),
    ):
        assert main(words.split()) == 2
        assert why in capsys.readouterr().err
