"""State of one pneumatic channel, from what was asked, what is measured, and how long it takes."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from jammkle_driver.core.regulator import draws

_SMOOTHING_TIME_S = 0.2
"""Time over which a switched channel's vacuum is averaged, s: several switches at 20 to 40 per second. Assumed."""


class ChannelState(enum.Enum):
    """What a channel is doing; values as in jammkle_msgs/ChannelJamState."""

    UNKNOWN = 0
    """No pressure has been measured, or the driver is not active."""
    UNJAMMED = 1
    """Vented; the tendons are soft."""
    JAMMING = 2
    """Evacuating towards the set point."""
    JAMMED = 3
    """At the set point, within tolerance."""
    VENTING = 4
    """Solenoid released, vacuum still above what was asked for."""
    FAULT = 5
    """Does not follow; released until the fault is cleared."""


@dataclass(frozen=True)
class ChannelSettings:
    """When a channel counts as jammed, vented or failed.

    Attributes:
        tolerance_pa: Distance from the set point within which a channel becomes JAMMED, and above which its
            solenoid is released, Pa.
        hysteresis_pa: How much further it must go to leave JAMMED or UNJAMMED again, Pa.
        vented_vacuum_pa: Vacuum below which a channel counts as vented, Pa.
        jam_timeout_s: Longest time in JAMMING, s.
        vent_timeout_s: Longest time in VENTING, s.

    """

    tolerance_pa: float
    hysteresis_pa: float
    vented_vacuum_pa: float
    jam_timeout_s: float
    vent_timeout_s: float


@dataclass(frozen=True)
class ChannelStatus:
    """What is known of one channel.

    Attributes:
        name: The channel.
        state: See `ChannelState`.
        commanded_vacuum_pa: Vacuum asked for, Pa; 0 = unjam.
        measured_vacuum_pa: Vacuum measured, Pa; None where it is not.
        reason: Why it is in this state, in plain English.

    """

    name: str
    state: ChannelState
    commanded_vacuum_pa: float
    measured_vacuum_pa: float | None
    reason: str


