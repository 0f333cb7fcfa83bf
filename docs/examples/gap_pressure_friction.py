"""Real data: a piston with an O-ring is stroked at four pressures. Its friction grows with pressure.

Measured by others: see data/README.md beside the recordings. The simulator has the piston's area and a dry friction,
as they are at 1 bar. No two runs were stroked alike, so each is a setting of its own. Scatter is what repeats within
and among them show: noise is how far the ten strokes of a run differ at the same place, and how far the friction of
reruns differs is a nuisance.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap import Effect, EffectParameter, Library, Nuisance, Problem, Recording, Signal, diagnose

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from jammkle_gap import Diagnosis

PRESSURES_BAR = (1, 3, 5, 7)
SMOOTH = 11
"""Samples that position is smoothed over before it is differentiated."""
THIN = 5
"""Every so many samples are compared: 20 Hz."""
BIN_S, PER_BIN = 0.2, 4
PLACES = 20
"""Parts of the stroke at which strokes are compared."""
SLOW_MM_S = 1.0
"""Below this the piston counts as resting, and friction keeps the sign of the last motion; assumed."""
MOVING_MM_S = 3.0
FORCE_N_BAR = 51.8
"""Slope of the mean of both directions over pressure, read off the recordings, N/bar."""
LIBRARY = Library(
    (
        Effect(
            "pressure_friction",
            "seal",
            (EffectParameter("per_bar", "N/bar", 0.0, -0.5, 3.0, "assumed"),),
            "The seal is pressed on harder: look at its groove.",
        ),
        Effect(
            "dry_friction",
            "seal",
            (EffectParameter("more", "N", 0.0, -6.0, 12.0, "assumed"),),
            "The seal rubs more at any pressure: grease it.",
        ),
        Effect(
            "viscous_friction",
            "seal",
            (EffectParameter("coefficient", "N s/mm", 0.0, 0.0, 1.0, "assumed"),),
            "The grease is stiff.",
        ),
        Effect(
            "presliding",
            "seal",
            (EffectParameter("length", "mm", 0.0, 0.0, 4.0, "assumed: about the seal's thickness"),),
            "The seal rolls in its groove before it slides: a tighter groove.",
        ),
        Effect(
            "spring",
            "rig",
            (EffectParameter("stiffness", "N/mm", 0.0, -0.5, 0.5, "assumed"),),
            "A hose or cable pulls on the piston.",
        ),
    )
)
CONSTANTS = (
    Nuisance("area.force_per_bar", "N/bar", FORCE_N_BAR, 1.5, "assumed: 3 % of piston and load cell"),
    Nuisance("load_cell.offset", "N", 0.0, 2.5, "assumed"),
)


def simulate(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
    """Give the force that strokes the piston, N."""
    inputs = recording.inputs
    pressure, rate = inputs["pressure"], inputs["rate"]
    rub = inputs["dry"] + values.get("dry_friction.more", 0.0) + values.get("run.friction", 0.0)
    rub = rub + values.get("pressure_friction.per_bar", 0.0) * (pressure - PRESSURES_BAR[0])
    side = turned(inputs["direction"], inputs["position"], values.get("presliding.length", 0.0))
    force = values.get("area.force_per_bar", FORCE_N_BAR) * pressure + rub * side
    force += values.get("viscous_friction.coefficient", 0.0) * rate + values.get("load_cell.offset", 0.0)
    return {"force": force + values.get("spring.stiffness", 0.0) * inputs["position"]}


def turned(side: NDArray[np.float64], position: NDArray[np.float64], length_mm: float) -> NDArray[np.float64]:
    """Let friction turn over a length after each reversal, instead of at once (Dahl)."""
    if length_mm <= 0.0:
        return side
    share = 1.0 - np.exp(-np.abs(np.diff(position, prepend=position[0])) / length_mm)
    found = side.copy()
    for k in range(1, side.size):
        found[k] = found[k - 1] + share[k] * (side[k] - found[k - 1])
    return found


def columns(file: Path) -> tuple[NDArray[np.float64], ...]:
    """Return time s, position mm, rate mm/s, pressure bar and force N."""
    table = np.loadtxt(file)
    table = table[np.concatenate([[True], np.diff(table[:, 0]) > 0.0])]
    time_s = (table[:, 0] - table[0, 0]) / 1000.0
    smooth = np.convolve(np.pad(table[:, 4], SMOOTH // 2, mode="edge"), np.ones(SMOOTH) / SMOOTH, "valid")
    return time_s, smooth, np.gradient(smooth, time_s), table[:, 5], table[:, 6]


def friction_n(file: Path) -> float:
    """Return half of what lies between the force of moving in and out, at the same pressure, N."""
    _, _, rate, pressure, force = columns(file)
    rest = force - FORCE_N_BAR * pressure
    return float(np.median(rest[rate > MOVING_MM_S]) - np.median(rest[rate < -MOVING_MM_S])) / 2.0


def stroke_noise_n(file: Path) -> float:
    """Return how far the force at the same place and in the same direction differs from stroke to stroke, N."""
    _, position, rate, pressure, force = columns(file)
    rest = force - FORCE_N_BAR * pressure
    place = np.digitize(position, np.linspace(position.min(), position.max(), PLACES + 1)[1:-1])
    cell = place + PLACES * (direction(rate) > 0.0)
    return float(np.mean([rest[cell == each].std() for each in np.unique(cell)]))


def reruns(folder: Path, bar: int) -> list[Path]:
    """Return the files of the three runs at a pressure."""
    return [folder / "rerun" / f"{k}_O-ring257_{bar}bar.csv" for k in (1, 2, 3)]


def direction(rate_mm_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sign of the motion, or of the last one."""
    moving = np.abs(rate_mm_s) > SLOW_MM_S
    last = np.maximum.accumulate(np.where(moving, np.arange(rate_mm_s.size), np.argmax(moving)))
    return np.sign(rate_mm_s[last])


