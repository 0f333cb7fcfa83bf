"""Any robot: from bags and a model to a name, a page and a corrected model."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import robot_arm

from jammkle_common.command.main import main
from jammkle_gap import BadRecordingError, Verdict, diagnose_mujoco
from jammkle_gap.mujoco import diagnosing
from jammkle_gap.mujoco.diagnosing import matched
from jammkle_gap.mujoco.library import robot_library
from jammkle_gap.mujoco.runs import BadRobotError
from jammkle_gap.mujoco.screening import promising
from jammkle_gap.mujoco.simulator import RobotSimulator, run
from jammkle_gap.mujoco.windows import recordings_of
from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from collections.abc import Callable

    Recorded = Callable[[robot_arm.Samples], robot_arm.Samples]

EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "examples"
FEW = ("friction_elbow", "damping_elbow", "payload")
"""Effects on offer where the whole library would only take time."""


def rubbing(model: mujoco.MjModel) -> None:
    model.dof_frictionloss[2] += 0.8


def test_command_names_the_friction_and_corrects_the_model(tmp_path: Path) -> None:
    """The verdict is the elbow's friction; page and JSON are written; the corrected model has it and closes the gap."""
    model = robot_arm.write_model(tmp_path)
    *bags, last = [str(robot_arm.write_bag(tmp_path / f"bag{k}", robot_arm.samples(k, rubbing, 3.0))) for k in range(3)]
    out, file = tmp_path / "out", tmp_path / "gap.json"
    offered = [part for name in FEW for part in ("--only", name)]
    asked = ["gap", "diagnose", "--model", str(model), *bags, "--held-out", last, *offered]
    assert main([*asked, "-o", str(out), "--json", str(file)]) == 0
    found = json.loads(file.read_text())
    assert [each["name"] for each in found["effects"]][:1] == ["friction_elbow"]
    assert found["corrected"]["values"]["friction_elbow.torque"] == pytest.approx(0.8, abs=0.08)
    assert "joint elbow" in (out / "gap.html").read_text().lower()
    corrected = mujoco.MjModel.from_xml_path(str(out / "corrected.xml"))
    assert float(corrected.dof_frictionloss[2]) == pytest.approx(0.8, abs=0.08)
    elbow = next(each for each in found["corrected"]["closing"] if each["signal"] == "elbow/position")
    assert elbow["corrected"] < 0.2 * elbow["nominal"]
    assert any("in recordings that were held out" in note for note in found["notes"])


@pytest.mark.slow
def test_what_closes_too_little_of_recordings_that_are_held_out_is_not_certain(tmp_path: Path) -> None:
    """The elbow rubs in all of them, but where nothing is fitted the shoulder rubs far more."""

    def rubbing_twice(model: mujoco.MjModel) -> None:
        rubbing(model)
        model.dof_frictionloss[1] += 4.0

    model = robot_arm.write_model(tmp_path)
    fitted = [robot_arm.write_csv(tmp_path / f"run{k}.csv", robot_arm.samples(k, rubbing, 3.0)) for k in range(2)]
    other = robot_arm.write_csv(tmp_path / "other.csv", robot_arm.samples(2, rubbing_twice, 3.0))
    found = diagnose_mujoco(model, fitted, held_out=[other], only=FEW, folder=tmp_path / "out", jobs=1).diagnosis
    assert found.verdict is Verdict.AMBIGUOUS
    assert [each.names for each in found.candidates][:2] == [("friction_elbow",), ()]
    assert found.candidates[0].probability == found.candidates[1].probability
    assert sum(found.posterior.values()) == pytest.approx(1.0)
    assert "of the gap is left in recordings that were held out" in found.reasons[-1]


