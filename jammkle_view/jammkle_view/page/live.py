"""The page of a running graph."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from jammkle_common.constants import HELD_VACUUM_PA
from jammkle_common.names import CHANNELS
from jammkle_view.core import ankle as known
from jammkle_view.core.figure import LINE_TINTS
from jammkle_view.core.models import knobs_of, setting_of
from jammkle_view.core.samples import Action, Ask, ChannelState, Jam, SetSim, Unjam
from jammkle_view.page import words
from jammkle_view.page.plots import Line, Mark, Plot, event_marks
from jammkle_view.page.scene import RobotScene
from jammkle_view.page.server import look_at
from jammkle_view.page.words import channel_html

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import viser

    from jammkle_view.core.ankle import Ankle, Quantity
    from jammkle_view.core.models import Knob, Naming
    from jammkle_view.core.samples import Channel, Request

_PLOT_PERIOD_S = 0.15
_TEXT_PERIOD_S = 0.25
_APART_M = 0.6
"""Between ankles that stand in rigs of their own, m."""
_LABEL_S = 1.5
"""Time for which an event is written beside the robot."""
_PANEL_WIDTH_PX, _PLOTS_WIDTH_PX = 330.0, 430.0


class LivePage:
    """Scene, plots, controls of all ankles. One thread feeds it; what is clicked is handed on from others."""

    def __init__(self, server: viser.ViserServer, ankles: Sequence[str], request: Callable[[Request], None]) -> None:
        """Lay the page of these ankles out; what is asked for is handed on from any thread."""
        self._server, self._request = server, request
        self._ankles = tuple(ankles)
        gui = server.gui
        gui.main_panel.dock_right()
        gui.main_panel.set_width(_PANEL_WIDTH_PX)
        self._status = gui.add_html(words.status_html(()))
        self._answer = gui.add_html(words.answer_html("", good=True))
        self._controls: dict[str, AnkleControls] = {}
        self._lay_out_controls(gui)
        self._sim = SimControls(gui, request)
        with gui.add_folder("Felt by the controller"):
            self._events = gui.add_html(words.events_html(()))
        with gui.add_folder("Latest landing, and what is left"):
            self._landing = gui.add_html(words.landing_html(known.AnkleState()))
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
        self._drawn: list[tuple[RobotScene, Mapping[str, Naming]]] = []
        """Robots in the scene, and the ankles that move each, by name on the page."""
        self._descriptions: dict[str, str] = {}
        self._next_plot_s = self._next_text_s = 0.0

    @property
    def chosen(self) -> str:
        """Name of the ankle whose signals are plotted."""
        return self._ankles[0] if self._chosen is None else str(self._chosen.value)

    def answer(self, text: str, *, good: bool) -> None:
        """Say what a node has answered."""
        self._answer.content = words.answer_html(text, good=good)

    def show_speed(self, speed: float) -> None:
        """Show what speed the simulation was given."""
        self._sim.show("speed", speed)

    def show(self, ankles: Mapping[str, Ankle], factor: float, now_s: float) -> None:
        """Show what is known of the ankles now, by a steady clock, s; the factor is NaN where it is not known."""
        with self._server.atomic():
            self._show_robots(ankles)
            if now_s >= self._next_plot_s:
                self._next_plot_s = now_s + _PLOT_PERIOD_S
                self._plots.show(ankles[self.chosen])
            if now_s >= self._next_text_s:
                self._next_text_s = now_s + _TEXT_PERIOD_S
                self._show_texts(ankles, factor)

    def _lay_out_controls(self, gui: viser.GuiApi) -> None:
        if len(self._ankles) == 1:
            self._controls[self._ankles[0]] = AnkleControls(gui, self._ankles[0], self._request)
            return
        tabs = gui.add_tab_group()
        for name in self._ankles:
            with tabs.add_tab(name):
                self._controls[name] = AnkleControls(gui, name, self._request)

    def _show_robots(self, ankles: Mapping[str, Ankle]) -> None:
        descriptions = {name: ankle.description for name, ankle in ankles.items()}
        if descriptions != self._descriptions:
            self._descriptions = descriptions
            self._build(descriptions)
        for scene, members in self._drawn:
            scene.show_ankles([(naming, ankles[name]) for name, naming in members.items()])

    def _build(self, descriptions: Mapping[str, str]) -> None:
        """Draw all robots anew, as a simulation now says that it is something else."""
        for scene, _ in self._drawn:
            scene.remove()
        self._drawn = []
        whole = setting_of(next(iter(descriptions.values())))
        if len(whole.ankles) > 1 and set(descriptions) <= set(whole.ankles):
            groups = [(whole, {name: whole.ankles[name] for name in descriptions})]
        else:
            settings = {name: setting_of(text) for name, text in descriptions.items()}
            groups = [(each, {name: next(iter(each.ankles.values()))}) for name, each in settings.items()]
        for place, (setting, members) in enumerate(groups):
            root = f"/{next(iter(members)) or 'ankle'}" if len(members) == 1 else f"/{setting.rig}"
            scene = RobotScene(self._server, root, setting.model, floats=setting.floats)
            scene.put((0.0, -_APART_M * place, 0.0))
            self._drawn.append((scene, members))
        first, _ = self._drawn[0]
        look_at(self._server, first.centre_m, first.reach_m)
        simulated = tuple(name for name, text in descriptions.items() if text)
        if simulated:
            several = len(groups) == 1 and len(self._ankles) > 1  # of one simulation above them
            self._sim.offer(("",) if several else simulated, knobs_of(whole))

    def _show_texts(self, ankles: Mapping[str, Ankle], factor: float) -> None:
        for name, ankle in ankles.items():
            undone = self._controls[name].show(ankle.channels)
            if undone:
                self.answer(undone, good=False)
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
        self._landing.content = words.landing_html(ankle)
        self._show_label(ankle)

    def _show_label(self, ankle: Ankle) -> None:
        """Write the latest event beside the robot for a moment."""
        latest = ankle.events[-1] if ankle.events else None
        fresh = latest is not None and 0.0 <= ankle.time_s - latest.time_s <= _LABEL_S
        if latest is not None and fresh:
            x, y, z = next(scene.centre_m for scene, members in self._drawn if self.chosen in members)
            self._label.text = f"{latest.kind.name} {latest.magnitude:.3g} {latest.unit}"
            self._label.position = (x + 0.09, y, z)
        self._label.visible = fresh


class _LivePlots:
    """Pressure, IMU and tension over the last seconds; the time axis ends now."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._plots = {known.PRESSURE: _plot(gui, known.PRESSURE)}
        shown = gui.add_dropdown("IMU", (known.FORCE.title, known.RATE.title))
        imu = {each: _plot(gui, each, event_marks()) for each in (known.FORCE, known.RATE)}
        imu[known.RATE].set_visible(visible=False)  # one at a time: a plot out of sight costs nothing

        @shown.on_update
        def _(_event: object) -> None:
            for quantity, plot in imu.items():
                plot.set_visible(visible=quantity.title == shown.value)

        self._plots |= {**imu, known.TENSION: _plot(gui, known.TENSION)}

    def show(self, ankle: Ankle) -> None:
        """Draw the last seconds of an ankle."""
        if math.isnan(ankle.time_s):
            return
        marked: dict[str, list[float]] = {}
        for event in ankle.events:
            marked.setdefault(event.kind.name.lower(), []).append(event.time_s - ankle.time_s)
        traces = (ankle.pressures_pa, ankle.forces_m_s2, ankle.rates_rad_s, ankle.pulls_n)
        for plot, trace in zip(self._plots.values(), traces, strict=True):
            if plot.visible:
                time_s, values = trace.window(ankle.time_s - known.SPAN_S, ankle.time_s)
                plot.show(time_s - ankle.time_s, values, marked)


