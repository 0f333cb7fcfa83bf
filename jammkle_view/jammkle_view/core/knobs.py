"""Numbers of a simulation that may be changed while it runs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_sim.robots.options import ROBOTS, Behaviour

if TYPE_CHECKING:
    from jammkle_view.core.models import Setting

_LANDING = "landing"
"""Rig of the sim node, whose slope and drop height may be changed."""
_STEEPEST_DEG = {_LANDING: 50.0, **dict.fromkeys(ROBOTS, 40.0)}
"""As far as the simulation allows."""
_HIGHEST_MM = 200.0
"""Chosen: four times the default; the simulation allows 500 mm."""


@dataclass(frozen=True)
class Knob:
    """A number of the simulation, as a slider offers it."""

    parameter: str
    label: str
    minimum: float
    maximum: float
    step: float
    start: float
    per_unit: float = 1.0
    """What one unit of the slider is in the parameter's unit."""
    hint: str = ""


def knobs_of(setting: Setting) -> tuple[Knob, ...]:
    """Return what can be changed while a setting is simulated."""
    hint = "Holds from the next reset on"
    knobs = [Knob("speed", "speed", 0.05, 2.0, 0.05, 1.0, hint="Simulated time per real time")]
    if setting.rig in _STEEPEST_DEG:
        slope_deg = float(setting.options["slope_deg"])
        steepest_deg = _STEEPEST_DEG[setting.rig]
        knobs.append(Knob("slope_deg", "slope [deg]", 0.0, steepest_deg, 1.0, slope_deg, hint=hint))
    if setting.rig == _LANDING or setting.options.get("behaviour") == Behaviour.DROP.value:
        height_mm = 1e3 * float(setting.options["drop_height_m"])
        knobs.append(Knob("drop_height_m", "drop height [mm]", 0.0, _HIGHEST_MM, 5.0, height_mm, 1e-3, hint))
    return tuple(knobs)
