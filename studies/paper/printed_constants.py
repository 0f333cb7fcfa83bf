"""The paper's own gap: its tendon model with the constants as printed, against the means of its tensile table.

Only the peak of each row is printed, with its standard error: nine numbers. The diagnosis works on runs, so each row is
handed over as a run that holds its mean, in one block of time: it counts as one sample, not as many.
Forces are in standard errors of their own row, as these differ a hundredfold and a signal has one noise.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares  # type: ignore[import-untyped]  # carries no types

from jammkle_gap import Constants, Effect, EffectParameter, Library, Problem, Recording, Signal, diagnose
from jammkle_sim.physics.constants import TENDON_SETS, TendonParameters
from studies.paper.reference import row_peak_n
from studies.paper.tables import TENSILE_ROWS as ROWS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap import Diagnosis
    from studies.paper.tables import PaperRow

UNJAMMED = tuple(row for row in ROWS if row.vacuum_pa == 0.0)
PRINTED = TENDON_SETS["as_printed"]
SPECTRUM = TENDON_SETS["fitted"].relaxation_gains
"""Gains of the relaxation that is offered, up to a common factor: fitted to the drop test, not to these rows."""
PA_PER_MPA, PA_PER_KPA = 1e6, 1e3
SAMPLES, PULL_S, BIN_S = 17, 4.0, 0.5
"""What one row is handed over as: so many times its mean over the time of a pull."""
STEP_PER_DEVIATION = 12.0**0.5
"""Resolution whose error has a standard deviation of 1. No average removes it, unlike noise."""


def _effect(
    name: str, part: str, parameter: str, unit: str, bounds: tuple[float, float, float], source: str, advice: str
) -> Effect:
    """Return an effect with one parameter, by the value at which it is off, and the least and the largest."""
    return Effect(name, part, (EffectParameter(parameter, unit, *bounds, source),), advice)


_C1, _C3, _MODULUS = (
    each / PA_PER_MPA for each in (PRINTED.fibres.c1_pa, PRINTED.fibres.c3_pa, PRINTED.fibres.modulus_pa)
)
LIBRARY = Library((
    _effect("soft_c1", "soft section", "c1", "MPa", (_C1, 0.004, 0.25),
            "a third of what is printed (assumed), to hardness: 0.23 MPa at Shore A-35 by Gent's relation",
            "The first Yeoh constant of Shore A-30 is misprinted: stretch a bar of it by a tenth."),
    _effect("soft_c3", "soft section", "c3", "MPa", (_C3, 0.0, 0.062), "assumed: up to ten times what is printed",
            "The third Yeoh constant of Shore A-30 is misprinted: stretch a bar of it to twice its length."),
    _effect("stiff_modulus", "stiff section", "modulus", "MPa", (_MODULUS, 3.0, 14.0),
            "under half of what is printed (assumed), to hardness: 13.2 MPa at Shore A-85 by Gent's relation",
            "The modulus of Shore A-85 is misprinted: stretch a bar of it."),
    _effect("relaxation", "both sections", "share", "1", (0.0, 0.0, 2.0),
            "assumed: up to twice what fits the drop test",
            "The material relaxes, and the constants are long-term ones: pull ten times slower."),
    _effect("friction_scale", "jamming", "scale", "1", (1.0, 0.0, 2.0), "assumed: none to twice what is printed",
            "Fibres rub more or less than printed: measure the friction of a pair."),
    _effect("friction_onset", "jamming", "vacuum", "kPa", (0.0, 0.0, 25.0),
            "assumed: below -30 kPa, where it plainly acts",
            "Fibres touch only from some vacuum on: look at how loosely the membrane sits."),
    _effect("membrane_grip", "membrane", "grip", "N/kPa", (0.0, 0.0, 0.1), "assumed: 5 N at -50 kPa",
            "The membrane grips the fibres under vacuum: pull an evacuated membrane alone."),
    _effect("vacuum_stiffening", "membrane", "gain", "1", (0.0, 0.0, 0.5), "assumed: half as stiff again at -50 kPa",
            "Fibres stiffen under vacuum: pull a single-material tendon at several vacuums."),
    _effect("load_cell_gain", "sensing", "gain", "1", (1.0, 0.9, 1.1), "assumed: a careless calibration",
            "Hang a known weight on the load cell."),
))  # fmt: skip
NULL = {effect.key(each): each.null for effect in LIBRARY for each in effect.parameters}


def corrected(values: Mapping[str, float]) -> TendonParameters:
    """Return the printed constants with the corrections in place; without any, the printed set itself."""
    known = {**NULL, **values}
    fibres = dataclasses.replace(
        PRINTED.fibres,
        c1_pa=known["soft_c1.c1"] * PA_PER_MPA,
        c3_pa=known["soft_c3.c3"] * PA_PER_MPA,
        modulus_pa=known["stiff_modulus.modulus"] * PA_PER_MPA,
    )
    first, second, third, fourth = (known["relaxation.share"] * gain for gain in SPECTRUM)
    return dataclasses.replace(
        PRINTED,
        fibres=fibres,
        relaxation_gains=(first, second, third, fourth),
        friction_scale=known["friction_scale.scale"],
        friction_onset_pa=known["friction_onset.vacuum"] * PA_PER_KPA,
        grip_n_per_pa=known["membrane_grip.grip"] / PA_PER_KPA,
        pressure_stiffening=known["vacuum_stiffening.gain"],
    )


@dataclass(frozen=True)
class Pull:
    """A row, and what counts as its noise."""

    row: PaperRow
    noise_n: float


def simulate(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
    """Give the peak force of a row, in its noise."""
    pull: Pull = recording.inputs
    gain = {**NULL, **values}["load_cell_gain.gain"]
    peak_n = gain * row_peak_n(corrected(values), pull.row)
    return {"peak_force": np.full(SAMPLES, peak_n / pull.noise_n)}


def load(row: PaperRow, least_share: float = 0.0) -> Recording:
    """Hand a row over as a run that holds its mean, worth one sample.

    Args:
        row: The row.
        least_share: Share of the mean that counts as noise where the standard error is smaller.

    """
    noise_n = max(row.standard_error, least_share * row.mean)
    time_s = np.linspace(0.0, PULL_S, SAMPLES)
    held = np.full(SAMPLES, row.mean / noise_n)
    signal = Signal("peak_force", "noise of its row", time_s, held, resolution=STEP_PER_DEVIATION)
    return Recording(row.identifier, (signal,), Pull(row, noise_n))


def run(rows: Sequence[PaperRow] = ROWS, library: Library = LIBRARY, least_share: float = 0.0) -> Diagnosis:
    """Diagnose rows of the table."""
    problem = Problem(simulate, library, bin_s=lambda _: BIN_S)
    return diagnose([load(row, least_share) for row in rows], problem, constants=Constants(blocks=1), jobs=1)


def fitted_values(found: Diagnosis) -> dict[str, float]:
    """Return the numbers of the effects that were found, by `effect.parameter`."""
    return {f"{effect.name}.{each.name}": each.value for effect in found.effects for each in effect.parameters}


def predicted_n(row: PaperRow, rows: Sequence[PaperRow], effects: Sequence[str]) -> float:
    """Return the peak force of a row after a fit by scipy to those of other tendons and vacuums, N."""
    others = [load(each) for each in rows if (each.material, each.vacuum_pa) != (row.material, row.vacuum_pa)]
    keys = [effect.key(each) for effect in LIBRARY if effect.name in effects for each in effect.parameters]
    bounds = {effect.key(each): (each.minimum, each.maximum) for effect in LIBRARY for each in effect.parameters}

    def misses(point: NDArray[np.float64]) -> NDArray[np.float64]:
        values = dict(zip(keys, point, strict=True))
        return np.array([each.signals[0].values[0] - simulate(each, values)["peak_force"][0] for each in others])

    low, high = np.array([bounds[key] for key in keys]).T
    null = np.array([NULL[key] for key in keys])
    found = least_squares(misses, null, bounds=(low, high), x_scale=high - low, loss="soft_l1")
    return float(simulate(load(row), dict(zip(keys, found.x, strict=True)))["peak_force"][0] * row.standard_error)


def tell(found: Diagnosis, rows: Sequence[PaperRow]) -> None:
    """Print what was found, and each row: measured, printed, corrected, and predicted from the others."""
    print(found.verdict.value, *found.reasons, sep="\n")
    for effect in found.effects:
        for parameter in effect.parameters:
            low, high = parameter.interval
            print(f"{effect.name}: {parameter.value:.3g} {parameter.unit} ({low:.3g} to {high:.3g})")
    for row in rows:
        forces_n = [
            row.mean,
            *(row_peak_n(corrected(values), row) for values in ({}, fitted_values(found))),
            predicted_n(row, rows, [effect.name for effect in found.effects]),
        ]
        print(
            "{}: measured {:.1f}, printed {:.1f}, corrected {:.1f}, predicted {:.1f} N".format(
                row.identifier, *forces_n
            )
        )
    for names, probability in list(found.posterior.items())[:5]:
        print(f"{probability:8.3f}  {' + '.join(names) or 'none of them'}")


if __name__ == "__main__":
    print("All rows")
    tell(run(), ROWS)
    print("\nAll rows, noise of at least 1.5 %")
    tell(run(least_share=0.015), ROWS)
    print("\nRows without vacuum")
    tell(run(UNJAMMED), UNJAMMED)
