"""The laws that are evaluated every step, compiled together: tendon, pneumatics, IMU filter, and the step itself.

They stand in one module because numba's cache knows only the file that holds a function, not those it calls.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar, cast

import numba
from llvmlite import ir  # type: ignore[import-untyped]  # carries no types
from numba import types
from numba.extending import intrinsic

from jammkle_sim.physics.records import (
    BRANCHES,
    CONTACT_COLUMNS,
    ELEMENTS,
    GUIDED_KG,
    GUIDED_KG_M2,
    IMU_AXES,
    LOAD_CELL_AXES,
    TABLE_POINTS,
    UNKNOWN,
    VALVES,
    VOLUMES,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from jammkle_sim.physics.records import Ankle, Body, Laws, Probe, States


P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function of scalars and arrays at its first call, and keep the result on disk for the next process.

    Numba keeps it beside the source or, where that is read-only, in the user's cache folder. Where neither can be
    written the function is compiled anew in every process. Numba looks only at the age of the file that holds the
    function, so compiled functions that call one another stand in one module.
    """
    try:
        return cast("Callable[P, R]", numba.njit(function, cache=True, error_model="numpy", nogil=True))
    except RuntimeError:  # "no locator available": no folder for the cache
        return cast("Callable[P, R]", numba.njit(function, error_model="numpy", nogil=True))


def _call_with_two_pointers(_context: Any, _function: Any, _first: Any, _second: Any) -> Any:
    """Write the machine code of `call_with_two_pointers`; numba's interface for that."""
    signature = types.void(types.intp, types.intp, types.intp)

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        pointer = ir.IntType(8).as_pointer()
        function_type = ir.FunctionType(ir.VoidType(), [pointer, pointer])
        function = builder.inttoptr(arguments[0], function_type.as_pointer())
        builder.call(function, [builder.inttoptr(argument, pointer) for argument in arguments[1:]])
        return context.get_dummy_value()

    return signature, generate


call_with_two_pointers = cast("Callable[[int, int, int], None]", intrinsic(_call_with_two_pointers))
"""Call the C function `void f(void*, void*)` at an address, from compiled code: address, first and second pointer.

Addresses come as arguments, not as constants, so that the compiled code can be kept for other processes.
"""


SMALLEST_SHARE = 1e-6
"""Share of a time step below which a valve does not begin to move: the rounding of times that are whole steps."""

HEAT_CAPACITY_RATIO = 1.4
"""Heat capacity of air at constant pressure over that at constant volume (ISO 2533)."""

LARGEST_SPEED = 1.0e3
"""Joint speed, m/s or rad/s, beyond which a simulation counts as unstable. Assumed: no rig comes near it."""


@compiled
def tendon_tension_n(law: Any, state: Any, extension_m: float, vacuum_pa: float) -> float:
    """Advance one tendon by a time step to a new extension and return its tension, N, never negative.

    Args:
        law: One record of TENDON_LAW.
        state: One record of TENDON_STATE, changed in place.
        extension_m: Length beyond the free length as drawn, m; negative when slack.
        vacuum_pa: Pressure below ambient, Pa, 0 or more.

    """
    beyond_m = extension_m + law.shorter_m
    if beyond_m >= law.break_extension_m:
        state.broken = 1.0
    if state.broken > 0.0:
        return 0.0
    stretched_m = max(beyond_m, 0.0)
    place = stretched_m / law.table_step_m
    index = min(int(place), TABLE_POINTS - 2)
    below = law.static_force_n[index]
    static_n = below + (law.static_force_n[index + 1] - below) * (place - index)
    if law.softening > 0.0:
        state.travel_m += max(stretched_m - state.stretched_m, 0.0)
        static_n *= 1.0 - law.softening * (1.0 - math.exp(-state.travel_m / law.softening_travel_m))
    state.stretched_m = stretched_m

    viscoelastic_n = static_n
    growth_n = static_n - state.static_n
    state.static_n = static_n
    for i in range(BRANCHES):
        state.branch_n[i] = law.decay[i] * state.branch_n[i] + law.gain[i] * growth_n
        viscoelastic_n += state.branch_n[i]

    friction_n = 0.0
    beyond_onset_pa = max(vacuum_pa - law.friction_onset_pa, 0.0)
    for i in range(ELEMENTS):
        yield_n = law.friction_yield_n_per_pa[i] * beyond_onset_pa
        stiffness = law.friction_stiffness_n_m[i]
        element_n = min(max(stiffness * (stretched_m - state.slider_m[i]), -yield_n), yield_n)
        state.slider_m[i] = stretched_m - element_n / stiffness
        friction_n += element_n

    if beyond_m <= 0.0:
        return 0.0
    grip_n = law.grip_n_per_pa * vacuum_pa * min(stretched_m / law.grip_saturation_m, 1.0)
    stiffened = 1.0 + law.stiffening_per_pa * vacuum_pa
    tension_n: float = max(stiffened * viscoelastic_n + friction_n + grip_n, 0.0)
    return tension_n


