"""`jammkle exercise`: what a robot can do to be diagnosed, done on a live graph and recorded with its run sheet.

Valves are moved by the driver, the shank by the robot's own joints, through a JointTrajectory, or by a person's hands.
What was commanded is recorded as issued, how the shank moved as its sensors read it; nothing else is needed.
"""

from __future__ import annotations

import dataclasses
import math
import sys
import time
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml
from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]  # carries no types
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from std_srvs.srv import SetBool
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from jammkle_bringup.core.supervisor import ChildSpec, Supervisor
from jammkle_bringup.graph_client import COMMAND_NODE, DISCOVERY_S, LOOK_S, LOOKERS, GraphClient, below, ros_domain
from jammkle_bringup.up import Startup, pass_on
from jammkle_common.bags.contents import holds_a_bag
from jammkle_common.bags.run_sheet import FILE_NAME, RunSheet
from jammkle_common.bags.stopped import refuse_written, set_aside, was_stopped
from jammkle_common.command.errors import GraphError, InputError
from jammkle_common.command.results import make_folder, say
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.messages import AUTOMATIC, POLICY_LINE
from jammkle_common.names import (
    ANKLE_JOINTS,
    CARRIAGE_JOINT,
    CARRIAGE_X_JOINT,
    CHANNELS,
    CLOCK,
    CONTROLLER_NODE,
    DIAGNOSTICS,
    DRIVER_NODE,
    IMU,
    JAM,
    JAM_STATE,
    JOINT_STATES,
    JOINT_TRAJECTORY,
    LEG_JOINTS,
    LOCKSTEP,
    ODOMETRY,
    QUADRUPED_ANKLES,
    RECORDER_NODE,
    SET_AUTO,
    SIM_NODE,
    UNJAM,
    resolved,
)
from jammkle_common.parameters import ParameterError, from_mapping, rows
from jammkle_common.qos import answer_qos, node_at, publisher_qos, subscriber_qos
from jammkle_msgs.msg import JamState
from jammkle_msgs.srv import Jam, Unjam
from jammkle_sim.physics.ankle import AnkleParameters, corner_m
from jammkle_sim.rigs.catalogue import EXERCISES
from jammkle_sim.rigs.model import hung
from jammkle_sim.rigs.replay import has_ground, timestep_s
from jammkle_sim.robots.limb import LimbParameters, stance_back_m
from jammkle_sim.robots.quadruped import place_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from jammkle_sim.rigs.rig import Rig
    from jammkle_sim.rigs.run import Programme

    Floats = NDArray[np.float64]

HANG_PITCH = "hang_pitch_deg"
AS_BUILT = ((CONTROLLER_NODE, HANG_PITCH), (DRIVER_NODE, "reservoir_volume_m3"))
"""Parameters of nodes that say how an ankle is built, and are options of an exercise."""
_PA_PER_KPA = 1e3
_RECORDER_TIMEOUT_S = 30.0
_SEEN_S = 3.0
"""How long joints and odometry of a robot are waited for, s."""
_BEFORE_S, _REST_S = 2.0, 0.5
"""Recorded time before an exercise, in which the foot comes to rest and the recorder finds all, and after it, s."""
_AHEAD_S = 0.5
"""How far ahead a trajectory is sent to a simulation, s, so that it begins at its stamp however long its 25 kB are on
the way. A robot's clock may be another one: there it begins when it comes."""
_COUNT_S = 5
"""Seconds that a person is given to take the shank."""
_STANDS_S = 10.0
"""Real time, s, for which the graph's clock may stand still."""
_STANDS = f"{CLOCK.name} stands still for {_STANDS_S:g} s; let the simulation go on with sim/set_paused"


