"""One picture of a run: height, shock, vacuum and tension over time, with the events marked."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import matplotlib as mpl
from matplotlib.figure import Figure

from jammkle_bringup.core.landing import REACHED_FRACTION, Series, vacuum_pa
from jammkle_common.command.results import EVENT_COLOURS, LINE_COLOURS
from jammkle_common.constants import STANDARD_GRAVITY_M_S2

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from matplotlib.axes import Axes

    from jammkle_bringup.core.landing import Array, RunSeries, RunSummary

_PA_PER_KPA = 1e3
_MM_PER_M = 1e3
_BEFORE_S = 0.25
_AFTER_S = 0.5
_ZOOM_BEFORE_S = 0.02
_ZOOM_AFTER_S = 0.1
_MS_PER_S = 1e3
_WIDTH_IN = 9.0
_PANEL_HEIGHT_IN = 1.9
_DOTS_PER_INCH = 130
_LARGEST_RING = 13
_RING_STEP = 4
_DASHES = (4, 8)
_DASH_OFFSET = 6
_SHOCK_LABEL = "IMU z - g\n[m/s²]"
_MARK_COLOURS = {"touch-down": "#444444", "detected": EVENT_COLOURS["IMPACT"]}


def draw(run: RunSeries, summary: RunSummary, path: Path) -> None:
    """Write a PNG of a run; panels whose topics the bag does not hold are left out.

    Raises:
        OSError: the file cannot be written.

    """
    whole: list[Callable[[Axes], None]] = []
    height, shock = run.carriage, _net_shock(run)
    if height is not None:
        whole.append(lambda axes: _line(axes, height.time_s, height.values * _MM_PER_M, "height of\nankle [mm]"))
    if shock is not None:
        whole.append(lambda axes: _line(axes, shock.time_s, shock.values, _SHOCK_LABEL, linewidth=0.8))
    if run.pressures:
        whole.append(lambda axes: _vacuum(axes, run, summary))
    if run.solenoids:
        whole.append(lambda axes: _solenoids(axes, run))
    if run.tensions:
        whole.append(lambda axes: _tension(axes, run))
    zoomed = shock if summary.touch_down_s is not None else None
    count = max(1, len(whole)) + (zoomed is not None)
    mpl.rcParams["axes.spines.top"] = mpl.rcParams["axes.spines.right"] = False
    figure = Figure(figsize=(_WIDTH_IN, 1.0 + _PANEL_HEIGHT_IN * count), layout="constrained")
    axes: list[Axes] = []
    for index, panel in enumerate(whole or [_nothing]):
        axes.append(figure.add_subplot(count, 1, index + 1, sharex=axes[0] if axes else None))
        panel(axes[-1])
        _mark_events(axes[-1], summary)
    for above in axes[:-1]:
        above.tick_params(labelbottom=False)
    axes[-1].set_xlabel("time since the start of the bag [s]")
    axes[-1].set_xlim(*_window(run, summary))
    if zoomed is not None and summary.touch_down_s is not None:
        axes.append(figure.add_subplot(count, 1, count))
        _zoom(axes[-1], zoomed, summary, summary.touch_down_s)
    for axis in axes:
        axis.grid(visible=True, alpha=0.25)
    axes[0].legend(loc="upper right", fontsize="small", ncols=2)
    figure.suptitle(_title(summary), fontsize="medium")
    figure.savefig(path, dpi=_DOTS_PER_INCH)


def _nothing(_axes: Axes) -> None:
    """Leave a panel empty, for a bag that holds nothing to draw."""


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


def _mark_events(axes: Axes, summary: RunSummary, factor: float = 1.0, origin_s: float = 0.0) -> None:
    """Mark touch-down below and detection above, behind the curves: both often fall on one sample."""
    for name, time_s, low, high in (
        ("touch-down", summary.touch_down_s, 0.0, 0.2),
        ("detected", summary.detected_s, 0.8, 1.0),
    ):
        if time_s is not None:
            at = (time_s - origin_s) * factor
            colour = _MARK_COLOURS[name]
            axes.axvline(at, low, high, color=colour, linewidth=0.8, alpha=0.8, zorder=1, label=name)


def _zoom(axes: Axes, shock: Series, summary: RunSummary, touch_down_s: float) -> None:
    """Show the shock alone, each sample a dot, over the time from touch-down."""
    from_touch_down_s = shock.time_s - touch_down_s
    near = (from_touch_down_s >= -_ZOOM_BEFORE_S) & (from_touch_down_s <= _ZOOM_AFTER_S)
    style = {"linewidth": 0.8, "marker": ".", "markersize": 3}
    _line(axes, from_touch_down_s[near] * _MS_PER_S, shock.values[near], _SHOCK_LABEL, **style)
    _mark_events(axes, summary, _MS_PER_S, touch_down_s)
    axes.set_xlim(-_ZOOM_BEFORE_S * _MS_PER_S, _ZOOM_AFTER_S * _MS_PER_S)
    axes.set_xlabel("time from touch-down [ms]")


def _net_shock(run: RunSeries) -> Series | None:
    """Return the reading of the IMU along z without that of standing still, m/s^2."""
    if run.imu_z is None:
        return None
    return Series(run.imu_z.time_s, run.imu_z.values - STANDARD_GRAVITY_M_S2)


def _line(axes: Axes, times: Array, values: Array, label: str, **style: Any) -> None:
    axes.plot(times, values, color="#2c3e50", **style)
    axes.set_ylabel(label)


def _vacuum(axes: Axes, run: RunSeries, summary: RunSummary) -> None:
    for index, channel in enumerate(summary.channels):
        vacuum = vacuum_pa(run, channel.channel)
        colour = LINE_COLOURS[channel.channel]
        if vacuum is not None:
            times_s = run.pressures[channel.channel].time_s
            axes.plot(times_s, vacuum / _PA_PER_KPA, label=channel.channel, **_style(index, channel.channel))
        commanded = run.commanded_vacuum.get(channel.channel)
        if commanded is not None:
            _steps(axes, commanded, run.duration_s, 1 / _PA_PER_KPA, colour)
        if channel.reached_s is not None and channel.commanded_vacuum_pa is not None:
            reached_kpa = REACHED_FRACTION * channel.commanded_vacuum_pa / _PA_PER_KPA
            # rings inside each other where channels reach it together
            size = _LARGEST_RING - _RING_STEP * index
            ring: dict[str, Any] = {"markerfacecolor": "none", "markersize": size, "markeredgewidth": 1.5, "zorder": 4}
            axes.plot(channel.reached_s, reached_kpa, "o", color=colour, **ring)
    if run.manifold_pressure is not None:
        ambient_pa = float(run.manifold_pressure.values[0])
        vacuum_kpa = (ambient_pa - run.manifold_pressure.values) / _PA_PER_KPA
        axes.plot(
            run.manifold_pressure.time_s, vacuum_kpa, color=LINE_COLOURS["manifold"], linewidth=0.8, label="manifold"
        )
    axes.set_ylabel("vacuum [kPa]\n(dotted: set point,\nring: reached)")
    axes.legend(loc="lower right", fontsize="small", ncols=2)


def _steps(axes: Axes, series: Series, end_s: float, factor: float, colour: str) -> None:
    times_s, values = _until(series, end_s)
    axes.step(times_s, [value * factor for value in values], where="post", color=colour, linestyle=":", linewidth=0.9)


def _until(series: Series, end_s: float) -> tuple[list[float], list[float]]:
    return [*series.time_s, max(end_s, series.time_s[-1])], [*series.values, series.values[-1]]


def _solenoids(axes: Axes, run: RunSeries) -> None:
    for index, (channel, series) in enumerate(run.solenoids.items()):
        times_s, values = _until(series, run.duration_s)
        low = [float(index)] * len(times_s)
        high = [index + 0.7 * value for value in values]
        axes.fill_between(times_s, low, high, step="post", color=LINE_COLOURS[channel], linewidth=0, label=channel)
    axes.set_yticks([index + 0.35 for index in range(len(run.solenoids))], list(run.solenoids), fontsize="small")
    axes.set_ylabel("solenoid\nenergised")


def _style(index: int, name: str) -> dict[str, Any]:
    """Return a line that lets two equal ones be seen through its gaps: channels often are equal."""
    style: dict[str, Any] = {"color": LINE_COLOURS[name], "linewidth": 1.6}
    if index % 3:
        # a third of the line each: the dashes of the second lie in the gaps of the third
        style["linestyle"] = (_DASH_OFFSET * (index % 3 - 1), _DASHES)
    return style


def _tension(axes: Axes, run: RunSeries) -> None:
    for index, (tendon, series) in enumerate(run.tensions.items()):
        axes.plot(series.time_s, series.values, label=tendon, **_style(index % 2, tendon))
    axes.set_ylabel("tension [N]")
    axes.legend(loc="upper right", fontsize="small", ncols=2)
