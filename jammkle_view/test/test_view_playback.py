"""A recording played back: what is read, what is simulated beside it, and what is refused."""

from __future__ import annotations

import dataclasses
import math
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from jammkle_common import names
from jammkle_view.core.samples import ChannelState, Joints, Pressure
from jammkle_view.overlay import overlay_of
from jammkle_view.playback import Player
from jammkle_view.recorded import Collected, Recorded, Track, read_recorded

JAMMKLE = Path(sys.executable).with_name("jammkle")
LOST = "fibre_loss_achilles_left: {lost: 0.8}\n"


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A landing of an ankle that has lost fibres."""
    folder = tmp_path_factory.mktemp("view")
    (folder / "lost.yaml").write_text(LOST)
    rig = [JAMMKLE, "rig", "landing", "--effects", "lost.yaml", "-o", "landing"]
    subprocess.run(rig, check=True, capture_output=True, cwd=folder)
    return folder / "landing"


@pytest.fixture(scope="module")
def recorded(bag: Path) -> Recorded:
    return read_recorded(bag, None, lambda _: None)


def refused(*arguments: str) -> str:
    """What `jammkle view` says as it refuses something, in one line."""
    done = subprocess.run([JAMMKLE, "view", *arguments], capture_output=True, text=True, check=False, timeout=100)
    assert done.returncode == 2, done.stderr
    assert done.stderr.count("\n") == 1
    return done.stderr


def test_times_count_from_the_first_stamp(recorded: Recorded) -> None:
    """It is held for a second, falls, and lies."""
    assert recorded.duration_s == pytest.approx(3.1, abs=0.1)
    start_m, end_m = (recorded.joints.at(time_s)["carriage"] for time_s in (0.0, recorded.duration_s))
    assert recorded.joints.at(0.9)["carriage"] == pytest.approx(start_m, abs=1e-3)
    assert start_m - end_m > 0.04


def test_the_simulation_lies_over_the_recording(bag: Path, recorded: Recorded) -> None:
    """It begins when the recording does; corrected by what was wrong, it is what was recorded, but for noise."""
    nominal = overlay_of(bag, recorded, None, None)
    (run,) = nominal.runs
    assert nominal.run_at(1.5) is run
    assert run.joints.at(0.9)["carriage"] == pytest.approx(recorded.joints.at(0.9)["carriage"], abs=1e-3)
    corrected = overlay_of(bag, recorded, None, bag.parent / "lost.yaml")
    pitch = "ankle_pitch/position"
    before, after = ({gap.signal: gap.rms for gap in each.gaps} for each in (nominal, corrected))
    assert before[pitch] > 0.05
    assert after[pitch] < before[pitch] / 20.0


def test_what_nobody_measured_is_not_known(recorded: Recorded) -> None:
    """Where no driver reported, a channel is by its pressure: not before its first reading, nor after its last."""
    topic = names.PRESSURES[names.ACHILLES].name
    pressure = recorded.readings[topic]
    begins_s = float(pressure.time_s[0])
    later = Track(pressure.time_s + 1.0, pressure.columns)
    some = dataclasses.replace(recorded, reports=(), readings={topic: later})
    assert some.state_at(begins_s + 1.5).channels[names.ACHILLES].state is ChannelState.UNJAMMED
    for time_s in (begins_s + 0.5, recorded.duration_s + 2.0):
        assert some.state_at(time_s).channels[names.ACHILLES].state is ChannelState.UNKNOWN
    at_the_end = dataclasses.replace(recorded, reports=()).state_at(recorded.duration_s + 0.1)
    assert at_the_end.channels[names.ACHILLES].state is not ChannelState.UNKNOWN
    unmeasured = some.state_at(begins_s + 1.5).channels[names.PERONEAL_LEFT]
    assert unmeasured.state is ChannelState.UNKNOWN
    assert math.isnan(unmeasured.measured_vacuum_pa)


def test_joints_of_two_publishers_are_all_there() -> None:
    """A robot's joints and its ankle's come in turn, or with one stamp: none is unknown in between."""
    collected = Collected()
    for k in range(500):
        collected.take(Joints(0.01 * k, {"ankle_pitch": 0.1}))
        collected.take(Joints(0.01 * k, {"carriage": 0.2}))
        collected.take(Joints(0.01 * k + 0.003, {"hip": 0.4}))
    shown = collected.recorded("bag", "/").state_at(2.501).joints
    assert shown == pytest.approx({"ankle_pitch": 0.1, "carriage": 0.2, "hip": 0.4})


@pytest.mark.parametrize(("vented_pa", "state"), [(89.9e3, ChannelState.UNJAMMED), (51e3, ChannelState.JAMMED)])
def test_thin_air_is_no_vacuum(vented_pa: float, state: ChannelState) -> None:
    """A vented ankle at 1000 m is not jammed; one that is evacuated all the time is."""
    collected = Collected()
    topic = names.PRESSURES[names.CHANNELS[0]].name
    for k in range(100):
        collected.take(Pressure(0.01 * k, topic, vented_pa))
    assert collected.recorded("bag", "/").state_at(0.5).channels[names.CHANNELS[0]].state is state


def test_a_playback_goes_round() -> None:
    """At the end it begins again; a jump stays inside."""
    player = Player(2.0)
    player.go_on(1.0)
    assert player.time_s == 0.0
    player.playing, player.speed = True, 0.5
    player.go_on(3.0)
    assert player.time_s == pytest.approx(1.5)
    player.go_on(1.5)
    assert player.time_s == pytest.approx(0.25)
    player.jump(9.0)
    assert player.time_s == 2.0
    player.jump(float("nan"))
    assert player.time_s == 2.0


def test_what_cannot_be_shown_is_refused_in_a_line(bag: Path) -> None:
    """Each names what is wrong, and what would be right."""
    assert "nowhere" in refused("nowhere")
    assert "lost.yaml" in refused(str(bag), "--corrected", "lost.yaml", "--no-simulation")
    assert "no_such_effect" in refused(str(bag), "--corrected", str(effect(bag.parent, "no_such_effect: {a: 1}\n")))
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        assert f"port {port}" in refused(str(bag), "--view-port", port, "--no-simulation")


def effect(folder: Path, text: str) -> Path:
    (folder / "effect.yaml").write_text(text)
    return folder / "effect.yaml"


def test_a_walking_robot_is_followed_through_its_bag(tmp_path: Path) -> None:
    """One ankle of a quadruped is chosen; where the trunk was and how the other legs stood is read as well."""
    bag = tmp_path / "trot"
    (tmp_path / "slow.yaml").write_text("imu_rate_hz: 100\n")
    words = [
        "robot",
        "quadruped",
        "--behaviour",
        "walk",
        "--duration-s",
        "2.5",
        "--params",
        str(tmp_path / "slow.yaml"),
    ]
    subprocess.run([JAMMKLE, *words, "-o", str(bag)], check=True, capture_output=True)
    trot = read_recorded(bag, "/rf_ankle", lambda _: None)
    assert "quadruped" in trot.description
    assert set(trot.others) == {"lf_ankle", "lh_ankle", "rh_ankle"}
    assert {"hip", "knee", "ankle_pitch"} <= set(trot.others["lh_ankle"].columns)
    start, end = trot.state_at(1.2).base, trot.state_at(2.4).base
    assert start is not None
    assert end is not None
    assert end.position_m[0] - start.position_m[0] > 0.05
    assert end.position_m[2] == pytest.approx(start.position_m[2], abs=0.02)
    assert end.rotation[0] == pytest.approx(1.0, abs=0.02)
    assert refused(str(bag)).count("_ankle") >= 4  # it says which there are
