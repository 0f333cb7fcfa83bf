"""Plots of a recording, with the simulation dashed, and a stroke where the playback stands."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_view.core.samples import EventKind
from jammkle_view.core.tints import EVENT_TINTS, GHOST_TINT, LINE_TINTS
from jammkle_view.core.trace import thinned
from jammkle_view.page.plots import BINS, LEAST, Line, Mark, Plot
from jammkle_view.playback.recorded import NOTHING, Track

if TYPE_CHECKING:
    from collections.abc import Sequence

    import viser
    from numpy.typing import NDArray

    from jammkle_view.core.tints import Rgb
    from jammkle_view.playback.overlay import Overlay
    from jammkle_view.playback.recorded import Recorded

WHOLE = "all of it"
WINDOWS_S: dict[str, float] = {WHOLE: math.inf, "20 s": 20.0, "5 s": 5.0, "1 s": 1.0, "0.2 s": 0.2}
"""How much time the plots show, around where the playback stands; s by name."""
PLOTTED: tuple[str, ...] = (
    *(names.PRESSURES[channel].name for channel in names.CHANNELS),
    names.MANIFOLD_PRESSURE.name,
    *(f"imu/specific_force_{axis}" for axis in "xyz"),
    *(f"imu/angular_velocity_{axis}" for axis in "xyz"),
    "ankle_pitch/position",
    f"{names.CARRIAGE_JOINT}/position",
    *(f"{tendon}/tension" for tendon in names.TENDONS),
)
"""Signals that there are curves of, as the diagnosis names them."""
_NOW = Mark("now", (20, 20, 20))
_HEIGHT_PX = 165
_JOINT_TINT: Rgb = (60, 60, 70)


@dataclass(frozen=True)
class _Curve:
    """One line of a plot: what was measured, and what the simulation has in its place."""

    label: str
    tint: Rgb
    measured: Track
    simulated: tuple[Track, ...]
    """One per run."""
    column: str
    simulated_column: str
    scale: float


class PlaybackPlots:
    """All plots of a recording."""

    def __init__(self, gui: viser.GuiApi, tab: viser.GuiTabHandle, recorded: Recorded, overlay: Overlay | None) -> None:
        """Draw them.

        Args:
            gui: Of the page.
            tab: Where.
            recorded: What was measured.
            overlay: Its simulation, if there is one.

        """
        self._gui, self._recorded = gui, recorded
        self._curves = {title: curves for title, curves in _curves(recorded, overlay).items() if curves}
        self._whole = {title: _sampled(curves, 0.0, math.inf) for title, curves in self._curves.items()}
        self._tab = tab
        self._plots: dict[str, Plot] = {}
        self.set_window(WHOLE)

    def set_window(self, name: str) -> None:
        """Choose how much time is shown: a key of WINDOWS_S."""
        for plot in self._plots.values():
            plot.remove()
        self.window = name
        span_s = WINDOWS_S[name]
        axis_s = (0.0, self._recorded.duration_s) if math.isinf(span_s) else (-span_s / 2.0, span_s / 2.0)
        events = [Mark(kind.name.lower(), EVENT_TINTS[kind]) for kind in EventKind if self._times_of(kind)]
        with self._tab:
            self._plots = {
                title: Plot(
                    self._gui,
                    title,
                    _lines(curves),
                    axis_s,
                    (*events, _NOW),
                    least=LEAST[title],
                    height_px=_HEIGHT_PX,
                )
                for title, curves in self._curves.items()
            }

    def show(self, time_s: float) -> None:
        """Draw what is shown while the playback stands at a time, s."""
        span_s = WINDOWS_S[self.window]
        whole = math.isinf(span_s)
        start_s, end_s = (0.0, math.inf) if whole else (time_s - span_s / 2.0, time_s + span_s / 2.0)
        zero_s = 0.0 if whole else time_s
        marked = {kind.name.lower(): [each - zero_s for each in self._times_of(kind)] for kind in EventKind}
        marked[_NOW.label] = [time_s - zero_s]
        for title, curves in self._curves.items():
            base_s, values = self._whole[title] if whole else _sampled(curves, start_s, end_s)
            self._plots[title].show(base_s - zero_s, values, marked)

    def _times_of(self, kind: EventKind) -> list[float]:
        return [event.time_s for event in self._recorded.events if event.kind is kind]


def _curves(recorded: Recorded, overlay: Overlay | None) -> dict[str, tuple[_Curve, ...]]:
    """Return the curves of every plot by its title; none where nothing was measured."""
    runs = () if overlay is None else overlay.runs

    def readings(signal: str) -> tuple[Track, ...]:
        return tuple(run.readings.get(signal, NOTHING) for run in runs)

    pressures = {channel: names.PRESSURES[channel].name for channel in names.CHANNELS}
    pressures["manifold"] = names.MANIFOLD_PRESSURE.name
    joints = tuple(run.joints for run in runs)
    pulls = tuple(run.tensions_n for run in runs)

    def joint(name: str, label: str, scale: float) -> tuple[_Curve, ...]:
        if name not in recorded.joints.columns:
            return ()
        return (_Curve(label, _JOINT_TINT, recorded.joints, joints, name, name, scale),)

    return {
        "Pressure, absolute [kPa]": tuple(
            _Curve(label, LINE_TINTS[label], recorded.pressures_pa[topic], readings(topic), topic, topic, 1e-3)
            for label, topic in pressures.items()
            if topic in recorded.pressures_pa
        ),
        "Specific force [m/s²]": tuple(
            _Curve(axis, LINE_TINTS[axis], recorded.forces_m_s2, readings(signal), axis, signal, 1.0)
            for axis, signal in ((axis, f"imu/specific_force_{axis}") for axis in recorded.forces_m_s2.columns)
        ),
        "Angular rate [rad/s]": tuple(
            _Curve(axis, LINE_TINTS[axis], recorded.rates_rad_s, readings(signal), axis, signal, 1.0)
            for axis, signal in ((axis, f"imu/angular_velocity_{axis}") for axis in recorded.rates_rad_s.columns)
        ),
        "Pitch of the foot, toe down [deg]": joint("ankle_pitch", "pitch", math.degrees(1.0)),
        "Carriage [mm]": joint(names.CARRIAGE_JOINT, "carriage", 1e3),
        "Tension [N]": tuple(
            _Curve(tendon, LINE_TINTS[tendon], recorded.tensions_n, pulls, tendon, tendon, 1.0)
            for tendon in names.TENDONS
            if tendon in recorded.tensions_n.columns
        ),
    }


def _lines(curves: Sequence[_Curve]) -> tuple[Line, ...]:
    """Return the lines of a plot: measured ones, then simulated ones."""
    measured = [Line(curve.label.replace("_", " "), curve.tint) for curve in curves]
    alone = len(curves) == 1
    simulated = [
        Line(
            "simulated" if alone else f"{curve.label.replace('_', ' ')} sim",
            GHOST_TINT if alone else curve.tint,
            dashed=True,
        )
        for curve in curves
        if any(curve.simulated_column in run.columns for run in curve.simulated)
    ]
    return (*measured, *simulated)


def _sampled(curves: Sequence[_Curve], start_s: float, end_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return all lines of a plot at the times of its first measured one, between two times, s, as many as it draws."""
    time_s = curves[0].measured.time_s
    first, last = np.searchsorted(time_s, start_s), np.searchsorted(time_s, end_s, side="right")
    base_s = time_s[first:last]
    columns = [
        curve.scale * np.interp(base_s, curve.measured.time_s, curve.measured.columns[curve.column]) for curve in curves
    ]
    for curve in curves:
        runs = [run for run in curve.simulated if curve.simulated_column in run.columns]
        if runs:
            columns.append(_pieced(base_s, runs, curve.simulated_column, curve.scale))
    return thinned(base_s, np.stack(columns, axis=1), BINS)


def _pieced(base_s: NDArray[np.float64], runs: Sequence[Track], column: str, scale: float) -> NDArray[np.float64]:
    """Return one simulated signal at times, not a number where no run covers them."""
    whole = np.full(len(base_s), np.nan)
    for run in runs:
        inside = (base_s >= run.time_s[0]) & (base_s <= run.time_s[-1])
        whole[inside] = scale * np.interp(base_s[inside], run.time_s, run.columns[column])
    return whole