@compiled
def tendon_history(law: Any, state: Any, extension_m: Any, vacuum_pa: Any, tension_n: Any) -> None:
    """Take one tendon through a history of extension and vacuum, one entry per time step.

    Args:
        law: Array of one TENDON_LAW record.
        state: Array of one TENDON_STATE record, changed in place.
        extension_m: Shape (n,), m.
        vacuum_pa: Shape (n,), Pa.
        tension_n: Shape (n,), N, written.

    """
    for i in range(extension_m.shape[0]):
        tension_n[i] = tendon_tension_n(law[0], state[0], extension_m[i], vacuum_pa[i])


@compiled
def orifice_flow_kg_s(
    from_pa: float, to_pa: float, conductance: float, critical_ratio: float, linear_ratio: float
) -> float:
    """Mass flow through an orifice by ISO 6358-1, kg/s; negative when `to_pa` is the higher pressure.

    Choked below the critical ratio, elliptic above it, and linear beyond `linear_ratio`, where the ellipse has an
    infinite slope that no explicit step could follow.

    Args:
        from_pa: Absolute pressure on one side, Pa.
        to_pa: Absolute pressure on the other side, Pa.
        conductance: Sonic conductance times density at the reference state, kg/(s Pa).
        critical_ratio: `b` of ISO 6358.
        linear_ratio: Pressure ratio at which the linear part begins, below 1.

    """
    upstream_pa = max(from_pa, to_pa)
    ratio = min(from_pa, to_pa) / upstream_pa
    elliptic = max(min(ratio, linear_ratio) - critical_ratio, 0.0) / (1.0 - critical_ratio)
    share = math.sqrt(1.0 - elliptic * elliptic)
    if ratio > linear_ratio:
        share *= (1.0 - ratio) / (1.0 - linear_ratio)
    flow = conductance * upstream_pa * share
    return flow if from_pa >= to_pa else -flow


@compiled
def move_valves(law: Any, state: Any) -> None:
    """Let each solenoid follow its command after the dead time; a command taken back before that has no effect.

    A dead time that ends between two steps leaves a valve between its two positions for one step, for the share of it.
    """
    for i in range(VALVES):
        if 0.0 < state.position[i] < 1.0:
            state.position[i] = state.target[i]
            state.waiting_s[i] = 0.0
        if state.command[i] == state.position[i]:
            state.waiting_s[i] = 0.0
            continue
        state.waiting_s[i] += law.step_s
        if state.waiting_s[i] >= law.valve_dead_time_s[i]:
            state.position[i] = state.command[i]
            state.waiting_s[i] = 0.0
            continue
        share = 1.0 - (law.valve_dead_time_s[i] - state.waiting_s[i]) / law.step_s
        if share > SMALLEST_SHARE:
            state.target[i] = state.command[i]
            state.position[i] += share * (state.command[i] - state.position[i])


@compiled
def advance_pneumatics(law: Any, state: Any) -> None:
    """Advance valves, manifold and channels by one time step.

    Args:
        law: One record of PNEUMATIC_LAW.
        state: One record of PNEUMATIC_STATE, changed in place.

    """
    move_valves(law, state)
    exchange_air(law, state)


