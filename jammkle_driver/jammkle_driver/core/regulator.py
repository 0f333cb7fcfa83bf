"""Vacuum regulation from measured pressure: the pump raises the one vacuum of all jammed channels, valves lower it."""

from __future__ import annotations

from dataclasses import dataclass

_DUTY_STEPS = 255
"""Duty is rounded to steps of an 8-bit PWM register, which keeps sensor noise off the topic."""

_LONGEST_STEP_S = 0.1
"""Longest time over which one sample counts for the integral, s; more is a gap in the data. Assumed."""


@dataclass(frozen=True)
class RegulatorSettings:
    """How vacuum is regulated.

    Attributes:
        proportional_gain_per_pa: Duty per Pa of missing vacuum, 1/Pa.
        integral_time_s: Time in which the integral repeats the proportional part, s.
        manifold_lead_pa: How far the manifold may be below the set point while a tendon follows, Pa.

    """

    proportional_gain_per_pa: float
    integral_time_s: float
    manifold_lead_pa: float


class PumpRegulator:
    """PI regulator from measured vacuum to pump duty, bounded 0 to 1, with conditional integration."""

    def __init__(self, settings: RegulatorSettings) -> None:
        """Make a regulator at rest."""
        self._settings = settings
        self._integral = 0.0

    def reset(self) -> None:
        """Forget the integral."""
        self._integral = 0.0

    def update(
        self, set_point_pa: float, channel_vacuum_pa: float, manifold_vacuum_pa: float | None, elapsed_s: float
    ) -> float:
        """Return the duty, 0 to 1.

        The channel is what counts. While the pump works the manifold runs ahead of the tendons, and what is drawn
        too much there cannot be given back but through a leak, so the manifold may only lead by so much.

        Args:
            set_point_pa: Vacuum wanted, Pa, >= 0.
            channel_vacuum_pa: Lowest vacuum among the jammed channels, Pa.
            manifold_vacuum_pa: Vacuum in the manifold, Pa, or None where it is not measured.
            elapsed_s: Time since the last update, s, >= 0.

        """
        settings = self._settings
        error_pa = set_point_pa - channel_vacuum_pa
        if manifold_vacuum_pa is not None:
            error_pa = min(error_pa, set_point_pa + settings.manifold_lead_pa - manifold_vacuum_pa)
        proportional = settings.proportional_gain_per_pa * error_pa
        step = proportional * min(max(elapsed_s, 0.0), _LONGEST_STEP_S) / settings.integral_time_s
        unbounded = proportional + self._integral + step
        # Anti-windup: at a bound, only a step that leads back from it counts.
        saturated = (unbounded > 1.0 and step > 0.0) or (unbounded < 0.0 and step < 0.0)
        if not saturated:
            self._integral = min(max(self._integral + step, 0.0), 1.0)
        duty = min(max(proportional + self._integral, 0.0), 1.0)
        return round(duty * _DUTY_STEPS) / _DUTY_STEPS


def draws(*, drawing: bool, set_point_pa: float, vacuum_pa: float, band_pa: float) -> bool:
    """Return whether a channel's solenoid shall be energised to reach its set point.

    A 3/2 solenoid cannot hold: it either connects to the manifold or vents. A channel that has too much, as after a
    lower set point, is therefore released above the band, and energised again at the set point. Air that comes in
    this way lowers the manifold too, until all is within the band and the channel stays connected.

    Args:
        drawing: Whether it is energised now.
        set_point_pa: Vacuum wanted, Pa; at 0 the answer is always no.
        vacuum_pa: Vacuum measured in the channel, Pa.
        band_pa: Width of the hysteresis above the set point, Pa.

    """
    if set_point_pa <= 0.0:
        return False
    return vacuum_pa <= set_point_pa + band_pa if drawing else vacuum_pa < set_point_pa
