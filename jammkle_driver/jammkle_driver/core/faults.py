"""Why a channel, the ankle or the line to the board is not well: the reasons, in the order of jammkle_msgs."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping


class Reason(enum.Enum):
    """What is wrong; values as in jammkle_msgs/Fault (NONE is UNKNOWN there)."""

    NONE = 0
    LEAK = 1
    BLOCKED_LINE = 2
    VALVE_STUCK_OPEN = 3
    VALVE_STUCK_CLOSED = 4
    PUMP_DEAD = 5
    PUMP_WEAK = 6
    SENSOR_DEAD = 7
    SENSOR_STUCK = 8
    SENSOR_DRIFTING = 9
    SENSOR_OUT_OF_RANGE = 10
    BOARD_UNPLUGGED = 11
    BOARD_REBOOTED = 12
    BROWN_OUT = 13
    LINE_NOISE = 14
    COMMANDS_STALE = 15
    EXECUTOR_OVERLOADED = 16
    BOARD_LET_GO = 17
    NOT_REACHED = 18
    NOT_VENTED = 19


REMEDIES: dict[Reason, str] = {
    Reason.LEAK: "look at push-fits and membrane",
    Reason.BLOCKED_LINE: "look for a kinked hose or a clogged filter",
    Reason.VALVE_STUCK_OPEN: "look at the valve and its driver's transistor",
    Reason.VALVE_STUCK_CLOSED: "look at the valve, its plug and its hose",
    Reason.PUMP_DEAD: "look at the pump's supply and plug",
    Reason.PUMP_WEAK: "look at the pump's membrane, filter and supply",
    Reason.SENSOR_DEAD: "look at the sensor's plug",
    Reason.SENSOR_STUCK: "look at the sensor's hose and plug",
    Reason.SENSOR_DRIFTING: "calibrate the sensor, or change it",
    Reason.SENSOR_OUT_OF_RANGE: "look at the sensor's plug and supply",
    Reason.BOARD_UNPLUGGED: "look at cable and supply",
    Reason.BOARD_REBOOTED: "look at the supply",
    Reason.BROWN_OUT: "look at the supply",
    Reason.LINE_NOISE: "look at cable, shield and baud rate",
    Reason.NOT_REACHED: "look for a leak, a weak pump or a bad valve",
    Reason.NOT_VENTED: "look for a stuck valve",
}
"""What a person looks at first, by reason."""


@dataclass(frozen=True)
class Finding:
    """A fault that was found, or why something was let go (NONE where somebody asked for it, as by an emergency stop).

    The place is a channel, the manifold, or what else was looked at, such as the board. The text is one line: what was
    seen, with numbers, and what to look at. Values are numbers for people, with units in the key.
    """

    reason: Reason
    place: str
    text: str
    values: Mapping[str, str] = field(default_factory=dict)

    def to_clear(self) -> Finding:
        """Return the same with the word that it must be cleared, at its end."""
        return replace(self, text=f"{self.text}, then call ~/clear_fault")


def finding(reason: Reason, place: str, seen: str, values: Mapping[str, str], remedy: str = "") -> Finding:
    """Return a finding whose text begins with its place and ends with the remedy: the usual one where none is given."""
    remedy = remedy or REMEDIES.get(reason, "")
    return Finding(reason, place, f"{place} {seen}: {remedy}" if remedy else f"{place} {seen}", values)
