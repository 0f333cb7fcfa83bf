"""`jammkle view`: a recording played back at any speed, with its simulation laid over it."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_common.command.errors import InputError
from jammkle_common.command.results import progress_bar, say
from jammkle_view.core.ankle import CARRIAGE, FORCE, PITCH, PRESSURE, RATE, TENSION, AnkleState, thinned
from jammkle_view.core.figure import EVENT_TINTS, GHOST_TINT, LINE_TINTS
from jammkle_view.core.models import setting_of
from jammkle_view.core.samples import EventKind
from jammkle_view.overlay import Overlay, is_robot, overlay_of, robot_overlay
from jammkle_view.page import words
from jammkle_view.page.plots import BINS, Line, Mark, Plot
from jammkle_view.page.scene import RobotScene
from jammkle_view.page.server import address_of, is_watched, look_at, serve
from jammkle_view.recorded import read_recorded

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    import viser
    from numpy.typing import NDArray

    from jammkle_view.core.ankle import Quantity, Window
    from jammkle_view.core.figure import Rgb
    from jammkle_view.recorded import Curve, Recorded

_FRAME_S = 1.0 / 30.0


def run(
    bag: Path,
    namespace: str | None,
    rig: str | None,
    corrected: Path | None,
    host: str,
    port: int,
    asked_to_stop: Callable[[], bool],
    *,
    simulated: bool,
) -> int:
    """Show a bag until asked to stop; return the exit code. Options are those of `jammkle view`.

    Raises:
        InputError: no bag, an option that does not fit, or a port that is taken.

    """
    for option, value in (("--corrected", corrected), ("--rig", rig)):
        if value is not None and not simulated:
            msg = f"{option} {value} and --no-simulation exclude each other: give one of them"
            raise InputError(msg)
    server = serve(host, port, "Jammkle")  # first: a port that is taken shall not be found after a simulation
    try:
        with progress_bar(f"reading {bag}") as show:
            recorded = read_recorded(bag, namespace, lambda share: show(share, ""))
        overlay, why_not = _simulated(bag, recorded, rig, corrected) if simulated else (None, "")
        player = Player(recorded.duration_s)
        page = PlaybackPage(server, recorded, overlay, why_not, player)
        say(f"page: {address_of(server)}; Ctrl-C stops")
        before_s = time.monotonic()
        while not asked_to_stop():
            now_s = time.monotonic()
            player.go_on(now_s - before_s)
            before_s = now_s
            if is_watched(server):
                page.show(now_s)
            time.sleep(_FRAME_S)
    finally:
        server.stop()
    return 0


def _simulated(bag: Path, recorded: Recorded, rig: str | None, corrected: Path | None) -> tuple[Overlay | None, str]:
    """Return the simulation, and why there is none. What a user has asked for by name must work, or is refused."""
    of_robot = rig is None and is_robot(recorded)
    if of_robot and corrected is not None:
        msg = f"--corrected {corrected} needs a recording of a rig: effects are of an ankle on its rig"
        raise InputError(msg)
    try:
        with progress_bar("simulating the same") as show:
            if of_robot:
                return robot_overlay(bag, recorded, lambda share: show(share, "")), ""
            return overlay_of(bag, recorded, rig, corrected), ""
    except InputError as error:
        if corrected is not None or rig is not None:
            raise
        why_not = f"without simulation: {error}"
        say(why_not)
        return None, why_not


SPEEDS: tuple[str, ...] = ("0.02", "0.05", "0.1", "0.25", "0.5", "1", "2", "5", "10")
PLAY, PAUSE = "Play", "Pause"
_PLOT_PERIOD_S = 0.15
_PANEL_WIDTH_PX, _PLOTS_WIDTH_PX = 340.0, 430.0


class PlaybackPage:
    """Scene, plots and transport of one recording."""

    def __init__(
        self, server: viser.ViserServer, recorded: Recorded, overlay: Overlay | None, why_not: str, player: Player
    ) -> None:
        """Lay the page out; clicks move the player, which moves the page. `why_not`: why there is no overlay."""
        self._server, self._recorded, self._overlay, self._player = server, recorded, overlay, player
        self._slider_s = 0.0
        setting = setting_of(recorded.description)
        model = setting.model
        if overlay is not None and not recorded.description:
            model = overlay.runs[0].model
        self._namings = setting.ankles
        ankle = recorded.namespace.rpartition("/")[2]
        self._naming = setting.ankles.get(ankle, next(iter(setting.ankles.values())))
        self._robot = RobotScene(server, "/recorded", model, floats=setting.floats)
        self._ghost = None
        if overlay is not None:
            self._ghost = RobotScene(
                server, "/simulated", overlay.runs[0].model, GHOST_TINT, floats=setting.floats, beside=self._robot
            )
        look_at(server, self._robot.centre_m, self._robot.reach_m)
        gui = server.gui
        gui.main_panel.dock_right()
        gui.main_panel.set_width(_PANEL_WIDTH_PX)
        self._status = gui.add_html(words.status_html(()))
        self._add_transport(gui)
        self._channels = {channel: gui.add_html(words.channel_html(None, channel)) for channel in names.CHANNELS}
        with gui.add_folder("Felt by the controller"):
            self._events = gui.add_html(words.events_html(recorded.events))
        with gui.add_folder("Latest landing, and what is left"):
            self._landing = gui.add_html(words.landing_html(AnkleState()))
        self._add_overlay(gui, why_not)
        gui.add_html(words.legend_html())
        panel = gui.add_panel()
        panel.dock_left()
        panel.set_width(_PLOTS_WIDTH_PX)
        tab = panel.add_tab("Recording" if overlay is None else "Recording (simulation dashed)")
        with tab:
            window = gui.add_dropdown("time shown", tuple(WINDOWS_S), initial_value=WHOLE)
        self._plots = PlaybackPlots(gui, tab, recorded, overlay)

        @window.on_update
        def _(_event: object) -> None:
            self._wanted_window = str(window.value)

        self._wanted_window = WHOLE
        self._next_plot_s = 0.0
        self._plotted_at_s = math.nan
        self._shown_s = math.nan

    def show(self, now_s: float) -> None:
        """Show where the player stands, at a time of a steady clock, s."""
        asked_s = float(self._slider.value)
        if asked_s != self._slider_s and not math.isnan(asked_s):  # by somebody: the page's own is known
            self._slider_s = asked_s
            self._player.jump(asked_s)
        time_s = self._player.time_s
        with self._server.atomic():
            if self._plots.window != self._wanted_window:
                self._plots.set_window(self._wanted_window)
                self._plotted_at_s = math.nan
            if time_s != self._shown_s:
                self._shown_s = time_s
                state = self._recorded.state_at(time_s)
                self._show_robot(state, time_s)
                self._show_ghost(time_s)
                self._show_texts(state, time_s)
            if now_s >= self._next_plot_s and time_s != self._plotted_at_s:
                self._next_plot_s = now_s + _PLOT_PERIOD_S
                self._plotted_at_s = time_s
                self._plots.show(time_s)

    def _add_transport(self, gui: viser.GuiApi) -> None:
        duration_s = self._player.duration_s
        step_s = 10.0 ** math.floor(math.log10(duration_s / 1000.0))
        self._slider = gui.add_slider("time [s]", 0.0, duration_s, min(step_s, duration_s), 0.0)
        run = gui.add_button_group("playback", (PLAY, PAUSE))
        speed = gui.add_dropdown("speed", SPEEDS, initial_value="1", hint="Recorded time per real time")

        @run.on_click
        def _(_event: object) -> None:
            self._player.playing = run.value == PLAY

        @speed.on_update
        def _(_event: object) -> None:
            self._player.speed = float(speed.value)

    def _add_overlay(self, gui: viser.GuiApi, why_not: str) -> None:
        with gui.add_folder("The gap"):
            if self._overlay is None:
                gui.add_html(words.answer_html(why_not or "no simulation was asked for", good=not why_not))
                return
            shown = gui.add_checkbox("show simulation", initial_value=True)
            shown.on_update(lambda _: self._set_ghost(visible=bool(shown.value)))
            rows = [
                (gap.signal, words.scaled(gap.rms, gap.unit), words.scaled(gap.largest, gap.unit))
                for gap in self._overlay.gaps
                if any(gap.signal in quantity.signals.values() for quantity in QUANTITIES)
            ]
            gui.add_html(words.table_html(("simulated less recorded", "rms", "largest"), rows))
            for note in self._overlay.notes:
                gui.add_html(words.answer_html(note, good=True))

    _ghost_wanted = True

    def _set_ghost(self, *, visible: bool) -> None:
        self._ghost_wanted = visible
        self._shown_s = math.nan

    def _show_robot(self, state: AnkleState, time_s: float) -> None:
        others = [
            (self._namings[ankle], AnkleState(joints=track.at(time_s)))
            for ankle, track in self._recorded.others.items()
            if ankle in self._namings
        ]
        self._robot.show_ankles([(self._naming, state), *others])

    def _show_ghost(self, time_s: float) -> None:
        if self._ghost is None or self._overlay is None:
            return
        run = self._overlay.run_at(time_s)
        self._ghost.set_visible(visible=run is not None and self._ghost_wanted)
        if run is not None:
            self._ghost.show(run.joints.at(time_s), {}, {}, run.base_at(time_s))

    def _show_texts(self, state: AnkleState, time_s: float) -> None:
        self._status.content = words.status_html(
            (
                ("recording", self._recorded.name),
                ("time", f"{time_s:.3f} of {self._recorded.duration_s:.2f} s"),
            )
        )
        self._landing.content = words.landing_html(state)
        stands_s = float(self._slider.value)
        if stands_s == self._slider_s and abs(stands_s - time_s) > self._slider.step / 2.0:
            self._slider_s = time_s
            self._slider.value = time_s  # type: ignore[misc]  # viser sets it by a way of its own
        for channel, handle in self._channels.items():
            text = words.channel_html(state.channels.get(channel), channel)
            if handle.content != text:
                handle.content = text


WHOLE = "all of it"
WINDOWS_S: dict[str, float] = {WHOLE: math.inf, "20 s": 20.0, "5 s": 5.0, "1 s": 1.0, "0.2 s": 0.2}
"""How much time the plots show, around where the playback stands; s by name."""
QUANTITIES = (PRESSURE, FORCE, RATE, PITCH, CARRIAGE, TENSION)
_NOW = Mark("now", (20, 20, 20))
_HEIGHT_PX = 165
_JOINT_TINT: Rgb = (60, 60, 70)


class PlaybackPlots:
    """All plots of a recording."""

    def __init__(self, gui: viser.GuiApi, tab: viser.GuiTabHandle, recorded: Recorded, overlay: Overlay | None) -> None:
        """Draw them into a tab of the page, with the simulation if there is one."""
        self._gui, self._tab, self._recorded = gui, tab, recorded
        self._runs = () if overlay is None else tuple(run.signals for run in overlay.runs)
        self._quantities = [each for each in QUANTITIES if self._labels(each)]
        self._whole = {each: self._sampled(each, 0.0, math.inf) for each in self._quantities}
        self._plots: dict[Quantity, Plot] = {}
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
                each: Plot(self._gui, each, self._lines(each), axis_s, (*events, _NOW), height_px=_HEIGHT_PX)
                for each in self._quantities
            }

    def show(self, time_s: float) -> None:
        """Draw what is shown while the playback stands at a time, s."""
        span_s = WINDOWS_S[self.window]
        whole = math.isinf(span_s)
        start_s, end_s = (0.0, math.inf) if whole else (time_s - span_s / 2.0, time_s + span_s / 2.0)
        zero_s = 0.0 if whole else time_s
        marked = {kind.name.lower(): [each - zero_s for each in self._times_of(kind)] for kind in EventKind}
        marked[_NOW.label] = [time_s - zero_s]
        for quantity, plot in self._plots.items():
            base_s, values = self._whole[quantity] if whole else self._sampled(quantity, start_s, end_s)
            plot.show(base_s - zero_s, values, marked)

    def _times_of(self, kind: EventKind) -> list[float]:
        return [event.time_s for event in self._recorded.events if event.kind is kind]

    def _labels(self, quantity: Quantity, *, simulated: bool = False) -> list[str]:
        """Return the labels of what was measured, or of what was measured and simulated."""
        return [
            label
            for label, signal in quantity.signals.items()
            if signal in self._recorded.signals and (not simulated or any(signal in run for run in self._runs))
        ]

    def _lines(self, quantity: Quantity) -> list[Line]:
        """Return the lines of a plot: measured ones, then simulated ones."""
        measured = self._labels(quantity)
        tints = {label: LINE_TINTS.get(label, _JOINT_TINT) for label in measured}
        lines = [Line(label.replace("_", " "), tints[label]) for label in measured]
        for label in self._labels(quantity, simulated=True):
            if len(measured) == 1:
                lines.append(Line("simulated", GHOST_TINT, dashed=True))
            else:
                lines.append(Line(f"{label.replace('_', ' ')} sim", tints[label], dashed=True))
        return lines

    def _sampled(self, quantity: Quantity, start_s: float, end_s: float) -> Window:
        """Return all lines of a plot at the times of all of them, between two times, s, as many as it draws."""
        measured = [self._recorded.signals[quantity.signals[label]] for label in self._labels(quantity)]
        base_s = np.unique(np.concatenate([time_s for time_s, _ in measured]))
        base_s = base_s[(base_s >= start_s) & (base_s <= end_s)]
        columns = [_pieced(base_s, [curve]) for curve in measured]
        for label in self._labels(quantity, simulated=True):
            signal = quantity.signals[label]
            columns.append(_pieced(base_s, [run[signal] for run in self._runs if signal in run]))
        return thinned(base_s, np.stack(columns, axis=1), BINS)


def _pieced(base_s: NDArray[np.float64], runs: Sequence[Curve]) -> NDArray[np.float64]:
    """Return one signal at times, not a number where no run covers them."""
    whole = np.full(len(base_s), np.nan)
    for time_s, values in runs:
        inside = (base_s >= time_s[0]) & (base_s <= time_s[-1])
        whole[inside] = np.interp(base_s[inside], time_s, values)
    return whole


class Player:
    """A place in a recording, 0 to its duration, that moves on while it plays, and begins again at the end."""

    def __init__(self, duration_s: float) -> None:
        """Stand still at the start of a recording of a duration above 0, s."""
        self.duration_s = duration_s
        self.time_s = 0.0
        self.speed = 1.0
        """Recorded time per real time."""
        self.playing = False

    def go_on(self, real_s: float) -> None:
        """Let real time pass, s."""
        if self.playing:
            self.jump((self.time_s + self.speed * real_s) % self.duration_s)

    def jump(self, time_s: float) -> None:
        """Stand at a time, s, or at the end that is nearest to it; at no time that is none."""
        if not math.isnan(time_s):
            self.time_s = min(max(time_s, 0.0), self.duration_s)