def exercise(runs: Mapping[Path, RunSheet], namespace: str, asked_to_stop: Callable[[], bool]) -> None:
    """Do exercises one after the other, and record each into a bag of its own.

    Args:
        runs: By bag: an exercise of `jammkle_sim.rigs.catalogue.EXERCISES`, and options that are not its defaults, SI.
        namespace: Normalised namespace of the ankle, or of the robot with its ankles below.
        asked_to_stop: Ends it early.

    Raises:
        InputError: a bag is there already, there is no such exercise or option, a driver takes no such vacuum, or
            another exercise is going on.
        GraphError: the graph is not there, or refuses.
        Interrupted: asked to stop; everything is vented, and what was recorded is complete.

    """
    stopped = [bag for bag in runs if holds_a_bag(bag) and was_stopped(bag)]
    for bag in stopped:
        refuse_written(bag)
    for bag, sheet in runs.items():
        if bag.exists() and bag not in stopped:
            msg = f"{bag} is there already: nothing is overwritten; choose another --output or move it away"
            raise InputError(msg)
        if sheet.rig not in EXERCISES:
            msg = f"exercise '{sheet.rig}' does not exist; it must be one of {', '.join(EXERCISES)}"
            raise InputError(msg)
        try:
            _options_of(sheet)
        except ParameterError as error:
            msg = f"{sheet.rig}: {error}"
            raise InputError(msg) from error
        make_folder(bag.parent)
    ends = False
    with GraphClient(namespace, lambda: asked_to_stop() and not ends, LOOKERS) as client:
        session = _Session(client)
        for sheet in runs.values():
            session.check(sheet)
        try:
            session.begin()
            for bag, sheet in runs.items():
                if bag in stopped:
                    set_aside(bag)
                session.do(sheet, bag)
        finally:
            ends = True  # it is vented however it ends
            session.end()


def _options_of(sheet: RunSheet) -> Any:
    return from_mapping(EXERCISES[sheet.rig].options, dict(sheet.options))


def is_simulated(namespace: str, asked_to_stop: Callable[[], bool]) -> bool:
    """Return whether the robot of a live graph, or the ankle, is a simulated one, which moves without anybody near it.

    Raises:
        GraphError: no driver is on the graph.

    """
    with GraphClient(namespace, asked_to_stop, LOOKERS) as client:
        client.ankles()
        return _simulation_is_seen(client)


def _simulation_is_seen(client: GraphClient) -> bool:
    # The simulation of one ankle of a robot stands above the ankle's own namespace.
    within = {resolved(above, SIM_NODE) for above in _above(client.namespace)}
    return client.wait_until(lambda: bool(within & client.nodes()), _SEEN_S)  # nodes are found one by one


def _above(namespace: str) -> list[str]:
    parts = namespace.strip("/").split("/")
    return [f"/{'/'.join(parts[:count])}" for count in range(len(parts), -1, -1)]