@pytest.mark.slow
def test_a_limit_that_acts_at_peaks_alone_is_named(tmp_path: Path) -> None:
    """It lies a fifth below what the motion takes, so that it does nothing for most of the time."""

    def weak(model: mujoco.MjModel) -> None:
        model.actuator_forcelimited[1], model.actuator_forcerange[1] = 1, (-limit, limit)

    free = robot_arm.samples(2)
    limit = 0.8 * float(np.abs(free["shoulder.effort"]).max())
    bags = [robot_arm.write_csv(tmp_path / f"run{k}.csv", robot_arm.samples(k, weak)) for k in (2, 3)]
    answer = tmp_path / "gap.json"
    offered = [part for name in (*FEW, "torque_limit_shoulder", "torque_limit") for part in ("--only", name)]
    asked = ["gap", "diagnose", "--model", str(robot_arm.write_model(tmp_path)), *map(str, bags), *offered]
    assert main([*asked, "-o", str(tmp_path / "out"), "--json", str(answer)]) == 0
    found = json.loads(answer.read_text())
    assert found["effects"][0]["name"] == "torque_limit_shoulder"
    assert found["corrected"]["values"]["torque_limit_shoulder.torque"] == pytest.approx(limit, rel=0.03)


@pytest.mark.parametrize(
    ("model", "said"),
    [
        ("missing.xml", "is no file; give an MJCF"),
        ("broken.xml", "cannot be loaded"),
        ("map.yaml", "names no model, but holds: units; write 'model: robot.xml' into it"),
        ("typo.yaml", "the key 'joint'; it may have: model, joints, units"),
    ],
)
def test_command_refuses_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], model: str, said: str) -> None:
    """Exit code 2, and one line that says what would be right."""
    robot_arm.write_model(tmp_path)
    (tmp_path / "broken.xml").write_text("<mujoco><worldbody></mujoco>")
    (tmp_path / "map.yaml").write_text("units: degrees\n")
    (tmp_path / "typo.yaml").write_text("model: arm.xml\njoint: {}\n")
    bag = robot_arm.write_bag(tmp_path / "bag", robot_arm.samples(1, duration_s=1.0))
    assert main(["gap", "diagnose", "--model", str(tmp_path / model), str(bag), "-o", str(tmp_path / "out")]) == 2
    last = capsys.readouterr().err.strip().splitlines()[-1]
    assert said in last


def renamed(recorded: robot_arm.Samples) -> robot_arm.Samples:
    return {key.replace("elbow", "elbow_joint"): values for key, values in recorded.items()}


def still(recorded: robot_arm.Samples) -> robot_arm.Samples:
    return {key: values if key == "time_s" else 0.0 * values for key, values in recorded.items()}


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (renamed, "write 'joints: {elbow_joint: elbow}' into a map"),
        (still, "nothing moves in recording"),
    ],
)
def test_command_refuses_recordings_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], changed: Recorded, said: str
) -> None:
    """Recordings that do not fit end the command with exit code 2, and a line that says what would be right."""
    bag = robot_arm.write_csv(tmp_path / "run.csv", changed(robot_arm.samples(1, duration_s=2.0)))
    model = robot_arm.write_model(tmp_path)
    assert main(["gap", "diagnose", "--model", str(model), str(bag), "-o", str(tmp_path / "out"), "--jobs", "1"]) == 2
    last = capsys.readouterr().err.strip().splitlines()[-1]
    assert said in last
    assert not (tmp_path / "out").exists()


