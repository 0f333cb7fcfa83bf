"""What the driver knows of itself and its channels at one moment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_driver.core.faults import Reason

if TYPE_CHECKING:
    from jammkle_driver.core.atmosphere import AtmosphereStatus
    from jammkle_driver.core.channel import ChannelStatus
    from jammkle_driver.core.requests import VacuumLimits


@dataclass(frozen=True)
class Trouble:
    """The worst that is known of the whole ankle.

    Attributes:
        reason: What it is; NONE where all is well.
        text: One line: what was seen, with numbers.
        action: What was done about it.

    """

    reason: Reason = Reason.NONE
    text: str = ""
    action: str = ""


@dataclass(frozen=True)
class DriverStatus:
    """What is known of the whole driver.

    Attributes:
        active: Whether it follows requests.
        stop_reason: Why everything is stopped; empty where it is not.
        manifold_vacuum_pa: Vacuum in the manifold, Pa; None where it is not measured.
        channels: One status per channel, in the driver's order.
        trouble: The worst that is known of the whole ankle.
        limits: Vacuum that may be asked for; None where nobody asks.
        atmosphere: What vacuum is counted from; None where nobody asks.
        held: Whether solenoids are kept as they were, the pump off.

    """

    active: bool
    stop_reason: str
    manifold_vacuum_pa: float | None
    channels: tuple[ChannelStatus, ...]
    trouble: Trouble = Trouble()
    limits: VacuumLimits | None = None
    atmosphere: AtmosphereStatus | None = None
    held: bool = False
