"""Names on the graph: nodes, channels, tendons, joints, frames, topics, services, actions. Does not import rclpy.

All topic names are relative, so that a namespace per ankle (`/lf_ankle`) is enough for a quadruped;
only `/clock` and `/diagnostics` are absolute.
"""

from __future__ import annotations

import enum
import re
from dataclasses import dataclass

from jammkle_common.command.errors import InputError

DRIVER_NODE = "driver"
CONTROLLER_NODE = "controller"
SIM_NODE = "sim"
GAP_MONITOR_NODE = "gap_monitor"
RECORDER_NODE = "recorder"
VIEWER_NODE = "viewer"
FOXGLOVE_NODE = "foxglove"
ROBOT_NAMES_NODE = "robot_names"

SIM_HARDWARE = "sim"
"""The driver's hardware that a node of the graph simulates. Every other one stands behind the driver alone."""

PERONEAL_LEFT = "peroneal_left"
PERONEAL_RIGHT = "peroneal_right"
ACHILLES = "achilles"

CHANNELS: tuple[str, ...] = (PERONEAL_LEFT, PERONEAL_RIGHT, ACHILLES)
"""Pneumatic channels, one solenoid each, in the order every message uses."""

TENDONS_OF_CHANNEL: dict[str, tuple[str, ...]] = {
    PERONEAL_LEFT: ("peroneal_left",),
    PERONEAL_RIGHT: ("peroneal_right",),
    ACHILLES: ("achilles_left", "achilles_right"),
}
"""Which tendons a channel evacuates. Three solenoids for four tendons: the Achilles pair shares one (our reading)."""

TENDONS: tuple[str, ...] = tuple(tendon for channel in CHANNELS for tendon in TENDONS_OF_CHANNEL[channel])
"""Tendons of one ankle, in the order every message uses."""

QUADRUPED_ANKLES: tuple[str, ...] = ("lf_ankle", "rf_ankle", "lh_ankle", "rh_ankle")
"""Ankles of a quadruped, each the namespace of its topics: left and right, fore and hind."""

ANKLE_JOINTS: tuple[str, ...] = ("ankle_roll", "ankle_pitch", "ankle_yaw")
"""Angles of the ball joint in joint_states, rad; ankle_pitch is positive toe-down."""

LEG_JOINTS: tuple[str, ...] = ("abduction", "hip", "knee")
"""Joints of a limb, as joint_states has them together with its ankle's, rad."""

CARRIAGE_JOINT = "carriage"
"""The rig's slide in joint_states: height of the ankle joint above floor or slope, m, up positive."""

CARRIAGE_X_JOINT = "carriage_x"
"""How far forward the ankle joint is, m, from anywhere on the ground; only where a press is not straight down."""

IMU_FRAME = "imu"
LOAD_CELL_FRAME = "load_cell"
MANIFOLD_FRAME = "manifold"
FOOT_FRAME = "foot"
"""Frames of one ankle; a channel's pressure is in a frame of the channel's name. `frame` puts them into a namespace."""

BASE_FRAME, ODOM_FRAME = "base_link", "odom"
"""Frames of a whole robot (REP-105): the origin of the body that carries the rest, and what it moves in."""


class TopicKind(enum.Enum):
    """How a topic is delivered; `jammkle_common.qos` turns it into profiles for both ends."""

    SENSOR = "sensor"
    """A stream of measurements: reliable publisher (REP-2003), best-effort subscribers."""
    COMMAND = "command"
    """A stream of requests: reliable, volatile. One from before one joined is void."""
    STATE = "state"
    """The latest value counts: reliable, latched (transient local), depth 1."""
    ACTUATOR = "actuator"
    """What an actuator is commanded: as a state, and no change may be missed: deep queues."""
    EVENT = "event"
    """Each message counts: reliable, volatile, deep queue."""
    CLOCK = "clock"
    """/clock: reliable with a deep queue, for recorders; subscribers best effort, depth 1, as rclpy has them."""


@dataclass(frozen=True)
class Topic:
    """One topic: its name, its type as `package/msg/Name`, how it is delivered, and what it means."""

    name: str
    message_type: str
    kind: TopicKind
    note: str


def _sensor(name: str, message_type: str, note: str) -> Topic:
    return Topic(name, message_type, TopicKind.SENSOR, note)


def _state(name: str, message_type: str, note: str) -> Topic:
    return Topic(name, message_type, TopicKind.STATE, note)


