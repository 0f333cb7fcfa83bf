"""Diagnose a pan-tilt head that is not ours: its model, two CSV files, what differs, and a run of what it is."""

import sys
from pathlib import Path

import mujoco
import numpy as np

from jammkle_gap import Modifier, diagnose_mujoco

MODEL, NAMES = Path(__file__).with_name("any_robot.xml"), ("pan", "tilt")


def record(file, seed):
    """Stand in for the robot: its tilt rubs, its masses are not quite as drawn, its encoders have steps."""
    random, model = np.random.default_rng(seed), mujoco.MjModel.from_xml_path(str(MODEL))
    model.body_mass[:] *= 1.015
    model.dof_frictionloss[1] += 0.1
    data, time_s = mujoco.MjData(model), 0.01 * np.arange(400)
    waves = np.sin(np.outer(time_s, random.uniform(2.0, 5.0, 2)) + random.uniform(0.0, 6.0, 2))
    commands = 0.6 * waves * np.minimum(time_s, 1.0)[:, np.newaxis]
    rows = []
    for at_s, command in zip(time_s, commands, strict=True):
        angles = np.round(data.qpos / 0.0005) * 0.0005
        efforts = data.qfrc_actuator + random.normal(0.0, 0.01, 2)
        rows.append([at_s, *angles, *efforts, *command])
        data.ctrl[:] = command
        mujoco.mj_step(model, data, 5)
    columns = [f"{name}.{what}" for what in ("position", "effort") for name in NAMES]
    header = ",".join(["time_s", *columns, *(f"command.{name}.position" for name in NAMES)])
    np.savetxt(file, rows, delimiter=",", header=header, comments="")
    return file


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "pan_tilt")
    folder.mkdir(parents=True, exist_ok=True)
    files = [record(folder / f"run_{seed}.csv", seed) for seed in range(2)]
    found = diagnose_mujoco(MODEL, files, folder=folder)
    print(found.diagnosis.verdict.value, *(each.sentence for each in found.diagnosis.effects), sep="\n")
    print(
        *(f"{each.signal}: {each.nominal:.2g} to {each.corrected:.2g} {each.unit}" for each in found.closing), sep="\n"
    )
    model = mujoco.MjModel.from_xml_path(str(folder / "corrected.xml"))
    data, modifier = mujoco.MjData(model), Modifier(model)
    while data.time < 1.0:
        modifier.control(data, {"pan": 0.3, "tilt": -0.2})
        mujoco.mj_step(model, data)
    print(*(f"{joint} reads {angle:.3f} rad" for joint, angle in modifier.positions(data).items()), sep="\n")