@compiled
def exchange_air(law: Any, state: Any) -> None:
    """Advance manifold and channels by one time step; every kilogram moved is booked on both sides.

    The first law for open volumes of an ideal gas whose walls have the temperature of the room: what comes in brings
    its enthalpy along, what stays expands, and the walls take away the difference in the volume's time constant. With
    0 it is isothermal, with infinity adiabatic (Carneiro and de Almeida 2006, Proc. IMechE Part I 220:301).

    Args:
        law: One record of PNEUMATIC_LAW.
        state: One record of PNEUMATIC_STATE, changed in place. A valve's position between 0 and 1 is the share of the
            step for which it draws from the manifold. Where it has changed, air of the atmosphere comes past it into
            the manifold, as all ports are connected while the armature travels.

    """
    duration_s = law.step_s / law.substeps
    for i in range(VALVES):
        if state.settled[i] != UNKNOWN:
            state.crossing_s[i] += abs(state.position[i] - state.settled[i]) * law.valve_crossover_s
        state.settled[i] = state.position[i]
    for _ in range(law.substeps):
        for i in range(VOLUMES):
            state.heat_kg[i] = state.mass_kg[i] * (1.0 + state.warmer[i])
        _pump(law, state, duration_s)
        for i in range(VOLUMES):
            _admit(law, state, i, law.leak_kg_s_pa[i], duration_s)
        for i in range(VALVES):
            _pass_valve(law, state, i, duration_s)
        for i in range(VOLUMES):
            _settle(law, state, i, duration_s)


@compiled
def _pump(law: Any, state: Any, duration_s: float) -> None:
    """Draw from the manifold."""
    manifold_pa, warmth = state.pressure_pa[0], 1.0 + state.warmer[0]
    vacuum_pa = law.ambient_pa - manifold_pa
    # Where the air is thin no pump gets below nothing.
    ultimate_pa = min(law.pump_ultimate_vacuum_pa, law.ambient_pa)
    flow_m3_s = law.pump_free_flow_m3_s * state.duty * (1.0 - vacuum_pa / ultimate_pa)
    pumped_kg = max(flow_m3_s, 0.0) * manifold_pa / (law.specific_energy_j_kg * warmth) * duration_s
    if law.pump_filling != 0.0:
        pumped_kg *= (law.ambient_pa / manifold_pa) ** law.pump_filling
    state.mass_kg[0] -= pumped_kg
    state.heat_kg[0] -= HEAT_CAPACITY_RATIO * warmth * pumped_kg
    state.pumped_kg += pumped_kg


@compiled
def _admit(law: Any, state: Any, volume: int, conductance_kg_s_pa: float, duration_s: float) -> None:
    """Let air of the atmosphere into a volume, or out of it where its pressure is higher."""
    moved_kg = duration_s * orifice_flow_kg_s(
        law.ambient_pa, state.pressure_pa[volume], conductance_kg_s_pa, law.critical_ratio, law.linear_ratio
    )
    warmth = 1.0 if moved_kg > 0.0 else 1.0 + state.warmer[volume]
    # An orifice lets less through the warmer the air is upstream (ISO 6358-1).
    moved_kg /= math.sqrt(warmth)
    state.mass_kg[volume] += moved_kg
    state.heat_kg[volume] += HEAT_CAPACITY_RATIO * warmth * moved_kg
    state.admitted_kg += moved_kg


@compiled
def _pass_valve(law: Any, state: Any, valve: int, duration_s: float) -> None:
    """Let air between a channel, the manifold and the atmosphere, as the valve stands or moves."""
    channel, drawing, conductance_kg_s_pa = valve + 1, state.position[valve], law.valve_kg_s_pa[valve]
    if drawing > 0.0:
        moved_kg = (drawing * duration_s) * orifice_flow_kg_s(
            state.pressure_pa[0], state.pressure_pa[channel], conductance_kg_s_pa, law.critical_ratio, law.linear_ratio
        )
        warmth = 1.0 + (state.warmer[0] if moved_kg > 0.0 else state.warmer[channel])
        moved_kg /= math.sqrt(warmth)
        carried_kg = HEAT_CAPACITY_RATIO * warmth * moved_kg
        state.mass_kg[channel] += moved_kg
        state.mass_kg[0] -= moved_kg
        state.heat_kg[channel] += carried_kg
        state.heat_kg[0] -= carried_kg
    if drawing < 1.0:
        _admit(law, state, channel, conductance_kg_s_pa, (1.0 - drawing) * duration_s)
    crossing_s = min(state.crossing_s[valve], duration_s)
    if crossing_s > 0.0:
        state.crossing_s[valve] -= crossing_s
        # It passes the valve's two seats alone: a tube that is pinched behind them changes nothing.
        _admit(law, state, 0, law.crossover_kg_s_pa[valve], crossing_s)


