"""The seam between the driver and what it drives: one command out, pressure samples and the state of the link in."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping

MANIFOLD = "manifold"
"""Name under which the manifold's own pressure sensor reports, beside the channels."""


@dataclass(frozen=True)
class PressureSample:
    """One reading of one pressure sensor.

    Attributes:
        place: Name of a channel, or `MANIFOLD`.
        pressure_pa: What was measured, Pa absolute; not finite where the sensor gave no number. Of a sensor that
            measures vacuum, the declared pressure of the atmosphere less that: the driver finds the true one itself.
        stamp_s: When it was measured, s: of the graph's clock from a simulation, else of the steady clock.
        counted: Whether it was counted from the declared pressure of the atmosphere: a sensor of vacuum.
        timely: Whether `stamp_s` is as sure as usual; else it regulates, and is no evidence of a fault.

    """

    place: str
    pressure_pa: float
    stamp_s: float
    counted: bool = False
    timely: bool = True


@dataclass(frozen=True)
class ActuatorCommand:
    """What all actuators of one ankle shall do now.

    Attributes:
        solenoids: Per channel, True = energised = connected to the manifold, False = vented.
        pump_duty: Share of the pump's full power, 0 to 1.

    """

    solenoids: Mapping[str, bool]
    pump_duty: float


def released(channels: tuple[str, ...]) -> ActuatorCommand:
    """Return the safe command: every channel vented, the pump off."""
    return ActuatorCommand(dict.fromkeys(channels, False), 0.0)


class LinkState(enum.Enum):
    """Whether somebody at the other end answers."""

    SEARCHING = "searching"
    """Nobody has answered yet; tried again and again."""
    CONNECTED = "connected"
    """Commands are acknowledged and sensors are read."""
    LOST = "lost"
    """Somebody has answered before and does no longer, as after an unplug; tried again and again."""


class SafeCause(enum.Enum):
    """Why a board has gone to its safe state by itself. Latched there until it is acknowledged."""

    HOST_SILENT = "no fresh command for watchdog_ms, or 0.2 s where the board has none"
    SUPPLY_LOW = "the supply fell below supply_minimum"
    RESET = "the board has started anew"


class ResetCause(enum.Enum):
    """What has last reset a board."""

    POWER_ON = "power-on"
    EXTERNAL = "reset pin"
    BROWN_OUT = "brown-out"
    WATCHDOG = "its own watchdog"
    UNKNOWN = "unknown"


class BoardFault(enum.Enum):
    """What a board finds wrong with itself now; not latched."""

    SUPPLY_LOW = "supply too low"
    CALIBRATION_LOST = "no valid calibration stored: the default one is in use"


@dataclass(frozen=True)
class LinkStatus:
    """What is known of the hardware's other end and of the way there.

    Attributes:
        state: See `LinkState`.
        detail: One line for people: what is connected, or what is tried and why it fails.
        starts: How often the board was seen to have started: it goes up by one when it was rebooted.
        reset_cause: What has last reset the board; None where it does not say.
        latched: Why the board has gone to its safe state and takes no jam until `Hardware.acknowledge`.
        faults: What the board finds wrong now.
        supply_v: Voltage of the supply, V; None where it is not measured.
        connects: How often the link came up.
        exchanges: Requests that were answered; 0 for ever of hardware that is not asked but speaks by itself.
        crc_errors: Frames that either end threw away because their check sum was wrong.
        timeouts: Requests that nobody answered in time.
        refusals: Requests that the board refused.
        rate_hz: Rate at which outputs and all sensors are exchanged; None where it is not known.
        plant_restarts: How often what is behind the outputs was put back to its start, as a simulation is.
        paused: Whether what is behind the outputs stands still although the clock may go on, as a simulation may.

    """

    state: LinkState
    detail: str = ""
    starts: int = 0
    reset_cause: ResetCause | None = None
    latched: frozenset[SafeCause] = frozenset()
    faults: frozenset[BoardFault] = frozenset()
    supply_v: float | None = None
    connects: int = 0
    exchanges: int = 0
    crc_errors: int = 0
    timeouts: int = 0
    refusals: int = 0
    rate_hz: float | None = None
    plant_restarts: int = 0
    paused: bool = False


class Hardware(Protocol):
    """A pump, its solenoids and its pressure sensors.

    An implementation hands every `PressureSample` to the function it was made with, from the node's own thread. None
    of its methods blocks. It gives signs of life to the board only while `apply` is called: a driver that hangs must
    look dead from there, or, where the board has no watchdog, be let go of by what of it still lives.
    """

    @property
    def link(self) -> LinkStatus:
        """What is known of the other end now."""

    def apply(self, command: ActuatorCommand) -> None:
        """Make the actuators do `command`; called on every change and several times a second as a sign of life."""

    def acknowledge(self) -> None:
        """Let a board that has latched its safe state take jams again; called where nothing is jammed."""

    def close(self) -> None:
        """Let go of the hardware; `apply` was called with the safe command before, which shall still get out."""
