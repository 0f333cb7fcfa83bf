"""What a simulation needs to know of a rig, and the names that every rig's model gives its parts."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from jammkle_common.names import TENDONS
from jammkle_sim.rigs.wiring import Wiring

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from jammkle_common.parameters import ParameterClass
    from jammkle_sim.physics.pneumatics import PneumaticParameters
    from jammkle_sim.physics.sensors import SensorParameters

ACCELEROMETER, GYRO, LOAD_CELL = "accelerometer", "gyro", "load_cell"
"""Names that a rig's model gives its sensors."""
GROUND = "slope"
"""Name that it gives the ground, where it has one."""


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
    spec: Any
    """The mujoco.MjSpec that the model was compiled from."""
    model: Any
    """The mujoco.MjModel, with a joint `carriage` and the three sensors. A keyframe, if it has one, is the start."""
    tendon_laws: NDArray[Any]
    """TENDON_LAW records, in the order of `tendon_names`, whose actuators come first in the model."""
    pneumatics: PneumaticParameters
    sensors: SensorParameters
    events: tuple[Event, ...]
    """By rising step."""
    options: ParameterClass
    """What it was built from."""
    parts: Mapping[str, Any]
    """Every dataclass of constants that went into it, by name."""
    tendon_names: tuple[str, ...] = TENDONS
    """Names of the tendons; empty for a foot without any."""
    pneumatic_law: NDArray[Any] | None = None
    """PNEUMATIC_LAW, shape (1,), where it differs from what `pneumatics` makes."""
    imu_law: NDArray[Any] | None = None
    """IMU_LAW, shape (1,), where it differs from what `sensors` makes."""
    joint_law: NDArray[Any] | None = None
    """JOINT_LAW, shape (1,), where the ankle's joint has dry friction."""
    wiring: Wiring = dataclasses.field(default_factory=Wiring)
    """What lies between commands and valves, and between sensors and topics."""
    effects: Mapping[str, float] = dataclasses.field(default_factory=dict)
    """What a gap diagnosis put into it, by `effect.parameter`."""
