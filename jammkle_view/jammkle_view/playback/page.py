"""The page of a recording: scrub, play at any speed, and see the simulation beside what was measured."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from jammkle_common import names
from jammkle_view.core.models import setting_of
from jammkle_view.core.samples import Channel, ChannelState
from jammkle_view.core.tints import GHOST_TINT, tendon_tint
from jammkle_view.page import words
from jammkle_view.page.scene import RobotScene
from jammkle_view.page.server import look_at
from jammkle_view.playback.plots import PLOTTED, WHOLE, WINDOWS_S, PlaybackPlots
from jammkle_view.playback.recorded import base_at

if TYPE_CHECKING:
    import viser

    from jammkle_view.core.samples import JamReport
    from jammkle_view.core.tints import Rgb
    from jammkle_view.playback.overlay import Overlay
    from jammkle_view.playback.player import Player
    from jammkle_view.playback.recorded import Recorded

SPEEDS: tuple[str, ...] = ("0.02", "0.05", "0.1", "0.25", "0.5", "1", "2", "5", "10")
PLAY, PAUSE = "Play", "Pause"
_PLOT_PERIOD_S = 0.15
_PANEL_WIDTH_PX, _PLOTS_WIDTH_PX = 340.0, 430.0
_CHANNEL_OF = {tendon: channel for channel, tendons in names.TENDONS_OF_CHANNEL.items() for tendon in tendons}
_AMBIENT_PA = 101325.0
"""What a pressure stands for no vacuum at, where no driver says more. Standard atmosphere (ISO 2533)."""


class PlaybackPage:
    """Scene, plots and transport of one recording."""

    def __init__(
        self, server: viser.ViserServer, recorded: Recorded, overlay: Overlay | None, why_not: str, player: Player
    ) -> None:
        """Lay the page out.

        Args:
            server: Running.
            recorded: What is played back.
            overlay: Its simulation; None: there is none.
            why_not: Why there is none; may be empty.
            player: Is moved by what is clicked, and moves the page.

        """
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
        """Show where the player stands.

        Args:
            now_s: Real time, s, from a steady clock.

        """
        asked_s = float(self._slider.value)
        if asked_s != self._slider_s:  # by somebody: what the page has written itself is known
            self._slider_s = asked_s
            self._player.jump(asked_s)
        time_s = self._player.time_s
        with self._server.atomic():
            if self._plots.window != self._wanted_window:
                self._plots.set_window(self._wanted_window)
                self._plotted_at_s = math.nan
            if time_s != self._shown_s:
                self._shown_s = time_s
                self._show_robot(time_s)
                self._show_ghost(time_s)
                self._show_texts(time_s)
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
                if gap.signal in PLOTTED
            ]
            gui.add_html(words.table_html(("simulated less recorded", "rms", "largest"), rows))
            for note in self._overlay.notes:
                gui.add_html(words.answer_html(note, good=True))

    _ghost_wanted = True

    def _set_ghost(self, *, visible: bool) -> None:
        self._ghost_wanted = visible
        self._shown_s = math.nan

    def _show_robot(self, time_s: float) -> None:
        report = self._recorded.report_at(time_s)
        tensions_n = self._recorded.tensions_n.at(time_s)
        tints: dict[str, Rgb] = {}
        shares: dict[str, float] = {}
        for told, channel in _CHANNEL_OF.items():
            tendon, share = self._naming.tendon(told), self._vacuum_share(channel, time_s)
            state = self._state(report, channel, share)
            broken = self._recorded.broken.get(told, math.inf) <= time_s
            tints[tendon] = tendon_tint(state, tensions_n.get(told, 0.0), broken=broken)
            shares[tendon] = share
        moved = {self._naming.joint(told): value for told, value in self._recorded.joints.at(time_s).items()}
        for ankle, track in self._recorded.others.items():
            if ankle in self._namings:
                moved |= {self._namings[ankle].joint(told): value for told, value in track.at(time_s).items()}
        self._robot.show(moved, tints, shares, self._recorded.base_at(time_s))

    def _vacuum_share(self, channel: str, time_s: float) -> float:
        topic = names.PRESSURES[channel].name if channel in names.PRESSURES else ""
        track = self._recorded.pressures_pa.get(topic)
        if track is None:
            return 0.0
        return min(max(1.0 - track.at(time_s)[topic] / _AMBIENT_PA, 0.0), 1.0)

    @staticmethod
    def _state(report: JamReport | None, channel: str, vacuum_share: float) -> ChannelState:
        """Return what the driver said; where there was none, what the pressure shows."""
        if report is not None and channel in report.channels:
            return report.channels[channel].state
        return ChannelState.JAMMED if vacuum_share > 0.1 else ChannelState.UNJAMMED  # noqa: PLR2004 - a tenth

    def _channel(self, report: JamReport | None, channel: str, time_s: float) -> Channel:
        """Return what the driver said of a channel; where there was none, what its pressure shows."""
        if report is not None and channel in report.channels:
            return report.channels[channel]
        share = self._vacuum_share(channel, time_s)
        return Channel(self._state(None, channel, share), math.nan, share * _AMBIENT_PA, "by its pressure")

    def _show_ghost(self, time_s: float) -> None:
        if self._ghost is None or self._overlay is None:
            return
        run = self._overlay.run_at(time_s)
        self._ghost.set_visible(visible=run is not None and self._ghost_wanted)
        if run is not None:
            self._ghost.show(run.joints.at(time_s), {}, {}, base_at(run.base, time_s))

    def _show_texts(self, time_s: float) -> None:
        self._status.content = words.status_html(
            (
                ("recording", self._recorded.name),
                ("time", f"{time_s:.3f} of {self._recorded.duration_s:.2f} s"),
            )
        )
        stands_s = float(self._slider.value)
        if stands_s == self._slider_s and abs(stands_s - time_s) > self._slider.step / 2.0:
            self._slider_s = time_s
            self._slider.value = time_s  # type: ignore[misc]  # viser sets it by a way of its own
        report = self._recorded.report_at(time_s)
        for channel, handle in self._channels.items():
            text = words.channel_html(self._channel(report, channel, time_s), channel)
            if handle.content != text:
                handle.content = text
