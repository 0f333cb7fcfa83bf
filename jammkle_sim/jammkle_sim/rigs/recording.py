"""What a run measured, topic by topic, and how it is collected while the rig runs."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_sim.physics import records

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jammkle_sim.rigs.rig import Rig
    from jammkle_sim.rigs.simulation import Simulation
    from jammkle_sim.rigs.vacuum import Commands

IMU_PERIOD_S = 0.001
"""Time between two rows of the IMU, s."""
STATE_ROWS = 2
"""Rows of the IMU per row of joint_states, tendon_states and load cell: 500 Hz."""
CONTROL_ROWS = 10
"""Rows of the IMU per row of the pressures, and per command: 100 Hz."""

GROUND_CLEARANCE = "ground clearance"
"""Where an evaluation finds how far the watched parts are off the ground, m, one column each, a row per row of the load
cell. No topic: nothing on a real rig measures it, and it is in no bag."""

IMU_COLUMNS = (
    "linear_acceleration_x_m_s2",
    "linear_acceleration_y_m_s2",
    "linear_acceleration_z_m_s2",
    "angular_velocity_x_rad_s",
    "angular_velocity_y_rad_s",
    "angular_velocity_z_rad_s",
)
_LOAD_CELL_COLUMNS = ("force_x_n", "force_y_n", "force_z_n")
TENDON_COLUMNS = ("extension_m", "extension_rate_m_s", "tension_n", "broken")


@dataclass(frozen=True)
class Series:
    """Samples of one topic."""

    columns: tuple[str, ...]
    """Name of each column: a field of the message with its unit, such as `force_z_n`, after the name of the tendon or
    joint it belongs to and a dot, where there are several (`achilles_left.tension_n`)."""
    time_s: NDArray[np.float64]
    """Since the start of the rig, shape (n,)."""
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


class Recorder:
    """Collects rows and commands of one run, and sorts them by topic at the end."""

    def __init__(self, rig: Rig, simulation: Simulation, watched: tuple[str, ...]) -> None:
        """Start with nothing.

        Args:
            rig: What is recorded.
            simulation: Where it runs.
            watched: Geoms whose clearance from the ground is kept.

        """
        self._rig = rig
        self._watched = watched
        self._clearances_m: list[tuple[float, ...]] = []
        self._simulation = simulation
        self._rows: list[NDArray[np.float64]] = []
        self._load_cell_n: list[tuple[float, float, float]] = []
        self._pressures_pa: list[tuple[float, ...]] = []
        self._pressure_times_s: list[float] = []
        self._changes: dict[str, list[tuple[float, float]]] = {}

    def note_pressures(self, pressures_pa: tuple[float, ...]) -> None:
        """Keep manifold and channels as measured now."""
        self._pressures_pa.append(pressures_pa)
        self._pressure_times_s.append(self._simulation.rig_time_s)

    def note_commands(self, commands: Commands) -> None:
        """Keep the commands that differ from those before."""
        values = {names.PUMP_DUTY.name: commands.pump_duty}
        for channel, energised in zip(names.CHANNELS, commands.energised, strict=True):
            values[names.SOLENOIDS[channel].name] = float(energised)
        for topic, value in values.items():
            kept = self._changes.setdefault(topic, [])
            if not kept or kept[-1][1] != value:
                kept.append((self._simulation.rig_time_s, value))

    def record_rows(self, rows: int, steps_per_row: int) -> None:
        """Advance by rows of the IMU and keep them."""
        self._rows.append(self._simulation.record(rows, steps_per_row))

    def note_load_cell(self) -> None:
        """Keep what the load cell gives now, and how far the watched geoms are off the ground."""
        self._load_cell_n.append(self._simulation.load_cell_force_n())
        self._clearances_m.append(tuple(self._simulation.ground_clearance_m(geom) for geom in self._watched))

    def clearance(self) -> Series:
        """Return how far the watched geoms were off the ground, m."""
        time_s = STATE_ROWS * IMU_PERIOD_S * np.arange(1, len(self._clearances_m) + 1, dtype=np.float64)
        return Series(self._watched, time_s, np.array(self._clearances_m))

    def topics(self, wanted: tuple[str, ...]) -> dict[str, Series]:
        """Return everything by topic."""
        rows = np.concatenate(self._rows)
        time_s: NDArray[np.float64] = np.arange(1, len(rows) + 1, dtype=np.float64) * np.float64(IMU_PERIOD_S)
        states, state_time_s = rows[STATE_ROWS - 1 :: STATE_ROWS], time_s[STATE_ROWS - 1 :: STATE_ROWS]
        joints = tuple(self._simulation.joint_positions())
        first_joint = records.IMU_AXES + records.LOAD_CELL_AXES
        first_tendon = first_joint + 2 * len(joints)
        found = {
            names.IMU.name: Series(IMU_COLUMNS, time_s, rows[:, : records.IMU_AXES]),
            names.LOAD_CELL.name: Series(_LOAD_CELL_COLUMNS, state_time_s, np.array(self._load_cell_n)),
            names.JOINT_STATES.name: Series(
                tuple(f"{joint}.{what}" for what in ("position", "velocity") for joint in joints),
                state_time_s,
                states[:, first_joint:first_tendon],
            ),
            names.TENDON_STATES.name: Series(
                tuple(f"{tendon}.{what}" for tendon in self._rig.tendon_names for what in TENDON_COLUMNS),
                state_time_s,
                states[:, first_tendon:],
            ),
        }
        found = {topic: series for topic, series in found.items() if topic in wanted}
        wiring = self._rig.wiring
        delays_s = {
            names.IMU.name: wiring.imu_delay_s,
            names.LOAD_CELL.name: wiring.load_cell_delay_s,
            names.JOINT_STATES.name: wiring.joint_delay_s,
            names.TENDON_STATES.name: wiring.joint_delay_s,
        }
        found = {topic: self._stamped(series, delays_s[topic]) for topic, series in found.items()}
        pressures_pa, pressure_time_s = np.array(self._pressures_pa), np.array(self._pressure_times_s)
        sources = (names.MANIFOLD_PRESSURE, *names.PRESSURES.values())
        for i, topic in enumerate(sources):
            series = Series(("fluid_pressure_pa",), pressure_time_s, pressures_pa[:, i : i + 1])
            found[topic.name] = self._stamped(series, wiring.pressure_delay_s)
        for name, changes in self._changes.items():
            table = np.array(changes)
            found[name] = Series(("data",), table[:, 0], table[:, 1:])
        return found

    def _stamped(self, series: Series, delay_s: float) -> Series:
        """Return readings as they are stamped: late, by a clock of their own."""
        skew = self._rig.wiring.clock_skew
        if delay_s == 0.0 and skew == 0.0:
            return series
        return dataclasses.replace(series, time_s=(series.time_s + delay_s) * (1.0 + skew))