class _Session:
    def __init__(self, client: GraphClient) -> None:
        self._client = client
        self._time_s: float | None = None
        """Of /clock; None: there is none."""
        self._joints: dict[str, dict[str, float]] = {}
        """By ankle, latest position by joint, rad; several nodes may publish joints of their own."""
        self._hip_height_m: float | None = None
        self._states: dict[str, JamState] = {}
        """By ankle, what its driver reported last."""
        self._automatic: dict[str, bool] = {}
        """By full name of the controller, whether it jams by itself."""
        self._were_automatic: tuple[str, ...] = ()
        """Ankles whose controllers jammed by themselves before they were taken from them."""
        self._ankles = client.ankles()
        client.subscribe(Odometry, ODOMETRY, self._take_odometry, subscriber_qos(ODOMETRY))
        client.subscribe(DiagnosticArray, DIAGNOSTICS, self._take_health, subscriber_qos(DIAGNOSTICS))
        self._limb_over_ground: Limb | None = None
        self._places = {}
        for ankle in self._ankles:
            topic = resolved(client.namespace, below(ankle, JOINT_STATES.name))
            self._places[ankle] = client.node.create_publisher(JointState, topic, publisher_qos(JOINT_STATES))

            def take(message: JointState, ankle: str = ankle) -> None:
                self._take_joints(ankle, message)

            def take_state(state: JamState, ankle: str = ankle) -> None:
                self._states[ankle] = state

            client.node.create_subscription(JointState, topic, take, subscriber_qos(JOINT_STATES))
            states = resolved(client.namespace, below(ankle, JAM_STATE.name))
            client.node.create_subscription(JamState, states, take_state, subscriber_qos(JAM_STATE))
        self._refuse_second()
        self._trajectory = client.node.create_publisher(
            JointTrajectory, resolved(client.namespace, JOINT_TRAJECTORY.name), publisher_qos(JOINT_TRAJECTORY)
        )
        # A simulation waits for this node, so that places and commands have the stamps at which they count. The clock
        # comes last: an executor of rclpy serves what has arrived in the order in which a node subscribed.
        self._done = client.node.create_publisher(Header, resolved(client.namespace, LOCKSTEP.name), answer_qos())
        client.subscribe(Clock, CLOCK, self._take_clock, subscriber_qos(CLOCK))
        client.wait_until(lambda: set(self._joints) == set(self._ankles), _SEEN_S)
        # a wait that begins before the first tick would begin by another clock than it ends
        is_simulated = self._value_of(DRIVER_NODE, "use_sim_time").bool_value
        if is_simulated and not client.wait_until(lambda: self._time_s is not None, _STANDS_S):
            raise GraphError(_STANDS)
        self._built = {name: self._value_of(node, name).double_value for node, name in AS_BUILT}
        self._recorder: Supervisor | None = None

    def check(self, sheet: RunSheet) -> None:
        """Refuse an exercise whose vacuum a driver would refuse on the way, or that nobody can do.

        Raises:
            InputError: as said.

        """
        self._client.wait_until(lambda: self._states.keys() >= set(self._ankles), DISCOVERY_S)
        vacuum_pa = _options_of(sheet).vacuum_pa
        for ankle, state in self._states.items():
            least_pa, most_pa = state.min_vacuum_pa, state.max_vacuum_pa
            if most_pa > 0.0 and not least_pa <= vacuum_pa <= most_pa:  # 0: not known
                msg = f"{sheet.rig} asks for {vacuum_pa / _PA_PER_KPA:g} kPa, and the driver of {ankle or 'the ankle'} "
                msg += f"takes {least_pa / _PA_PER_KPA:g} to {most_pa / _PA_PER_KPA:g} kPa (its min_vacuum_pa and "
                msg += "max_vacuum_pa): give a vacuum between them, by --vacuum-kpa"
                raise InputError(msg)
        if self._limbs():
            return
        name, (rig, _) = sheet.rig, EXERCISES[sheet.rig].build(_options_of(self._as_done(sheet)))
        if spoken(course_of(rig, timestep_s(rig))) and _simulation_is_seen(self._client):
            msg = f"{name} moves the shank, and nobody can take that of a simulated ankle into the hands: `jammkle rig "
            msg += f"{name}` does it without the graph, and `jammkle up --robot leg` simulates a leg that moves it"
            raise InputError(msg)
        if has_ground(rig) and not all(CARRIAGE_JOINT in joints for joints in self._joints.values()):
            msg = f"{name} needs the height of the ankle over the ground: by {' and '.join(LEG_JOINTS[1:])}, or by "
            msg += f"{CARRIAGE_JOINT}, in {JOINT_STATES.name}; do the others one by one"
            raise InputError(msg)

    def begin(self) -> None:
        """Take the ankles from their controllers; one that does not say what it does is taken for automatic."""
        controllers = {ankle: resolved(self._client.namespace, below(ankle, CONTROLLER_NODE)) for ankle in self._ankles}
        self._client.wait_until(lambda: self._automatic.keys() >= set(controllers.values()), DISCOVERY_S)
        self._were_automatic = tuple(ankle for ankle, name in controllers.items() if self._automatic.get(name, True))
        self._set_auto(self._ankles, automatic=False)

    def _refuse_second(self) -> None:
        """Refuse to move what another exercise moves: each publishes where its ankles are, from before it begins.

        Raises:
            InputError: as said.

        """
        client, topics = self._client, [publisher.topic_name for publisher in self._places.values()]
        own = client.node.get_fully_qualified_name()

        def others() -> list[str]:
            ends = [end for topic in topics for end in client.publishers(topic)]
            return sorted({node_at(end) for end in ends if end.node_name.startswith(COMMAND_NODE)} - {own})

        if client.wait_until(lambda: bool(others()), LOOK_S):
            msg = f"another exercise is going on in namespace {client.namespace} of ROS domain {ros_domain()} "
            msg += f"({', '.join(others())}); wait for its end (one that was killed is seen for 20 s more)"
            raise InputError(msg)

    def _value_of(self, node: str, name: str) -> ParameterValue:
        """Return a parameter of a node of every ankle; it is not set, that is 0 and false, where the node has none.

        Raises:
            InputError: it is another for one ankle than for another.

        """
        found: dict[str, ParameterValue] = {}
        for ankle in self._ankles:
            path = below(ankle, f"{node}/get_parameters")
            answer = self._client.call(path, GetParameters, GetParameters.Request(names=[name]))
            found[ankle] = answer.values[0] if answer.values else ParameterValue()
        first = next(iter(found.values()))
        if any(value != first for value in found.values()):
            said = ", ".join(f"{ankle} {parameter_value_to_python(value)}" for ankle, value in found.items())
            msg = f"{name} of the nodes {node} differs ({said}), and a run sheet has one for all: set the same"
            raise InputError(msg)
        return first

    def do(self, sheet: RunSheet, bag: Path) -> None:
        """Do one exercise and record it."""
        name, limbs = sheet.rig, self._limbs()
        done = self._as_done(sheet)
        rig, programme = EXERCISES[name].build(_options_of(done))
        say(f"{name}: {EXERCISES[name].title}; {programme.duration_s:.0f} s")
        angles = self._angles(rig, limbs) if limbs else {}
        by_hand = [] if limbs else spoken(course_of(rig, timestep_s(rig)))
        if by_hand:
            for left in range(_COUNT_S, 0, -1):
                say(f"no joints of the robot's own are seen: take the shank into your hands; it begins in {left}")
                self._wait(1.0)
        if angles:
            self._move({joint: course[:1] for joint, course in angles.items()}, [READY_S])
            self._wait(READY_S)
        for doubt in standing(self._joints, self._built[HANG_PITCH]):
            say(doubt)
        command = (sys.executable, "-m", "jammkle_common.command", "record", "-o", str(bag))
        spec = ChildSpec(RECORDER_NODE, (*command, "--namespace", self._client.namespace), _RECORDER_TIMEOUT_S)
        with Supervisor((spec,), pass_on) as supervisor:
            self._recorder = supervisor
            if not Startup(self._client, supervisor).wait(self._is_recorded, _RECORDER_TIMEOUT_S):
                msg = f"the recorder does not listen to every ankle after {_RECORDER_TIMEOUT_S:g} s"
                raise GraphError(msg)
            self._wait(_BEFORE_S)
            self._perform(rig, programme, limbs, angles, by_hand)
            self._wait(_REST_S)
            self._limb_over_ground = None
            self._recorder = None
            if bad := supervisor.stop():
                msg = f"{bad[0].text()}; {bag} is not whole: do the exercise again"
                raise GraphError(msg)
        (bag / FILE_NAME).write_text(yaml.safe_dump(done.as_mapping(), sort_keys=False), encoding="utf-8")

    def end(self) -> None:
        """Vent everything, and let the robot and its controllers do what they did before."""
        self._trajectory.publish(JointTrajectory())
        try:
            self._set_vacuum(CHANNELS, 0.0)
        finally:
            self._set_auto(self._were_automatic, automatic=True)

    def _perform(
        self,
        rig: Rig,
        programme: Programme,
        limbs: Mapping[str, Limb],
        angles: Mapping[str, Any],
        by_hand: Sequence[tuple[float, str]],
    ) -> None:
        """Move shank and valves through an exercise, the shank by its joints or by the words for whoever moves it."""
        in_simulation, course = self._time_s is not None, course_of(rig, timestep_s(rig))
        begun_s = self._now_s() + (_AHEAD_S if in_simulation else 0.0)
        due: list[tuple[float, Callable[[], None]]] = [
            (step.time_s, partial(self._set_vacuum, step.channels, step.vacuum_pa)) for step in programme.vacuum
        ]
        if angles and course.lasts_s > 0.0:
            self._limb_over_ground = next(iter(limbs.values())) if has_ground(rig) else None
            moved = {joint: course_rad[1:] for joint, course_rad in angles.items()}
            self._move(moved, course.time_s[1:].tolist(), begun_s if in_simulation else None)
        due += [(at_s, partial(say, text)) for at_s, text in by_hand]
        for at_s, act in sorted(due, key=lambda each: each[0]):
            self._wait(begun_s + at_s - self._now_s())
            act()
        self._wait(begun_s + programme.duration_s - self._now_s())
        self._set_vacuum(CHANNELS, 0.0)

    def _set_vacuum(self, channels: Sequence[str], vacuum_pa: float) -> None:
        """Ask the driver of every ankle for a vacuum, 0 to vent.

        Raises:
            GraphError: one does not answer, or refuses.

        """
        if vacuum_pa > 0.0:
            request: Any = Jam.Request(channels=list(channels), vacuum_pa=vacuum_pa)
            answers = self._client.call_each(self._ankles, JAM.path, Jam, request)
        else:
            request = Unjam.Request(channels=list(channels))
            answers = self._client.call_each(self._ankles, UNJAM.path, Unjam, request)
        for ankle, answer in answers.items():
            if not answer.success:
                msg = f"the driver of {ankle or 'the ankle'} refuses: {answer.message}"
                raise GraphError(msg)

    def _is_recorded(self) -> bool:
        """Return whether the recorder listens to every ankle, and to what this node itself will ask for.

        Who publishes once must have found the recorder itself: another participant's finding it is not enough.
        """
        recorder, client = resolved(self._client.namespace, RECORDER_NODE), self._client
        measured = [resolved(client.namespace, below(ankle, IMU.name)) for ankle in self._ankles]
        asked = [each.topic_name for each in (self._trajectory, *self._places.values())]
        ends = [client.subscriptions(topic) for topic in measured]
        ends += [client.node.get_subscriptions_info_by_topic(topic) for topic in asked]
        return all(recorder in map(node_at, each) for each in ends)

    def _as_done(self, sheet: RunSheet) -> RunSheet:
        """Return the run sheet of an exercise as it is done with these ankles."""
        kind = EXERCISES[sheet.rig]
        given: dict[str, Any] = {**self._built, **sheet.options}
        if self._limbs() and "sides" in {row.name for row in rows(kind.options)}:
            given["sides"] = "no"  # an abducted leg turns and slides its ankle as it comes down, which nothing measures
        return RunSheet(sheet.rig, {**given, "vacuum_pa": from_mapping(kind.options, given).vacuum_pa})

    def _limbs(self) -> dict[str, Limb]:
        found = {}
        for ankle, joints in self._joints.items():
            if set(LEG_JOINTS[1:]) <= set(joints):
                offset_m = place_of(ankle).get("hip_offset_m", 0.0) if ankle in QUADRUPED_ANKLES else 0.0
                found[ankle] = Limb(
                    LimbParameters(), LEG_JOINTS[0] in joints, offset_m, hung(None, self._built[HANG_PITCH])
                )
        return found

    def _angles(self, rig: Rig, limbs: Mapping[str, Limb]) -> dict[str, Any]:
        """Return where the joints of all limbs are taken, by the names of the robot's model."""
        course, found = course_of(rig, timestep_s(rig)), {}
        for ankle, limb in limbs.items():
            if has_ground(rig):
                if not self._client.wait_until(lambda: self._hip_height_m is not None, _SEEN_S):
                    msg = (
                        f"{ODOMETRY.name} is not published, so that nobody knows how high the hips are over the ground"
                    )
                    raise GraphError(msg)
                angles_rad = limb.pressing_rad(course, float(self._hip_height_m or 0.0))
            else:
                angles_rad = limb.hanging_rad(course)
            side = f"{ankle.partition('_')[0]}_" if ankle else ""
            found |= {f"{side}{joint}": column for joint, column in zip(limb.joints, angles_rad.T, strict=True)}
        return found

    def _move(self, angles: Mapping[str, Any], time_s: Sequence[float], begins_s: float | None = None) -> None:
        """Ask the joints for angles at times from `begins_s` on, on the graph's clock; None: from when it comes."""
        points = [
            JointTrajectoryPoint(
                positions=[float(course[place]) for course in angles.values()],
                time_from_start=Duration(sec=int(at_s), nanosec=int(at_s % 1.0 * NANOSECONDS_PER_SECOND)),
            )
            for place, at_s in enumerate(time_s)
        ]
        trajectory = JointTrajectory(joint_names=list(angles), points=points)
        if begins_s is not None:
            trajectory.header.stamp = Time(nanoseconds=round(begins_s * NANOSECONDS_PER_SECOND)).to_msg()
        self._trajectory.publish(trajectory)

    def _take_clock(self, tick: Clock) -> None:
        self._time_s = tick.clock.sec + tick.clock.nanosec / NANOSECONDS_PER_SECOND
        self._done.publish(Header(stamp=tick.clock, frame_id=self._client.node.get_fully_qualified_name()))

    def _take_odometry(self, message: Odometry) -> None:
        self._hip_height_m = float(message.pose.pose.position.z)

    def _take_health(self, array: DiagnosticArray) -> None:
        for line in array.status:
            said = {value.key: value.value for value in line.values}
            if line.name.endswith(POLICY_LINE) and AUTOMATIC in said:
                self._automatic[line.name.removesuffix(POLICY_LINE)] = said[AUTOMATIC] == "true"

    def _take_joints(self, ankle: str, message: JointState) -> None:
        angles = dict(zip(message.name, message.position, strict=False))
        if set(angles) == {CARRIAGE_X_JOINT, CARRIAGE_JOINT}:
            return  # its own
        known = self._joints.setdefault(ankle, {})
        known.update(angles)
        is_over_ground = self._limb_over_ground is not None and self._hip_height_m is not None
        if is_over_ground and {HIP, KNEE} <= angles.keys():
            place_m = self._limbs()[ankle].place_m(known, self._hip_height_m)
            joints = [CARRIAGE_X_JOINT, CARRIAGE_JOINT]
            self._places[ankle].publish(JointState(header=message.header, name=joints, position=list(place_m)))

    def _now_s(self) -> float:
        return time.monotonic() if self._time_s is None else self._time_s

    def _wait(self, lasts_s: float) -> None:
        """Wait on the graph's clock.

        Raises:
            GraphError: it stands still.

        """
        end_s, stood_s = self._now_s() + lasts_s, time.monotonic()
        before_s = self._now_s()
        while self._now_s() < end_s:
            self._client.wait_until(lambda: self._now_s() >= end_s, 0.2)
            if self._recorder is not None and (death := self._recorder.first_death()) is not None:
                raise GraphError(death.text())
            if self._now_s() > before_s:
                before_s, stood_s = self._now_s(), time.monotonic()
            elif time.monotonic() - stood_s > _STANDS_S:
                raise GraphError(_STANDS)

    def _set_auto(self, ankles: Sequence[str], *, automatic: bool) -> None:
        self._client.call_each(ankles, SET_AUTO.path, SetBool, SetBool.Request(data=automatic))


