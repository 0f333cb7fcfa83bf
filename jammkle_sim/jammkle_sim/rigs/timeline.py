"""Commands over time, and what they make of pump and valves in every time step, between two steps included."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

_ON_THE_GRID = 1e-6
"""Share of a time step within which a time counts as the step's own, so that rounded stamps make no shares."""


@dataclass(frozen=True)
class Timeline:
    """A value that stays until the next one; 0 before the first."""

    time_s: NDArray[np.float64]
    """When each value begins, since the start of the rig, rising, shape (n,), s."""
    values: NDArray[np.float64]
    """Shape (n,)."""

    def at(self, time_s: float) -> float:
        """Return the value at a time."""
        place = int(np.searchsorted(self.time_s, time_s, side="right"))
        return float(self.values[place - 1]) if place else 0.0

    def later(self, delay_s: float) -> Timeline:
        """Return the same, delayed."""
        return Timeline(self.time_s + delay_s, self.values)

    def changes(self) -> Timeline:
        """Return the same without values that only repeat the one before."""
        changed = np.diff(np.concatenate(([0.0], self.values))) != 0.0
        return Timeline(self.time_s[changed], self.values[changed])

    def means(self, timestep_s: float, steps: int) -> NDArray[np.float64]:
        """Return the mean value within each of the first steps, shape (steps,)."""
        place = self.time_s / timestep_s
        place = np.where(np.abs(place - np.round(place)) < _ON_THE_GRID, np.round(place), place)
        values = np.concatenate(([0.0], self.values))
        means: NDArray[np.float64] = values[np.searchsorted(place, np.arange(steps), side="right")]
        for i in np.flatnonzero((place != np.floor(place)) & (place > 0.0) & (place < steps)).tolist():
            change = values[i + 1] - values[i]
            step = int(place[i])
            means[step] += (step + 1 - place[i]) * change
        return means


def valve_timeline(command: Timeline, dead_time_s: float, timestep_s: float) -> Timeline:
    """Return when a solenoid moves, 1 for energised, from what it is told.

    It follows its command after the dead time, counted as the simulation's steps count it; a command taken back before
    that has no effect. Without steps it would be: after `dead_time_s` less one time step.

    Args:
        command: 0 or 1.
        dead_time_s: From command to movement, s.
        timestep_s: Time step, s.

    """
    command = command.changes()  # a repeated command is none: it does not begin the dead time anew
    wait_s = max(dead_time_s - timestep_s, 0.0)
    ends_s = np.append(command.time_s[1:], np.inf)
    obeyed = ends_s > command.time_s + wait_s + _ON_THE_GRID * timestep_s
    return Timeline(command.time_s[obeyed] + wait_s, command.values[obeyed]).changes()
