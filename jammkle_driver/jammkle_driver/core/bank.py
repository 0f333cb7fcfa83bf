"""A bank of extended Kalman filters, one per hypothesis: prediction by the law of the air, correction by readings."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_driver.core.air import HEAT_TIME_S, SETTLING_S, orifice
from jammkle_driver.core.hypotheses import Spread, Tables

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from numpy.typing import NDArray

    from jammkle_driver.core.air import AirSettings, Array

    Flags = NDArray[np.bool_]


_LOWEST_PA = 100.0
"""Pressure below which none is taken to be, Pa: no pump of this kind gets there, and ratios stay finite."""

_LEFT_OUT_PA_RTS = 16.0
"""How a pressure may wander beyond all flows, Pa/sqrt(s): rounding. Assumed."""


@dataclass(frozen=True)
class Step:
    """What happened from one set of readings to the next, `duration_s` later.

    Attributes:
        readings_pa: What each sensor read at the end, Pa absolute: manifold, then channels; NaN where nothing came.
        connected: Per channel, whether it was commanded to the manifold.
        switching: Per channel, whether its valve may be moving.
        duty: The pump's duty, 0 to 1.
        duty_doubt: How far the duty that acts may be from that, 0 to 1.
        ambient_pa: Pressure of the atmosphere, Pa.
        heat_pa: Per volume, how far its pressure may still go as its air comes back to the temperature of the wall, Pa.
    """

    duration_s: float
    readings_pa: tuple[float, ...]
    connected: tuple[bool, ...]
    switching: tuple[bool, ...]
    duty: float
    duty_doubt: float
    ambient_pa: float
    heat_pa: tuple[float, ...]


@dataclass(frozen=True)
class _Balance:
    """Flows of every hypothesis, Pa m^3/s, and slopes of the pressures' rates.

    Attributes:
        flows: Valves to the manifold, vents, leaks, the pump.
        full: What each valve would let through to the manifold and from the vent, were it quite open.
        pumped: Flow of a whole pump at full duty.
        by_pressure: Slope of each pressure's rate by each pressure, 1/s.
        by_built: Slope of each pressure's rate by pump, lines and leaks, Pa/s.

    """

    flows: Array
    full: Array
    pumped: Array
    by_pressure: Array
    by_built: Array


KNOWN_AFTER = 100
"""Readings from which a sensor's way to repeat itself is known: a second of noise."""

_LIVELY = 0.1
"""Share of sets that repeat, below which a repeated one is no news: of noise of half a converter's step three sensors
and a manifold's repeat together in one set of ten or less."""

_BY_CHANCE = 1e-6
"""Probability of a run below which it is none: once in three hours at 100 Hz."""


class Freshness:
    """Compares each set of readings with the one before; `run` sets in a row have repeated the one before them."""

    def __init__(self) -> None:
        """Know nothing of the sensors yet."""
        self._last: dict[str, float] = {}
        self._sets = 0
        self._repeats = 0
        self.run = 0

    @property
    def stood_still(self) -> bool:
        """Whether the run is too long for chance, of sensors that were seen to be lively."""
        return self.run > 0 and self._lively and self._share**self.run < _BY_CHANCE

    def take(self, readings_pa: Mapping[str, float]) -> bool:
        """Take the next set, Pa by place; return whether it repeats the last one though its sensors are lively."""
        same = len(readings_pa) > 1 and readings_pa == self._last
        self._last = dict(readings_pa)
        if same:
            self.run += 1
            return self._lively
        if not self.stood_still:
            self._sets += self.run + 1
            self._repeats += self.run
        self.run = 0
        return False

    @property
    def _share(self) -> float:
        return (self._repeats + 1) / (self._sets + 2)  # Laplace's rule of succession

    @property
    def _lively(self) -> bool:
        return self._sets >= KNOWN_AFTER and self._share < _LIVELY