ABDUCTION, HIP, KNEE = LEG_JOINTS
_EVERY_S = 0.02
"""Time between two points of a course. Chosen: straight lines between them follow 6 Hz to 7 parts in 1000."""
RETRACTED_M = 0.04
"""How much nearer to the hip than in the stance an ankle is that must touch nothing. Assumed: a toe that is turned down
by 40 degrees needs as much."""
_MOVES = 1e-3
"""Degrees, or mm, between two points from which on a shank moves: rounding is below."""
_TURNS = 2.0
"""A kind of motion; others are down, -1, up, 1, and none, 0."""
_STANDS_RAD = 1e-6
"""Turn between two points below which a shank stands: rounding."""
READY_S = 2.0
"""Time in which a robot goes to where an exercise begins."""


@dataclass(frozen=True)
class ShankCourse:
    """Poses of a shank over time, against level ground."""

    time_s: Floats
    """Rising from 0, shape (n,), s."""
    pitch_rad: Floats
    """Toe-down positive."""
    roll_rad: Floats
    height_m: Floats
    """Of the ankle's joint over the ground; it counts only where the ground does."""

    @property
    def lasts_s(self) -> float:
        """How long it takes, s."""
        return float(self.time_s[-1])


def course_of(rig: Rig, step_s: float) -> ShankCourse:
    """Return the course that a rig of an exercise guides its shank through by itself."""
    every = max(round(_EVERY_S / step_s), 1)
    rows = rig.guide[::every]
    turn = Rotation.from_quat(rows[:, [4, 5, 6, 3]]).as_euler("YXZ")
    time_s = np.arange(len(rows), dtype=np.float64) * np.float64(step_s * every)
    return ShankCourse(time_s, turn[:, 0], turn[:, 1], rows[:, 2])


