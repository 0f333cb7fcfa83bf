"""Detector and policy as one: IMU samples in, contact events and a wish for the tendons out."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from jammkle_controller.core.detector import ContactDetector, DetectorSettings, Phase
from jammkle_controller.core.policy import JammingPolicy, JamMode, PolicySettings

if TYPE_CHECKING:
    from jammkle_controller.core.events import ContactEvent
    from jammkle_controller.core.imu import ImuGate, ImuSample


class Reaction(NamedTuple):
    """What one sample led to: its events, oldest first, and whether the wish for the tendons changed."""

    events: tuple[ContactEvent, ...]
    wish_changed: bool


class AnkleController:
    """The controller of one ankle without any middleware."""

    def __init__(self, detector: DetectorSettings, policy: PolicySettings) -> None:
        """Start on the ground and soft."""
        self._detector = ContactDetector(detector)
        self._policy = JammingPolicy(policy)
        self._stance_held = False

    def inherit_stance(self) -> None:
        """Note that the ankle was held by a controller before this one: hold it too, once the body is seen at rest.

        A robot stood there, and a controller that was started anew has seen no landing. Any contact event ends the
        wait: from then on this controller knows by itself.
        """
        self._stance_held = True

    def configure(self, detector: DetectorSettings, policy: PolicySettings) -> None:
        """Take new settings and go on from the present state."""
        self._detector.configure(detector)
        self._policy.settings = policy

    def update(self, sample: ImuSample) -> Reaction:
        """Take the next sample."""
        policy = self._policy
        gate = self._detector.gate
        wish_before_pa = policy.vacuum_pa
        stamp_before_ns = gate.last_ns
        events = self._detector.update(sample)
        if gate.last_ns != stamp_before_ns:
            policy.advance(sample.time_ns)
        for event in events:
            policy.react(event)
        if self._stance_held and (events or self._detector.phase is Phase.PLANTED):
            self._stance_held = False
            if not events:
                policy.take_up()
        return Reaction(events, policy.vacuum_pa != wish_before_pa)

    @property
    def gate(self) -> ImuGate:
        """What is known of the IMU stream."""
        return self._detector.gate

    @property
    def phase(self) -> Phase:
        """What the foot does."""
        return self._detector.phase

    @property
    def mode(self) -> JamMode:
        """What the policy does."""
        return self._policy.mode

    @property
    def vacuum_pa(self) -> float:
        """Vacuum wanted in every channel, Pa, gauge, positive; 0 is vented."""
        return self._policy.vacuum_pa
