"""The detectors on recordings of a real foot beside a force, and what the page says of them.

The layout is that of Maravgakis et al., "Probabilistic Contact State Estimation for Legged Robots using Inertial
Information", ICRA 2023: `Fz, ax, ay, az, wx, wy, wz` in raw units, g and deg/s. Rows do not belong together: the force
was written at 500 Hz and the IMU at 250 Hz, from a begin of its own, so that the columns have different lengths.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from jammkle_common.command.results import STYLE
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_controller.core.reading import Received
from jammkle_controller.parameters import ControllerParameters
from jammkle_controller.recordings import TableFormat, read_table, replay
from studies.contact.robots import joined_contacts, spans_of
from studies.contact.trial import KINDS, OURS, WAYS, Score, median_with_interval, score_times

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from jammkle_controller.core.imu import ImuSample

FORCE_HZ, IMU_HZ = 500.0, 250.0
"""As published."""
SCORED = ("impact", "lift-off")
"""Kinds of events that the force reports of."""
LOADED_SHARE = 0.35
"""Of the span of the force from its 10th to its 90th percentile, above which the foot stands."""
CLOCKS = np.arange(0.90, 1.1001, 0.0025)
SHIFTS_S = np.arange(-1.0, 1.0001, 0.01)
"""Clock rates and shifts that are tried. The force changes every 20 ms, and the IMU every 14 to 20 ms."""
LEAST_OVERLAP = 0.8
_SMOOTHED_S = 0.06
_LARGEST_RATE_RAD_S = 5.0


@dataclass(frozen=True)
class Fit:
    """How the IMU's time, s, becomes the force's: `clock * time_s + shift_s`, and how well both then agree."""

    clock: float
    shift_s: float
    correlation: float

    def force_time_s(self, imu_time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return times of the IMU as times of the force, s."""
        return np.asarray(self.clock * imu_time_s + self.shift_s)


@dataclass(frozen=True)
class RealFoot:
    """One recording, with what is true and what was reported, both in the time of the force, s."""

    name: str
    force_time_s: NDArray[np.float64]
    force: NDArray[np.float64]
    imu_time_s: NDArray[np.float64]
    imu: NDArray[np.float64]
    fit: Fit
    touchdowns_s: tuple[float, ...]
    liftoffs_s: tuple[float, ...]
    touches_s: tuple[float, ...]
    reported_s: Mapping[tuple[str, str], list[float]]
    """By kind of event and way."""

    def score(self, kind: str, way: str) -> Score:
        """Score a way on a kind of event."""
        truth_s = self.touchdowns_s if kind == "impact" else self.liftoffs_s
        return score_times(truth_s, self.reported_s[kind, way], kind, self.touches_s if kind == "impact" else ())


def real_foot(path: Path, best: Mapping[tuple[str, str], str]) -> RealFoot:
    """Read a recording, put both clocks together, and run the detectors and simpler ways over it.

    Args:
        path: Of the table.
        best: Simpler ways with their settings, by kind and name, as of `best_settings`.

    Raises:
        InputError: it cannot be read.

    """
    layout = TableFormat(("2", "3", "4"), ("5", "6", "7"), force_unit="g", rate_unit="deg/s", rate_hz=IMU_HZ)
    recording = read_table(path, layout)
    samples = recording.samples
    force = read_force(path)
    force_time_s = np.arange(len(force)) / FORCE_HZ
    imu = np.array(samples, dtype=float)
    imu_time_s = imu[:, 0] / NANOSECONDS_PER_SECOND
    fit = fit_clocks(force, imu_time_s, imu[:, 1:])
    low, high = np.percentile(force, (10, 90))
    stands = force > low + LOADED_SHARE * (high - low)
    contacts = joined_contacts(stands, FORCE_HZ)
    first_s, last_s = fit.force_time_s(imu_time_s[[0, -1]])

    def seen(times: list[int]) -> tuple[float, ...]:
        return tuple(at / FORCE_HZ for at in times if first_s < at / FORCE_HZ < last_s)

    return RealFoot(
        name=path.stem,
        force_time_s=force_time_s,
        force=force,
        imu_time_s=fit.force_time_s(imu_time_s),
        imu=imu[:, 1:],
        fit=fit,
        touchdowns_s=seen([begin for begin, _ in contacts if begin > 0]),
        liftoffs_s=seen([end for _, end in contacts if end < len(force)]),
        touches_s=seen([begin for begin, _ in spans_of(stands)]),
        reported_s=_reported(samples, best, fit),
    )


