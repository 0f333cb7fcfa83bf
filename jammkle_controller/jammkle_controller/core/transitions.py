"""The jamming policy as a table: states, what leads from one to the next, and what each wants of the tendons."""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping


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
    FORESEEN = "touch-down foreseen within jam_lead_s"
    MISSED = "the foreseen touch-down did not come"
    TOUCHDOWN = "impact"
    SHOCK_OVER = "jam_delay_s over"
    SLIP = "slip"
    STOPPED = "no slip for slip_hold_s"
    RECOVERED = "no slip for recover_s"
    INHERITED = "at rest, and held by a controller before"
    SHOWN = "contact is shown without a touch-down: by switch, load, efforts, gait at rest, or ~/set_contact"
    RESTED = "at rest for 1 s, and nothing shows that it hangs"
    LOST = "nothing shows contact"
    REGAINED_JAMMED = "contact is known again, jammed"
    REGAINED_SOFT = "contact is known again, soft"


class Wish(enum.Enum):
    """What a state wants of the tendons."""

    SOFT = "vented"
    HOLD = "hold_vacuum_pa"
    GRIP = "full_vacuum_pa, the side that slips first"
    KEEP = "what it was"


S, T = PolicyState, Trigger

WISHES: Mapping[PolicyState, Wish] = {
    S.SWING: Wish.SOFT,
    S.PREPARING: Wish.HOLD,
    S.LANDING: Wish.SOFT,
    S.STANCE: Wish.HOLD,
    S.SLIPPING: Wish.GRIP,
    S.RECOVERING: Wish.GRIP,
    S.FAULT: Wish.KEEP,
}

MEANINGS: Mapping[PolicyState, str] = {
    S.SWING: "the foot is in the air, or nothing is known and it moves: ready for a landing",
    S.PREPARING: "touch-down is so near that fibres which are evacuated from now on grip only after the shock",
    S.LANDING: "the foot has hit, and the shock passes",
    S.STANCE: "the foot stands, or rests and nothing shows that it hangs",
    S.SLIPPING: "the foot slides",
    S.RECOVERING: "the foot slid a moment ago",
    S.FAULT: "no input that shows contact is believed: a robot that stands goes on standing as it did",
}

TRANSITIONS: Mapping[tuple[PolicyState, Trigger], PolicyState] = {
    (S.SWING, T.FORESEEN): S.PREPARING,
    (S.SWING, T.TOUCHDOWN): S.LANDING,
    (S.SWING, T.SLIP): S.SLIPPING,
    (S.SWING, T.INHERITED): S.STANCE,
    (S.SWING, T.SHOWN): S.STANCE,
    (S.SWING, T.RESTED): S.STANCE,
    (S.SWING, T.LOST): S.FAULT,
    (S.PREPARING, T.TOUCHDOWN): S.STANCE,
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
