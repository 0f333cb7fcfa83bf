"""Our robots by name, and an ankle by itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_common.names import BASE_FRAME, LOAD_CELL_FRAME
from jammkle_common.parameters import ParameterError
from jammkle_sim.rigs.model import new_spec
from jammkle_sim.rigs.simulation import Simulation
from jammkle_sim.robots.leg import leg
from jammkle_sim.robots.options import ROBOTS, RobotOptions
from jammkle_sim.robots.quadruped import quadruped
from jammkle_sim.robots.robot import AnkleFitting, Robot, attach_ankle, robot_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from jammkle_sim.physics.ankle import AnkleParameters

_BUILT_BY: dict[str, Callable[[RobotOptions], Robot]] = dict(zip(ROBOTS, (leg, quadruped), strict=True))


def robot(name: str, options: RobotOptions) -> Robot:
    """Build one of our robots.

    Raises:
        ParameterError: there is no such robot, or an option out of range.

    """
    if name not in _BUILT_BY:
        msg = f"robot '{name}' does not exist; known are: {', '.join(ROBOTS)}"
        raise ParameterError(msg)
    return _BUILT_BY[name](options)


def robot_simulation(name: str, options: RobotOptions) -> Simulation:
    """Build one of our robots, ready to run; as `robot` otherwise."""
    return Simulation(robot(name, options))


ANKLE = "ankle"
"""Name of the ankle, and of the robot that it is."""


def ankle_alone(parameters: AnkleParameters | None = None) -> Robot:
    """Build an ankle that hangs on nothing but a fixed base, with the IMU at the centre of its joint, as the rigs have.

    The base has no mass; its origin is the centre of the ball joint, and so is that of the rigs' load cell.
    """
    spec = new_spec(ANKLE, RobotOptions().timestep_s)
    spec.worldbody.add_body(name=BASE_FRAME)
    fitting = AnkleFitting() if parameters is None else AnkleFitting(parameters)
    ankle = attach_ankle(spec, BASE_FRAME, ANKLE, fitting=fitting)
    spec.body(ankle.mount).add_site(name=ankle.named(LOAD_CELL_FRAME))
    return robot_of(spec, (ankle,), base=BASE_FRAME)