def spoken(course: ShankCourse) -> list[tuple[float, str]]:
    """Return what is said to a person who moves the shank by hand, with the times, s."""
    poses = np.column_stack((np.degrees(course.pitch_rad), np.degrees(course.roll_rad), 1e3 * course.height_m))
    steps = np.diff(poses, axis=0)
    moves = np.abs(steps) > _MOVES
    turns = moves[:, :2].any(axis=1)
    kinds = np.where(turns, _TURNS, np.where(moves[:, 2], np.sign(steps[:, 2]), 0.0))
    edges = np.flatnonzero(np.diff(kinds, prepend=0.0, append=0.0))
    found = []
    for first, last in pairwise(edges.tolist()):
        if kinds[first] == 0.0:
            continue
        lasts_s = float(course.time_s[last] - course.time_s[first])
        pitch_deg, _, height_mm = poses[last] - poses[first]
        if kinds[first] != _TURNS:
            text = f"{'press down' if height_mm < 0.0 else 'lift'} by {abs(height_mm):.0f} mm, within {lasts_s:.1f} s"
        elif np.ptp(poses[first : last + 1, 0]) > 2.0 * abs(pitch_deg) + _MOVES:
            text = f"rock the shank to all sides, slowly and then faster and faster, for {lasts_s:.0f} s"
        else:
            pitch_deg, roll_deg, _ = poses[last]
            text = f"tilt the shank to {pitch_deg:.0f} degrees toe-down and {roll_deg:.0f} degrees to the right"
        found.append((float(course.time_s[first]), text))
    return found


