"""The laws that are evaluated every step, compiled together: tendon, pneumatics, IMU filter, and the step itself.

They stand in one module because numba's cache knows only the file that holds a function, not those it calls. Layouts of
the records are here too; `tendon`, `pneumatics` and `sensors` fill them and explain the numbers.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from jammkle_sim.physics.compiled import call_with_two_pointers, compiled

BRANCHES = 4
"""Maxwell branches of a tendon."""
ELEMENTS = 2
"""Elastic-Coulomb elements of a tendon."""
TABLE_POINTS = 1111
"""Points of the static force curve: every 50 um up to just beyond the break extension."""

TENDON_LAW = np.dtype(
    [
        ("static_force_n", np.float64, TABLE_POINTS),
        ("table_step_m", np.float64),
        ("decay", np.float64, BRANCHES),
        ("gain", np.float64, BRANCHES),
        ("friction_stiffness_n_m", np.float64, ELEMENTS),
        ("friction_yield_n_per_pa", np.float64, ELEMENTS),
        ("friction_onset_pa", np.float64),
        ("stiffening_per_pa", np.float64),
        ("grip_n_per_pa", np.float64),
        ("grip_saturation_m", np.float64),
        ("break_extension_m", np.float64),
        ("free_length_m", np.float64),
        ("channel", np.int64),
    ],
)
"""Constants of one tendon, for one time step."""

TENDON_STATE = np.dtype(
    [
        ("branch_n", np.float64, BRANCHES),
        ("slider_m", np.float64, ELEMENTS),
        ("static_n", np.float64),
        ("extension_m", np.float64),
        ("rate_m_s", np.float64),
        ("tension_n", np.float64),
        ("broken", np.float64),
    ],
)
"""Memory and latest output of one tendon."""

VOLUMES = 4
"""Manifold and three channels, in this order."""
VALVES = 3
"""Solenoids, one per channel."""

PNEUMATIC_LAW = np.dtype(
    [
        ("ambient_pa", np.float64),
        ("specific_energy_j_kg", np.float64),
        ("volume_m3", np.float64, VOLUMES),
        ("valve_kg_s_pa", np.float64, VALVES),
        ("leak_kg_s_pa", np.float64, VOLUMES),
        ("critical_ratio", np.float64),
        ("linear_ratio", np.float64),
        ("pump_free_flow_m3_s", np.float64),
        ("pump_ultimate_vacuum_pa", np.float64),
        ("valve_dead_time_s", np.float64, VALVES),
        ("step_s", np.float64),
        ("substeps", np.int64),
    ],
)
"""Constants of the pneumatics."""

PNEUMATIC_STATE = np.dtype(
    [
        ("mass_kg", np.float64, VOLUMES),
        ("pressure_pa", np.float64, VOLUMES),
        ("pumped_kg", np.float64),
        ("admitted_kg", np.float64),
        ("duty", np.float64),
        ("command", np.float64, VALVES),
        ("position", np.float64, VALVES),
        ("waiting_s", np.float64, VALVES),
    ],
)
"""Air in each volume, the ledger of what pump and atmosphere exchanged, the commands, and the valves."""

IMU_AXES = 6
"""Three of specific force, then three of angular velocity."""

IMU_LAW = np.dtype([("smoothing", np.float64), ("noise", np.float64, IMU_AXES), ("limit", np.float64, IMU_AXES)])
"""Share of the way that each pole goes in a step, noise per step, and range, per axis."""

IMU_STATE = np.dtype([("first", np.float64, IMU_AXES), ("second", np.float64, IMU_AXES)])
"""The two poles of the filter; the second is the output."""

LARGEST_SPEED = 1.0e3
"""Joint speed, m/s or rad/s, beyond which a simulation counts as unstable. Assumed: no rig comes near it."""


@compiled
def tendon_tension_n(law: Any, state: Any, extension_m: float, vacuum_pa: float) -> float:
    """Advance one tendon by a time step to a new extension and return its tension, N, never negative.

    Args:
        law: One record of TENDON_LAW.
        state: One record of TENDON_STATE, changed in place.
        extension_m: Length beyond the free length, m; negative when slack.
        vacuum_pa: Pressure below ambient, Pa, 0 or more.

    """
    if extension_m >= law.break_extension_m:
        state.broken = 1.0
    if state.broken > 0.0:
        return 0.0
    stretched_m = max(extension_m, 0.0)
    place = stretched_m / law.table_step_m
    index = min(int(place), TABLE_POINTS - 2)
    below = law.static_force_n[index]
    static_n = below + (law.static_force_n[index + 1] - below) * (place - index)

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

    if extension_m <= 0.0:
        return 0.0
    grip_n = law.grip_n_per_pa * vacuum_pa * min(stretched_m / law.grip_saturation_m, 1.0)
    return max((1.0 + law.stiffening_per_pa * vacuum_pa) * viscoelastic_n + friction_n + grip_n, 0.0)


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
    """Let each solenoid follow its command after the dead time; a command taken back before that has no effect."""
    for i in range(VALVES):
        if state.command[i] == state.position[i]:
            state.waiting_s[i] = 0.0
            continue
        state.waiting_s[i] += law.step_s
        if state.waiting_s[i] >= law.valve_dead_time_s[i]:
            state.position[i] = state.command[i]
            state.waiting_s[i] = 0.0


@compiled
def advance_pneumatics(law: Any, state: Any) -> None:
    """Advance manifold and channels by one time step; every kilogram moved is booked on both sides.

    Args:
        law: One record of PNEUMATIC_LAW.
        state: One record of PNEUMATIC_STATE, changed in place.

    """
    move_valves(law, state)
    ambient = law.ambient_pa
    duration_s = law.step_s / law.substeps
    for _ in range(law.substeps):
        manifold_pa = state.pressure_pa[0]
        vacuum_pa = ambient - manifold_pa
        flow_m3_s = law.pump_free_flow_m3_s * state.duty * (1.0 - vacuum_pa / law.pump_ultimate_vacuum_pa)
        pumped_kg = max(flow_m3_s, 0.0) * manifold_pa / law.specific_energy_j_kg * duration_s
        state.mass_kg[0] -= pumped_kg
        state.pumped_kg += pumped_kg
        for i in range(VOLUMES):
            pressure_pa = state.pressure_pa[i]
            leaked_kg = duration_s * orifice_flow_kg_s(
                ambient, pressure_pa, law.leak_kg_s_pa[i], law.critical_ratio, law.linear_ratio
            )
            state.mass_kg[i] += leaked_kg
            state.admitted_kg += leaked_kg
        for i in range(VALVES):
            energised = state.position[i] > 0.0
            source_pa = manifold_pa if energised else ambient
            moved_kg = duration_s * orifice_flow_kg_s(
                source_pa, state.pressure_pa[i + 1], law.valve_kg_s_pa[i], law.critical_ratio, law.linear_ratio
            )
            state.mass_kg[i + 1] += moved_kg
            if energised:
                state.mass_kg[0] -= moved_kg
            else:
                state.admitted_kg += moved_kg
        for i in range(VOLUMES):
            state.pressure_pa[i] = state.mass_kg[i] * law.specific_energy_j_kg / law.volume_m3[i]


@compiled
def pneumatic_history(law: Any, state: Any, steps: int, pressure_pa: Any) -> None:
    """Advance the pneumatics by `steps` and write the pressures after each, shape (steps, VOLUMES)."""
    for step in range(steps):
        advance_pneumatics(law[0], state[0])
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
        within = min(max(raw[i], -law.limit[i]), law.limit[i])
        state.first[i] += law.smoothing * (within + law.noise[i] * white[i] - state.first[i])
        state.second[i] += law.smoothing * (state.first[i] - state.second[i])


@compiled
def act(
    pneumatic_law: Any, pneumatics: Any, tendon_laws: Any, tendons: Any, length_m: Any, rate_m_s: Any, pull_n: Any
) -> None:
    """Advance pneumatics and tendons by one step, to the lengths given, and write the pull of each tendon.

    Args:
        pneumatic_law: Array of one PNEUMATIC_LAW record.
        pneumatics: Array of one PNEUMATIC_STATE record.
        tendon_laws: TENDON_LAW records, shape (n,).
        tendons: TENDON_STATE records, shape (n,).
        length_m: Shape (n,), m.
        rate_m_s: Shape (n,), m/s.
        pull_n: Shape (n,), N, written.

    """
    air = pneumatics[0]
    advance_pneumatics(pneumatic_law[0], air)
    for i in range(tendons.shape[0]):
        law = tendon_laws[i]
        state = tendons[i]
        vacuum_pa = max(pneumatic_law[0].ambient_pa - air.pressure_pa[law.channel + 1], 0.0)
        state.extension_m = length_m[i] - law.free_length_m
        state.rate_m_s = rate_m_s[i]
        state.tension_n = tendon_tension_n(law, state, state.extension_m, vacuum_pa)
        pull_n[i] = state.tension_n


@compiled
def is_unstable(speed: Any) -> bool:
    """True if any joint speed is beyond LARGEST_SPEED or not a number."""
    for i in range(speed.shape[0]):
        if not abs(speed[i]) < LARGEST_SPEED:
            return True
    return False


@compiled
def advance_ankle(
    addresses: Any,
    pneumatic_law: Any,
    pneumatics: Any,
    tendon_laws: Any,
    tendons: Any,
    imu_law: Any,
    imu: Any,
    length_m: Any,
    rate_m_s: Any,
    pull_n: Any,
    speed: Any,
    raw_imu: Any,
    white: Any,
) -> int:
    """Advance everything by one step per row of `white`, calling MuJoCo from compiled code.

    The laws stand between mj_step1 and mj_step2, so that they see lengths of the same instant.

    Args:
        addresses: Shape (4,), integers: mj_step1, mj_step2, model, data.
        pneumatic_law: Array of one PNEUMATIC_LAW record.
        pneumatics: Array of one PNEUMATIC_STATE record.
        tendon_laws: TENDON_LAW records, shape (n,).
        tendons: TENDON_STATE records, shape (n,).
        imu_law: Array of one IMU_LAW record.
        imu: Array of one IMU_STATE record.
        length_m: MuJoCo's tendon lengths, shape (n,), m.
        rate_m_s: MuJoCo's tendon rates, shape (n,), m/s.
        pull_n: MuJoCo's controls, shape (n,), N.
        speed: MuJoCo's joint speeds, shape (nv,).
        raw_imu: MuJoCo's accelerometer and gyro, shape (6,).
        white: Standard normal numbers, shape (steps, 6).

    Returns:
        Steps taken; fewer than asked if the simulation became unstable.

    """
    for step in range(white.shape[0]):
        if is_unstable(speed):
            return step
        call_with_two_pointers(addresses[0], addresses[2], addresses[3])
        act(pneumatic_law, pneumatics, tendon_laws, tendons, length_m, rate_m_s, pull_n)
        call_with_two_pointers(addresses[1], addresses[2], addresses[3])
        filter_imu(imu_law[0], imu[0], raw_imu, white[step])
    return -1 if is_unstable(speed) else white.shape[0]