PUMP_DUTY = Topic("pump/duty", "std_msgs/msg/Float32", TopicKind.ACTUATOR, "duty applied to the pump, 0 to 1")
ACTUATOR_STATES = _sensor(
    "actuator_states",
    "jammkle_msgs/msg/ActuatorStates",
    "duty and solenoids as the hardware has taken them, stamped; commands carry no stamp",
)
MANIFOLD_PRESSURE = _sensor(
    "manifold/pressure", "sensor_msgs/msg/FluidPressure", "absolute pressure in the manifold, Pa"
)
IMU = _sensor(
    "imu/data", "sensor_msgs/msg/Imu", "specific force, m/s^2, and angular velocity, rad/s (REP-145); no orientation"
)
JOINT_STATES = _sensor("joint_states", "sensor_msgs/msg/JointState", "ankle angles, rad, and the rig's carriage, m")
TENDON_STATES = _sensor(
    "tendon_states", "jammkle_msgs/msg/TendonStates", "extension, m, rate, m/s, and tension, N, per tendon"
)
LOAD_CELL = _sensor(
    "load_cell/wrench",
    "geometry_msgs/msg/WrenchStamped",
    "force between rig and leg, N; tension on force.z is positive",
)
FOOT_CONTACT = _sensor("foot_contact", "std_msgs/msg/Bool", "true: the foot's contact switch is closed; optional")
GAIT_PHASE = _sensor(
    "gait/phase",
    "std_msgs/msg/Float32",
    "0 at touch-down to 1 at the next, of the foot; optional; a simulated robot that walks publishes it",
)
PLANNED_CONTACT = _sensor(
    "gait/contact",
    "std_msgs/msg/Bool",
    "whether the gait plans contact of the foot now; optional; a simulated robot that walks publishes it",
)
JAM_STATE = _state("jam_state", "jammkle_msgs/msg/JamState", "state and vacuum per channel")
JAM_COMMAND = Topic(
    "jam_command", "jammkle_msgs/msg/JamCommand", TopicKind.COMMAND, "vacuum requested per channel, Pa; goes stale"
)
CONTACT_EVENTS = Topic(
    "contact_events", "jammkle_msgs/msg/ContactEvent", TopicKind.EVENT, "impact, slip, lift-off, swing, settled"
)
CONTACT_STATE = _state(
    "contact_state",
    "jammkle_msgs/msg/ContactState",
    "contact, no contact or unknown, what shows it, and whether the ankle is soft in stance",
)
LANDING = _state(
    "landing", "jammkle_msgs/msg/Landing", "vacuum chosen for the latest touch-down, what was reached, and why"
)
EMERGENCY_STOP = _state("emergency_stop", "std_msgs/msg/Bool", "true: release everything until ~/clear_fault")
SIM_PARAMETERS = _state("sim_parameters", "std_msgs/msg/String", "rig and simulation parameters as YAML")
ROBOT_DESCRIPTION = _state(
    "robot_description",
    "std_msgs/msg/String",
    "URDF of what is simulated: its frames are those of the messages, its joints those of joint_states",
)
ODOMETRY = _sensor(
    "odom", "nav_msgs/msg/Odometry", "pose of base_link in odom, and its velocity in itself; of a simulation the truth"
)
SIMULATOR_GAP = _state(
    "simulator_gap",
    "jammkle_msgs/msg/SimulatorGap",
    "how far the robot is from its simulator, per subsystem, in units of the noise; from the gap monitor",
)
TRUE_CONTACT = _sensor(
    "true_contact",
    "jammkle_msgs/msg/TrueContact",
    "what a simulated robot's foot truly does on the ground: force, sliding",
)
CLOCK = Topic("/clock", "rosgraph_msgs/msg/Clock", TopicKind.CLOCK, "simulated time, after the state it belongs to")
DIAGNOSTICS = Topic(
    "/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", TopicKind.EVENT, "health of every node, 1 Hz and on change"
)

LOCKSTEP = _sensor(
    "lockstep",
    "std_msgs/msg/Header",
    "from each node that the simulation waits for: its full name in frame_id, and up to which stamp it is done",
)
"""Between a simulation and those that keep in step with it; not part of a recording, which says nothing of pace."""

TF = Topic("/tf", "tf2_msgs/msg/TFMessage", TopicKind.SENSOR, "the same pose for tf, where tf2_msgs is installed")

JOINT_TRAJECTORY = Topic(
    "joint_trajectory",
    "trajectory_msgs/msg/JointTrajectory",
    TopicKind.COMMAND,
    "angles, rad, that a robot's own joints shall take from its stamp on, by its model's names; an empty one ends it",
)
"""To whatever moves a robot's joints, such as a joint_trajectory_controller of ros2_control, or a simulated robot."""


