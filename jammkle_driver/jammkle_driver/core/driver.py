"""The driver without ROS: who may ask what, what the actuators do, and what is known of the channels."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from jammkle_common.names import WAY_BACK
from jammkle_driver.core.admission import INACTIVE, check_able, check_ready
from jammkle_driver.core.ankle import Ankle, SafeState
from jammkle_driver.core.emergency_stop import EmergencyStop
from jammkle_driver.core.faults import Finding, Reason
from jammkle_driver.core.hardware import ActuatorCommand, LinkState, LinkStatus, PressureSample, released
from jammkle_driver.core.link import BOARD, LinkGuard, NoiseMeter, RestartWatch
from jammkle_driver.core.overload import OverloadStatus, OverloadWatch
from jammkle_driver.core.publishers import ONLY_PUBLISHER, Publication
from jammkle_driver.core.requests import (
    RequestError,
    Wish,
    check_shared_vacuum,
    checked_channels,
    checked_vacuum,
    checked_wishes,
)
from jammkle_driver.core.sensors import SensorWatch
from jammkle_driver.core.status import DriverStatus, Trouble, worst_trouble
from jammkle_driver.core.stream import WishStreams

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_driver.core.requests import VacuumLimits
    from jammkle_driver.core.settings import DriverSettings
    from jammkle_driver.core.watchdog import Instant


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
        self._streams = WishStreams(settings.command_timeout_s)
        self._sensors = SensorWatch(self._names, settings.pressure_timeout_s, settings.tick_period_s)
        self._emergency_stop = EmergencyStop(settings.emergency_stop_timeout_s)
        self._overload = OverloadWatch(settings.tick_period_s)
        self._link_guard = LinkGuard()
        self._noise = NoiseMeter()
        self._restarts = RestartWatch()
        self._steady_s = 0.0
        self._ticked_s: float | None = None
        self._active = False
        self._stopped = False
        self._board_waits = False
        self._link = LinkStatus(LinkState.SEARCHING)
        self._plant_restarts = 0
        self._plant_paused = False
        self._line_noise: Finding | None = None
        self._restarted: Finding | None = None

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
        if not self._active:
            return released(self._names)
        if self._emergency_stop.reason and not self._ankle.held:
            return released(self._names)
        return self._ankle.command

    @property
    def status(self) -> DriverStatus:
        """What is known now."""
        ankle = self._ankle
        return DriverStatus(
            active=self._active,
            stop_reason=self._emergency_stop.reason,
            manifold_vacuum_pa=ankle.manifold_vacuum_pa,
            channels=tuple(channel.status for channel in ankle.channels.values()),
            trouble=self._trouble,
            limits=self._limits,
            atmosphere=ankle.atmosphere.status,
            held=ankle.held,
            line_noise=self._line_noise,
            restarted=self._restarted,
            stop_publishers=self._emergency_stop.publishers,
            stop_asked_by=self._emergency_stop.asked_by,
            commanders=self._streams.speaking,
        )

    @property
    def standing(self) -> tuple[object, ...]:
        """All of the status but what was measured: what everybody is to know at once when it changes."""
        channels = [(each.state, each.set_point_pa, each.reason) for each in self._ankle.channels.values()]
        return (
            self._active,
            self._emergency_stop.reason,
            self._streams.speaking,
            self._trouble.reason,
            self._limits,
            *channels,
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
        self._streams.forget()
        self._emergency_stop.begin(now)
        for channel in self._ankle.channels.values():
            channel.enable()
        self._ankle.regulate(0.0)

    def deactivate(self) -> None:
        """Release everything and refuse requests; faults stay until cleared."""
        self._active = False
        self._streams.forget()
        self._ankle.release()
        for channel in self._ankle.channels.values():
            channel.disable(INACTIVE)
        self._ankle.regulate(0.0)

    def reset(self) -> None:
        """Be as new, inactive; only an emergency stop stays."""
        self._ankle.reset()
        self._sensors.forget()
        self._link_guard = LinkGuard()
        self.deactivate()

    def jam(self, channels: Sequence[str], vacuum_pa: float, asked_by: str) -> str:
        """Jam channels (none named: all) with `vacuum_pa` Pa, 0 for the default.

        Raises:
            RequestError: unknown channel, vacuum out of range, driver inactive or stopped, channel in fault or
                without a measured pressure, another channel jammed to another vacuum. Nothing has changed.

        """
        names = checked_channels(channels, self._names)
        vacuum_pa = checked_vacuum(vacuum_pa, self.limits)
        check_ready(active=self._active, stop_reason=self._emergency_stop.reason, board=self._why_not_ready)
        check_able(self._ankle, names)
        wishes = [Wish(name, vacuum_pa) for name in names]
        check_shared_vacuum(wishes, self._ankle.set_points_pa)
        for wish in wishes:
            self._take(wish, f"asked by {asked_by}")
            self._streams.release(wish.channel)
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
            self._streams.release(name)
        self._ankle.regulate(0.0)
        return f"unjamming {', '.join(names)}; {WAY_BACK}"

    def follow(
        self,
        wishes: Sequence[Wish],
        now: Instant,
        asked_by: str,
        *,
        anew: bool = False,
        publication: Publication = ONLY_PUBLISHER,
    ) -> None:
        """Take one message of a stream of wishes; only changes count, repeating keeps them alive.

        A channel in FAULT or stopped does not follow, and the change is spent: it does not jam by itself later.
        With `anew` everything counts as a change: that is the way back after a service, a fault or a stop.
        A message that jams with a new vacuum takes the jammed channels that it names along to it.
        Changes are those of each publisher, so that two that contradict one another do not take turns.

        Raises:
            RequestError: one of the wishes is bad, a channel that is not named is jammed to another vacuum, or the
                driver is inactive. Nothing has changed, and the message is no sign of life.

        """
        if not self._active:
            msg = f"{INACTIVE}: activate it first"
            raise RequestError(msg)
        stream = self._streams.of(wishes, publication, now)
        if stream is None:
            return
        checked = checked_wishes(wishes, self._names, self.limits)
        # Before its first measurement a channel cannot follow; the wish counts as soon as it can.
        heard = [
            wish
            for wish in checked
            if self._ankle.channels[wish.channel].vacuum_pa is not None and not self._why_not_ready
        ]
        able = [wish for wish in heard if self._can_follow(wish.channel)]
        new = tuple(able) if anew else stream.changes(able)
        jams = any(wish.vacuum_pa > 0.0 for wish in new)
        taken = [wish for wish in able if wish in new or (jams and self._holds_another(wish))]
        check_shared_vacuum(taken, self._ankle.set_points_pa)
        stream.hear(heard, now)
        for wish in taken:
            self._take(wish, f"asked by {asked_by}")
            self._streams.lead(stream, wish.channel)
        self._ankle.regulate(0.0)

    def emergency_stop(self, *, stop: bool, now: Instant, publication: Publication = ONLY_PUBLISHER) -> None:
        """Take a message of an emergency stop: True releases everything, False only permits `clear_fault`.

        There may be several publishers: one that says True suffices, and only itself, or its end, takes that back.
        """
        self._emergency_stop.take(publication, now, stop=stop)
        self._obey_stop()

    def clear_fault(self, now: Instant) -> str:
        """Leave every fault and the emergency stop; all channels stay vented until asked anew.

        Raises:
            RequestError: the emergency stop is still asked for. Nothing has changed.

        """
        was_stopped = bool(self._emergency_stop.reason)
        refusal = self._emergency_stop.clear(now)
        if refusal:
            raise RequestError(refusal)
        faulty = self._ankle.faulty
        cleared = (["emergency stop"] if was_stopped else []) + [channel.name for channel in faulty]
        for channel in faulty:
            if self._sensors.silent(channel.name):
                channel.forget_pressure()
        if cleared:
            self._ankle.clear(tuple(self._ankle.channels.values()) if was_stopped else faulty)
        self._stopped = False
        self._link_guard.clear()
        return f"cleared: {', '.join(cleared)}; vented until asked anew: {WAY_BACK}" if cleared else "nothing to clear"

    def measure(self, sample: PressureSample, now: Instant) -> None:
        """Take a pressure sample. One that is not a finite number, or of a plant that is paused, is ignored."""
        valid = math.isfinite(sample.pressure_pa) and not self._plant_paused
        self._sensors.take(sample.place, valid=valid)
        if not valid:
            return
        self._ankle.measure(sample, now, driven=self._active)

    def take_driven(self, driven: ActuatorCommand, stamp_s: float) -> None:
        """Take what the hardware says that it drives, from `stamp_s` on or still then, s, on the clock of the samples.

        Every change, and at least 20 times a second: what is read while it is silent is no evidence of a fault.
        """
        self._ankle.evidence.acknowledge(driven, stamp_s)

    def look_at_link(self, link: LinkStatus, now: Instant) -> bool:
        """Take the state of the link: fail, or let go, with a board that does not answer or has let go by itself.

        While a board that had let go has not yet taken the release nothing jams; a stream's wish then counts.

        Returns:
            Whether the board's latched safe state is to be acknowledged now.

        """
        self._link = link
        if link.plant_restarts != self._plant_restarts:
            self._plant_restarts = link.plant_restarts
            self._ankle.begin_anew(now)
        if link.paused != self._plant_paused:
            self._plant_paused = link.paused
            self._ankle.judge_from_now_on(now)
        verdict = self._link_guard.look(link, jammed=self._ankle.jammed)
        self._board_waits = verdict.wait
        if verdict.fault is not None or verdict.wait:  # it did something else than it was told
            self._ankle.judge_from_now_on(now)
        if verdict.fault is not None:
            self._ankle.fail(self._names, verdict.fault)
        if verdict.let_go is not None:
            self._ankle.vent(verdict.let_go)
            self._streams.forget()
            self._ankle.regulate(0.0)
        if link.state is LinkState.LOST:
            self._forget_pressures()
        return verdict.acknowledge

    def watch_link(self, link: LinkStatus, now: Instant) -> None:
        """Count wrong check sums and the board's starts, several times a second; told, and nothing is let go."""
        self._line_noise = self._noise.look(link, now.steady_s)
        self._restarted = self._restarts.look(link, now.steady_s)

    def tick(self, now: Instant, stop_publishers: int | None = None) -> None:
        """Look at the clocks: let go, fail or stop what has gone silent. To be called several times a second.

        Args:
            now: The time.
            stop_publishers: How many publishers emergency_stop has in the graph; None where that is not known.

        """
        passed_s = 0.0 if self._ticked_s is None else now.graph_s - self._ticked_s
        self._steady_s, self._ticked_s = now.steady_s, now.graph_s
        self._sensors.tick(0.0 if self._plant_paused else passed_s, asked=self._link.exchanges > 0)
        stood_s = self._overload.tick(now.steady_s)
        if stood_s > 0.0:
            # Who stood still has heard nothing, and nobody is to blame for that.
            self._emergency_stop.excuse(stood_s)
            self._streams.excuse(stood_s)
            self._ankle.stood_still()
        self._sensors.look(self._ankle, active=self._active)
        if self._sensors.unanswered:
            self._let_go_blind()
        for name in self._streams.fall_silent(now):
            verb = "unjammed" if self._settings.ankle.safe_state is SafeState.VENT else "held"
            text = f"{verb}: no accepted jam_command for {self._streams.timeout_s:g} s (command_timeout_s)"
            self._ankle.let_go((name,), Finding(Reason.COMMANDS_STALE, name, text, self._streams.values))
        if self._active:
            self._emergency_stop.tick(stop_publishers, now)
            self._obey_stop()
        self._ankle.regulate(0.0)

    @property
    def _trouble(self) -> Trouble:
        return worst_trouble(self._ankle, self._sensors, self._link, self._line_noise, self.own_pace)

    @property
    def _why_not_ready(self) -> str:
        """Why the board takes no jam now; empty where it does."""
        if self._link.state is LinkState.LOST:
            return f"the board does not answer ({self._link.detail})"
        return "the board has let go and has not yet taken the release" if self._board_waits else ""

    def _forget_pressures(self) -> None:
        self._ankle.manifold_vacuum_pa = None
        for channel in self._ankle.channels.values():
            channel.forget_pressure()
        self._ankle.regulate(0.0)

    def _let_go_blind(self) -> None:
        """Go to the safe state where answers come too late to count, which no fault is concluded from."""
        text = f"let go: no answer of the board for {self._sensors.timeout_s:g} s (pressure_timeout_s)"
        self._ankle.let_go(self._names, Finding(Reason.BOARD_LET_GO, BOARD, text, self._sensors.values))
        self._streams.forget()
        self._forget_pressures()

    def _can_follow(self, channel: str) -> bool:
        return not self._emergency_stop.reason and self._ankle.able(channel)

    def _holds_another(self, wish: Wish) -> bool:
        return wish.vacuum_pa > 0.0 and self._ankle.channels[wish.channel].set_point_pa not in (0.0, wish.vacuum_pa)

    def _take(self, wish: Wish, reason: str) -> None:
        self._ankle.ask(wish.channel, wish.vacuum_pa, reason)

    def _obey_stop(self) -> None:
        reason = self._emergency_stop.reason
        if not reason or self._stopped:
            return
        self._stopped = True
        self._ankle.let_go(self._names, Finding(Reason.NONE, "ankle", f"emergency stop: {reason}"))
        for name in self._names:
            if not self._ankle.held:
                self._ankle.channels[name].ask(0.0, f"emergency stop: {reason}")
            self._streams.release(name)
        self._ankle.regulate(0.0)
