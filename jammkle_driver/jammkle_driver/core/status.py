"""What the driver knows of itself and its channels at one moment."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from jammkle_driver.core.ankle import FaultPolicy
from jammkle_driver.core.faults import REMEDIES, Reason
from jammkle_driver.core.hardware import LinkState
from jammkle_driver.core.link import link_numbers

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_driver.core.ankle import Ankle
    from jammkle_driver.core.atmosphere import AtmosphereStatus
    from jammkle_driver.core.channel import ChannelStatus
    from jammkle_driver.core.faults import Finding
    from jammkle_driver.core.hardware import LinkStatus
    from jammkle_driver.core.overload import OverloadStatus
    from jammkle_driver.core.requests import VacuumLimits
    from jammkle_driver.core.sensors import SensorWatch


@dataclass(frozen=True)
class Trouble:
    """The worst that is known of the whole ankle.

    Attributes:
        reason: What it is; NONE where all is well.
        text: One line: what was seen, with numbers.
        action: What was done about it.
        values: What was seen in numbers for people, with units in the key.

    """

    reason: Reason = Reason.NONE
    text: str = ""
    action: str = ""
    values: Mapping[str, str] = field(default_factory=dict)


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
        line_noise: What is wrong with the line to the board; None where nothing is.
        restarted: That the board has started anew a while ago; None where it has not.
        stop_publishers: How many publishers of emergency_stop there are that have said anything.
        stop_asked_by: How many of them said true last.
        commanders: How many publish jam_command now.

    """

    active: bool
    stop_reason: str
    manifold_vacuum_pa: float | None
    channels: tuple[ChannelStatus, ...]
    trouble: Trouble = Trouble()
    limits: VacuumLimits | None = None
    atmosphere: AtmosphereStatus | None = None
    held: bool = False
    line_noise: Finding | None = None
    restarted: Finding | None = None
    stop_publishers: int = 0
    stop_asked_by: int = 0
    commanders: int = 0


def worst_trouble(
    ankle: Ankle, sensors: SensorWatch, link: LinkStatus, line_noise: Finding | None, own_pace: OverloadStatus
) -> Trouble:
    """Return the worst: a fault, a lost board, what was let go, a silent manifold, a noisy line, the own pace."""
    return _of_ankle(ankle, link) or _of_what_is_around(ankle, sensors, line_noise, own_pace)


def _of_ankle(ankle: Ankle, link: LinkStatus) -> Trouble | None:
    faulty = ankle.faulty
    acts = "kept as it was, pump off" if ankle.held else "vented"
    if faulty:
        names = ", ".join(each.name for each in faulty)
        others = "every channel" if ankle.settings.fault_policy is FaultPolicy.ANKLE else names
        worst = faulty[0].status
        return Trouble(worst.fault, worst.reason, f"{others} {acts} until ~/clear_fault", worst.values)
    if link.state is LinkState.LOST:
        text = f"the board does not answer ({link.detail}): {REMEDIES[Reason.BOARD_UNPLUGGED]}"
        return Trouble(Reason.BOARD_UNPLUGGED, text, "nothing jams until it answers", link_numbers(link))
    let_go = [channel for channel in ankle.channels.values() if channel.fault is not Reason.NONE]
    if let_go:
        names = ", ".join(channel.name for channel in let_go)
        worst = let_go[0].status
        return Trouble(worst.fault, worst.reason, f"{names} {acts} until asked anew", worst.values)
    return None


def _of_what_is_around(
    ankle: Ankle, sensors: SensorWatch, line_noise: Finding | None, own_pace: OverloadStatus
) -> Trouble:
    if sensors.manifold_measured and ankle.manifold_vacuum_pa is None:
        text = f"manifold sensor gives no valid pressure for {sensors.timeout_s:g} s: {REMEDIES[Reason.SENSOR_DEAD]}"
        return Trouble(Reason.SENSOR_DEAD, text, "the pump is regulated by the channels alone", sensors.values)
    if line_noise is not None:
        action = "none: the line repeats what is lost"
        return Trouble(line_noise.reason, line_noise.text, action, line_noise.values)
    if own_pace.overloaded:
        stalls = f"it stood still {own_pace.stalls} times, at most {own_pace.longest_s:.2f} s"
        text = f"the driver's work comes {own_pace.late_s:.3f} s late; {stalls}"
        action = "none: the board lets go where that lasts"
        return Trouble(Reason.EXECUTOR_OVERLOADED, text, action, own_pace.values)
    return Trouble()
