"""A floating base: it moves as odometry says, or is free from where odometry has it, and its pose is compared."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import mujoco
import numpy as np
import pytest
import robot_arm

from jammkle_gap import BadRecordingError, run_of_arrays
from jammkle_gap.mujoco.diagnosing import matched
from jammkle_gap.mujoco.library import robot_library
from jammkle_gap.mujoco.prescribed import coordinates_of, state_of
from jammkle_gap.mujoco.runs import BASE_COLUMNS, BadRobotError
from jammkle_gap.mujoco.simulator import RobotSimulator, scale_of
from jammkle_gap.mujoco.windows import recordings_of

if TYPE_CHECKING:
    from pathlib import Path

    from jammkle_gap import Run

SLIDER = """
<mujoco model="slider">
  <compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 0.1" friction="0.4"/>
    <body name="box" pos="0 0 0.05"><freejoint/><geom type="box" size="0.15 0.1 0.05" mass="2" friction="0.4"/>
      <body name="arm" pos="0 0 0.08"><joint name="turn" axis="0 0 1" damping="0.05" armature="0.005"/>
        <geom type="capsule" fromto="0 0 0 0.25 0 0" size="0.02" mass="0.9" contype="0" conaffinity="0"/>
      </body>
    </body>
  </worldbody>
  <actuator><position name="turn" joint="turn" kp="30" kv="1.5"/></actuator>
</mujoco>"""
RATE_HZ = 100


def recorded(seed: int, grip: float = 1.0, sunk_m: float = 0.0) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return what is measured and commanded of a box that its arm pushes about on a floor of some grip."""
    model, random = mujoco.MjModel.from_xml_string(SLIDER), np.random.default_rng(seed)
    model.geom_friction[:, 0] *= grip
    data, rows = mujoco.MjData(model), []
    time_s = np.arange(0.0, 6.0, 1.0 / RATE_HZ)
    for command in 1.2 * np.sin(7.0 * time_s + seed) * np.minimum(time_s, 1.0):
        rows.append([*data.qpos, command])
        data.ctrl[0] = command
        mujoco.mj_step(model, data, round(1.0 / RATE_HZ / model.opt.timestep))
    table = np.array(rows)
    table[:, 2] -= sunk_m
    read = table[:, :-1] + random.normal(0.0, 2e-4, (len(table), table.shape[1] - 1))
    names = [*(f"base.{each}" for each in BASE_COLUMNS), "turn.position"]
    measured = dict(zip(names, read.T, strict=True))
    return {"time_s": time_s, **measured}, {"turn.position": table[:, -1]}


def run_of(measured: dict[str, np.ndarray], commands: dict[str, np.ndarray]) -> Run:
    """Return a run of samples."""
    return run_of_arrays("one", measured["time_s"], {k: v for k, v in measured.items() if k != "time_s"}, commands)


def test_rates_of_coordinates_are_the_velocity_of_a_free_joint() -> None:
    """Position and velocity of the joint move the coordinates as their rates say."""
    random = np.random.default_rng(0)
    model = mujoco.MjModel.from_xml_string(SLIDER)
    for _ in range(20):
        coordinates, rates = random.uniform(-1.2, 1.2, 6), random.normal(size=6)
        position, velocity = state_of(coordinates, rates)
        after = np.append(position, 0.0)
        mujoco.mj_integratePos(model, after, np.append(velocity, 0.0), 1e-6)
        moved = coordinates_of(np.array([position, after[:7]]))
        assert np.allclose(moved[0], coordinates)
        assert np.allclose((moved[1] - moved[0]) / 1e-6, rates, atol=1e-4)


def test_grip_of_the_floor_shows_in_where_the_base_goes(tmp_path: Path) -> None:
    """Windows of a box on a smoother floor are as the simulator has them with that floor, and not without."""
    file = tmp_path / "slider.xml"
    file.write_text(SLIDER)
    runs, robot = matched(file, [run_of(*recorded(1, grip=0.6))], {"base": "free"})
    assert robot.floating
    compared, kept = recordings_of(robot, runs, 1.0, 3.0)
    assert len(kept[0].inputs.starts_s) >= 2
    simulator = RobotSimulator(robot, robot_library(robot, compared).changes)

    def left(values: dict[str, float]) -> dict[str, float]:
        return {
            signal.name: float(np.sqrt(np.square((signal.values - made[signal.name]) / scale_of(signal)).mean()))
            for each in compared
            for made in [simulator(each, values)]
            for signal in each.signals
        }

    with_it, without = left({"floor_friction.scale": 0.6}), left({})
    assert set(with_it) == {"turn/position", *(f"base/{each}" for each in ("x", "y", "z", "yaw", "pitch", "roll"))}
    assert max(with_it.values()) < 2.0
    assert without["base/yaw"] > 5.0 * with_it["base/yaw"]


def test_odometry_that_counts_from_its_start_is_lifted_out_of_the_floor(tmp_path: Path) -> None:
    """A base that would begin in the floor stands on it, and the notes say so."""
    file = tmp_path / "slider.xml"
    file.write_text(SLIDER)
    runs, robot = matched(file, [run_of(*recorded(1, sunk_m=0.2)), run_of(*recorded(2))], {"base": "free"})
    sunk, standing = runs
    assert any("0.2 m in the floor" in note for note in sunk.notes)
    assert standing.notes == ()
    assert float(sunk.base[2].values.mean()) == pytest.approx(0.05, abs=1e-3)
    assert robot.notes == ()