@compiled
def _settle(law: Any, state: Any, volume: int, duration_s: float) -> None:
    """Let the walls of a volume take heat away, and find its temperature and pressure."""
    mass_kg, time_s = state.mass_kg[volume], law.thermal_time_s[volume]
    at_ambient_kg = law.ambient_pa * law.volume_m3[volume] / law.specific_energy_j_kg
    # Implicit: with a time constant of 0 the air has the temperature of the walls.
    kept = time_s / (time_s + duration_s * at_ambient_kg / mass_kg)
    state.warmer[volume] = kept * (state.heat_kg[volume] / mass_kg - 1.0)
    specific_energy_j_kg = law.specific_energy_j_kg * (1.0 + state.warmer[volume])
    state.pressure_pa[volume] = mass_kg * specific_energy_j_kg / law.volume_m3[volume]


@compiled
def air_history(law: Any, state: Any, duty: Any, drawing: Any, pressure_pa: Any) -> None:
    """Advance the air by one time step per row, with what pump and valves do in each.

    Args:
        law: Array of one PNEUMATIC_LAW record; its dead time is not used.
        state: Array of one PNEUMATIC_STATE record, changed in place.
        duty: Pump duty, shape (n,), 0 to 1.
        drawing: Share of the step for which each valve draws from the manifold, shape (n, VALVES), 0 to 1.
        pressure_pa: Shape (n, VOLUMES), Pa, written: after each step.

    """
    for step in range(duty.shape[0]):
        state[0].duty = duty[step]
        for i in range(VALVES):
            state[0].position[i] = drawing[step, i]
        exchange_air(law[0], state[0])
        for i in range(VOLUMES):
            pressure_pa[step, i] = state[0].pressure_pa[i]


@compiled
def filter_imu(law: Any, state: Any, raw: Any, white: Any) -> None:
    """Take one raw sample, within its range, through noise and two equal poles.

    Args:
        law: One record of IMU_LAW.
        state: One record of IMU_STATE, changed in place.
        raw: Shape (6,): specific force, m/s^2, and angular velocity, rad/s.
        white: Shape (6,): standard normal numbers.

    """
    for i in range(IMU_AXES):
        axis, first = i % 3, i - i % 3
        turned = law.turn[axis, 0] * raw[first]
        turned += law.turn[axis, 1] * raw[first + 1]
        turned += law.turn[axis, 2] * raw[first + 2]
        within = min(max(turned + law.offset[i], -law.limit[i]), law.limit[i])
        state.first[i] += law.smoothing * (within + law.noise[i] * white[i] - state.first[i])
        state.second[i] += law.smoothing * (state.first[i] - state.second[i])


@compiled
def imu_history(law: Any, state: Any, raw: Any, filtered: Any) -> None:
    """Take raw samples of the IMU, one row per time step, through range and poles, without noise.

    Args:
        law: Array of one IMU_LAW record.
        state: Array of one IMU_STATE record, changed in place.
        raw: Shape (n, 6), as for `filter_imu`.
        filtered: Shape (n, 6), written.

    """
    still = raw[0] * 0.0
    for step in range(raw.shape[0]):
        filter_imu(law[0], state[0], raw[step], still)
        for i in range(IMU_AXES):
            filtered[step, i] = state[0].second[i]


@compiled
def act(laws: Laws, states: States, body: Body) -> None:
    """Advance pneumatics and tendons by one step, to the lengths that MuJoCo has now, and pull."""
    air = states.pneumatics[0]
    advance_pneumatics(laws.pneumatics[0], air)
    pull(laws, states, body, air.pressure_pa)


@compiled
def rub_joint(law: Any, state: Any, body: Body) -> None:
    """Advance the dry friction of the ankle's joint by a time step, and let it act.

    An elastic-Coulomb element of a ball in its socket: it bends as the joint turns, about all axes together, until its
    torque reaches what slides; that falls with the speed from breaking away to sliding (Stribeck). Below it nothing
    drifts (Dupont et al., 2002). Its torque is that of the end of the step, so that it holds instead of chattering.

    Args:
        law: One record of JOINT_LAW.
        state: One record of JOINT_STATE, changed in place.
        body: MuJoCo's side.

    """
    speed_squared, bent_squared = 0.0, 0.0
    for i in range(body.joint_index.shape[0]):
        speed = body.speed[body.joint_index[i]]
        state.deflection_rad[i] += law.step_s * speed
        speed_squared += speed * speed
        bent_squared += state.deflection_rad[i] * state.deflection_rad[i]
    furthest_rad = law.presliding_rad * (1.0 + law.breakaway * math.exp(-speed_squared / law.stribeck_rad_s**2))
    bent_rad = math.sqrt(bent_squared)
    kept = furthest_rad / bent_rad if bent_rad > furthest_rad else 1.0
    stiffness_n_m = law.friction_n_m / law.presliding_rad
    for i in range(body.joint_index.shape[0]):
        state.deflection_rad[i] *= kept
        body.applied_n_m[body.joint_index[i]] = -stiffness_n_m * state.deflection_rad[i]


