"""What the driver says of itself on /diagnostics."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_driver.core.channel import ChannelState
from jammkle_driver.core.hardware import LinkState
from jammkle_graph.diagnostics import Health, Level

if TYPE_CHECKING:
    from jammkle_driver.core.channel import ChannelStatus
    from jammkle_driver.core.hardware import LinkStatus
    from jammkle_driver.core.status import DriverStatus

_LEVELS = {ChannelState.UNKNOWN: Level.WARN, ChannelState.FAULT: Level.ERROR}
_LINK_LEVELS = {LinkState.CONNECTED: Level.OK, LinkState.SEARCHING: Level.WARN, LinkState.LOST: Level.ERROR}


def health_lines(
    status: DriverStatus, lifecycle_state: str, refused_command: str, link: LinkStatus | None = None
) -> tuple[Health, ...]:
    """Return one line for the driver, one each for link, jam_command and manifold, and one per channel.

    Args:
        status: What is known of the driver.
        lifecycle_state: Label of the node's lifecycle state.
        refused_command: Why the last jam_command was refused; empty if it was taken, or none came.
        link: What is known of the hardware's other end; None where the driver is not configured.

    """
    return (
        _driver_line(status, lifecycle_state),
        *(() if link is None else (_link_line(link),)),
        Health("jam_command", Level.WARN, refused_command) if refused_command else Health("jam_command", Level.OK, ""),
        _manifold_line(status),
        *(_channel_line(channel) for channel in status.channels),
    )


def _driver_line(status: DriverStatus, lifecycle_state: str) -> Health:
    if status.stop_reason:
        return Health("driver", Level.ERROR, f"emergency stop: {status.stop_reason}; release it, then ~/clear_fault")
    return Health("driver", Level.OK if status.active else Level.WARN, lifecycle_state)


def _link_line(link: LinkStatus) -> Health:
    level, message = _LINK_LEVELS[link.state], f"{link.state.value}: {link.detail}"
    if link.state is not LinkState.CONNECTED:
        pass  # what the board said before is old
    elif link.latched:
        level = Level.ERROR
        message = f"safe state latched: {', '.join(sorted(cause.value for cause in link.latched))}"
    elif link.faults:
        level = Level.WARN
        message = ", ".join(sorted(fault.value for fault in link.faults))
    values = {
        "board starts": str(link.starts),
        "last reset": "not told" if link.reset_cause is None else link.reset_cause.value,
        "supply (V)": "not measured" if link.supply_v is None else f"{link.supply_v:.2f}",
        "connects": str(link.connects),
        "exchanges": str(link.exchanges),
        "check sum errors": str(link.crc_errors),
        "time-outs": str(link.timeouts),
        "refusals": str(link.refusals),
        "rate (Hz)": "not known" if link.rate_hz is None else f"{link.rate_hz:.0f}",
    }
    return Health("link", level, message, values)


def _manifold_line(status: DriverStatus) -> Health:
    if status.manifold_vacuum_pa is None:
        return Health("manifold", Level.WARN, "no pressure measured; the pump is regulated by the channels alone")
    return Health("manifold", Level.OK, "", {"vacuum (Pa)": f"{status.manifold_vacuum_pa:.0f}"})


def _channel_line(channel: ChannelStatus) -> Health:
    measured_pa = channel.measured_vacuum_pa
    message = f"{channel.state.name}: {channel.reason}" if channel.reason else channel.state.name
    values = {
        "commanded vacuum (Pa)": f"{channel.commanded_vacuum_pa:.0f}",
        "measured vacuum (Pa)": "not measured" if measured_pa is None else f"{measured_pa:.0f}",
    }
    return Health(channel.name, _LEVELS.get(channel.state, Level.OK), message, values)
