"""Exercises on a live simulated robot: whole bags, each with its run sheet, that the simulator makes again."""

from __future__ import annotations

import shutil
import subprocess
import sys
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pytest

from graph import environment
from jammkle_bringup.exercise import Limb, course_of, spoken, standing
from jammkle_common.bags.run_sheet import FILE_NAME, read_sheet
from jammkle_common.names import JAM_STATE, SET_PAUSED
from jammkle_common.parameters import from_mapping
from jammkle_gap.ankle.recording import load_recordings
from jammkle_gap.mujoco.changes import change_timing
from jammkle_gap.mujoco.diagnosing import matched
from jammkle_gap.mujoco.simulator import RobotSimulator, scale_of
from jammkle_gap.mujoco.windows import recordings_of
from jammkle_sim.rigs.catalogue import EXERCISES
from jammkle_sim.rigs.model import hung
from jammkle_sim.robots.catalogue import robot
from jammkle_sim.robots.limb import LimbParameters
from jammkle_sim.robots.options import RobotOptions
from jammkle_sim.robots.urdf import robot_mjcf
from recorded import SIMULATOR

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from graph import Probe, Up
    from jammkle_bringup.exercise import ShankCourse
    from jammkle_gap import Recording

TIMEOUT_S = 240.0
"""Of real time, for half a minute of simulated time beside other tests."""


SESSION = """
import sys
from types import SimpleNamespace
import jammkle_gap.session as room
from jammkle_common.command.main import main
from jammkle_gap.core.result import NextExperiment
following = NextExperiment("exercise cycle -p vacuum_pa:=20000", 12.0, "angle", 5.0, 0.1, "rad", "they differ")
said = [SimpleNamespace(next_experiment=each, candidates=(), finished=True) for each in (following, None)]
room.diagnose = lambda request: said.pop(0)
sys.exit(main(["gap", "session", sys.argv[1]]))
"""
"""A session whose diagnosis, of minutes, is made up."""

LATE_CLOCK = """
import sys, time
from jammkle_bringup.exercise import _Session
from jammkle_common.command.main import main
take, ends_s = _Session._take_clock, []
def late(session, tick):
    ends_s.append(time.monotonic() + 1.0)
    if time.monotonic() > ends_s[0]:
        take(session, tick)
_Session._take_clock = late
sys.exit(main(["exercise", sys.argv[1], "-o", sys.argv[2], "-p", sys.argv[3]]))
"""
"""An exercise whose command receives the clock a second after all else, as on a busy machine."""


def course(name: str, **options: object) -> ShankCourse:
    """Course of an exercise."""
    kind = EXERCISES[name]
    rig, programme = kind.build(from_mapping(kind.options, options))
    found = course_of(rig, float(rig.model.opt.timestep))
    assert found.lasts_s == 0.0 or found.lasts_s == pytest.approx(programme.duration_s, abs=0.03)  # 0: it stands
    return found


def worst_angle_gap(recording: Recording) -> float:
    """Largest difference of measured and nominal angles, root mean square in steps of the encoder by sqrt(12)."""
    simulated = SIMULATOR(recording, {})
    angles = [each for each in recording.signals if each.name.startswith("ankle_")]
    return max(float(np.sqrt(np.mean(((each.values - simulated[each.name]) / each.deviation) ** 2))) for each in angles)


def worst_limb_gap(bag: Path) -> float:
    """Largest difference of measured and nominal angles of hip and knee, root mean square in noise."""
    model = bag.with_name("leg.xml")
    model.write_text(robot_mjcf(robot("leg", RobotOptions(behaviour="hang"))))
    runs, leg = matched(model, [bag])
    (compared,), _ = recordings_of(leg, runs, window_s=2.0, search_s=4.0)
    # servos take a set point a millisecond after it is due
    simulator = RobotSimulator(leg, {"late": (("late",), (0.0,), partial(change_timing, "arrival_s"))})
    made = simulator(compared, {"late": 0.001})
    angles = [each for each in compared.signals if each.name in {"hip/position", "knee/position"}]
    return max(float(np.sqrt(np.mean(((each.values - made[each.name]) / scale_of(each)) ** 2))) for each in angles)


@pytest.mark.parametrize("hang_deg", [0.0, RobotOptions().hang_pitch_deg])
@pytest.mark.parametrize("has_abduction", [False, True])
def test_joints_take_the_shank_where_the_exercise_has_it(
    has_abduction: bool,  # noqa: FBT001 - a case
    hang_deg: float,
) -> None:
    """In the air: hip and knee add up to the pitch against the lean of the stance, the abduction is the roll."""
    limb, tilted = Limb(LimbParameters(), has_abduction, ankle=hung(None, hang_deg)), course("tilt")
    angles = limb.hanging_rad(tilted)
    assert angles[:, -2] + angles[:, -1] == pytest.approx(tilted.pitch_rad - limb.lean_rad)
    assert angles.shape[1] == 2 + has_abduction
    if has_abduction:
        assert angles[:, 0] == pytest.approx(tilted.roll_rad)


