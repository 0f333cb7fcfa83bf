"""The jamming policy as a table of states: soft for the shock, stiff for the stance, more for a slip."""

from __future__ import annotations

import dataclasses
import enum
from typing import TYPE_CHECKING

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.names import ACHILLES, CHANNELS, PERONEAL_LEFT, PERONEAL_RIGHT
from jammkle_controller.core.events import ContactEvent, ContactKind
from jammkle_controller.core.imu import REORDERING_LIMIT_S
from jammkle_controller.core.landing import (
    HALF_WAY_S,
    LEVEL_PA,
    Evacuation,
    Fall,
    Landing,
    LandingModel,
    Stored,
)
from jammkle_controller.parameters import PolicyMode

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_controller.parameters import ControllerParameters


class PolicyState(enum.Enum):
    """What the policy does."""

    SWING = "swing or flight"
    PREPARING = "preparing"
    LANDING = "landing"
    STANCE = "stance"
    SLIPPING = "slipping"
    RECOVERING = "recovering"
    FAULT = "fault"


class Trigger(enum.Enum):
    """What leads from one state to another."""

    LIFTOFF = "lift-off"
    FORESEEN = "touch-down foreseen within the time that the vacuum takes"
    FALLING = "the fall so far asks for vacuum, and a later start would come short of it"
    MISSED = "the foreseen touch-down did not come"
    TOUCHDOWN = "impact"
    SHOCK_OVER = "jam_delay_s over; at once where toes were hit and nothing was foreseen"
    SLIP = "slip"
    STOPPED = "no slip for 0.5 s"
    RECOVERED = "no slip for recover_s"
    INHERITED = "at rest, and held by a controller before"
    SHOWN = "contact is shown without a touch-down: by switch, load, efforts, gait at rest, or ~/set_contact"
    RESTED = "at rest for 1 s, and nothing shows that it hangs"
    LOST = "nothing shows contact"
    REGAINED_JAMMED = "contact is known again, jammed"
    REGAINED_SOFT = "contact is known again, soft"


class SetPoint(enum.Enum):
    """What a state wants of the tendons."""

    SOFT = "vented"
    CHOSEN = "what was chosen for this landing"
    HOLD = "hold_vacuum_pa; more if the landing asked for it"
    GRIP = "full_vacuum_pa, the side that slips first"
    KEEP = "what it was"


S, T = PolicyState, Trigger

SET_POINTS: Mapping[PolicyState, SetPoint] = {
    S.SWING: SetPoint.SOFT,
    S.PREPARING: SetPoint.CHOSEN,
    S.LANDING: SetPoint.CHOSEN,
    S.STANCE: SetPoint.HOLD,
    S.SLIPPING: SetPoint.GRIP,
    S.RECOVERING: SetPoint.GRIP,
    S.FAULT: SetPoint.KEEP,
}

MEANINGS: Mapping[PolicyState, str] = {
    S.SWING: "the foot is in the air, or nothing is known and it moves: ready for a landing",
    S.PREPARING: "touch-down is so near that evacuation must begin for the vacuum that is chosen for it",
    S.LANDING: "the foot has hit, and the shock passes",
    S.STANCE: "the foot stands, or rests and nothing shows that it hangs",
    S.SLIPPING: "the foot slides",
    S.RECOVERING: "the foot slid a moment ago",
    S.FAULT: "no input that shows contact is believed: a robot that stands goes on standing as it did",
}

TRANSITIONS: Mapping[tuple[PolicyState, Trigger], PolicyState] = {
    (S.SWING, T.FORESEEN): S.PREPARING,
    (S.SWING, T.FALLING): S.PREPARING,
    (S.SWING, T.TOUCHDOWN): S.LANDING,
    (S.SWING, T.SLIP): S.SLIPPING,
    (S.SWING, T.INHERITED): S.STANCE,
    (S.SWING, T.SHOWN): S.STANCE,
    (S.SWING, T.RESTED): S.STANCE,
    (S.SWING, T.LOST): S.FAULT,
    (S.PREPARING, T.TOUCHDOWN): S.LANDING,
    (S.PREPARING, T.MISSED): S.SWING,
    (S.PREPARING, T.SLIP): S.SLIPPING,
    (S.PREPARING, T.LIFTOFF): S.SWING,
    (S.PREPARING, T.LOST): S.FAULT,
    (S.LANDING, T.SHOCK_OVER): S.STANCE,
    (S.LANDING, T.SLIP): S.SLIPPING,
    (S.LANDING, T.LIFTOFF): S.SWING,
    (S.LANDING, T.LOST): S.FAULT,
    (S.STANCE, T.SLIP): S.SLIPPING,
    (S.STANCE, T.LIFTOFF): S.SWING,
    (S.STANCE, T.LOST): S.FAULT,
    (S.SLIPPING, T.STOPPED): S.RECOVERING,
    (S.SLIPPING, T.LIFTOFF): S.SWING,
    (S.SLIPPING, T.LOST): S.FAULT,
    (S.RECOVERING, T.SLIP): S.SLIPPING,
    (S.RECOVERING, T.RECOVERED): S.STANCE,
    (S.RECOVERING, T.LIFTOFF): S.SWING,
    (S.RECOVERING, T.LOST): S.FAULT,
    (S.FAULT, T.REGAINED_JAMMED): S.STANCE,
    (S.FAULT, T.REGAINED_SOFT): S.SWING,
}
"""Where a pair is missing, the state stays as it is."""


