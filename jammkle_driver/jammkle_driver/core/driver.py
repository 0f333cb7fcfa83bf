"""The driver without ROS: who may ask what, what the actuators do, and what is known of the channels."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from jammkle_common.names import WAY_BACK
from jammkle_driver.core.ankle import Ankle
from jammkle_driver.core.channel import ChannelState
from jammkle_driver.core.faults import REMEDIES, Finding, Reason
from jammkle_driver.core.hardware import MANIFOLD, ActuatorCommand, LinkState, LinkStatus, PressureSample, released
from jammkle_driver.core.requests import (
    ONLY_PUBLISHER,
    CommandStreams,
    EmergencyStop,
    Publication,
    RequestError,
    SetPoint,
    check_shared_vacuum,
    checked_channels,
    checked_set_points,
    checked_vacuum,
)
from jammkle_driver.core.watch import (
    BOARD,
    LinkWatch,
    OverloadWatch,
    SensorWatch,
    link_numbers,
    silence_allowed,
)
from jammkle_driver.parameters import TICK_PERIOD_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_driver.core.watch import Instant
    from jammkle_driver.parameters import DriverParameters


class Trouble(NamedTuple):
    """The worst that is known of the whole ankle (NONE where all is well), and what was done about it."""

    why: Finding
    action: str


INACTIVE = "driver is not active"


_FARTHEST_PA = 1e7
"""Reading beyond which a sensor says no more than that it is broken, Pa: the atmosphere a hundred times."""


class Driver:
    """Takes requests, measurements and the time; says what the actuators shall do and what is known.

    Requests are atomic: they raise `RequestError` and change nothing, or are taken whole and return one line that says
    what was taken. Per channel the latest change wins, from wherever it came. All jammed channels share one vacuum,
    since they share one manifold.

    Attributes:
        parameters: What it goes by; those that may change while it runs may be replaced.
        ankle: Channels, pump and sensors.
        active: Whether it follows requests.
        stop: The emergency stop, with its reason and its publishers.
        streams: Who publishes set points.
        own_pace: Whether the driver itself keeps up.
        link_watch: What is wrong with the line and the board behind it; its noise and starts are reported alone.
    """

    def __init__(self, channels: Sequence[str], parameters: DriverParameters) -> None:
        """Make an inactive driver: everything released."""
        self._names = tuple(channels)
        self.parameters = parameters
        self.ankle = Ankle(self._names, parameters)
        self.streams = CommandStreams(parameters.command_timeout_s)
        self._sensors = SensorWatch(self._names, parameters.pressure_timeout_s, TICK_PERIOD_S)
        self.stop = EmergencyStop(parameters.emergency_stop_timeout_s)
        self.own_pace = OverloadWatch(TICK_PERIOD_S)
        self.link_watch = LinkWatch()
        self._ticked_s: float | None = None
        self.active = False
        self._stopped = False
        self._board_waits = False
        self._link = LinkStatus(LinkState.SEARCHING)

    @property
    def command(self) -> ActuatorCommand:
        """What the actuators shall do now."""
        if not self.active:
            return released(self._names)
        if self.stop.reason and not self.ankle.held:
            return released(self._names)
        return self.ankle.command

    @property
    def standing(self) -> tuple[object, ...]:
        """All that is known but what was measured: what everybody is to know at once when it changes."""
        channels = [(each.state, each.set_point_pa, each.why.text) for each in self.ankle.channels.values()]
        return (
            self.active,
            self.stop.reason,
            self.streams.speaking,
            self.trouble.why.reason,
            self.parameters.default_vacuum_pa,
            *channels,
        )

    def activate(self, now: Instant) -> None:
        """Start to follow requests; nothing is wanted yet. An emergency stop and faults stay until cleared."""
        self.active = True
        self.streams.forget()
        self.stop.begin(now)
        for channel in self.ankle.channels.values():
            channel.enable()
        self._permit_storing()
        self.ankle.regulate(0.0)

    def deactivate(self) -> None:
        """Release everything and refuse requests; faults stay until cleared."""
        self.active = False
        self.streams.forget()
        self.ankle.release()
        for channel in self.ankle.channels.values():
            channel.disable(INACTIVE)
        self._permit_storing()
        self.ankle.regulate(0.0)

    def reset(self) -> None:
        """Be as new, inactive; only an emergency stop stays."""
        self.ankle.reset()
        self._sensors.forget()
        self.link_watch = LinkWatch()  # the next link counts from the beginning
        self.deactivate()
        # The ticks end with this configuration: until the next one nobody stands still.
        self.own_pace, self._ticked_s = OverloadWatch(TICK_PERIOD_S), None

    def jam(self, channels: Sequence[str], vacuum_pa: float, asked_by: str) -> str:
        """Jam channels (none named: all) with `vacuum_pa` Pa, 0 for the default.

        Raises:
            RequestError: unknown channel, vacuum out of range, driver inactive or stopped, channel in fault or
                without a measured pressure, another channel jammed to another vacuum. Nothing has changed.

        """
        names = checked_channels(channels, self._names)
        vacuum_pa = checked_vacuum(vacuum_pa, self.parameters)
        self._check_ready()
        self._check_able(names)
        check_shared_vacuum([SetPoint(name, vacuum_pa) for name in names], self.ankle.set_points_pa)
        for name in names:
            self.ankle.ask(name, vacuum_pa, f"asked by {asked_by}")
            self.streams.release(name)
        self.ankle.regulate(0.0)
        return f"jamming {', '.join(names)} at {vacuum_pa:g} Pa below ambient"

    def unjam(self, channels: Sequence[str], asked_by: str) -> str:
        """Vent channels (none named: all).

        Raises:
            RequestError: unknown channel, or the driver is inactive. Nothing has changed.

        """
        names = checked_channels(channels, self._names)
        if not self.active:
            msg = f"{INACTIVE}: every channel is vented already; activate it to follow requests"
            raise RequestError(msg)
        self.ankle.release()
        for name in names:
            self.ankle.ask(name, 0.0, f"asked by {asked_by}")
            self.streams.release(name)
        self.ankle.regulate(0.0)
        return f"unjamming {', '.join(names)}; {WAY_BACK}"

    def check_carried_out(self, channels: Sequence[str], link: LinkStatus | None) -> None:
        """Check that a release of channels (none named: all) which was just commanded can take place.

        Raises:
            RequestError: nobody is there to carry it out, or a channel does not vent.

        """
        if link is not None and link.state is not LinkState.CONNECTED:
            way_out = "a board with a watchdog lets go by itself; cut the supply of any other"
            msg = f"released, but the board gets no command ({link.detail}): {way_out}"
            raise RequestError(msg)
        for name in checked_channels(channels, self._names):
            why = self.ankle.channels[name].why
            if why.reason is Reason.BOARD_UNPLUGGED:
                msg = f"released, but no sensor answers, so nobody may be there to do it: {why.text}"
                raise RequestError(msg)
            if why.reason in {Reason.VALVE_STUCK_OPEN, Reason.NOT_VENTED}:
                msg = f"released, but {name} does not vent: {why.text}"
                raise RequestError(msg)

    def follow(
        self,
        set_points: Sequence[SetPoint],
        now: Instant,
        asked_by: str,
        *,
        anew: bool = False,
        publication: Publication = ONLY_PUBLISHER,
    ) -> bool:
        """Take one message of a stream of set points; only changes count, repeating keeps them alive.

        Return False for one that came before, as by a second subscription: it changes nothing.

        A channel in FAULT or stopped does not follow, and the change is spent: it does not jam by itself later.
        With `anew` everything counts as a change: that is the way back after a service, a fault or a stop.
        A message that jams with a new vacuum takes the jammed channels that it names along to it.
        Changes are those of each publisher, so that two that contradict one another do not take turns.

        Raises:
            RequestError: one of the set points is bad, a channel that is not named is jammed to another vacuum, or the
                driver is inactive. Nothing has changed, and the message is no sign of life.

        """
        if not self.active:
            msg = f"{INACTIVE}: activate it first"
            raise RequestError(msg)
        stream = self.streams.of(set_points, publication, now)
        if stream is None:
            return False
        checked = checked_set_points(set_points, self._names, self.parameters)
        # Before its first measurement a channel cannot follow; the set point counts as soon as it can.
        measured = [
            set_point
            for set_point in checked
            if self.ankle.channels[set_point.channel].vacuum_pa is not None and not self._why_not_ready
        ]
        stopped = self.stop.reason
        able = [set_point for set_point in measured if not stopped and self.ankle.able(set_point.channel)]
        new = tuple(able) if anew else stream.changes(able)
        jams = any(set_point.vacuum_pa > 0.0 for set_point in new)
        taken = [set_point for set_point in able if set_point in new or (jams and self._holds_another(set_point))]
        check_shared_vacuum(taken, self.ankle.set_points_pa)
        stream.take(measured, now)
        for set_point in taken:
            self.ankle.ask(set_point.channel, set_point.vacuum_pa, f"asked by {asked_by}")
            self.streams.lead(stream, set_point.channel)
        self.ankle.regulate(0.0)
        return True

    def emergency_stop(self, *, stop: bool, now: Instant, publication: Publication = ONLY_PUBLISHER) -> None:
        """Take a message of an emergency stop: True releases everything, False only permits `clear_fault`.

        There may be several publishers: one that says True suffices, and only itself, or its end, takes that back.
        """
        self.stop.take(publication, now, stop=stop)
        self._obey_stop()

    def clear_fault(self, now: Instant) -> str:
        """Leave every fault and the emergency stop; all channels stay vented until asked anew.

        Raises:
            RequestError: the emergency stop is still asked for. Nothing has changed.

        """
        was_stopped = bool(self.stop.reason)
        refusal = self.stop.clear(now)
        if refusal:
            raise RequestError(refusal)
        faulty = self.ankle.faulty
        cleared = (["emergency stop"] if was_stopped else []) + [channel.name for channel in faulty]
        for channel in faulty:
            if self._sensors.silent(channel.name):
                channel.forget_pressure()
        if cleared:
            self.ankle.clear(tuple(self.ankle.channels.values()) if was_stopped else faulty)
        self._stopped = False
        self.link_watch.clear()
        return f"cleared: {', '.join(cleared)}; vented until asked anew: {WAY_BACK}" if cleared else "nothing to clear"

    def measure(self, sample: PressureSample, now: Instant) -> None:
        """Take a pressure sample. One that is no pressure, or of a plant that is paused, is ignored."""
        valid = abs(sample.pressure_pa) <= _FARTHEST_PA and not self._link.paused  # NaN is not
        self._sensors.take(sample.place, valid=valid)
        if not valid:
            return
        self.ankle.measure(sample, now, driven=self.active)

    def take_driven(self, driven: ActuatorCommand, stamp_s: float) -> None:
        """Take what the hardware says that it drives, from `stamp_s` on or still then, s, on the clock of the samples.

        Every change, and at least 20 times a second: what is read while it is silent is no evidence of a fault. What
        leaves out a channel, or is no duty, as a message that nobody has filled in, says nothing.
        """
        if not driven.solenoids.keys() >= set(self._names) or not 0.0 <= driven.pump_duty <= 1.0:
            return
        self.ankle.evidence.acknowledge(driven, stamp_s)

    def look_at_link(self, link: LinkStatus, now: Instant) -> bool:
        """Take the state of the link, and return whether the board's latched safe state is to be acknowledged now.

        Fail, or let go, with a board that does not answer or has let go by itself. While a board that had let go has
        not yet taken the release nothing jams; a stream's set point then counts.
        """
        before, self._link = self._link, link
        if link.plant_restarts != before.plant_restarts:
            self.ankle.begin_anew(now)
        if link.paused != before.paused:
            self.ankle.judge_from_now_on(now)
        verdict = self.link_watch.look(link, jammed=self.ankle.jammed)
        self._board_waits = verdict.wait
        if verdict.fault is not None or verdict.wait:  # it did something else than it was commanded
            self.ankle.judge_from_now_on(now)
        if verdict.fault is not None:
            self.ankle.fail(self._names, verdict.fault)
        if verdict.let_go is not None:
            self.ankle.vent(verdict.let_go)
            self.streams.forget()
            self.ankle.regulate(0.0)
        if link.state is LinkState.LOST:
            self._forget_pressures()
        return verdict.acknowledge

    def follow_another_clock(self) -> None:
        """Forget when regular work was done last: the steady time of the next tick is of another clock."""
        self.own_pace = OverloadWatch(TICK_PERIOD_S)

    def tick(self, now: Instant, stop_publishers: int | None = None) -> None:
        """Look at the clocks: let go, fail or stop what has gone silent. To be called several times a second.

        `stop_publishers` are those that emergency_stop has in the graph; None where that is not known.
        """
        passed_s = 0.0 if self._ticked_s is None else now.graph_s - self._ticked_s
        self._ticked_s = now.graph_s
        if passed_s < 0.0:
            self.ankle.follow_clock_back(now)
        self._sensors.tick(0.0 if self._link.paused else passed_s, asked=self._link.exchanges > 0)
        stood_s = self.own_pace.tick(now.steady_s)
        if stood_s > 0.0:
            # Who stood still has received nothing, and nobody is to blame for that.
            self.stop.excuse(stood_s)
            self.streams.excuse(stood_s)
            self.ankle.stood_still()
        self._look_at_sensors()
        if self._sensors.unanswered:
            self._let_go_blind()
        for name in self.streams.fall_silent(now):
            verb = "held" if self.parameters.holds else "unjammed"
            text = f"{verb}: no accepted jam_command for {self.streams.timeout_s:g} s (command_timeout_s)"
            self.ankle.let_go(
                (name,), Finding(Reason.COMMANDS_STALE, name, text, silence_allowed(self.streams.timeout_s))
            )
        if self.active:
            self.stop.tick(stop_publishers, now)
            self._obey_stop()
        self._permit_storing()
        self.ankle.regulate(0.0)

    def _check_ready(self) -> None:
        if not self.active:
            msg = f"{INACTIVE}: cannot jam; activate it first (lifecycle transition 'activate')"
            raise RequestError(msg)
        if reason := self.stop.reason:
            msg = f"emergency stop ({reason}): cannot jam; {self.stop.way_out}; {WAY_BACK}"
            raise RequestError(msg)
        if board := self._why_not_ready:
            msg = f"{board}: cannot jam; ask again"
            raise RequestError(msg)

    def _check_able(self, channels: Sequence[str]) -> None:
        """Check that channels may be jammed as far as faults and sensors go."""
        for name in channels:
            channel = self.ankle.channels[name]
            if channel.state is ChannelState.FAULT:
                msg = f"channel '{name}' is in FAULT ({channel.why.text}); nothing was jammed"
                raise RequestError(msg)
            if not self.ankle.able(name):
                failed = self.ankle.faulty[0]
                msg = f"channel '{failed.name}' is in FAULT ({failed.why.text}); "
                msg += "fault_policy is ankle: nothing was jammed"
                raise RequestError(msg)
            if channel.state is ChannelState.UNKNOWN:
                msg = f"no pressure of channel '{name}' is measured; start the hardware or simulation first"
                raise RequestError(msg)

    @property
    def trouble(self) -> Trouble:
        """The worst that is known of the whole ankle."""
        return self._trouble_of_ankle() or self._trouble_around()

    def _trouble_of_ankle(self) -> Trouble | None:
        """Return the worst of a fault, a lost board, and what was let go."""
        ankle, link, faulty = self.ankle, self._link, self.ankle.faulty
        acts = "kept as it was, pump off" if ankle.held else "vented"
        if faulty:
            names = ", ".join(each.name for each in faulty)
            others = names if self.parameters.fails_alone else "every channel"
            return Trouble(faulty[0].why, f"{others} {acts} until ~/clear_fault")
        if link.state is LinkState.LOST:
            text = f"the board does not answer ({link.detail}): {REMEDIES[Reason.BOARD_UNPLUGGED]}"
            why = Finding(Reason.BOARD_UNPLUGGED, BOARD, text, link_numbers(link))
            return Trouble(why, "nothing jams until it answers")
        let_go = [channel for channel in ankle.channels.values() if channel.why.reason is not Reason.NONE]
        if let_go:
            names = ", ".join(channel.name for channel in let_go)
            acts = "kept as it was" if let_go[0].held and not ankle.held else acts  # the pump works for others
            return Trouble(let_go[0].why, f"{names} {acts} until asked anew")
        return None

    def _trouble_around(self) -> Trouble:
        """Return the worst of a silent manifold, a noisy line, and the own pace."""
        sensors, noise, pace = self._sensors, self.link_watch.noise, self.own_pace
        if sensors.manifold_measured and self.ankle.manifold_vacuum_pa is None:
            remedy = REMEDIES[Reason.SENSOR_DEAD]
            text = f"manifold sensor gives no valid pressure for {sensors.timeout_s:g} s: {remedy}"
            why = Finding(Reason.SENSOR_DEAD, MANIFOLD, text, silence_allowed(sensors.timeout_s))
            return Trouble(why, "the pump is regulated by the channels alone")
        if noise is not None:
            return Trouble(noise, "none: the line repeats what is lost")
        if pace.overloaded:
            stalls = f"it stood still {pace.stalls} times, at most {pace.longest_s:.2f} s"
            text = f"the driver's work comes {pace.late_s:.3f} s late; {stalls}"
            why = Finding(Reason.EXECUTOR_OVERLOADED, "driver", text, pace.values)
            return Trouble(why, "none: the board lets go where that lasts")
        return Trouble(Finding(Reason.NONE, "ankle", ""), "")

    @property
    def _why_not_ready(self) -> str:
        """Why the board takes no jam now; empty where it does."""
        if self._link.state is LinkState.LOST and not self.ankle.faulty:  # else the fault is the reason
            return f"the board does not answer ({self._link.detail})"
        return "the board has let go and has not yet taken the release" if self._board_waits else ""

    def _forget_pressures(self) -> None:
        self.ankle.manifold_vacuum_pa = None
        for channel in self.ankle.channels.values():
            channel.forget_pressure()
        self.ankle.regulate(0.0)

    def _look_at_sensors(self) -> None:
        """Forget the pressures of silent sensors; while active, their channels fail."""
        channels = self.ankle.channels
        silent = self._sensors.fallen_silent([name for name in channels if channels[name].vacuum_pa is not None])
        if (silent and self._sensors.all_silent) or self._sensors.silent(MANIFOLD):
            self.ankle.manifold_vacuum_pa = None
        if silent and self.active:
            self.ankle.fail(silent, self._sensors.why(silent))
        for name in silent:
            channels[name].forget_pressure()

    def _let_go_blind(self) -> None:
        """Go to the safe state where answers come too late to count, which no fault is concluded from."""
        text = f"let go: no answer of the board for {self._sensors.timeout_s:g} s (pressure_timeout_s)"
        why = Finding(Reason.BOARD_LET_GO, BOARD, text, silence_allowed(self._sensors.timeout_s))
        self.ankle.let_go(self._names, why)
        self.streams.forget()
        self._forget_pressures()

    def _holds_another(self, asked: SetPoint) -> bool:
        held_pa = self.ankle.channels[asked.channel].set_point_pa
        return asked.vacuum_pa > 0.0 and held_pa not in (0.0, asked.vacuum_pa)

    def _permit_storing(self) -> None:
        able = self.active and not self.stop.reason and not self._why_not_ready
        self.ankle.may_store = able and not self._link.paused

    def _obey_stop(self) -> None:
        reason = self.stop.reason
        self._permit_storing()
        if not reason or self._stopped:
            return
        self._stopped = True
        self.ankle.let_go(self._names, Finding(Reason.NONE, "ankle", f"emergency stop: {reason}"))
        for name in self._names:
            if not self.ankle.held:
                self.ankle.channels[name].ask(0.0, f"emergency stop: {reason}")
            self.streams.release(name)
        self.ankle.regulate(0.0)
