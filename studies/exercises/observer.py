"""An ideal observer: it knows the simulator, the tolerances of machine and run, and the noise, but not the specimen.

Features y of a run differ from the nominal by a signature s(e) of an effect, by constants of the machine c within their
tolerances, by scatter of the run r, and by noise: y = s(e) + C c + R r + n. With constants and scatter marginalised the
covariance is D + C C' + R R', columns scaled to one standard deviation; D also holds what random runs scatter
beside R, so that nothing is read from a bounce that no two runs share. Lengths are those of the whitened
signatures. What the best single rival leaves of an effect is its distance from the span of the rival's signatures,
whatever their size (T-optimality: Atkinson and Fedorov, 1975). From 4.65 on an observer that decides between the two
errs either way in 1 of 100.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from joblib import Parallel, delayed  # type: ignore[import-untyped]  # carries no types
from scipy.linalg import block_diag  # type: ignore[import-untyped]  # carries no types

from jammkle_common.parameters import from_mapping
from jammkle_gap import InfeasibleError, ankle_problem, features_of, layout_of, quantity_of, recording_of_run
from jammkle_sim.rigs.catalogue import rig_kind, run_rig

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap import Effect, Nuisance, Problem, Recording

    Floats = NDArray[np.float64]

NAMEABLE = 4.65
"""Distance from which on either error is below 1 %: twice the 99th percentile of a normal number."""
SIZES: dict[str, float] = {
    "payload.mass_kg": 0.2,
    "ankle_joint_friction.coulomb_n_m": 0.02,
    "ankle_joint_friction.viscous_n_m_s": 0.02,
    "floor_friction.scale": 0.7,
    "floor_compliance.give_m_n": 1e-4,
    "backlash.play_m": 5e-4,
    "line_leak.conductance_dm3_s_bar": 1e-3,
    "pump_wear.flow_scale": 0.7,
    "pump_wear.vacuum_scale": 0.85,
    "valve_dead_time.extra_s": 0.02,
    "line_restriction.conductance_scale": 0.5,
    "trapped_volume.volume_m3": 3e-6,
    "long_hose.length_m": 1.0,
    "pressure_sensor_offset.offset_pa": 1000.0,
    "imu_offset.x_m_s2": 1.0,
    "imu_offset.y_m_s2": 1.0,
    "imu_offset.z_m_s2": 1.0,
    "gyro_offset.x_rad_s": 0.05,
    "gyro_offset.y_rad_s": 0.05,
    "gyro_offset.z_rad_s": 0.05,
    "imu_misalignment.roll_rad": 0.1,
    "imu_misalignment.pitch_rad": 0.1,
    "imu_misalignment.yaw_rad": 0.1,
    "imu_saturation.range_scale": 0.3,
    "command_delay.delay_s": 0.05,
    "sensor_delay.delay_s": 0.02,
    "pressure_delay.delay_s": 0.02,
    "imu_delay.delay_s": 0.02,
    "joint_delay.delay_s": 0.02,
    "load_cell_delay.delay_s": 0.02,
    "clock_skew.skew": 0.005,
    "load_cell_gain.gain": 1.05,
    "viscoelasticity.gain_scale": 1.5,
    "viscoelasticity.time_scale": 2.0,
    "jamming_friction.scale": 0.6,
    "tendon_stiffness.scale": 0.7,
    "membrane_stiffness.stiffness_n_m": 60.0,
    "pretension.extension_m": 0.002,
    "softening.loss": 0.3,
    "fibre_loss.lost": 0.3,
    "tendon_failure.remaining": 0.5,
}
"""Size at which each effect is looked for, by `family.parameter`: three to five of the standard deviations that
builders leave of the same, or what a technician would mend. Its first parameter here is what it is measured by; as a
rival it may have any of all."""
_SCATTERED = 12
"""Runs that scatter is drawn for. Chosen: their variance is known to a third."""


@dataclass(frozen=True)
class Seen:
    """One kind of run, as the observer sees it; all in standard deviations of the noise."""

    name: str
    lasts_s: float
    quantities: NDArray[np.str_]
    """What each feature is of, such as `angle`, shape (features,)."""
    signatures: Mapping[str, Floats]
    """By effect, shape (parameters, features)."""
    constants: Floats
    """One row for a standard deviation of each constant of the machine, shape (constants, features)."""
    scatter: Floats
    """The same of what no two runs have the same."""
    rest: Floats
    """Variance of each feature that scatter leaves in its runs beside the rows above, shape (features,): where contact
    makes much of little, no straight line follows it."""

    def of(self, name: str, quantities: Collection[str]) -> Seen:
        """Return what is seen with some sensors alone."""
        kept = np.isin(self.quantities, list(quantities))
        signatures = {effect: rows[:, kept] for effect, rows in self.signatures.items()}
        shapes = (self.quantities[kept], signatures, self.constants[:, kept], self.scatter[:, kept], self.rest[kept])
        return Seen(name, self.lasts_s, *shapes)


def nominal(rig: str, options: Mapping[str, object]) -> Recording:
    """Return the recording of a run with nothing wrong."""
    table = rig_kind(rig).options
    return recording_of_run(run_rig(rig, from_mapping(table, dict(options)), lambda _: None, lambda: False))


def seen(name: str, recording: Recording, jobs: int = 1) -> Seen:
    """Return what an observer with all sensors of a rig, but for those of the tendons, sees of a kind of run.

    Args:
        name: For tables.
        recording: Of a run with nothing wrong.
        jobs: Processes.

    """
    problem = ankle_problem()
    signals = tuple(each for each in recording.signals if quantity_of(each.name) not in {"tension", "extension"})
    chosen = dataclasses.replace(recording, signals=signals)
    effects = {effect.name: _asked(effect) for effect in problem.library}
    drawn = np.random.default_rng(0).standard_normal((_SCATTERED, len(problem.scatter)))
    values: list[Mapping[str, float]] = [{}]
    values += [{key: value} for asked in effects.values() for key, value in asked]
    values += [_drawn((each,), (1.0,)) for each in (*problem.constants, *problem.scatter)]
    values += [_drawn(problem.scatter, row.tolist()) for row in drawn]
    made = Parallel(n_jobs=jobs)(delayed(_features)(problem, chosen, each) for each in values)
    layout = layout_of([chosen], problem.bin_s(chosen), problem.alignment)
    kept = np.isfinite(made[0])
    white = ((np.array(made) - made[0]) / layout.floor)[1:, kept]
    rows = iter(np.nan_to_num(white))  # what cannot be run so, or has no such event, shows nothing
    signatures = {effect: np.array([next(rows) for _ in asked]) for effect, asked in effects.items()}
    constants, scatter, runs = (
        np.array([next(rows) for _ in range(count)])
        for count in (len(problem.constants), len(problem.scatter), _SCATTERED)
    )
    rest = np.square(runs - drawn @ scatter).mean(axis=0)
    of_bins = [quantity_of(signal) for signal in layout.signals for _ in range(layout.bins)]
    quantities = np.array([*of_bins, *(["event"] * len(layout.event_s))])[kept]
    return Seen(name, max(float(each.time_s[-1]) for each in signals), quantities, signatures, constants, scatter, rest)


def together(name: str, kinds: Sequence[Seen]) -> Seen:
    """Return what an observer sees of several runs of one machine."""
    signatures = {effect: np.hstack([kind.signatures[effect] for kind in kinds]) for effect in kinds[0].signatures}
    return Seen(
        name,
        sum(kind.lasts_s for kind in kinds),
        np.concatenate([kind.quantities for kind in kinds]),
        signatures,
        np.hstack([kind.constants for kind in kinds]),
        block_diag(*(kind.scatter for kind in kinds)),
        np.concatenate([kind.rest for kind in kinds]),
    )


@dataclass(frozen=True)
class Lengths:
    """What an observer makes of every effect at its stated size."""

    effects: tuple[str, ...]
    length: Floats
    """Against nothing wrong, standard deviations, shape (effects,)."""
    left: Floats
    """What each rival, at its best, leaves of each effect, shape (effects, rivals); infinite of itself."""

    @property
    def separated(self) -> NDArray[np.bool_]:
        """Which pairs are distinguished whichever of the two is true, shape (effects, effects)."""
        apart: NDArray[np.bool_] = (self.left >= NAMEABLE) & (self.left.T >= NAMEABLE)
        return apart

    @property
    def pairs(self) -> int:
        """How many pairs are distinguished."""
        return int(np.triu(self.separated, 1).sum())

    @property
    def seen(self) -> int:
        """How many effects are distinguished from nothing wrong."""
        return int((self.length >= NAMEABLE).sum())


def lengths(kind: Seen, *, tolerances: bool = True) -> Lengths:
    """Return lengths and distances of all effects.

    Args:
        kind: What is seen.
        tolerances: Whether machine and run are known within their tolerances alone; else exactly.

    """
    local = 1.0 / np.sqrt(1.0 + kind.rest) if tolerances else np.ones(len(kind.rest))
    columns = (np.vstack((kind.constants, kind.scatter)) * local).T[:, : None if tolerances else 0]
    # (1 + U U')^(-1/2) leaves what is across U as it is, and shortens the rest by its singular values.
    basis, strength, _ = np.linalg.svd(columns, full_matrices=False)
    shrink = 1.0 - 1.0 / np.sqrt(1.0 + strength**2)
    white = {
        effect: local * rows - (local * rows @ basis * shrink) @ basis.T for effect, rows in kind.signatures.items()
    }
    effects = tuple(white)
    length = np.array([np.linalg.norm(white[effect][0]) for effect in effects])
    left = np.full((len(effects), len(effects)), np.inf)
    for j, rival in enumerate(effects):
        across = np.linalg.svd(white[rival], full_matrices=False)
        span = across[2][across[1] > 1e-6 * max(float(across[1].max()), 1e-12)]
        for i, effect in enumerate(effects):
            if i != j:
                own = white[effect][0]
                left[i, j] = np.linalg.norm(own - span.T @ (span @ own))
    return Lengths(effects, length, left)


def family_of(effect: str) -> str:
    """Return the family of an effect, by its name: that without the place where it is."""
    return next(family for family in (size.partition(".")[0] for size in SIZES) if effect.startswith(family))


def _asked(effect: Effect) -> list[tuple[str, float]]:
    """Return the parameters of an effect with their sizes, that which it is measured by first."""
    family = family_of(effect.name)
    return [
        (effect.key(each), SIZES[f"{family}.{each.name}"])
        for each in effect.parameters
        if f"{family}.{each.name}" in SIZES
    ]


def _drawn(nuisances: Sequence[Nuisance], numbers: Sequence[float]) -> dict[str, float]:
    """Return values of nuisances so many standard deviations off, within their bounds."""
    return {
        each.name: float(np.clip(each.null + each.sigma * number, each.minimum, each.maximum))
        for each, number in zip(nuisances, numbers, strict=True)
    }


def _features(problem: Problem, recording: Recording, values: Mapping[str, float]) -> Floats:
    layout = layout_of([recording], problem.bin_s(recording), problem.alignment)
    try:
        made = problem.simulator(recording, values)
    except InfeasibleError:
        return np.full(layout.size, np.nan)
    return features_of(layout, recording, made, problem.alignment)
