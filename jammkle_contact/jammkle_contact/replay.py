"""A controller over a stream of what it hears, without ROS: the same samples, the same decisions as in the graph."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_controller.core.controller import AnkleController, Reaction
from jammkle_controller.core.imu import ImuSample
from jammkle_controller.core.inputs import Input
from jammkle_controller.core.leg_load import LegReading
from jammkle_controller.core.sole_speed import BodyTwist, LegPose
from jammkle_controller.settings import controller_settings

if TYPE_CHECKING:
    from collections.abc import Iterable

    from jammkle_contact.recording import Heard
    from jammkle_controller.core.density_ratio import StepRatios
    from jammkle_controller.core.events import ContactEvent
    from jammkle_controller.core.imu import StreamCounts
    from jammkle_controller.parameters import ControllerParameters


@dataclass(frozen=True)
class Decision:
    """From a time, ns, on: what the policy does and wants, per channel, Pa."""

    time_ns: int
    state: str
    wish_pa: dict[str, float]


@dataclass(frozen=True)
class Replay:
    """What a controller made of a stream."""

    events: list[ContactEvent]
    decisions: list[Decision]
    """On every change of state or wish."""
    troubles: list[tuple[int, str]]
    """When an IMU became unbelievable, ns, and why; an empty reason says that it was believed again."""
    swing: list[tuple[int, float]]
    """Probability of swing, at every tenth sample."""
    counts: StreamCounts


def new_controller(parameters: ControllerParameters, ratios: StepRatios | None = None) -> AnkleController:
    """Return a controller with these parameters, and with other density ratios than its own where given."""
    return AnkleController(controller_settings(parameters), ratios)


def hear(controller: AnkleController, heard: Heard) -> Reaction:
    """Let a controller hear one thing."""
    time_ns, what, value = heard
    if isinstance(what, ImuSample):
        return controller.update(what)
    if isinstance(what, (LegReading, LegPose, BodyTwist)):
        return _hear_motion(controller, what, time_ns)
    if what is Input.JOINTS:
        controller.inputs.hear_joints(value, time_ns)
        return Reaction((), wish_changed=False)
    if what is Input.CONTACT_SWITCH:
        return controller.hear_switch(closed=bool(value), time_ns=time_ns)
    if what is Input.PLANNED_CONTACT:
        return controller.hear_plan(contact=bool(value), time_ns=time_ns)
    take = controller.hear_phase if what is Input.GAIT_PHASE else controller.hear_load
    return take(value, time_ns)


def _hear_motion(controller: AnkleController, what: LegReading | LegPose | BodyTwist, time_ns: int) -> Reaction:
    if isinstance(what, LegReading):
        return controller.hear_leg(what, time_ns)
    if isinstance(what, LegPose):
        return controller.hear_pose(what, time_ns)
    return controller.hear_odometry(what, time_ns)


def replay(stream: Iterable[Heard], parameters: ControllerParameters) -> Replay:
    """Run a new controller over a stream.

    Args:
        stream: What it hears, by time of arrival.
        parameters: As of the node.

    """
    controller = new_controller(parameters)
    events: list[ContactEvent] = []
    decisions: list[Decision] = []
    troubles: list[tuple[int, str]] = []
    swing: list[tuple[int, float]] = []
    state, told = None, ""
    for number, heard in enumerate(stream):
        reaction = hear(controller, heard)
        events += reaction.events
        if reaction.wish_changed or controller.state is not state:
            state = controller.state
            decisions.append(Decision(heard.time_ns, state.value, dict(controller.wish)))
        reason = controller.watch.reason
        if reason != told:
            troubles.append((heard.time_ns, reason))
            told = reason
        if number % 10 == 0:
            swing.append((heard.time_ns, controller.swing_probability))
    return Replay(events, decisions, troubles, swing, controller.gate.counts)