@dataclass(frozen=True)
class Scoring:
    """What a reading may gain or cost, and when it counts.

    Attributes:
        cap: Squared normalised error beyond which a reading counts no more against a hypothesis than that, 1: one that
            is off by five deviations is as likely a broken telegram as the doing of a fault.
        grace_s: How long after a valve has moved a part is not taken anew for built otherwise, s: twice the time in
            which the air spreads, in which heat and seats that are not quite shut count most.
        debt_nats: Least score of such a hypothesis in that time: what was lost while valves moved can be gained back.
            A reading at the cap costs 12.5, so one and a half of those.
        allowance_nats: What a hypothesis must gain with every set of readings to count: Page's reference value, half
            the square of a shift by a fifth of a deviation. Without it, an ankle at rest for minutes lets the slightly
            sharper one win.
        still_pa: How far a sensor that is taken as stuck must be from what its own filter makes of the pressure, Pa:
            two deviations of an offset. That a reading stands still where nothing changes says nothing, unless it
            repeats in vacuum as it never did before.
        evacuated_pa: Vacuum beyond which a sensor reads somewhere within its range, Pa: more than offset (1 kPa) and
            weather (2 kPa) together.
        longer_run: A run of equal readings is news beyond so many times the longest one before, 1: a lively sensor's
            runs are of one or two, those of a coarse converter or of a slow sensor are as long as they are.
        more_repeats: And beyond so many more, 1.
        repeat_nats: What a stuck sensor gains by each further reading of such a run: ln(20), as a healthy one would
            have ended.
        lately: Readings that say how fast a pressure changes now, 1: a late one repeats those before it, for 50 ms.
        unknown_pa: Deviation of a pressure that no sensor has read yet, Pa. Assumed: a tenth of an atmosphere.

    """

    cap: float = 25.0
    grace_s: float = 2.0 * SETTLING_S
    debt_nats: float = -20.0
    allowance_nats: float = 0.02
    still_pa: float = 500.0
    evacuated_pa: float = 3e3
    longer_run: float = 2.0
    more_repeats: float = 5.0
    repeat_nats: float = 3.0
    lately: int = 6
    unknown_pa: float = 1e4


@dataclass(frozen=True)
class Estimate:
    """What one hypothesis makes of the ankle; the manifold first, then the channels.

    Pressures are absolute, and each sensor reads too high by its offset. Shares are of what was declared: the pump's
    flow and ultimate vacuum, and each line's conductance. Leaks are sonic conductances; deviations are standard ones.
    """

    pressures_pa: tuple[float, ...]
    offsets_pa: tuple[float, ...]
    pump_share: float
    pump_end_share: float
    line_shares: tuple[float, ...]
    leaks_m3_s_pa: tuple[float, ...]
    leak_deviations_m3_s_pa: tuple[float, ...]
    pump_deviation: float


