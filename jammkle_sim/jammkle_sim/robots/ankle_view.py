"""One ankle of a simulated robot: commands in, sensors and truth out, as the ankle of a rig has them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from jammkle_common.names import ANKLE_JOINTS, CHANNELS, TENDONS
from jammkle_sim.rigs.readout import channel_index, check_duty, imu_sample, tendon_samples
from jammkle_sim.rigs.vacuum import VacuumRegulator
from jammkle_sim.robots.foot_truth import FootTruth

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import numpy as np
    from numpy.typing import NDArray

    from jammkle_sim.physics import records
    from jammkle_sim.physics.sensors import Noise, SensorParameters
    from jammkle_sim.rigs.readout import ImuSample, TendonSample
    from jammkle_sim.robots.attach import AttachedAnkle
    from jammkle_sim.robots.gait import FootPlan
    from jammkle_sim.robots.servos import Servos


@dataclass(frozen=True)
class AnkleSample:
    """All of one ankle at one time."""

    imu: ImuSample
    positions: Mapping[str, float]
    """Angles of the ankle, rad, and of its leg's joints, rad or m."""
    velocities: Mapping[str, float]
    """Rates of the same."""
    efforts: Mapping[str, float]
    """Efforts of their servos, N m or N; 0 where there is none."""
    channel_pressures_pa: Mapping[str, float]
    """Absolute, Pa, as the sensors give them."""
    manifold_pressure_pa: float
    tendons: tuple[TendonSample, ...]
    foot: FootTruth
    plan: FootPlan | None
    """What the gait plans of this foot; None: there is no gait."""


