"""Which outputs are due at which simulation step: counted in whole steps, so that no rate can drift."""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING

from jammkle_common.constants import NANOSECONDS_PER_SECOND

if TYPE_CHECKING:
    from collections.abc import Mapping

_RATE_TOLERANCE = 1e-9


class Output(enum.Enum):
    """What the sim node publishes at rates of their own. Listed in the order of publishing."""

    JOINT_STATES = "joint_states"
    TENDON_STATES = "tendon_states"
    LOAD_CELL = "load_cell"
    TRUE_CONTACT = "true_contact"
    GAIT = "gait"
    """What the robot's gait plans of the foot."""
    WHOLE = "whole"
    """Where the base is, and the joints of all ankles together."""
    PRESSURES = "pressures"
    IMU = "imu"


STATES = (Output.JOINT_STATES, Output.TENDON_STATES)
"""Outputs that are states and not readings: looking at them once more, between two due times, disturbs nothing."""


class RateError(ValueError):
    """A rate that the time step does not divide. The message is one line with the rates that would do."""


def timestep_ns(timestep_s: float) -> int:
    """Return the time step in whole nanoseconds, so that every stamp is exact.

    Raises:
        RateError: it is not a whole number of nanoseconds.

    """
    nanoseconds = timestep_s * NANOSECONDS_PER_SECOND
    if round(nanoseconds) < 1 or abs(nanoseconds - round(nanoseconds)) > _RATE_TOLERANCE * nanoseconds:
        msg = f"timestep_s is {timestep_s!r}; it must be a whole number of nanoseconds, as 0.0005 is"
        raise RateError(msg)
    return round(nanoseconds)


def steps_per_output(rate_hz: int, timestep_s: float, max_rate_hz: int) -> int:
    """Whole number of steps between two outputs.

    Args:
        rate_hz: Rate wanted, Hz.
        timestep_s: Simulation step, s.
        max_rate_hz: Highest rate to name in the error, Hz.

    Raises:
        RateError: the rate is not the step rate divided by a whole number.

    """
    steps_per_second = 1.0 / timestep_s
    steps = steps_per_second / rate_hz
    if steps < 1 - _RATE_TOLERANCE or abs(steps - round(steps)) > _RATE_TOLERANCE * steps:
        fitting = [
            rate
            for rate in range(1, max_rate_hz + 1)
            if abs(steps_per_second / rate - round(steps_per_second / rate)) <= _RATE_TOLERANCE * steps_per_second
        ]
        below, above = [rate for rate in fitting if rate < rate_hz], [rate for rate in fitting if rate > rate_hz]
        neighbours = " or ".join(str(rate) for rate in below[-1:] + above[:1])
        way_out = f"as {neighbours} Hz" if neighbours else "which none does: change timestep_s, 0.0005 s is usual"
        msg = (
            f"an output rate of {rate_hz} Hz does not fit timestep_s of {timestep_s:g} s; "
            f"the rate must divide {steps_per_second:g} Hz, {way_out}"
        )
        raise RateError(msg)
    return round(steps)


class Schedule:
    """Outputs by step, counted from the last (re)start of the rig. An output of period n is due at n, 2n, 3n ..."""

    def __init__(self, periods: Mapping[Output, int]) -> None:
        """Take the periods.

        Args:
            periods: Steps between two of each output, each at least 1.

        """
        if not periods or min(periods.values()) < 1:
            msg = f"every output needs a period of at least one step, not {dict(periods)}"
            raise ValueError(msg)
        # An enum's members iterate in the order of their definition, which is the order of publishing.
        self._periods = tuple((output, periods[output]) for output in Output if output in periods)
        self._distinct = tuple(sorted(set(periods.values())))

    def due(self, step: int) -> tuple[Output, ...]:
        """Outputs due at `step`, in the order of publishing."""
        return tuple([output for output, period in self._periods if step % period == 0])

    def steps_to_next(self, step: int) -> int:
        """Steps from `step` to the next one, after it, at which something is due."""
        return min([period - step % period for period in self._distinct])