def test_joints_press_straight_down() -> None:
    """Over the ground: the ankle is as high as asked, and comes down within a millimetre of where it was above."""
    limb, pressed, hip_m = Limb(LimbParameters(), has_abduction=False), course("press", sides="no"), 0.29
    places = [
        limb.place_m(dict(zip(limb.joints, row, strict=True)), hip_m)
        for row in limb.pressing_rad(pressed, hip_m).tolist()
    ]
    forward_m, height_m = np.array(places).T
    assert height_m == pytest.approx(pressed.height_m, abs=1e-6)
    first = (pressed.time_s > 0.65) & (pressed.time_s < 2.0)
    assert np.ptp(height_m[first]) > 0.005
    assert np.ptp(forward_m[first]) < 1e-3


def test_a_foot_that_stands_is_doubted() -> None:
    """A foot far from where it hangs is named, with the way out; one that hangs, or that nobody measures, is not."""
    hangs, stands = {"ankle_pitch": 0.51, "knee": 1.0}, {"ankle_pitch": 0.10}
    assert standing({"": hangs}, 30.0) == []
    assert standing({"": {"knee": 1.0}}, 30.0) == []
    (doubt,) = standing({"lf_ankle": hangs, "rf_ankle": stands}, 30.0)
    assert doubt.startswith("the foot rf_ankle is at 6 degrees of pitch, and hangs at 30")
    assert "sim:behaviour:=hang" in doubt


def test_a_person_is_told_what_to_do_when() -> None:
    """Six poses of a tilt, two halves of a shake, every way of a press; nothing for a cycle, in which nothing moves."""
    said = spoken(course("tilt"))
    assert said[0][1] == "tilt the shank to 40 degrees toe-down and 0 degrees to the right"
    assert [text.split()[0] for _, text in spoken(course("shake"))] == ["rock", "rock"]
    assert not spoken(course("cycle"))
    said = spoken(course("press", sides="no"))
    assert [text.split()[0] for _, text in said] == ["tilt", "press", "lift"] * 4
    assert said[1] == (pytest.approx(0.6), "press down by 11 mm, within 0.6 s")
    assert said[2] == (pytest.approx(1.5), "lift by 11 mm, within 0.6 s")


def test_a_leg_shakes_and_presses_and_is_recorded(
    domain_id: int, start: Callable[..., Up], make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    """Its own joints move the shank, its driver the valves; bags are whole, and what they hold is simulated again.

    A session then records the exercise that would separate what is left, without asking, as the robot is simulated.
    """
    # in real time: as fast as it goes it takes all processors, also while an exercise looks for another one
    start("up", "--robot", "leg", "-p", "sim:behaviour:=hang", "-p", "sim:drop_height_m:=0.01")
    probe = make_probe()
    probe.listen(JAM_STATE)
    probe.wait_until_up()
    for name, brief in {"shake": "sweep_s:=2.0", "press": "way_time_s:=0.4"}.items():
        late = [sys.executable, "-c", LATE_CLOCK, name, str(tmp_path / "bags"), brief]
        done = subprocess.run(late, env=environment(domain_id), capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    assert probe.call(SET_PAUSED, data=True).success  # or it takes all the time that there is while bags are compared
    for name in ("shake", "press"):
        bag = tmp_path / "bags" / name
        assert (bag / FILE_NAME).is_file()
        sheet = read_sheet(bag, None)
        assert sheet.rig == name
        assert sheet.options["hang_pitch_deg"] == RobotOptions().hang_pitch_deg
        assert sheet.options["reservoir_volume_m3"] == RobotOptions().reservoir_volume_m3
        (recording,) = load_recordings(bag)
        assert any(line.values.max() > 0.0 for line in recording.inputs.commands.solenoids.values())
        assert recording.inputs.shank is not None
        assert np.ptp(recording.signal("ankle_pitch/position").values) > 0.005
        assert worst_angle_gap(recording) < 2.5
        assert any("left out: hip, knee; they are diagnosed" in note for note in recording.notes)
        if name == "shake":
            assert worst_limb_gap(bag) < 1.0
            again = ["rig", name, "--params", str(bag), "-o", str(tmp_path / "again")]
            subprocess.run([sys.executable, "-m", "jammkle_common.command", *again], check=True, capture_output=True)
    for name in ("cycle", "tilt"):  # as if they had been recorded, too
        shutil.copytree(tmp_path / "bags" / "shake", tmp_path / "bags" / name)
    assert probe.call(SET_PAUSED, data=False).success
    session = [sys.executable, "-c", SESSION, str(tmp_path / "bags")]
    asked = subprocess.run(session, env=environment(domain_id), capture_output=True, text=True, check=False)
    assert asked.returncode == 0, asked.stderr
    assert "next: jammkle exercise cycle -p vacuum_pa:=20000, 12 s" in asked.stderr
    assert read_sheet(tmp_path / "bags" / "cycle_2", None).options["vacuum_pa"] == 20e3
