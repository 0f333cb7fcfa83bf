"""What a diagnosis costs: a seven-joint arm, five recordings of 20 s, a joint that rubs.

python -m studies.any_robot.cost
"""

from __future__ import annotations

import resource
import tempfile
import time
from pathlib import Path
from typing import Annotated

import mujoco  # type: ignore[import-untyped]  # carries no types
import numpy as np
import typer
from joblib.externals.loky import get_reusable_executor  # type: ignore[import-untyped]  # carries no types

from jammkle_gap import Run, diagnose_mujoco, run_of_arrays
from studies.any_robot.machines import ARM

RECORDINGS, DURATION_S, RATE_HZ = 5, 20.0, 125
_SEVENTH = """
  <body name="hand" pos="0 0 0.08"><inertial pos="0 0 0.03" mass="0.4" diaginertia="0.0006 0.0006 0.0006"/>
    <joint name="wrist_4" axis="0 0 1" damping="0.2" armature="0.03" frictionloss="0.1" range="-3 3"/></body>
  <site name="flange" """
_DRIVE = '<position name="wrist_4" joint="wrist_4" kp="150" kv="6" forcerange="-15 15"/></actuator>'
MODEL = ARM.replace('<site name="flange" ', _SEVENTH).replace("</actuator>", _DRIVE)


def record(seed: int) -> Run:
    """Return a recording of an arm whose elbow rubs, and whose masses are 1.5 % off."""
    random, model = np.random.default_rng(seed), mujoco.MjModel.from_xml_string(MODEL)
    model.body_mass[:] *= 1.015
    model.dof_frictionloss[2] += 1.5
    data, times = mujoco.MjData(model), np.arange(0.0, DURATION_S, 1.0 / RATE_HZ)
    hertz, phase = random.uniform(0.2, 0.8, model.nu), random.uniform(0.0, 6.0, model.nu)
    waves = 0.5 * np.sin(2.0 * np.pi * np.outer(times, hertz) + phase) * np.minimum(times, 1.0)[:, np.newaxis]
    read, effort = np.empty_like(waves), np.empty_like(waves)
    for k, command in enumerate(waves):
        read[k], effort[k], data.ctrl[:] = data.qpos, data.qfrc_actuator, command
        mujoco.mj_step(model, data, round(1.0 / RATE_HZ / model.opt.timestep))
    names = [model.joint(k).name for k in range(model.njnt)]
    read = np.round((read + random.normal(0.0, 6e-5, read.shape)) / 2e-4) * 2e-4
    effort += random.normal(0.0, 0.15, effort.shape)
    measured = {f"{name}.position": column for name, column in zip(names, read.T, strict=True)}
    measured.update({f"{name}.effort": column for name, column in zip(names, effort.T, strict=True)})
    commands = {f"{name}.position": column for name, column in zip(names, waves.T, strict=True)}
    return run_of_arrays(f"run {seed}", times, measured, commands)


def main(jobs: Annotated[int, typer.Option(help="Processes.")] = 2) -> None:
    """Diagnose the arm, and print what was found and what it took."""
    runs = [record(seed) for seed in range(RECORDINGS)]
    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder) / "arm.xml"
        model.write_text(MODEL)
        begin_s, before_s = time.perf_counter(), _spent_s()
        found = diagnose_mujoco(model, runs, folder=folder, jobs=jobs)
        wall_s = time.perf_counter() - begin_s
    get_reusable_executor().shutdown(wait=True)  # what its processes took counts when they have ended
    core_s = _spent_s() - before_s
    named = [" + ".join(each.names) or "none of them" for each in found.diagnosis.candidates]
    typer.echo(f"{found.diagnosis.verdict.value}: {', '.join(named)}")
    effects, constants = len(found.library.effects), len(found.problem.constants)
    typer.echo(f"{effects} effects and {constants} constants, {found.diagnosis.spent.runs} runs in the search")
    typer.echo(f"{wall_s:.0f} s of wall time in {jobs} processes, {core_s:.0f} s of a core")


def _spent_s() -> float:
    """Return the time of a core that this process and those that it waited for have taken, s."""
    own = (resource.getrusage(each) for each in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(each.ru_utime + each.ru_stime for each in own)


if __name__ == "__main__":
    typer.run(main)
