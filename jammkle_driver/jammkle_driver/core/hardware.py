"""The seam between the driver and what it drives: one command out, pressure samples in."""

from __future__ import annotations

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
        vacuum_pa: Pressure below ambient, Pa, gauge, positive; not finite where the sensor gave no number.
        stamp_s: When it was measured, s of the graph's clock.

    """

    place: str
    vacuum_pa: float
    stamp_s: float


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


class Hardware(Protocol):
    """A pump, its solenoids and its pressure sensors.

    An implementation hands every `PressureSample` to the function it was made with, from the node's own thread,
    and never blocks in `apply`.
    """

    def apply(self, command: ActuatorCommand) -> None:
        """Make the actuators do `command`; called on every change and several times a second as a sign of life."""

    def close(self) -> None:
        """Let go of the hardware; `apply` was called with the safe command before."""
