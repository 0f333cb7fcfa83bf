"""State of one pneumatic channel, from what was asked, what is measured, and how long it takes."""

from __future__ import annotations

import enum
from dataclasses import replace
from typing import TYPE_CHECKING

from jammkle_driver.core.faults import Finding, Reason, finding

if TYPE_CHECKING:
    from jammkle_driver.parameters import DriverParameters


class ChannelState(enum.Enum):
    """What a channel is doing; values as in jammkle_msgs/ChannelJamState."""

    UNKNOWN = 0
    """No pressure has been measured, or the driver is not active."""
    UNJAMMED = 1
    """Vented; the tendons are soft."""
    JAMMING = 2
    """Evacuating towards the set point."""
    JAMMED = 3
    """At the set point, within tolerance on both sides."""
    VENTING = 4
    """Solenoid released, vacuum still above what was asked for."""
    FAULT = 5
    """Does not follow; released until the fault is cleared."""


_LETS_NO_AIR_IN = "look for a stuck valve or a blocked vent"
"""What to do about a channel that stays deeper than its set point: no leak and no weak pump leave it there."""


class Channel:
    """State machine of one channel. Fed with set points and measurements; says whether to energise the solenoid.

    Attributes:
        name: The channel.
        state: See `ChannelState`.
        set_point_pa: Vacuum asked for, Pa; 0 = unjam.
        vacuum_pa: Vacuum measured, Pa; None where it is not.
        energised: Whether the solenoid shall connect the channel to the manifold.
        held: Whether it is kept connected as it is, in the safe state `hold`.
        why: Why it is in this state, what has failed, or why it was let go; NONE where nothing is wrong.
    """

    def __init__(self, name: str, parameters: DriverParameters) -> None:
        """Make a disabled channel about which nothing is known."""
        self.name = name
        self._parameters = parameters
        self._enabled = False
        self.state = ChannelState.UNKNOWN
        self.set_point_pa = 0.0
        self.vacuum_pa: float | None = None
        self.why = Finding(Reason.NONE, name, "driver is not active")
        self._in_state_s = 0.0
        self._missed_s = 0.0
        self.energised = False
        self.held = False

    @property
    def excess_pa(self) -> float:
        """How far a connected channel is above the band around its set point, and from there, Pa; 0 where it is not."""
        if not self.energised or self.held or self.vacuum_pa is None:
            return 0.0
        excess_pa = self.vacuum_pa - self.set_point_pa
        return excess_pa if excess_pa > self._parameters.tolerance_pa else 0.0

    def enable(self) -> None:
        """Start to follow; nothing is wanted yet."""
        self._enabled = True
        if self.state is not ChannelState.FAULT:
            self.set_point_pa = 0.0
            self.why = replace(self.why, text="" if self.vacuum_pa is not None else "no pressure measured yet")
            self._follow()

    def disable(self, reason: str) -> None:
        """Release, and follow nothing until `enable`; a fault stays."""
        self._enabled = False
        self.set_point_pa = 0.0
        if self.state is not ChannelState.FAULT:
            self.why = replace(self.why, text=reason)
        self._follow()

    def hold(self, why: Finding) -> None:
        """Stay connected as it is, until the next set point: nothing is regulated, and nothing counts as missed."""
        self.held = True
        self.why = why

    def ask(self, vacuum_pa: float, reason: str) -> None:
        """Take a new set point, `vacuum_pa` Pa, 0 to vent, and who asks, or why.

        A channel that is disabled or in FAULT stays as it is.
        """
        if not self._enabled or self.state is ChannelState.FAULT:
            return
        self.held = False
        if vacuum_pa != self.set_point_pa:
            self._missed_s = self._in_state_s = 0.0
        self.set_point_pa = vacuum_pa
        self.why = Finding(Reason.NONE, self.name, reason)
        self._follow()

    def let_go(self, why: Finding) -> None:
        """Vent, not because anybody asks for it, but for what was found. A channel in FAULT keeps its first reason."""
        if not self._enabled or self.state is ChannelState.FAULT:
            return
        self.ask(0.0, why.text)
        self.why = why

    def measure(self, vacuum_pa: float, elapsed_s: float) -> None:
        """Take a measurement of `vacuum_pa` Pa, which counts for `elapsed_s` s; 0 for the first."""
        if self.vacuum_pa is None and self.state is ChannelState.UNKNOWN and self._enabled:
            self.why = replace(self.why, text="")
        self.vacuum_pa = vacuum_pa
        self._in_state_s += elapsed_s
        self._missed_s += elapsed_s
        self._follow()
        if self.set_point_pa == 0.0 or self.held or self.state is ChannelState.JAMMED:
            self._missed_s = 0.0
        self._check_time()

    def forget_pressure(self) -> None:
        """Treat the pressure as not measured."""
        self.vacuum_pa = None
        self._follow()

    def fail(self, why: Finding) -> None:
        """Go to FAULT and release until `clear`; one that is in FAULT keeps its first reason.

        But a board that did not answer, and then says that it has started anew, had been away for that.
        """
        if self.state is ChannelState.FAULT:
            if self.why.reason is Reason.BOARD_UNPLUGGED and why.reason in {Reason.BOARD_REBOOTED, Reason.BROWN_OUT}:
                self.why = why
            return
        self.set_point_pa = 0.0
        self.held = False
        self.why = why
        self._enter(ChannelState.FAULT)
        self.energised = False

    def clear(self) -> None:
        """Leave FAULT, or forget an emergency stop: vented, nothing is wanted."""
        self.set_point_pa = 0.0
        self.held = False
        text = "cleared by ~/clear_fault" if self._enabled else "driver is not active"
        self.why = Finding(Reason.NONE, self.name, text)
        if self.state is ChannelState.FAULT:
            self._enter(ChannelState.UNKNOWN)
        self._follow()

    def _follow(self) -> None:
        if self.state is not ChannelState.FAULT:
            self._enter(self._observed())
        if self.state in (ChannelState.FAULT, ChannelState.UNKNOWN) or self.vacuum_pa is None:
            self.energised = False
            return
        if self.held:
            return
        self.energised = self.set_point_pa > 0.0

    def _observed(self) -> ChannelState:
        if not self._enabled or self.vacuum_pa is None:
            return ChannelState.UNKNOWN
        parameters = self._parameters
        if self.set_point_pa == 0.0:
            slack_pa = parameters.hysteresis_pa if self.state is ChannelState.UNJAMMED else 0.0
            vented = self.vacuum_pa <= parameters.vented_vacuum_pa + slack_pa
            return ChannelState.UNJAMMED if vented else ChannelState.VENTING
        error_pa = self.vacuum_pa - self.set_point_pa
        if abs(error_pa) <= parameters.tolerance_pa:
            return ChannelState.JAMMED
        return ChannelState.JAMMING if error_pa < 0.0 else ChannelState.VENTING

    def _enter(self, state: ChannelState) -> None:
        if state is not self.state:
            self.state = state
            self._in_state_s = 0.0

    def _check_time(self) -> None:
        longest_jam_s, longest_vent_s = self._parameters.longest_jam_s, self._parameters.vent_timeout_s
        if self._missed_s > longest_jam_s:
            seen = (
                f"at {self.vacuum_pa:.0f} of {self.set_point_pa:.0f} Pa, not JAMMED for {self._parameters.longest_jam}"
            )
            too_deep = self.vacuum_pa is not None and self.vacuum_pa > self.set_point_pa
            self._give_up(Reason.NOT_REACHED, seen, _LETS_NO_AIR_IN if too_deep else "")
        elif self.set_point_pa == 0.0 and self.state is ChannelState.VENTING and self._in_state_s > longest_vent_s:
            seen = (
                f"still at {self.vacuum_pa:.0f} Pa, wanted {self.set_point_pa:.0f} Pa, after venting for "
                f"{longest_vent_s:g} s (vent_timeout_s)"
            )
            self._give_up(Reason.NOT_VENTED, seen)

    def _give_up(self, reason: Reason, seen: str, remedy: str = "") -> None:
        self.fail(finding(reason, self.name, seen, missed(self), remedy).to_clear())


def missed(channel: Channel) -> dict[str, str]:
    """Return in numbers for people how far a channel is from what it was asked for."""
    return {
        "vacuum wanted (Pa)": f"{channel.set_point_pa:.0f}",
        "vacuum at last (Pa)": "not measured" if channel.vacuum_pa is None else f"{channel.vacuum_pa:.0f}",
    }
