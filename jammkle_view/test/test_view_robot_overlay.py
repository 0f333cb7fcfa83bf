"""A recorded leg or quadruped is simulated again: with the same commands it does the same, with others not."""

from __future__ import annotations

import dataclasses
import math
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import yaml

from jammkle_common.command.errors import InputError
from jammkle_sim.physics.sensors import SensorParameters, imu_variance
from jammkle_view.overlay import is_robot, robot_overlay
from jammkle_view.recorded import read_recorded

if TYPE_CHECKING:
    from jammkle_view.recorded import Recorded

JAMMKLE = Path(sys.executable).with_name("jammkle")
SENSORS = SensorParameters()
PRESSURE_PA = 3.0 * math.hypot(SENSORS.pressure_offset_pa, SENSORS.pressure_noise_pa)
"""What a sensor of pressure may be off by, and so the simulation beside it, which has no noise."""
FORCE_M_S2, RATE_RAD_S = (1.1 * math.sqrt(variance) for variance in imu_variance(SENSORS))
ANGLE_RAD = 0.002
"""A tenth of a degree: states are reported every 10 ms, and a joint may turn at several rad/s in between."""
TENSION_N = 0.5


@pytest.fixture(scope="module")
def drop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("drop"), "leg", "--behaviour", "drop", "--duration-s", "2")


def made(folder: Path, *words: str) -> Path:
    """Bag of a robot whose ankles are jammed."""
    bag = folder / words[0]
    command = [JAMMKLE, "robot", *words, "--vacuum-kpa", "40", "-o", bag]
    subprocess.run(command, check=True, capture_output=True)
    return bag


def read(bag: Path, namespace: str | None = None) -> Recorded:
    return read_recorded(bag, namespace, lambda _: None)


def rms(bag: Path, recorded: Recorded) -> dict[str, float]:
    """Root mean square of the gap, by signal."""
    return {gap.signal: gap.rms for gap in robot_overlay(bag, recorded, lambda _: None).gaps}


def told_otherwise(recorded: Recorded, **options: object) -> Recorded:
    """The same recording of a robot that says to have other options than it had."""
    content = yaml.safe_load(recorded.description)
    content["options"] |= options
    return dataclasses.replace(recorded, description=yaml.safe_dump(content))


def assert_is_noise(gaps: dict[str, float]) -> None:
    limits = {"pressure": PRESSURE_PA, "position": ANGLE_RAD, "tension": TENSION_N}
    limits |= {f"specific_force_{axis}": FORCE_M_S2 for axis in "xyz"}
    limits |= {f"angular_velocity_{axis}": RATE_RAD_S for axis in "xyz"}
    assert {signal: gap for signal, gap in gaps.items() if gap > limits[signal.rpartition("/")[2]]} == {}


def test_a_leg_that_drops_does_so_again(drop: Path) -> None:
    """Commands are taken from the bag: what is left is the noise of the sensors, in every signal."""
    gaps = rms(drop, read(drop))
    assert {"manifold/pressure", "imu/specific_force_z", "knee/position", "achilles_left/tension"} <= set(gaps)
    assert_is_noise(gaps)


def test_a_robot_that_was_another_shows_a_gap(drop: Path) -> None:
    """Let fall from higher up it lands later, and harder."""
    other = rms(drop, told_otherwise(read(drop), drop_height_m=0.1))
    assert other["imu/specific_force_z"] > 50.0 * FORCE_M_S2


def test_every_ankle_of_a_quadruped_walks_again(tmp_path: Path) -> None:
    """One ankle is looked at; the others have had their commands, too, or the trunk would move otherwise."""
    bag = made(tmp_path, "quadruped", "--behaviour", "walk", "--duration-s", "1.5")
    recorded = read(bag, "/rf_ankle")
    assert is_robot(recorded)
    assert_is_noise(rms(bag, recorded))
    (run,) = robot_overlay(bag, recorded, lambda _: None).runs
    trunk, beside = recorded.state_at(1.4).base, run.base.at(1.4)
    assert trunk is not None
    assert (beside["x"], beside["y"], beside["z"]) == pytest.approx(trunk.position_m, abs=0.001)


def test_what_cannot_be_simulated_again_is_said(drop: Path) -> None:
    """A machine's clock gives no time since the start of a simulation; no robot can do what none can."""
    recorded = read(drop)
    with pytest.raises(InputError, match="machine's clock"):
        rms(drop, dataclasses.replace(recorded, start_s=1.7e9))
    with pytest.raises(InputError, match="slope_deg"):
        rms(drop, told_otherwise(recorded, slope_deg=89.0))


def test_a_robot_is_not_corrected(drop: Path, tmp_path: Path) -> None:
    """Effects are of an ankle on its rig: it says so, in a line."""
    (tmp_path / "leak.yaml").write_text("line_leak_achilles: {}\n")
    command = [JAMMKLE, "view", drop, "--corrected", tmp_path / "leak.yaml", "--view-port", "0"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=100)
    assert done.returncode == 2
    assert "recording of a rig" in done.stderr.splitlines()[-1]
