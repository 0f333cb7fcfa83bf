"""The pressure rig: the ankle hangs free while its channels are jammed and vented, again and again."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from jammkle_common import names
from jammkle_common.constants import HELD_VACUUM_PA, STANDARD_GRAVITY_M_S2
from studies.blind.reality.air import HISTORY_S, breathe, together
from studies.blind.reality.bodies import compiled
from studies.blind.reality.sensors import BadPlanError, RealRun, Truth, encoder_track, settings, tendon_track
from studies.blind.reality.tendon import TIME, bristle_n, tendon_law, tendon_state, tendon_tension_n

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from studies.blind.reality.machine import Ankle, Machine
    from studies.blind.reality.sensors import Option, Plan

JOINTS = names.ANKLE_JOINTS
"""Roll, pitch, yaw."""
_SUBSTEPS = 2
"""Steps per row of the vacuum's history."""
_GIVE_RAD = 0.002
"""Angle over which the dry friction of the joint builds up. Assumed."""
_SETTLING = 8
"""How often the foot is let swing and its tendons relax before a run."""
_SETTLING_ROWS = 400


_COLUMNS = len(JOINTS) + 2 * len(names.TENDONS)
MASS, VISCOUS, DRY, ANCHOR = range(4)
"""Places in `Foot.body`."""


class Foot(NamedTuple):
    """Constants."""

    inertia_kg_m2: NDArray[np.float64]
    """About roll, pitch, yaw."""
    centre_m: NDArray[np.float64]
    body: NDArray[np.float64]
    """Mass, kg; viscous and dry friction of the joint, N m s and N m; height of the tendons' upper ends, m."""
    sites_m: NDArray[np.float64]
    """Lower ends of the tendons, shape (tendons, 3)."""
    free_m: NDArray[np.float64]
    """Their free lengths."""
    channel: NDArray[np.int64]
    """Which channel empties each."""


class Swing(NamedTuple):
    """Memory: roll, pitch, yaw each."""

    angle_rad: NDArray[np.float64]
    rate_rad_s: NDArray[np.float64]
    dry_n_m: NDArray[np.float64]
    """Moment of the bristles in the joint."""


@dataclass(frozen=True)
class Hanging:
    """How the foot moved, a row per row of the vacuum's history."""

    angle_rad: NDArray[np.float64]
    """Roll, pitch, yaw, shape (n, 3)."""
    extension_m: NDArray[np.float64]
    """Beyond the free length as drawn, shape (n, tendons)."""
    tension_n: NDArray[np.float64]
    """Shape (n, tendons)."""


def hang(machine: Machine, vacuum_pa: NDArray[np.float64], row_s: float) -> Hanging:
    """Let the foot hang, from rest, while the vacuum comes and goes.

    Args:
        machine: With its faults, on the day of the run.
        vacuum_pa: Of each channel, shape (n, channels).
        row_s: Between two rows of it.

    """
    step_s = row_s / _SUBSTEPS
    foot, swing = _foot(machine.ankle), Swing(np.zeros(3), np.zeros(3), np.zeros(3))
    laws = tuple(tendon_law(make, step_s) for make in machine.tendons)
    states = tuple(tendon_state(law, _pretension_m(machine.ankle, i)) for i, law in enumerate(laws))
    still, rows = np.zeros((_SETTLING_ROWS, vacuum_pa.shape[1])), np.zeros((_SETTLING_ROWS, _COLUMNS))
    for _ in range(_SETTLING):
        _swing(laws, states, foot, swing, still, step_s, rows)
        swing.rate_rad_s[:] = 0.0
        for state in states:
            state.branch_pa[:] = 0.0
            state.stretched[:] = 0.0
    for state in states:
        state.more[TIME] = 0.0  # warming begins with the run
    rows = np.zeros((len(vacuum_pa), _COLUMNS))
    _swing(laws, states, foot, swing, vacuum_pa, step_s, rows)
    return Hanging(rows[:, :3], rows[:, 3:7], rows[:, 7:])


