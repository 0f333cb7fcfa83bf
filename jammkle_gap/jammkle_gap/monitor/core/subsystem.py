"""Parts of an ankle that the monitor follows by themselves."""

import enum


class Subsystem(enum.Enum):
    """Parts of the ankle that can be looked at alone."""

    PNEUMATICS = "pneumatics"
    TENDON = "tendon"
    MECHANICS = "mechanics"
    SENSING = "sensing"