class Channel:
    """State machine of one channel. Fed with wishes and measurements; says whether to energise the solenoid."""

    def __init__(self, name: str, settings: ChannelSettings) -> None:
        """Make a disabled channel about which nothing is known."""
        self._name = name
        self._settings = settings
        self._enabled = False
        self._state = ChannelState.UNKNOWN
        self._set_point_pa = 0.0
        self._vacuum_pa: float | None = None
        self._reason = "driver is not active"
        self._in_state_s = 0.0
        self._energised = False
        self._smoothed_pa = 0.0
        self._deepest_pa = 0.0
        self._may_vent = True

    @property
    def name(self) -> str:
        """Name of the channel."""
        return self._name

    @property
    def state(self) -> ChannelState:
        """Where the channel stands."""
        return self._state

    @property
    def set_point_pa(self) -> float:
        """Vacuum to hold, Pa; 0 = unjam."""
        return self._set_point_pa

    @property
    def vacuum_pa(self) -> float | None:
        """Vacuum measured, Pa; None where it is not."""
        return self._vacuum_pa

    @property
    def energised(self) -> bool:
        """Whether the solenoid shall connect the channel to the manifold."""
        return self._energised

    @property
    def status(self) -> ChannelStatus:
        """Everything known of the channel."""
        reason = self._reason
        if self._is_switched and self._state is not ChannelState.FAULT:
            reason = f"{reason}; switched, since the manifold holds {self._deepest_pa:.0f} Pa for others"
        return ChannelStatus(self._name, self._state, self._set_point_pa, self._vacuum_pa, reason)

    def enable(self) -> None:
        """Start to follow; nothing is wanted yet."""
        self._enabled = True
        if self._state is not ChannelState.FAULT:
            self._set_point_pa = 0.0
            self._reason = "" if self._vacuum_pa is not None else "no pressure measured yet"
            self._follow()

    def disable(self, reason: str) -> None:
        """Release, and follow nothing until `enable`; a fault stays."""
        self._enabled = False
        self._set_point_pa = 0.0
        if self._state is not ChannelState.FAULT:
            self._reason = reason
        self._follow()

    def ask(self, vacuum_pa: float, reason: str) -> None:
        """Take a new wish: `vacuum_pa` Pa, 0 to vent. A channel that is disabled or in FAULT stays as it is."""
        if not self._enabled or self._state is ChannelState.FAULT:
            return
        self._set_point_pa = vacuum_pa
        self._reason = reason
        self._follow()

    def measure(self, vacuum_pa: float, elapsed_s: float) -> None:
        """Take a measurement of `vacuum_pa` Pa, `elapsed_s` s after the one before (0 for the first)."""
        if self._vacuum_pa is None and self._state is ChannelState.UNKNOWN and self._enabled:
            self._reason = ""
        weight = 1.0 if self._vacuum_pa is None else elapsed_s / (elapsed_s + _SMOOTHING_TIME_S)
        self._smoothed_pa += weight * (vacuum_pa - self._smoothed_pa)
        self._vacuum_pa = vacuum_pa
        self._in_state_s += elapsed_s
        if self._is_switched and vacuum_pa >= self._set_point_pa:
            # It can be reached; that the mean is lower is the price of switching and no fault.
            self._in_state_s = 0.0
        self._follow()
        self._check_time()

    def share(self, deepest_pa: float, *, may_vent: bool) -> None:
        """Take note of the manifold: the deepest set point of all, Pa, and whether the pump can spare a refill."""
        self._deepest_pa = deepest_pa
        self._may_vent = may_vent
        self._follow()

    def forget_pressure(self) -> None:
        """Treat the pressure as not measured."""
        self._vacuum_pa = None
        self._follow()

    def fail(self, reason: str) -> None:
        """Go to FAULT and release until `clear`."""
        self._set_point_pa = 0.0
        self._reason = reason
        self._enter(ChannelState.FAULT)
        self._energised = False

    def clear(self) -> None:
        """Leave FAULT, vented; nothing is wanted."""
        if self._state is not ChannelState.FAULT:
            return
        self._set_point_pa = 0.0
        self._reason = "fault cleared" if self._enabled else "driver is not active"
        self._enter(ChannelState.UNKNOWN)
        self._follow()

    @property
    def _is_switched(self) -> bool:
        return 0.0 < self._set_point_pa < self._deepest_pa

    def _follow(self) -> None:
        if self._state is not ChannelState.FAULT:
            self._enter(self._observed())
        if self._state in (ChannelState.FAULT, ChannelState.UNKNOWN) or self._vacuum_pa is None:
            self._energised = False
            return
        self._energised = draws(
            drawing=self._energised,
            set_point_pa=self._set_point_pa,
            vacuum_pa=self._vacuum_pa,
            band_pa=self._settings.tolerance_pa,
            may_vent=self._may_vent or not self._is_switched,
        )

    def _observed(self) -> ChannelState:
        if not self._enabled or self._vacuum_pa is None:
            return ChannelState.UNKNOWN
        settings = self._settings
        if self._set_point_pa == 0.0:
            slack_pa = settings.hysteresis_pa if self._state is ChannelState.UNJAMMED else 0.0
            vented = self._vacuum_pa <= settings.vented_vacuum_pa + slack_pa
            return ChannelState.UNJAMMED if vented else ChannelState.VENTING
        slack_pa = settings.hysteresis_pa if self._state is ChannelState.JAMMED else 0.0
        if self._is_switched:
            # The pressure swings around the set point by nature; its mean, and only from below, is what tells.
            is_low = self._set_point_pa - self._smoothed_pa > settings.tolerance_pa + slack_pa
            return ChannelState.JAMMING if is_low else ChannelState.JAMMED
        error_pa = self._vacuum_pa - self._set_point_pa
        if abs(error_pa) <= settings.tolerance_pa + slack_pa:
            return ChannelState.JAMMED
        return ChannelState.JAMMING if error_pa < 0.0 else ChannelState.VENTING

    def _enter(self, state: ChannelState) -> None:
        if state is not self._state:
            self._state = state
            self._in_state_s = 0.0

    def _check_time(self) -> None:
        settings = self._settings
        if self._state is ChannelState.JAMMING and self._in_state_s > settings.jam_timeout_s:
            self.fail(
                f"reached {self._vacuum_pa:.0f} of {self._set_point_pa:.0f} Pa in {settings.jam_timeout_s:g} s "
                "(jam_timeout_s): look for a leak or a weak pump, then call ~/clear_fault"
            )
        elif self._state is ChannelState.VENTING and self._in_state_s > settings.vent_timeout_s:
            self.fail(
                f"still at {self._vacuum_pa:.0f} Pa, wanted {self._set_point_pa:.0f} Pa, after venting for "
                f"{settings.vent_timeout_s:g} s (vent_timeout_s): look for a stuck valve, then call ~/clear_fault"
            )
