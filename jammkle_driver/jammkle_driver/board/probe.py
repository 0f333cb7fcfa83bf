"""Drives a board step by step and measures what its sensors make of it: the hands of `jammkle hardware check`."""

from __future__ import annotations

import asyncio
import contextlib
import math
import statistics
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_common.command.errors import Interrupted
from jammkle_common.names import CHANNELS
from jammkle_driver.board.line import RefusedError
from jammkle_driver.core.hardware import ActuatorCommand, released

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from jammkle_driver.board.dialogue import Dialogue, Exchange
    from jammkle_driver.board.wiring import Wiring

PERIOD_S = 0.01
RELEASED = released(CHANNELS)
_VENT_TURNS = 6
_VENT_TURN_S = 0.15


@dataclass(frozen=True)
class Moment:
    """One reading of all sensors: when, s, and the vacuum below each sensor's own reading at rest, Pa."""

    at_s: float
    vacuum_pa: Mapping[str, float]


def command(energised: Sequence[str] = (), duty: float = 0.0) -> ActuatorCommand:
    """Return the command that energises these channels and runs the pump."""
    return ActuatorCommand({name: name in energised for name in CHANNELS}, duty)


class Probe:
    """Keeps a command on a board for a while and collects what the sensors say."""

    def __init__(self, talk: Dialogue, wiring: Wiring, pace: float, stops: Callable[[], bool] = lambda: False) -> None:
        """Make a probe on an open dialogue.

        Args:
            talk: The dialogue.
            wiring: How the board is wired.
            pace: Factor on every duration.
            stops: Whether somebody wants an end; asked before every exchange.

        """
        self._pace = pace
        self._stops = stops
        self._talk = talk
        self._wiring = wiring
        self._rest_pa: dict[str, float] = {}

    @property
    def places(self) -> tuple[str, ...]:
        """Names of all sensors."""
        return tuple(self._wiring.sensors)

    async def exchanges(
        self, wanted: ActuatorCommand, duration_s: float, until: Callable[[Exchange], bool] | None = None
    ) -> list[tuple[float, Exchange]]:
        """Keep a command for so long, or until something holds; return every exchange, at least one, with its time, s.

        Raises:
            LineError: the board has gone.
            Interrupted: somebody wants an end.

        """
        found: list[tuple[float, Exchange]] = []
        end_s = time.monotonic() + self._pace * duration_s
        while time.monotonic() < end_s or not found:
            exchange = await self.exchange(wanted)
            found.append((time.monotonic(), exchange))
            if until is not None and until(exchange):
                break
            await asyncio.sleep(PERIOD_S)
        return found

    async def exchange(self, wanted: ActuatorCommand) -> Exchange:
        """Exchange once.

        A request that is on the line is never broken off: the release that follows would meet its reply.

        Raises:
            LineError: the board has gone.
            Interrupted: somebody wants an end.

        """
        if self._stops():
            raise Interrupted
        exchange = await self._talk.exchange(wanted)
        if exchange.latched:
            with contextlib.suppress(RefusedError):  # the next exchange tells, and it is tried again
                await self._talk.acknowledge()
        return exchange

    async def vent(self) -> None:
        """Let air into channels and manifold: a 3/2 valve has no way from the manifold to the air but by its channel.

        Each turn takes the manifold's vacuum down by the share of its volume in that of all (0.4 for an ankle).
        """
        for _ in range(_VENT_TURNS):
            await self.exchanges(command(CHANNELS), _VENT_TURN_S)
            await self.exchanges(RELEASED, _VENT_TURN_S)

    async def rest(self, duration_s: float) -> dict[str, tuple[float, float]]:
        """Vent everything; return mean and standard deviation of each sensor, Pa, and remember the mean as its rest.

        Both are NaN where a reading was outside the sensor's limits.
        """
        came = await self.exchanges(RELEASED, duration_s)
        settled = came[len(came) // 3 :]
        found = {}
        for place in self.places:
            readings = [exchange.sensors_pa[place] for _, exchange in settled]
            broken = not all(map(math.isfinite, readings))
            found[place] = (math.nan, math.nan) if broken else (statistics.fmean(readings), statistics.pstdev(readings))
            self._rest_pa[place], _ = found[place]
        return found

    async def drive(
        self, wanted: ActuatorCommand, duration_s: float, until: Callable[[Moment], bool] | None = None
    ) -> list[Moment]:
        """Keep a command; return the vacuum over time."""

        def holds(exchange: Exchange) -> bool:
            return until is not None and until(self._moment(0.0, exchange))

        return [self._moment(at_s, exchange) for at_s, exchange in await self.exchanges(wanted, duration_s, holds)]

    def _moment(self, at_s: float, exchange: Exchange) -> Moment:
        return Moment(at_s, {place: self._vacuum_pa(place, exchange.sensors_pa[place]) for place in self.places})

    def _vacuum_pa(self, place: str, measured_pa: float) -> float:
        less = measured_pa - self._rest_pa[place]
        return less if self._wiring.sensors[place].vacuum else -less


def rate_pa_s(moments: Sequence[Moment], place: str) -> float:
    """Return how fast a vacuum has grown, Pa/s: the slope of the least-squares line; 0 for less than two readings."""
    if len(moments) < 2:  # noqa: PLR2004 - a line
        return 0.0
    times = [moment.at_s for moment in moments]
    return statistics.linear_regression(times, [moment.vacuum_pa[place] for moment in moments]).slope
