"""The air: pump, manifold, solenoids, tubes and tendons, the firmware that keeps the vacuum, and a run of all of it."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from jammkle_common import names
from jammkle_common.names import CHANNELS
from studies.blind.reality.bodies import compiled
from studies.blind.reality.machine import GAS_J_KG_K, HEAT_RATIO, Machine, Sensors, stream
from studies.blind.reality.sensors import Track, coloured

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from studies.blind.reality.machine import Air, Regulator

PERIOD_S = 0.010
"""Between two decisions: 100 Hz."""
_LEAST_DUTY = -0.2
"""Where the sum of the changes stops falling. Not at 0, else noise alone would add up to a vacuum too deep."""


@dataclass(frozen=True)
class SetPoint:
    """From a time on, a channel is to be at a vacuum; 0 vents it."""

    time_s: float
    channel: str
    vacuum_pa: float


def together(time_s: float, channels: Sequence[str], vacuum_pa: float) -> tuple[SetPoint, ...]:
    """Return set points of several channels at once."""
    return tuple(SetPoint(time_s, channel, vacuum_pa) for channel in channels)


def wanted_pa(schedule: Sequence[SetPoint], time_s: float) -> tuple[float, ...]:
    """Return the set point of each channel at a time, in the order of CHANNELS, Pa."""
    latest = dict.fromkeys(CHANNELS, 0.0)
    for point in sorted(schedule, key=lambda each: each.time_s):
        if point.time_s <= time_s + 1e-9:
            latest[point.channel] = point.vacuum_pa
    return tuple(latest[channel] for channel in CHANNELS)


@dataclass(frozen=True)
class Orders:
    """What pump and coils are commanded."""

    duty: float
    """0 to 1, in steps of the pulse width."""
    coils: tuple[bool, ...]
    """In the order of CHANNELS."""


@dataclass(frozen=True)
class Memory:
    """What the firmware keeps from one decision to the next."""

    duty: float = 0.0
    """Before rounding; below 0 it says how much too deep the vacuum is."""
    band_pa: float = 0.0
    """Error within the band in which the duty is not full."""
    running: bool = False


def decide(
    regulator: Regulator, memory: Memory, wanted: tuple[float, ...], vacuum_pa: Sequence[float], manifold_pa: float
) -> tuple[Orders, Memory]:
    """Return what to command now: a regulator in its velocity form, that adds changes to the duty.

    Args:
        regulator: Its constants.
        memory: From the decision before.
        wanted: Set points, Pa, in the order of CHANNELS.
        vacuum_pa: Measured vacuum of each channel, Pa.
        manifold_pa: Measured vacuum of the manifold, Pa.

    """
    coils = tuple(each > 0.0 for each in wanted)
    if not any(coils):
        return Orders(0.0, coils), Memory()
    missing_pa = max(goal - has for goal, has in zip(wanted, vacuum_pa, strict=True) if goal > 0.0)
    error_pa = min(missing_pa, max(wanted) + regulator.lead_pa - manifold_pa)
    # What lies beyond full duty does not count, else the duty would fall long before the set point.
    band_pa = min(max(error_pa, -1.0 / regulator.gain_per_pa), 1.0 / regulator.gain_per_pa)
    before_pa = memory.band_pa if memory.running else 0.0
    change = regulator.gain_per_pa * (band_pa - before_pa + error_pa * PERIOD_S / regulator.integral_s)
    duty = min(max(memory.duty + change, _LEAST_DUTY), 1.0)
    rounded = round(max(duty, 0.0) * regulator.duty_steps) / regulator.duty_steps
    return Orders(rounded, coils), dataclasses.replace(memory, duty=duty, band_pa=band_pa, running=True)


STEP_S = 5e-5
"""Time step of the air, s."""
LINES = len(CHANNELS)
NODES = 1 + 2 * LINES
"""Manifold, then tube and tendon of each line."""
_CV = GAS_J_KG_K / (HEAT_RATIO - 1.0)
_CP = HEAT_RATIO * _CV
_CRITICAL = (2.0 / (HEAT_RATIO + 1.0)) ** (HEAT_RATIO / (HEAT_RATIO - 1.0))
_NEARLY_EQUAL = 0.995
"""Ratio of pressures above which a nozzle is linear, as its slope has no end there."""

AMBIENT, ROOM, FREE_FLOW, ULTIMATE, BULGE, RIPPLE, STROKE, RETURN = range(8)
"""Places in `AirLaw.scalars`."""
VALVE, LAMINAR, TURBULENT, DEAD, TRAVEL, SLUG = range(6)
"""Rows of `AirLaw.lines`."""
VOLUME, WALL, LEAK = range(3)
"""Rows of `AirLaw.nodes`."""


class AirLaw(NamedTuple):
    """Constants."""

    scalars: NDArray[np.float64]
    lines: NDArray[np.float64]
    """Shape (6, LINES)."""
    nodes: NDArray[np.float64]
    """Shape (3, NODES)."""


class AirState(NamedTuple):
    """Memory."""

    mass_kg: NDArray[np.float64]
    """Shape (NODES,)."""
    heat_j: NDArray[np.float64]
    """Inner energy, shape (NODES,)."""
    lift: NDArray[np.float64]
    """Of each armature: 0 vented, 1 on the manifold."""
    goal: NDArray[np.float64]
    """Where it will move."""
    wait_s: NDArray[np.float64]
    """How long it still rests."""
    more: NDArray[np.float64]
    """Duty; phase of the stroke, turns; mass admitted, mass pumped out, kg; heat that came in, J."""


def air_law(air: Air) -> AirLaw:
    """Return the constants of the compiled loop."""
    pump = air.pump
    scalars = np.array([
        air.ambient_pa, air.room_k, pump.free_flow_m3_s, pump.ultimate_vacuum_pa, pump.bulge, pump.ripple,
        pump.stroke_hz, pump.return_area_m2,
    ])  # fmt: skip
    lines = np.array([
        (line.valve_area_m2, line.laminar_per_m_s, line.turbulent_per_m4, line.dead_s, line.travel_s, line.slug_pa)
        for line in air.lines
    ]).T.copy()  # fmt: skip
    nodes = np.zeros((3, NODES))
    nodes[:, 0] = air.manifold_volume_m3, air.manifold_wall_w_k, air.manifold_leak_area_m2
    for i, line in enumerate(air.lines):
        nodes[:, 1 + 2 * i] = line.tube_volume_m3, line.tube_wall_w_k, 0.0
        nodes[:, 2 + 2 * i] = line.tendon_volume_m3, line.tendon_wall_w_k, line.leak_area_m2
    return AirLaw(scalars, lines, nodes)


def vented(law: AirLaw) -> AirState:
    """Return everything at ambient pressure and room temperature, pump off."""
    mass_kg = law.scalars[AMBIENT] * law.nodes[VOLUME] / (GAS_J_KG_K * law.scalars[ROOM])
    heat_j = mass_kg * _CV * law.scalars[ROOM]
    return AirState(mass_kg, heat_j, np.zeros(LINES), np.zeros(LINES), np.zeros(LINES), np.zeros(5))


def pressures_pa(law: AirLaw, state: AirState) -> NDArray[np.float64]:
    """Return the absolute pressures of all nodes, Pa."""
    found: NDArray[np.float64] = state.heat_j * (HEAT_RATIO - 1.0) / law.nodes[VOLUME]
    return found


@compiled
def nozzle_kg_s(area_m2: float, up_pa: float, up_k: float, down_pa: float) -> float:
    """Return the mass flow through a nozzle from the higher to the lower pressure: isentropic, choked or not."""
    ratio = down_pa / up_pa
    linear = 1.0
    if ratio < _CRITICAL:
        ratio = _CRITICAL
    elif ratio > _NEARLY_EQUAL:
        linear = (1.0 - ratio) / (1.0 - _NEARLY_EQUAL)
        ratio = _NEARLY_EQUAL
    power = ratio ** (1.0 / HEAT_RATIO)
    flow = math.sqrt(2.0 * _CP / (GAS_J_KG_K * GAS_J_KG_K * up_k) * power * (power - ratio))
    return area_m2 * up_pa * flow * linear


@compiled
def tube_kg_s(laminar: float, turbulent: float, density_kg_m3: float, difference_pa: float) -> float:
    """Return the mass flow through a tube: laminar and turbulent loss, solved for the flow."""
    push = 4.0 * turbulent * density_kg_m3 * difference_pa
    return 2.0 * density_kg_m3 * difference_pa / (laminar + math.sqrt(laminar * laminar + push))


@compiled
def _exchange(law: Any, state: Any, phase: float, mass: Any, heat: Any, rates: Any) -> None:
    """Write the rates of mass, kg/s, and heat, W, of every node, and those of all air together.

    Args:
        law: AirLaw.
        state: AirState, of which lift and duty are looked at.
        phase: Of the stroke, turns.
        mass: Of every node, kg.
        heat: Of every node, J.
        rates: Written, shape (3, NODES): mass, heat, and in the last row what is admitted and pumped out, kg/s, and the
            heat that comes in, W.

    """
    for i in range(NODES):
        rates[0, i] = rates[2, i] = 0.0
        rates[1, i] = law.nodes[WALL, i] * (law.scalars[ROOM] - heat[i] / (mass[i] * _CV))
    for i in range(NODES):
        rates[2, 2] += rates[1, i]
        _admit(law, i, law.nodes[LEAK, i], heat, rates)
    _admit(law, 0, law.scalars[RETURN], heat, rates)
    _pump(law, state.more[0], phase, mass, heat, rates)
    for i in range(LINES):
        _seats(law, i, state.lift[i], mass, heat, rates)
        _tube(law, i, mass, heat, rates)


@compiled
def _admit(law: Any, node: int, area_m2: float, heat: Any, rates: Any) -> None:
    """Let air of the room into a node through a hole."""
    pressure_pa = heat[node] * (HEAT_RATIO - 1.0) / law.nodes[VOLUME, node]
    if area_m2 <= 0.0 or pressure_pa >= law.scalars[AMBIENT]:
        return
    flow = nozzle_kg_s(area_m2, law.scalars[AMBIENT], law.scalars[ROOM], pressure_pa)
    _enter(rates, node, flow, flow * _CP * law.scalars[ROOM])


@compiled
def _enter(rates: Any, node: int, flow: float, carried: float) -> None:
    """Book what comes from outside."""
    rates[0, node] += flow
    rates[1, node] += carried
    rates[2, 0] += flow
    rates[2, 2] += carried


@compiled
def _pass_on(rates: Any, source: int, sink: int, flow: float, carried: float) -> None:
    """Book what goes from node to node."""
    rates[0, source] -= flow
    rates[1, source] -= carried
    rates[0, sink] += flow
    rates[1, sink] += carried


@compiled
def _pump(law: Any, duty: float, phase: float, mass: Any, heat: Any, rates: Any) -> None:
    """Draw from the manifold, stroke by stroke."""
    scalars = law.scalars
    depth = (scalars[AMBIENT] - heat[0] * (HEAT_RATIO - 1.0) / law.nodes[VOLUME, 0]) / scalars[ULTIMATE]
    stroke = 1.0 + scalars[RIPPLE] * math.sin(2.0 * math.pi * phase)
    drawn_m3_s = duty * stroke * scalars[FREE_FLOW] * (1.0 - depth) * (1.0 + scalars[BULGE] * depth)
    if drawn_m3_s <= 0.0 or depth >= 1.0:
        return
    flow = drawn_m3_s * mass[0] / law.nodes[VOLUME, 0]
    carried = flow * _CP * heat[0] / (mass[0] * _CV)
    rates[0, 0] -= flow
    rates[1, 0] -= carried
    rates[2, 1] += flow
    rates[2, 2] -= carried


@compiled
def _seats(law: Any, line: int, lift: float, mass: Any, heat: Any, rates: Any) -> None:
    """Let air through the two seats of a solenoid, both open while the armature travels."""
    tube, area_m2 = 1 + 2 * line, law.lines[VALVE, line]
    ambient, room = law.scalars[AMBIENT], law.scalars[ROOM]
    tube_pa = heat[tube] * (HEAT_RATIO - 1.0) / law.nodes[VOLUME, tube]
    tube_k = heat[tube] / (mass[tube] * _CV)
    if lift > 0.0:
        manifold_pa = heat[0] * (HEAT_RATIO - 1.0) / law.nodes[VOLUME, 0]
        manifold_k = heat[0] / (mass[0] * _CV)
        if tube_pa >= manifold_pa:
            flow = nozzle_kg_s(area_m2 * lift, tube_pa, tube_k, manifold_pa)
            _pass_on(rates, tube, 0, flow, flow * _CP * tube_k)
        else:
            flow = nozzle_kg_s(area_m2 * lift, manifold_pa, manifold_k, tube_pa)
            _pass_on(rates, 0, tube, flow, flow * _CP * manifold_k)
    if lift < 1.0:
        if tube_pa >= ambient:
            flow = -nozzle_kg_s(area_m2 * (1.0 - lift), tube_pa, tube_k, ambient)
            _enter(rates, tube, flow, flow * _CP * tube_k)
        else:
            flow = nozzle_kg_s(area_m2 * (1.0 - lift), ambient, room, tube_pa)
            _enter(rates, tube, flow, flow * _CP * room)


@compiled
def _tube(law: Any, line: int, mass: Any, heat: Any, rates: Any) -> None:
    """Let air along a tube, past the water in it, if there is any."""
    tube, tendon = 1 + 2 * line, 2 + 2 * line
    volume = law.nodes[VOLUME]
    difference_pa = (heat[tendon] / volume[tendon] - heat[tube] / volume[tube]) * (HEAT_RATIO - 1.0)
    moving_pa = abs(difference_pa) - law.lines[SLUG, line]
    if moving_pa <= 0.0:
        return
    density = 0.5 * (mass[tube] / volume[tube] + mass[tendon] / volume[tendon])
    flow = tube_kg_s(law.lines[LAMINAR, line], law.lines[TURBULENT, line], density, moving_pa)
    source, sink = (tendon, tube) if difference_pa > 0.0 else (tube, tendon)
    _pass_on(rates, source, sink, flow, flow * _CP * heat[source] / (mass[source] * _CV))


@compiled
def advance_air(law: Any, state: Any, first: int, steps: int, every: int, history_pa: Any) -> None:
    """Advance the air by steps, and write the pressures after every so many of them.

    Args:
        law: AirLaw.
        state: AirState, changed in place.
        first: Steps taken before these.
        steps: How many.
        every: Steps per row of the history.
        history_pa: Shape (rows, NODES), Pa; row `n` is written after step `n * every`.

    """
    one, two = np.empty((3, NODES)), np.empty((3, NODES))
    mass, heat = np.empty(NODES), np.empty(NODES)
    duty = state.more[0]
    for step in range(first + 1, first + steps + 1):
        for i in range(LINES):
            if state.wait_s[i] > 0.0:
                state.wait_s[i] -= STEP_S
                continue
            pace = STEP_S / max(law.lines[TRAVEL, i], STEP_S)
            state.lift[i] += min(max(state.goal[i] - state.lift[i], -pace), pace)
        _exchange(law, state, state.more[1], state.mass_kg, state.heat_j, one)
        for i in range(NODES):
            mass[i] = state.mass_kg[i] + STEP_S * one[0, i]
            heat[i] = state.heat_j[i] + STEP_S * one[1, i]
        state.more[1] = (state.more[1] + duty * law.scalars[STROKE] * STEP_S) % 1.0
        _exchange(law, state, state.more[1], mass, heat, two)
        for i in range(NODES):
            state.mass_kg[i] += 0.5 * STEP_S * (one[0, i] + two[0, i])
            state.heat_j[i] += 0.5 * STEP_S * (one[1, i] + two[1, i])
        state.more[2] += 0.5 * STEP_S * (one[2, 0] + two[2, 0])
        state.more[3] += 0.5 * STEP_S * (one[2, 1] + two[2, 1])
        state.more[4] += 0.5 * STEP_S * (one[2, 2] + two[2, 2])
        if step % every == 0:
            for i in range(NODES):
                history_pa[step // every, i] = state.heat_j[i] * (HEAT_RATIO - 1.0) / law.nodes[VOLUME, i]


HISTORY_S = 5e-4
"""Between two rows of the history."""
_EVERY = round(HISTORY_S / STEP_S)
_DECIDES_S = 0.0003
"""From reading the pressures to commanding. Assumed."""
_TARE = 8
"""Readings of which the firmware takes the mean as atmosphere when it starts."""
_SENSED = (0, *(2 + 2 * i for i in range(LINES)))
"""Nodes with a pressure sensor: manifold, then the tendons of each line."""
_KEPT = 16
"""Runs of the air kept per process, as the same day is run with one fault after the other; each takes 0.5 MB."""


@dataclass(frozen=True)
class AirRun:
    """What the air did and what was recorded of it. Runs share it: nothing in it may be changed."""

    time_s: NDArray[np.float64]
    """Every HISTORY_S from 0, shape (n,)."""
    pressure_pa: NDArray[np.float64]
    """Absolute, of every node, shape (n, NODES)."""
    vacuum_pa: NDArray[np.float64]
    """In the tendons of each channel, shape (n, channels)."""
    topics: Mapping[str, Track]
    """Pressures and commands."""


def breathe(machine: Machine, schedule: Sequence[SetPoint], duration_s: float, seed: int) -> AirRun:
    """Run the air, vented at the start.

    Args:
        machine: With its faults, on the day of the run.
        schedule: Set points.
        duration_s: A whole number of hundredths of a second.
        seed: Of the run.

    """
    # All else is at its default, so that machines whose air is the same share a run.
    sensors = Sensors(pressure=machine.sensors.pressure, clock=machine.sensors.clock)
    known = Machine(air=machine.air, regulator=machine.regulator, sensors=sensors)
    return _breathed(known, tuple(schedule), duration_s, seed)


@lru_cache(maxsize=_KEPT)
def _breathed(machine: Machine, schedule: tuple[SetPoint, ...], duration_s: float, seed: int) -> AirRun:
    """Run the air, or return what it did before: a fault of a tendon, of a body or of an IMU leaves it as it is."""
    return _Breathing(machine, schedule, duration_s, seed).run()


class _Breathing:
    """State of one such run."""

    def __init__(self, machine: Machine, schedule: Sequence[SetPoint], duration_s: float, seed: int) -> None:
        self._machine = machine
        self._schedule = schedule
        self._ticks = round(duration_s / PERIOD_S)
        self._law = air_law(machine.air)
        self._state = vented(self._law)
        self._steps = 0
        self._history_pa = np.zeros((round(self._ticks * PERIOD_S / HISTORY_S) + 1, NODES))
        self._history_pa[0] = machine.air.ambient_pa
        self._switching = stream(seed, "switching")
        sensors = machine.sensors.pressure
        self._noise_pa = np.column_stack(
            [coloured(stream(seed, f"pressure {i}"), sensor, PERIOD_S, self._ticks) for i, sensor in enumerate(sensors)]
        )
        self._clock = stream(seed, "moments of pressures")
        self._commands: dict[str, list[tuple[float, float]]] = {}
        self._due: deque[tuple[int, Orders]] = deque()  # in order: every order takes as long
        self._latest = Orders(0.0, (False,) * LINES)

    def run(self) -> AirRun:
        """Take the air through the run."""
        memory, read = Memory(), np.zeros((self._ticks, len(_SENSED)))
        clock = self._machine.sensors.clock
        jitter_s = np.clip(
            clock.sample_jitter_s * np.abs(self._clock.standard_normal(self._ticks)), 0.0, PERIOD_S / 4.0
        )
        taken_s = PERIOD_S * np.arange(self._ticks) + np.round(jitter_s / STEP_S) * STEP_S
        for tick in range(self._ticks):
            self._advance_to(float(taken_s[tick]))
            read[tick] = self._read(tick, float(taken_s[tick]))
            atmosphere_pa = read[: min(tick + 1, _TARE)].mean(axis=0)
            vacuum_pa = (atmosphere_pa - read[tick]).tolist()
            wanted = wanted_pa(self._schedule, float(taken_s[tick]))
            orders, memory = decide(self._machine.regulator, memory, wanted, vacuum_pa[1:], vacuum_pa[0])
            self._order(float(taken_s[tick]) + _DECIDES_S, orders)
        self._advance_to(self._ticks * PERIOD_S)
        time_s = HISTORY_S * np.arange(len(self._history_pa), dtype=np.float64)
        ambient_pa = self._law.scalars[AMBIENT]
        vacuum = np.maximum(ambient_pa - self._history_pa[:, list(_SENSED[1:])], 0.0)
        return AirRun(time_s, self._history_pa, vacuum, {**self._pressures(taken_s, read), **self._command_tracks()})

    def _advance_to(self, time_s: float) -> None:
        """Go on, stopping wherever an order arrives."""
        end = round(time_s / STEP_S)
        while self._steps < end:
            goal = min(end, self._due[0][0]) if self._due else end
            advance_air(self._law, self._state, self._steps, goal - self._steps, _EVERY, self._history_pa)
            self._steps = goal
            while self._due and self._due[0][0] <= goal:
                self._obey(self._due.popleft()[1])

    def _order(self, time_s: float, orders: Orders) -> None:
        """Record what is commanded, and let it arrive."""
        values = {names.PUMP_DUTY.name: orders.duty}
        values |= {
            names.SOLENOIDS[channel].name: float(coil)
            for channel, coil in zip(names.CHANNELS, orders.coils, strict=True)
        }
        for topic, value in values.items():
            kept = self._commands.setdefault(topic, [])
            if not kept or kept[-1][1] != value:
                kept.append((time_s, value))
        arrives_s = time_s + self._machine.sensors.clock.command_delay_s
        self._due.append((max(round(arrives_s / STEP_S), self._steps + 1), orders))

    def _obey(self, orders: Orders) -> None:
        """Let pump and armatures follow."""
        self._state.more[0] = orders.duty
        for i, (new, old) in enumerate(zip(orders.coils, self._latest.coils, strict=True)):
            if new != old:
                line = self._machine.air.lines[i]
                late, sticks = self._switching.standard_normal(), self._switching.random()
                stuck_s = line.stick_s if sticks < line.stick_share else 0.0
                self._state.goal[i] = float(new)
                self._state.wait_s[i] = max(line.dead_s + line.dead_jitter_s * late, 0.0) + stuck_s
        self._latest = orders

    def _read(self, tick: int, time_s: float) -> NDArray[np.float64]:
        """Return what the pressure sensors give now: the past, smoothed by their lag."""
        found = np.zeros(len(_SENSED))
        for i, (node, sensor) in enumerate(zip(_SENSED, self._machine.sensors.pressure, strict=True)):
            place = (time_s - sensor.delay_s) / HISTORY_S
            weights, total = 0.0, 0.0
            for back in range(8):
                at = min(max(int(place) - back, 0), len(self._history_pa) - 1)
                weight = float(np.exp(-back * HISTORY_S / max(sensor.lag_s, 1e-6)))
                weights += weight
                total += weight * float(self._history_pa[at, node])
            raw = sensor.gain * total / weights + sensor.offset + self._noise_pa[tick, i]
            found[i] = round(raw / sensor.step) * sensor.step
        return found

    def _pressures(self, taken_s: NDArray[np.float64], read: NDArray[np.float64]) -> dict[str, Track]:
        clock, draw = self._machine.sensors.clock, self._clock
        stamp_s = taken_s + clock.skew * taken_s + clock.stamp_jitter_s * draw.standard_normal(taken_s.size)
        topics = (names.MANIFOLD_PRESSURE, *(names.PRESSURES[channel] for channel in names.CHANNELS))
        found = {}
        for i, topic in enumerate(topics):
            kept = draw.random(taken_s.size) >= clock.dropped
            kept[0] = True
            log_s = np.maximum.accumulate(
                taken_s + clock.log_s + clock.log_jitter_s * draw.exponential(size=taken_s.size)
            )
            log_s += 1e-9 * np.arange(taken_s.size)
            stamps_s = np.maximum.accumulate(np.maximum(stamp_s, 0.0))
            found[topic.name] = Track(("fluid_pressure_pa",), stamps_s[kept], log_s[kept], read[kept, i : i + 1])
        return found

    def _command_tracks(self) -> dict[str, Track]:
        found = {}
        for topic, changes in self._commands.items():
            table = np.array(changes)
            found[topic] = Track(("data",), table[:, 0], table[:, 0], table[:, 1:])
        return found