SLIP_OVER_S = 0.5
"""From the last slip to the state recovering, s: the pump takes as long to full vacuum."""
LONGEST_FALL_S = 0.3
"""Fall that is looked ahead to where a vacuum takes longer, s: 0.44 m."""
MISSED_S = 0.15
"""How late a foreseen touch-down may come, s: half a swing of a fast trot."""

_TRIGGERS = {
    ContactKind.IMPACT: Trigger.TOUCHDOWN,
    ContactKind.LIFTOFF: Trigger.LIFTOFF,
    ContactKind.SWING: Trigger.LIFTOFF,
    ContactKind.SLIP: Trigger.SLIP,
}


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

    What a landing needs is worked out by `landing.LandingModel`. Channels share one manifold, and a valve connects or
    vents, so that the vacuum at the touch-down is chosen by when evacuation begins: with what is stored the Achilles
    pair alone, which bears a landing on toes, else all, as channels that join later would draw from it. From then on it
    rises to what the stance holds. A foot that hangs flat is met soft.

    Time is that of the samples: it stands still while a simulation is paused, and runs as fast as the simulation does.

    Attributes:
        parameters: Of the node.
        state: What it does.
        landing: What was chosen for the latest landing; None before the first.
        borne_kg: What the foot is measured to bear; it counts if it is more than `load_kg` of the parameters.
        stored: What the driver says of manifold and reservoir.

    """

    def __init__(self, parameters: ControllerParameters) -> None:
        """Start soft."""
        self.parameters = parameters
        self.state = PolicyState.SWING
        self._since_ns = 0
        self._now_ns: int | None = None
        self._kept: Mapping[str, float] = dict.fromkeys(CHANNELS, 0.0)
        self._first: tuple[str, ...] = ()
        self._touchdown_ns: int | None = None
        self._fall: Fall | None = None
        self._braced: tuple[str, ...] = ()
        self._goes_full = False
        self._begun_ns: int | None = None
        self._given_up_ns: int | None = None
        self.borne_kg = 0.0
        self.stored = Stored()
        self.landing: Landing | None = None

    @property
    def set_points_pa(self) -> Mapping[str, float]:
        """Vacuum wanted per channel, Pa, gauge, positive; 0 is vented."""
        parameters = self.parameters
        fixed_pa = self._fixed_pa
        if parameters.mode in (PolicyMode.ALWAYS_SOFT, PolicyMode.ALWAYS_JAMMED):
            return dict.fromkeys(CHANNELS, fixed_pa or 0.0)
        chosen_pa = self._chosen_pa if fixed_pa is None else dict.fromkeys(CHANNELS, fixed_pa)
        gripping = self._first or CHANNELS
        wanted: Mapping[SetPoint, Mapping[str, float]] = {
            SetPoint.SOFT: dict.fromkeys(CHANNELS, fixed_pa or 0.0),
            SetPoint.CHOSEN: chosen_pa,
            SetPoint.HOLD: dict.fromkeys(CHANNELS, max(parameters.hold_vacuum_pa, *chosen_pa.values())),
            SetPoint.GRIP: {name: parameters.full_vacuum_pa * (name in gripping) for name in CHANNELS},
            SetPoint.KEEP: self._kept,
        }
        return wanted[SET_POINTS[self.state]]

    @property
    def _chosen_pa(self) -> Mapping[str, float]:
        """What was chosen for this landing, Pa, by the parameters as they are now."""
        vacuum_pa = self.parameters.full_vacuum_pa if self._goes_full else self.parameters.hold_vacuum_pa
        return {channel: vacuum_pa if channel in self._braced else 0.0 for channel in CHANNELS}

    @property
    def _fixed_pa(self) -> float | None:
        """Vacuum with which a baseline meets every landing, Pa; None: it is chosen."""
        return {
            PolicyMode.ALWAYS_SOFT: 0.0,
            PolicyMode.ALWAYS_JAMMED: self.parameters.hold_vacuum_pa,
            PolicyMode.FIXED: self.parameters.landing_vacuum_pa,
        }.get(self.parameters.mode)

    def advance(self, time_ns: int) -> None:
        """Take the stamp of the sample at hand, before its events; takes what is due by time alone."""
        before_ns, self._now_ns = self._now_ns, time_ns
        if before_ns is not None and time_ns < before_ns:
            # The clock was set back. What is held stays held: on a real slope, letting go would be the worse error.
            self._since_ns += time_ns - before_ns
            if before_ns - time_ns > _nanoseconds(REORDERING_LIMIT_S):  # less: an IMU that was silent comes late again
                self._touchdown_ns = self._fall = self._given_up_ns = None
                self._take(Trigger.MISSED)  # nobody knows any more when what is prepared would come
        parameters, since_ns = self.parameters, time_ns - self._since_ns
        if self.state is PolicyState.LANDING and since_ns >= _nanoseconds(parameters.jam_delay_s):
            self._take(Trigger.SHOCK_OVER)
        elif self.state is PolicyState.SLIPPING:
            if self._first and since_ns >= _nanoseconds(parameters.side_first_s):
                self._first = ()
            if since_ns >= _nanoseconds(SLIP_OVER_S):
                self._take(Trigger.STOPPED)
        elif self.state is PolicyState.RECOVERING and since_ns >= _nanoseconds(parameters.recover_s):
            self._take(Trigger.RECOVERED)
        if self._fall is not None:
            self._brace(self._fall, time_ns)
        elif self._touchdown_ns is not None:
            self._prepare(self._touchdown_ns - time_ns)

    def _prepare(self, ahead_ns: int) -> None:
        """Begin to evacuate for a touch-down that is foreseen, or give it up."""
        missed = ahead_ns < -_nanoseconds(MISSED_S)
        # A foot is put down slowly, so that it may be met soft: its fibres begin to grip as it touches.
        lead_s = min(self._air(CHANNELS).until_s(LandingModel().onset_pa), LONGEST_FALL_S)
        if self.state is PolicyState.SWING and not missed and ahead_ns <= _nanoseconds(lead_s):
            self._choose(CHANNELS)
            self._take(Trigger.FORESEEN)
        elif self.state is PolicyState.PREPARING and missed:
            self._given_up_ns, self._touchdown_ns = self._touchdown_ns, None
            self._take(Trigger.MISSED)

    def foresee(self, touchdown_ns: int) -> None:
        """Take when the next touch-down is expected, ns. One that is prepared is waited for first."""
        if self.state is not PolicyState.PREPARING:
            self._touchdown_ns = touchdown_ns

    def fall(self, begin_ns: int) -> None:
        """Take that the body has been falling freely since a time, ns: no plan counts until it lands."""
        parameters = self.parameters
        if self._fall is None and parameters.takes_blows and self.state in (PolicyState.SWING, PolicyState.PREPARING):
            mass_kg, travel = max(parameters.load_kg, self.borne_kg), parameters.landing_travel_m
            self._fall = Fall(begin_ns, mass_kg, travel, parameters.full_vacuum_pa, self._air(self._able))

    @property
    def _able(self) -> tuple[str, ...]:
        """Channels that are evacuated for the landing of a fall."""
        full = self.stored.reservoir_m3 > 0.0 and self.stored.vacuum_pa >= self.parameters.hold_vacuum_pa
        return (ACHILLES,) if full else CHANNELS

    def _air(self, channels: tuple[str, ...]) -> Evacuation:
        return Evacuation.of(self.stored, achilles_alone=channels == (ACHILLES,))

    def _brace(self, fall: Fall, time_ns: int) -> None:
        """Begin to evacuate, or go for more, as the fall asks for it."""
        parameters = self.parameters
        if self.state is PolicyState.SWING and fall.must_begin(time_ns):
            self._choose(self._able)
            self._take(Trigger.FALLING)
        if self.state is PolicyState.PREPARING and not self._goes_full:
            ahead_ns = _nanoseconds(min(fall.air.until_s(parameters.hold_vacuum_pa), LONGEST_FALL_S))
            if fall.needed_pa(time_ns + ahead_ns - _nanoseconds(HALF_WAY_S)) > parameters.hold_vacuum_pa:
                self._goes_full = True

    def _choose(self, channels: tuple[str, ...]) -> None:
        """Begin to evacuate channels for a landing; those that have begun go on."""
        if self._begun_ns is None:
            self._begun_ns = self._now_ns
        self._braced = self._braced or channels

    def _note_landing(self, time_ns: int) -> None:
        """Note what a touch-down finds, and make up for what could not be known or reached."""
        parameters = self.parameters
        if self._fall is not None:
            self.landing = self._fall.landing(time_ns, self._begun_ns)
            if self.landing.reached_pa < self.landing.chosen_pa - LEVEL_PA:
                self._braced, self._goes_full = CHANNELS, True
        elif self._begun_ns is not None:
            reached_pa = self._air(CHANNELS).after_pa((time_ns - self._begun_ns) / NANOSECONDS_PER_SECOND)
            why = "foreseen by the gait or its rhythm"
            self.landing = Landing(0.0, LandingModel().onset_pa, reached_pa, why, time_ns=time_ns)
        else:
            then = "met as it was, and jammed at once" if parameters.takes_blows else "met as it was"
            why = f"{self._what_was_foreseen(time_ns)}: {then}"
            self.landing = Landing(0.0, 0.0, 0.0, why, surprised=True, time_ns=time_ns)
        fixed_pa = self._fixed_pa
        if fixed_pa is not None:
            why = f"policy is {parameters.mode.value}: the vacuum is the same for every landing"
            self.landing = dataclasses.replace(self.landing, chosen_pa=fixed_pa, reached_pa=fixed_pa, why=why)
        self._fall = self._touchdown_ns = self._given_up_ns = None

    def _what_was_foreseen(self, time_ns: int) -> str:
        """Say what was foreseen of a touch-down that nothing was prepared for."""
        foreseen_ns = self._given_up_ns if self._touchdown_ns is None else self._touchdown_ns
        if foreseen_ns is None:
            return "nothing foresaw it" if self.parameters.takes_blows else "a foot that hangs flat has no way to give"
        by_ms = 1e3 * (time_ns - foreseen_ns) / NANOSECONDS_PER_SECOND
        early_or_late = "later" if by_ms > 0.0 else "earlier"
        return f"{abs(by_ms):.0f} ms {early_or_late} than the gait or its rhythm foresaw"

    def take_up(self, why: Trigger) -> None:
        """Hold without a touch-down: INHERITED, SHOWN or RESTED. In a fault what is kept becomes a stance's vacuum."""
        if self.state is PolicyState.FAULT:
            self._kept = dict.fromkeys(CHANNELS, self.parameters.hold_vacuum_pa)
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
            soft = not any(self.set_points_pa.values())
            if self.state is PolicyState.SLIPPING:
                self._since_ns = event.time_ns
            elif soft and self.parameters.side_first_s > 0.0:
                self._first = loaded_channels(event.direction)
        surprised = False
        if trigger is Trigger.TOUCHDOWN and self.state in (PolicyState.SWING, PolicyState.PREPARING):
            self._note_landing(event.time_ns)
            surprised = self.landing is not None and self.landing.surprised and self.parameters.takes_blows
        elif trigger in (Trigger.TOUCHDOWN, Trigger.LIFTOFF):
            self._touchdown_ns = None
        self._take(trigger)
        if self.state is PolicyState.LANDING and (surprised or _nanoseconds(self.parameters.jam_delay_s) == 0):
            self._take(Trigger.SHOCK_OVER)

    def lose(self) -> None:
        """Nothing that shows contact is believed: keep what is wanted now."""
        self._kept = dict(self.set_points_pa)
        self._take(Trigger.LOST)

    def regain(self) -> None:
        """Something shows contact again."""
        self._take(Trigger.REGAINED_JAMMED if any(self._kept.values()) else Trigger.REGAINED_SOFT)

    def _take(self, trigger: Trigger) -> None:
        following = TRANSITIONS.get((self.state, trigger))
        if following is None:
            return
        if trigger is Trigger.LIFTOFF:
            self._given_up_ns = None
        if following is PolicyState.SWING:
            self._fall = self._begun_ns = None
            self._braced, self._goes_full = (), False
        if following is not PolicyState.SLIPPING and following is not PolicyState.RECOVERING:
            self._first = ()
        self.state = following
        self._since_ns = self._now_ns or 0


def _nanoseconds(time_s: float) -> int:
    return round(time_s * NANOSECONDS_PER_SECOND)
