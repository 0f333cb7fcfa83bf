"""Whether an ankle may be jammed as asked, and the reason in one line where it may not."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_common.names import WAY_BACK
from jammkle_driver.core.channel import ChannelState
from jammkle_driver.core.requests import RequestError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_driver.core.ankle import Ankle

INACTIVE = "driver is not active"


def check_ready(*, active: bool, stop_reason: str, board: str) -> None:
    """Check that a driver may jam at all.

    Args:
        active: Whether it follows requests.
        stop_reason: Why everything is stopped; empty where it is not.
        board: Why the board takes no jam now; empty where it does.

    Raises:
        RequestError: it may not.

    """
    if not active:
        msg = f"{INACTIVE}: cannot jam; activate it first (lifecycle transition 'activate')"
        raise RequestError(msg)
    if stop_reason:
        msg = f"emergency stop ({stop_reason}): cannot jam; release it, then call ~/clear_fault; {WAY_BACK}"
        raise RequestError(msg)
    if board:
        msg = f"{board}: cannot jam; ask again"
        raise RequestError(msg)


def check_able(ankle: Ankle, channels: Sequence[str]) -> None:
    """Check that channels may be jammed as far as faults and sensors go.

    Raises:
        RequestError: one is in FAULT or, by the policy, another one is; or its pressure is not measured.

    """
    for name in channels:
        status = ankle.channels[name].status
        if status.state is ChannelState.FAULT:
            msg = f"channel '{name}' is in FAULT ({status.reason}); nothing was jammed"
            raise RequestError(msg)
        if not ankle.able(name):
            failed = ankle.faulty[0].status
            msg = f"channel '{failed.name}' is in FAULT ({failed.reason}); fault_policy is ankle: nothing was jammed"
            raise RequestError(msg)
        if status.state is ChannelState.UNKNOWN:
            msg = f"no pressure of channel '{name}' is measured; start the hardware or simulation first"
            raise RequestError(msg)