def test_free_base_without_odometry_is_one_window(tmp_path: Path) -> None:
    """Where nobody measured the base it starts as the model has it, once; a model without one is refused."""
    file = tmp_path / "slider.xml"
    file.write_text(SLIDER)
    measured, commands = recorded(1)
    run = run_of({key: values for key, values in measured.items() if not key.startswith("base.")}, commands)
    runs, robot = matched(file, [run], {"base": "free"})
    assert any("holds no odometry" in note for note in robot.notes)
    compared, _ = recordings_of(robot, runs, 1.0, 3.0)
    assert compared[0].inputs.starts_s == (pytest.approx(0.2),)
    assert [signal.name for signal in compared[0].signals] == ["turn/position"]
    file.write_text(SLIDER.replace("<freejoint/>", ""))
    with pytest.raises(BadRobotError, match="'base: free', and the model has 0 free joints"):
        matched(file, [run], {"base": "free"})


CART = """
<mujoco><compiler angle="radian"/><option timestep="0.0025" integrator="implicitfast"/><worldbody>
  <body name="cart" pos="0 0 1">BASE<inertial pos="0 0 0" mass="5" diaginertia="0.1 0.1 0.1"/>
    <body name="leg"><inertial pos="0 0 -0.3" mass="1" diaginertia="0.01 0.01 0.001"/>
      <joint name="hip" axis="0 1 0" damping="0.05" range="-3 3"/></body></body></worldbody>
  <actuator><position name="hip" joint="hip" kp="8" kv="0.5"/>PUSH</actuator></mujoco>"""
RAILS = '<joint name="slide" type="slide" axis="1 0 0"/><joint name="yaw" axis="0 0 1"/>'
PUSHES = '<position name="push" joint="slide" kp="4000" kv="300"/><position name="turn" joint="yaw" kp="400" kv="30"/>'


def shaken(folder: Path) -> tuple[Path, Run]:
    """Return a model with a floating base, and a run of a machine whose base is shaken by drives of its own."""
    machine = mujoco.MjModel.from_xml_string(CART.replace("BASE", RAILS).replace("PUSH", PUSHES))
    data = mujoco.MjData(machine)
    mujoco.mj_forward(machine, data)
    time_s, rows = 0.005 * np.arange(1000), []
    for at_s in time_s:
        body = data.body("cart")
        rows.append([*body.xpos, *body.xquat, data.joint("hip").qpos[0], 0.3 * np.sin(2.0 * at_s)])
        for late_s in (0.0, 0.0025):
            pushed = 0.3 * np.sin(5.0 * (at_s + late_s)), 0.8 * np.sin(1.5 * (at_s + late_s))
            data.ctrl[:] = rows[-1][-1], *pushed
            mujoco.mj_step(machine, data)
        mujoco.mj_forward(machine, data)
    table = np.array(rows)
    table[500:, 3:7] *= -1.0  # the same orientation
    measured = {f"base.{name}": column for name, column in zip(BASE_COLUMNS, table.T[:7], strict=True)}
    file = folder / "cart.xml"
    file.write_text(CART.replace("BASE", "<freejoint/>").replace("PUSH", ""))
    step = np.round(table[:, 7] / 1e-4) * 1e-4
    return file, run_of_arrays("one", time_s, {**measured, "hip.position": step}, {"hip.position": table[:, 8]})


@pytest.mark.filterwarnings("error")
def test_base_that_was_measured_carries_the_leg(tmp_path: Path) -> None:
    """A leg swings as the shaken base makes it where the base moves as measured, and otherwise where it is held."""
    file, run = shaken(tmp_path)
    left = {}
    for base in ("measured", "held"):
        runs, robot = matched(file, [run], {"base": base})
        (compared,), _ = recordings_of(robot, runs, 2.0, 20.0)
        made = RobotSimulator(robot, {})(compared, {})["hip/position"]
        left[base] = float(np.sqrt(np.mean((compared.signal("hip/position").values - made) ** 2)))
    assert left["measured"] < 0.004
    assert left["held"] > 10.0 * left["measured"]


def test_base_without_odometry_is_refused(tmp_path: Path) -> None:
    """A measured base takes a free joint and recordings of it."""
    file, run = shaken(tmp_path)
    with pytest.raises(BadRobotError, match="holds no odometry of the base"):
        matched(file, [replace(run, base=())], {"base": "measured"})
    lost = replace(run, base=(*run.base[:3], *(each.changed(0.0, 0.0) for each in run.base[3:])))
    runs, robot = matched(file, [lost], {"base": "measured"})
    with pytest.raises(BadRecordingError, match="is no quaternion"):
        recordings_of(robot, runs, 2.0, 20.0)
    with pytest.raises(BadRobotError, match="the model has 0 free joints"):
        matched(
            robot_arm.write_model(tmp_path),
            [robot_arm.run("one", robot_arm.samples(1, duration_s=1.0))],
            {"base": "measured"},
        )


def test_odometry_of_a_bag_is_the_base(tmp_path: Path) -> None:
    """Poses of nav_msgs/Odometry are those of the arrays."""
    file, run = shaken(tmp_path)
    bag = robot_arm.write_odometry(tmp_path / "bag", run)
    (read,), robot = matched(file, [bag], {"base": "measured"})
    assert robot.joints == ("hip",)
    for ours, given in zip(read.base, run.base, strict=True):
        assert np.allclose(np.abs(ours.values), np.abs(given.values))
