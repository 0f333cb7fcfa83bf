"""`jammkle robot`: a bag with the true contact of every foot, in namespaces as on the graph; bad input in one line."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from jammkle_common.command.main import main
from jammkle_common.names import GAIT_PHASE, IMU, PLANNED_CONTACT, QUADRUPED_ANKLES, TRUE_CONTACT
from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from pathlib import Path


def test_a_body_that_slips_has_its_sliding_in_the_bag(tmp_path: Path) -> None:
    """The IMU on the body feels friction alone while the truth slides; before, it feels gravity and the foot stands."""
    bag = tmp_path / "slip"
    words = f"robot leg --behaviour slip --slope-deg 25 --slip-friction 0.2 --imu body --duration-s 1.4 -o {bag}"
    assert main([*words.split(), "--json", str(tmp_path / "slip.json")]) == 0
    with AnyReader([bag]) as reader:
        assert {"/clock", "/sim_parameters"} <= set(reader.topics)
        assert not {f"/{PLANNED_CONTACT.name}", f"/{GAIT_PHASE.name}"} & set(reader.topics)  # it has no gait
        found = {name: [] for name in (f"/{IMU.name}", f"/{TRUE_CONTACT.name}")}
        for connection, _, raw in reader.messages():
            if connection.topic in found:
                found[connection.topic].append(reader.deserialize(raw, connection.msgtype))
    imus, truths = found.values()
    slope_rad = math.radians(25.0)
    along = [
        each.linear_acceleration.x * math.cos(slope_rad) + each.linear_acceleration.z * math.sin(slope_rad)
        for each in imus
    ]
    times_s = np.array([each.header.stamp.sec + 1e-9 * each.header.stamp.nanosec for each in imus])
    still, sliding = (times_s > 0.8) & (times_s < 1.0), times_s > 1.2
    assert np.mean(np.array(along)[still]) == pytest.approx(9.81 * math.sin(slope_rad), rel=0.05)
    assert np.mean(np.array(along)[sliding]) == pytest.approx(0.2 * 9.81 * math.cos(slope_rad), rel=0.05)
    assert truths[-1].sliding_distance_m > 0.15
    assert truths[-1].stands
    found = json.loads((tmp_path / "slip.json").read_text())
    assert found["ankles"]["ankle"]["results"]["sliding_distance_m"] == truths[-1].sliding_distance_m


def test_the_model_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    """MuJoCo loads it, with the joints of joint_states; two descriptions at a time are refused."""
    assert main(["robot", "leg", "--behaviour", "hang", "--mjcf"]) == 0
    model = mujoco.MjModel.from_xml_string(capsys.readouterr().out)
    assert {"hip", "knee", "ankle_pitch"} <= {model.joint(index).name for index in range(model.njnt)}
    assert main(["robot", "leg", "--mjcf", "--urdf"]) == 2
    assert "one at a time" in capsys.readouterr().err


def test_a_quadruped_has_a_namespace_for_each_ankle(tmp_path: Path) -> None:
    """Every ankle's topics below the robot's own, its gait's among them; one set of parameters for all."""
    bag = tmp_path / "trot"
    assert main(["robot", "quadruped", "--behaviour", "walk", "--duration-s", "0.7", "-o", str(bag)]) == 0
    with AnyReader([bag]) as reader:
        counts = {name: topic.msgcount for name, topic in reader.topics.items()}
    for ankle in QUADRUPED_ANKLES:
        assert counts[f"/{ankle}/{IMU.name}"] == counts[f"/{ankle}/{TRUE_CONTACT.name}"] == 350
        assert counts[f"/{ankle}/{PLANNED_CONTACT.name}"] == 70
        assert counts[f"/{ankle}/{GAIT_PHASE.name}"] == 21  # it stands for 0.5 s, and then walks
    assert counts["/sim_parameters"] == 1


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("robot hexapod -o {bag}", "ROBOT 'hexapod' does not exist; it must be leg or quadruped"),
        ("robot leg --slope-deg 60 -o {bag}", "--slope-deg is 60; it must be 0 to 40 deg"),
        ("robot leg --roughness-mm 100 -o {bag}", "--roughness-mm is 100; it must be 0 to 40 mm"),
        ("robot leg --imu-rate-hz 300 -o {bag}", "--imu-rate-hz 300 must be one of 100, 200, 500, 1000 Hz"),
        ("robot leg --vacuum-kpa 90 -o {bag}", "--vacuum-kpa 90 must be 0 to 75 kPa"),
        ("robot leg --behaviour hop -o {bag}", "--behaviour is 'hop'; it must be one of stand, walk, drop, hang, slip"),
    ],
)
def test_bad_input_gets_one_line(words: str, line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 2, value and limit, and no bag."""
    bag = tmp_path / "bag"
    assert main(words.format(bag=bag).split()) == 2
    assert line in capsys.readouterr().err
    assert not bag.exists()