class FilterBank:
    """Filters of all hypotheses about one ankle, advanced together.

    Attributes:
        scoring: How readings count.
        hypotheses: The healthy ankle, and then everything that may have failed.
        scores: What each hypothesis has gained over the healthy ankle, nats.
        changes_while_stuck: How often the reading has changed that a hypothesis takes for stuck, since it last began.

    """

    def __init__(self, air: AirSettings, ambient_pa: float) -> None:
        """Begin vented, with every hypothesis as good as the healthy one."""
        self._air = air
        self.scoring = Scoring()
        self._spread = Spread()
        self._tables = Tables(air, self._spread)
        self.hypotheses = self._tables.hypotheses
        self._layout = self._tables.layout
        self._per_volume = into = 1.0 / np.array(air.volumes_m3)  # pressure rate per flow, 1/m^3
        self._drifting = tuple(np.array(self._tables.drifting).T)  # hypotheses, and the offset that drifts in each
        volumes, channels = self._layout.volumes, self._layout.volumes - 1
        channel, place = np.arange(channels), np.arange(volumes)
        self._spreading = np.zeros((volumes, 2 * channels + volumes + 1))  # the same of each flow: see `_Balance`
        self._spreading[channel + 1, channel] = -into[1:]
        self._spreading[0, channel] = into[0]
        self._spreading[channel + 1, channels + channel] = into[1:]
        self._spreading[place, 2 * channels + place] = into
        self._spreading[0, -1] = -into[0]
        self._every = np.arange(self._layout.size)
        self.leave_out(())
        self.reset(ambient_pa)

    @property
    def repeats_as_never(self) -> Flags:
        """Which sensors repeat a reading more often now than ever before, the manifold's first."""
        return (self._changes >= KNOWN_AFTER) & (self._run > self._longest_run)

    def reset(self, ambient_pa: float) -> None:
        """Begin anew, vented at `ambient_pa`, Pa, or at what the first readings say."""
        models, size = self._tables.mean.shape
        volumes = self._layout.volumes
        self._state = self._tables.mean.copy()
        self._state[:, :volumes] = ambient_pa
        self._covariance = np.zeros((models, size, size))
        self._covariance[:, self._every, self._every] = self._tables.deviation**2
        self.scores = np.zeros(models)
        self._held_pa = np.full((models, volumes), ambient_pa)
        self._held_variance = np.full((models, volumes), self._spread.noise_pa**2)
        self._last_pa = np.full(volumes, np.nan)
        self._lately: deque[tuple[float, Array]] = deque(maxlen=self.scoring.lately)
        self._run = np.zeros(volumes)
        self._longest_run = np.zeros(volumes)
        self._changes = np.zeros(volumes)
        self.changes_while_stuck = np.zeros(models)
        self._bridging = False
        self._fresh = True
        self._grace_s = 0.0

    def leave_out(self, places: Collection[int]) -> None:
        """Weigh no hypothesis of these volumes any more, by index: what is at them is known."""
        self._known = np.array([hypothesis.place in places for hypothesis in self.hypotheses])

    def bridge(self) -> None:
        """Forget where the pressures are, and nothing else: readings of a while are missing."""
        index = self._every[: self._layout.volumes]
        self._covariance[:, index, index] += self.scoring.unknown_pa**2
        self._bridging = True

    def adopt(self, model: int) -> None:
        """Take what a hypothesis says for the healthy ankle, and let every fault begin from there."""
        self._state[0] = np.clip(self._state[model], self._tables.least[0], self._tables.most[0])
        self._covariance[0] = self._covariance[model]
        self.scores[:] = 0.0
        self._begin_again()

    def estimate(self, model: int = 0) -> Estimate:
        """Return what a hypothesis makes of the ankle; the first is the healthy one."""
        state, layout = self._state[model], self._layout
        deviation = np.sqrt(np.maximum(np.diagonal(self._covariance[model]), 0.0))
        unit = self._air.valve_conductance_m3_s_pa
        return Estimate(
            pressures_pa=tuple(state[layout.pressures].tolist()),
            offsets_pa=tuple(state[layout.offsets].tolist()),
            pump_share=float(state[layout.pump]),
            pump_end_share=float(1.0 / state[layout.end]),
            line_shares=tuple(state[layout.lines].tolist()),
            leaks_m3_s_pa=tuple((state[layout.leaks] * unit).tolist()),
            leak_deviations_m3_s_pa=tuple((deviation[layout.leaks] * unit).tolist()),
            pump_deviation=float(deviation[layout.pump]),
        )

    def advance(self, step: Step) -> None:
        """Take what was commanded and what was read at the end of `step.duration_s`."""
        readings_pa = np.array(step.readings_pa)
        if self._fresh:
            self._begin(readings_pa, step.ambient_pa)
        self._predict(step)
        likelihood = self._weigh(step.readings_pa, self._late_pa(readings_pa, step.duration_s))
        repeats, beyond_doubt = self._repeats(readings_pa, step.ambient_pa)
        likelihood += self.scoring.repeat_nats * repeats
        if self._bridging:
            self._bridging = False
            return
        gain = likelihood - likelihood[0] - self.scoring.allowance_nats
        # While a valve may or may not have moved yet, what predicts sharply is not the likelier for it: then
        # hypotheses may lose, but not gain, and none begins anew.
        if any(step.switching):
            self._grace_s = self.scoring.grace_s
            gain = np.minimum(gain, 0.0)
        least = np.where(self._tables.built, self.scoring.debt_nats if self._grace_s > 0.0 else 0.0, 0.0)
        self.scores = np.maximum(self.scores + gain, least)
        if any(step.switching):
            return
        self._grace_s -= step.duration_s
        tells_nothing = self._nothing_changes() & ~beyond_doubt
        self.scores = np.where(tells_nothing, np.minimum(self.scores, 0.0), self.scores)
        self.scores[0] = 0.0
        self.scores[self._known] = 0.0
        self._begin_again()

    def _late_pa(self, readings_pa: Array, duration_s: float) -> Array:
        """Return how far each reading may be off as nobody knows to the millisecond when it was made, Pa.

        From the readings alone, and so the same for all: a hypothesis gains nothing by being vague in time.
        """
        self._lately.append((duration_s, readings_pa))
        known = np.array([readings for _, readings in self._lately])
        known = np.where(np.isfinite(known), known, readings_pa)  # one that is missing has not moved
        span_s = sum(duration for duration, _ in self._lately)
        late_pa: Array = self._spread.timing_s * np.nan_to_num(np.ptp(known, axis=0)) / span_s
        return late_pa

    def _repeats(self, readings_pa: Array, ambient_pa: float) -> tuple[Flags, Flags]:
        """Return which hypotheses of a stuck sensor see it repeat as it never did, and which of them in vacuum.

        At the atmosphere a converter may be at the end of its range, and a healthy reading then repeats, too.
        """
        valid = np.isfinite(readings_pa)
        same = valid & (readings_pa == self._last_pa)
        changed = valid & ~same
        self._longest_run = np.where(changed, np.maximum(self._longest_run, self._run), self._longest_run)
        self._changes += changed
        self.changes_while_stuck += (self._tables.stuck & changed).any(axis=1)
        self._run = np.where(changed, 0.0, self._run + same)
        self._last_pa = np.where(valid, readings_pa, self._last_pa)
        news = (
            same
            & (self._changes >= KNOWN_AFTER)
            & (self._run > self.scoring.longer_run * self._longest_run + self.scoring.more_repeats)
        )
        repeats: Flags = (self._tables.stuck & news).any(axis=1)
        evacuated = np.nan_to_num(ambient_pa - readings_pa) > self.scoring.evacuated_pa
        return repeats, (self._tables.stuck & news & evacuated).any(axis=1)

    def _nothing_changes(self) -> Flags:
        """Hypotheses of a stuck sensor whose pressure is still what that reads."""
        layout, stuck = self._layout, self._tables.stuck
        seen_pa = self._state[:, layout.pressures] + self._state[:, layout.offsets]
        still: Flags = (stuck & (np.abs(seen_pa - self._held_pa) < self.scoring.still_pa)).any(axis=1)
        return still

    def _begin(self, readings_pa: Array, ambient_pa: float) -> None:
        volumes = self._layout.volumes
        valid = np.isfinite(readings_pa)
        self._state[:, :volumes] = np.where(valid, readings_pa, ambient_pa)
        self._held_pa[:] = self._state[:, :volumes]
        index = self._every[:volumes]
        self._covariance[:, index, index] = np.where(valid, self._spread.offset_pa, self.scoring.unknown_pa) ** 2
        self._fresh = False

    def _begin_again(self) -> None:
        """Let hypotheses that have gained nothing start from where the healthy one is, their fault beginning now."""
        tables, every = self._tables, self._every
        again = tables.begins_again & (self.scores == 0.0)
        self._state[again] = self._state[0]
        self._covariance[again] = self._covariance[0]
        moved = again[:, None] & tables.moved
        self._state[moved] = tables.mean[moved]
        self._covariance[moved] = 0.0
        self._covariance.transpose(0, 2, 1)[moved] = 0.0
        self._covariance[:, every, every] += np.where(moved, tables.deviation**2, 0.0)
        self._covariance[:, every, every] += np.where(again[:, None], tables.jump**2, 0.0)
        expected_pa = self._state[0, self._layout.pressures] + self._state[0, self._layout.offsets]
        self._held_pa[again] = np.where(self._run > 0, self._last_pa, expected_pa)  # what repeats may have jumped there
        self._held_variance[again] = self._spread.noise_pa**2
        self.changes_while_stuck[again] = 0.0

    def _weigh(self, readings_pa: tuple[float, ...], late_pa: Array) -> Array:
        """Take the readings one after the other into every filter; return the log-likelihood of each."""
        state, covariance, tables = self._state, self._covariance, self._tables
        total = np.zeros(len(state))
        for place, reading_pa in enumerate(readings_pa):
            if not math.isfinite(reading_pa):
                continue
            noise = self._spread.noise_pa**2 + float(late_pa[place]) ** 2
            offset, stuck = self._layout.offsets.start + place, tables.stuck[:, place]
            row = covariance[:, place, :] + covariance[:, offset, :]
            held = self._held_variance[:, place]
            seen_pa = np.where(stuck, self._held_pa[:, place], state[:, place] + state[:, offset])
            error = reading_pa - seen_pa
            expected = np.where(stuck, held, row[:, place] + row[:, offset]) + noise
            squared = error * error / expected
            total -= 0.5 * (np.minimum(squared, self.scoring.cap) + np.log(expected))
            share = held / (held + noise)
            self._held_pa[:, place] += np.where(stuck, share * error, 0.0)
            self._held_variance[:, place] = share * noise
            # Beyond the cap a reading pulls no harder than at it (Huber 1964).
            # But where the pressures begin anew, they begin with what is read, however far that is.
            beyond = 1.0 if self._bridging else np.maximum(1.0, squared / self.scoring.cap)
            gain = row * np.where(stuck, 0.0, 1.0 / (expected * beyond))[:, None]
            state += gain * error[:, None]
            covariance -= gain[:, :, None] * row[:, None, :]
        np.clip(state, tables.least, tables.most, out=state)
        return total

    def _predict(self, step: Step) -> None:
        """Advance states, shape (hypotheses, quantities), and covariances by the law of the air."""
        state, covariance = self._state, self._covariance
        tables, volumes, duration_s = self._tables, self._layout.volumes, step.duration_s
        pressures = np.maximum(state[:, :volumes], _LOWEST_PA)
        balance = self._balance(state, pressures, step)
        solved = np.linalg.inv(np.eye(volumes) - duration_s * balance.by_pressure)
        rate = balance.flows @ self._spreading.T
        moved = pressures + (solved @ (duration_s * rate)[:, :, None])[:, :, 0]
        rows = np.zeros((len(state), volumes, state.shape[1]))
        rows[:, :, :volumes] = solved
        rows[:, :, 2 * volumes :] = solved @ (duration_s * balance.by_built)
        carried = rows @ covariance
        within = carried @ rows.transpose(0, 2, 1)
        covariance[:, :volumes, :] = carried
        covariance[:, :, :volumes] = carried.transpose(0, 2, 1)
        shaped = solved @ self._spreading
        within += (shaped * self._doubt(state, balance, step)[:, None, :]) @ shaped.transpose(0, 2, 1)
        place = np.arange(volumes)
        heat_pa2 = np.square(np.array(step.heat_pa)) / HEAT_TIME_S
        within[:, place, place] += (_LEFT_OUT_PA_RTS**2 + heat_pa2) * duration_s
        covariance[:, :volumes, :volumes] = within
        models, offsets = self._drifting
        drift = tables.layout.drift
        state[models, offsets] += duration_s * state[models, drift]
        covariance[models, offsets, :] += duration_s * covariance[models, drift, :]
        covariance[models, :, offsets] += duration_s * covariance[models, :, drift]
        # What is built comes back to its mean within its spread (Ornstein-Uhlenbeck); what was let go walks.
        decay = np.exp(-duration_s / tables.time_s)
        decay[:, :volumes] = 1.0
        state[:] = tables.mean + decay * (state - tables.mean)
        state[:, :volumes] = np.maximum(moved, _LOWEST_PA)
        covariance *= decay[:, :, None] * decay[:, None, :]
        every = np.arange(state.shape[1])
        covariance[:, every, every] += tables.deviation**2 * (1.0 - decay**2) + tables.wander * duration_s

    def _balance(self, state: Array, pressures: Array, step: Step) -> _Balance:
        air, tables, layout = self._air, self._tables, self._tables.layout
        models, volumes = pressures.shape
        manifold = pressures[:, :1]
        unit = air.valve_conductance_m3_s_pa
        share = np.where(tables.opened, 1.0, np.where(tables.closed, 0.0, np.array(step.connected, dtype=float)))
        line, leak, pump = state[:, layout.lines] * unit, state[:, layout.leaks] * unit, state[:, layout.pump]
        end = state[:, layout.end] / air.pump_ultimate_vacuum_pa  # 1/Pa
        drawn, by_channel, by_manifold = orifice(pressures[:, 1:], np.repeat(manifold, volumes - 1, axis=1))
        inward, _, by_place = orifice(np.full_like(pressures, step.ambient_pa), pressures)
        vacuum = step.ambient_pa - manifold[:, 0]
        curve = 1.0 - end * vacuum
        curve_slope = np.where(curve > 0.0, curve + end * manifold[:, 0], 0.0)
        pumped = air.pump_free_flow_m3_s * np.maximum(curve, 0.0) * manifold[:, 0]
        full = np.concatenate([line * drawn, line * inward[:, 1:]], axis=1)
        valves = full * np.concatenate([share, 1.0 - share], axis=1)
        flows = np.concatenate([valves, leak * inward, (pump * step.duty * pumped)[:, None]], axis=1)

        into, channel = self._per_volume, np.arange(1, volumes)
        by_pressure = np.zeros((models, volumes, volumes))
        from_vents = ((1.0 - share) * line + leak[:, 1:]) * by_place[:, 1:]
        by_pressure[:, channel, channel] = (from_vents - share * line * by_channel) * into[1:]
        by_pressure[:, channel, 0] = -share * line * by_manifold * into[1:]
        by_pressure[:, 0, channel] = share * line * by_channel * into[0]
        drawing = (share * line * by_manifold).sum(axis=1) + leak[:, 0] * by_place[:, 0]
        by_pressure[:, 0, 0] = (drawing - pump * step.duty * air.pump_free_flow_m3_s * curve_slope) * into[0]

        by_built = np.zeros((models, volumes, layout.size - 2 * volumes))
        by_built[:, 0, 0] = -step.duty * pumped * into[0]
        ends = pump * step.duty * air.pump_free_flow_m3_s * manifold[:, 0] * vacuum / air.pump_ultimate_vacuum_pa
        by_built[:, 0, layout.end - 2 * volumes] = np.where(curve > 0.0, ends, 0.0) * into[0]
        by_built[:, channel, channel] = ((1.0 - share) * inward[:, 1:] - share * drawn) * unit * into[1:]
        by_built[:, 0, channel] = share * drawn * unit * into[0]
        place = np.arange(volumes)
        by_built[:, place, volumes + place] = inward * unit * into
        return _Balance(flows, full, pumped, by_pressure, by_built)

    def _doubt(self, state: Array, balance: _Balance, step: Step) -> Array:
        """Variance of the air that each flow moves beyond what the law says, (Pa m^3)^2."""
        tables, spread = self._tables, self._spread
        valves = balance.full.shape[1]
        # A valve that is stuck does not move, whatever the command.
        unsure = np.array(step.switching) & ~tables.opened & ~tables.closed
        unsure = np.concatenate([unsure, unsure], axis=1)
        relative = np.full(balance.flows.shape, spread.flow)
        relative[:, :valves] += unsure
        doubtful = balance.flows.copy()
        doubtful[:, :valves] = np.where(unsure, balance.full, balance.flows[:, :valves])
        variance = (relative * doubtful) ** 2
        variance[:, -1] += (step.duty_doubt * state[:, tables.layout.pump] * balance.pumped) ** 2
        # A pump that draws nothing must not seem likely by predicting sharply.
        variance[:, -1] = np.maximum(variance[:, -1], variance[0, -1])
        doubt: Array = variance * (2.0 * spread.flow_time_s * step.duration_s)
        return doubt
