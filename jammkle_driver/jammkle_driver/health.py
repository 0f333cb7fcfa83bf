"""What the driver says of itself on /diagnostics."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_common.messages import Health, Level
from jammkle_driver.core.channel import ChannelState
from jammkle_driver.core.faults import Reason
from jammkle_driver.core.hardware import MANIFOLD, LinkState
from jammkle_driver.core.watch import link_numbers

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_driver.core.air import Atmosphere
    from jammkle_driver.core.ankle import Ankle
    from jammkle_driver.core.bank import Estimate
    from jammkle_driver.core.channel import Channel
    from jammkle_driver.core.driver import Driver, Trouble
    from jammkle_driver.core.hardware import LinkStatus

_LEVELS = {ChannelState.UNKNOWN: Level.WARN, ChannelState.FAULT: Level.ERROR}
_LATE = f"{Reason.EXECUTOR_OVERLOADED.name}: work comes late, or stood still"
_LINK_LEVELS = {LinkState.CONNECTED: Level.OK, LinkState.SEARCHING: Level.WARN, LinkState.LOST: Level.ERROR}


def health_lines(
    driver: Driver,
    lifecycle_state: str,
    refused_command: str,
    link: LinkStatus | None = None,
    commanders: Sequence[str] = (),
) -> tuple[Health, ...]:
    """Return one line each for driver, link, jam_command, manifold, channels, and for what is made of them.

    Args:
        driver: The driver.
        lifecycle_state: Label of the node's lifecycle state.
        refused_command: Why the last jam_command was refused; empty if it was taken, or none came.
        link: What is known of the hardware's other end; None where the driver is not configured.
        commanders: Names of the nodes that publish jam_command.

    """
    ankle, estimate = driver.ankle, driver.ankle.diagnosis.estimate
    return (
        _driver_line(driver, lifecycle_state),
        *(() if link is None else (_link_line(link, driver),)),
        _command_line(driver, refused_command, commanders),
        _manifold_line(ankle.manifold_vacuum_pa),
        *map(_channel_line, ankle.channels.values()),
        _fault_line(driver.trouble, Level.ERROR if ankle.faulty else Level.WARN),
        _atmosphere_line(ankle.atmosphere),
        _pump_line(ankle, estimate),
        *_leak_lines(ankle, estimate),
        _line("executor", _LATE if driver.own_pace.overloaded else "", driver.own_pace.values),
    )


def _fault_line(trouble: Trouble, level: Level) -> Health:
    why, action = trouble
    said = f"{why.reason.name}: {why.text}; action: {action}" if why.text else "none"
    values = {"action": action or "none", **why.values}
    return Health("fault", Level.OK if why.reason is Reason.NONE else level, said, values)


def _line(about: str, warning: str, values: Mapping[str, str]) -> Health:
    """Return a line that is well where there is nothing to warn of."""
    return Health(about, Level.WARN if warning else Level.OK, warning, values)


def _atmosphere_line(air: Atmosphere) -> Health:
    warning = (
        f"ambient_pressure_pa is {air.declared_pa:.0f}, and vented channels read {air.pressure_pa:.0f} Pa: "
        "what they read is used; correct the parameter"
    )
    values = {
        "atmosphere (Pa)": f"{air.pressure_pa:.0f}",
        "ambient_pressure_pa (Pa)": f"{air.declared_pa:.0f}",
        "measured by vented channels": "yes" if air.measured else "not yet",
    }
    return _line("atmosphere", warning if air.doubtful else "", values)


def _pump_line(ankle: Ankle, estimate: Estimate) -> Health:
    load = ankle.load
    values = {
        "mean duty (1)": f"{load.mean_duty:.2f}",
        "flow (share of declared)": f"{estimate.pump_share:.2f} +- {estimate.pump_deviation:.2f}",
        "ultimate vacuum (share of declared)": f"{estimate.pump_end_share:.2f}",
        "resting": "yes" if ankle.resting else "no",
        "stored vacuum wanted (Pa)": f"{ankle.parameters.reservoir_vacuum_pa:.0f}",
    }
    return _line("pump", "spared: its mean duty is at pump_rated_duty; look for a leak" if load.limited else "", values)


def _leak_lines(ankle: Ankle, estimate: Estimate) -> tuple[Health, ...]:
    latest, alone = ankle.leaks.latest, ankle.leaks.alone
    lines = []
    for index, name in enumerate((MANIFOLD, *ankle.channels)):
        values = {
            "leak conductance by the law of the air (m^3/(s Pa))": (
                f"{estimate.leaks_m3_s_pa[index]:.1e} +- {estimate.leak_deviations_m3_s_pa[index]:.1e}"
            )
        }
        rate, said = latest if name == MANIFOLD else alone.get(name), ""
        if rate is not None:
            values["decay while the pump rests (Pa/s)"] = f"{rate.rate_pa_s:.0f}"
            values["leak conductance by decay, manifold included (m^3/(s Pa))"] = f"{rate.conductance_m3_s_pa:.1e}"
            values["connected"] = ", ".join(sorted(rate.connected))
        elif name == MANIFOLD or latest is None:
            said = "no rest of the pump seen yet"
        else:
            said = "no rest of it alone seen yet: it decays with all that is connected, see manifold leak"
        lines.append(Health(f"{name} leak", Level.OK, said, values))
    return tuple(lines)


def _driver_line(driver: Driver, lifecycle_state: str) -> Health:
    values = {
        "publishers of emergency_stop": str(driver.stop.publishers),
        "of these say true": str(driver.stop.asked_by),
    }
    if driver.stop.reason:
        held = "; solenoids kept, pump off" if driver.ankle.held else ""
        text = f"emergency stop: {driver.stop.reason}; release it, then ~/clear_fault{held}"
        return Health("driver", Level.ERROR, text, values)
    return Health("driver", Level.OK if driver.active else Level.WARN, lifecycle_state, values)


def _command_line(driver: Driver, refused_command: str, commanders: Sequence[str]) -> Health:
    values = {"publishers": ", ".join(commanders) or "none"}
    if driver.streams.speaking > 1:
        text = (
            f"{driver.streams.speaking} publishers at once ({values['publishers']}): each channel follows the one that "
            "changed last; to command alone stop the others, the controller by controller/set_auto with false"
        )
        refused_command = f"{refused_command}; {text}" if refused_command else text
    return _line("jam_command", refused_command, values)


def _link_line(link: LinkStatus, driver: Driver) -> Health:
    level, message = _LINK_LEVELS[link.state], f"{link.state.value}: {link.detail}"
    if link.state is not LinkState.CONNECTED:
        pass  # what the board said before is old
    elif link.latched:
        level = Level.ERROR
        message = f"safe state latched: {', '.join(sorted(cause.value for cause in link.latched))}"
    elif link.paused:
        level, message = Level.WARN, "the simulation is paused or runs a rig; what is asked for happens when it goes on"
    elif warning := driver.line_noise or driver.restarted:
        level, message = Level.WARN, f"{warning.reason.name}: {warning.text}"
    elif link.faults:
        level = Level.WARN
        message = ", ".join(sorted(fault.value for fault in link.faults))
    reset = "unknown" if link.reset_cause is None else link.reset_cause.value
    return Health("link", level, message, {"last reset": reset, **link_numbers(link)})


def _manifold_line(vacuum_pa: float | None) -> Health:
    if vacuum_pa is None:
        return Health("manifold", Level.WARN, "no pressure measured; the pump is regulated by the channels alone")
    return Health("manifold", Level.OK, "", {"vacuum (Pa)": f"{vacuum_pa:.0f}"})


def _channel_line(channel: Channel) -> Health:
    why, name = channel.why, channel.state.name
    values = {
        "fault": why.reason.name,
        "commanded vacuum (Pa)": f"{channel.set_point_pa:.0f}",
        "measured vacuum (Pa)": "not measured" if channel.vacuum_pa is None else f"{channel.vacuum_pa:.0f}",
        **why.values,
    }
    level = _LEVELS.get(channel.state, Level.OK)
    return Health(channel.name, level, f"{name}: {why.text}" if why.text else name, values)