def _reported(
    samples: list[ImuSample], best: Mapping[tuple[str, str], str], fit: Fit
) -> dict[tuple[str, str], list[float]]:
    """Return when each way reported what, by the clock of the force."""
    made = replay((Received(sample.time_ns, sample) for sample in samples), ControllerParameters(imu_mount="foot"))
    reported = {
        (kind, OURS): [event.time_ns / NANOSECONDS_PER_SECOND for event in made.events if event.kind is KINDS[kind]]
        for kind in SCORED
    }
    for (kind, name), way in best.items():
        if kind in SCORED:
            reported[kind, way] = WAYS[name][0](samples, float(way.removeprefix(name)))
    return {key: fit.force_time_s(np.array(times_s)).tolist() for key, times_s in reported.items()}


def read_force(path: Path) -> NDArray[np.float64]:
    """Read the column of the force to its own end."""
    with path.open(newline="", encoding="utf-8") as file:
        return np.array([float(row[0]) for row in csv.reader(file) if row and row[0].strip()])


def fit_clocks(force: NDArray[np.float64], imu_time_s: NDArray[np.float64], imu: NDArray[np.float64]) -> Fit:
    """Find rate and shift of the IMU's clock at which the foot turns while it is unloaded.

    It goes by the correlation of the unloaded foot with the angular velocity over the whole recording. No event of any
    detector is in it.
    """
    low = np.percentile(force, 5)
    unloaded = (force < 0.5 * (low + np.median(force))).astype(float)
    rate = np.minimum(np.linalg.norm(imu[:, 3:], axis=1), _LARGEST_RATE_RAD_S)
    window = max(1, round(_SMOOTHED_S * IMU_HZ))
    turning = np.convolve(rate, np.ones(window) / window, mode="same")
    last_s = (len(force) - 1) / FORCE_HZ
    best = Fit(1.0, 0.0, -1.0)
    for clock in CLOCKS:
        for shift_s in SHIFTS_S:
            at_s = clock * imu_time_s + shift_s
            inside = (at_s >= 0.0) & (at_s <= last_s)
            if inside.mean() < LEAST_OVERLAP:
                continue
            expected = unloaded[np.round(at_s[inside] * FORCE_HZ).astype(int)]
            correlation = float(np.corrcoef(expected, turning[inside])[0, 1])
            if correlation > best.correlation:
                best = Fit(float(clock), float(shift_s), correlation)
    return best


def real_figures(foot: RealFoot) -> dict[str, Any]:
    """Return the figures of a recording."""
    rows = []
    for kind, way in foot.reported_s:
        score = foot.score(kind, way)
        delay_s = median_with_interval(score.delays_s)[0]
        rows.append(
            {
                "kind": kind,
                "way": way,
                **score.figures(),
                "delay_ms": round(1e3 * delay_s, 1) if score.delays_s else None,
            }
        )
    return {
        "name": foot.name,
        "clock": round(foot.fit.clock, 4),
        "shift_s": round(foot.fit.shift_s, 3),
        "correlation": round(foot.fit.correlation, 3),
        "rows": rows,
    }


def draw_real_foot(foot: RealFoot, path: Path) -> None:
    """Draw force and IMU over each other with what is true and what was reported.

    Raises:
        OSError: it cannot be written.

    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(14.0, 7.0), layout="constrained")
        axes = figure.subplots(2, 1, sharex=True)
        for each, columns, name in (
            (axes[0], slice(0, 3), "|specific force| [m/s²]"),
            (axes[1], slice(3, 6), "|angular velocity| [rad/s]"),
        ):
            values = np.linalg.norm(foot.imu[:, columns], axis=1)
            each.plot(foot.imu_time_s, values, color="#c1121f", linewidth=0.7)
            each.plot(foot.force_time_s, foot.force / foot.force.max() * values.max(), color="#222222", linewidth=0.9)
            each.set_ylabel(f"{name}, force")
            for at_s in foot.touchdowns_s:
                each.axvline(at_s, color="#4f772d", linewidth=1.0)
            for kind, marker, colour in (("impact", "v", "#222222"), ("lift-off", "^", "#d9741a")):
                reported_s = foot.reported_s[kind, OURS]
                each.plot(
                    reported_s, np.full(len(reported_s), -0.05 * values.max()), marker, color=colour, markersize=5
                )
        axes[1].set_xlabel("time of the force [s]")
        figure.suptitle(f"{foot.name}: touch-downs by the force (lines), reported (down) and lift-offs reported (up)")
        figure.savefig(path, dpi=110)