def _plot(gui: viser.GuiApi, quantity: Quantity, marks: Sequence[Mark] = ()) -> Plot:
    lines = [Line(label.replace("_", " "), LINE_TINTS[label]) for label in quantity.signals]
    return Plot(gui, quantity, lines, (-known.SPAN_S, 0.0), marks)


_PA_PER_KPA = 1000.0
JAM, UNJAM = "Jam", "Unjam"
_JAMMING = (ChannelState.JAMMING, ChannelState.JAMMED)
AUTO, MANUAL = "Controller", "Page alone"


class AnkleControls:
    """What can be asked of one ankle, and what its channels are doing."""

    def __init__(self, gui: viser.GuiApi, ankle: str, request: Callable[[Request], None]) -> None:
        """Lay it out where the interface stands; what is asked for is handed on from any thread."""
        self._ankle, self._request = ankle, request
        self._states: dict[str, viser.GuiHtmlHandle] = {}
        self._shown: dict[str, str] = {}
        self._held_pa: dict[str, float] = {}
        """Vacuum of each channel that is jammed or being jammed."""
        self._unjammed: dict[str, bool] = {}
        """Channels that were to be unjammed, and whether they have been since."""
        for channel in CHANNELS:
            self._add_pair(gui, channel.replace("_", " "), (channel,))
            self._states[channel] = gui.add_html(channel_html(None))
        gui.add_divider()
        self._add_pair(gui, "all channels", ())
        self._vacuum_kpa = gui.add_slider(
            "vacuum [kPa]",
            5.0,
            75.0,
            1.0,
            HELD_VACUUM_PA / _PA_PER_KPA,
            hint="Vacuum that the next Jam asks for, below ambient; all channels of an ankle share one",
        )
        decides = gui.add_button_group(
            "jams by itself", (AUTO, MANUAL), hint="Whether the controller jams, or only you"
        )

        @decides.on_click
        def _(_event: object) -> None:
            action = Action.AUTO_ON if decides.value == AUTO else Action.AUTO_OFF
            self._request(Ask(ankle, action))

        stop = gui.add_button("EMERGENCY STOP", color="red", hint="Releases everything until the fault is cleared")
        stop.on_click(lambda _: self._request(Ask(ankle, Action.EMERGENCY_STOP)))
        clear = gui.add_button("Clear fault", color="gray", hint="Ends an emergency stop or a fault; all stays vented")
        clear.on_click(lambda _: self._request(Ask(ankle, Action.CLEAR_FAULT)))

    def show(self, channels: Mapping[str, Channel]) -> str:
        """Say what the channels are doing.

        All channels share one manifold, and so one vacuum: where one is jammed, the slider goes to what it is held at,
        and stays where somebody moves it until that changes.

        Returns:
            What to say where somebody else has jammed a channel that was unjammed on this page; empty otherwise.

        """
        held_pa = {name: each.commanded_vacuum_pa for name, each in channels.items() if each.state in _JAMMING}
        if held_pa and set(held_pa.values()) != set(self._held_pa.values()):
            self._show_vacuum(max(held_pa.values()))
        self._held_pa = held_pa
        undone = self._undone(channels)
        for channel, handle in self._states.items():
            text = channel_html(channels.get(channel))
            if self._shown.get(channel) != text:
                self._shown[channel] = handle.content = text
        return undone

    def _show_vacuum(self, vacuum_pa: float) -> None:
        shown_kpa = min(max(vacuum_pa / _PA_PER_KPA, self._vacuum_kpa.min), self._vacuum_kpa.max)
        self._vacuum_kpa.value = shown_kpa  # type: ignore[misc]  # set by a way of viser's own

    def _vacuum_for(self, channels: tuple[str, ...]) -> float:
        """Return what to ask for, Pa: the slider's, or what the channels that are not asked for are held at.

        The driver refuses any other vacuum, since one manifold cannot hold two.
        """
        others_pa = [held_pa for name, held_pa in self._held_pa.items() if name not in (channels or CHANNELS)]
        if not others_pa:
            return float(self._vacuum_kpa.value) * _PA_PER_KPA
        self._show_vacuum(max(others_pa))
        return max(others_pa)

    def _undone(self, channels: Mapping[str, Channel]) -> str:
        again = []
        for name, each in channels.items():
            jams = each.state in _JAMMING
            if name in self._unjammed and not jams:
                self._unjammed[name] = True
            elif self._unjammed.get(name):
                del self._unjammed[name]
                again.append(f"{name.replace('_', ' ')}: {each.reason}")
        if not again:
            return ""
        return f"jammed again ({'; '.join(again)}). Choose '{MANUAL}' first to keep it unjammed"

    def _add_pair(self, gui: viser.GuiApi, label: str, channels: tuple[str, ...]) -> None:
        pair = gui.add_button_group(label, (JAM, UNJAM))

        @pair.on_click
        def _(_event: object) -> None:
            if pair.value == JAM:
                for each in channels or CHANNELS:
                    self._unjammed.pop(each, None)
                self._request(Jam(self._ankle, channels, self._vacuum_for(channels)))
            else:
                self._unjammed |= dict.fromkeys(channels or CHANNELS, False)
                self._request(Unjam(self._ankle, channels))


