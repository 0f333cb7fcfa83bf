"""What a simulation needs to know of a machine: its model, the ankles in it, and what the machine does by itself.

A `Rig` has one ankle, a `jammkle_sim.robots.robot.Robot` one or several. Both are a `Machine`.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from jammkle_common.bags.run_sheet import RunSheet
from jammkle_common.command import EFFECTS_FILE, provided
from jammkle_common.names import ANKLE_JOINTS, CARRIAGE_JOINT, TENDONS
from jammkle_sim.physics import kernels, records
from jammkle_sim.physics.ankle import joint_law
from jammkle_sim.physics.engine import address_of_function, mujoco
from jammkle_sim.physics.pneumatics import pneumatic_law, vented_state
from jammkle_sim.physics.sensors import imu_law
from jammkle_sim.physics.tendon import relaxed_state

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from jammkle_common.parameters import ParameterClass
    from jammkle_sim.physics.pneumatics import PneumaticParameters
    from jammkle_sim.physics.sensors import SensorParameters

ACCELEROMETER, GYRO, LOAD_CELL = "accelerometer", "gyro", "load_cell"
"""Names that a rig's model gives its sensors."""
GROUND = "slope"
"""Name that a model gives the ground, where it has one."""
_ANKLE = "ankle"
_CARRIAGE = "carriage"


def free() -> NDArray[np.float64]:
    """Return the guide of a carriage that is not guided."""
    return np.zeros((0, records.GUIDE_COLUMNS))


@dataclass(frozen=True)
class Event:
    """Something that a machine does at a step after each start."""

    step: int
    act: Callable[[Any], None]
    """Takes the mujoco.MjData."""


@dataclass(frozen=True)
class Wiring:
    """What lies between commands and valves, and between sensors and topics; by default nothing."""

    command_delay_s: float = 0.0
    """From a command to when pump and valves get it, s, 0 or more."""
    pressure_delay_s: float = 0.0
    """From a pressure to its reading, s, 0 or more."""
    imu_delay_s: float = 0.0
    """From a motion to the IMU's reading of it, s, 0 or more; its own filter not counted."""
    joint_delay_s: float = 0.0
    """From a motion to the reading of joints and tendons, s, 0 or more."""
    load_cell_delay_s: float = 0.0
    """From a force to its reading, s, 0 or more."""
    clock_skew: float = 0.0
    """How much faster the clock that stamps the readings runs than that of the commands, 1."""
    pressure_offset_pa: tuple[float, ...] = (0.0,) * records.VOLUMES
    """What each pressure reads too much, Pa: manifold, then channels."""
    load_cell_gain: float = 1.0
    """Reading of the load cell over the true force, 1."""


@dataclass(frozen=True)
class AnkleInModel:
    """One ankle of a machine: its constants, and the names that its parts have in the machine's model."""

    name: str
    laws: records.Laws
    sensors: SensorParameters
    """With the seed of this ankle's own noise."""
    tendons: Mapping[str, str]
    """Tendon and actuator in the model, next to one another there in this order, by the name that is reported."""
    joints: Mapping[str, str]
    """Hinge or slide in the model by the name that is reported: the ankle's own and those around it."""
    hinges: tuple[str, ...]
    """In the model, the ankle's own joint, about its three axes; empty for a foot without one."""
    accelerometer: str
    """Sensor in the model; the gyro's data follow its own."""
    load_cell: str = ""
    """Sensor in the model; empty: there is none."""
    contacts: str = ""
    """Sensor of the foot's contacts in the model; empty: nobody looks at them."""
    bearing_n: float = 0.0
    """Normal force from which on the foot counts as standing, N."""
    wiring: Wiring = field(default_factory=Wiring)
    guide: NDArray[np.float64] = field(default_factory=free)
    """How its carriage is guided, as `records.Body` has it."""


@dataclass(frozen=True)
class FootPlan:
    """What a gait plans of one foot, at one time."""

    bears: bool
    """Whether it has the foot on the ground."""
    phase: float | None = None
    """From 0 at touch-down to 1 at the next; None: it has not begun to step."""


class JointControl(Protocol):
    """What moves a robot's own joints."""

    def command(self, time_s: float, data: Any) -> None:
        """Write into the controls of the mujoco.MjData what the joints shall do, `time_s` after the robot's start."""

    def plan(self, ankle: str, time_s: float) -> FootPlan | None:
        """Return what the gait plans of this ankle's foot; None: there is no gait."""


