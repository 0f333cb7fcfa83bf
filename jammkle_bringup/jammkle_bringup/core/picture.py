"""One picture of a run: height, shock, vacuum and tension over time, with the events marked."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib as mpl
from matplotlib.figure import Figure

from jammkle_bringup.core.run_summary import (
    REACHED_FRACTION,
    STANDARD_GRAVITY_M_S2,
    STANDARD_PRESSURE_PA,
    vacuum_pa,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from matplotlib.axes import Axes

    from jammkle_bringup.core.run_series import RunSeries, Series
    from jammkle_bringup.core.run_summary import RunSummary

_PA_PER_KPA = 1e3
_MM_PER_M = 1e3
_BEFORE_S = 0.25
_AFTER_S = 0.5
_WIDTH_IN = 9.0
_PANEL_HEIGHT_IN = 1.9
_DOTS_PER_INCH = 130
_EVENT_COLOURS = {"touch-down": "#444444", "detected": "#c0392b"}


def draw(run: RunSeries, summary: RunSummary, path: Path) -> None:
    """Write a PNG of a run; panels whose topics the bag does not hold are left out.

    Raises:
        OSError: the file cannot be written.

    """
    panels: list[Callable[[Axes], None]] = []
    if run.carriage is not None:
        panels.append(lambda axes: _height(axes, run))
    if run.imu_z is not None:
        panels.append(lambda axes: _shock(axes, run))
    if run.pressures:
        panels.append(lambda axes: _vacuum(axes, run, summary))
    if run.solenoids:
        panels.append(lambda axes: _solenoids(axes, run))
    if run.tensions:
        panels.append(lambda axes: _tension(axes, run))
    mpl.rcParams["axes.spines.top"] = mpl.rcParams["axes.spines.right"] = False
    figure = Figure(figsize=(_WIDTH_IN, 1.0 + _PANEL_HEIGHT_IN * max(1, len(panels))), layout="constrained")
    axes = figure.subplots(max(1, len(panels)), 1, sharex=True, squeeze=False)[:, 0]
    for panel, axis in zip(panels, axes, strict=False):
        panel(axis)
        axis.grid(visible=True, alpha=0.25)
        _mark_events(axis, summary)
    axes[0].legend(loc="upper right", fontsize="small", ncols=2)
    axes[-1].set_xlabel("time since the start of the bag [s]")
    axes[-1].set_xlim(*_window(run, summary))
    figure.suptitle(_title(summary), fontsize="medium")
    figure.savefig(path, dpi=_DOTS_PER_INCH)


def _title(summary: RunSummary) -> str:
    if summary.peak_deceleration_m_s2 is None:
        return f"Run in {summary.namespace}"
    return f"Landing: peak deceleration {summary.peak_deceleration_m_s2:.1f} m/s² net"


def _window(run: RunSeries, summary: RunSummary) -> tuple[float, float]:
    """Return the part of the run in which something happens, s."""
    times = [summary.touch_down_s, summary.detected_s]
    times += [channel.reached_s for channel in summary.channels]
    times += [event.time_s for event in run.events]
    known = [time_s for time_s in times if time_s is not None]
    if not known:
        return 0.0, max(run.duration_s, 1e-3)
    return max(0.0, min(known) - _BEFORE_S), min(run.duration_s, max(known) + _AFTER_S)


def _mark_events(axes: Axes, summary: RunSummary) -> None:
    for name, time_s in (("touch-down", summary.touch_down_s), ("detected", summary.detected_s)):
        if time_s is not None:
            style = ":" if name == "touch-down" else "-"
            axes.axvline(time_s, color=_EVENT_COLOURS[name], linestyle=style, linewidth=1.0, label=name)


def _height(axes: Axes, run: RunSeries) -> None:
    if run.carriage is not None:
        axes.plot(run.carriage.time_s, run.carriage.values * _MM_PER_M, color="#2c3e50")
    axes.set_ylabel("height of\nankle [mm]")


def _shock(axes: Axes, run: RunSeries) -> None:
    if run.imu_z is not None:
        axes.plot(run.imu_z.time_s, run.imu_z.values - STANDARD_GRAVITY_M_S2, color="#2c3e50", linewidth=0.8)
    axes.set_ylabel("IMU z - g\n[m/s²]")


def _vacuum(axes: Axes, run: RunSeries, summary: RunSummary) -> None:
    for index, channel in enumerate(summary.channels):
        vacuum = vacuum_pa(run, channel.channel)
        colour = f"C{index}"
        if vacuum is not None:
            times_s = run.pressures[channel.channel].time_s
            axes.plot(times_s, vacuum / _PA_PER_KPA, color=colour, label=channel.channel, linewidth=_width(index))
        commanded = run.commanded_vacuum.get(channel.channel)
        if commanded is not None:
            _steps(axes, commanded, run.duration_s, 1 / _PA_PER_KPA, colour)
        if channel.reached_s is not None and channel.commanded_vacuum_pa is not None:
            reached_kpa = REACHED_FRACTION * channel.commanded_vacuum_pa / _PA_PER_KPA
            axes.plot(channel.reached_s, reached_kpa, "o", color=colour, markersize=5)
    if run.manifold_pressure is not None:
        ambient_pa = float(run.manifold_pressure.values[0]) if len(run.manifold_pressure) else STANDARD_PRESSURE_PA
        vacuum_kpa = (ambient_pa - run.manifold_pressure.values) / _PA_PER_KPA
        axes.plot(run.manifold_pressure.time_s, vacuum_kpa, color="#999999", linewidth=0.8, label="manifold")
    axes.set_ylabel("vacuum [kPa]\n(dashed: set point)")
    axes.legend(loc="lower right", fontsize="small", ncols=2)


def _steps(axes: Axes, series: Series, end_s: float, factor: float, colour: str) -> None:
    times = [*series.time_s, max(end_s, series.time_s[-1])]
    values = [*series.values, series.values[-1]]
    axes.step(times, [value * factor for value in values], where="post", color=colour, linestyle="--", linewidth=0.9)


def _solenoids(axes: Axes, run: RunSeries) -> None:
    for index, (channel, series) in enumerate(run.solenoids.items()):
        times = [*series.time_s, max(run.duration_s, series.time_s[-1])]
        values = [*series.values, series.values[-1]]
        low = [float(index)] * len(times)
        high = [index + 0.7 * value for value in values]
        axes.fill_between(times, low, high, step="post", color=f"C{index}", linewidth=0, label=channel)
    axes.set_yticks([index + 0.35 for index in range(len(run.solenoids))], list(run.solenoids), fontsize="small")
    axes.set_ylabel("solenoid\nenergised")


def _width(index: int) -> float:
    """Return a line width that lets equal curves show from under each other: left and right often are equal."""
    return max(0.8, 3.2 - 0.8 * index)


def _tension(axes: Axes, run: RunSeries) -> None:
    for index, (tendon, series) in enumerate(run.tensions.items()):
        axes.plot(series.time_s, series.values, color=f"C{index}", linewidth=_width(index), label=tendon)
    axes.set_ylabel("tension [N]")
    axes.legend(loc="upper right", fontsize="small", ncols=2)
