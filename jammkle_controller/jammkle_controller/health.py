"""What the controller says of itself on /diagnostics."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.messages import Health, Level
from jammkle_common.names import SET_CONTACT, WAY_BACK
from jammkle_controller.core.events import Contact, Detection, not_felt
from jammkle_controller.core.imu import ImuTrouble
from jammkle_controller.core.inputs import Input
from jammkle_controller.core.policy import PolicyState
from jammkle_controller.parameters import PolicyMode

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_controller.core.controller import AnkleController
    from jammkle_controller.core.imu import Freshness, ImuWatch, StreamCounts

REMEMBERED_S = 5.0
"""How long trouble in the stream is shown after it ended, s."""

LOOKED_AT_S = 2.0
"""How long contact may be unknown before that is a warning, s: rest is seen after 1 s."""
SAY_SO = f"{SET_CONTACT.path} says so"

SAFE_MODE = "the last set points are kept"
"""What is done where nothing shows contact: what is jammed stays jammed, what is soft stays soft."""


class StreamTrouble:
    """Remembers for a while that the counts of ignored samples, gaps or restarts have grown."""

    def __init__(self) -> None:
        """Make one without any trouble."""
        self._seen = 0
        self._until_s = 0.0

    def recent(self, counts: StreamCounts, steady_s: float) -> bool:
        """Return True if a count has grown within the last `REMEMBERED_S` of the steady clock."""
        seen = counts.ignored + counts.gaps + counts.restarts
        if seen != self._seen:
            self._seen = seen
            self._until_s = steady_s + REMEMBERED_S
        return steady_s < self._until_s


def imu_health(controller: AnkleController, freshness: Freshness, topic: str, *, trouble: bool) -> Health:
    """Say whether the IMU's samples come in and are fit for use."""
    counts = controller.gate.counts
    values = {
        "rate (Hz)": f"{controller.gate.rate_hz:.0f}",
        "mean specific force (m/s^2)": f"{controller.watch.level_m_s2:.2f}",
        "usable samples": str(counts.usable),
        "held": str(counts.held),
        "ignored, not finite": str(counts.not_finite),
        "ignored, out of range": str(counts.out_of_range),
        "ignored, repeated stamp": str(counts.repeated),
        "ignored, late": str(counts.late),
        "gaps": str(counts.gaps),
        "clock set back": str(counts.restarts),
        "clipped (%)": f"{100.0 * controller.watch.clipped_share:.0f}",
        "silent for (s)": f"{freshness.silent_s:.2f}",
        "detection": "available" if controller.watch.trouble is None else "unavailable",
        **{
            f"not felt on the {controller.mount.value}: {what}": why for what, why in not_felt(controller.mount).items()
        },
    }
    # Whole seconds: a message is sent anew when its text changes.
    silent = f"no usable sample on {topic} for {freshness.silent_s:.0f} s"
    seen = (
        f"{counts.not_finite} not finite, {counts.out_of_range} out of range, {counts.repeated} repeated, "
        f"{counts.late} late, "
        f"{counts.gaps} gaps, {counts.restarts} restarts"
    )
    if freshness.stale:
        reason = f" ({counts.ignored} samples were ignored: {seen})" if trouble and counts.ignored else ""
        return Health("imu", Level.ERROR, f"{silent}{reason}; {SAFE_MODE}", values)
    if not counts.usable:
        return Health("imu", Level.OK, f"waiting for the first sample on {topic}", values)
    return _believed_health(controller.watch, seen if trouble else "", values)


def _believed_health(watch: ImuWatch, irregular: str, values: Mapping[str, str]) -> Health:
    """Say whether samples that come in are believed, and what is irregular about them."""
    if watch.trouble is ImuTrouble.CHECKING:
        return Health("imu", Level.OK, "samples come in, and are looked at first", values)
    if watch.trouble is not None:
        return Health("imu", Level.ERROR, f"detection is unavailable: {watch.reason}; {SAFE_MODE}", values)
    if irregular:
        return Health("imu", Level.WARN, f"irregular samples: {irregular}", values)
    return Health("imu", Level.OK, "samples come in", values)


