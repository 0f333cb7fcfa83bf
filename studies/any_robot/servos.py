"""Real recordings: a small servo with a pendulum, diagnosed from a model by data sheet and beside least squares.

Sixteen runs by others: four trajectories with each of four gains (see the folder's own page for source and licence).
The firmware turns an error of position into a share of the supply's voltage; with the motor's back EMF that is a
position actuator, a damping of the joint and a limit of torque. Each gain is another model. One trajectory is held out.

    python -m studies.any_robot.servos ../shared/data/servo_friction
"""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from mujoco import minimize  # type: ignore[import-untyped]  # carries no types

from jammkle_gap import diagnose_mujoco, run_of_arrays

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap import Recording, RobotDiagnosis, Run

    Array = NDArray[np.float64]

TORQUE_CONSTANT, RESISTANCE = 0.464, 3.4
"""N m/A and Ohm. Data sheet of the servo: 103 turns a minute without load, and 1.47 A when it is stalled, at 5 V. Its
stall torque, 0.52 N m, would give 0.354 N m/A, but is what the gears leave of the motor's."""
DUTY_PER_RAD = 0.00246
"""Share of the supply per radian of error and unit of gain; as published with the recordings."""
ARMATURE, DRY, VISCOUS = 0.0015, 0.03, 0.008
"""kg m^2, N m, N m s/rad. Guessed, to a half."""
HELD_OUT = "sin_time_square"
TOLERANCES = {"gain": 0.2, "friction": 0.5, "damping": 0.3, "armature": 0.5}
"""Of the model. Data sheet: torque constant and resistance within a fifth, from which gain and back EMF follow; the
others are guessed."""
USUAL = ("friction_shaft.torque", "damping_shaft.coefficient", "armature_shaft.inertia", "position_gain_shaft.scale",
         "mass_pendulum.scale", "pendulum/length", "commands/arrival")  # fmt: skip
"""What MJCF says of such a servo: the parameters of an identification by least squares."""
_MODEL = """
<mujoco model="servo">
  <compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/>
  <worldbody><body name="pendulum"><inertial pos="0 0 -{length}" mass="{mass}" diaginertia="1e-6 1e-6 1e-6"/>
    <joint name="shaft" axis="0 1 0" damping="{damping}" armature="{armature}" frictionloss="{dry}"/>
  </body></worldbody>
  <actuator><position name="shaft" joint="shaft" kp="{kp}" forcerange="-{stall} {stall}"/></actuator>
</mujoco>"""


@dataclass(frozen=True)
class Servo:
    """Recordings with one gain."""

    gain: int
    model: str
    fitted: tuple[Run, ...]
    held_out: Run


@dataclass(frozen=True)
class Line:
    """What comes out for one gain; root mean squares on the recording that was held out, rad."""

    gain: int
    verdict: str
    posterior: Mapping[tuple[str, ...], float]
    nominal: float
    corrected: float
    same: float
    """By least squares of the parameters that the diagnosis fitted, effects and constants."""
    usual: float
    """By least squares of what MJCF says of such a servo."""


def servos_of(folder: Path) -> list[Servo]:
    """Read all runs of a folder, by gain."""
    runs: dict[int, dict[str, Run]] = {}
    models: dict[int, str] = {}
    for file in sorted(folder.glob("*.json")):
        table = json.loads(file.read_text())
        gain, name = int(table["kp"]), str(table["trajectory"])
        runs.setdefault(gain, {})[name] = _run_of(name, table["entries"])
        torque_per_volt = TORQUE_CONSTANT / RESISTANCE
        models[gain] = _MODEL.format(
            length=table["length"],
            mass=table["mass"],
            damping=VISCOUS + TORQUE_CONSTANT * torque_per_volt,
            armature=ARMATURE,
            dry=DRY,
            kp=torque_per_volt * table["vin"] * DUTY_PER_RAD * gain,
            stall=torque_per_volt * table["vin"],
        )
    return [
        Servo(gain, models[gain], tuple(run for name, run in own.items() if name != HELD_OUT), own[HELD_OUT])
        for gain, own in sorted(runs.items())
    ]


