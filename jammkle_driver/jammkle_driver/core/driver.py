"""The driver without ROS: who may ask what, what the actuators do, and what is known of the channels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_driver.core.channel import Channel, ChannelSettings, ChannelState
from jammkle_driver.core.hardware import MANIFOLD, ActuatorCommand, PressureSample, released
from jammkle_driver.core.regulator import PumpRegulator, RegulatorSettings
from jammkle_driver.core.requests import (
    RequestError,
    VacuumLimits,
    Wish,
    check_shared_vacuum,
    checked_channels,
    checked_vacuum,
    checked_wishes,
)
from jammkle_driver.core.status import DriverStatus
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
        channel: When a channel counts as jammed, vented or failed.
        regulator: How vacuum is regulated.
        command_timeout_s: Silence after which what a stream of wishes jammed is vented, s.
        pressure_timeout_s: Silence after which a pressure counts as not measured, s.
        emergency_stop_timeout_s: Silence of the emergency stop that counts as a stop, s; 0 = never.

    """

    limits: VacuumLimits
    channel: ChannelSettings
    regulator: RegulatorSettings
    command_timeout_s: float
    pressure_timeout_s: float
    emergency_stop_timeout_s: float


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
        self._channels = {name: Channel(name, settings.channel) for name in self._names}
        self._regulator = PumpRegulator(settings.regulator)
        self._stream = WishStream(settings.command_timeout_s)
        self._silences = {place: Watchdog(settings.pressure_timeout_s) for place in (*self._names, MANIFOLD)}
        self._stop_silence = Watchdog(settings.emergency_stop_timeout_s or math.inf)
        self._stamps: dict[str, float] = {}
        self._manifold_vacuum_pa: float | None = None
        self._regulated_at_s = -math.inf
        self._duty = 0.0
        self._active = False
        self._stop_asked = False
        self._stop_reason = ""

    @property
    def limits(self) -> VacuumLimits:
        """Vacuum that may be asked for."""
        return self._limits

    def limit(self, limits: VacuumLimits) -> None:
        """Take new limits; what was asked before stays."""
        self._limits = limits

    @property
    def command(self) -> ActuatorCommand:
        """What the actuators shall do now."""
        if not self._active or self._stop_reason:
            return released(self._names)
        return ActuatorCommand({name: self._channels[name].energised for name in self._names}, self._duty)

    @property
    def status(self) -> DriverStatus:
        """What is known now."""
        channels = tuple(channel.status for channel in self._channels.values())
        return DriverStatus(self._active, self._stop_reason, self._manifold_vacuum_pa, channels)

    def activate(self, now: Instant) -> None:
        """Start to follow requests; nothing is wanted yet. An emergency stop and faults stay until cleared."""
        self._active = True
        self._stream.forget()
        self._stop_silence.feed(now)
        for channel in self._channels.values():
            channel.enable()

    def deactivate(self) -> None:
        """Release everything and refuse requests; faults stay until cleared."""
        self._active = False
        self._stream.forget()
        for channel in self._channels.values():
            channel.disable(INACTIVE)
        self._regulate(0.0)

    def reset(self) -> None:
        """Be as new, inactive; only an emergency stop stays."""
        self._channels = {name: Channel(name, self._settings.channel) for name in self._names}
        self._manifold_vacuum_pa = None
        self._stamps.clear()
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
            status = self._channels[name].status
            if status.state is ChannelState.FAULT:
                msg = f"channel '{name}' is in FAULT ({status.reason}); nothing was jammed"
                raise RequestError(msg)
            if status.state is ChannelState.UNKNOWN:
                msg = f"no pressure of channel '{name}' is measured; start the hardware or simulation first"
                raise RequestError(msg)
        wishes = [Wish(name, vacuum_pa) for name in names]
        check_shared_vacuum(wishes, self._set_points_pa)
        for wish in wishes:
            self._take(wish, f"asked by {asked_by}")
            self._stream.release(wish.channel)
        self._regulate(0.0)
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
        for name in names:
            self._take(Wish(name, 0.0), f"asked by {asked_by}")
            self._stream.release(name)
        self._regulate(0.0)
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
        heard = [wish for wish in checked if self._channels[wish.channel].vacuum_pa is not None]
        able = [wish for wish in heard if self._can_follow(wish.channel)]
        new = self._stream.changes(able)
        jams = any(wish.vacuum_pa > 0.0 for wish in new)
        taken = [wish for wish in able if wish in new or (jams and self._holds_another(wish))]
        check_shared_vacuum(taken, self._set_points_pa)
        self._stream.hear(heard, now)
        for wish in taken:
            self._take(wish, f"asked by {asked_by}")
            self._stream.lead(wish.channel)
        self._regulate(0.0)

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
        faults = [channel.name for channel in self._channels.values() if channel.state is ChannelState.FAULT]
        cleared = (["emergency stop"] if self._stop_reason else []) + faults
        for channel in self._channels.values():
            if channel.state is ChannelState.FAULT and self._silences[channel.name].expired(now):
                channel.forget_pressure()
            if self._stop_reason or channel.state is ChannelState.FAULT:
                channel.clear()
        self._stop_reason = ""
        self._stop_silence.feed(now)
        return f"cleared: {', '.join(cleared)}" if cleared else "nothing to clear"

    def measure(self, sample: PressureSample, now: Instant) -> None:
        """Take a pressure sample. One that is not a finite number counts as none."""
        if not math.isfinite(sample.vacuum_pa):
            return
        self._silences[sample.place].feed(now)
        elapsed_s = max(sample.stamp_s - self._stamps.get(sample.place, sample.stamp_s), 0.0)
        self._stamps[sample.place] = sample.stamp_s
        if sample.place == MANIFOLD:
            self._manifold_vacuum_pa = sample.vacuum_pa
        else:
            self._channels[sample.place].measure(sample.vacuum_pa, elapsed_s)
        # Samples of one moment come one by one; the pump is set once per moment.
        if sample.stamp_s != self._regulated_at_s:
            since_s = sample.stamp_s - self._regulated_at_s
            self._regulated_at_s = sample.stamp_s
            self._regulate(since_s if math.isfinite(since_s) else 0.0)

    @property
    def jammed(self) -> bool:
        """Whether a channel is asked to jam."""
        return any(channel.set_point_pa > 0.0 for channel in self._channels.values())

    def fail(self, reason: str) -> None:
        """Put every channel into FAULT: what drives them has failed."""
        for channel in self._channels.values():
            channel.fail(reason)
        self._regulate(0.0)

    def tick(self, now: Instant) -> None:
        """Look at the clocks: vent, fail or stop what has gone silent. To be called several times a second."""
        for name, channel in self._channels.items():
            if channel.vacuum_pa is not None and self._silences[name].expired(now):
                channel.forget_pressure()
                if self._active:
                    timeout_s = self._settings.pressure_timeout_s
                    channel.fail(
                        f"no valid pressure for {timeout_s:g} s (pressure_timeout_s): "
                        "look at the sensor, then call ~/clear_fault"
                    )
        if self._silences[MANIFOLD].expired(now):
            self._manifold_vacuum_pa = None
        for name in self._stream.fall_silent(now):
            reason = f"unjammed: no accepted jam_command for {self._stream.timeout_s:g} s (command_timeout_s)"
            self._take(Wish(name, 0.0), reason)
        if self._active and not self._stop_reason and self._stop_silence.expired(now):
            self._stop(f"no emergency_stop for {self._stop_silence.timeout_s:g} s (emergency_stop_timeout_s)")
        self._regulate(0.0)

    def _check_ready(self, verb: str) -> None:
        if not self._active:
            msg = f"{INACTIVE}: cannot {verb}; activate it first (lifecycle transition 'activate')"
            raise RequestError(msg)
        if self._stop_reason:
            msg = f"emergency stop ({self._stop_reason}): cannot {verb}; release it, then call ~/clear_fault"
            raise RequestError(msg)

    @property
    def _set_points_pa(self) -> dict[str, float]:
        return {name: channel.set_point_pa for name, channel in self._channels.items()}

    def _can_follow(self, channel: str) -> bool:
        return not self._stop_reason and self._channels[channel].state is not ChannelState.FAULT

    def _holds_another(self, wish: Wish) -> bool:
        return wish.vacuum_pa > 0.0 and self._channels[wish.channel].set_point_pa not in (0.0, wish.vacuum_pa)

    def _take(self, wish: Wish, reason: str) -> None:
        self._channels[wish.channel].ask(wish.vacuum_pa, reason)

    def _stop(self, reason: str) -> None:
        self._stop_reason = reason
        for channel in self._channels.values():
            channel.ask(0.0, f"emergency stop: {reason}")
            self._stream.release(channel.name)
        self._regulate(0.0)

    def _regulate(self, elapsed_s: float) -> None:
        jammed = [channel for channel in self._channels.values() if channel.set_point_pa > 0.0]
        measured_pa = [channel.vacuum_pa for channel in jammed if channel.vacuum_pa is not None]
        if not measured_pa:
            self._regulator.reset()
            self._duty = 0.0
            return
        set_point_pa = jammed[0].set_point_pa
        self._duty = self._regulator.update(set_point_pa, min(measured_pa), self._manifold_vacuum_pa, elapsed_s)
