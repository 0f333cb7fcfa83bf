"""Measurements of `jammkle hardware check`: what is at the pins of a board, and whether it works."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import math
import statistics
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_common.command.errors import Interrupted
from jammkle_common.constants import HELD_VACUUM_PA
from jammkle_common.names import CHANNELS, TENDONS_OF_CHANNEL
from jammkle_driver.board.line import RefusedError
from jammkle_driver.core.hardware import MANIFOLD, ActuatorCommand, released

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Mapping, Sequence

    from jammkle_driver.board.protocol import BoardProtocol, Exchange
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

    def __init__(
        self, talk: BoardProtocol, wiring: Wiring, pace: float, stops: Callable[[], bool] = lambda: False
    ) -> None:
        """Make a probe on a board that was opened.

        `pace` is a factor on every duration; `stops` says whether somebody wants an end, before every exchange.
        """
        self._pace = pace
        self._stops = stops
        self._talk = talk
        self._wiring = wiring
        self._rest_pa: dict[str, float] = {}

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
            with contextlib.suppress(RefusedError):  # the next exchange says so, and it is tried again
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
        for place in self._wiring.sensors:
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
        more_pa = {place: pa - self._rest_pa[place] for place, pa in exchange.sensors_pa.items()}
        sensors = self._wiring.sensors
        return Moment(at_s, {place: pa if sensors[place].vacuum else -pa for place, pa in more_pa.items()})


def rate_pa_s(moments: Sequence[Moment], place: str) -> float:
    """Return how fast a vacuum has grown, Pa/s: the slope of the least-squares line; 0 for less than two readings."""
    if len(moments) < 2:  # noqa: PLR2004 - a line
        return 0.0
    times = [moment.at_s for moment in moments]
    return statistics.linear_regression(times, [moment.vacuum_pa[place] for moment in moments]).slope


_LOWEST_AMBIENT_PA, _HIGHEST_AMBIENT_PA = 60e3, 110e3
"""Pressure of the atmosphere from 4,000 m up to the deepest valley in the highest weather (ISO 2533)."""
_SPREAD_PA = 3e3
"""Two sensors of the MPX4115A class differ by no more: each is within 1.5 % of its 100 kPa (NXP data sheet)."""
_NOISE_PA = 500.0
"""Five steps of the board's converter, 10 bits over 115 kPa; more is a bad ground or a loose wire."""
_VENTED_PA = 5e3
"""The driver's own word for vented."""
_LEAK_SHARE = 0.05
"""A leak that takes more than this share of what the pump draws keeps it running for good."""
_OPEN_SHARE = 0.8
"""Share of the manifold's vacuum that a channel behind an open valve has after `_VALVE_S`, and one that does not vent
keeps for `_VENT_S`."""
_SLOW = 3.0
"""A line that takes this many times as long per tendon as the others has less than a third of their conductance, where
the driver reports BLOCKED_LINE."""
_LINE_TRIES = 3
"""How often a slow line is tried: a computer that was busy has been slow once."""
_NO_PRESSURE = "out of its limits", "its sensor gives no pressure: broken wire or no supply"
_REST_S = 0.6
_PUMP_S = 8.0
_VALVE_S = 3.0
_VENT_S = 1.0
_LEAK_S = 0.5


@dataclass(frozen=True)
class CheckRow:
    """One line of the table: what was looked at, whether it is well, what was measured, and what to do."""

    what: str
    passed: bool
    measured: str
    to_do: str = ""


def row_of(what: str, measured: str, to_do: str = "") -> CheckRow:
    """Return a row that has passed where nothing is to be done."""
    return CheckRow(what, not to_do, measured, to_do)


async def check(probe: Probe, wiring: Wiring) -> AsyncIterator[CheckRow]:
    """Yield one row after the other; everything is released at the end. A dead pump ends the check."""
    await probe.vent()
    readings = await probe.rest(_REST_S)
    rows = [_sensor_row(place, wiring, *reading) for place, reading in readings.items()]
    rows.append(_spread_row(wiring, {place: mean for place, (mean, _) in readings.items()}))
    for row in rows:
        yield row
    known = [name for name in (MANIFOLD, *CHANNELS) if name in readings and math.isfinite(readings[name][0])]
    place = known[0] if known else CHANNELS[0]
    energised = () if place == MANIFOLD else (place,)
    moments = await probe.drive(command(energised, 1.0), _PUMP_S, lambda m: m.vacuum_pa[place] >= HELD_VACUUM_PA)
    pump = _pump_row(moments, place)
    yield pump
    if pump.passed:
        drawn_pa_s = _drawn_pa_s(moments, place)
        rested = await probe.drive(command(energised, 0.0), _LEAK_S)
        yield _leak_row(place, [moments[-1], *rested], drawn_pa_s)  # a big leak is through before the next reading
        falls_s: dict[str, float] = {}
        for channel in CHANNELS:
            async for row in _valve_rows(probe, channel, place, drawn_pa_s, falls_s):
                yield row
        for channel in falls_s if len(falls_s) > 1 else ():
            yield await _line_row(probe, channel, falls_s)
    await probe.exchanges(RELEASED, 0.1)


