"""An arm with three joints that is not ours: its model, machines that differ from it, and their recordings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from jammkle_gap.mujoco.runs import AXES, Quantity, Run, Sense, run_of_arrays
from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

JOINTS = ("yaw", "shoulder", "elbow")
MODEL = """
<mujoco model="arm">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="column" pos="0 0 0.3">
      <inertial pos="0 0 0" mass="2.0" diaginertia="0.01 0.01 0.01"/>
      <joint name="yaw" axis="0 0 1" damping="0.5" armature="0.05" range="-3 3"/>
      <body name="upper">
        <inertial pos="0.2 0 0" mass="2.0" diaginertia="0.002 0.027 0.027"/>
        <joint name="shoulder" axis="0 1 0" damping="0.5" armature="0.05" range="-3 3"/>
        <body name="fore" pos="0.4 0 0">
          <inertial pos="0.15 0 0" mass="1.2" diaginertia="0.001 0.009 0.009"/>
          <joint name="elbow" axis="0 1 0" damping="0.3" armature="0.03" range="-3 3"/>
          <body name="tool" pos="0.3 0 0">
            <inertial pos="0 0 0" mass="0.2" diaginertia="0.0002 0.0002 0.0002"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>ACTUATORS</actuator>
</mujoco>
"""
SERVOS = """
    <position name="yaw" joint="yaw" kp="60" kv="3"/>
    <position name="shoulder" joint="shoulder" kp="120" kv="5"/>
    <position name="elbow" joint="elbow" kp="60" kv="2.5"/>
"""
MOTORS = """
    <motor name="yaw" joint="yaw"/><motor name="shoulder" joint="shoulder"/><motor name="elbow" joint="elbow"/>