@dataclass(frozen=True)
class Limb:
    """A limb of one of our robots."""

    parameters: LimbParameters
    has_abduction: bool
    offset_m: float = 0.0
    """How far to the left of the abduction's axis its plane is."""
    ankle: AnkleParameters = field(default_factory=AnkleParameters)
    """What it stands on, and how that hangs."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Its joints, in the order of the angles below."""
        return LEG_JOINTS if self.has_abduction else (HIP, KNEE)

    @property
    def lean_rad(self) -> float:
        """Lean of the shank as it stands, from which its pitch counts."""
        return self.parameters.lean_rad(stance_back_m(self.ankle))

    @property
    def _toe_m(self) -> float:
        """How much lower than that of a flat foot its toe hangs."""
        flat = dataclasses.replace(self.ankle, hang_pitch_rad=0.0)
        return corner_m(self.ankle, self.ankle.toe_m)[1] - corner_m(flat, self.ankle.toe_m)[1]

    def hanging_rad(self, course: ShankCourse) -> Floats:
        """Return the angles that take a shank through a course in the air, shape (n, joints); the thigh is at rest."""
        lean_rad, thigh_m, shank_m = self.lean_rad, self.parameters.thigh_m, self.parameters.shank_m
        down_m = self.parameters.stance_m - RETRACTED_M - self._toe_m - shank_m * math.cos(lean_rad)
        hip_rad = np.full(len(course.time_s), math.acos(down_m / thigh_m))
        return self._together(course.roll_rad, hip_rad, course.pitch_rad - lean_rad - hip_rad)

    def pressing_rad(self, course: ShankCourse, hip_height_m: float) -> Floats:
        """Return the angles that press a shank straight down onto the ground, shape (n, joints).

        It is tilted as asked above the ground. On its way down it turns with the leg, by a few degrees.
        """
        limb = self.parameters
        along_m = (course.height_m - hip_height_m - self.offset_m * np.sin(course.roll_rad)) / np.cos(course.roll_rad)
        highest_m = _highest(course, along_m)
        angles = np.zeros((len(course.time_s), 2))
        for i, (pitch_rad, up_m, above_m) in enumerate(zip(course.pitch_rad, along_m, highest_m, strict=True)):
            leaning = pitch_rad - self.lean_rad
            hip_rad = math.acos(min(max((-above_m - limb.shank_m * math.cos(leaning)) / limb.thigh_m, -1.0), 1.0))
            forward_m = -limb.thigh_m * math.sin(hip_rad) - limb.shank_m * math.sin(leaning)
            angles[i] = limb.segments.angles_rad(forward_m, up_m)
        return self._together(course.roll_rad, angles[:, 0], angles[:, 1])

    def place_m(self, angles_rad: dict[str, float], hip_height_m: float) -> tuple[float, float]:
        """Return how far the ankle's joint is forward of the hip and over the ground, m, by the joints' angles."""
        limb, roll_rad = self.parameters, angles_rad.get(ABDUCTION, 0.0)
        leaning = angles_rad[HIP] + angles_rad[KNEE]
        along_m = -limb.thigh_m * math.cos(angles_rad[HIP]) - limb.shank_m * math.cos(leaning)
        forward_m = -limb.thigh_m * math.sin(angles_rad[HIP]) - limb.shank_m * math.sin(leaning)
        return forward_m, hip_height_m + self.offset_m * math.sin(roll_rad) + along_m * math.cos(roll_rad)

    def _together(self, roll_rad: Floats, hip_rad: Floats, knee_rad: Floats) -> Floats:
        columns = (roll_rad, hip_rad, knee_rad) if self.has_abduction else (hip_rad, knee_rad)
        return np.column_stack(columns)