@compiled
def pull(laws: Laws, states: States, body: Body, pressure_pa: Any) -> None:
    """Advance tendons and joint by one step, to what MuJoCo has now, at pressures of shape (VOLUMES,), Pa."""
    for i in range(states.tendons.shape[0]):
        law = laws.tendons[i]
        state = states.tendons[i]
        vacuum_pa = max(laws.pneumatics[0].ambient_pa - pressure_pa[law.channel + 1], 0.0)
        state.extension_m = body.length_m[i] - law.free_length_m
        state.rate_m_s = body.rate_m_s[i]
        state.tension_n = tendon_tension_n(law, state, state.extension_m, vacuum_pa)
        body.pull_n[i] = state.tension_n
    if laws.joint[0].friction_n_m > 0.0:
        rub_joint(laws.joint[0], states.joint[0], body)


@compiled
def guide(body: Body) -> None:
    """Put a guided carriage where its next row has it, and let it be moved as that says; the last row stays.

    The carriage weighs so much that nothing it carries moves it: what moves it is in proportion to its mass.

    Args:
        body: MuJoCo's side; its counter goes on.

    """
    rows = body.guide.shape[0]
    if rows == 0:
        return
    row = body.guide[min(body.guide_at[0], rows - 1)]
    body.guide_at[0] += 1
    for i in range(7):
        body.position[i] = row[i]
    for i in range(3):
        body.speed[i] = row[7 + i]
        body.speed[3 + i] = row[10 + i]
        body.applied_n_m[i] = GUIDED_KG * row[13 + i]
        body.applied_n_m[3 + i] = GUIDED_KG_M2 * row[16 + i]


@compiled
def is_stable(speed: Any) -> bool:
    """True if every joint speed is a number and below LARGEST_SPEED."""
    stable = True
    for i in range(speed.shape[0]):
        stable = stable and abs(speed[i]) < LARGEST_SPEED
    return stable


