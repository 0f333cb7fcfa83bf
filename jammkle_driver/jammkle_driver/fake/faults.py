"""What can be made to fail in a plant, and at the board before it."""

from __future__ import annotations

import enum


class FakeFault(enum.Enum):
    """What can be made to fail; the size's meaning and unit stand beside it."""

    LEAK = "leak"
    """Sonic conductance of the hole, m^3/(s Pa)."""
    BLOCKED = "blocked"
    """Share of the line's conductance that is left, 0 to 1."""
    STUCK_OPEN = "stuck_open"
    """The valve stays at the manifold; no size."""
    STUCK_CLOSED = "stuck_closed"
    """The valve stays at the vent; no size."""
    PUMP_DEAD = "pump_dead"
    """No size."""
    PUMP_WEAK = "pump_weak"
    """Share of the flow that is left, 0 to 1."""
    SENSOR_DEAD = "sensor_dead"
    """No reading comes; no size."""
    SENSOR_STUCK = "sensor_stuck"
    """The reading stands still where it is; no size."""
    SENSOR_DRIFT = "sensor_drift"
    """Rate at which the reading runs away, Pa/s."""
    SENSOR_BIAS = "sensor_bias"
    """How much the sensor reads too high from now on, Pa."""
    SENSOR_OUT_OF_RANGE = "sensor_out_of_range"
    """What is read, Pa absolute."""


class LinkFault(enum.Enum):
    """What can be made to fail at the board, and on the line to it; the size's meaning stands beside it."""

    UNPLUGGED = "unplugged"
    """The cable is pulled; no size."""
    REBOOTED = "rebooted"
    """The board starts anew, by its reset pin; no size."""
    BROWN_OUT = "brown_out"
    """The supply falls below what the board works with; no size."""
    LINE_NOISE = "line_noise"
    """Share of telegrams whose check sum is wrong, 0 to 1."""
