"""Real data: closed chambers that lose pressure. Do they leak, or does the gas that was let in only cool down?

Measured by others: see data/README.md beside the recordings. Gross leaks are named; in tight chambers a small leak and
a cooling gas fit alike, and the answer is one of the two. No two chambers were recorded twice, so that scatter is what
three runs of another one differ by.
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

CHAMBERS = ("Aluminium", "Formlabs", "Prusa", "Ultimaker_006", "Ultimaker_010", "Ultimaker_015", "Ultimaker_020")
START_SAMPLES = 20
BIN_S, PER_BIN = 1.0, 10
LIBRARY = Library(
    (
        Effect(
            "leak",
            "chamber",
            (
                EffectParameter("rate", "1/s", 0.0, 0.0, 0.3, "assumed: empty within seconds"),
                EffectParameter(
                    "start", "s", 0.0, 0.0, 12.0, "assumed: the supply is shut off within the first seconds"
                ),
            ),
            "The chamber leaks: check walls and push-fits.",
        ),
        Effect(
            "cooling",
            "chamber",
            (
                EffectParameter("share", "1", 0.0, 0.0, 0.05, "assumed: 15 K of 300 K"),
                EffectParameter("time", "s", 20.0, 5.0, 200.0, "assumed: walls of plastic take up to minutes"),
            ),
            "The gas cools down after filling: wait before you measure.",
        ),
    )
)


def simulate(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
    """Give the pressure of a chamber that was filled and shut, mbar."""
    time_s = recording.signal("pressure").time_s
    open_s = np.maximum(time_s - values.get("leak.start", 0.0), 0.0)
    cooled = 1.0 - np.exp(-time_s / values.get("cooling.time", 20.0))
    left = np.exp(-values.get("leak.rate", 0.0) * open_s) * (1.0 - values.get("cooling.share", 0.0) * cooled)
    read = values.get("reading.offset", 0.0) + values.get("reading.drift", 0.0) * (time_s / time_s[-1] - 0.5)
    return {"pressure": recording.inputs * left + read}


def load(folder: Path, name: str, noise_mbar: float) -> Recording:
    """Read one chamber; some of its times carry a stray point."""
    rows = [line.split(";") for line in (folder / f"{name}.csv").read_text().splitlines() if line.count(";") == 2]
    time_s = np.array([float("".join(row[0].split(".")[:-1])) / 1000.0 for row in rows])
    pressure_mbar = np.array([1000.0 * float(row[2]) for row in rows])
    rising = np.concatenate([[True], np.diff(np.maximum.accumulate(time_s)) > 0.0])
    time_s, pressure_mbar = time_s[rising] - time_s[0], pressure_mbar[rising]
    signal = Signal("pressure", "mbar", time_s, pressure_mbar, noise_mbar)
    return Recording(name, (signal,), float(pressure_mbar[:START_SAMPLES].mean()))


def scatter(folder: Path) -> tuple[float, tuple[Nuisance, ...]]:
    """Return how far three runs of one chamber differ, mbar: from sample to sample, in their mean, and in their drift.

    Means over a bin differ by more than white noise would, so noise is given as what makes them differ as much.
    """
    lines = (folder / "Resultaten_opnieuwaanzetten.csv").read_text(encoding="latin-1").splitlines()[1:]
    cells = [line.split(";")[1:4] for line in lines if line.strip(";")]
    runs = np.array([[float(cell.replace(",", ".")) for cell in row] for row in cells])
    runs = runs[: len(runs) // PER_BIN * PER_BIN].reshape(-1, PER_BIN, 3).mean(axis=1)
    share = np.linspace(-0.5, 0.5, len(runs))
    lines_fitted = np.polyfit(share, runs, 1)
    drift, offset = lines_fitted.std(axis=1, ddof=1).tolist()
    rest = runs - np.outer(share, lines_fitted[0]) - lines_fitted[1]
    noise = float(np.sqrt(PER_BIN * rest.var(axis=1, ddof=1).mean()))
    source = "three runs of one chamber"
    return noise, (
        Nuisance("reading.offset", "mbar", 0.0, offset, source),
        Nuisance("reading.drift", "mbar", 0.0, drift, source),
    )


def run(folder: Path, name: str) -> Diagnosis:
    """Diagnose one chamber."""
    noise_mbar, nuisances = scatter(folder)
    problem = Problem(simulate, LIBRARY, nuisances, bin_s=lambda _: BIN_S)
    return diagnose([load(folder, name, noise_mbar)], problem, jobs=1)


if __name__ == "__main__":
    for chamber in CHAMBERS:
        found = run(Path(sys.argv[1]), chamber)
        names = [" + ".join(each.names) or "nothing" for each in found.candidates]
        print(f"{chamber}: {found.verdict.value}: {' or '.join(names)}; {'; '.join(found.reasons)}")