class Machine(Protocol):
    """What a simulation takes forward."""

    @property
    def name(self) -> str:
        """Name of the rig or robot."""

    @property
    def model(self) -> Any:
        """The mujoco.MjModel. A keyframe, if it has one, is the start."""

    @property
    def events(self) -> tuple[Event, ...]:
        """What it does by itself, by rising step."""

    @property
    def base(self) -> str:
        """Body that stands for the whole."""

    @property
    def control(self) -> JointControl | None:
        """What moves its joints; None: it has no servos."""

    @property
    def options(self) -> ParameterClass | None:
        """What it was built from; None: nobody knows."""

    @property
    def one_imu(self) -> bool:
        """Whether all its ankles have the same IMU."""

    @property
    def left_out(self) -> Sequence[str]:
        """What of an effects file it goes without, as it cannot show it, by `constant.parameter`."""

    def in_model(self) -> tuple[AnkleInModel, ...]:
        """Return every ankle, as the model has it."""

    def description(self) -> dict[str, object]:
        """Return its name and all its parameters, ready for YAML."""


@dataclass(frozen=True)
class Rig:
    """A test rig with one ankle, one tendon, or a foot that the ankle is compared with."""

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
    wiring: Wiring = field(default_factory=Wiring)
    """What lies between commands and valves, and between sensors and topics."""
    effects: Mapping[str, float] = field(default_factory=dict)
    """What a gap diagnosis put into it, by `effect.parameter`."""
    left_out: Sequence[str] = ()
    """What of an effects file it goes without, by `constant.parameter`."""
    guide: NDArray[np.float64] = field(default_factory=free)
    """How its carriage is guided, a row per time step, as `records.Body` has it; made by `rigs.guide`."""

    base = _CARRIAGE
    control = None
    one_imu = False

    def in_model(self) -> tuple[AnkleInModel, ...]:
        """Return its ankle, or what is in its place."""
        known = {self.model.joint(i).name for i in range(self.model.njnt)}
        joints = {name: name for name in (*ANKLE_JOINTS, CARRIAGE_JOINT) if name in known}
        return (
            AnkleInModel(
                name=_ANKLE,
                laws=laws_of(self),
                sensors=self.sensors,
                tendons={name: name for name in self.tendon_names},
                joints=joints,
                hinges=tuple(name for name in ANKLE_JOINTS if name in known),
                accelerometer=ACCELEROMETER,
                load_cell=LOAD_CELL,
                wiring=self.wiring,
                guide=self.guide,
            ),
        )

    def description(self) -> dict[str, object]:
        """Return its name and all its parameters, ready for YAML."""
        sheet = RunSheet(self.name, dataclasses.asdict(self.options)).as_mapping()
        plain = {name: dataclasses.asdict(part) for name, part in self.parts.items()}
        effects = {"effects": dict(self.effects)} if self.effects else {}
        return {**sheet, "timestep_s": float(self.model.opt.timestep), **plain, **effects}


def laws_of(rig: Rig) -> records.Laws:
    """Return the constants of a rig, for its time step."""
    timestep_s = float(rig.model.opt.timestep)
    return records.Laws(
        pneumatic_law(rig.pneumatics, timestep_s) if rig.pneumatic_law is None else rig.pneumatic_law,
        rig.tendon_laws,
        imu_law(rig.sensors, timestep_s) if rig.imu_law is None else rig.imu_law,
        joint_law(timestep_s) if rig.joint_law is None else rig.joint_law,
    )


@dataclass(frozen=True)
class Assembly:
    """A rig put together for the compiled laws, in its pose."""

    data: Any
    """The mujoco.MjData."""
    ankle: records.Ankle
    """Constants, memory at the start, and views of MuJoCo's arrays."""
    probe: records.Probe
    """Where a recording finds what is not in the memory."""
    joints: tuple[str, ...]
    """Joints that are recorded, in order."""


def assembled(rig: Rig) -> Assembly:
    """Put a rig together, in its pose, at rest as if it had been there for long: vented, pump off."""
    data = new_data(rig.model)
    pose(rig.model, data)
    (ankle,) = rig.in_model()
    return Assembly(data, *assembled_ankle(rig.model, data, ankle), tuple(ankle.joints))


def new_data(model: Any) -> Any:
    """Return a mujoco.MjData that is not reset by itself when it becomes unstable."""
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    return mujoco.MjData(model)


def pose(model: Any, data: Any) -> None:
    """Put the bodies where the machine starts."""
    mujoco.mj_resetData(model, data)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)


