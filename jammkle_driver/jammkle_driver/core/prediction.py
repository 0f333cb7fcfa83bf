"""One step of the law of the air for all hypotheses at once: where the pressures go, and how sure that is.

A linearly implicit (Rosenbrock) step of the mass balances, stable however fast two volumes exchange air, and its
linearisation for an extended Kalman filter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_driver.core.air import orifice
from jammkle_driver.core.heat import HEAT_TIME_S

if TYPE_CHECKING:
    from jammkle_driver.core.air import AirSettings, Array
    from jammkle_driver.core.hypotheses import Spread, Tables

_LOWEST_PA = 100.0
"""Pressure below which none is taken to be, Pa: no pump of this kind gets there, and ratios stay finite."""

_LEFT_OUT_PA_RTS = 16.0
"""How a pressure may walk beyond all flows, Pa/sqrt(s): rounding. Assumed."""


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


class Predictor:
    """Advances states and covariances of all hypotheses of one ankle."""

    def __init__(self, air: AirSettings, spread: Spread, tables: Tables) -> None:
        """Prepare for an ankle."""
        self._air = air
        self._spread = spread
        self._tables = tables
        self._volumes_m3 = np.array(air.volumes_m3)
        self._drifting = tuple(np.array(tables.drifting).T)  # hypotheses, and the offset that drifts in each
        volumes, channels = tables.layout.volumes, tables.layout.volumes - 1
        self._spreading = np.zeros((volumes, 2 * channels + volumes + 1))  # pressure rate per flow, 1/m^3
        for channel in range(channels):
            self._spreading[channel + 1, channel] = -1.0 / self._volumes_m3[channel + 1]
            self._spreading[0, channel] = 1.0 / self._volumes_m3[0]
            self._spreading[channel + 1, channels + channel] = 1.0 / self._volumes_m3[channel + 1]
        for place in range(volumes):
            self._spreading[place, 2 * channels + place] = 1.0 / self._volumes_m3[place]
        self._spreading[0, -1] = -1.0 / self._volumes_m3[0]

    def advance(self, state: Array, covariance: Array, step: Step) -> None:
        """Advance states, shape (hypotheses, quantities), and covariances in place."""
        tables, volumes, duration_s = self._tables, self._tables.layout.volumes, step.duration_s
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
        covariance[:, every, every] += tables.deviation**2 * (1.0 - decay**2) + tables.walk * duration_s

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

        into, channel = 1.0 / self._volumes_m3, np.arange(1, volumes)
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
        # A valve that is stuck does not move, whatever it is told.
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