@compiled
def watch_foot(contacts: Any, truth: Any) -> None:
    """Take note of how hard a foot stands on the ground, and how it slides there.

    Its speed is the mean of its contacts' tangential speeds, each counted by its share of the normal force: that at
    which Coulomb friction takes energy away. A foot that rolls over its rounded corners does not slide.

    Args:
        contacts: As `records.Ankle` has them.
        truth: One record of FOOT_TRUTH, changed in place.

    """
    normal_n, power_w = 0.0, 0.0
    for slot in range(contacts.shape[0] // CONTACT_COLUMNS):
        at = slot * CONTACT_COLUMNS
        force_n = abs(contacts[at])
        normal_n += force_n
        power_w += force_n * math.hypot(contacts[at + 4], contacts[at + 5])
    truth.normal_force_n = normal_n
    truth.sliding_speed_m_s = 0.0
    if normal_n > truth.bearing_n:
        truth.sliding_speed_m_s = power_w / normal_n
        truth.sliding_distance_m += truth.sliding_speed_m_s * truth.step_s


@compiled
def advance(ankles: tuple[Ankle, ...], white: Any, begin: int, end: int) -> int:
    """Advance a machine and all its ankles by one step per row of `white`, calling MuJoCo from compiled code.

    The laws stand between mj_step1 and mj_step2, so that they see lengths of the same instant.

    Args:
        ankles: Constants, memory, which is changed in place, and MuJoCo's side of each.
        white: Standard normal numbers for the IMUs, shape (ankles, rows, 6).
        begin: First row that is used.
        end: Row after the last one.

    Returns:
        Steps taken; fewer than asked if the simulation became unstable.

    """
    step_1, step_2, model, data = ankles[0].body.addresses
    speed = ankles[0].body.speed
    for step in range(begin, end):
        if not is_stable(speed):
            return step - begin
        for ankle in ankles:
            guide(ankle.body)
        call_with_two_pointers(step_1, model, data)
        for ankle in ankles:
            act(ankle.laws, ankle.states, ankle.body)
        call_with_two_pointers(step_2, model, data)
        for i in range(len(ankles)):
            ankle = ankles[i]
            filter_imu(ankle.laws.imu[0], ankle.states.imu[0], ankle.body.raw_imu, white[i, step])
            watch_foot(ankle.contacts, ankle.truth[0])
    taken: int = end - begin if is_stable(speed) else end - begin - 1
    return taken


@compiled
def record_row(states: States, probe: Probe, row: Any) -> None:
    """Write what is to be recorded now.

    Args:
        states: Memory of the laws.
        probe: MuJoCo's side.
        row: Shape (records.row_width(joints, tendons),), written.

    """
    at = 0
    for i in range(IMU_AXES):
        row[at] = states.imu[0].second[i]
        at += 1
    missing = LOAD_CELL_AXES - probe.load_cell_n.shape[0]
    for i in range(LOAD_CELL_AXES):
        row[at] = probe.load_cell_n[i - missing] if i >= missing else 0.0
        at += 1
    for i in range(probe.position_index.shape[0]):
        row[at] = probe.position[probe.position_index[i]]
        at += 1
    for i in range(probe.speed_index.shape[0]):
        row[at] = probe.speed[probe.speed_index[i]]
        at += 1
    for i in range(states.tendons.shape[0]):
        row[at] = states.tendons[i].extension_m
        row[at + 1] = states.tendons[i].rate_m_s
        row[at + 2] = states.tendons[i].tension_n
        row[at + 3] = states.tendons[i].broken
        at += 4


@compiled
def advance_and_record(ankles: tuple[Ankle, ...], probes: tuple[Probe, ...], white: Any, rows: Any) -> int:
    """Do what `advance` does, and record a row of every ankle after every so many steps.

    Args:
        ankles: As for `advance`.
        probes: What is recorded of each.
        white: Standard normal numbers for the IMUs, shape (ankles, steps, 6); a whole number of steps per row.
        rows: Shape (ankles, n, width), written; the width is at least records.row_width(joints, tendons) of each.

    Returns:
        Steps taken; fewer than asked if the simulation became unstable.

    """
    every = white.shape[1] // rows.shape[1]
    for row in range(rows.shape[1]):
        taken = advance(ankles, white, row * every, (row + 1) * every)
        if taken != every:
            before: int = row * every
            return before + taken
        for i in range(len(ankles)):
            record_row(ankles[i].states, probes[i], rows[i, row])
    steps: int = rows.shape[1] * every
    return steps


@compiled
def body_history(laws: Laws, states: States, body: Body, probe: Probe, pressure_pa: Any, rows: Any) -> int:
    """Advance tendons and bodies by one step per row, at pressures that are given, and record every step.

    Args:
        laws: Constants.
        states: Memory, changed in place; the pneumatics are not touched.
        body: MuJoCo's side, what the laws need.
        probe: MuJoCo's side, what is recorded.
        pressure_pa: Absolute pressures in each step, shape (n, VOLUMES), Pa.
        rows: Shape (n, records.row_width(joints, tendons)), written; the IMU's columns are raw.

    Returns:
        Steps taken; fewer than asked if the simulation became unstable.

    """
    step_1, step_2, model, data = body.addresses
    for step in range(rows.shape[0]):
        if not is_stable(body.speed):
            return step
        guide(body)
        call_with_two_pointers(step_1, model, data)
        pull(laws, states, body, pressure_pa[step])
        call_with_two_pointers(step_2, model, data)
        for i in range(IMU_AXES):
            states.imu[0].second[i] = body.raw_imu[i]
        record_row(states, probe, rows[step])
    return int(rows.shape[0])


@compiled
def driven_history(laws: Laws, states: States, body: Body, probe: Probe, tension_n: Any, rows: Any) -> int:
    """Do what `body_history` does, with tensions that are given, shape (n, tendons), N."""
    step_1, step_2, model, data = body.addresses
    for step in range(rows.shape[0]):
        if not is_stable(body.speed):
            return step
        call_with_two_pointers(step_1, model, data)
        for i in range(tension_n.shape[1]):
            states.tendons[i].extension_m = body.length_m[i] - laws.tendons[i].free_length_m
            states.tendons[i].tension_n = tension_n[step, i]
            body.pull_n[i] = tension_n[step, i]
        if laws.joint[0].friction_n_m > 0.0:
            rub_joint(laws.joint[0], states.joint[0], body)
        call_with_two_pointers(step_2, model, data)
        for i in range(IMU_AXES):
            states.imu[0].second[i] = body.raw_imu[i]
        record_row(states, probe, rows[step])
    return int(rows.shape[0])
