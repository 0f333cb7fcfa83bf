"""The diagnosis: what is said of a gap, and its JSON."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class Verdict(Enum):
    """What a diagnosis says."""

    NO_GAP = "NO_GAP"
    """Simulation and recordings agree within scatter and the tolerances of the machine's constants."""
    EFFECTS = "EFFECTS"
    """One effect or combination, or one equivalence class, holds the stated probability."""
    AMBIGUOUS = "AMBIGUOUS"
    """Several share it: the credible set."""
    UNKNOWN = "UNKNOWN"
    """There is a gap, and most likely none of the effects on offer causes it."""


@dataclass(frozen=True)
class FittedParameter:
    """One number of an effect."""

    name: str
    unit: str
    value: float
    interval: tuple[float, float]
    """90 % interval."""
    at_bound: bool
    """Whether it ended at a bound, where the truth may lie outside."""
    detectable: float
    """Smallest value on this side of null that an ideal diagnosis would detect with these recordings; NaN: none."""
    is_cut: bool = False
    """Whether the interval ends at a bound, beyond which it would go on."""


@dataclass(frozen=True)
class FittedEffect:
    """One effect of a candidate."""

    name: str
    subsystem: str
    sentence: str
    parameters: tuple[FittedParameter, ...]


@dataclass(frozen=True)
class Candidate:
    """A possible cause: one effect, or several."""

    names: tuple[str, ...]
    """Empty: none of the effects on offer."""
    probability: float
    """Of its whole equivalence class, given all that was said of the prior, and that there is a gap."""
    explained: float
    """Share that it explains of the squared whitened difference; without references, of what the constants leave."""
    effects: tuple[FittedEffect, ...]
    equivalents: tuple[str, ...] = ()
    """Effects that these sensors cannot tell from it, whatever the data."""


@dataclass(frozen=True)
class Place:
    """A part of the gap."""

    signal: str
    phase: str
    share: float
    """Of the squared whitened difference."""
    interval: tuple[float, float]
    """90 % interval from resampled blocks of time."""
    gap: float
    """Root mean square there; 1: healthy scatter."""


@dataclass(frozen=True)
class SignalGap:
    """How far one signal is off, and is left off."""

    signal: str
    unit: str
    nominal: float
    """Root mean square of the difference, in healthy scatter."""
    corrected: float
    """The same with the effect in it, as fitted to all runs."""
    nominal_physical: float
    """Root mean square of the difference, in the signal's unit."""
    corrected_physical: float
    scatter_physical: float
    """What healthy runs differ by, in the signal's unit."""


@dataclass(frozen=True)
class Closing:
    """How far a gap closes on data that the effect was not fitted to; 1 is healthy scatter."""

    nominal: float
    corrected: float
    closed: float
    """1 - (corrected - 1) / (nominal - 1); NaN where there is no gap."""
    interval: tuple[float, float]
    """90 % interval from resampled blocks of time."""


@dataclass(frozen=True)
class HeldOutSetting:
    """How far the gap closes in a setting that was not fitted."""

    setting: str
    closing: Closing


@dataclass(frozen=True)
class Trace:
    """One signal of one setting in the features that the decision was made on."""

    setting: str
    signal: str
    unit: str
    time_s: NDArray[np.float64] = field(repr=False)
    difference: NDArray[np.float64] = field(repr=False)
    """Faulty runs less references, both less what the simulator says."""
    scatter: NDArray[np.float64] = field(repr=False)
    """Standard deviation of the difference for a healthy machine."""
    signature: NDArray[np.float64] = field(repr=False)
    """What the best candidate makes of it; 0 without one."""
    measured: NDArray[np.float64] = field(repr=False)
    """Mean of the faulty runs."""
    simulated: NDArray[np.float64] = field(repr=False)
    """Nominal simulator, calibrated to the references."""


@dataclass(frozen=True)
class FittedConstant:
    """One constant of the machine, fitted together with the best candidate."""

    name: str
    unit: str
    value: float
    nominal: float
    deviations: float
    """From nominal, in standard deviations of its tolerance."""
    interval: tuple[float, float]
    """90 % interval, in `unit`."""
    is_cut: bool = False
    """Whether it ends at a bound, beyond which it would go on."""


_FAR = 3.0
"""Standard deviations from which on a constant is said to lie beyond its tolerance."""


def beyond(constants: Sequence[FittedConstant]) -> list[FittedConstant]:
    """Return the constants that lie beyond their tolerance."""
    return [each for each in constants if abs(each.deviations) > _FAR]


@dataclass(frozen=True)
class LedgerEntry:
    """What one part closes of the gap, on recordings that it was not fitted to."""

    part: str
    """Constants of the machine, an effect, or what is left."""
    share: float
    """Of the gap above scatter; all shares add up to 1. What overlaps is split by Shapley's value."""
    gap: float
    """Gap with this part alone in the simulator; of what is left: with all of them."""


