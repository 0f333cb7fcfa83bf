"""Facts that several packages count on. Imports nothing, so that every pure core may use it."""

from __future__ import annotations

STANDARD_GRAVITY_M_S2 = 9.80665
"""Specific force at rest, m/s^2 (standard gravity, CGPM 1901). Local gravity differs by at most 0.03 m/s^2."""

STANDARD_ATMOSPHERE_PA = 101_325.0
"""Standard atmosphere, Pa (ISO 2533): ambient pressure where none is measured."""

HELD_VACUUM_PA = 50e3
"""Vacuum that the paper's pump is known to hold, Pa; the paper names no deeper one."""

NANOSECONDS_PER_SECOND = 1_000_000_000
"""ROS counts time in whole nanoseconds. Divide by it: a product with 1e-9 is off by a bit now and then."""

MAX_REPEATS = 1000
"""Most runs of one request."""

MAX_SEED = 2**31 - 1
"""Largest seed: what a signed 32-bit number holds."""