def assembled_ankle(model: Any, data: Any, ankle: AnkleInModel) -> tuple[records.Ankle, records.Probe]:
    """Return constants and memory of an ankle, with views of MuJoCo's arrays: for its laws, and for a recording.

    Args:
        model: The mujoco.MjModel.
        data: The mujoco.MjData, in its pose.
        ankle: Which.

    """
    count = len(ankle.tendons)
    first = next(iter(ankle.tendons.values()), None)
    tendon, actuator = (0, 0) if first is None else (model.tendon(first).id, model.actuator(first).id)
    imu = int(model.sensor(ankle.accelerometer).adr[0])
    addresses = [
        address_of_function("mj_step1"),
        address_of_function("mj_step2"),
        model._address,  # noqa: SLF001  # the bindings' own way to hand a model to C
        data._address,  # noqa: SLF001  # as above
    ]
    body = records.Body(
        addresses=np.array(addresses, dtype=np.intp),
        length_m=data.ten_length[tendon : tendon + count],
        rate_m_s=data.ten_velocity[tendon : tendon + count],
        pull_n=data.ctrl[actuator : actuator + count],
        position=data.qpos,
        speed=data.qvel,
        applied_n_m=data.qfrc_applied,
        joint_index=np.array([model.joint(name).dofadr[0] for name in ankle.hinges], dtype=np.intp),
        raw_imu=data.sensordata[imu : imu + records.IMU_AXES],
        guide=ankle.guide,
        guide_at=np.zeros(1, dtype=np.int64),
    )
    if len(ankle.guide):
        kernels.guide(body)
        mujoco.mj_forward(model, data)
    found = [model.joint(name) for name in ankle.joints.values()]
    probe = records.Probe(
        position=data.qpos,
        speed=data.qvel,
        position_index=np.array([joint.qposadr[0] for joint in found], dtype=np.intp),
        speed_index=np.array([joint.dofadr[0] for joint in found], dtype=np.intp),
        load_cell_n=data.sensor(ankle.load_cell).data if ankle.load_cell else np.zeros(0),
    )
    laws = ankle.laws
    tendons = np.zeros(count, dtype=records.TENDON_STATE)
    for i, extension_m in enumerate((body.length_m - laws.tendons["free_length_m"]).tolist()):
        tendons[i : i + 1] = relaxed_state(laws.tendons[i : i + 1], extension_m)
    states = records.States(
        vented_state(laws.pneumatics),
        tendons,
        imu_at_rest(laws.imu, body.raw_imu),
        np.zeros(1, dtype=records.JOINT_STATE),
    )
    contacts = np.zeros(0)
    if ankle.contacts:
        at = int(model.sensor(ankle.contacts).adr[0])
        contacts = data.sensordata[at : at + records.CONTACT_SLOTS * records.CONTACT_COLUMNS]
    truth = np.zeros(1, dtype=records.FOOT_TRUTH)
    truth["bearing_n"], truth["step_s"] = ankle.bearing_n, float(model.opt.timestep)
    parts = records.Ankle(laws, states, body, contacts, truth)
    if len(ankle.guide):
        _hang(model, data, parts, probe)
    return parts, probe


_SWING_S, _SWINGS = 0.2, 5
"""How a guided ankle comes to rest where it hangs: it swings for this long, then its tendons forget, so many times.
What is left falls by the share that relaxation takes of their stiffness, a third or so, each time."""


def _hang(model: Any, data: Any, parts: records.Ankle, probe: records.Probe) -> None:
    """Let an ankle hang from its shank as if it had done so for long; its shank is where its guide begins."""
    laws, states, body = parts.laws, parts.states, parts.body
    still = body.guide[:1].copy()
    still[:, 7:13] = still[:, 16:] = 0.0
    held = body._replace(guide=still)
    if body.addresses.all():
        steps = round(_SWING_S / float(model.opt.timestep))
        pressure_pa = np.full((steps, records.VOLUMES), float(laws.pneumatics["ambient_pa"][0]))
        rows = np.zeros((steps, records.row_width(len(probe.position_index), len(states.tendons))))
        for _ in range(_SWINGS):
            kernels.body_history(laws, states, held, probe, pressure_pa, rows)
            data.qvel[:] = 0.0
            for i, extension_m in enumerate((body.length_m - laws.tendons["free_length_m"]).tolist()):
                states.tendons[i : i + 1] = relaxed_state(laws.tendons[i : i + 1], extension_m)
    body.guide_at[:] = 0
    kernels.guide(body)
    mujoco.mj_forward(model, data)
    body.guide_at[:] = 0
    data.time = 0.0
    states.imu[:] = imu_at_rest(laws.imu, body.raw_imu)
    states.joint[:] = 0


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


class Change(Protocol):
    """What is done to a rig, or to an ankle of a robot; each refuses with an InputError what it cannot change."""

    @property
    def values(self) -> Mapping[str, float]:
        """What is changed, and by how much, by `effect.parameter`."""

    @property
    def left_out(self) -> Sequence[str]:
        """Constants of the file that this change goes without, by `constant.parameter`."""

    def __call__(self, rig: Rig) -> Rig:
        """Return a changed rig."""

    def live(self) -> Change:
        """Return what of it a live simulation can show: constants that only a recording shows are left out."""

    def of_robots(self) -> Change:
        """Return what of it an ankle of a robot can have: constants of bodies and of the ground are left out."""

    def on_ankle(self, ankle: AnkleInModel, timestep_s: float) -> AnkleInModel:
        """Return an ankle of a robot that is changed, the robot's own bodies as they are; its time step in s."""


def load_change(file: Path) -> Change:
    """Return what the effects of a file do to a rig; read by the package that knows the effects.

    Raises:
        InputError: the file cannot be used.
        InputError: nobody is installed who could read it.

    """
    change: Change = provided(EFFECTS_FILE, "load", "jammkle_gap")(file)
    return change
