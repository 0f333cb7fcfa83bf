"""Layouts of what the compiled laws read and write: one record of constants and one of memory per part.

`tendon`, `pneumatics` and `sensors` fill the records and explain the numbers; `kernels` holds the laws.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

BRANCHES = 5
"""Maxwell branches of a tendon."""
ELEMENTS = 4
"""Elastic-Coulomb elements of a tendon: those of `early_slip`, and the two of its friction."""
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
        ("softening", np.float64),
        ("softening_travel_m", np.float64),
        ("shorter_m", np.float64),
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
        ("stretched_m", np.float64),
        ("travel_m", np.float64),
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
        ("pump_filling", np.float64),
        ("valve_dead_time_s", np.float64, VALVES),
        ("crossover_kg_s_pa", np.float64, VALVES),
        ("valve_crossover_s", np.float64),
        ("thermal_time_s", np.float64, VOLUMES),
        ("step_s", np.float64),
        ("substeps", np.int64),
    ],
)
"""Constants of the pneumatics."""

UNKNOWN = -1.0
"""Where a valve stood a step before, of a state that does not say."""

PNEUMATIC_STATE = np.dtype(
    [
        ("mass_kg", np.float64, VOLUMES),
        ("pressure_pa", np.float64, VOLUMES),
        ("warmer", np.float64, VOLUMES),
        ("heat_kg", np.float64, VOLUMES),
        ("pumped_kg", np.float64),
        ("admitted_kg", np.float64),
        ("duty", np.float64),
        ("command", np.float64, VALVES),
        ("position", np.float64, VALVES),
        ("waiting_s", np.float64, VALVES),
        ("target", np.float64, VALVES),
        ("settled", np.float64, VALVES),
        ("crossing_s", np.float64, VALVES),
    ],
)
"""Air in each volume, its pressure, by which share of the room's temperature it is warmer than the room, and its mass
times its temperature over the room's; what pump and atmosphere have exchanged; the commands; and the valves, with
where they stood a step before and how long they are still to let air past them into the manifold."""

IMU_AXES = 6
"""Three of specific force, then three of angular velocity."""

IMU_LAW = np.dtype(
    [
        ("smoothing", np.float64),
        ("noise", np.float64, IMU_AXES),
        ("limit", np.float64, IMU_AXES),
        ("turn", np.float64, (3, 3)),
        ("offset", np.float64, IMU_AXES),
    ],
)
"""Share of the way that each pole goes in a step; noise per step and range, per axis; how the sensor is turned against
its mount, as a matrix from the frame of the mount to its own; and its offsets."""

IMU_STATE = np.dtype([("first", np.float64, IMU_AXES), ("second", np.float64, IMU_AXES)])
"""The two poles of the filter; the second is the output."""


JOINT_AXES = 3
"""Axes of the ankle's joint."""

JOINT_LAW = np.dtype(
    [
        ("friction_n_m", np.float64),
        ("breakaway", np.float64),
        ("stribeck_rad_s", np.float64),
        ("presliding_rad", np.float64),
        ("step_s", np.float64),
    ],
)
"""Constants of the dry friction in the ankle's joint; none where its torque is 0."""

JOINT_STATE = np.dtype([("deflection_rad", np.float64, JOINT_AXES)])
"""How far the joint's surfaces are bent before they slide, per axis."""


class Laws(NamedTuple):
    """Constants of everything that is advanced together."""

    pneumatics: NDArray[Any]
    """Shape (1,) of PNEUMATIC_LAW."""
    tendons: NDArray[Any]
    """Shape (n,) of TENDON_LAW."""
    imu: NDArray[Any]
    """Shape (1,) of IMU_LAW."""
    joint: NDArray[Any]
    """Shape (1,) of JOINT_LAW."""


class States(NamedTuple):
    """Memory of everything that is advanced together."""

    pneumatics: NDArray[Any]
    """Shape (1,) of PNEUMATIC_STATE."""
    tendons: NDArray[Any]
    """Shape (n,) of TENDON_STATE."""
    imu: NDArray[Any]
    """Shape (1,) of IMU_STATE."""
    joint: NDArray[Any]
    """Shape (1,) of JOINT_STATE."""


