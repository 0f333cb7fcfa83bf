"""Buttons of the simulation: pause, go on, reset; how fast it runs, what it lands on and from where."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_view.core.wishes import Action, Ask, SetSim

if TYPE_CHECKING:
    from collections.abc import Callable

    import viser

    from jammkle_view.core.knobs import Knob
    from jammkle_view.core.wishes import Wish

PAUSE, GO_ON, RESET = "Pause", "Go on", "Reset"


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
                    self._wish(Ask(ankle, action))

            for knob in knobs:
                self._add_slider(knob)
        self._folder.visible = True
        self._wish(Ask(ankles[0], Action.TELL_SPEED))

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
                    self._wish(SetSim(ankle, knob.parameter, float(slider.value) * knob.per_unit))
