"""What every ankle of a simulation measured, topic by topic: how it is collected, and figures taken from it."""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_sim.physics import records

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping

    from numpy.typing import NDArray

    from jammkle_sim.rigs.rig import Wiring
    from jammkle_sim.rigs.simulation import Simulation

IMU_PERIOD_S = 0.001
"""Time between two rows of a rig's IMU, s."""
STATE_ROWS = 2
"""Rows of its IMU per row of joint_states, tendon_states and load cell: 500 Hz."""
CONTROL_ROWS = 10
"""Rows of its IMU per row of the pressures, and per command: 100 Hz."""

GROUND_CLEARANCE = "ground clearance"
"""Where an evaluation finds how far the watched parts are off the ground, m, one column each, a row per row of the load
cell. No topic: nothing on a real rig measures it, and it is in no bag."""

IMU_COLUMNS = (
    *(f"linear_acceleration_{axis}_m_s2" for axis in "xyz"),
    *(f"angular_velocity_{axis}_rad_s" for axis in "xyz"),
)
_LOAD_CELL_COLUMNS = ("force_x_n", "force_y_n", "force_z_n")
TENDON_COLUMNS = ("extension_m", "extension_rate_m_s", "tension_n", "broken")
TRUTH_COLUMNS = ("stands", "normal_force_n", "sliding_speed_m_s", "sliding_distance_m")
"""Of the true contact: fields of its message."""
BASE_COLUMNS = (
    *(f"position_{axis}_m" for axis in "xyz"),
    *(f"orientation_{axis}" for axis in "wxyz"),
    *(f"linear_{axis}_m_s" for axis in "xyz"),
    *(f"angular_{axis}_rad_s" for axis in "xyz"),
)
"""Of the odometry: numbers of a BaseSample."""

_SMOOTHED_ROWS = 5
"""Rows of 2 ms that a reported force is the mean of: 10 ms, as a test machine's filter. Assumed."""
SMOOTHED_S = 0.010
"""The same as a time, s."""


@dataclass(frozen=True)
class Series:
    """Samples of one topic."""

    columns: tuple[str, ...]
    """Name of each column: a field of the message with its unit, such as `force_z_n`, after the name of the tendon or
    joint it belongs to and a dot, where there are several (`achilles_left.tension_n`)."""
    time_s: NDArray[np.float64]
    """Since the start of the machine, shape (n,)."""
    values: NDArray[np.float64]
    """Shape (n, columns)."""

    def column(self, name: str) -> NDArray[np.float64]:
        """Return one column, shape (n,).

        Raises:
            KeyError: there is no such column.

        """
        if name not in self.columns:
            raise KeyError(name)
        return self.values[:, self.columns.index(name)]


@dataclass
class _Kept:
    """What was collected of one ankle."""

    rows: list[NDArray[np.float64]] = dataclasses.field(default_factory=list)
    samples: defaultdict[str, list[tuple[float, ...]]] = dataclasses.field(default_factory=lambda: defaultdict(list))
    """Of topics that are looked at between rows: time, then values."""


