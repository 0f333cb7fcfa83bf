"""Run a robot without the graph, as fast as it can, and keep what each of its ankles measured, topic by topic."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common import names
from jammkle_sim.rigs.recording import (
    IMU_COLUMNS,
    TENDON_COLUMNS,
    Series,
)
from jammkle_sim.rigs.run import RigCancelledError, RigRun
from jammkle_sim.robots.urdf import robot_urdf

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from jammkle_sim.rigs.base import BaseSample
    from jammkle_sim.robots.ankle_view import AnkleSample, AnkleView
    from jammkle_sim.robots.gait import FootPlan
    from jammkle_sim.robots.simulation import RobotSimulation

PRESSURE_RATE_HZ = 100
"""Rate of every pressure and of what the gait plans, Hz, as on the graph."""
TRUTH_COLUMNS = ("stands", "normal_force_n", "sliding_speed_m_s", "sliding_distance_m")
"""Of the true contact: fields of its message."""
BASE_COLUMNS = (
    *(f"position_{axis}_m" for axis in "xyz"),
    *(f"orientation_{axis}" for axis in "wxyz"),
    *(f"linear_{axis}_m_s" for axis in "xyz"),
    *(f"angular_{axis}_rad_s" for axis in "xyz"),
)
"""Of the odometry: numbers of a BaseSample."""
_LOOKS_PER_S = 10


class AnkleRecorder:
    """Rows of one ankle."""

    def __init__(self, view: AnkleView) -> None:
        """Start with nothing."""
        self._view = view
        self._time_s: list[float] = []
        self._pressure_time_s: list[float] = []
        self._rows: dict[str, list[list[float]]] = {
            topic.name: [] for topic in (names.IMU, names.JOINT_STATES, names.TENDON_STATES, names.TRUE_CONTACT)
        }
        self._pressures_pa: list[list[float]] = []
        self._bases: list[list[float]] = []
        self._plans: dict[str, list[tuple[float, float]]] = {}
        self._changes: dict[str, list[tuple[float, float]]] = {}
        self._joints: tuple[str, ...] = ()
        self._tendons: tuple[str, ...] = ()

    def note(self, time_s: float, sample: AnkleSample, base: BaseSample, *, with_pressures: bool) -> None:
        """Keep a sample, and what pump and solenoids are told, where that is new."""
        self._time_s.append(time_s)
        self._joints = tuple(sample.positions)
        self._tendons = tuple(tendon.name for tendon in sample.tendons)
        rows = self._rows
        rows[names.IMU.name].append([*sample.imu.specific_force_m_s2, *sample.imu.angular_velocity_rad_s])
        rows[names.JOINT_STATES.name].append([*sample.positions.values(), *sample.velocities.values()])
        rows[names.TENDON_STATES.name].append(
            [
                value
                for tendon in sample.tendons
                for value in (tendon.extension_m, tendon.extension_rate_m_s, tendon.tension_n, float(tendon.broken))
            ]
        )
        foot = sample.foot
        rows[names.TRUE_CONTACT.name].append(
            [float(foot.stands), foot.normal_force_n, foot.sliding_speed_m_s, foot.sliding_distance_m]
        )
        if with_pressures:
            self._pressure_time_s.append(time_s)
            self._pressures_pa.append([sample.manifold_pressure_pa, *sample.channel_pressures_pa.values()])
            self._bases.append([*base.position_m, *base.rotation, *base.linear_m_s, *base.angular_rad_s])
            self._note_plan(time_s, sample.plan)
        told = {names.PUMP_DUTY.name: self._view.pump_duty}
        told |= {
            names.SOLENOIDS[channel].name: float(energised)
            for channel, energised in zip(names.CHANNELS, self._view.energised, strict=True)
        }
        for topic, value in told.items():
            kept = self._changes.setdefault(topic, [])
            if not kept or kept[-1][1] != value:
                kept.append((time_s, value))

    def _note_plan(self, time_s: float, plan: FootPlan | None) -> None:
        if plan is None:
            return
        self._plans.setdefault(names.PLANNED_CONTACT.name, []).append((time_s, float(plan.bears)))
        if plan.phase is not None:
            self._plans.setdefault(names.GAIT_PHASE.name, []).append((time_s, plan.phase))

    def run(self, robot: str, options: Any, description: dict[str, object], urdf: str) -> RigRun:
        """Return what was kept, with the figures that it makes."""
        columns = {
            names.IMU.name: IMU_COLUMNS,
            names.JOINT_STATES.name: tuple(
                f"{joint}.{what}" for what in ("position", "velocity") for joint in self._joints
            ),
            names.TENDON_STATES.name: tuple(f"{name}.{what}" for name in self._tendons for what in TENDON_COLUMNS),
            names.TRUE_CONTACT.name: TRUTH_COLUMNS,
        }
        time_s = np.array(self._time_s)
        topics = {name: Series(columns[name], time_s, np.array(rows)) for name, rows in self._rows.items()}
        pressures_pa, pressure_time_s = np.array(self._pressures_pa), np.array(self._pressure_time_s)
        for i, topic in enumerate((names.MANIFOLD_PRESSURE, *names.PRESSURES.values())):
            topics[topic.name] = Series(("fluid_pressure_pa",), pressure_time_s, pressures_pa[:, i : i + 1])
        topics[names.ODOMETRY.name] = Series(BASE_COLUMNS, pressure_time_s, np.array(self._bases))
        for name, values in {**self._changes, **self._plans}.items():
            table = np.array(values)
            topics[name] = Series(("data",), table[:, 0], table[:, 1:])
        broken = tuple(tendon.name for tendon in self._view.tendons() if tendon.broken)
        return RigRun(robot, options, topics, description, _figures(topics), broken, (), urdf)


def record(
    simulation: RobotSimulation,
    duration_s: float,
    rate_hz: int,
    on_progress: Callable[[float], None],
    cancelled: Callable[[], bool],
    namespace: str = "/",
) -> dict[str, RigRun]:
    """Go on for a time, and return what every ankle measured, by its name.

    Args:
        simulation: The robot, with whatever its ankles were commanded.
        duration_s: How long, simulated, s.
        rate_hz: Rate of IMU, joints, tendons and the truth; a multiple of 100 that divides the step rate.
        on_progress: Called with the share done, 0 to 1.
        cancelled: Asked as often; true ends the run.
        namespace: Normalised ROS namespace of the robot, for the frames of its description.

    Raises:
        ValueError: the rate does not fit.
        RigCancelledError: it was cancelled.
        UnstableSimulationError: the simulation blew up.

    """
    if rate_hz % PRESSURE_RATE_HZ:
        msg = f"a rate of {rate_hz} Hz does not fit the pressures' {PRESSURE_RATE_HZ} Hz; it must be a multiple"
        raise ValueError(msg)
    recorders = {name: AnkleRecorder(view) for name, view in simulation.ankles.items()}
    for index, sample in enumerate(simulation.samples(duration_s, rate_hz), start=1):
        with_pressures = index % (rate_hz // PRESSURE_RATE_HZ) == 0
        for name, recorder in recorders.items():
            recorder.note(sample.time_s, sample.ankles[name], sample.base, with_pressures=with_pressures)
        if index % (rate_hz // _LOOKS_PER_S) == 0:
            on_progress(sample.time_s / duration_s)
            if cancelled():
                msg = f"robot '{simulation.robot.name}' was cancelled after {sample.time_s:g} s of {duration_s:g} s"
                raise RigCancelledError(msg)
    robot, description, urdf = simulation.robot, simulation.description(), robot_urdf(simulation.robot, namespace)
    return {name: recorder.run(robot.name, robot.options, description, urdf) for name, recorder in recorders.items()}


def _figures(topics: dict[str, Series]) -> dict[str, float]:
    truth = topics[names.TRUE_CONTACT.name]
    force_m_s2 = np.linalg.norm(topics[names.IMU.name].values[:, :3], axis=1)
    return {
        "peak_specific_force_m_s2": float(force_m_s2.max()),
        "peak_normal_force_n": float(truth.column("normal_force_n").max()),
        "standing_share": float(truth.column("stands").mean()),
        "touch_downs": float(_rises(truth.column("stands"))),
        "sliding_distance_m": float(truth.column("sliding_distance_m")[-1]),
        "peak_sliding_speed_m_s": float(truth.column("sliding_speed_m_s").max()),
    }


def _rises(values: Sequence[float] | Any) -> int:
    return int((np.diff(np.asarray(values)) > 0.0).sum())