def solenoid_topic(channel: str) -> Topic:
    """Topic of a channel's solenoid: true = energised = connected to the manifold."""
    note = "true: energised, vacuum; false: vented"
    return Topic(f"{channel}/solenoid", "std_msgs/msg/Bool", TopicKind.ACTUATOR, note)


SOLENOIDS: dict[str, Topic] = {channel: solenoid_topic(channel) for channel in CHANNELS}
PRESSURES: dict[str, Topic] = {
    channel: _sensor(f"{channel}/pressure", "sensor_msgs/msg/FluidPressure", "absolute pressure in the channel, Pa")
    for channel in CHANNELS
}

TOPICS: tuple[Topic, ...] = (
    PUMP_DUTY,
    *SOLENOIDS.values(),
    ACTUATOR_STATES,
    *PRESSURES.values(),
    MANIFOLD_PRESSURE,
    IMU,
    JOINT_STATES,
    TENDON_STATES,
    LOAD_CELL,
    JAM_STATE,
    JAM_COMMAND,
    CONTACT_EVENTS,
    CONTACT_STATE,
    LANDING,
    FOOT_CONTACT,
    GAIT_PHASE,
    PLANNED_CONTACT,
    EMERGENCY_STOP,
    SIM_PARAMETERS,
    ROBOT_DESCRIPTION,
    ODOMETRY,
    SIMULATOR_GAP,
    DIAGNOSTICS,
    CLOCK,
)
"""Every topic of one ankle's graph: what a complete recording holds."""

FROM_OUTSIDE: tuple[Topic, ...] = (EMERGENCY_STOP, FOOT_CONTACT, GAIT_PHASE, PLANNED_CONTACT)
"""Those that only a robot around the ankle publishes, a simulated one its gait among them."""

OF_THE_WHOLE: tuple[Topic, ...] = (SIM_PARAMETERS, ROBOT_DESCRIPTION, ODOMETRY)
"""What one simulation of several ankles says above them, and once."""

ROBOT_TOPICS: tuple[Topic, ...] = (TRUE_CONTACT,)
"""What there is besides, for each ankle of a simulated leg or quadruped."""


ROBOTS_JOINT_STATES = Topic(
    "robot/joint_states", JOINT_STATES.message_type, TopicKind.SENSOR, "joints by the robot's names, for `robot_names`"
)


def below(within: str, topic: Topic) -> str:
    """Return a topic's name in a namespace below a node's own, such as that of one ankle of several; empty: in that."""
    return topic.name if topic.name.startswith("/") or not within else f"{within}/{topic.name}"


def frame(namespace: str, name: str) -> str:
    """Return a frame of an ankle in a namespace: `lf_ankle/imu`; as it is in the root."""
    return "/".join(part for part in (namespace.strip("/"), name) if part)


@dataclass(frozen=True)
class Service:
    """One service: the node that offers it, its name below that, its type as `package/srv/Name`, and what it does."""

    node: str
    suffix: str
    service_type: str
    note: str

    @property
    def name(self) -> str:
        """Name as the node itself creates it: private, so that it follows the node's name and namespace."""
        return f"~/{self.suffix}"

    @property
    def path(self) -> str:
        """Name relative to the namespace, for clients: `driver/jam`."""
        return f"{self.node}/{self.suffix}"


TRIGGER = "std_srvs/srv/Trigger"
SET_BOOL = "std_srvs/srv/SetBool"

JAM = Service(DRIVER_NODE, "jam", "jammkle_msgs/srv/Jam", "jam channels to a vacuum")
UNJAM = Service(DRIVER_NODE, "unjam", "jammkle_msgs/srv/Unjam", "vent channels")
JAM_ALL = Service(DRIVER_NODE, "jam_all", TRIGGER, "jam all channels to the default vacuum")
UNJAM_ALL = Service(DRIVER_NODE, "unjam_all", TRIGGER, "vent all channels")
CLEAR_FAULT = Service(DRIVER_NODE, "clear_fault", TRIGGER, "leave FAULT and emergency stop, everything vented")
SET_AUTO = Service(
    CONTROLLER_NODE,
    "set_auto",
    SET_BOOL,
    "let the controller decide, or not; true is the way back to automatic from every state",
)
SET_CONTACT = Service(CONTROLLER_NODE, "set_contact", SET_BOOL, "say that the foot stands, or that it does not")
SET_PAUSED = Service(SIM_NODE, "set_paused", SET_BOOL, "pause or go on")
RESET = Service(SIM_NODE, "reset", TRIGGER, "put the rig back to its start; simulated time goes on")
STEP = Service(SIM_NODE, "step", "jammkle_msgs/srv/Step", "advance a paused simulation by steps")


