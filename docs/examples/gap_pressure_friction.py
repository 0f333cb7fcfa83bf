"""Real data: a piston with an O-ring is stroked at four pressures. Its friction grows with pressure.

Measured by others: see data/README.md beside the recordings. The simulator has the piston's area and a dry friction,
as they are at 1 bar; noise is how far reruns of the same setting differ.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.november.diagnosis import Diagnosis, diagnose
from jammkle_gap.november.effect import Effect, EffectParameter, Library
from jammkle_gap.november.recording import Recording, Signal

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

PRESSURES_BAR = (1, 3, 5, 7)
SMOOTH = 11
"""Samples that position is smoothed over before it is differentiated."""
THIN = 5
"""Every so many samples are compared: 20 Hz."""
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
CALIBRATION = Library(
    (
        Effect(
            "area",
            "piston",
            (EffectParameter("force_per_bar", "N/bar", FORCE_N_BAR, 48.0, 56.0, "assumed"),),
            "The piston's area, and the load cell's gain with it.",
        ),
        Effect(
            "load_cell_offset",
            "sensing",
            (EffectParameter("force", "N", 0.0, -5.0, 5.0, "assumed"),),
            "Zero the load cell.",
        ),
    )
)


def simulate(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
    """Give the force that strokes the piston, N."""
    inputs = recording.inputs
    pressure, rate = inputs["pressure"], inputs["rate"]
    rub = inputs["dry"] + values.get("dry_friction.more", 0.0)
    rub = rub + values.get("pressure_friction.per_bar", 0.0) * (pressure - PRESSURES_BAR[0])
    side = turned(inputs["direction"], inputs["position"], values.get("presliding.length", 0.0))
    force = values.get("area.force_per_bar", FORCE_N_BAR) * pressure + rub * side
    force += values.get("viscous_friction.coefficient", 0.0) * rate + values.get("load_cell_offset.force", 0.0)
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


def rerun_noise_n(folder: Path) -> float:
    """Return how far the friction of reruns of the same setting differs, N."""
    spreads = [
        np.var([friction_n(folder / "rerun" / f"{k}_O-ring257_{bar}bar.csv") for k in (1, 2, 3)], ddof=1)
        for bar in PRESSURES_BAR
    ]
    return float(np.sqrt(np.mean(spreads)))


def direction(rate_mm_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sign of the motion, or of the last one."""
    moving = np.abs(rate_mm_s) > SLOW_MM_S
    last = np.maximum.accumulate(np.where(moving, np.arange(rate_mm_s.size), np.argmax(moving)))
    return np.sign(rate_mm_s[last])


def load(file: Path, bar: int, dry_n: float, noise_n: float) -> Recording:
    """Read one run."""
    time_s, position, rate, pressure, force = (column[::THIN] for column in columns(file))
    inputs = {"position": position, "rate": rate, "pressure": pressure, "dry": dry_n, "direction": direction(rate)}
    return Recording(file.stem, (Signal("force", "N", time_s, force, noise_n),), inputs, regime=f"{bar} bar")


def run(folder: Path, parts: Sequence[str] = ("O-ring257_{}bar.csv",)) -> Diagnosis:
    """Diagnose the runs at all four pressures; friction at 1 bar is taken as known."""
    noise_n = rerun_noise_n(folder)
    files = [(bar, folder / part.format(bar)) for part in parts for bar in PRESSURES_BAR]
    dry_n = friction_n(files[0][1])
    recordings = [load(file, bar, dry_n, noise_n) for bar, file in files]
    return diagnose(recordings, simulate, LIBRARY, calibration=CALIBRATION)


if __name__ == "__main__":
    found = run(Path(sys.argv[1]))
    print(found.verdict.value, *found.reasons, sep="\n")
    for effect in found.effects:
        for parameter in effect.parameters:
            low, high = parameter.interval
            print(f"{effect.name}: {parameter.value:.3g} {parameter.unit} ({low:.3g} to {high:.3g})")
    for names, nats in found.ranking:
        print(f"{nats:8.1f} nats  {' + '.join(names) or 'no effect'}")
