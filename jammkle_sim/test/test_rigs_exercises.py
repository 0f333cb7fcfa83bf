"""Exercises: a guided shank goes where its guide says, the foot feels that, and jamming shows in what it answers."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from jammkle_common.parameters import ParameterError, from_mapping
from jammkle_sim.rigs.catalogue import EXERCISES, run_rig
from jammkle_sim.rigs.guide import guided_by_imu, smooth_course
from jammkle_sim.rigs.replay import Bodies

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jammkle_sim.rigs.rig import Rig
    from jammkle_sim.rigs.run import RigRun

AMBIENT_PA = 101325.0


def built(name: str, **options: object) -> Rig:
    """Rig of an exercise."""
    kind = EXERCISES[name]
    rig, _ = kind.build(from_mapping(kind.options, options))
    return rig


def followed(rig: Rig, vacuum_pa: float = 0.0) -> Any:
    """What the bodies do at one pressure until the guide ends."""
    pressure_pa = np.full((len(rig.guide) - 1, 4), AMBIENT_PA - vacuum_pa)
    return Bodies(rig).follow(pressure_pa)


def go(name: str, **options: object) -> RigRun:
    """Run an exercise."""
    return run_rig(name, from_mapping(EXERCISES[name].options, options), lambda _: None, lambda: False)


def angles(run: RigRun, joint: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times and angles of a joint."""
    series = run.topics["joint_states"]
    return series.time_s, series.column(f"{joint}.position")


def test_the_foot_feels_the_motion_and_not_the_place() -> None:
    """d'Alembert: moved in the world, or at rest in a field as the shank's IMU measures it, it swings the same."""
    rig = built("shake", sweep_s=1.0)
    truth = followed(rig)
    imu, step_s = truth.raw_imu, float(rig.model.opt.timestep)
    again = followed(dataclasses.replace(rig, guide=guided_by_imu(step_s, imu[:, :3], imu[:, 3:])))
    for joint in ("ankle_pitch", "ankle_roll", "ankle_yaw"):
        swing = np.ptp(truth.position(joint))
        assert swing > 0.003
        assert np.abs(truth.position(joint)[: len(imu) - 1] - again.position(joint)).max() < 0.005 * swing


def test_nothing_that_hangs_on_a_guided_shank_moves_it() -> None:
    """Pressed onto the ground with 20 N and more, the ankle is within 10 um of where it is guided to."""
    run = go("press", sides="no", way_time_s=0.2)
    rig = built("press", sides="no", way_time_s=0.2)
    assert run.results["jammed_peak_force_n"] > 20.0
    time_s, height_m = angles(run, "carriage")
    guided_m = np.interp(time_s, rig.model.opt.timestep * np.arange(len(rig.guide)), rig.guide[:, 2])
    assert np.abs(height_m - guided_m).max() < 1e-5


def test_contact_forces_of_a_guided_foot_are_solved_to_their_end() -> None:
    """Half the time step moves a jammed foot that is pressed and turned by 60 urad at most, of 90 mrad."""
    tracks = []
    for step_s in (5e-4, 2.5e-4):
        rig = built("press", way_time_s=0.3, timestep_s=step_s)
        every = round(1e-3 / step_s)
        track = followed(rig, vacuum_pa=20e3)
        joints = ("ankle_roll", "ankle_pitch", "ankle_yaw")
        tracks.append(np.array([track.position(joint)[every - 1 :: every] for joint in joints]))
    rows = min(track.shape[1] for track in tracks)
    coarse, fine = (track[:, :rows] for track in tracks)
    assert np.ptp(fine, axis=1).min() > 0.09
    assert np.abs(coarse - fine).max() < 6e-5


def test_a_guided_foot_begins_at_rest() -> None:
    """It hangs as if it had done so for long: in the first half second, held still, it stays within 0.05 mrad."""
    truth = followed(built("shake", sweep_s=1.0))
    pitch = truth.position("ankle_pitch")[:1000]
    assert np.ptp(pitch) < 5e-5
    assert abs(pitch[0]) > 1e-3  # and gravity has turned it from where it was drawn


def test_the_guide_ends_in_stillness() -> None:
    """After its last row a guided carriage stays where it is."""
    rig = built("tilt", hold_s=0.5)
    track = Bodies(rig).follow(np.full((len(rig.guide) + 2000, 4), AMBIENT_PA))
    assert np.ptp(track.position("carriage")[-1500:]) < 1e-9


def test_a_pressed_foot_is_stiffer_when_jammed() -> None:
    """Jammed by 50 kPa it takes twice the force, by the 20 kPa at which its fibres slide half as much again."""
    held, slid = (go("press", way_time_s=0.3, vacuum_pa=vacuum_pa) for vacuum_pa in (50e3, 20e3))
    assert held.results["jammed_peak_force_n"] > 2.0 * held.results["soft_peak_force_n"]
    assert slid.results["jammed_peak_force_n"] > 1.3 * slid.results["soft_peak_force_n"]


def test_a_press_that_would_stand_flat_is_refused() -> None:
    """A turn of the whole tilt has no tendon bear any more."""
    with pytest.raises(ParameterError, match="less than the tilt of 10 deg"):
        built("press", tilt_deg=10.0, turn_deg=10.0)


def test_a_shaken_foot_swings_less_when_jammed() -> None:
    """Friction of the fibres stiffens the ankle against the same motion."""
    run = go("shake", sweep_s=2.0)
    assert run.results["jammed_swing_rad"] < 0.7 * run.results["soft_swing_rad"]


def test_gravity_turns_the_foot_to_the_low_side() -> None:
    """Rolled to either side the foot gives way to that side, by about as much: creep of the first pose is left."""
    run = go("tilt", hold_s=0.6)
    time_s, roll_rad = angles(run, "ankle_roll")
    right, left = (roll_rad[np.searchsorted(time_s, pose * 1.2 + 1.15)] for pose in (3, 4))
    assert right == pytest.approx(-left, rel=0.25)
    assert abs(right) > 1e-3


def test_every_channel_is_cycled_alone_and_then_all() -> None:
    """Four cycles: each channel takes part in its own and in the last."""
    run = go("cycle", jam_time_s=0.5, vent_time_s=0.3)
    for place, channel in enumerate(("peroneal_left", "peroneal_right", "achilles")):
        command = run.topics[f"{channel}/solenoid"]
        rises = command.time_s[1:][np.diff(command.column("data")) > 0.0]
        assert rises == pytest.approx([0.5 + 0.8 * place, 0.5 + 0.8 * 3], abs=0.011)


def test_a_course_rests_in_its_corners() -> None:
    """Half a cosine: there at the time, without speed."""
    time_s = np.linspace(0.0, 3.0, 3001)
    course = smooth_course(np.array([0.0, 1.0, 3.0]), np.array([[0.0], [1.0], [-1.0]]), time_s)[:, 0]
    assert course[[0, 1000, 3000]] == pytest.approx([0.0, 1.0, -1.0])
    assert np.abs(np.gradient(course, time_s)[[0, 1000, 3000]]).max() < 0.01