def test_held_out_goes_with_a_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Recordings of an ankle are held out in turn: the option is refused there."""
    assert main(["gap", "diagnose", str(tmp_path), "--held-out", str(tmp_path)]) == 2
    assert "goes with --model" in capsys.readouterr().err.strip().splitlines()[-1]


@pytest.mark.parametrize(("option", "value"), [("--rig", "slip"), ("--sensors", "robot"), ("--namespace", "/left")])
def test_options_of_an_ankle_are_refused_beside_a_model(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str, value: str
) -> None:
    """What would not count is refused, by its name and its value."""
    model = robot_arm.write_model(tmp_path)
    assert main(["gap", "diagnose", "--model", str(model), str(tmp_path), option, value]) == 2
    assert f"{option} {value} is of ankles" in capsys.readouterr().err.strip().splitlines()[-1]


def test_no_process_at_all_is_refused_beside_a_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = robot_arm.write_model(tmp_path)
    assert main(["gap", "diagnose", "--model", str(model), str(tmp_path), "--jobs", "0"]) == 2
    assert "--jobs 0 must be 1 or more" in capsys.readouterr().err.strip().splitlines()[-1]


def test_what_was_decided_is_shown_before_the_search(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Gains that were estimated stand on the screen even if the search is never finished."""

    def stopped(*_: object) -> None:
        raise BadRobotError

    monkeypatch.setattr(diagnosing, "promising", stopped)
    bag = robot_arm.write_csv(tmp_path / "run.csv", robot_arm.samples(1, duration_s=2.0))
    model = robot_arm.write_model(tmp_path, robot_arm.MOTORS)
    main(["gap", "diagnose", "--model", str(model), str(bag), "-o", str(tmp_path / "out"), "--jobs", "1"])
    assert "note: nobody described the controller of joint yaw" in capsys.readouterr().err


def again(seed: int) -> robot_arm.Samples:
    """Return what a healthy arm reads of the same motion another time."""
    random = np.random.default_rng(seed)
    noise = {"position": robot_arm.STEP_RAD, "effort": robot_arm.NOISE_N_M}
    return {
        name: values + random.normal(0.0, noise[name.rpartition(".")[2]], values.shape)
        if not name.startswith(("command.", "time_s"))
        else values
        for name, values in robot_arm.samples(1, duration_s=3.0).items()
    }


def test_what_has_changed_since_is_named(tmp_path: Path) -> None:
    """Beside earlier runs of the same motion the friction that came since is named; one run twice is refused."""
    model = robot_arm.write_model(tmp_path)
    now, *before = [
        robot_arm.run(f"run {k}", robot_arm.samples(1, rubbing, 3.0) if k == 0 else again(k)) for k in range(3)
    ]
    found = diagnose_mujoco(model, [now], since=before, only=FEW, folder=tmp_path / "out", jobs=1)
    assert found.diagnosis.verdict is Verdict.EFFECTS
    assert found.diagnosis.effects[0].name == "friction_elbow"
    assert found.corrected.values["friction_elbow.torque"] == pytest.approx(0.8, abs=0.08)
    with pytest.raises(BadRecordingError, match="run 1 and run 1 hold the same readings; give each of them once"):
        matched(model, [now, before[0], before[0]])


STOP_RAD = 0.8


def stopped(model: mujoco.MjModel) -> None:
    model.jnt_range[2, 1] = STOP_RAD


@pytest.mark.slow
def test_joint_that_meets_something_is_named_and_corrected(tmp_path: Path) -> None:
    """An elbow that runs into something has an upper stop there, and the corrected model has it as a range."""
    model = robot_arm.write_model(tmp_path)
    runs = [robot_arm.run(f"run {k}", robot_arm.samples(k, stopped, 4.0)) for k in range(2)]
    stops = [f"{which}_stop_{joint}" for which in ("lower", "upper") for joint in robot_arm.JOINTS]
    found = diagnose_mujoco(model, runs, only=(*FEW, *stops), folder=tmp_path / "out", jobs=1)
    assert found.diagnosis.effects[0].name == "upper_stop_elbow"
    assert found.corrected.values["upper_stop_elbow.position"] == pytest.approx(STOP_RAD, abs=0.02)
    corrected = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "corrected.xml"))
    assert corrected.joint("elbow").range == pytest.approx([-3.0, STOP_RAD], abs=0.02)
    (elbow,) = (each for each in found.closing if each.signal == "elbow/position")
    assert elbow.corrected < 0.2 * elbow.nominal


