"""The jamming policy: soft for the shock, stiff for the stance, more for a slip. Its table stands in `transitions`."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.names import ACHILLES, CHANNELS, PERONEAL_LEFT, PERONEAL_RIGHT
from jammkle_controller.core.events import ContactEvent, ContactKind
from jammkle_controller.core.transitions import TRANSITIONS, WISHES, PolicyState, Trigger, Wish

if TYPE_CHECKING:
    from collections.abc import Mapping

MISSED_S = 0.15
"""How late a foreseen touch-down may come, s: half a swing of a fast trot."""

_TRIGGERS = {
    ContactKind.IMPACT: Trigger.TOUCHDOWN,
    ContactKind.LIFTOFF: Trigger.LIFTOFF,
    ContactKind.SWING: Trigger.LIFTOFF,
    ContactKind.SLIP: Trigger.SLIP,
}


class PolicyMode(enum.Enum):
    """What automatic jamming does. Manual is without it (`~/set_auto`)."""

    AUTO = "auto"
    """By what is felt."""
    ALWAYS_SOFT = "always_soft"
    """Vented, whatever is felt: a baseline."""
    ALWAYS_JAMMED = "always_jammed"
    """Held, whatever is felt: a baseline."""


@dataclass(frozen=True)
class PolicySettings:
    """What the policy decides with.

    Attributes:
        mode: Auto, or one of the baselines.
        jam_delay_s: From an impact to jamming, s.
        jam_lead_s: How long before a foreseen touch-down jamming begins, s.
        hold_vacuum_pa: Vacuum of a stance, Pa, gauge, positive.
        full_vacuum_pa: Vacuum of a slip, Pa, gauge, positive.
        side_first_s: How long the side that slips is jammed alone where nothing is jammed yet, s.
        slip_hold_s: From the last slip to recovering, s.
        recover_s: From there to the vacuum of a stance, s.

    """

    mode: PolicyMode
    jam_delay_s: float
    jam_lead_s: float
    hold_vacuum_pa: float
    full_vacuum_pa: float
    side_first_s: float
    slip_hold_s: float
    recover_s: float


def loaded_channels(direction: tuple[float, float, float]) -> tuple[str, ...]:
    """Return the channels whose tendons friction stretches on a foot that slides this way.

    Axes as in REP-103: x forward, y left. Friction -d acts on the sole below the joint, at r = -h z: its moment r x F
    is h (z x d). Sliding to the left it rolls the foot onto its left edge, away from the left peroneal; sliding back it
    lifts the toe, which the Achilles pair holds; sliding forward no tendon of this ankle holds better than the others.
    """
    x, y, _ = direction
    if abs(y) > abs(x):
        return (PERONEAL_LEFT,) if y > 0.0 else (PERONEAL_RIGHT,)
    return (ACHILLES,) if x < 0.0 else CHANNELS


class JammingPolicy:
    """Decides on one vacuum per channel from contact events and the stamps of samples.

    The shock of 1.8 kg dropped by 50 mm on a 40 deg slope peaks 0 to 10 ms after contact in simulation, whatever the
    delay: the fibres begin to grip (8.5 kPa) only 36 to 44 ms after the command. A delay of 20 ms leaves a faster pump
    and a slower shock room; a touch-down that is foreseen may be jammed for 30 ms ahead of it and is still met soft.

    Time is that of the samples: it stands still while a simulation is paused, and runs as fast as the simulation does.
    """

    def __init__(self, settings: PolicySettings) -> None:
        """Start soft."""
        self.settings = settings
        self.state = PolicyState.SWING
        self._since_ns = 0
        self._now_ns: int | None = None
        self._kept: Mapping[str, float] = dict.fromkeys(CHANNELS, 0.0)
        self._first: tuple[str, ...] = ()
        self._touchdown_ns: int | None = None

    @property
    def wish(self) -> Mapping[str, float]:
        """Vacuum wanted per channel, Pa, gauge, positive; 0 is vented."""
        settings = self.settings
        if settings.mode is PolicyMode.ALWAYS_SOFT:
            return dict.fromkeys(CHANNELS, 0.0)
        if settings.mode is PolicyMode.ALWAYS_JAMMED:
            return dict.fromkeys(CHANNELS, settings.hold_vacuum_pa)
        wish = WISHES[self.state]
        if wish is Wish.KEEP:
            return self._kept
        if wish is Wish.GRIP:
            return {
                channel: settings.full_vacuum_pa if not self._first or channel in self._first else 0.0
                for channel in CHANNELS
            }
        return dict.fromkeys(CHANNELS, settings.hold_vacuum_pa if wish is Wish.HOLD else 0.0)

    def advance(self, time_ns: int) -> None:
        """Tell the stamp of the sample at hand, before its events; takes what is due by time alone."""
        if self._now_ns is not None and time_ns < self._now_ns:
            # The clock was set back. What is held stays held: on a real slope, letting go would be the worse error.
            self._since_ns += time_ns - self._now_ns
            self._touchdown_ns = None
        self._now_ns = time_ns
        settings, since_ns = self.settings, time_ns - self._since_ns
        if self.state is PolicyState.LANDING and since_ns >= _nanoseconds(settings.jam_delay_s):
            self._take(Trigger.SHOCK_OVER)
        elif self.state is PolicyState.SLIPPING:
            if self._first and since_ns >= _nanoseconds(settings.side_first_s):
                self._first = ()
            if since_ns >= _nanoseconds(settings.slip_hold_s):
                self._take(Trigger.STOPPED)
        elif self.state is PolicyState.RECOVERING and since_ns >= _nanoseconds(settings.recover_s):
            self._take(Trigger.RECOVERED)
        if self._touchdown_ns is not None:
            ahead_ns = self._touchdown_ns - time_ns
            missed = ahead_ns < -_nanoseconds(MISSED_S)
            if self.state is PolicyState.SWING and not missed and ahead_ns <= _nanoseconds(settings.jam_lead_s):
                self._take(Trigger.FORESEEN)
            elif self.state is PolicyState.PREPARING and missed:
                self._touchdown_ns = None
                self._take(Trigger.MISSED)

    def foresee(self, touchdown_ns: int | None) -> None:
        """Take when the next touch-down is expected, ns; None: not known. One that is prepared is waited for first."""
        if self.state is not PolicyState.PREPARING or touchdown_ns is None:
            self._touchdown_ns = touchdown_ns

    def take_up(self, why: Trigger) -> None:
        """Hold without a touch-down: INHERITED, SHOWN or RESTED. In a fault what is kept becomes a stance's vacuum."""
        if self.state is PolicyState.FAULT:
            self._kept = dict.fromkeys(CHANNELS, self.settings.hold_vacuum_pa)
        self._take(why)

    def let_go(self) -> None:
        """Vent without a lift-off that was felt, in a fault, too."""
        if self.state is PolicyState.FAULT:
            self._kept = dict.fromkeys(CHANNELS, 0.0)
        self._touchdown_ns = None
        self._take(Trigger.LIFTOFF)

    def react(self, event: ContactEvent) -> None:
        """Take one contact event."""
        trigger = _TRIGGERS.get(event.kind)
        if trigger is None:
            return
        if trigger is Trigger.SLIP:
            soft = not any(self.wish.values())
            if self.state is PolicyState.SLIPPING:
                self._since_ns = event.time_ns
            elif soft and self.settings.side_first_s > 0.0:
                self._first = loaded_channels(event.direction)
        if trigger in (Trigger.TOUCHDOWN, Trigger.LIFTOFF):
            self._touchdown_ns = None
        self._take(trigger)
        if self.state is PolicyState.LANDING and _nanoseconds(self.settings.jam_delay_s) == 0:
            self._take(Trigger.SHOCK_OVER)

    def lose(self) -> None:
        """Nothing that shows contact is believed: keep what is wanted now."""
        self._kept = dict(self.wish)
        self._take(Trigger.LOST)

    def regain(self) -> None:
        """Something shows contact again."""
        self._take(Trigger.REGAINED_JAMMED if any(self._kept.values()) else Trigger.REGAINED_SOFT)

    def _take(self, trigger: Trigger) -> None:
        following = TRANSITIONS.get((self.state, trigger))
        if following is None:
            return
        if following is not PolicyState.SLIPPING and following is not PolicyState.RECOVERING:
            self._first = ()
        self.state = following
        self._since_ns = self._now_ns or 0


def _nanoseconds(time_s: float) -> int:
    return round(time_s * NANOSECONDS_PER_SECOND)
