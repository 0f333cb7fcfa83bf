"""Whether a release that was commanded can take place at all."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_driver.core.faults import Reason
from jammkle_driver.core.hardware import LinkState
from jammkle_driver.core.requests import RequestError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_driver.core.hardware import LinkStatus
    from jammkle_driver.core.status import DriverStatus


def check_carried_out(status: DriverStatus, channels: Sequence[str], link: LinkStatus | None) -> None:
    """Check that a release which was just commanded can take place.

    Args:
        status: What the driver knows.
        channels: Channels that were released; none named: all.
        link: What is known of the hardware's other end.

    Raises:
        RequestError: nobody is there to carry it out, or a channel does not vent.

    """
    if link is not None and link.state is not LinkState.CONNECTED:
        way_out = "a board with a watchdog lets go by itself; cut the supply of any other"
        msg = f"released, but the board does not hear it ({link.detail}): {way_out}"
        raise RequestError(msg)
    for channel in status.channels:
        if channels and channel.name not in channels:
            continue
        if channel.fault is Reason.BOARD_UNPLUGGED:
            msg = f"released, but no sensor is heard, so nobody may be there to do it: {channel.reason}"
            raise RequestError(msg)
        if channel.fault in {Reason.VALVE_STUCK_OPEN, Reason.NOT_VENTED}:
            msg = f"released, but {channel.name} does not vent: {channel.reason}"
            raise RequestError(msg)
