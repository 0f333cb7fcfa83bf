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
    (tmp_path / "slip.yaml").write_text("slip_friction: 0.2\nimu: body\n")
    words = f"robot leg --behaviour slip --slope-deg 25 --duration-s 1.4 --params {tmp_path}/slip.yaml -o {bag}"
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


def test_a_blow_that_the_imu_cannot_read_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As a rig does it, for the figure of the IMU is too small then; a low fall says nothing."""
    for height_mm, clipped in (("300", ["the IMU at 80.83 m/s^2 with gravity"]), ("20", [])):
        words = f"robot leg --behaviour drop --drop-height-mm {height_mm} --duration-s 2 -o {tmp_path / height_mm}"
        assert main([*words.split(), "--json", str(tmp_path / "drop.json")]) == 0
        assert json.loads((tmp_path / "drop.json").read_text())["ankles"]["ankle"]["clipped"] == clipped
        assert ("clipped at ankle" in capsys.readouterr().out) == bool(clipped)


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
        (
            "robot leg --roughness-mm 10 -o {bag}",
            "--roughness-mm 10 is no option: write 'roughness_mm: 10' into a file",
        ),
        ("robot leg --duration-s 0 -o {bag}", "--duration-s is 0; it must be 0.1 to 3600 s"),
        ("robot leg --vacuum-kpa 90 -o {bag}", "--vacuum-kpa is 90; it must be 0 to 75 kPa"),
        ("robot leg --behaviour hop -o {bag}", "--behaviour is 'hop'; it must be one of stand, walk, drop, hang, slip"),
    ],
)
def test_bad_input_gets_one_line(words: str, line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 2, value and limit, and no bag."""
    bag = tmp_path / "bag"
    assert main(words.format(bag=bag).split()) == 2
    assert line in capsys.readouterr().err
    assert not bag.exists()


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("roughness_mm: 100", "roughness_mm is 100; it must be 0 to 40 mm"),
        ("imu_rate_hz: 300", "imu_rate_hz is 300; it must be one of 100, 200, 500, 1000 Hz"),
        ("timestep_s: 0.0003", "timestep_s 0.0003: a rate of 500 Hz does not fit a time step of 0.0003 s"),
        ("rig: leg", "rig is 'leg', which does not exist; there are tensile,"),
        (
            "robot: quadruped",
            "is the run sheet of robot quadruped, and this is robot leg; run `jammkle robot quadruped",
        ),
        ("rig: drop", "is the run sheet of rig drop, and this is robot leg; run `jammkle rig drop"),
    ],
)
def test_bad_files_get_one_line(text: str, line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With the file, the value and the way out; and no bag."""
    file, bag = tmp_path / "robot.yaml", tmp_path / "bag"
    file.write_text(text)
    assert main(["robot", "leg", "--params", str(file), "-o", str(bag)]) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert said.startswith(f"jammkle: --params {file}")
    assert line in said
    assert not bag.exists()


def test_a_run_is_repeated_from_its_bag(tmp_path: Path) -> None:
    """How long, at which vacuum and rate is in the bag as well: the same options give the same figures."""
    (tmp_path / "rough.yaml").write_text("roughness_mm: 10\nimu_rate_hz: 200\nvacuum_kpa: 50\nduration_s: 9\n")
    words = {"first": ["--params", str(tmp_path / "rough.yaml"), "--duration-s", "0.6"]}
    words["again"] = ["--params", str(tmp_path / "first")]
    found = []
    for name, given in words.items():
        assert main(["robot", "leg", *given, "-o", str(tmp_path / name), "--json", str(tmp_path / "run.json")]) == 0
        found.append({**json.loads((tmp_path / "run.json").read_text()), "bag": ""})
    assert found[0] == found[1]
    options = found[0]["options"]
    assert (options["duration_s"], options["vacuum_pa"], options["imu_rate_hz"]) == (0.6, 50e3, 200)
    assert options["roughness_m"] == 0.01