@pytest.mark.parametrize(("change", "name"), [(rubbing, "friction_elbow"), (stopped, "upper_stop_elbow")])
def test_screening_puts_the_truth_among_the_first(tmp_path: Path, change: robot_arm.Change, name: str) -> None:
    """Of all effects that the arm is offered, those of the elbow's own cause are kept, and few others."""
    runs, robot = matched(robot_arm.write_model(tmp_path), [robot_arm.run("one", robot_arm.samples(5, change, 4.0))])
    compared, _ = recordings_of(robot, runs, 2.0, 4.0)
    offer = robot_library(robot, compared)
    kept = promising(
        RobotSimulator(robot, offer.changes), offer, offer.effects, compared, 1, lambda _what, _share: None
    )
    names = [effect.name for effect in kept]
    assert name in names
    assert len(names) <= 16 < len(offer.effects.effects)


@pytest.mark.slow
def test_efforts_alone_are_diagnosed_backwards(tmp_path: Path) -> None:
    """Without commands the efforts that the motion takes are compared: friction shows in them, and where."""
    arm = robot_arm.write_model(tmp_path, robot_arm.MOTORS)
    runs = [
        robot_arm.run(f"{k}", robot_arm.samples(k, rubbing, 4.0, smooth=True), without=("commands",)) for k in range(2)
    ]
    found = diagnose_mujoco(arm, runs, only=FEW, folder=tmp_path / "out", jobs=1)
    assert not found.robot.drives
    assert found.diagnosis.verdict in {Verdict.EFFECTS, Verdict.AMBIGUOUS}
    assert found.diagnosis.effects[0].name == "friction_elbow"
    assert found.corrected.values["friction_elbow.torque"] == pytest.approx(0.8, abs=0.15)


def test_healthy_arm_needs_no_backward_change(tmp_path: Path) -> None:
    """Inverse dynamics of the machine's own model leave only the noise of efforts and differentiated angles."""
    plain = robot_arm.samples(4, robot_arm.exactly, 4.0, smooth=True)
    run = robot_arm.run("one", plain, without=("commands",))
    runs, robot = matched(robot_arm.write_model(tmp_path), [run])
    (compared,), _ = recordings_of(robot, runs, 2.0, 20.0)
    made = RobotSimulator(robot, {})(compared, {})
    for each in compared.signals:
        inside = slice(20, -20)
        left = float(np.sqrt(np.mean((each.values - made[each.name])[inside] ** 2)))
        assert left < 3.0 * each.noise, each.name


def test_machine_that_runs_backward_keeps_its_friction(tmp_path: Path) -> None:
    """A second run of the same machine takes the efforts of the first: its friction is not used up."""
    recorded = robot_arm.run("one", robot_arm.samples(4, duration_s=2.0, smooth=True), without=("commands",))
    runs, robot = matched(robot_arm.write_model(tmp_path), [recorded])
    (compared,), _ = recordings_of(robot, runs, 2.0, 20.0)
    machine = RobotSimulator(robot, {}).machine({})
    rubbing(machine.model)
    first, second = run(machine, compared), run(machine, compared)
    assert np.array_equal(first["elbow/effort"], second["elbow/effort"])


def test_efforts_that_are_currents_are_refused(tmp_path: Path) -> None:
    """Efforts of another unit than the model's are no torque constant that is off: the map is asked for."""
    recorded = robot_arm.samples(1, duration_s=2.0)
    recorded["shoulder.effort"] = recorded["shoulder.effort"] / 9.0
    run = robot_arm.run("one", recorded)
    with pytest.raises(BadRobotError, match=r"write 'torque_constants: {shoulder: 8.99}'") as error:
        diagnose_mujoco(robot_arm.write_model(tmp_path), [run], folder=tmp_path, jobs=1)
    assert "\n" not in str(error.value)


@pytest.mark.slow
def test_example_of_the_page_names_the_friction(tmp_path: Path) -> None:
    """The script of the page runs as it stands."""
    command = [sys.executable, EXAMPLES / "any_robot.py", tmp_path]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    assert done.stdout.splitlines()[0] == "EFFECTS"
    assert done.stdout.splitlines()[1].startswith("Joint tilt rubs")