def input_health(
    controller: AnkleController, time_ns: int, topics: Mapping[Input, str], leg_trouble: str = ""
) -> Health:
    """Name every input beside the IMU, and whether it is received; none is needed."""
    received = controller.inputs.received(time_ns)
    values = {f"{each.value} ({topics[each]})": "received" if each in received else "not received" for each in Input}
    names = ", ".join(each.value for each in Input if each in received)
    missing = ""
    if not controller.feels(Detection.STEP) and not controller.inputs.shows_contact(time_ns):
        missing = f"; a step is not felt on the {controller.mount.value}: who walks needs gait, efforts, switch or load"
    level = Level.OK
    if leg_trouble:
        level = Level.WARN
        missing += f"; the leg is not known: {leg_trouble}"
    sole = controller.inputs.sole
    if sole is not None:
        for what, count in dataclasses.asdict(sole.counts).items():
            values[f"odometry, {what.replace('_', ' ')}"] = str(count)
        if Input.ODOMETRY not in received:
            level = Level.WARN
            missing += (
                f"; no odometry on {topics[Input.ODOMETRY]} that gives the speed of the sole: slips are the IMU's"
            )
    return Health("inputs", level, f"beside the IMU: {names or 'none'}{missing}", values)


def contact_health(controller: AnkleController, soft: Sequence[str], *, is_soft_in_stance: bool) -> Health:
    """Say what is known of contact; WARN where it is not known for `LOOKED_AT_S`, or the ankle is soft in stance.

    Args:
        controller: Whose knowledge it is.
        soft: Channels that are not asked to jam.
        is_soft_in_stance: Whether they should be, and were not for a while.

    """
    report = controller.contact
    values = {"shown by": report.shown_by or "nothing", "at rest": str(report.at_rest)}
    known = f"{report.contact.value} ({report.shown_by})" if report.shown_by else report.contact.value
    if is_soft_in_stance:
        what = f"soft in stance: {known}, and not asked to jam: {', '.join(soft) or 'no channel is reported'}"
        return Health("contact", Level.WARN, f"{what}; {WAY_BACK}", values)
    time_ns = controller.gate.last_ns
    if time_ns is None or report.contact is not Contact.UNKNOWN:
        return Health("contact", Level.OK, "waiting for the first sample" if time_ns is None else known, values)
    if time_ns - report.since_ns < LOOKED_AT_S * NANOSECONDS_PER_SECOND:
        return Health("contact", Level.OK, "unknown: looked at first", values)
    does = "at rest, so held" if report.at_rest else "it moves, so it is left as it is"
    return Health("contact", Level.WARN, f"unknown: nothing shows whether it stands or hangs; {does}; {SAY_SO}", values)


def policy_health(controller: AnkleController, *, auto: bool, trouble: str, by_hand: Sequence[str] = ()) -> Health:
    """Say what the policy wants, and whether the driver follows.

    Args:
        controller: Whose policy it is.
        auto: Whether it is let decide.
        trouble: Why the driver does not follow, or would not; empty if it does.
        by_hand: Channels that somebody has vented by a service while the policy wants them jammed.

    """
    values = {
        "contact": controller.phase.value,
        "mode": controller.mode.value,
        "state": controller.state.value,
        **{
            f"wanted vacuum, {channel} (Pa)": f"{vacuum_pa:.0f}"
            for channel, vacuum_pa in controller.set_points_pa.items()
        },
    }
    landing = controller.landing
    if landing is not None:
        values |= {
            "landing, expected speed (m/s)": f"{landing.speed_m_s:.2f}",
            "landing, vacuum chosen (Pa)": f"{landing.chosen_pa:.0f}",
            "landing, vacuum reached (Pa)": f"{landing.reached_pa:.0f}",
            "landing, why": landing.why,
        }
    if not auto:
        return Health("policy", Level.OK, f"automatic jamming is off; {WAY_BACK}", values)
    if trouble:
        return Health("policy", Level.ERROR, f"automatic: {controller.state.value}, but {trouble}", values)
    if controller.state is PolicyState.FAULT:
        return Health("policy", Level.ERROR, f"fault: nothing shows contact; {SAFE_MODE}", values)
    what = controller.state.value if controller.mode is PolicyMode.AUTO else controller.mode.value
    if by_hand:
        what += f"; vented by a service: {', '.join(by_hand)}, until the policy changes its set points; {WAY_BACK}"
    return Health("policy", Level.OK, f"automatic: {what}", values)
