"""What a simulation needs to know of a robot that stands on ankles."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from jammkle_sim.physics.constants import TENDON_SETS, TendonParameters
from jammkle_sim.physics.pneumatics import PneumaticParameters
from jammkle_sim.physics.sensors import SensorParameters
from jammkle_sim.robots.attach import check_steps

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_common.parameters import ParameterClass
    from jammkle_sim.rigs.rig import Event
    from jammkle_sim.robots.attach import AttachedAnkle
    from jammkle_sim.robots.gait import FootPlan


class JointControl(Protocol):
    """What moves the robot's own joints."""

    def command(self, time_s: float, data: Any) -> None:
        """Write into the controls of the mujoco.MjData what the joints shall do, `time_s` after the robot's start."""

    def plan(self, ankle: str, time_s: float) -> FootPlan | None:
        """Return what the gait plans of this ankle's foot; None: there is no gait."""


class NoControl:
    """Leaves all controls as they are: the user's own code sets them."""

    def command(self, time_s: float, data: Any) -> None:
        """Do nothing."""

    def plan(self, ankle: str, time_s: float) -> FootPlan | None:  # noqa: ARG002 - for any of them
        """There is no gait."""
        return None


@dataclass(frozen=True)
class Robot:
    """A robot, its ankles, and what moves it."""

    name: str
    spec: Any
    """The mujoco.MjSpec that the model was compiled from."""
    model: Any
    """The mujoco.MjModel. A keyframe, if it has one, is the start."""
    ankles: tuple[AttachedAnkle, ...]
    base: str
    """Body that stands for the whole: its pose is told, and the IMU is on it where that is asked for."""
    tendon: TendonParameters
    pneumatics: PneumaticParameters
    """Of each ankle: every one has its own pump and manifold."""
    sensors: SensorParameters
    control: JointControl = field(default_factory=NoControl)
    events: tuple[Event, ...] = ()
    """By rising step."""
    options: ParameterClass | None = None
    """What it was built from, if it is one of ours."""
    parts: Mapping[str, Any] = field(default_factory=dict)
    """Every other dataclass of constants that went into it, by name."""


def robot_of(
    spec: Any,
    ankles: Sequence[AttachedAnkle],
    *,
    base: str = "",
    parameter_set: str = "fitted",
    seed: int = 0,
    control: JointControl | None = None,
) -> Robot:
    """Make a robot of a user's own model with ankles attached.

    Args:
        spec: The mujoco.MjSpec, with ground, ankles attached. Its first keyframe, if it has one, is the start.
        ankles: What `attach_ankle` returned, one or several.
        base: Body that stands for the whole; empty: the first one of the model.
        parameter_set: Constants of the tendons.
        seed: Of all noise.
        control: Moves the robot's own joints; None: `RobotSimulation.data.ctrl` is the user's.

    Raises:
        ParameterError: its time step or integrator does not go with the tendons.

    """
    model = spec.compile()
    check_steps(model)
    return Robot(
        name=spec.modelname,
        spec=spec,
        model=model,
        ankles=tuple(ankles),
        base=base or model.body(1).name,
        tendon=TENDON_SETS[parameter_set],
        pneumatics=PneumaticParameters(),
        sensors=SensorParameters(seed=seed),
        control=control or NoControl(),
    )