def sites(ankle: Ankle) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where tendons meet the foot, shape (tendons, 3), m, and their free lengths, shape (tendons,), m."""
    back, spread = -ankle.achilles_arm_m, ankle.achilles_spread_m
    front, side = ankle.peroneal_forward_m, ankle.peroneal_spread_m
    places = np.array([(front, side, 0.0), (front, -side, 0.0), (back, spread, 0.0), (back, -spread, 0.0)])
    free_m = np.array([ankle.tendon_length_m - _pretension_m(ankle, i) for i in range(len(names.TENDONS))])
    return places, free_m


def _pretension_m(ankle: Ankle, tendon: int) -> float:
    """Extension at the neutral pose: that of the peroneal tendons balances the Achilles pair by its lever."""
    peroneal_m = ankle.achilles_pretension_m * ankle.achilles_arm_m / ankle.peroneal_forward_m
    return ankle.achilles_pretension_m if names.TENDONS[tendon].startswith(names.ACHILLES) else peroneal_m


def _foot(ankle: Ankle) -> Foot:
    body = np.array([
        ankle.foot_kg, ankle.joint_viscous_n_m_s, ankle.joint_dry_n_m, ankle.tendon_length_m
    ])  # fmt: skip
    channel = np.array([names.CHANNELS.index(each) for each in names.CHANNELS for _ in names.TENDONS_OF_CHANNEL[each]])
    inertia, centre = np.array(ankle.foot_inertia_kg_m2), np.array(ankle.foot_centre_m)
    return Foot(inertia, centre, body, *sites(ankle), channel)


@compiled
def turned(angle: Any, point: Any, found: Any) -> None:
    """Write a point of the foot in the frame of the leg: pitch, then roll, then yaw, each about the turned axis."""
    cr, sr = math.cos(angle[0]), math.sin(angle[0])
    cp, sp = math.cos(angle[1]), math.sin(angle[1])
    cy, sy = math.cos(angle[2]), math.sin(angle[2])
    x, y, z = cy * point[0] - sy * point[1], sy * point[0] + cy * point[1], point[2]
    y, z = cr * y - sr * z, sr * y + cr * z
    found[0], found[1], found[2] = cp * x + sp * z, y, cp * z - sp * x


@compiled
def _moment(angle: Any, at: Any, force: Any, torque: Any) -> None:
    """Add what a force at a point, both in the frame of the leg, does about roll, pitch and yaw."""
    mx = at[1] * force[2] - at[2] * force[1]
    my = at[2] * force[0] - at[0] * force[2]
    mz = at[0] * force[1] - at[1] * force[0]
    cr, sr = math.cos(angle[0]), math.sin(angle[0])
    cp, sp = math.cos(angle[1]), math.sin(angle[1])
    torque[0] += cp * mx - sp * mz
    torque[1] += my
    torque[2] += sp * cr * mx - sr * my + cp * cr * mz


@compiled
def _swing(laws: Any, states: Any, foot: Any, swing: Any, vacuum_pa: Any, step_s: float, rows: Any) -> None:
    """Move the foot by a row of the vacuum at a time: speeds first, then angles (symplectic Euler).

    Args:
        laws: TendonLaw of each tendon.
        states: TendonState of each, changed in place.
        foot: Constants.
        swing: Memory, changed in place.
        vacuum_pa: Shape (rows, channels).
        step_s: A row of the vacuum takes _SUBSTEPS of them.
        rows: Shape (rows, 11), written: angles, rad, extensions, m, tensions, N.

    """
    at, force, torque = np.zeros(3), np.zeros(3), np.zeros(3)
    angle, rate, dry, body = swing.angle_rad, swing.rate_rad_s, swing.dry_n_m, foot.body
    tendons = foot.sites_m.shape[0]
    for row in range(vacuum_pa.shape[0]):
        for _ in range(_SUBSTEPS):
            torque[:] = 0.0
            for i in range(tendons):
                turned(angle, foot.sites_m[i], at)
                force[0], force[1] = foot.sites_m[i, 0] - at[0], foot.sites_m[i, 1] - at[1]
                force[2] = body[ANCHOR] - at[2]
                length_m = math.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2)
                extension_m = length_m - foot.free_m[i]
                tension_n = tendon_tension_n(laws[i], states[i], extension_m, vacuum_pa[row, foot.channel[i]])
                rows[row, 3 + i] = extension_m
                rows[row, 3 + tendons + i] = tension_n
                force *= tension_n / length_m
                _moment(angle, at, force, torque)
            turned(angle, foot.centre_m, at)
            force[0], force[1], force[2] = 0.0, 0.0, -body[MASS] * STANDARD_GRAVITY_M_S2
            _moment(angle, at, force, torque)
            for axis in range(3):
                inertia = foot.inertia_kg_m2[axis]
                dry[axis], _ = bristle_n(dry[axis], rate[axis] * step_s, body[DRY], body[DRY] / _GIVE_RAD)
                slowed = 1.0 + step_s * body[VISCOUS] / inertia
                rate[axis] = (rate[axis] + step_s * (torque[axis] - dry[axis]) / inertia) / slowed
                angle[axis] += step_s * rate[axis]
        for axis in range(3):
            rows[row, axis] = angle[axis]


_ALL = "all"
DEFAULTS: dict[str, Option] = {
    "channel": _ALL,
    "vacuum_pa": HELD_VACUUM_PA,
    "cycles": 3,
    "jam_time_s": 1.0,
    "vent_time_s": 0.5,
}
FIXED: dict[str, Option] = {
    "pump_free_flow_l_min": 6.0,
    "pump_ultimate_vacuum_pa": 80e3,
    "valve_dead_time_s": 0.010,
    "leak_dm3_s_bar": 1e-4,
}
_START_S = 0.2
_HEIGHT_M = 0.3


def pressure(plan: Plan, machine: Machine, seed: int) -> RealRun:
    """Jam and vent.

    Args:
        plan: Settings of the rig.
        machine: With its faults, on the day of the run.
        seed: Of the run.

    Raises:
        BadPlanError: a setting that there is not.

    """
    chosen = settings(plan, DEFAULTS, FIXED)
    if chosen["channel"] not in (_ALL, *names.CHANNELS):
        msg = f"'channel' is {chosen['channel']}; it must be {_ALL} or one of {', '.join(names.CHANNELS)}"
        raise BadPlanError(msg)
    channels = names.CHANNELS if chosen["channel"] == _ALL else (str(chosen["channel"]),)
    jam_s, vacuum_pa = float(chosen["jam_time_s"]), float(chosen["vacuum_pa"])
    period_s = jam_s + float(chosen["vent_time_s"])
    starts_s = [_START_S + cycle * period_s for cycle in range(int(chosen["cycles"]))]
    schedule = [
        point
        for start_s in starts_s
        for point in (*together(start_s, channels, vacuum_pa), *together(start_s + jam_s, channels, 0.0))
    ]
    duration_s = round((_START_S + len(starts_s) * period_s) * 100.0) / 100.0
    air = breathe(machine, schedule, duration_s, seed)
    motion = hang(machine, air.vacuum_pa, HISTORY_S)

    carriage_m = np.full((len(air.time_s), 1), _HEIGHT_M)
    joints = Truth(air.time_s, np.column_stack([motion.angle_rad, carriage_m]))
    encoders = (*(machine.sensors.angle,) * len(JOINTS), machine.sensors.slide)
    topics = {
        **air.topics,
        names.JOINT_STATES.name: encoder_track(
            machine, seed, (*JOINTS, names.CARRIAGE_JOINT), joints, duration_s, encoders
        ),
        names.TENDON_STATES.name: tendon_track(
            machine,
            seed,
            names.TENDONS,
            Truth(air.time_s, motion.extension_m),
            Truth(air.time_s, motion.tension_n),
            Truth(air.time_s, np.zeros_like(motion.tension_n)),
            duration_s,
        ),
    }
    return RealRun(plan, topics)
