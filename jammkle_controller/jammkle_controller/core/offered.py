"""What is felt where: of each place of the IMU the kinds of event that are told, on what, and why the others are not.

A detection stays only where it beats a threshold on the magnitude and a cumulative sum on what it was tuned on.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_controller.core.detector_settings import Mount

if TYPE_CHECKING:
    from collections.abc import Mapping


class Detection(enum.Enum):
    """Kinds of event, by what they are told apart from."""

    IMPACT = "impact"
    FLIGHT = "lift-off into free fall"
    STEP = "lift-off of a step"
    SWING = "swing"
    RAISE = "lift-off of what is raised slowly"
    SLIP_STANDING = "slip of a foot that stood"
    SLIP_STEPPING = "slip while it steps"
    REST = "settled"


@dataclass(frozen=True)
class Offer:
    """Whether a detection is made, on what, or why it is not."""

    made: bool
    reason: str


_SWING_POSTERIOR = Offer(made=True, reason="probability of swing")
_SLIDE_POSTERIOR = Offer(made=True, reason="probability of sliding")
_FREE_FALL = Offer(made=True, reason="nearly no specific force")
_RAISED = Offer(made=True, reason="height since it last rested, and a tilt")
_REST = Offer(made=True, reason="specific force of gravity, and no turning")
_FOOT: Mapping[Detection, Offer] = {
    Detection.IMPACT: Offer(made=True, reason="a blow in a swing, by its density ratio"),
    Detection.FLIGHT: _FREE_FALL,
    Detection.STEP: _SWING_POSTERIOR,
    Detection.SWING: _SWING_POSTERIOR,
    Detection.RAISE: _RAISED,
    Detection.SLIP_STANDING: _SLIDE_POSTERIOR,
    Detection.SLIP_STEPPING: _SLIDE_POSTERIOR,
    Detection.REST: _REST,
}
_BODY: Mapping[Detection, Offer] = {
    Detection.IMPACT: Offer(made=True, reason="the end of free fall; a threshold above weight and level"),
    Detection.FLIGHT: _FREE_FALL,
    Detection.STEP: Offer(
        made=False, reason="a body that does not fall never showed it: needs the gait, efforts, a switch or the load"
    ),
    Detection.SWING: Offer(made=False, reason="the swing of one foot is not felt on the body"),
    Detection.RAISE: _RAISED,
    Detection.SLIP_STANDING: Offer(made=True, reason="a step of the acceleration that becomes a speed"),
    Detection.SLIP_STEPPING: Offer(
        made=False,
        reason="a body that walks speeds up and slows down at every step: 2 of 309 told were one; odometry shows it",
    ),
    Detection.REST: _REST,
}
OFFERS: Mapping[Mount, Mapping[Detection, Offer]] = {Mount.FOOT: _FOOT, Mount.SHANK: _FOOT, Mount.BODY: _BODY}


def is_felt(mount: Mount, detection: Detection) -> bool:
    """Whether an IMU in this place is used to detect it."""
    return OFFERS[mount][detection].made


def not_felt(mount: Mount) -> Mapping[str, str]:
    """Return what is not detected on an IMU in this place, with the reasons."""
    return {detection.value: offer.reason for detection, offer in OFFERS[mount].items() if not offer.made}