PAUSE, GO_ON, RESET = "Pause", "Go on", "Reset"


class SimControls:
    """What can be asked of the simulation, in a folder that is out of sight until there is one."""

    def __init__(self, gui: viser.GuiApi, request: Callable[[Request], None]) -> None:
        """Keep a place for it where the interface stands; what is asked for is handed on from any thread."""
        self._gui, self._request = gui, request
        self._folder = gui.add_folder("Simulation", visible=False)
        self._ankles: tuple[str, ...] = ()
        self._sliders: dict[str, viser.GuiSliderHandle[float]] = {}

    def offer(self, ankles: tuple[str, ...], knobs: tuple[Knob, ...]) -> None:
        """Show what can be turned, once it is known, of the simulations in these namespaces; each of them is asked."""
        known, self._ankles = self._ankles, ankles
        if known:
            return
        with self._folder:
            run = self._gui.add_button_group("time", (PAUSE, GO_ON, RESET))

            @run.on_click
            def _(_event: object) -> None:
                action = {PAUSE: Action.PAUSE, GO_ON: Action.GO_ON, RESET: Action.RESET}[run.value]
                for ankle in self._ankles:
                    self._request(Ask(ankle, action))

            for knob in knobs:
                self._add_slider(knob)
        self._folder.visible = True
        self._request(Ask(ankles[0], Action.READ_SPEED))

    def show(self, parameter: str, value: float) -> None:
        """Put a slider where the simulation has its parameter, as far as it reaches."""
        slider = self._sliders.get(parameter)
        if slider is not None:
            slider.value = min(max(value, slider.min), slider.max)  # type: ignore[misc]  # set by a way of viser's own

    def _add_slider(self, knob: Knob) -> None:
        slider = self._gui.add_slider(
            knob.label, knob.minimum, knob.maximum, knob.step, knob.start, hint=knob.hint or None
        )
        self._sliders[knob.parameter] = slider

        @slider.on_update
        def _(event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
            if event.client is not None:  # moved by somebody, not by `show`
                for ankle in self._ankles:
                    self._request(SetSim(ankle, knob.parameter, float(slider.value) * knob.per_unit))