class AnkleView:
    """One ankle of a simulation."""

    def __init__(
        self,
        ankle: AttachedAnkle,
        parts: records.Ankle,
        data: Any,
        sensors: SensorParameters,
        noise: Noise,
        plan: Callable[[], FootPlan | None],
        servos: Servos,
    ) -> None:
        """Look at an ankle.

        Args:
            ankle: Which.
            parts: Its constants and memory.
            data: The mujoco.MjData.
            sensors: Of this ankle.
            noise: Of its sensors.
            plan: Gives what the gait plans of its foot now.
            servos: Of the robot.

        """
        self.ankle = ankle
        self.plan = plan
        self._parts = parts
        self._sensors = sensors
        self._noise = noise
        self._servos = servos
        self._regulator: VacuumRegulator | None = None
        self._wanted_pa = dict.fromkeys(CHANNELS, 0.0)
        self._steps = 0
        told = {**{joint: ankle.named(joint) for joint in ANKLE_JOINTS}, **ankle.joints}
        self._joints = {name: data.joint(joint) for name, joint in told.items()}

    def set_pump_duty(self, duty: float) -> None:
        """Set the pump's duty, 0 to 1, and end any set point.

        Raises:
            ValueError: out of range or not a number.

        """
        check_duty(duty)
        self._regulator = None
        self._parts.states.pneumatics["duty"][0] = duty

    def set_solenoid(self, channel: str, energised: bool) -> None:  # noqa: FBT001  # the state of a coil, as Bool is
        """Energise or release a channel's solenoid, and end any set point.

        Raises:
            ValueError: there is no such channel.

        """
        index = channel_index(channel)
        self._regulator = None
        self._parts.states.pneumatics["command"][0, index] = float(energised)

    def hold_vacuum(self, vacuum_pa: Mapping[str, float]) -> None:
        """Let a regulator like the driver's hold these channels at a vacuum from now on; the others stay as they are.

        Args:
            vacuum_pa: By channel, Pa below ambient; 0 vents.

        Raises:
            ValueError: there is no such channel, or a vacuum is negative or not a number.

        """
        for channel, value_pa in vacuum_pa.items():
            channel_index(channel)
            if not value_pa >= 0.0:
                msg = f"vacuum of {channel} is {value_pa} Pa; it must be 0 or more"
                raise ValueError(msg)
        self._wanted_pa.update(vacuum_pa)
        if self._regulator is None:
            self._regulator = VacuumRegulator(float(self._parts.laws.pneumatics["ambient_pa"][0]))

    def regulate(self, elapsed_s: float) -> None:
        """Command pump and solenoids for the set points, if there are any."""
        if self._regulator is None:
            return
        manifold_pa, *channels_pa = self._pressures_pa()
        measured_pa = dict(zip(CHANNELS, channels_pa, strict=True))
        commands = self._regulator.commands(self._wanted_pa, measured_pa, manifold_pa, elapsed_s)
        self._parts.states.pneumatics["duty"][0] = commands.pump_duty
        self._parts.states.pneumatics["command"][0] = commands.energised

    @property
    def pump_duty(self) -> float:
        """What the pump is told, 0 to 1."""
        return float(self._parts.states.pneumatics["duty"][0])

    @property
    def energised(self) -> tuple[bool, ...]:
        """What the solenoids are told, in the order of CHANNELS."""
        return tuple(bool(told > 0.0) for told in self._parts.states.pneumatics["command"][0])

    def imu(self) -> ImuSample:
        """Latest output of the IMU, noise, range and filter included."""
        return imu_sample(self._parts.states)

    def channel_pressures_pa(self) -> dict[str, float]:
        """Absolute pressure per channel, Pa, as the sensors give it."""
        return dict(zip(CHANNELS, self._pressures_pa()[1:], strict=True))

    def manifold_pressure_pa(self) -> float:
        """Absolute pressure in the manifold, Pa, as the sensor gives it."""
        return self._pressures_pa()[0]

    def joint_positions(self) -> dict[str, float]:
        """Angles of the ankle, rad, and positions of its leg's joints, rad or m."""
        return {name: float(joint.qpos[0]) for name, joint in self._joints.items()}

    def joint_velocities(self) -> dict[str, float]:
        """Rates of the same, rad/s and m/s."""
        return {name: float(joint.qvel[0]) for name, joint in self._joints.items()}

    def joint_efforts(self) -> dict[str, float]:
        """Efforts of the same, N m and N, in the mean since the latest targets; 0 where there is no servo."""
        return {name: self._servos.effort(joint.name) for name, joint in self._joints.items()}

    def tendons(self) -> tuple[TendonSample, ...]:
        """Every tendon, in the order of TENDONS."""
        return tendon_samples(TENDONS, self._parts.states)

    def foot(self) -> FootTruth:
        """What the foot truly does on the ground."""
        truth = self._parts.truth[0]
        normal_n = float(truth["normal_force_n"])
        return FootTruth(
            bool(normal_n > truth["bearing_n"]),
            normal_n,
            float(truth["sliding_speed_m_s"]),
            float(truth["sliding_distance_m"]),
        )

    def sample(self) -> AnkleSample:
        """Return all of it."""
        pressures_pa = self._pressures_pa()
        return AnkleSample(
            imu=self.imu(),
            positions=self.joint_positions(),
            velocities=self.joint_velocities(),
            efforts=self.joint_efforts(),
            channel_pressures_pa=dict(zip(CHANNELS, pressures_pa[1:], strict=True)),
            manifold_pressure_pa=pressures_pa[0],
            tendons=self.tendons(),
            foot=self.foot(),
            plan=self.plan(),
        )

    def white(self, steps: int) -> NDArray[np.float64]:
        """Next standard normal numbers of the IMU, shape (steps, 6)."""
        self._steps += steps
        return self._noise.imu_white(steps)

    def restart(self) -> None:
        """Forget set points, and start the noise again."""
        self._regulator = None
        self._wanted_pa = dict.fromkeys(CHANNELS, 0.0)
        self._noise.reset()
        self._steps = 0

    def _pressures_pa(self) -> list[float]:
        measured: list[float] = (
            self._parts.states.pneumatics["pressure_pa"][0] + self._noise.pressure_pa(self._steps)
        ).tolist()
        return measured
