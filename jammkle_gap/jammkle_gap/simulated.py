"""How recordings are simulated again."""

from __future__ import annotations

import enum


class Simulated(enum.Enum):
    """What the simulator is fed with."""

    WHOLE = "whole"
    """The commands alone: everything else follows. One error runs on through all that comes after it."""
    PARTS = "parts"
    """Each part with what was measured at its inputs, so that an error stays where it is made."""
