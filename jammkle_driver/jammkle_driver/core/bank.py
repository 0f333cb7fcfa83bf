"""One Kalman filter per hypothesis of what has failed, on one law of the air, and how much better each explains.

Multiple-model estimation (Magill 1965, "Optimal adaptive estimation of sampled stochastic processes"): each hypothesis
is an extended Kalman filter on the mass balance of `core.air`, and gains or loses by the likelihood of the pressures that
come next. What it has gained over the healthy one since it was last no better than that is Page's cumulative sum (Page
1954), so that a fault may begin at any time.

All filters share one state: pressures; each sensor's offset; the pump's share of its flow; each line's share of its
conductance; each volume's leak as a share of a valve's conductance. In the healthy one what is built stays near what was
declared; each other one lets go of one thing, or takes a valve or a sensor to be stuck.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_driver.core.air import orifice
from jammkle_driver.core.faults import Reason

if TYPE_CHECKING:
    from jammkle_driver.core.air import AirSettings, Array


@dataclass(frozen=True)
class Spread:
    """How far healthy ankles are from what was declared: standard deviations, and how slowly that changes.

    Attributes:
        noise_pa: Of one reading, Pa.
        offset_pa: Of a sensor's offset, Pa.
        pump: Of the pump's share of its declared flow, 1.
        line: Of a line's share of its declared conductance, 1.
        leak: Of a leak, as a share of a valve's conductance, 1.
        flow: Of each flow beyond that, relative: what the law leaves out, 1.
        flow_time_s: For how long such an error lasts, s.
        change_time_s: In which what is built changes within its spread, s.

    """

    noise_pa: float = 60.0
    offset_pa: float = 250.0
    pump: float = 0.2
    line: float = 0.2
    leak: float = 0.003
    flow: float = 0.05
    flow_time_s: float = 0.05
    change_time_s: float = 100.0


@dataclass(frozen=True)
class Hypothesis:
    """One thing that may have failed.

    Attributes:
        reason: What; NONE is the healthy ankle.
        place: Index of the volume that it is at: 0 the manifold, then the channels.

    """

    reason: Reason
    place: int
    jump: bool = False


FREE_TIME_S = 0.5
"""In which what a hypothesis lets go may change from one end of its range to the other, s."""

_CAP = 25.0
"""Squared normalised error beyond which a reading counts no more against a hypothesis than that: one that is off by
five deviations is as likely a broken telegram as the doing of a fault."""


class FilterBank:
    """Filters of all hypotheses about one ankle, advanced together."""

    def __init__(self, air: AirSettings, spread: Spread, ambient_pa: float) -> None:
        """Begin vented, with every hypothesis as good as the healthy one."""
        self._air = air
        self._spread = spread
        self._volumes_m3 = np.array(air.volumes_m3)
        self._count = len(self._volumes_m3)
        channels = range(1, self._count)
        places = range(self._count)
        self.hypotheses = (
            Hypothesis(Reason.NONE, 0),
            *(Hypothesis(Reason.LEAK, place) for place in places),
            *(Hypothesis(Reason.LEAK, place, jump=True) for place in places),
            *(Hypothesis(Reason.BLOCKED_LINE, place) for place in channels),
            *(Hypothesis(Reason.VALVE_STUCK_OPEN, place) for place in channels),
            *(Hypothesis(Reason.VALVE_STUCK_CLOSED, place) for place in channels),
            Hypothesis(Reason.PUMP_WEAK, 0),
            Hypothesis(Reason.PUMP_DEAD, 0),
            *(Hypothesis(Reason.SENSOR_STUCK, place) for place in places),
            *(Hypothesis(Reason.SENSOR_DRIFTING, place) for place in places),
            *(Hypothesis(Reason.SENSOR_DRIFTING, place, jump=True) for place in places),
        )
        count, models = self._count, len(self.hypotheses)
        self._offset = slice(count, 2 * count)
        self._pump = 2 * count
        self._line = slice(2 * count + 1, 3 * count)
        self._leak = slice(3 * count, 4 * count)
        size = 4 * count
        self._mean = np.zeros((models, size))
        self._mean[:, self._pump] = 1.0
        self._mean[:, self._line] = 1.0
        self._mean[:, self._leak] = air.leak_conductance_m3_s_pa / air.valve_conductance_m3_s_pa
        self._sd = np.zeros((models, size))
        self._sd[:, self._offset] = spread.offset_pa
        self._sd[:, self._pump] = spread.pump
        self._sd[:, self._line] = spread.line
        self._sd[:, self._leak] = spread.leak
        self._time_s = np.full((models, size), spread.change_time_s)
        self._opened = np.zeros((models, count - 1), dtype=bool)
        self._closed = np.zeros((models, count - 1), dtype=bool)
        self._stuck = np.zeros((models, count), dtype=bool)
        self._jumps = np.zeros((models, size))
        self._walk = np.zeros((models, size))
        self._moved = np.zeros((models, size), dtype=bool)
        self._least = np.full((models, size), -np.inf)
        self._most = np.full((models, size), np.inf)
        self._least[:, self._offset], self._most[:, self._offset] = -1000.0, 1000.0
        self._least[:, self._pump], self._most[:, self._pump] = 0.55, 2.0
        self._least[:, self._line], self._most[:, self._line] = 0.4, 2.5
        self._least[:, self._leak], self._most[:, self._leak] = 0.0, 0.03
        for model, hypothesis in enumerate(self.hypotheses):
            self._let_go(model, hypothesis)
        # What cannot follow the truth before its fault has begun starts anew from the healthy one until then.
        self._discrete = self._opened.any(axis=1) | self._closed.any(axis=1) | self._stuck.any(axis=1) | self._jumps.any(axis=1)
        self._discrete |= self._moved.any(axis=1)
        self._flows = self._flow_matrix()
        self.reset(ambient_pa)

    def reset(self, ambient_pa: float) -> None:
        """Begin anew, vented at `ambient_pa`, Pa, or at what the first readings say."""
        models, size = self._mean.shape
        self._state = self._mean.copy()
        self._state[:, : self._count] = ambient_pa
        deviation = self._sd.copy()
        deviation[:, : self._count] = ambient_pa  # not known before the first reading
        self._covariance = np.zeros((models, size, size))
        index = np.arange(size)
        self._covariance[:, index, index] = deviation**2
        self.scores = np.zeros(models)
        self._held_pa = np.full((models, self._count), ambient_pa)
        self._held_variance = np.full((models, self._count), self._spread.noise_pa**2)
        self._fresh = True
        self._grace_s = 0.0

    def estimate(self, model: int = 0) -> Estimate:
        """Return what a hypothesis makes of the ankle; the first is the healthy one."""
        state = self._state[model]
        deviation = np.sqrt(np.maximum(np.diagonal(self._covariance[model]), 0.0))
        return Estimate(
            pressures_pa=tuple(state[: self._count]),
            offsets_pa=tuple(state[self._offset]),
            pump_share=float(state[self._pump]),
            line_shares=tuple(state[self._line]),
            leaks_m3_s_pa=tuple(state[self._leak] * self._air.valve_conductance_m3_s_pa),
            leak_deviations_m3_s_pa=tuple(deviation[self._leak] * self._air.valve_conductance_m3_s_pa),
            pump_deviation=float(deviation[self._pump]),
        )

    def advance(self, step: Step) -> None:
        """Take what was commanded and what was read at the end of `step.duration_s`."""
        if self._fresh:
            self._begin(step)
        self._predict(step)
        gain = self._weigh(step.readings_pa)
        # While a valve may or may not have moved yet, what predicts least sharply is not the least likely: then and
        # a little later hypotheses may lose, but not gain by it, nor are they begun anew.
        change = gain - gain[0]
        if any(step.switching):
            self._grace_s = 0.3
            self.scores = np.maximum(self.scores + np.minimum(change, 0.0), -20.0)
            return
        self._grace_s -= step.duration_s
        self.scores = np.maximum(self.scores + change, -20.0 if self._grace_s > 0.0 else 0.0)
        self._begin_again(self._discrete & (self.scores == 0.0), step)

    def _begin_again(self, again, step) -> None:
        self._state[again] = self._state[0]
        self._covariance[again] = self._covariance[0]
        fresh = again[:, None] & self._moved
        self._state[fresh] = self._mean[fresh]
        self._covariance[fresh] = 0.0
        self._covariance.transpose(0, 2, 1)[fresh] = 0.0
        every = np.arange(self._state.shape[1])
        self._covariance[:, every, every] += np.where(fresh, self._sd**2, 0.0)
        every = np.arange(self._state.shape[1])
        self._covariance[:, every, every] += np.where(again[:, None], self._jumps**2, 0.0)
        readings = np.array(step.readings_pa)
        heard = np.isfinite(readings)
        self._held_pa[again] = np.where(heard, readings, self._held_pa[again])
        self._held_variance[again] = self._spread.noise_pa**2

    def _begin(self, step: Step) -> None:
        readings = np.array(step.readings_pa)
        heard = np.isfinite(readings)
        self._state[:, : self._count] = np.where(heard, readings, step.ambient_pa)
        self._held_pa[:] = self._state[:, : self._count]
        index = np.arange(self._count)
        self._covariance[:, index, index] = np.where(heard, self._spread.offset_pa, 1e4) ** 2
        self._fresh = False

    def _let_go(self, model: int, hypothesis: Hypothesis) -> None:
        place, count, reason = hypothesis.place, self._count, hypothesis.reason
        if reason is Reason.LEAK:
            self._move(model, 3 * count + place, (0.2, 1.5) if hypothesis.jump else (0.04, 0.3))
        elif reason is Reason.BLOCKED_LINE:
            self._move(model, 2 * count + place, (0.0, 0.3))
        elif reason is Reason.PUMP_WEAK:
            self._move(model, self._pump, (0.08, 0.45))
        elif reason is Reason.PUMP_DEAD:
            self._move(model, self._pump, (0.0, 0.05))
        elif reason is Reason.SENSOR_DRIFTING:
            self._least[model, count + place], self._most[model, count + place] = -np.inf, np.inf
            if hypothesis.jump:
                self._jumps[model, count + place] = 50e3
            else:
                self._walk[model, count + place] = (10e3) ** 2 / 277.0
                self._sd[model, count + place] = 10e3
                self._time_s[model, count + place] = np.inf
        elif reason is Reason.VALVE_STUCK_OPEN:
            self._opened[model, place - 1] = True
        elif reason is Reason.VALVE_STUCK_CLOSED:
            self._closed[model, place - 1] = True
        elif reason is Reason.SENSOR_STUCK:
            self._stuck[model, place] = True

    def _move(self, model: int, built: int, bounds: tuple[float, float]) -> None:
        """Let one thing be out of its healthy range, anywhere within `bounds`."""
        low, high = bounds
        self._least[model, built], self._most[model, built] = low, high
        self._mean[model, built] = 0.5 * (low + high)
        self._sd[model, built] = 0.4 * (high - low)
        self._time_s[model, built] = np.inf
        self._walk[model, built] = (0.1 * (high - low)) ** 2
        self._moved[model, built] = True

    def _flow_matrix(self) -> Array:
        """Pressure per flow of each volume: valves to the manifold, vents, leaks, the pump; 1/m^3."""
        count = self._count
        channels = count - 1
        matrix = np.zeros((count, 2 * channels + count + 1))
        for channel in range(channels):
            matrix[channel + 1, channel] = -1.0 / self._volumes_m3[channel + 1]
            matrix[0, channel] = 1.0 / self._volumes_m3[0]
            matrix[channel + 1, channels + channel] = 1.0 / self._volumes_m3[channel + 1]
        for place in range(count):
            matrix[place, 2 * channels + place] = 1.0 / self._volumes_m3[place]
        matrix[0, -1] = -1.0 / self._volumes_m3[0]
        return matrix

    def _predict(self, step: Step) -> None:
        air, count, state = self._air, self._count, self._state
        models = len(state)
        channels = count - 1
        pressures = np.maximum(state[:, :count], 100.0)
        manifold = pressures[:, :1]
        share = np.where(self._opened, 1.0, np.where(self._closed, 0.0, np.array(step.connected, dtype=float)))
        line = state[:, self._line] * air.valve_conductance_m3_s_pa
        drawn, drawn_by_channel, drawn_by_manifold = orifice(pressures[:, 1:], np.broadcast_to(manifold, (models, channels)))
        ambient = np.full_like(pressures, step.ambient_pa)
        inwards, _, inwards_by_place = orifice(ambient, pressures)
        curve = 1.0 - (step.ambient_pa - manifold[:, 0]) / air.pump_ultimate_vacuum_pa
        curve_slope = np.where(curve > 0.0, curve + manifold[:, 0] / air.pump_ultimate_vacuum_pa, 0.0)
        pumped = air.pump_free_flow_m3_s * np.maximum(curve, 0.0) * manifold[:, 0]
        leak = state[:, self._leak] * air.valve_conductance_m3_s_pa
        pump = state[:, self._pump]

        flows = np.concatenate(
            [share * line * drawn, (1.0 - share) * line * inwards[:, 1:], leak * inwards, (pump * step.duty * pumped)[:, None]],
            axis=1,
        )
        rate = flows @ self._flows.T
        by_pressure = np.zeros((models, count, count))
        to_channel, to_manifold = 1.0 / self._volumes_m3[1:], 1.0 / self._volumes_m3[0]
        index = np.arange(1, count)
        by_pressure[:, index, index] = (
            -share * line * drawn_by_channel + (1.0 - share) * line * inwards_by_place[:, 1:] + leak[:, 1:] * inwards_by_place[:, 1:]
        ) * to_channel
        by_pressure[:, index, 0] = -share * line * drawn_by_manifold * to_channel
        by_pressure[:, 0, index] = share * line * drawn_by_channel * to_manifold
        by_pressure[:, 0, 0] = (
            (share * line * drawn_by_manifold).sum(axis=1)
            + leak[:, 0] * inwards_by_place[:, 0]
            - pump * step.duty * air.pump_free_flow_m3_s * curve_slope
        ) * to_manifold
        by_built = np.zeros((models, count, self._mean.shape[1] - 2 * count))
        by_built[:, 0, 0] = -step.duty * pumped * to_manifold
        unit = air.valve_conductance_m3_s_pa
        by_built[:, index, index] = (-share * drawn + (1.0 - share) * inwards[:, 1:]) * unit * to_channel
        by_built[:, 0, index] = share * drawn * unit * to_manifold
        place = np.arange(count)
        by_built[:, place, count + place] = inwards * unit / self._volumes_m3

        # A linearly implicit step (Rosenbrock): stable however fast two volumes exchange air.
        duration_s = step.duration_s
        solved = np.linalg.inv(np.eye(count) - duration_s * by_pressure)
        state[:, :count] = np.maximum(pressures + (solved @ (duration_s * rate)[:, :, None])[:, :, 0], 100.0)
        rows = np.zeros((models, count, state.shape[1]))
        rows[:, :, :count] = solved
        rows[:, :, 2 * count :] = solved @ (duration_s * by_built)
        covariance = self._covariance
        moved = rows @ covariance
        within = moved @ rows.transpose(0, 2, 1)
        covariance[:, :count, :] = moved
        covariance[:, :, :count] = moved.transpose(0, 2, 1)
        covariance[:, :count, :count] = within

        spread = self._spread
        # A valve that is stuck does not move, whatever it is told.
        unsure = np.array(step.switching) & ~self._opened & ~self._closed
        unsure = np.concatenate([unsure, unsure], axis=1)
        relative = np.full(flows.shape, spread.flow)
        relative[:, : 2 * channels] += unsure
        doubtful = flows.copy()
        full = np.concatenate([line * drawn, line * inwards[:, 1:]], axis=1)
        doubtful[:, : 2 * channels] = np.where(unsure, full, flows[:, : 2 * channels])
        pump_doubt = step.duty_doubt * pump * pumped
        weights = (relative * doubtful) ** 2
        weights[:, -1] += pump_doubt**2
        weights[:, -1] = np.maximum(weights[:, -1], weights[0, -1])
        weights *= 2.0 * spread.flow_time_s * duration_s
        shaped = solved @ self._flows
        covariance[:, :count, :count] += (shaped * weights[:, None, :]) @ shaped.transpose(0, 2, 1)
        covariance[:, place, place] += (5.0**2) * duration_s / 0.1

        decay = np.exp(-duration_s / self._time_s)
        decay[:, :count] = 1.0
        state[:] = self._mean + decay * (state - self._mean)
        state[:, :count] = state[:, :count]  # pressures keep their value: their decay is 1
        covariance *= decay[:, :, None] * decay[:, None, :]
        every = np.arange(state.shape[1])
        covariance[:, every, every] += self._sd**2 * (1.0 - decay**2) + self._walk * duration_s

    def _weigh(self, readings_pa: tuple[float, ...]) -> Array:
        """Take the readings one after the other into every filter; return the log-likelihood of each."""
        count, state, covariance = self._count, self._state, self._covariance
        variance = self._spread.noise_pa**2
        total = np.zeros(len(state))
        for place, reading_pa in enumerate(readings_pa):
            if not math.isfinite(reading_pa):
                continue
            stuck = self._stuck[:, place]
            error = reading_pa - state[:, place] - state[:, count + place]
            row = covariance[:, place, :] + covariance[:, count + place, :]
            expected = row[:, place] + row[:, count + place] + variance
            held = self._held_variance[:, place]
            error = np.where(stuck, reading_pa - self._held_pa[:, place], error)
            expected = np.where(stuck, held + variance, expected)
            squared = error * error / expected
            own = expected
            squared_ = error * error / expected
            total -= 0.5 * (np.minimum(squared_, _CAP) + np.log(expected))
            share = held / (held + variance)
            self._held_pa[:, place] += np.where(stuck, share * error, 0.0)
            self._held_variance[:, place] = share * variance
            weight = np.where(stuck, 0.0, 1.0 / np.maximum(own, own * squared / _CAP))
            gain = row * weight[:, None]
            state += gain * error[:, None]
            covariance -= gain[:, :, None] * row[:, None, :]
        np.clip(state, self._least, self._most, out=state)
        return total


@dataclass(frozen=True)
class Step:
    """What happened from one set of readings to the next.

    Attributes:
        duration_s: Time between, s.
        readings_pa: What each sensor read at the end, Pa absolute: manifold, then channels; NaN where nothing came.
        connected: Per channel, whether it was commanded to the manifold.
        switching: Per channel, whether its valve may be moving.
        duty: The pump's duty, 0 to 1.
        duty_doubt: How far the duty that acts may be from that, 0 to 1.
        ambient_pa: Pressure of the atmosphere, Pa.

    """

    duration_s: float
    readings_pa: tuple[float, ...]
    connected: tuple[bool, ...]
    switching: tuple[bool, ...]
    duty: float
    duty_doubt: float
    ambient_pa: float


@dataclass(frozen=True)
class Estimate:
    """What one hypothesis makes of the ankle; the manifold first, then the channels.

    Attributes:
        pressures_pa: True pressures, Pa absolute.
        offsets_pa: How much each sensor reads too high, Pa.
        pump_share: Flow of the pump over the declared one, 1.
        line_shares: Conductance of each channel's line over the declared one, 1.
        leaks_m3_s_pa: Sonic conductance of each volume's leak, m^3/(s Pa).
        leak_deviations_m3_s_pa: Standard deviations of those.
        pump_deviation: Standard deviation of the pump's share.

    """

    pressures_pa: tuple[float, ...]
    offsets_pa: tuple[float, ...]
    pump_share: float
    line_shares: tuple[float, ...]
    leaks_m3_s_pa: tuple[float, ...]
    leak_deviations_m3_s_pa: tuple[float, ...]
    pump_deviation: float
