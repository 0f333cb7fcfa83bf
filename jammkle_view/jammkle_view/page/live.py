"""The page of a running graph."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from jammkle_view.core import ankle as known
from jammkle_view.core.models import setting_of
from jammkle_view.core.samples import EventKind
from jammkle_view.core.tints import EVENT_TINTS, LINE_TINTS, tendon_tint
from jammkle_view.page import words
from jammkle_view.page.controls import AnkleControls
from jammkle_view.page.plots import Line, Mark, Plot
from jammkle_view.page.scene import RobotScene
from jammkle_view.page.server import look_at
from jammkle_view.page.sim_controls import Knob, SimControls

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import viser

    from jammkle_view.core.ankle import Ankle
    from jammkle_view.core.models import Setting
    from jammkle_view.core.trace import Trace
    from jammkle_view.core.wishes import Wish

_PLOT_PERIOD_S = 0.15
_TEXT_PERIOD_S = 0.25
_LANDING = "landing"
"""Rig of the sim node, whose slope and drop height may be changed."""
_LABEL_S = 1.5
"""Time for which an event is written beside the robot."""
_PER_KILO = 1e-3
_PANEL_WIDTH_PX, _PLOTS_WIDTH_PX = 330.0, 430.0


class LivePage:
    """Scene, plots, controls of all ankles. One thread feeds it; what is clicked is handed on from others."""

    def __init__(self, server: viser.ViserServer, ankles: Sequence[str], wish: Callable[[Wish], None]) -> None:
        """Lay the page out.

        Args:
            server: Running.
            ankles: Names, one or several.
            wish: Takes what is asked for, from any thread.

        """
        self._server, self._wish = server, wish
        self._ankles = tuple(ankles)
        gui = server.gui
        gui.main_panel.dock_right()
        gui.main_panel.set_width(_PANEL_WIDTH_PX)
        self._status = gui.add_html(words.status_html(()))
        self._answer = gui.add_html(words.answer_html("", good=True))
        self._controls: dict[str, AnkleControls] = {}
        self._lay_out_controls(gui)
        self._sim = SimControls(gui, wish)
        with gui.add_folder("Felt by the controller"):
            self._events = gui.add_html(words.events_html(()))
        gui.add_html(words.legend_html())
        plots = gui.add_panel()
        plots.dock_left()
        plots.set_width(_PLOTS_WIDTH_PX)
        with plots.add_tab("Last seconds"):
            self._chosen = None
            if len(self._ankles) > 1:
                self._chosen = gui.add_dropdown("ankle", self._ankles)
            self._plots = _LivePlots(gui)
        self._label = server.scene.add_label("/event", "", visible=False)
        self._scenes: dict[str, RobotScene] = {}
        self._descriptions: dict[str, str] = {}
        self._next_plot_s = self._next_text_s = 0.0

    @property
    def chosen(self) -> str:
        """Name of the ankle whose signals are plotted."""
        return self._ankles[0] if self._chosen is None else str(self._chosen.value)

    def answer(self, text: str, *, good: bool) -> None:
        """Say what a node has answered."""
        self._answer.content = words.answer_html(text, good=good)

    def show(self, ankles: Mapping[str, Ankle], factor: float, now_s: float) -> None:
        """Show what is known now.

        Args:
            ankles: By name.
            factor: Robot's time per real time; NaN where it is not known.
            now_s: Real time, s, from a steady clock.

        """
        with self._server.atomic():
            for name, ankle in ankles.items():
                self._show_robot(name, ankle)
            if now_s >= self._next_plot_s:
                self._next_plot_s = now_s + _PLOT_PERIOD_S
                self._plots.show(ankles[self.chosen])
            if now_s >= self._next_text_s:
                self._next_text_s = now_s + _TEXT_PERIOD_S
                self._show_texts(ankles, factor)

    def _lay_out_controls(self, gui: viser.GuiApi) -> None:
        if len(self._ankles) == 1:
            self._controls[self._ankles[0]] = AnkleControls(gui, self._ankles[0], self._wish)
            return
        tabs = gui.add_tab_group()
        for name in self._ankles:
            with tabs.add_tab(name):
                self._controls[name] = AnkleControls(gui, name, self._wish)

    def _show_robot(self, name: str, ankle: Ankle) -> None:
        if name not in self._scenes or self._descriptions[name] != ankle.description:
            self._build(name, ankle)
        scene = self._scenes[name]
        tints = {
            tendon: tendon_tint(
                ankle.state_of(tendon), ankle.tensions_n.get(tendon, 0.0), broken=tendon in ankle.broken
            )
            for tendon in scene.tendons
        }
        scene.show(ankle.joints, tints, {tendon: ankle.vacuum_share(tendon) for tendon in scene.tendons})

    def _build(self, name: str, ankle: Ankle) -> None:
        """Draw a robot anew, as its simulation now says it is something else."""
        if name in self._scenes:
            self._scenes[name].remove()
        setting = setting_of(ankle.description)
        self._descriptions[name] = ankle.description
        self._scenes[name] = RobotScene(self._server, f"/{name or 'ankle'}", setting.model)
        if len(self._scenes) == 1:
            look_at(self._server, self._scenes[name].centre_m)
        if ankle.description:
            self._sim.offer(name, knobs_of(setting))

    def _show_texts(self, ankles: Mapping[str, Ankle], factor: float) -> None:
        for name, ankle in ankles.items():
            self._controls[name].show(ankle.channels)
        ankle = ankles[self.chosen]
        stopped = "STOPPED" if any(each.emergency_stopped for each in ankles.values()) else "no"
        self._status.content = words.status_html(
            (
                ("real-time factor", words.number(factor, ".2f")),
                ("time", words.number(ankle.time_s, ".1f", " s")),
                ("emergency stop", stopped),
            )
        )
        self._events.content = words.events_html(ankle.events)
        self._show_label(ankle)

    def _show_label(self, ankle: Ankle) -> None:
        """Write the latest event beside the robot for a moment."""
        latest = ankle.events[-1] if ankle.events else None
        fresh = latest is not None and 0.0 <= ankle.time_s - latest.time_s <= _LABEL_S
        if latest is not None and fresh:
            x, y, z = self._scenes[self.chosen].centre_m
            self._label.text = f"{latest.kind.name} {latest.magnitude:.1f} {latest.unit}"
            self._label.position = (x + 0.09, y, z)
        self._label.visible = fresh


def knobs_of(setting: Setting) -> tuple[Knob, ...]:
    """Return what can be turned while a setting is simulated."""
    knobs = [Knob("speed", "speed", 0.05, 2.0, 0.05, 1.0, hint="Simulated time per real time")]
    if setting.rig == _LANDING:
        slope_deg, height_m = float(setting.options["slope_deg"]), float(setting.options["drop_height_m"])
        hint = "Holds from the next reset on"
        knobs.append(Knob("slope_deg", "slope [deg]", 0.0, 50.0, 1.0, slope_deg, hint=hint))
        knobs.append(Knob("drop_height_m", "drop height [mm]", 0.0, 200.0, 5.0, 1e3 * height_m, 1e-3, hint))
    return tuple(knobs)


class _LivePlots:
    """Pressure, specific force and tension over the last seconds; the time axis ends now."""

    def __init__(self, gui: viser.GuiApi) -> None:
        axis_s = (-known.SPAN_S, 0.0)
        self._pressure = Plot(gui, "Pressure, absolute [kPa]", lines_of(known.PRESSURE_LINES), axis_s)
        self._force = Plot(gui, "Specific force [m/s²]", lines_of(known.IMU_LINES), axis_s, event_marks())
        self._pull = Plot(gui, "Tension [N]", lines_of(known.TENSION_LINES), axis_s)

    def show(self, ankle: Ankle) -> None:
        """Draw the last seconds of an ankle."""
        if math.isnan(ankle.time_s):
            return
        marked: dict[str, list[float]] = {}
        for event in ankle.events:
            marked.setdefault(event.kind.name.lower(), []).append(event.time_s - ankle.time_s)
        self._draw(self._pressure, ankle.pressures_pa, ankle.time_s, _PER_KILO)
        self._draw(self._force, ankle.forces_m_s2, ankle.time_s, 1.0, marked)
        self._draw(self._pull, ankle.pulls_n, ankle.time_s, 1.0)

    def _draw(
        self,
        plot: Plot,
        trace: Trace,
        now_s: float,
        scale: float,
        marked_s: Mapping[str, Sequence[float]] | None = None,
    ) -> None:
        time_s, values = trace.window(now_s - known.SPAN_S, now_s)
        plot.show(time_s - now_s, scale * values, marked_s)


def lines_of(names: Sequence[str]) -> tuple[Line, ...]:
    """Return lines of these names in their colours."""
    return tuple(Line(name.replace("_", " "), LINE_TINTS[name]) for name in names)


def event_marks() -> tuple[Mark, ...]:
    """Return a mark for every kind of event."""
    return tuple(Mark(kind.name.lower(), EVENT_TINTS[kind]) for kind in EventKind if kind is not EventKind.UNKNOWN)
