"""Controls: of one ankle, jam and unjam, who decides, emergency stop; of the simulation, time, speed and set-up."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_common.constants import HELD_VACUUM_PA
from jammkle_common.names import CHANNELS
from jammkle_view.core.samples import Action, Ask, ChannelState, Jam, SetSim, Unjam
from jammkle_view.page.words import channel_html

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import viser

    from jammkle_view.core.models import Knob
    from jammkle_view.core.samples import Channel, Request

_PA_PER_KPA = 1000.0
JAM, UNJAM = "Jam", "Unjam"
_JAMMING = (ChannelState.JAMMING, ChannelState.JAMMED)
AUTO, MANUAL = "Controller", "Page alone"


class AnkleControls:
    """What can be asked of one ankle, and what its channels are doing."""

    def __init__(self, gui: viser.GuiApi, ankle: str, request: Callable[[Request], None]) -> None:
        """Lay it out where the interface stands.

        Args:
            gui: Of the page.
            ankle: Whose.
            request: Takes what is asked for, from any thread.

        """
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
        """Keep a place for it where the interface stands.

        Args:
            gui: Of the page.
            request: Takes what is asked for, from any thread.

        """
        self._gui, self._request = gui, request
        self._folder = gui.add_folder("Simulation", visible=False)
        self._ankles: tuple[str, ...] = ()
        self._sliders: dict[str, viser.GuiSliderHandle[float]] = {}

    def offer(self, ankles: tuple[str, ...], knobs: tuple[Knob, ...]) -> None:
        """Show what can be asked for, once it is known; each simulation that is there is asked.

        Args:
            ankles: In whose namespaces the simulations are.
            knobs: What can be turned.

        """
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
