"""What the driver knows of itself and its channels at one moment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jammkle_driver.core.channel import ChannelStatus


@dataclass(frozen=True)
class DriverStatus:
    """What is known of the whole driver.

    Attributes:
        active: Whether it follows requests.
        stop_reason: Why everything is stopped; empty where it is not.
        manifold_vacuum_pa: Vacuum in the manifold, Pa; None where it is not measured.
        channels: One status per channel, in the driver's order.

    """

    active: bool
    stop_reason: str
    manifold_vacuum_pa: float | None
    channels: tuple[ChannelStatus, ...]
