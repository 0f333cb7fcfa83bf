"""A rig in simulated time: commands in, physics forward, sensors out. The sim node and headless runs use only this."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_graph.names import ANKLE_JOINTS, CARRIAGE_JOINT, CHANNELS, TENDONS
from jammkle_sim.physics import kernels
from jammkle_sim.physics.engine import address_of_function, mujoco
from jammkle_sim.physics.pneumatics import pneumatic_law, vented_state
from jammkle_sim.physics.sensors import Noise, SensorParameters, imu_law

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from jammkle_sim.physics.pneumatics import PneumaticParameters

ACCELEROMETER, GYRO, LOAD_CELL = "accelerometer", "gyro", "load_cell"
"""Names that a rig's model gives its sensors."""


class UnstableSimulationError(RuntimeError):
    """The simulation blew up. The message names what was simulated and when."""


@dataclass(frozen=True)
class ImuSample:
    """What the IMU gives now, in its own frame."""

    specific_force_m_s2: tuple[float, float, float]
    """Acceleration less gravity: +9.81 along z at rest."""
    angular_velocity_rad_s: tuple[float, float, float]


@dataclass(frozen=True)
class TendonSample:
    """One tendon, without noise."""

    name: str
    extension_m: float
    """Beyond the free length; negative when slack."""
    extension_rate_m_s: float
    tension_n: float
    broken: bool


@dataclass(frozen=True)
class Event:
    """Something that the rig does at a step after each start."""

    step: int
    act: Callable[[Any], None]
    """Takes the mujoco.MjData."""


@dataclass(frozen=True)
class Rig:
    """What a simulation needs to know of a rig."""

    name: str
    model: Any
    """The mujoco.MjModel, with an ankle, a joint `carriage`, and the three sensors."""
    tendon_laws: NDArray[Any]
    """TENDON_LAW records, in the order of TENDONS."""
    pneumatics: PneumaticParameters
    sensors: SensorParameters
    events: tuple[Event, ...]
    """By rising step."""
    description: dict[str, object]


