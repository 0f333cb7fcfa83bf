"""Buttons of the simulation: pause, go on, reset; how fast it runs, what it lands on and from where."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_view.core.wishes import Action, Ask, SetSim

if TYPE_CHECKING:
    from collections.abc import Callable

    import viser

    from jammkle_view.core.wishes import Wish

PAUSE, GO_ON, RESET = "Pause", "Go on", "Reset"


@dataclass(frozen=True)
class Knob:
    """A number of the simulation that may be changed while it runs."""

    parameter: str
    label: str
    minimum: float
    maximum: float
    step: float
    start: float
    per_unit: float = 1.0
    """What one unit of the slider is in the parameter's unit."""
    hint: str = ""


class SimControls:
    """What can be asked of the simulation, in a folder that is out of sight until there is one."""

    def __init__(self, gui: viser.GuiApi, wish: Callable[[Wish], None]) -> None:
        """Keep a place for it where the interface stands.

        Args:
            gui: Of the page.
            wish: Takes what is asked for, from any thread.

        """
        self._gui, self._wish = gui, wish
        self._folder = gui.add_folder("Simulation", visible=False)
        self._offered = False
        self._sliders: dict[str, viser.GuiSliderHandle[float]] = {}

    def offer(self, ankle: str, knobs: tuple[Knob, ...]) -> None:
        """Show what can be asked for, the first time that it is known.

        Args:
            ankle: In whose namespace the simulation is.
            knobs: What can be turned.

        """
        if self._offered:
            return
        self._offered = True
        with self._folder:
            run = self._gui.add_button_group("time", (PAUSE, GO_ON, RESET))

            @run.on_click
            def _(_event: object) -> None:
                action = {PAUSE: Action.PAUSE, GO_ON: Action.GO_ON, RESET: Action.RESET}[run.value]
                self._wish(Ask(ankle, action))

            for knob in knobs:
                self._add_slider(ankle, knob)
        self._folder.visible = True
        self._wish(Ask(ankle, Action.TELL_SPEED))

    def show(self, parameter: str, value: float) -> None:
        """Put a slider where the simulation has its parameter, as far as it reaches."""
        slider = self._sliders.get(parameter)
        if slider is not None:
            slider.value = min(max(value, slider.min), slider.max)  # type: ignore[misc]  # set by a way of viser's own

    def _add_slider(self, ankle: str, knob: Knob) -> None:
        slider = self._gui.add_slider(
            knob.label, knob.minimum, knob.maximum, knob.step, knob.start, hint=knob.hint or None
        )
        self._sliders[knob.parameter] = slider

        @slider.on_update
        def _(event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
            if event.client is not None:  # moved by somebody, not by `show`
                self._wish(SetSim(ankle, knob.parameter, float(slider.value) * knob.per_unit))