def load(file: Path, dry_n: float, noise_n: float) -> Recording:
    """Read one run."""
    time_s, position, rate, pressure, force = (column[::THIN] for column in columns(file))
    inputs = {"position": position, "rate": rate, "pressure": pressure, "dry": dry_n, "direction": direction(rate)}
    return Recording(file.stem, (Signal("force", "N", time_s, force, noise_n),), inputs)


def run(folder: Path) -> Diagnosis:
    """Diagnose the runs at all four pressures; friction at 1 bar is taken as known."""
    friction = np.array([[friction_n(file) for file in reruns(folder, bar)] for bar in PRESSURES_BAR])
    spread_n = float(np.sqrt(friction.var(axis=1, ddof=1).mean()))
    scatter = (Nuisance("run.friction", "N", 0.0, spread_n, "three runs at each pressure"),)
    problem = Problem(simulate, LIBRARY, scatter, CONSTANTS, bin_s=lambda _: BIN_S)
    files = [file for bar in PRESSURES_BAR for file in reruns(folder, bar)]
    # It lasts for longer than a bin, so that means over a bin have all of it.
    noise_n = float(np.sqrt(PER_BIN) * np.mean([stroke_noise_n(file) for file in files]))
    runs = [load(file, float(friction[0].mean()), noise_n) for file in files]
    return diagnose(runs, problem, jobs=1)


if __name__ == "__main__":
    found = run(Path(sys.argv[1]))
    print(found.verdict.value, *found.reasons, sep="\n")
    for effect in found.effects:
        for parameter in effect.parameters:
            low, high = parameter.interval
            print(f"{effect.name}: {parameter.value:.3g} {parameter.unit} ({low:.3g} to {high:.3g})")
    for names, probability in found.posterior.items():
        print(f"{probability:8.3f}  {' + '.join(names) or 'none of them'}")
