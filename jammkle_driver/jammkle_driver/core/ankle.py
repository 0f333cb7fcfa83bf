"""One ankle's channels, pump and sensors: what is measured of them, and what they shall do."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from jammkle_driver.core.air import Atmosphere, LeakMeter
from jammkle_driver.core.channel import Channel, ChannelState, missed
from jammkle_driver.core.diagnosis import LONGEST_UNKNOWN_S, Diagnosis, Evidence
from jammkle_driver.core.faults import Finding, Reason, finding
from jammkle_driver.core.hardware import MANIFOLD, ActuatorCommand, released
from jammkle_driver.core.regulator import LATE_S, ExcessVent, PumpLoad, PumpRegulator

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_driver.core.diagnosis import Moment
    from jammkle_driver.core.hardware import PressureSample
    from jammkle_driver.core.watch import Instant
    from jammkle_driver.parameters import DriverParameters

_LONGEST_WAIT_S = 5.0
"""How long a reading may wait to be taken, s, while a node hangs. Assumed: what is older is of a clock set back."""

_SHORTEST_PERIOD_S, _LONGEST_PERIOD_S = 0.005, 0.1
"""Bounds of the time from one reading to the next, s: faster than any line, and a host that stands still."""

_ANSWERED_AFTER = 3.0
"""Cycles from a reading to the end of what it led to: half a cycle until it is in, then the command's way out and its
cycle."""


class Ankle:
    """Channels that share one pump; follows set points, lets go when something fails, and says what it knows.

    Attributes:
        parameters: What it goes by.
        may_store: Whether a reservoir may be evacuated while nothing is jammed.

    """

    def __init__(self, channels: Sequence[str], parameters: DriverParameters) -> None:
        """Make an ankle of disabled channels."""
        self._names = tuple(channels)
        self.parameters = parameters
        self._air = parameters.air()
        self._volumes_m3 = dict(zip(self._names, self._air.channel_volumes_m3, strict=False))
        self.atmosphere = Atmosphere(self._names, parameters.ambient_pressure_pa)
        self.load = PumpLoad(parameters)
        self._counted: set[str] = set()
        self._regulator = PumpRegulator(parameters)
        self.may_store = False
        self.reset()

    def reset(self) -> None:
        """Be as new, disabled."""
        self.channels = {name: Channel(name, self.parameters) for name in self._names}
        self.leaks = LeakMeter(self._names, self._air)
        self.diagnosis = Diagnosis(self._names, self._air, self.atmosphere.pressure_pa)
        self.evidence = Evidence((MANIFOLD, *self._names))
        self.manifold_vacuum_pa: float | None = None
        self.findings: tuple[Finding, ...] = ()
        self._stamps: dict[str, float] = {}
        self._regulated_at_s = -math.inf
        self._duty = 0.0
        self._command = released(self._names)
        self._held: ActuatorCommand | None = None
        self._vent = ExcessVent(self._volumes_m3, self._air.valve_conductance_m3_s_pa)
        self._pulsed: frozenset[str] = frozenset()
        self._period_s = _SHORTEST_PERIOD_S
        self._judged_from_s = -math.inf

    @property
    def command(self) -> ActuatorCommand:
        """What the actuators shall do now; the same object until something else is."""
        if self._held is not None:
            return self._held
        solenoids = {name: each.energised and name not in self._pulsed for name, each in self.channels.items()}
        if self._duty != self._command.pump_duty or solenoids != self._command.solenoids:
            self._command = ActuatorCommand(solenoids, self._duty)
        return self._command

    @property
    def held(self) -> bool:
        """Whether solenoids are kept as they were, in the safe state `hold`."""
        return self._held is not None

    @property
    def resting(self) -> bool:
        """Whether the set point is held without the pump."""
        return self._regulator.resting

    @property
    def set_points_pa(self) -> dict[str, float]:
        """Vacuum asked for, per channel, Pa; 0 = unjam."""
        return {name: channel.set_point_pa for name, channel in self.channels.items()}

    @property
    def jammed(self) -> bool:
        """Whether a channel is asked to jam."""
        return any(channel.set_point_pa > 0.0 for channel in self.channels.values())

    @property
    def faulty(self) -> tuple[Channel, ...]:
        """Channels in FAULT."""
        return tuple(channel for channel in self.channels.values() if channel.state is ChannelState.FAULT)

    def able(self, channel: str) -> bool:
        """Whether a channel may be jammed, as far as faults go."""
        if self.parameters.fails_alone:
            return self.channels[channel].state is not ChannelState.FAULT
        return not self.faulty

    def ask(self, channel: str, vacuum_pa: float, reason: str) -> None:
        """Take a set point for one channel; whatever was held before is regulated, or vented, again."""
        self._end_hold(f"let go with the set point for {channel}")
        self.channels[channel].ask(vacuum_pa, reason)

    def vent(self, why: Finding) -> None:
        """Vent all that is asked to jam, whatever the safe state is: it has been let go of already."""
        jammed = [channel for channel in self.channels.values() if channel.set_point_pa > 0.0]
        self._end_hold(why.text)
        for channel in jammed:
            channel.let_go(why)

    def let_go(self, channels: Sequence[str], why: Finding) -> None:
        """Bring channels to the safe state; nothing has failed that must be acknowledged."""
        asked = [self.channels[name] for name in channels if self.channels[name].set_point_pa > 0.0]
        if self.parameters.holds and self._held is None and asked:
            self._held = ActuatorCommand(dict(self.command.solenoids), 0.0)
        for channel in asked:
            if self._held is not None:
                channel.hold(why)
            else:
                channel.let_go(why)

    def fail(self, channels: Sequence[str], why: Finding) -> None:
        """Put channels into FAULT until they are cleared, and the others to where the policy wants them."""
        if self.parameters.holds and self._held is None and self.jammed:
            self._held = ActuatorCommand(dict(self.command.solenoids), 0.0)
        for name in channels:
            self.channels[name].fail(why)
        self._spread(why)
        if self.parameters.fails_alone and self.jammed:
            self._held = None
        self.regulate(0.0)

    def clear(self, channels: Sequence[Channel]) -> None:
        """Let channels leave their faults, vented."""
        self._end_hold("cleared")
        self.findings = ()
        for channel in channels:
            channel.clear()
        self.diagnosis.clear(self.atmosphere.pressure_pa)
        self.evidence.clear()
        self.regulate(0.0)

    def declare_atmosphere(self, pressure_pa: float, now: Instant) -> None:
        """Take what the parameter says of the atmosphere now, Pa; sensors of vacuum count from it from now on."""
        self.atmosphere.declare(pressure_pa, self._counted)
        if self._counted:  # their readings jump, and no air has moved
            self.judge_from_now_on(now)

    def release(self) -> None:
        """End the safe state `hold`: what was kept is vented."""
        self._end_hold("let go")

    def measure(self, sample: PressureSample, now: Instant, *, driven: bool) -> None:
        """Take a reading; nothing is concluded from it if not `driven`."""
        place, pressure_pa, stamp_s = sample.place, sample.pressure_pa, sample.stamp_s
        if sample.counted:
            self._counted.add(place)
        if not driven:  # who moves the air is not known: a rig, or another driver
            self.judge_from_now_on(now)
        elapsed_s = min(max(stamp_s - self._stamps.get(place, stamp_s), 0.0), 0.1)
        self._stamps[place] = stamp_s
        judged = driven and sample.timely and self.parameters.diagnose
        judged = judged and not 0.0 <= self._judged_from_s - stamp_s < _LONGEST_WAIT_S
        if judged:
            self.note_command(now)
            self.evidence.read(place, pressure_pa, stamp_s)
        vacuum_pa = self.atmosphere.pressure_pa - pressure_pa
        if place == MANIFOLD:
            self.manifold_vacuum_pa = vacuum_pa
        else:
            channel = self.channels[place]
            was_faulty = channel.state is ChannelState.FAULT
            channel.measure(vacuum_pa, elapsed_s)
            if channel.state is ChannelState.FAULT and not was_faulty:
                self._spread(channel.why)
                self.regulate(0.0)
        if judged:
            self._look_into(self.diagnosis.check_range(place, pressure_pa, self.atmosphere))
            for moment in self.evidence.due():
                self._note(moment)
                if self.atmosphere.measured:
                    self._look_into(self.diagnosis.take(moment, self.atmosphere.pressure_pa))
        # Samples of one moment come one by one, and late ones in any order; the pump is set once per moment.
        since_s = stamp_s - self._regulated_at_s
        if not -_LONGEST_WAIT_S < since_s <= 0.0:
            self._regulated_at_s = stamp_s
            passed_s = max(since_s, 0.0) if math.isfinite(since_s) else 0.0
            self._period_s = min(max(passed_s, 0.95 * self._period_s, _SHORTEST_PERIOD_S), _LONGEST_PERIOD_S)
            excesses_pa = {name: each.excess_pa for name, each in self.channels.items() if each.excess_pa > 0.0}
            self._pulsed = self._vent.pulse(excesses_pa, self._connected_m3(), stamp_s, self._period_s)
            self.regulate(passed_s)

    def regulate(self, elapsed_s: float) -> None:
        """Set the pump anew, `elapsed_s` s after the last measurement."""
        jammed = [channel for channel in self.channels.values() if channel.set_point_pa > 0.0]
        measured_pa = [channel.vacuum_pa for channel in jammed if channel.vacuum_pa is not None]
        if not jammed and self._stores and self.manifold_vacuum_pa is not None:
            self._store(self.manifold_vacuum_pa, elapsed_s)
            return
        if not measured_pa or self._held is not None:
            self._regulator.reset()
            self._duty = self.load.spare(0.0, elapsed_s)
            return
        set_point_pa = jammed[0].set_point_pa
        connected_pa = [channel.vacuum_pa or 0.0 for channel in jammed if channel.energised]
        duty = self._regulator.update(
            set_point_pa,
            min(measured_pa),
            self.manifold_vacuum_pa,
            elapsed_s,
            deepest_vacuum_pa=max(connected_pa, default=0.0),
            rise_pa=self._rise_pa(set_point_pa),
        )
        self._duty = self.load.spare(duty, elapsed_s)
        if self._regulator.full_s > self.parameters.longest_jam_s:
            self._give_up(min(jammed, key=lambda channel: math.inf if channel.vacuum_pa is None else channel.vacuum_pa))

    @property
    def _stores(self) -> bool:
        able = self.may_store and self._held is None and not self.faulty and not self.findings
        return able and self.parameters.reservoir_vacuum_pa > 0.0

    def _store(self, manifold_vacuum_pa: float, elapsed_s: float) -> None:
        """Evacuate the reservoir: all valves are shut, so that the manifold's sensor reads it."""
        stored_pa = self.parameters.reservoir_vacuum_pa
        duty = self._regulator.update(stored_pa, manifold_vacuum_pa, manifold_vacuum_pa, elapsed_s)
        self._duty = self.load.spare(duty, elapsed_s)
        timeout_s = self.parameters.longest_jam_s
        if self._regulator.full_s > timeout_s:
            self._regulator.reset()
            seen = f"at {manifold_vacuum_pa:.0f} of {stored_pa:.0f} Pa with the pump at full duty for {timeout_s:.3g} s"
            values = {"vacuum wanted (Pa)": f"{stored_pa:.0f}", "vacuum at last (Pa)": f"{manifold_vacuum_pa:.0f}"}
            self.fail(self._names, finding(Reason.NOT_REACHED, MANIFOLD, seen, values).to_clear())

    def _connected_m3(self) -> float:
        connected_m3 = sum(each for name, each in self._volumes_m3.items() if self.channels[name].energised)
        return self._air.shared_volume_m3 + connected_m3

    def _rise_pa(self, vacuum_pa: float) -> float:
        if self._period_s <= LATE_S:
            return 0.0
        air = self._air
        flow_m3_s = air.pump_free_flow_m3_s * max(1.0 - vacuum_pa / air.pump_ultimate_vacuum_pa, 0.0)
        pressure_pa = max(self.atmosphere.pressure_pa - vacuum_pa, 0.0)
        return flow_m3_s * pressure_pa / self._connected_m3() * _ANSWERED_AFTER * self._period_s

    def stood_still(self) -> None:
        """Note that readings of a while are missing because nobody took them."""
        self._stamps.clear()
        self.leaks.stop()

    def note_command(self, now: Instant) -> None:
        """Note what is commanded from now on; to be called whenever something is, or a brief command is missed."""
        if self.parameters.diagnose:
            self.evidence.command(self.command, now.graph_s)

    def judge_from_now_on(self, now: Instant) -> None:
        """Conclude nothing from readings of until now: the hardware did something else than it was commanded.

        Readings of that time may still wait to be taken.
        """
        self.diagnosis.clear(self.atmosphere.pressure_pa)
        self.leaks.stop()
        self._judged_from_s = max(now.graph_s, self.evidence.acknowledged_s)
        self.evidence.clear()

    def begin_anew(self, now: Instant) -> None:
        """Keep nothing of what was known of the air: it was put back to a start. What is asked for stays."""
        self.judge_from_now_on(now)
        self._regulator.reset()
        self._stamps.clear()

    def _give_up(self, weakest: Channel) -> None:
        """End what the pump cannot come to: at full duty for ever, JAMMED or not, it would only wear out."""
        self._regulator.reset()
        timeout_s = self.parameters.longest_jam_s
        seen = f"at {weakest.vacuum_pa or 0.0:.0f} of {weakest.set_point_pa:.0f} Pa with the pump at full duty for "
        seen += f"{timeout_s:g} s (jam_timeout_s)"
        why = finding(Reason.NOT_REACHED, weakest.name, seen, missed(weakest))
        self.fail((weakest.name,), why.to_clear())

    def _note(self, moment: Moment) -> None:
        """Learn the atmosphere from what is vented, and leaks from what is at rest."""
        elapsed_s = min(moment.elapsed_s, LONGEST_UNKNOWN_S)
        _, command = moment.driven[-1]
        connected = frozenset(name for name, energised in command.solenoids.items() if energised)
        at_rest = bool(connected) and command.pump_duty == 0.0 and moment.known
        if not at_rest:
            self.leaks.stop()
        for place, pressure_pa in moment.readings_pa.items():
            if place == MANIFOLD:
                continue
            self.atmosphere.read(place, pressure_pa, elapsed_s, vented=not command.solenoids[place])
            if at_rest:
                self.leaks.read(place, pressure_pa, elapsed_s, connected, self.atmosphere.pressure_pa)

    def _look_into(self, found: Finding | None) -> None:
        """Act on what was found, if anything was, and if it is the first, or another channel's alone."""
        others_go_on = self.parameters.fails_alone and all(map(self._is_alone, self.findings))
        if found is None or (self.findings and not others_go_on):
            return
        self.findings = (*self.findings, found)
        if others_go_on and self._is_alone(found):
            self.diagnosis.go_on_without(found, self.atmosphere.pressure_pa)
        self.fail((found.place,) if self._is_alone(found) else self._names, found.to_clear())

    def _is_alone(self, found: Finding) -> bool:
        return found.place in self.channels

    def _spread(self, why: Finding) -> None:
        if self.parameters.fails_alone or not self.faulty:
            return
        others = [name for name, channel in self.channels.items() if channel.state is not ChannelState.FAULT]
        failed = ", ".join(channel.name for channel in self.faulty)
        self.let_go(others, replace(why, text=f"let go with {failed} (fault_policy is ankle)"))

    def _end_hold(self, reason: str) -> None:
        if self._held is None:
            return
        self._held = None
        for channel in self.channels.values():
            channel.ask(0.0, reason)
