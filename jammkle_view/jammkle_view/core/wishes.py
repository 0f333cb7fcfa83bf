"""What somebody asks for on the page. Who carries it out does so by the graph's own services and parameters."""

from __future__ import annotations

import enum
from dataclasses import dataclass


@dataclass(frozen=True)
class Jam:
    """Jam channels of an ankle to a vacuum; no channel named means all."""

    ankle: str
    channels: tuple[str, ...]
    vacuum_pa: float


@dataclass(frozen=True)
class Unjam:
    """Vent channels of an ankle; no channel named means all."""

    ankle: str
    channels: tuple[str, ...]


class Action(enum.Enum):
    """What else an ankle's nodes can be asked for."""

    TELL_SPEED = "tell how fast the simulation is to run"

    AUTO_ON = "let the controller decide"
    AUTO_OFF = "let nobody but the page decide"
    EMERGENCY_STOP = "emergency stop"
    CLEAR_FAULT = "clear fault"
    PAUSE = "pause"
    GO_ON = "go on"
    RESET = "reset"


@dataclass(frozen=True)
class Ask:
    """Ask an ankle's nodes for something."""

    ankle: str
    action: Action


@dataclass(frozen=True)
class SetSim:
    """Set a parameter of the simulation."""

    ankle: str
    name: str
    value: float


Wish = Jam | Unjam | Ask | SetSim