class Simulation:
    """A rig, its tendons, its air and its sensors, advanced together."""

    def __init__(self, rig: Rig) -> None:
        """Start the rig: vented, pump off, at the pose of its model.

        Args:
            rig: What is simulated.

        """
        self._rig = rig
        self._model = rig.model
        self._model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        self.timestep_s = float(self._model.opt.timestep)
        """Time step, s."""
        self._data = mujoco.MjData(self._model)
        self._pneumatic_law = pneumatic_law(rig.pneumatics, self.timestep_s)
        self._vented = vented_state(self._pneumatic_law)
        self._pneumatics = self._vented.copy()
        self._tendons = np.zeros(len(TENDONS), dtype=kernels.TENDON_STATE)
        self._imu_law = imu_law(rig.sensors, self.timestep_s)
        self._imu = np.zeros(1, dtype=kernels.IMU_STATE)
        self._noise = Noise(rig.sensors)
        raw = self._data.sensordata
        start = int(self._model.sensor(ACCELEROMETER).adr[0])
        self._raw_imu = raw[start : start + kernels.IMU_AXES]
        self._load_cell = self._data.sensor(LOAD_CELL).data
        self._joints = {name: self._data.joint(name) for name in (*ANKLE_JOINTS, CARRIAGE_JOINT)}
        self._addresses = np.array(
            [
                address_of_function("mj_step1"),
                address_of_function("mj_step2"),
                self._model._address,  # noqa: SLF001  # the bindings' own way to hand a model to C
                self._data._address,  # noqa: SLF001  # as above
            ],
            dtype=np.intp,
        )
        self._total_steps = 0
        self._rig_steps = 0
        self._stand()

    @property
    def time_s(self) -> float:
        """Simulated time since construction, s: a whole number of time steps, never set back."""
        return self._total_steps * self.timestep_s

    def set_pump_duty(self, duty: float) -> None:
        """Set the pump's duty, 0 to 1.

        Raises:
            ValueError: out of range or not a number.

        """
        if not 0.0 <= duty <= 1.0:
            msg = f"pump duty is {duty}; it must be 0 to 1"
            raise ValueError(msg)
        self._pneumatics["duty"] = duty

    def set_solenoid(self, channel: str, energised: bool) -> None:  # noqa: FBT001  # the state of a coil, as Bool is
        """Energise or release a channel's solenoid.

        Raises:
            ValueError: there is no such channel.

        """
        if channel not in CHANNELS:
            msg = f"channel '{channel}' does not exist; known are: {', '.join(CHANNELS)}"
            raise ValueError(msg)
        self._pneumatics["command"][0, CHANNELS.index(channel)] = energised

    def advance(self, steps: int) -> None:
        """Take `steps` time steps.

        Raises:
            UnstableSimulationError: the state grew beyond all bounds.

        """
        end = self._rig_steps + steps
        for event in self._rig.events:
            if self._rig_steps <= event.step < end:
                self._run(event.step - self._rig_steps)
                event.act(self._data)
        self._run(end - self._rig_steps)

    def reset(self) -> None:
        """Start the rig again, with the same noise; the time goes on."""
        mujoco.mj_resetData(self._model, self._data)
        self._pneumatics[:] = self._vented
        self._tendons[:] = np.zeros_like(self._tendons)
        self._noise.reset()
        self._rig_steps = 0
        self._stand()

    def imu(self) -> ImuSample:
        """Latest output of the IMU, noise, range and filter included."""
        x, y, z, roll, pitch, yaw = self._imu["second"][0].tolist()
        return ImuSample((x, y, z), (roll, pitch, yaw))

    def channel_pressures_pa(self) -> dict[str, float]:
        """Absolute pressure per channel, Pa, as the sensors give it."""
        return dict(zip(CHANNELS, self._measured_pressures_pa()[1:], strict=True))

    def manifold_pressure_pa(self) -> float:
        """Absolute pressure in the manifold, Pa, as the sensor gives it."""
        return self._measured_pressures_pa()[0]

    def joint_positions(self) -> dict[str, float]:
        """Angles of the ankle, rad, and height of the carriage, m."""
        return {name: float(joint.qpos[0]) for name, joint in self._joints.items()}

    def joint_velocities(self) -> dict[str, float]:
        """Rates of the same, rad/s and m/s."""
        return {name: float(joint.qvel[0]) for name, joint in self._joints.items()}

    def tendons(self) -> tuple[TendonSample, ...]:
        """Every tendon, in the order of TENDONS."""
        return tuple(
            TendonSample(
                name,
                float(state["extension_m"]),
                float(state["rate_m_s"]),
                float(state["tension_n"]),
                bool(state["broken"] > 0.0),
            )
            for name, state in zip(TENDONS, self._tendons, strict=True)
        )

    def load_cell_force_n(self) -> tuple[float, float, float]:
        """Force between rig and leg, N, as the cell gives it: tension on z is positive."""
        x, y, z = (self._noise.load_cell_n(self._rig_steps) + self._load_cell).tolist()
        return (x, y, z)

    def description(self) -> dict[str, object]:
        """Name of the rig and all its parameters, ready for YAML."""
        return {"rig": self._rig.name, "timestep_s": self.timestep_s, **self._rig.description}

    def _measured_pressures_pa(self) -> list[float]:
        measured: list[float] = (self._pneumatics["pressure_pa"][0] + self._noise.pressure_pa(self._rig_steps)).tolist()
        return measured

    def _stand(self) -> None:
        """Let the sensors show the pose that the rig starts in, as if it had been there for long."""
        mujoco.mj_forward(self._model, self._data)
        self._imu["first"] = self._raw_imu
        self._imu["second"] = self._raw_imu

    def _run(self, steps: int) -> None:
        if steps <= 0:
            return
        taken = kernels.advance_ankle(
            self._addresses,
            self._pneumatic_law,
            self._pneumatics,
            self._rig.tendon_laws,
            self._tendons,
            self._imu_law,
            self._imu,
            self._data.ten_length,
            self._data.ten_velocity,
            self._data.ctrl,
            self._data.qvel,
            self._raw_imu,
            self._noise.imu_white(steps),
        )
        if taken != steps:
            time_s = self._rig_steps * self.timestep_s
            msg = (
                f"simulation of rig '{self._rig.name}' became unstable within {steps} steps after {time_s:g} s; "
                f"options: {self._rig.description}; a smaller timestep_s or milder parameters help"
            )
            raise UnstableSimulationError(msg)
        self._total_steps += steps
        self._rig_steps += steps