class Recorder:
    """Collects rows, readings and commands of every ankle, and sorts them by topic at the end."""

    def __init__(self, simulation: Simulation, row_period_s: float) -> None:
        """Start with nothing.

        Args:
            simulation: What is recorded.
            row_period_s: Time between two rows of the IMU, s: a whole number of time steps.

        """
        self._simulation = simulation
        self._row_period_s = row_period_s
        self._row_steps = round(row_period_s / simulation.timestep_s)
        self._kept = {name: _Kept() for name in simulation.ankles}

    def advance(self, rows: int) -> None:
        """Advance by rows of the IMU and keep them."""
        for name, part in self._simulation.record(rows, self._row_steps).items():
            self._kept[name].rows.append(part)

    def note_pressures(self) -> None:
        """Keep manifold and channels as measured now."""
        for name, ankle in self._simulation.ankles.items():
            pressures_pa = (ankle.manifold_pressure_pa(), *ankle.channel_pressures_pa().values())
            for topic, pressure_pa in zip(
                (names.MANIFOLD_PRESSURE, *names.PRESSURES.values()), pressures_pa, strict=True
            ):
                self._note(name, topic, (pressure_pa,))

    def note_commands(self, ankle: str, pump_duty: float, energised: Iterable[bool], time_s: float) -> None:
        """Keep the commands of an ankle that differ from those before, with the time at which they were given."""
        values = {names.PUMP_DUTY: pump_duty}
        values |= {names.SOLENOIDS[channel]: float(on) for channel, on in zip(names.CHANNELS, energised, strict=True)}
        for topic, value in values.items():
            kept = self._kept[ankle].samples[topic.name]
            if not kept or kept[-1][1] != value:
                kept.append((time_s, value))

    def note_load_cell(self, watched: tuple[str, ...] = ()) -> None:
        """Keep what the load cells give now, and how far the watched geoms are off the ground."""
        clearances_m = tuple(self._simulation.ground_clearance_m(geom) for geom in watched)
        for name, ankle in self._simulation.ankles.items():
            self._note(name, names.LOAD_CELL, ankle.load_cell_force_n())
            self._kept[name].samples[GROUND_CLEARANCE].append((self._simulation.elapsed_s, *clearances_m))

    def note_contacts(self) -> None:
        """Keep what the feet truly do on the ground."""
        for name, ankle in self._simulation.ankles.items():
            foot = ankle.foot()
            values = (float(foot.stands), foot.normal_force_n, foot.sliding_speed_m_s, foot.sliding_distance_m)
            self._note(name, names.TRUE_CONTACT, values)

    def note_base_and_plans(self) -> None:
        """Keep where the base is, and what the gait plans, where there is one."""
        base = self._simulation.base()
        values = (*base.position_m, *base.rotation, *base.linear_m_s, *base.angular_rad_s)
        for name, ankle in self._simulation.ankles.items():
            self._note(name, names.ODOMETRY, values)
            plan = ankle.plan()
            if plan is not None:
                self._note(name, names.PLANNED_CONTACT, (float(plan.bears),))
                if plan.phase is not None:
                    self._note(name, names.GAIT_PHASE, (plan.phase,))

    def topics(
        self, ankle: str, wanted: Collection[str], *, state_rows: int = 1, wiring: Wiring | None = None
    ) -> dict[str, Series]:
        """Return everything of an ankle by topic, stamped as the readings are: late, by a clock of their own.

        Args:
            ankle: Its name.
            wanted: Topics, of the IMU, joints, tendons and load cell, that there is a sensor for.
            state_rows: Rows of the IMU per row of joints and tendons.
            wiring: What lies between sensors and topics; None: nothing.

        """
        kept = self._kept[ankle]
        rows = np.concatenate(kept.rows)
        time_s: NDArray[np.float64] = np.arange(1, len(rows) + 1, dtype=np.float64) * np.float64(self._row_period_s)
        states, state_time_s = rows[state_rows - 1 :: state_rows], time_s[state_rows - 1 :: state_rows]
        joints = tuple(self._simulation.ankles[ankle].joint_positions())
        tendons = tuple(tendon.name for tendon in self._simulation.ankles[ankle].tendons())
        first_joint = records.IMU_AXES + records.LOAD_CELL_AXES
        first_tendon = first_joint + 2 * len(joints)
        found = {
            names.IMU.name: Series(IMU_COLUMNS, time_s, rows[:, : records.IMU_AXES]),
            names.JOINT_STATES.name: Series(
                tuple(f"{joint}.{what}" for what in ("position", "velocity") for joint in joints),
                state_time_s,
                states[:, first_joint:first_tendon],
            ),
            names.TENDON_STATES.name: Series(
                tuple(f"{tendon}.{what}" for tendon in tendons for what in TENDON_COLUMNS),
                state_time_s,
                states[:, first_tendon:],
            ),
        }
        columns = {
            names.LOAD_CELL.name: _LOAD_CELL_COLUMNS,
            names.TRUE_CONTACT.name: TRUTH_COLUMNS,
            names.ODOMETRY.name: BASE_COLUMNS,
            **{topic.name: ("fluid_pressure_pa",) for topic in (names.MANIFOLD_PRESSURE, *names.PRESSURES.values())},
        }
        for topic, samples in kept.samples.items():
            table = np.array(samples)
            if topic != GROUND_CLEARANCE:
                found[topic] = Series(columns.get(topic, ("data",)), table[:, 0], table[:, 1:])
        sensed = {names.IMU.name, names.JOINT_STATES.name, names.TENDON_STATES.name, names.LOAD_CELL.name}
        found = {topic: series for topic, series in found.items() if topic not in sensed or topic in wanted}
        return found if wiring is None else {topic: _stamped(topic, found[topic], wiring) for topic in found}

    def clearance(self, ankle: str, watched: tuple[str, ...]) -> Series:
        """Return how far the watched geoms were off the ground, m."""
        table = np.array(self._kept[ankle].samples[GROUND_CLEARANCE])
        return Series(watched, table[:, 0], table[:, 1:])

    def _note(self, ankle: str, topic: names.Topic, values: tuple[float, ...]) -> None:
        self._kept[ankle].samples[topic.name].append((self._simulation.elapsed_s, *values))


def _stamped(topic: str, series: Series, wiring: Wiring) -> Series:
    delays_s: Mapping[str, float] = {
        names.IMU.name: wiring.imu_delay_s,
        names.LOAD_CELL.name: wiring.load_cell_delay_s,
        names.JOINT_STATES.name: wiring.joint_delay_s,
        names.TENDON_STATES.name: wiring.joint_delay_s,
        **{each.name: wiring.pressure_delay_s for each in (names.MANIFOLD_PRESSURE, *names.PRESSURES.values())},
    }
    if topic not in delays_s or (delays_s[topic] == 0.0 and wiring.clock_skew == 0.0):
        return series
    return dataclasses.replace(series, time_s=(series.time_s + delays_s[topic]) * (1.0 + wiring.clock_skew))


def smoothed(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the moving mean of a load cell over 10 ms, centred, same shape; the ends are held."""
    half = _SMOOTHED_ROWS // 2
    padded = np.pad(values, half, mode="edge")
    return np.convolve(padded, np.full(_SMOOTHED_ROWS, 1.0 / _SMOOTHED_ROWS), mode="valid")


def work_j(position_m: NDArray[np.float64], force_n: NDArray[np.float64]) -> float:
    """Return the integral of force over position, J, by trapezoids; both of shape (n,)."""
    return float((np.diff(position_m) * (force_n[1:] + force_n[:-1])).sum() / 2.0)


def peak_deceleration_m_s2(imu: Series, release_s: float) -> float:
    """Return the largest upward acceleration, net of gravity, that the IMU gave after the release, m/s^2."""
    upward = imu.column("linear_acceleration_z_m_s2")[imu.time_s > release_s]
    return float(upward.max()) - STANDARD_GRAVITY_M_S2


def rebound_m(height_m: NDArray[np.float64]) -> float:
    """Return how far a height rises again after its lowest point, m."""
    lowest = int(np.argmin(height_m))
    return float(height_m[lowest:].max() - height_m[lowest])
