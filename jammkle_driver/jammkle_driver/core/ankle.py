"""One ankle's channels, pump and sensors: what is measured of them, and how pump and valves hold the vacuum."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from jammkle_driver.core.air import REFERENCE_PA, Atmosphere, LeakMeter
from jammkle_driver.core.channel import Channel, ChannelState, missed
from jammkle_driver.core.diagnosis import LONGEST_UNKNOWN_S, Diagnosis, Evidence
from jammkle_driver.core.faults import Finding, Reason, finding
from jammkle_driver.core.hardware import MANIFOLD, ActuatorCommand, released

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

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
        regulator: Of the pump.

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
        self.regulator = PumpRegulator(parameters)
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

    @property
    def _regulated(self) -> list[Channel]:
        """Channels that are asked to jam, but for those that are merely kept connected."""
        return [channel for channel in self.channels.values() if channel.set_point_pa > 0.0 and not channel.held]

    def able(self, channel: str) -> bool:
        """Whether a channel may be jammed, as far as faults go."""
        if self.parameters.fails_alone:
            return self.channels[channel].state is not ChannelState.FAULT
        return not self.faulty

    def ask(self, channel: str, vacuum_pa: float, reason: str) -> None:
        """Take a set point for one channel; whatever was held before is regulated, or vented, again."""
        self.release(f"let go with the set point for {channel}")
        self.channels[channel].ask(vacuum_pa, reason)

    def vent(self, why: Finding) -> None:
        """Vent all that is asked to jam, whatever the safe state is: it has been let go of already."""
        jammed = [channel for channel in self.channels.values() if channel.set_point_pa > 0.0]
        self.release(why.text)
        for channel in jammed:
            channel.let_go(why)

    def let_go(self, channels: Sequence[str], why: Finding) -> None:
        """Bring channels to the safe state; nothing has failed that must be acknowledged."""
        asked = [self.channels[name] for name in channels if self.channels[name].set_point_pa > 0.0]
        to_hold = self._to_hold()
        for channel in asked:
            if self.parameters.holds:
                channel.hold(why)
            else:
                channel.let_go(why)
        if self._held is None and asked and not self._regulated:
            self._held = to_hold

    def fail(self, channels: Sequence[str], why: Finding) -> None:
        """Put channels into FAULT until they are cleared, and the others to where the policy wants them."""
        to_hold = self._to_hold()
        for name in channels:
            self.channels[name].fail(why)
        self._settle_fault(why, to_hold)

    def _settle_fault(self, why: Finding, to_hold: ActuatorCommand | None) -> None:
        """Bring what a fault concerns to the safe state; `to_hold` is from before it."""
        others_go_on = self.parameters.fails_alone and self._regulated
        if self._held is None and not others_go_on:
            self._held = to_hold
        self._spread(why)
        self.regulate(0.0)

    def _to_hold(self) -> ActuatorCommand | None:
        """Return what the safe state `hold` would keep, a valve in a pulse as connected; None: nothing."""
        if not self.parameters.holds or not self.jammed:
            return None
        return ActuatorCommand({name: each.energised for name, each in self.channels.items()}, 0.0)

    def clear(self, channels: Sequence[Channel]) -> None:
        """Let channels leave their faults, vented."""
        self.release("cleared")
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

    def measure(self, sample: PressureSample, now: Instant, *, driven: bool) -> None:
        """Take a reading; nothing is concluded from it if not `driven`."""
        place, pressure_pa, stamp_s = sample.place, sample.pressure_pa, sample.stamp_s
        if sample.counted:
            self._counted.add(place)
        if not driven:  # who moves the air is not known: a rig, or another driver
            self.judge_from_now_on(now)
        elapsed_s = min(max(stamp_s - self._stamps.get(place, stamp_s), 0.0), _LONGEST_STEP_S)
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
            was_faulty, to_hold = channel.state is ChannelState.FAULT, self._to_hold()
            channel.measure(vacuum_pa, elapsed_s)
            if channel.state is ChannelState.FAULT and not was_faulty:
                self._settle_fault(channel.why, to_hold)
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
        jammed = self._regulated
        measured_pa = [channel.vacuum_pa for channel in jammed if channel.vacuum_pa is not None]
        stores = self.may_store and self.parameters.reservoir_vacuum_pa > 0.0
        stores = stores and not self.jammed and self._held is None and not self.faulty and not self.findings
        if stores and self.manifold_vacuum_pa is not None:
            self._store(self.manifold_vacuum_pa, elapsed_s)
            return
        if not measured_pa or self._held is not None:
            self.regulator.reset()
            self._duty = self.load.spare(0.0, elapsed_s)
            return
        set_point_pa = jammed[0].set_point_pa
        connected_pa = [channel.vacuum_pa or 0.0 for channel in jammed if channel.energised]
        duty = self.regulator.update(
            set_point_pa,
            min(measured_pa),
            self.manifold_vacuum_pa,
            elapsed_s,
            deepest_vacuum_pa=max(connected_pa, default=0.0),
            rise_pa=self._rise_pa(set_point_pa),
        )
        self._duty = self.load.spare(duty, elapsed_s)
        if self.regulator.full_s > self.parameters.longest_jam_s:
            self._give_up(min(jammed, key=lambda channel: math.inf if channel.vacuum_pa is None else channel.vacuum_pa))

    def _store(self, manifold_vacuum_pa: float, elapsed_s: float) -> None:
        """Evacuate the reservoir: all valves are shut, so that the manifold's sensor reads it."""
        stored_pa = self.parameters.reservoir_vacuum_pa
        duty = self.regulator.update(stored_pa, manifold_vacuum_pa, manifold_vacuum_pa, elapsed_s)
        self._duty = self.load.spare(duty, elapsed_s)
        if self.regulator.full_s > self.parameters.longest_jam_s:
            self.regulator.reset()
            seen = f"at {manifold_vacuum_pa:.0f} of {stored_pa:.0f} Pa with {self._all_of_the_pump}"
            values = {"vacuum wanted (Pa)": f"{stored_pa:.0f}", "vacuum at last (Pa)": f"{manifold_vacuum_pa:.0f}"}
            self.fail(self._names, finding(Reason.NOT_REACHED, MANIFOLD, seen, values).to_clear())

    @property
    def _all_of_the_pump(self) -> str:
        """What was tried in vain, for people."""
        duty = "the duty that pump_rated_duty leaves" if self.load.limited else "full duty"
        return f"the pump at {duty} for {self.parameters.longest_jam}"

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
        self.regulator.reset()
        self._stamps.clear()
        self._regulated_at_s = -math.inf

    def follow_clock_back(self, now: Instant) -> None:
        """Begin anew on a clock that was set back: what is stamped earlier than before is no late reading."""
        self.evidence.clear()
        self.begin_anew(now)

    def _give_up(self, weakest: Channel) -> None:
        """End what the pump cannot come to: at full duty for ever, JAMMED or not, it would only wear out."""
        self.regulator.reset()
        seen = f"at {weakest.vacuum_pa or 0.0:.0f} of {weakest.set_point_pa:.0f} Pa with {self._all_of_the_pump}"
        why = finding(Reason.NOT_REACHED, weakest.name, seen, missed(weakest))
        self.fail((weakest.name,), why.to_clear())

    def _note(self, moment: Moment) -> None:
        """Learn the atmosphere from what is vented, and leaks from what is at rest."""
        elapsed_s = min(moment.elapsed_s, LONGEST_UNKNOWN_S)
        _, command = moment.driven[-1]
        connected = frozenset(name for name, energised in command.solenoids.items() if energised)
        at_rest = bool(connected) and command.pump_duty == 0.0 and moment.known
        stood = moment.stood
        if not at_rest:
            self.leaks.stop()
        for place, pressure_pa in moment.readings_pa.items():
            if place == MANIFOLD:
                continue
            vented = not any(each.solenoids[place] for each in stood)
            self.atmosphere.read(place, pressure_pa, elapsed_s, vented=vented)
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

    def release(self, reason: str = "let go") -> None:
        """End the safe state `hold`: what was kept is vented."""
        kept = [each for each in self.channels.values() if each.held or self._held is not None]
        self._held = None
        for channel in kept:
            channel.ask(0.0, reason)


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
"""Longest time for which one sample counts, s: what a driver that stood still has missed, it has not seen. Assumed."""


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
