"""A rig put together for the compiled laws: MuJoCo's data, constants, memory at the start, views of MuJoCo's arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common.names import ANKLE_JOINTS, CARRIAGE_JOINT
from jammkle_sim.physics import records
from jammkle_sim.physics.ankle import joint_law
from jammkle_sim.physics.engine import address_of_function, mujoco
from jammkle_sim.physics.pneumatics import pneumatic_law, vented_state
from jammkle_sim.physics.sensors import imu_law
from jammkle_sim.physics.tendon import relaxed_state
from jammkle_sim.rigs.rig import ACCELEROMETER, LOAD_CELL

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jammkle_sim.rigs.rig import Rig


@dataclass(frozen=True)
class Assembly:
    """What the compiled laws work on."""

    data: Any
    """The mujoco.MjData, in the pose of the start."""
    laws: records.Laws
    start: records.States
    """Memory at the start: vented, pump off, at rest as if it had been there for long."""
    body: records.Body
    probe: records.Probe
    joints: tuple[str, ...]
    """Joints that are recorded, in order."""


def assembled(rig: Rig) -> Assembly:
    """Put a rig together, in its pose."""
    model = rig.model
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    data = mujoco.MjData(model)
    pose(model, data)
    laws = laws_of(rig)
    body = _body(model, data)
    known = {model.joint(i).name for i in range(model.njnt)}
    joints = tuple(name for name in (*ANKLE_JOINTS, CARRIAGE_JOINT) if name in known)
    return Assembly(data, laws, _start(laws, body), body, _probe(model, data, joints), joints)


def laws_of(rig: Rig) -> records.Laws:
    """Return the constants of a rig, for its time step."""
    timestep_s = float(rig.model.opt.timestep)
    return records.Laws(
        pneumatic_law(rig.pneumatics, timestep_s) if rig.pneumatic_law is None else rig.pneumatic_law,
        rig.tendon_laws,
        imu_law(rig.sensors, timestep_s) if rig.imu_law is None else rig.imu_law,
        joint_law(timestep_s) if rig.joint_law is None else rig.joint_law,
    )


def pose(model: Any, data: Any) -> None:
    """Put the bodies where the rig starts."""
    mujoco.mj_resetData(model, data)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)


def _start(laws: records.Laws, body: records.Body) -> records.States:
    extensions_m = body.length_m - laws.tendons["free_length_m"]
    tendons = np.zeros(len(laws.tendons), dtype=records.TENDON_STATE)
    for i, extension_m in enumerate(extensions_m.tolist()):
        tendons[i : i + 1] = relaxed_state(laws.tendons[i : i + 1], extension_m)
    joint = np.zeros(1, dtype=records.JOINT_STATE)
    return records.States(vented_state(laws.pneumatics), tendons, imu_at_rest(laws.imu, body.raw_imu), joint)


def imu_at_rest(law: NDArray[Any], raw: NDArray[np.float64]) -> NDArray[Any]:
    """Return the memory, shape (1,) of IMU_STATE, of a filter that has seen nothing but this raw sample for long.

    Args:
        law: Its constants, shape (1,) of IMU_LAW.
        raw: Specific force, m/s^2, and angular velocity, rad/s, shape (6,).

    """
    state = np.zeros(1, dtype=records.IMU_STATE)
    turned = raw.reshape(2, 3) @ law["turn"][0].T
    state["first"] = state["second"] = turned.ravel() + law["offset"][0]
    return state


def _body(model: Any, data: Any) -> records.Body:
    known = {model.joint(i).name for i in range(model.njnt)}
    joints = [name for name in ANKLE_JOINTS if name in known]
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
        applied_n_m=data.qfrc_applied,
        joint_index=np.array([model.joint(name).dofadr[0] for name in joints], dtype=np.intp),
        raw_imu=data.sensordata[imu : imu + records.IMU_AXES],
    )


def _probe(model: Any, data: Any, joints: tuple[str, ...]) -> records.Probe:
    found = [model.joint(name) for name in joints]
    return records.Probe(
        position=data.qpos,
        speed=data.qvel,
        position_index=np.array([joint.qposadr[0] for joint in found], dtype=np.intp),
        speed_index=np.array([joint.dofadr[0] for joint in found], dtype=np.intp),
        load_cell_n=data.sensor(LOAD_CELL).data,
    )
