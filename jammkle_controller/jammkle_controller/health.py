"""What the controller says of itself on /diagnostics."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_graph.health import Health, Level

if TYPE_CHECKING:
    from jammkle_controller.core.controller import AnkleController
    from jammkle_controller.core.freshness import Freshness
    from jammkle_controller.core.imu import StreamCounts

REMEMBERED_S = 5.0
"""How long trouble in the stream is shown after it ended, s."""


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
    """Tell whether the IMU's samples come in and are fit for use."""
    counts = controller.gate.counts
    values = {
        "rate (Hz)": f"{controller.gate.rate_hz:.0f}",
        "usable samples": str(counts.usable),
        "ignored, not finite": str(counts.not_finite),
        "ignored, repeated stamp": str(counts.repeated),
        "ignored, late": str(counts.late),
        "gaps": str(counts.gaps),
        "clock set back": str(counts.restarts),
        "silent for (s)": f"{freshness.silent_s:.2f}",
    }
    # Whole seconds: a message is sent anew when its text changes.
    silent = f"no usable sample on {topic} for {freshness.silent_s:.0f} s"
    seen = (
        f"{counts.not_finite} not finite, {counts.repeated} repeated, {counts.late} late, "
        f"{counts.gaps} gaps, {counts.restarts} restarts"
    )
    if freshness.stale:
        reason = f" ({counts.ignored} samples were ignored: {seen})" if trouble and counts.ignored else ""
        return Health("imu", Level.ERROR, f"{silent}{reason}; the last wish is kept", values)
    if freshness.paused:
        level = Level.OK if counts.usable else Level.WARN
        return Health("imu", level, "no samples, and the graph's clock stands still: paused", values)
    if not counts.usable:
        return Health("imu", Level.OK, f"waiting for the first sample on {topic}", values)
    if trouble:
        return Health("imu", Level.WARN, f"irregular samples: {seen}", values)
    return Health("imu", Level.OK, "samples come in", values)


def policy_health(controller: AnkleController, *, auto: bool, trouble: str) -> Health:
    """Tell what the policy wants, and whether it is heard.

    Args:
        controller: Whose policy it is.
        auto: Whether it is let decide.
        trouble: Why the driver does not follow, or would not; empty if it does.

    """
    values = {
        "contact": controller.phase.value,
        "mode": controller.mode.value,
        "wanted vacuum (Pa)": f"{controller.vacuum_pa:.0f}",
    }
    if not auto:
        return Health("policy", Level.OK, "automatic jamming is off; ~/set_auto turns it on", values)
    if trouble:
        return Health("policy", Level.ERROR, f"automatic: {controller.mode.value}, but {trouble}", values)
    return Health("policy", Level.OK, f"automatic: {controller.mode.value}", values)