WAY_BACK = f"back to automatic: {SET_AUTO.path} with true"
"""From every state, after `~/clear_fault` where there is a fault or was a stop; named wherever something is refused."""

CHANNEL_JAMS: dict[str, Service] = {
    channel: Service(DRIVER_NODE, f"{channel}/jam", SET_BOOL, "jam this channel to the default vacuum, or vent it")
    for channel in CHANNELS
}

SERVICES: tuple[Service, ...] = (
    JAM,
    UNJAM,
    *CHANNEL_JAMS.values(),
    JAM_ALL,
    UNJAM_ALL,
    CLEAR_FAULT,
    SET_AUTO,
    SET_CONTACT,
    SET_PAUSED,
    RESET,
    STEP,
)
"""Every service of one ankle's graph, apart from those that ROS gives each node."""


MAX_NAMESPACE_LENGTH = 200
"""Most characters of a namespace. Names on the graph may have 255, node or topic included (rmw validates them)."""

_TOKEN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def normalised(namespace: str) -> str:
    """Return `namespace` with a leading slash and none at the end; the root is `/`.

    Raises:
        InputError: it holds characters that ROS does not allow in names, or is too long.

    """
    tokens = [token for token in namespace.strip().split("/") if token]
    for token in tokens:
        if not _TOKEN.fullmatch(token):
            msg = (
                f"namespace '{namespace}' is not a ROS name: letters, digits and underscores, "
                "not starting with a digit, parted by '/', for example lf_ankle"
            )
            raise InputError(msg)
    full = "/" + "/".join(tokens)
    if len(full) > MAX_NAMESPACE_LENGTH:
        msg = f"namespace '{full[:20]}...' has {len(full)} characters; it must have {MAX_NAMESPACE_LENGTH} at most"
        raise InputError(msg)
    return full


def resolved(namespace: str, name: str) -> str:
    """Return the absolute form of `name` in a normalised namespace; absolute names stay as they are."""
    if name.startswith("/"):
        return name
    return f"{namespace.rstrip('/')}/{name}"


def relative(namespace: str, name: str) -> str | None:
    """Return the absolute `name` as seen from a normalised namespace, or None if it lies outside of it."""
    prefix = namespace.rstrip("/") + "/"
    return name[len(prefix) :] if name.startswith(prefix) else None


_SENSOR_DEPTH = 100
SENSOR_HISTORY_DEPTH = 1000
"""Two seconds of 500 Hz, one of 1 kHz: longer than a process on a busy machine waits for its turn. Assumed.

A reliable publisher can send again only what it still has, so its depth is how long a recorder may be held up.
"""
_EVENT_DEPTH = 100
"""Five seconds of what is repeated at 20 Hz, so that a recorder which is held up for 2 s misses none."""


@dataclass(frozen=True)
class Delivery:
    """What is asked of the middleware for one end of a topic."""

    depth: int
    """Messages that wait for a receiver that is busy."""
    reliable: bool
    """Whether a lost message is sent again."""
    latched: bool = False
    """Whether one who joins late gets the last messages (transient local)."""


_LATCHED = Delivery(1, reliable=True, latched=True)
_PUBLISHED = {
    TopicKind.SENSOR: Delivery(SENSOR_HISTORY_DEPTH, reliable=True),
    TopicKind.COMMAND: Delivery(_EVENT_DEPTH, reliable=True),
    TopicKind.STATE: _LATCHED,
    TopicKind.ACTUATOR: Delivery(_EVENT_DEPTH, reliable=True, latched=True),
    TopicKind.EVENT: Delivery(_EVENT_DEPTH, reliable=True),
    TopicKind.CLOCK: Delivery(SENSOR_HISTORY_DEPTH, reliable=True),
}
_SUBSCRIBED = {
    **_PUBLISHED,
    TopicKind.SENSOR: Delivery(_SENSOR_DEPTH, reliable=False),
    TopicKind.CLOCK: Delivery(1, reliable=False),
}


def published(topic: Topic) -> Delivery:
    """Return how this project publishes `topic`."""
    return _PUBLISHED[topic.kind]


def subscribed(topic: Topic) -> Delivery:
    """Return how this project subscribes to `topic`; it matches any publisher of the ecosystem for sensors."""
    return _SUBSCRIBED[topic.kind]