def _highest(course: ShankCourse, along_m: Floats) -> Floats:
    """Return for every moment the height before the press that it is part of: where the tilt last changed."""
    tilt_rad = np.column_stack((course.pitch_rad, course.roll_rad))
    turning = np.abs(np.diff(tilt_rad, axis=0, prepend=np.nan)).max(axis=1) > _STANDS_RAD
    turning[0] = True
    last = np.maximum.accumulate(np.where(turning, np.arange(len(turning)), 0))
    return along_m[last]


_PITCH = ANKLE_JOINTS[1]
_DROOPS_DEG = 10.0
"""How far from its pitch a foot may hang. Assumed: tendons that lost their pretension let it droop by less."""


def standing(joints: Mapping[str, Mapping[str, float]], hang_pitch_deg: float) -> list[str]:
    """Return a line for every ankle, by its joints, rad, whose foot does not hang at this pitch, as a free one does."""
    found = []
    for ankle, angles in joints.items():
        pitch_deg = math.degrees(angles.get(_PITCH, math.radians(hang_pitch_deg)))
        if abs(pitch_deg - hang_pitch_deg) > _DROOPS_DEG:
            found.append(
                f"the foot {ankle or 'of the robot'} is at {pitch_deg:.0f} degrees of pitch, and hangs at "
                f"{hang_pitch_deg:.0f}; if it stands, hoist the robot (simulated: jammkle up --robot ... -p "
                "sim:behaviour:=hang -p sim:drop_height_m:=0.01): exercises are of feet that hang"
            )
    return found