def _run_of(name: str, entries: Sequence[Mapping[str, Any]]) -> Run:
    """Return a run until the servo lets go, if it does: a model does not know of that."""
    on = [bool(each["torque_enable"]) for each in entries]
    kept = entries if all(on) else entries[: on.index(False)]
    time_s, angle, goal = (
        np.array([each[key] for each in kept], dtype=float) for key in ("timestamp", "position", "goal_position")
    )
    return run_of_arrays(name, time_s, {"shaft.position": angle}, {"shaft.position": goal})


def line_of(servo: Servo, folder: Path, jobs: int) -> Line:
    """Diagnose the runs with one gain, and fit them by least squares."""
    model = folder / f"servo_{servo.gain}.xml"
    model.write_text(servo.model)
    found = diagnose_mujoco(
        model,
        servo.fitted,
        {"tolerances": TOLERANCES},
        held_out=[servo.held_out],
        folder=folder / f"{servo.gain}",
        jobs=jobs,
    )
    (closing,) = found.closing
    diagnosis = found.diagnosis
    return Line(
        servo.gain,
        diagnosis.verdict.value,
        dict(list(diagnosis.posterior.items())[:3]),
        closing.nominal,
        closing.corrected,
        left_by(found, least_squares(found, tuple(found.corrected.values))),
        left_by(found, least_squares(found, USUAL)),
    )


def least_squares(found: RobotDiagnosis, keys: Sequence[str]) -> dict[str, float]:
    """Return parameters fitted by the optimiser of mujoco.sysid to what was diagnosed, without priors.

    Args:
        found: Its simulator, its recordings, and the bounds of its effects and constants.
        keys: Effects by `effect.parameter`, and constants by name; those that it has not are left out.

    """
    known = {effect.key(each): (each.null, each.minimum, each.maximum)
             for effect in found.library for each in effect.parameters}  # fmt: skip
    known.update({each.name: (each.null, each.minimum, each.maximum) for each in found.problem.constants})
    names = [key for key in keys if key in known]
    null, low, high = (np.array(each) for each in zip(*(known[name] for name in names), strict=True))
    span = high - low

    def left(shares: Array) -> Array:
        return np.column_stack([
            _left(found, dict(zip(names, (low + span * column).tolist(), strict=True)), found.recordings)
            for column in shares.T
        ])  # fmt: skip

    ends = [np.zeros((len(names), 1)), np.ones((len(names), 1))]
    start = np.clip((null - low) / span, 0.02, 0.98)[:, np.newaxis]
    shares, _ = minimize.least_squares(
        start, left, bounds=ends, verbose=minimize.Verbosity.SILENT, eps=1e-4, max_iter=30
    )
    return dict(zip(names, (low + span * shares.ravel()).tolist(), strict=True))


def left_by(found: RobotDiagnosis, values: Mapping[str, float]) -> float:
    """Return the root mean square that some values leave of what was held out, rad."""
    return float(np.sqrt(np.square(_left(found, values, found.tried)).mean()))


def _left(found: RobotDiagnosis, values: Mapping[str, float], recordings: Sequence[Recording]) -> Array:
    return np.concatenate([
        each.signal("shaft/position").values - found.problem.simulator(each, values)["shaft/position"]
        for each in recordings
    ])  # fmt: skip


def main(
    folder: Annotated[Path, typer.Argument(help="Of the recordings.")],
    jobs: Annotated[int, typer.Option(help="Processes.")] = 1,
) -> None:
    """Diagnose real servos, and compare with least squares of the same and of the usual parameters."""
    head = (
        f"| gain | verdict | likeliest | {HELD_OUT}, rad: model | corrected | the same by least squares | MJCF's own |"
    )
    typer.echo(f"{head}\n|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as out:
        for servo in servos_of(folder):
            line = line_of(servo, Path(out), jobs)
            likeliest = ", ".join(f"{' + '.join(each) or 'none'} {share:.2f}" for each, share in line.posterior.items())
            figures = " | ".join(f"{each:.4f}" for each in (line.nominal, line.corrected, line.same, line.usual))
            typer.echo(f"| {line.gain} | `{line.verdict}` | {likeliest} | {figures} |")


if __name__ == "__main__":
    typer.run(main)
