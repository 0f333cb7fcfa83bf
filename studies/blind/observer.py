"""The ideal observer: it has the second simulator's equations and faults, and knows tolerances but not the specimen.

It compares two explanations of the same recordings by their likelihood ratio (Neyman and Pearson 1933). Both are
normal: signatures are simulated with the machine as drawn, and what specimens, days and sensors add has one covariance.
The best rival has the size that suits it best. Where signatures lie d standard deviations apart, the wrong one is
likelier with a probability of Phi(-d / 2).
"""

from __future__ import annotations

import dataclasses
import hashlib
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import joblib  # type: ignore[import-untyped]  # carries no types
import numpy as np
from scipy.stats import norm  # type: ignore[import-untyped]  # carries no types

from jammkle_gap import Whitener, features_of, layout_of, measured
from studies.blind import reality
from studies.blind.reality import landing
from studies.blind.reality.faults import FAULTS, FaultSetting, with_faults
from studies.blind.reality.machine import STILL, Machine
from studies.blind.reality.run import RIGS
from studies.blind.reality.sensors import Plan
from studies.blind.reality.specimen import machine as specimen
from studies.blind.signals import DAY, built, recording_of_real

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap import Layout, Recording
    from studies.blind.reality.faults import Fault
    from studies.blind.reality.sensors import Option

    Floats = NDArray[np.float64]

EXERCISES: Final = tuple(Plan(name, {}) for name in ("cycle", "press", "shake", "tilt"))
LANDINGS: Final = (
    Plan("landing", {}),
    Plan("landing", {"jam": "before"}),
    Plan("landing", {"jam": "never", "slope_deg": 15.0}),
)
"""What a robot brings back from the field. Chosen: jammed at the blow, before it, and not at all on gentler ground."""
REPEATS: Final = 3
"""Of every run; the least that shows what differs from one to the next."""
NAMEABLE: Final = float(2.0 * norm.ppf(0.99))
"""Standard deviations to the best rival from which on the observer names an effect with 99 %."""
_SPECIMENS = 60
"""Chosen: more than a specimen has constants."""
_BIN_S = 0.02
_RIVAL_SHARE = 0.3
"""Of its range at which a rival is simulated; its signature is taken to grow in proportion. Chosen: the middle of the
sizes in a trial."""
_UNSEEN = ("load_cell", "late_load_cell", "rail", "dented_rail", "cable")
"""Beginnings of the names of faults that are on no robot: there is no load cell and no rail."""
_MOVED = ("press", "shake")
"""Exercises whose IMU says how the shank was moved, and is no answer of the foot."""


class Observer:
    """Knows what every fault makes of what is recorded, and how much of that tolerances and days could make as well."""

    def __init__(
        self,
        folder: Path,
        plans: Sequence[Plan] = EXERCISES,
        faults: Mapping[str, Fault] = FAULTS,
        specimens: int = _SPECIMENS,
    ) -> None:
        """Simulate, or read what was simulated before.

        Args:
            folder: Where simulations are kept.
            plans: What is recorded.
            faults: That may be there.
            specimens: Drawn, for the covariance of the tolerances.

        """
        self.plans = tuple(plans)
        self._simulated = joblib.Memory(folder / _version(), verbose=0).cache(_features)
        self.faults = {name: fault for name, fault in faults.items() if not name.startswith(_UNSEEN)}
        self._nominal = self._of()
        self._whiten = self._whitener(specimens)
        ends = [(fault, each) for fault in self.faults.values() for each in _ends(fault)]
        self._signatures = self._whiten(np.array(self._all([{"wrong": (each,)} for _, each in ends])) - self._nominal)
        self._gram = self._signatures @ self._signatures.T
        self._rows = {name: [row for row, (fault, _) in enumerate(ends) if fault.name == name] for name in self.faults}

    @cached_property
    def reach(self) -> dict[str, float]:
        """Distance of every fault from its best rival at the end of its range, of those that are nameable there."""
        found = {
            name: max(self._least(self._signatures[row], {fault.effect}) for row in self._rows[name]) / _RIVAL_SHARE
            for name, fault in self.faults.items()
        }
        return {name: each for name, each in found.items() if each >= NAMEABLE}

    def distances(self, wrong: Sequence[FaultSetting]) -> dict[str, float]:
        """Return for every fault of a machine how far the best explanation without it stays away, by its name.

        In standard deviations. The others of the machine are known; explanations are all effects of the library.
        """
        whole = self._whiten(self._of(wrong=tuple(wrong)) - self._nominal)
        found = {}
        for each in wrong:
            others = tuple(other for other in wrong if other is not each)
            own = whole - self._whiten(self._of(wrong=others) - self._nominal)
            found[each.fault] = self._least(own, {FAULTS[one.fault].effect for one in wrong})
        return found

    def _least(self, signature: Floats, without: Collection[str | None]) -> float:
        """Return the length of what the best of the library's effects but some, of any size, leaves of a signature."""
        overlap, squared = self._signatures @ signature, float(signature @ signature)
        least = squared
        for name, rows in self._rows.items():
            if self.faults[name].effect not in {None, *without}:
                gram = self._gram[np.ix_(rows, rows)]
                shares = np.linalg.lstsq(gram, overlap[rows], rcond=1e-9)[0]
                least = min(least, squared - float(overlap[rows] @ shares))
        return float(np.sqrt(max(least, 0.0)))

    def _of(self, **case: Any) -> Floats:
        """Return the features of all that is recorded, of `_features`."""
        return np.concatenate([self._simulated(plan, **case) for plan in self.plans])

    def _all(self, cases: Sequence[Mapping[str, Any]]) -> list[Floats]:
        """Return the features of several cases, simulated side by side."""
        return list(joblib.Parallel(n_jobs=-1)(joblib.delayed(self._of)(**case) for case in cases))

    def _whitener(self, specimens: int) -> Whitener:
        """Return what whitens by sensors and days, as the mean of repeats has them, and by the tolerances."""
        floor = np.concatenate([_floor(plan) for plan in self.plans])
        deviations = [(each.name, each.sigma) for each in DAY]
        if any(plan.rig == "landing" for plan in self.plans):
            deviations += landing.RUNS.items()
        days = np.array(self._all([{"day": each} for each in deviations]))
        drawn = np.array(self._all([{"seed": seed} for seed in range(1, specimens + 1)]))
        tolerance = (drawn - drawn.mean(axis=0)) / np.sqrt(specimens - 1)
        return Whitener(np.square(floor) / REPEATS, np.vstack([(days - self._nominal) / np.sqrt(REPEATS), tolerance]).T)


