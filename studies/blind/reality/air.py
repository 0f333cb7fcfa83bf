"""The air: pump, manifold, and per channel a solenoid, a tube and the tendons at its end.

Seven volumes of gas with mass and heat of their own: they cool when they expand and take heat from their walls. Seats
of valves and holes are nozzles, choked or not; a tube loses pressure by laminar and turbulent friction. Heun's method.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from jammkle_common.names import CHANNELS
from studies.blind.reality.compiled import compiled
from studies.blind.reality.machine import GAS_J_KG_K, HEAT_RATIO

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from studies.blind.reality.machine import Air

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


def fill_again(law: AirLaw, before: AirLaw, state: AirState) -> None:
    """Keep the pressures where volumes change, as when a fault sets in: a longer hose comes with its air."""
    share = law.nodes[VOLUME] / before.nodes[VOLUME]
    state.more[2] += float((state.mass_kg * (share - 1.0)).sum())
    state.more[4] += float((state.heat_j * (share - 1.0)).sum())
    state.mass_kg[:] *= share
    state.heat_j[:] *= share


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
