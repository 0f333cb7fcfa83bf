"""An ankle by itself: what the rigs hold, and what a user attaches to a robot of his own."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_common.names import BASE_FRAME, LOAD_CELL_FRAME
from jammkle_sim.rigs.model import new_spec
from jammkle_sim.robots.attach import AnkleFitting, attach_ankle
from jammkle_sim.robots.options import RobotOptions
from jammkle_sim.robots.robot import Robot, robot_of

if TYPE_CHECKING:
    from jammkle_sim.physics.ankle import AnkleParameters

ANKLE = "ankle"
"""Name of the ankle, and of the robot that it is."""


def ankle_alone(parameters: AnkleParameters | None = None) -> Robot:
    """Build an ankle that hangs on nothing but a fixed base, with the IMU at the centre of its joint, as the rigs have.

    The base has no mass; its origin is the centre of the ball joint, and so is that of the rigs' load cell.

    Args:
        parameters: Its constants; None: as they stand.

    """
    spec = new_spec(ANKLE, RobotOptions().timestep_s)
    spec.worldbody.add_body(name=BASE_FRAME)
    fitting = AnkleFitting() if parameters is None else AnkleFitting(parameters)
    ankle = attach_ankle(spec, BASE_FRAME, ANKLE, fitting=fitting)
    spec.body(ankle.mount).add_site(name=ankle.named(LOAD_CELL_FRAME))
    return robot_of(spec, (ankle,), base=BASE_FRAME)