"""
WRIST = '<site name="wrist" pos="0.02 0 0" euler="0 0.3 0"/>'
RATE_HZ = 100
STEP_RAD = 2.0 * np.pi / 8192.0
"""Of the encoders."""
NOISE_N_M = 0.05
"""Of efforts."""
_BEGUN_S = 20.0
"""When a bag begins, as of a simulation."""

if TYPE_CHECKING:
    Change = Callable[[mujoco.MjModel], None]
    Samples = dict[str, NDArray[np.float64]]


def write_model(folder: Path, actuators: str = SERVOS, *, wrist: bool = False) -> Path:
    """Write the model into a folder, with a site on its tool where wanted, and return the file."""
    file = folder / "arm.xml"
    tool = '<inertial pos="0 0 0" mass="0.2"'
    file.write_text(MODEL.replace("ACTUATORS", actuators).replace(tool, f"{WRIST if wrist else ''}{tool}"))
    return file


def exactly(model: mujoco.MjModel) -> None:
    """Give a machine the masses of the model."""
    plain = mujoco.MjModel.from_xml_string(MODEL.replace("ACTUATORS", SERVOS))
    model.body_mass[:], model.body_inertia[:] = plain.body_mass, plain.body_inertia


def at_rest(recorded: Samples) -> Samples:
    """Return what the sensors at the wrist would read if they were weightless and at rest: their noise."""
    noise = np.random.default_rng(0).normal(0.0, 0.001, len(recorded["time_s"]))
    return {f"wrist.{sense.value}.{axis}": noise for sense in Sense for axis in AXES}


def samples(
    seed: int, change: Change | None = None, duration_s: float = 6.0, late_s: float = 0.0, *, smooth: bool = False
) -> Samples:
    """Return `time_s`, and `JOINT.position`, `JOINT.effort` and `command.JOINT.position` of a machine that moves.

    Args:
        seed: Of motion, noise and the machine's constants, which are within 2 %.
        change: What is wrong with it.
        duration_s: How long it is recorded.
        late_s: Delay of the commands.
        smooth: Whether its drives go straight from command to command, so that efforts have no steps.

    """
    random = np.random.default_rng(seed)
    model = mujoco.MjModel.from_xml_string(MODEL.replace("ACTUATORS", SERVOS))
    for number in range(1, model.nbody):
        scale = 1.0 + random.uniform(-0.02, 0.02)
        model.body_mass[number] *= scale
        model.body_inertia[number] *= scale
    if change is not None:
        change(model)
    data = mujoco.MjData(model)
    mujoco.mj_setConst(model, data)
    time_s = np.arange(0.0, duration_s, 1.0 / RATE_HZ)
    hertz, phase = random.uniform(0.3, 0.9, 3), random.uniform(0.0, 6.0, 3)
    grown = np.minimum(time_s / 0.5, 1.0)[:, np.newaxis]
    wave = 0.5 * np.sin(2.0 * np.pi * hertz * time_s[:, np.newaxis] + phase) * grown
    commands = wave + np.array([0.0, -0.3, 0.6]) * grown
    late = round(late_s * RATE_HZ)
    position, effort = np.empty_like(commands), np.empty_like(commands)
    for k in range(len(time_s)):
        position[k], effort[k] = data.qpos, data.qfrc_actuator
        before, after = commands[max(k - late - 1, 0)], commands[max(k - late, 0)]
        count = round(1.0 / RATE_HZ / model.opt.timestep)
        for share in np.arange(1, count + 1) / count if smooth else np.ones(count):
            data.ctrl[:] = before + share * (after - before)
            mujoco.mj_step(model, data)
    position = np.round((position + random.normal(0.0, 0.2 * STEP_RAD, position.shape)) / STEP_RAD) * STEP_RAD
    effort += random.normal(0.0, NOISE_N_M, effort.shape)
    found = {"time_s": time_s}
    for column, joint in enumerate(JOINTS):
        found[f"{joint}.position"], found[f"{joint}.effort"] = position[:, column], effort[:, column]
        found[f"command.{joint}.position"] = commands[:, column]
    return found


def run(name: str, recorded: Samples, **changed: Any) -> Run:
    """Return samples as a run; `without` names a quantity that is left out."""
    without = changed.get("without", ())
    measured = {
        key: values
        for key, values in recorded.items()
        if not key.startswith(("command.", "time_s")) and key.rpartition(".")[2] not in without
    }
    commands = {key[len("command.") :]: values for key, values in recorded.items() if key.startswith("command.")}
    return run_of_arrays(name, recorded["time_s"], measured, {} if "commands" in without else commands)


def write_csv(path: Path, recorded: Samples) -> Path:
    """Write samples as a CSV file."""
    rows = np.column_stack(list(recorded.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(recorded), comments="")
    return path


def write_bag(
    path: Path,
    recorded: Samples,
    form: str = "trajectory",
    ahead_s: float = 0.0,
    imu_frame: str = "",
    second: str = "",
) -> Path:
    """Write samples as a bag with `joint_states` and commands.

    Args:
        path: Folder of the bag.
        recorded: The samples.
        form: Of the commands: `trajectory`, `now` (one without a stamp), `array` (Float64MultiArray), `states`
            (JointState), or `none`.
        ahead_s: By which the clock of the commands' stamps is ahead.
        imu_frame: Of an IMU that lies still; empty: there is none.
        second: Another topic with the same joint states; empty: there is none.

    """
    store = get_typestore(Stores.ROS2_JAZZY)
    time_type, header_type = store.types["builtin_interfaces/msg/Time"], store.types["std_msgs/msg/Header"]
    duration_type = store.types["builtin_interfaces/msg/Duration"]
    names = list(JOINTS)
    kinds = {
        "trajectory": ("/arm/joint_trajectory", "trajectory_msgs/msg/JointTrajectory"),
        "now": ("/arm/joint_trajectory", "trajectory_msgs/msg/JointTrajectory"),
        "array": ("/arm/commands", "std_msgs/msg/Float64MultiArray"),
        "states": ("/arm/joint_command", "sensor_msgs/msg/JointState"),
    }
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        states = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        again = writer.add_connection(second, "sensor_msgs/msg/JointState", typestore=store) if second else None
        commanded = None if form == "none" else writer.add_connection(*kinds[form], typestore=store)
        imu = writer.add_connection("/imu/data", "sensor_msgs/msg/Imu", typestore=store)
        for k, at_s in enumerate(recorded["time_s"].tolist()):
            stamp_ns = round((at_s + _BEGUN_S) * 1e9)
            header = header_type(time_type(stamp_ns // 10**9, stamp_ns % 10**9), "")
            row = {each: np.array([recorded[f"{name}.{each}"][k] for name in names]) for each in ("position", "effort")}
            none = np.array([])
            message = store.types["sensor_msgs/msg/JointState"](header, names, row["position"], none, row["effort"])
            data = store.serialize_cdr(message, "sensor_msgs/msg/JointState")
            writer.write(states, stamp_ns, data)
            if again is not None:
                writer.write(again, stamp_ns, data)
            if imu_frame:
                vector, turn = store.types["geometry_msgs/msg/Vector3"], store.types["geometry_msgs/msg/Quaternion"]
                framed = header_type(time_type(stamp_ns // 10**9, stamp_ns % 10**9), imu_frame)
                nine, still = np.zeros(9), vector(0.0, 0.0, 0.0)
                imu_message = store.types["sensor_msgs/msg/Imu"](
                    framed, turn(0.0, 0.0, 0.0, 1.0), nine, still, nine, vector(0.0, 0.0, 9.81), nine
                )
                writer.write(imu, stamp_ns, store.serialize_cdr(imu_message, "sensor_msgs/msg/Imu"))
            asked = np.array([recorded[f"command.{name}.position"][k] for name in names])
            if commanded is None:
                continue
            stamp_ns = round((at_s + _BEGUN_S + ahead_s) * 1e9)
            header = header_type(time_type(stamp_ns // 10**9, stamp_ns % 10**9), "")
            if form in {"trajectory", "now"}:
                if form == "now":
                    header = header_type(time_type(0, 0), "")
                point = store.types["trajectory_msgs/msg/JointTrajectoryPoint"](
                    asked, none, none, none, duration_type(0, 0)
                )
                command = store.types[commanded.msgtype](header, names, [point])
            elif form == "array":
                layout = store.types["std_msgs/msg/MultiArrayLayout"]([], 0)
                command = store.types[commanded.msgtype](layout, asked)
            else:
                command = store.types[commanded.msgtype](header, names, asked, none, none)
            writer.write(commanded, round((at_s + _BEGUN_S) * 1e9), store.serialize_cdr(command, commanded.msgtype))
    return path


def write_odometry(path: Path, run: Run) -> Path:
    """Write positions, commands and the base of a run as a bag with `joint_states`, `joint_command` and `odom`."""
    store = get_typestore(Stores.ROS2_JAZZY)
    make = store.types
    (joint,), none, still = run.joints(), np.array([]), make["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    track = run.measured[joint, Quantity.POSITION]
    asked = run.commands[joint, Quantity.POSITION].at(track.time_s + 1e-6)
    types = {"/joint_states": "sensor_msgs/msg/JointState", "/joint_command": "sensor_msgs/msg/JointState",
             "/odom": "nav_msgs/msg/Odometry"}  # fmt: skip
    covariance, twist = np.zeros(36), make["geometry_msgs/msg/Twist"](still, still)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        added = {topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in types.items()}
        for k, at_s in enumerate(track.time_s.tolist()):
            stamp_ns = round((at_s + _BEGUN_S) * 1e9)
            stamp = make["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9)
            header = make["std_msgs/msg/Header"](stamp, "odom")
            x, y, z, qw, qx, qy, qz = (float(each.values[k]) for each in run.base)
            place, turn = make["geometry_msgs/msg/Point"](x, y, z), make["geometry_msgs/msg/Quaternion"](qx, qy, qz, qw)
            pose = make["geometry_msgs/msg/PoseWithCovariance"](make["geometry_msgs/msg/Pose"](place, turn), covariance)
            moving = make["geometry_msgs/msg/TwistWithCovariance"](twist, covariance)
            state = make["sensor_msgs/msg/JointState"]
            messages = {
                "/joint_states": state(header, [joint], np.array([track.values[k]]), none, none),
                "/joint_command": state(header, [joint], np.array([asked[k]]), none, none),
                "/odom": make["nav_msgs/msg/Odometry"](header, "base", pose, moving),
            }
            for topic, message in messages.items():
                writer.write(added[topic], stamp_ns, store.serialize_cdr(message, types[topic]))
    return path