@dataclass(frozen=True)
class NextExperiment:
    """What to record next, to split the credible set."""

    name: str
    """The command that makes it, without `jammkle`."""
    lasts_s: float
    signal: str
    """Where the two candidates that are hardest to tell apart differ most."""
    difference: float
    """Root mean square between them there, in the noise of the sensor and the accuracy of the simulator."""
    difference_physical: float
    unit: str
    sentence: str


@dataclass(frozen=True)
class Spent:
    """What a diagnosis took."""

    wall_s: float
    runs: int
    simulated_s: float


@dataclass(frozen=True)
class Diagnosis:
    """What was found."""

    verdict: Verdict
    reasons: tuple[str, ...]
    candidates: tuple[Candidate, ...]
    """The credible set, most probable first; empty without a gap. With UNKNOWN the first is none of the effects, and
    what follows are leads."""
    posterior: Mapping[tuple[str, ...], float]
    """Probability of every candidate, and of none of them, (), given a gap; largest first."""
    gap_probability: float
    """That there is a gap."""
    p_value: float
    """Of the test for a gap."""
    false_alarm_rate: float
    """That the test was made at."""
    where: tuple[Place, ...]
    """Largest share first."""
    subsystems: Mapping[str, float]
    """Probability of each subsystem to hold the cause; largest first."""
    gap: Closing
    signals: tuple[SignalGap, ...]
    held_out: tuple[HeldOutSetting, ...]
    classes: tuple[tuple[str, ...], ...]
    """Effects that these recordings cannot tell apart at all."""
    silent: tuple[str, ...]
    """Effects that move nothing in these recordings, and so cannot be seen."""
    calibration: Mapping[str, float]
    """Constants of the machine that its references moved by more than a standard deviation of their prior, in such."""
    references_left: float
    """What the calibrated simulator leaves of the references per feature, in their scatter's variance; NaN: none."""
    traces: tuple[Trace, ...]
    next_experiment: NextExperiment | None
    notes: tuple[str, ...]
    spent: Spent
    finished: bool = True
    """False if it was stopped on the way: provisional."""
    constants: tuple[FittedConstant, ...] = ()
    """Of the machine, as fitted together with the best candidate where references are missing; those that moved by
    most of their tolerance first."""
    ledger: tuple[LedgerEntry, ...] = ()
    """Constants, effects of the best candidate, and what is left; empty where there are references."""

    @property
    def effects(self) -> tuple[FittedEffect, ...]:
        """Of the most probable candidate that names any."""
        for each in self.candidates:
            if each.names:
                return each.effects
        return ()


def as_dict(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return the diagnosis as what JSON can hold; gaps are in healthy scatter, intervals are 90 %."""
    plain = _plain(diagnosis)
    return {
        **{name: plain[name] for name in _AS_THEY_ARE},
        "effects": [_effect(each) for each in diagnosis.effects],
        "set": [
            {**_plain(each), "effects": [_effect(effect) for effect in each.effects]} for each in diagnosis.candidates
        ],
        "posterior": [
            {"names": list(names), "probability": _plain(value)} for names, value in diagnosis.posterior.items()
        ],
        "gap": {
            **plain["gap"],
            "signals": _by(plain["signals"], "signal"),
            "held_out": [{"setting": each["setting"], **each["closing"]} for each in plain["held_out"]],
        },
        "constants": _by(plain["constants"], "name"),
        "runtime": {
            "wall_s": diagnosis.spent.wall_s,
            "simulator_runs": diagnosis.spent.runs,
            "simulated_s": diagnosis.spent.simulated_s,
        },
    }


_AS_THEY_ARE = (
    "verdict", "reasons", "gap_probability", "p_value", "false_alarm_rate", "where", "subsystems", "classes", "silent",
    "calibration", "ledger", "references_left", "next_experiment", "notes", "finished",
)  # fmt: skip


def _plain(value: Any) -> Any:
    """Return what JSON can hold: fields of dataclasses by name, and None for numbers that JSON has not."""
    if dataclasses.is_dataclass(value):
        return {each.name: _plain(getattr(value, each.name)) for each in dataclasses.fields(value)}
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Mapping):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(each) for each in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value


def _by(rows: list[dict[str, Any]], key: str) -> dict[str, dict[str, Any]]:
    """Return rows by one of their fields."""
    return {row[key]: {name: value for name, value in row.items() if name != key} for row in rows}


def _effect(effect: FittedEffect) -> dict[str, Any]:
    parameters = _by([_plain(each) for each in effect.parameters], "name")
    return {
        "name": effect.name,
        "subsystem": effect.subsystem,
        "check": effect.sentence,
        "parameters": parameters,
    }