def _ends(fault: Fault) -> list[FaultSetting]:
    """Return a fault some way to each bound of each of its parameters."""
    null = {key: row.null for key, row in fault.parameters.items()}
    return [
        FaultSetting(fault.name, {**null, key: row.null + _RIVAL_SHARE * (bound - row.null)})
        for key, row in fault.parameters.items()
        for bound in (row.minimum, row.maximum)
        if bound != row.null
    ]


def _features(
    plan: Plan, seed: int | None = None, wrong: Sequence[FaultSetting] = (), day: tuple[str, float] | None = None
) -> Floats:
    """Return the features of a run without noise.

    Args:
        plan: What is recorded.
        seed: Of the specimen; None: the machine as drawn.
        wrong: What is wrong with it.
        day: A deviation by its name in `DAY`, of the machine as drawn, or in `landing.RUNS`, of the plan; None: none.

    """
    machine, done = Machine() if seed is None else specimen(seed), plan
    if day is not None and day[0] in landing.RUNS:
        if plan.rig == "landing":
            off = {day[0]: float(plan.options.get(day[0], landing.DEFAULTS[day[0]])) + day[1]}
            done = dataclasses.replace(plan, options={**plan.options, **off})
    elif day is not None:
        machine = built(dict([day]))
    run = _recorded(done, machine, wrong)
    return np.nan_to_num(features_of(_layout(plan.rig, tuple(plan.options.items())), run, measured(run), None))


@lru_cache
def _layout(rig: str, options: tuple[tuple[str, Option], ...]) -> Layout:
    return layout_of([_recorded(Plan(rig, dict(options)), Machine(), ())], _BIN_S, None)


def _floor(plan: Plan) -> Floats:
    """Return the noise of the features, that of the signals of a run with noise: one without would have none."""
    quiet = _layout(plan.rig, tuple(plan.options.items()))
    noisy = layout_of([_recorded(plan, Machine(), (), seed=1)], _BIN_S, None)
    levels = dict(zip(noisy.signals, np.median(noisy.by_signal(noisy.floor), axis=1), strict=True))
    return np.repeat([levels[name] for name in quiet.signals], quiet.bins).astype(float)


def _recorded(plan: Plan, machine: Machine, wrong: Sequence[FaultSetting], seed: int = STILL) -> Recording:
    """Return a run as a robot's sensors read it, without chance unless it has a seed."""
    run = recording_of_real(RIGS[plan.rig](plan, with_faults(machine, wrong), seed), plan.rig)
    hidden = ("carriage/", "imu/") if plan.rig in _MOVED else ("carriage/",)
    return dataclasses.replace(run, signals=tuple(each for each in run.signals if not each.name.startswith(hidden)))


def _version() -> str:
    """Return what tells the second simulator from its other versions."""
    digest = hashlib.blake2b(digest_size=8)
    for file in sorted(Path(next(iter(reality.__path__))).glob("*.py")):
        digest.update(file.name.encode() + file.read_bytes())
    return digest.hexdigest()
