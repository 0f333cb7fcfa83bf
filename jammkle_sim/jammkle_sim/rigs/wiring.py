"""Where in MuJoCo's arrays the compiled laws find what they read and write."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_sim.physics import records
from jammkle_sim.physics.engine import address_of_function
from jammkle_sim.rigs.rig import ACCELEROMETER, LOAD_CELL

if TYPE_CHECKING:
    from collections.abc import Iterable


def body_of(model: Any, data: Any) -> records.Body:
    """Return the views through which a simulation is stepped.

    Args:
        model: The mujoco.MjModel.
        data: Its mujoco.MjData; the views live as long as it does.

    """
    imu = int(model.sensor(ACCELEROMETER).adr[0])
    addresses = [
        address_of_function("mj_step1"),
        address_of_function("mj_step2"),
        model._address,  # noqa: SLF001  # the bindings' own way to hand a model to C
        data._address,  # noqa: SLF001  # as above
    ]
    return records.Body(
        addresses=np.array(addresses, dtype=np.intp),
        length_m=data.ten_length,
        rate_m_s=data.ten_velocity,
        pull_n=data.ctrl,
        speed=data.qvel,
        raw_imu=data.sensordata[imu : imu + records.IMU_AXES],
    )


def probe_of(model: Any, data: Any, joints: Iterable[str]) -> records.Probe:
    """Return the views through which a simulation is recorded.

    Args:
        model: The mujoco.MjModel.
        data: Its mujoco.MjData; the views live as long as it does.
        joints: Names of the joints to record, in this order.

    """
    found = [model.joint(name) for name in joints]
    return records.Probe(
        position=data.qpos,
        speed=data.qvel,
        position_index=np.array([joint.qposadr[0] for joint in found], dtype=np.intp),
        speed_index=np.array([joint.dofadr[0] for joint in found], dtype=np.intp),
        load_cell_n=data.sensor(LOAD_CELL).data,
    )
