"""The driver without ROS: who may ask what, what the actuators do, and what is known of the channels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_driver.core.ankle import Ankle, AnkleSettings, FaultPolicy, SafeState
from jammkle_driver.core.channel import ChannelState
from jammkle_driver.core.faults import REMEDIES, Reason
from jammkle_driver.core.hardware import MANIFOLD, REFERENCE_PA, ActuatorCommand, PressureSample, released
from jammkle_driver.core.overload import OverloadStatus, OverloadWatch
from jammkle_driver.core.requests import (
    RequestError,
    VacuumLimits,
    Wish,
    check_shared_vacuum,
    checked_channels,
    checked_vacuum,
    checked_wishes,
)
from jammkle_driver.core.status import DriverStatus, Trouble
from jammkle_driver.core.stream import WishStream
from jammkle_driver.core.watchdog import Instant, Watchdog

if TYPE_CHECKING:
    from collections.abc import Sequence

INACTIVE = "driver is not active"


@dataclass(frozen=True)
class DriverSettings:
    """Everything that can be set about the driver.

    Attributes:
        limits: Vacuum that may be asked for.
        ankle: What channels, pump and diagnosis go by.
        command_timeout_s: Silence after which what a stream of wishes jammed is let go, s.
        pressure_timeout_s: Silence after which a pressure counts as not measured, s.
        emergency_stop_timeout_s: Silence of the emergency stop that counts as a stop, s; 0 = never.
        tick_period_s: Time between two calls of `Driver.tick`, s.

    """

    limits: VacuumLimits
    ankle: AnkleSettings
    command_timeout_s: float
    pressure_timeout_s: float
    emergency_stop_timeout_s: float
    tick_period_s: float


class Driver:
    """Takes requests, measurements and the time; says what the actuators shall do and what is known.

    Requests are atomic: they raise `RequestError` and change nothing, or are taken whole and return one line that
    says what was taken. Per channel the latest change wins, from wherever it came. All jammed channels share one
    vacuum, since they share one manifold.
    """

    def __init__(self, channels: Sequence[str], settings: DriverSettings) -> None:
        """Make an inactive driver: everything released."""
        self._names = tuple(channels)
        self._settings = settings
        self._limits = settings.limits
        self._ankle = Ankle(self._names, settings.ankle)
        self._stream = WishStream(settings.command_timeout_s)
        self._silences = {place: Watchdog(settings.pressure_timeout_s) for place in (*self._names, MANIFOLD)}
        self._stop_silence = Watchdog(settings.emergency_stop_timeout_s or math.inf)
        self._overload = OverloadWatch(settings.tick_period_s)
        self._steady_s = 0.0
        self._active = False
        self._stop_asked = False
        self._stop_reason = ""
        self._board_waits = False

    @property
    def limits(self) -> VacuumLimits:
        """Vacuum that may be asked for."""
        return self._limits

    def limit(self, limits: VacuumLimits) -> None:
        """Take new limits; what was asked before stays."""
        self._limits = limits

    def declare_ambient(self, pressure_pa: float) -> None:
        """Take what a parameter says of the atmosphere, Pa; vented channels that say otherwise are believed more."""
        self._ankle.atmosphere.declare(pressure_pa)

    @property
    def command(self) -> ActuatorCommand:
        """What the actuators shall do now."""
        if not self._active:
            return released(self._names)
        if self._stop_reason and not self._ankle.held:
            return released(self._names)
        return self._ankle.command

    @property
    def status(self) -> DriverStatus:
        """What is known now."""
        ankle = self._ankle
        return DriverStatus(
            active=self._active,
            stop_reason=self._stop_reason,
            manifold_vacuum_pa=ankle.manifold_vacuum_pa,
            channels=tuple(channel.status for channel in ankle.channels.values()),
            trouble=self._trouble(),
            limits=self._limits,
            atmosphere=ankle.atmosphere.status,
            held=ankle.held,
        )

    @property
    def ankle(self) -> Ankle:
        """The ankle, to look at."""
        return self._ankle

    @property
    def own_pace(self) -> OverloadStatus:
        """What is known of the driver's own pace."""
        return self._overload.status(self._steady_s)

    def activate(self, now: Instant) -> None:
        """Start to follow requests; nothing is wanted yet. An emergency stop and faults stay until cleared."""
        self._active = True
        self._stream.forget()
        self._stop_silence.feed(now)
        for channel in self._ankle.channels.values():
            channel.enable()
        self._ankle.regulate(0.0)

    def deactivate(self) -> None:
        """Release everything and refuse requests; faults stay until cleared."""
        self._active = False
        self._stream.forget()
        self._ankle.release()
        for channel in self._ankle.channels.values():
            channel.disable(INACTIVE)
        self._ankle.regulate(0.0)

    def reset(self) -> None:
        """Be as new, inactive; only an emergency stop stays."""
        self._ankle.reset()
        for silence in self._silences.values():
            silence.forget()
        self.deactivate()

    def jam(self, channels: Sequence[str], vacuum_pa: float, asked_by: str) -> str:
        """Jam channels (none named: all) with `vacuum_pa` Pa, 0 for the default.

        Raises:
            RequestError: unknown channel, vacuum out of range, driver inactive or stopped, channel in fault or
                without a measured pressure, another channel jammed to another vacuum. Nothing has changed.

        """
        names = checked_channels(channels, self._names)
        vacuum_pa = checked_vacuum(vacuum_pa, self.limits)
        self._check_ready("jam")
        for name in names:
            status = self._ankle.channels[name].status
            if status.state is ChannelState.FAULT:
                msg = f"channel '{name}' is in FAULT ({status.reason}); nothing was jammed"
                raise RequestError(msg)
            if not self._ankle.able(name):
                failed = self._ankle.faulty[0].status
                msg = (
                    f"channel '{failed.name}' is in FAULT ({failed.reason}); fault_policy is ankle: nothing was jammed"
                )
                raise RequestError(msg)
            if status.state is ChannelState.UNKNOWN:
                msg = f"no pressure of channel '{name}' is measured; start the hardware or simulation first"
                raise RequestError(msg)
        wishes = [Wish(name, vacuum_pa) for name in names]
        check_shared_vacuum(wishes, self._ankle.set_points_pa)
        for wish in wishes:
            self._take(wish, f"asked by {asked_by}")
            self._stream.release(wish.channel)
        self._ankle.regulate(0.0)
        return f"jamming {', '.join(names)} at {vacuum_pa:g} Pa below ambient"

    def unjam(self, channels: Sequence[str], asked_by: str) -> str:
        """Vent channels (none named: all).

        Raises:
            RequestError: unknown channel, or the driver is inactive. Nothing has changed.

        """
        names = checked_channels(channels, self._names)
        if not self._active:
            msg = f"{INACTIVE}: every channel is vented already; activate it to follow requests"
            raise RequestError(msg)
        self._ankle.release()
        for name in names:
            self._take(Wish(name, 0.0), f"asked by {asked_by}")
            self._stream.release(name)
        self._ankle.regulate(0.0)
        return f"unjamming {', '.join(names)}"

    def follow(self, wishes: Sequence[Wish], now: Instant, asked_by: str) -> None:
        """Take one message of a stream of wishes; only changes count, repeating keeps them alive.

        A channel in FAULT or stopped does not follow, and the change is spent: it does not jam by itself later.
        A message that jams with a new vacuum takes the jammed channels that it names along to it.

        Raises:
            RequestError: one of the wishes is bad, a channel that is not named is jammed to another vacuum, or the
                driver is inactive. Nothing has changed, and the message is no sign of life.

        """
        if not self._active:
            msg = f"{INACTIVE}: activate it first"
            raise RequestError(msg)
        checked = checked_wishes(wishes, self._names, self.limits)
        # Before its first measurement a channel cannot follow; the wish counts as soon as it can.
        heard = [
            wish
            for wish in checked
            if self._ankle.channels[wish.channel].vacuum_pa is not None and not self._board_waits
        ]
        able = [wish for wish in heard if self._can_follow(wish.channel)]
        new = self._stream.changes(able)
        jams = any(wish.vacuum_pa > 0.0 for wish in new)
        taken = [wish for wish in able if wish in new or (jams and self._holds_another(wish))]
        check_shared_vacuum(taken, self._ankle.set_points_pa)
        self._stream.hear(heard, now)
        for wish in taken:
            self._take(wish, f"asked by {asked_by}")
            self._stream.lead(wish.channel)
        self._ankle.regulate(0.0)

    def emergency_stop(self, *, stop: bool, now: Instant) -> None:
        """Take the latest word on the emergency stop: True releases everything, False only permits `clear_fault`."""
        self._stop_silence.feed(now)
        self._stop_asked = stop
        if stop:
            self._stop("emergency_stop is true")

    def clear_fault(self, now: Instant) -> str:
        """Leave every fault and the emergency stop; all channels stay vented until asked anew.

        Raises:
            RequestError: the emergency stop is still asked for. Nothing has changed.

        """
        if self._stop_asked:
            msg = "emergency_stop is still true; publish false on it first, then call ~/clear_fault again"
            raise RequestError(msg)
        faulty = self._ankle.faulty
        cleared = (["emergency stop"] if self._stop_reason else []) + [channel.name for channel in faulty]
        for channel in faulty:
            if self._silences[channel.name].expired(now):
                channel.forget_pressure()
        if cleared:
            self._ankle.clear(tuple(self._ankle.channels.values()) if self._stop_reason else faulty)
        self._stop_reason = ""
        self._stop_silence.feed(now)
        return f"cleared: {', '.join(cleared)}" if cleared else "nothing to clear"

    def measure(self, sample: PressureSample, now: Instant) -> None:
        """Take a pressure sample. One that is not a finite number counts as none."""
        if not math.isfinite(sample.vacuum_pa):
            return
        self._silences[sample.place].feed(now)
        self._ankle.measure(sample.place, REFERENCE_PA - sample.vacuum_pa, sample.stamp_s, now)

    @property
    def jammed(self) -> bool:
        """Whether a channel is asked to jam."""
        return self._ankle.jammed

    def fail(self, reason: str, fault: Reason = Reason.BOARD_UNPLUGGED) -> None:
        """Put every channel into FAULT: what drives them has failed."""
        self._ankle.fail(self._names, reason, fault)

    def wait_for_board(self, *, wait: bool) -> None:
        """Jam nothing while the board, which had let go, has not yet taken the release; a stream's wish then counts."""
        self._board_waits = wait

    def was_let_go(self, reason: str) -> None:
        """Note that the hardware has let go of everything by itself; a stream that goes on jams anew."""
        for name in self._names:
            if self._ankle.channels[name].set_point_pa > 0.0:
                self._ankle.ask(name, 0.0, reason, Reason.BOARD_LET_GO)
        self._stream.forget()
        self._ankle.regulate(0.0)

    def tick(self, now: Instant) -> None:
        """Look at the clocks: let go, fail or stop what has gone silent. To be called several times a second."""
        self._steady_s = now.steady_s
        stood_s = self._overload.tick(now.steady_s)
        if stood_s > 0.0:
            # Who stood still has heard nothing, and nobody is to blame for that.
            for silence in (*self._silences.values(), self._stop_silence):
                silence.excuse(stood_s)
            self._stream.excuse(stood_s)
            self._ankle.stood_still()
        self._look_at_sensors(now)
        for name in self._stream.fall_silent(now):
            reason = f"no accepted jam_command for {self._stream.timeout_s:g} s (command_timeout_s)"
            verb = "unjammed" if self._settings.ankle.safe_state is SafeState.VENT else "held"
            self._ankle.let_go((name,), f"{verb}: {reason}", Reason.COMMANDS_STALE)
        if self._active and not self._stop_reason and self._stop_silence.expired(now):
            self._stop(f"no emergency_stop for {self._stop_silence.timeout_s:g} s (emergency_stop_timeout_s)")
        self._ankle.regulate(0.0)

    def _look_at_sensors(self, now: Instant) -> None:
        silent = [
            name
            for name, channel in self._ankle.channels.items()
            if channel.vacuum_pa is not None and self._silences[name].expired(now)
        ]
        if self._silences[MANIFOLD].expired(now):
            self._ankle.manifold_vacuum_pa = None
        for name in silent:
            self._ankle.channels[name].forget_pressure()
        if not silent or not self._active:
            return
        every = len(silent) == len(self._names) and self._ankle.manifold_vacuum_pa is None
        fault = Reason.BOARD_UNPLUGGED if every else Reason.SENSOR_DEAD
        whose = "of any sensor " if every else ""
        timeout_s = self._settings.pressure_timeout_s
        remedy = "look at hardware or simulation" if every else REMEDIES[fault]
        self._ankle.fail(
            silent,
            f"no valid pressure {whose}for {timeout_s:g} s (pressure_timeout_s): {remedy}, then call ~/clear_fault",
            fault,
        )

    def _trouble(self) -> Trouble:
        """Return the worst that is known of the whole ankle."""
        ankle = self._ankle
        faulty = ankle.faulty
        if faulty:
            acts = "kept as they were, pump off" if ankle.held else "vented"
            others = "every channel" if self._settings.ankle.fault_policy is FaultPolicy.ANKLE else faulty[0].name
            return Trouble(faulty[0].fault, faulty[0].status.reason, f"{others} {acts} until ~/clear_fault")
        let_go = [channel for channel in ankle.channels.values() if channel.fault is not Reason.NONE]
        if let_go:
            acts = "kept as it was, pump off" if ankle.held else "vented"
            names = ", ".join(channel.name for channel in let_go)
            return Trouble(let_go[0].fault, let_go[0].status.reason, f"{names} {acts} until asked anew")
        if self._silences[MANIFOLD].fed and ankle.manifold_vacuum_pa is None:
            text = f"manifold: no pressure for {self._settings.pressure_timeout_s:g} s: {REMEDIES[Reason.SENSOR_DEAD]}"
            return Trouble(Reason.SENSOR_DEAD, text, "the pump is regulated by the channels alone")
        own = self.own_pace
        if own.overloaded:
            stalls = f"it stood still {own.stalls} times, at most {own.longest_s:.2f} s"
            text = f"the driver's work comes {own.late_s:.3f} s late; {stalls}"
            return Trouble(Reason.EXECUTOR_OVERLOADED, text, "none: the board lets go where that lasts")
        return Trouble()

    def _check_ready(self, verb: str) -> None:
        if not self._active:
            msg = f"{INACTIVE}: cannot {verb}; activate it first (lifecycle transition 'activate')"
            raise RequestError(msg)
        if self._stop_reason:
            msg = f"emergency stop ({self._stop_reason}): cannot {verb}; release it, then call ~/clear_fault"
            raise RequestError(msg)
        if self._board_waits:
            msg = f"the board has let go and has not yet taken the release: cannot {verb}; ask again"
            raise RequestError(msg)

    def _can_follow(self, channel: str) -> bool:
        return not self._stop_reason and self._ankle.able(channel)

    def _holds_another(self, wish: Wish) -> bool:
        return wish.vacuum_pa > 0.0 and self._ankle.channels[wish.channel].set_point_pa not in (0.0, wish.vacuum_pa)

    def _take(self, wish: Wish, reason: str) -> None:
        self._ankle.ask(wish.channel, wish.vacuum_pa, reason)

    def _stop(self, reason: str) -> None:
        if self._stop_reason:
            return
        self._stop_reason = reason
        self._ankle.let_go(self._names, f"emergency stop: {reason}", Reason.NONE)
        for name in self._names:
            if not self._ankle.held:
                self._ankle.channels[name].ask(0.0, f"emergency stop: {reason}")
            self._stream.release(name)
        self._ankle.regulate(0.0)
