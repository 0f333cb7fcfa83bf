"""Vacuum regulation from measured pressure: the pump raises the one vacuum of all jammed channels, valves lower it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from jammkle_driver.core.air import REFERENCE_PA

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_driver.parameters import DriverParameters

_DUTY_STEPS = 255
"""Duty is rounded to steps of an 8-bit PWM register, which keeps sensor noise off the topic."""

_NEARLY_ALL = 0.9
"""Duty from which a pump counts as working at full duty, 1: noise of 100 Pa moves the duty by a fortieth."""

LATE_S = 0.03
"""Time between two readings from which they come late, s: three cycles of a line at 100 Hz."""

_CHANNEL_LEAD = 0.5
"""How far any channel may be below the set point while another follows, over the band above which its solenoid is
released: one that never follows must not make the others vent."""

_LONGEST_STEP_S = 0.1
"""Longest time over which one sample counts for the integral, s; more is a gap in the data. Assumed."""


class PumpRegulator:
    """PI regulator from measured vacuum to pump duty, bounded 0 to 1, with conditional integration.

    `full_s` is for how long the pump has worked at full duty for one set point without coming to it, s; `resting`,
    whether the set point is held without the pump.
    """

    def __init__(self, parameters: DriverParameters) -> None:
        """Make a regulator at rest."""
        self._parameters = parameters
        self._integral = 0.0
        self.resting = False
        self._set_point_pa = 0.0
        self.full_s = 0.0

    def reset(self) -> None:
        """Forget the integral, and how long the pump has worked."""
        self._integral = 0.0
        self.resting = False
        self.full_s = 0.0

    def update(
        self,
        set_point_pa: float,
        channel_vacuum_pa: float,
        manifold_vacuum_pa: float | None,
        elapsed_s: float,
        *,
        deepest_vacuum_pa: float = 0.0,
        rise_pa: float = 0.0,
    ) -> float:
        """Return the duty, 0 to 1.

        The channel is what counts. While the pump works the manifold runs ahead of the tendons, and what is drawn
        too much there cannot be given back but through a leak, so the manifold may only lead by so much, and
        each channel by less. A channel counts as no deeper than the manifold: tendons that are drawn from follow it.

        Args:
            set_point_pa: Vacuum wanted, Pa, >= 0.
            channel_vacuum_pa: Lowest vacuum among the jammed channels, Pa.
            manifold_vacuum_pa: Vacuum in the manifold, Pa, or None where it is not measured.
            elapsed_s: Time since the last update, s, >= 0.
            deepest_vacuum_pa: Highest vacuum among the channels that are connected, Pa; 0 where none is.
            rise_pa: What the pump adds at full duty until the answer to the next reading, Pa, where readings come late:
                the duty is lower then, so that the set point is not passed meanwhile. 0: they come in time.

        """
        parameters = self._parameters
        if manifold_vacuum_pa is not None:
            deepest_vacuum_pa = min(deepest_vacuum_pa, manifold_vacuum_pa)
        spare_pa = set_point_pa + _CHANNEL_LEAD * parameters.tolerance_pa - deepest_vacuum_pa
        error_pa = min(set_point_pa - channel_vacuum_pa, spare_pa)
        # A tight ankle holds its vacuum by itself; a pump that trickles would wear out for nothing.
        self.resting = error_pa <= (parameters.pump_rest_band_pa if self.resting else 0.0)
        if self.resting:
            self._integral = self.full_s = 0.0
            return 0.0
        if manifold_vacuum_pa is not None:
            error_pa = min(error_pa, set_point_pa + parameters.manifold_lead_pa - manifold_vacuum_pa)
        proportional = parameters.regulator_gain_per_pa * error_pa
        passed_s = min(max(elapsed_s, 0.0), _LONGEST_STEP_S)
        step = proportional * passed_s / parameters.regulator_integral_time_s
        unbounded = proportional + self._integral + step
        # Anti-windup: at a bound, only a step that leads back from it counts.
        saturated = (unbounded > 1.0 and step > 0.0) or (unbounded < 0.0 and step < 0.0)
        if not saturated:
            self._integral = min(max(self._integral + step, 0.0), 1.0)
        most = 1.0 if rise_pa <= max(error_pa, 0.0) else max(error_pa, 0.0) / rise_pa
        duty = min(max(proportional + self._integral, 0.0), most)
        goes_on = duty >= _NEARLY_ALL and set_point_pa == self._set_point_pa
        self.full_s = self.full_s + passed_s if goes_on else 0.0
        self._set_point_pa = set_point_pa
        return round(duty * _DUTY_STEPS) / _DUTY_STEPS


class PumpLoad:
    """How warm the pump is, by a first-order model of its mean duty: what it bears for ever is `pump_rated_duty`.

    Short work at full duty is free; the pump is `limited` to the rated one once the mean has come up to it, and until
    that has fallen by a tenth (the usual I^2 t protection of drives, IEC 60034-1 duty type S3, with duty for the
    losses).
    """

    def __init__(self, parameters: DriverParameters) -> None:
        """Make a cold pump."""
        self._parameters = parameters
        self.mean_duty = 0.0
        self.limited = False

    def spare(self, duty: float, elapsed_s: float) -> float:
        """Return the duty that the pump may have, 0 to 1, `elapsed_s` s after the last one."""
        rated = self._parameters.pump_rated_duty
        self.limited = self.mean_duty >= (0.9 * rated if self.limited else rated)
        allowed = min(duty, 0.9 * rated) if self.limited and rated < 1.0 else duty
        share = min(max(elapsed_s, 0.0) / self._parameters.pump_thermal_time_s, 1.0)
        self.mean_duty += share * (allowed - self.mean_duty)
        return allowed


class ExcessVent:
    """Lowers the one vacuum of all jammed channels by short pulses of single valves, after a lower set point.

    A 3/2 valve cannot hold: it either connects to the manifold or vents, and then lets in `C p_atmosphere` of air,
    which fills a tendon of 6 mL in 0.06 s. With the dead times of valve, line and sensor on top, a valve that waits for
    its reading to come down lets nearly all of the vacuum go. But the manifold is a store: what one valve lets in
    within one reading, 1 mL, is 2.6 kPa of all that is connected. So a channel vents for one reading and is connected
    again; what it lacks comes from the others, and the next pulse waits until that has settled. The larger a channel,
    the less it dips meanwhile, so that the largest come first; as many at once as the excess asks for.
    """

    SETTLE_S = 0.06
    """From one pulse to the next, s: a dead time of 20 ms, a cycle of 10 ms, and 30 ms in which it evens out."""

    LONGEST_WAIT_S = 0.5
    """How long readings that come late, in which a valve would let in too much, are waited out, s."""

    def __init__(self, volumes_m3: Mapping[str, float], conductance_m3_s_pa: float) -> None:
        """Vent channels of these volumes, m^3, through valves of this sonic conductance, m^3/(s Pa)."""
        self._volumes_m3 = volumes_m3
        self._inflow_pa_m3_s = conductance_m3_s_pa * REFERENCE_PA * REFERENCE_PA
        self._pulsed_at_s = -math.inf
        self._excessive_since_s: float | None = None

    def pulse(
        self, excesses_pa: Mapping[str, float], connected_m3: float, stamp_s: float, period_s: float
    ) -> frozenset[str]:
        """Return the channels that vent from `stamp_s` until the next reading, `period_s` later.

        `excesses_pa` are of the channels that are connected and above the set point; `connected_m3` is all air that is
        connected.
        """
        if not excesses_pa:
            self._excessive_since_s = None
            return frozenset()
        if self._excessive_since_s is None or stamp_s < self._excessive_since_s:
            self._excessive_since_s = stamp_s
        if 0.0 <= stamp_s - self._pulsed_at_s < self.SETTLE_S:
            return frozenset()
        by_one_pa = self._inflow_pa_m3_s * period_s / connected_m3
        excess_pa = min(excesses_pa.values())
        too_much = by_one_pa > 2.0 * excess_pa and period_s > LATE_S
        if too_much and stamp_s - self._excessive_since_s < self.LONGEST_WAIT_S:
            return frozenset()
        self._pulsed_at_s = stamp_s
        count = max(1, int(excess_pa / by_one_pa))
        largest_first = sorted(excesses_pa, key=lambda name: -self._volumes_m3[name])
        return frozenset(largest_first[:count])