GUIDE_COLUMNS = 19
"""Of each row of a guide: position of the carriage, m, its orientation as a quaternion (w, x, y, z), velocity, m/s, and
angular velocity in its own frame, rad/s; then specific force, m/s^2, and angular acceleration in its own frame,
rad/s^2."""
GUIDED_KG, GUIDED_KG_M2 = 1e5, 1e4
"""Mass and inertia of a guided carriage. Chosen: 100 N of an ankle accelerate it by a thirteenth of an IMU's noise, and
its equations still have ten digits left."""


class Body(NamedTuple):
    """Where MuJoCo keeps what the laws read and write: views of its own arrays."""

    addresses: NDArray[np.intp]
    """mj_step1, mj_step2, model, data."""
    length_m: NDArray[np.float64]
    """Tendon lengths, shape (n,)."""
    rate_m_s: NDArray[np.float64]
    """Tendon rates, shape (n,)."""
    pull_n: NDArray[np.float64]
    """Controls of the tendons' actuators, shape (n,)."""
    position: NDArray[np.float64]
    """Joint positions."""
    speed: NDArray[np.float64]
    """Joint speeds."""
    applied_n_m: NDArray[np.float64]
    """Forces and torques applied from outside, per joint speed."""
    joint_index: NDArray[np.intp]
    """Which of the speeds are those of the ankle's joint, shape (JOINT_AXES,); empty without one."""
    raw_imu: NDArray[np.float64]
    """Accelerometer and gyro, shape (6,)."""
    guide: NDArray[np.float64]
    """How a guided carriage moves, a row per time step, shape (n, GUIDE_COLUMNS); of shape (0, GUIDE_COLUMNS) where it
    moves freely. Its joints are then the first of the model: three slides and a ball."""
    guide_at: NDArray[np.int64]
    """Which row comes next, shape (1,)."""


CONTACT_SLOTS = 12
"""Contacts of one foot that are looked at: three for each of its four corners, as on a ridge of rough ground."""
CONTACT_COLUMNS = 6
"""Of each contact, in its own frame: force, N, and speed of the foot against the ground, m/s; each along the normal,
then along both tangents."""

FOOT_TRUTH = np.dtype(
    [
        ("bearing_n", np.float64),
        ("step_s", np.float64),
        ("normal_force_n", np.float64),
        ("sliding_speed_m_s", np.float64),
        ("sliding_distance_m", np.float64),
    ],
)
"""What a foot truly does on the ground: from which force on it counts as standing, the time step, then the latest
normal force and speed, and the way that it has slid since the start."""


class Probe(NamedTuple):
    """Where MuJoCo keeps what a recording holds beside the states: views of its own arrays."""

    position: NDArray[np.float64]
    """Joint positions of the whole model."""
    speed: NDArray[np.float64]
    """Joint speeds of the whole model."""
    position_index: NDArray[np.intp]
    """Which of the positions are recorded, shape (joints,)."""
    speed_index: NDArray[np.intp]
    """Which of the speeds are recorded, shape (joints,)."""
    load_cell_n: NDArray[np.float64]
    """Force in the load cell: shape (3,), (1,) for a cell that measures along z alone, (0,) without one."""


class Ankle(NamedTuple):
    """One ankle of a machine, with all that is advanced with it."""

    laws: Laws
    states: States
    body: Body
    contacts: NDArray[np.float64]
    """Contacts of the foot with the ground, shape (CONTACT_SLOTS * CONTACT_COLUMNS,), zeros where there are fewer; of
    shape (0,) where nobody looks at them."""
    truth: NDArray[Any]
    """Shape (1,) of FOOT_TRUTH."""


LOAD_CELL_AXES = 3
TENDON_COLUMNS = 4
"""Extension, rate, tension, broken."""


def row_width(joints: int, tendons: int) -> int:
    """Columns of one recorded row: IMU, load cell, joint positions, joint speeds, tendons one after the other."""
    return IMU_AXES + LOAD_CELL_AXES + 2 * joints + TENDON_COLUMNS * tendons
