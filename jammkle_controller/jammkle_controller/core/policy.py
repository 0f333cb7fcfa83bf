"""The jamming policy: soft for the shock, stiff for the stance."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from jammkle_controller.core.events import ContactEvent, ContactKind
from jammkle_graph.constants import NANOSECONDS_PER_SECOND


class JamMode(enum.Enum):
    """What the policy wants of the tendons."""

    SOFT = "soft"
    """Vented, ready for a landing."""
    WAITING = "waiting for the shock to pass"
    """Vented; the foot has hit, and jamming follows after the delay."""
    HOLDING = "holding"
    """Jammed for the stance."""
    GRIPPING = "gripping"
    """Jammed at full vacuum, because the foot slid."""


@dataclass(frozen=True)
class PolicySettings:
    """Delay from impact to jam, s, and the vacuum of a stance and of a slip, Pa, gauge, positive."""

    jam_delay_s: float
    hold_vacuum_pa: float
    full_vacuum_pa: float


class JammingPolicy:
    """Decides on one vacuum for all channels from contact events and the stamps of IMU samples.

    A landing loads all four tendons of the ankle, so the channels are jammed together. The shock of 1.8 kg dropped
    by 50 mm on a 40 deg slope peaks 0 to 10 ms after contact in simulation, whatever the delay: the fibres begin to
    grip (8.5 kPa) only 36 to 44 ms after the command. A delay of 20 ms leaves a faster pump and a slower shock room,
    and costs a twentieth of the time to full vacuum.

    Time is that of the samples:
    it stands still while a simulation is paused, and runs as fast as the simulation does.
    """

    def __init__(self, settings: PolicySettings) -> None:
        """Start soft."""
        self.settings = settings
        self.mode = JamMode.SOFT
        self._impact_ns = 0
        self._now_ns: int | None = None

    @property
    def vacuum_pa(self) -> float:
        """Vacuum wanted in every channel, Pa, gauge, positive; 0 is vented."""
        if self.mode is JamMode.HOLDING:
            return self.settings.hold_vacuum_pa
        if self.mode is JamMode.GRIPPING:
            return self.settings.full_vacuum_pa
        return 0.0

    def advance(self, time_ns: int) -> None:
        """Tell the stamp of the sample at hand, before its events; jams when the delay has passed."""
        if self._now_ns is not None and time_ns < self._now_ns:
            # The clock was set back. What is held stays held: on a real slope, letting go would be the worse error.
            self._impact_ns += time_ns - self._now_ns
        self._now_ns = time_ns
        if self.mode is JamMode.WAITING:
            self._jam_when_due(time_ns)

    def take_up(self) -> None:
        """Hold, because somebody before has held this stance."""
        if self.mode is JamMode.SOFT:
            self.mode = JamMode.HOLDING

    def react(self, event: ContactEvent) -> None:
        """Take one contact event."""
        if event.kind is ContactKind.LIFTOFF:
            self.mode = JamMode.SOFT
        elif event.kind is ContactKind.SLIP:
            self.mode = JamMode.GRIPPING
        elif event.kind is ContactKind.IMPACT and self.mode is JamMode.SOFT:
            self.mode = JamMode.WAITING
            self._impact_ns = event.time_ns
            self._jam_when_due(event.time_ns)

    def _jam_when_due(self, now_ns: int) -> None:
        if now_ns - self._impact_ns >= round(self.settings.jam_delay_s * NANOSECONDS_PER_SECOND):
            self.mode = JamMode.HOLDING