async def _valve_rows(
    probe: Probe, channel: str, place: str, drawn_pa_s: float, falls_s: dict[str, float]
) -> AsyncIterator[CheckRow]:
    before = await probe.drive(RELEASED, _VENT_S, lambda m: all(m.vacuum_pa[name] < _VENTED_PA for name in CHANNELS))
    vented = [name for name in CHANNELS if before[-1].vacuum_pa[name] <= _VENTED_PA]  # others have a fault of their own
    opened = await _open(probe, channel, place)
    others = [name for name in vented if name != channel and opened[-1].vacuum_pa[name] > _VENTED_PA]
    yield _open_row(opened[-1], channel, place, others)
    rested = await probe.drive(command((channel,), 0.0), _LEAK_S)
    if opened[-1].vacuum_pa[channel] > _VENTED_PA:
        yield _leak_row(channel, rested[len(rested) // 3 :], drawn_pa_s)
    closed = await _close(probe, channel)
    row = _vent_row(closed, channel)
    yield row
    if row.passed and closed[0].vacuum_pa[channel] > _VENTED_PA:
        falls_s[channel] = _fall_s(closed, channel)


async def _open(probe: Probe, channel: str, place: str) -> list[Moment]:
    def follows(moment: Moment) -> bool:
        return moment.vacuum_pa[channel] >= _OPEN_SHARE * max(HELD_VACUUM_PA, moment.vacuum_pa[place])

    return await probe.drive(command((channel,), 1.0), _VALVE_S, follows)


async def _close(probe: Probe, channel: str) -> list[Moment]:
    return await probe.drive(RELEASED, _VENT_S, lambda m: m.vacuum_pa[channel] < _VENTED_PA)


async def _line_row(probe: Probe, channel: str, falls_s: Mapping[str, float]) -> CheckRow:
    """Compare how fast a channel vents with the fastest of the others; volumes are as their numbers of tendons."""
    usual_s = min(fall_s for name, fall_s in falls_s.items() if name != channel)
    tries_s = [falls_s[channel]]
    while (slow := min(tries_s) > _SLOW * usual_s) and len(tries_s) < _LINE_TRIES:
        await _open(probe, channel, channel)
        tries_s.append(_fall_s(await _close(probe, channel), channel))
    measured = f"vents in {min(tries_s):.3f} s per tendon, the fastest other in {usual_s:.3f} s"
    to_do = "slow: look for a pinched or kinked hose, or a clogged filter" if slow else ""
    return row_of(f"line {channel}", measured, to_do)


def _fall_s(moments: Sequence[Moment], channel: str) -> float:
    """Return the time in which a channel that vents falls from 80 to 20 % of its vacuum, s per tendon."""
    first_pa = moments[0].vacuum_pa[channel]
    began_s, ended_s = (_crossed_s(moments, channel, share * first_pa) for share in (0.8, 0.2))
    return (ended_s - began_s) / len(TENDONS_OF_CHANNEL[channel])


def _crossed_s(moments: Sequence[Moment], channel: str, level_pa: float) -> float:
    """Return when a falling vacuum crosses a level, between two readings by a straight line."""
    for before, after in itertools.pairwise(moments):
        high_pa, low_pa = before.vacuum_pa[channel], after.vacuum_pa[channel]
        if low_pa < level_pa:
            return before.at_s + (after.at_s - before.at_s) * (high_pa - level_pa) / (high_pa - low_pa)
    return moments[-1].at_s


def _sensor_row(place: str, wiring: Wiring, mean_pa: float, noise_pa: float) -> CheckRow:
    what, measured, to_do = f"sensor {place} at rest", f"{mean_pa / 1e3:.1f} kPa, noise {noise_pa:.0f} Pa", ""
    low, high = (-_SPREAD_PA, _SPREAD_PA) if wiring.sensors[place].vacuum else (_LOWEST_AMBIENT_PA, _HIGHEST_AMBIENT_PA)
    if not math.isfinite(mean_pa):
        measured, to_do = _NO_PRESSURE
    elif not low <= mean_pa <= high:
        to_do = f"expected {low / 1e3:.0f} to {high / 1e3:.0f} kPa: wire, supply of the sensor, scale in the board file"
    elif noise_pa > _NOISE_PA:
        to_do = "loose wire, or ground shared with the pump"
    return row_of(what, measured, to_do)


def _spread_row(wiring: Wiring, means_pa: dict[str, float]) -> CheckRow:
    same = {place: pa for place, pa in means_pa.items() if not wiring.sensors[place].vacuum and math.isfinite(pa)}
    spread_pa = max(same.values()) - min(same.values()) if same else 0.0
    to_do = "" if spread_pa <= _SPREAD_PA else "calibrate; if that does not help, one sensor is broken"
    return row_of("sensors agree", f"within {spread_pa / 1e3:.1f} kPa", to_do)


def _pump_row(moments: Sequence[Moment], place: str) -> CheckRow:
    reached_pa = moments[-1].vacuum_pa[place]
    took_s = moments[-1].at_s - moments[0].at_s
    if not math.isfinite(reached_pa):
        return row_of("pump", *_NO_PRESSURE)
    if reached_pa >= HELD_VACUUM_PA:
        to_do = ""
    elif reached_pa < _VENTED_PA:
        to_do = "does it run? supply, MOSFET, pin; if it runs: hose, or in and out exchanged; a valve stuck open vents"
    else:
        to_do = f"below {HELD_VACUUM_PA / 1e3:.0f} kPa after {_PUMP_S:.0f} s: leak at the manifold, or worn membrane"
    return row_of("pump", f"{reached_pa / 1e3:.1f} kPa in {took_s:.1f} s", to_do)


def _leak_row(place: str, moments: Sequence[Moment], drawn_pa_s: float) -> CheckRow:
    lost_pa_s = max(-rate_pa_s(moments, place), 0.0)
    share = lost_pa_s / drawn_pa_s
    to_do = "" if share <= _LEAK_SHARE else "find it with soapy water: hose ends, membrane, valve seat"
    measured = f"{lost_pa_s:.0f} Pa/s, {100.0 * share:.1f} % of what the pump draws"
    return row_of(f"leak of {place}", measured, to_do)


def _open_row(moment: Moment, channel: str, place: str, others: Sequence[str]) -> CheckRow:
    vacuum_pa = moment.vacuum_pa[channel]
    if not math.isfinite(vacuum_pa):
        return row_of(f"valve {channel} connects", *_NO_PRESSURE)
    measured = f"{vacuum_pa / 1e3:.1f} kPa, {place} {moment.vacuum_pa[place] / 1e3:.1f} kPa"
    if others:
        also = "also" if vacuum_pa > _VENTED_PA else "instead"
        to_do = f"{', '.join(others)} {also} gets vacuum: exchanged wires, hoses or sensors; or its valve is stuck open"
    elif vacuum_pa >= _OPEN_SHARE * moment.vacuum_pa[place] and vacuum_pa > _VENTED_PA:
        to_do = ""
    elif vacuum_pa > _VENTED_PA:
        to_do = "slow: blocked or kinked line, or a big leak in the tendon"
    else:
        to_do = "does it click? supply, MOSFET, pin; if it clicks: blocked line, or stuck closed"
    return row_of(f"valve {channel} connects", measured, to_do)


def _vent_row(moments: Sequence[Moment], channel: str) -> CheckRow:
    left_pa = moments[-1].vacuum_pa[channel]
    took_s = moments[-1].at_s - moments[0].at_s
    if not math.isfinite(left_pa):
        return row_of(f"valve {channel} vents", *_NO_PRESSURE)
    to_do = ""
    if left_pa >= max(_OPEN_SHARE * moments[0].vacuum_pa[channel], _VENTED_PA):
        to_do = "stuck open, its vent is blocked, or its flyback diode keeps it energised"
    elif left_pa >= _VENTED_PA:
        to_do = "slow: blocked or kinked line, or a clogged vent"
    measured = f"{left_pa / 1e3:.1f} kPa after {took_s:.2f} s"
    return row_of(f"valve {channel} vents", measured, to_do)


def _drawn_pa_s(moments: Sequence[Moment], place: str) -> float:
    """Return what the pump draws, Pa/s: the mean from start to the vacuum that it was asked for."""
    took_s = max(moments[-1].at_s - moments[0].at_s, 1e-3)
    return max(moments[-1].vacuum_pa[place] - moments[0].vacuum_pa[place], 1.0) / took_s
