"""What somebody wants a rig to do, and how far it is: options from text, runs one after the other, figures."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_common import names
from jammkle_common.constants import MAX_REPEATS, MAX_SEED
from jammkle_common.parameters import ParameterError, from_mapping, rows
from jammkle_sim.core.schedule import Output
from jammkle_sim.rigs.catalogue import begin_run, rig_kind, scattered
from jammkle_sim.rigs.run import CONTROL_ROWS, IMU_PERIOD_S, STATE_ROWS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_common.parameters import ParameterClass, ParameterRow
    from jammkle_sim.rigs.run import RigRun, RunInProgress

_SEED = "seed"

_PERIODS = {
    Output.JOINT_STATES: (names.JOINT_STATES, STATE_ROWS),
    Output.TENDON_STATES: (names.TENDON_STATES, STATE_ROWS),
    Output.LOAD_CELL: (names.LOAD_CELL, STATE_ROWS),
    Output.IMU: (names.IMU, 1),
}
"""Topic, and rows of the IMU between two of its messages: the rates of a recorded run."""

_UNITS = {
    "m_s2": "m/s^2",
    "rad_s": "rad/s",
    "n_m": "N m",
    "m_s": "m/s",
    "rad": "rad",
    "deg": "deg",
    "kg": "kg",
    "pa": "Pa",
    "n": "N",
    "m": "m",
    "s": "s",
    "j": "J",
}
"""Unit by the end of a figure's name, longest first."""


@dataclass(frozen=True)
class Figure:
    """One figure over all runs."""

    name: str
    unit: str
    """Empty for a ratio or a count."""
    values: tuple[float, ...]
    """By run; NaN where a run has no such figure."""


class RigGoal:
    """Runs of one rig, one after the other."""

    def __init__(self, rig: str, texts: Sequence[str], repeats: int, seed: int) -> None:
        """Check what is wanted.

        Args:
            rig: Name in the catalogue.
            texts: Options that differ from their defaults, each "name=value".
            repeats: How many runs; 0 stands for 1.
            seed: Start of scatter and noise.

        Raises:
            ParameterError: an unknown rig or option, or a value out of range.

        """
        for text in (rig, *texts):
            if not text.isprintable():
                msg = f"{text!r} holds characters that cannot be printed; write rigs and options on one line"
                raise ParameterError(msg)
        kind = rig_kind(rig)
        if not 0 <= repeats <= MAX_REPEATS:
            msg = f"repeats is {repeats}; it must be 0 to {MAX_REPEATS}; send several goals for more"
            raise ParameterError(msg)
        if not 0 <= seed <= MAX_SEED:
            msg = f"seed is {seed}; it must be 0 to {MAX_SEED}"
            raise ParameterError(msg)
        self._rig = rig
        self._options = from_mapping(kind.options, {**_values(kind.options, texts), _SEED: seed})
        self._repeats = max(repeats, 1)
        self._begun = 0
        self._done: list[RigRun] = []

    @property
    def rig(self) -> str:
        """Name of the rig."""
        return self._rig

    @property
    def is_done(self) -> bool:
        """Whether every run is at its end."""
        return len(self._done) == self._repeats

    @property
    def place(self) -> str:
        """Which run it is, for people: `tensile, run 2 of 5`."""
        return f"{self._rig}, run {self._begun} of {self._repeats}"

    def begin(self) -> RunInProgress:
        """Start the next run.

        Raises:
            ParameterError: options that do not fit together.

        """
        repeat = self._begun
        self._begun += 1
        options = scattered(self._rig, self._options, repeat) if self._repeats > 1 else self._options
        return begin_run(self._rig, options)

    def keep(self, run: RigRun) -> None:
        """Take a finished run."""
        self._done.append(run)

    def share_done(self, share_of_run: float) -> float:
        """How much of the goal is done, 0 to 1, when so much of the present run is."""
        return min((len(self._done) + share_of_run) / self._repeats, 1.0)

    def figures(self) -> tuple[Figure, ...]:
        """Return everything that the finished runs measured."""
        found = dict.fromkeys(name for run in self._done for name in run.results)
        return tuple(
            Figure(name, unit_of(name), tuple(run.results.get(name, math.nan) for run in self._done)) for name in found
        )

    def torn(self) -> str:
        """Which tendons tore in which finished run, for people; empty if none did."""
        return "; ".join(f"{', '.join(run.broken)} in run {i + 1}" for i, run in enumerate(self._done) if run.broken)


class RigRows:
    """A run as the engine sees it: something that is taken forward in steps, here of one row of the IMU."""

    timestep_s = IMU_PERIOD_S

    def __init__(self, running: RunInProgress) -> None:
        """Look at a run."""
        self._running = running

    @property
    def time_s(self) -> float:
        """Simulated time since the start of the run, s."""
        return self._running.rows_done * IMU_PERIOD_S

    def advance(self, steps: int) -> None:
        """Take rows."""
        self._running.advance(steps)


def periods_of(running: RunInProgress) -> Mapping[Output, int]:
    """Rows between two of each output that the rig has a sensor for."""
    topics = running.topics
    found = {output: period for output, (topic, period) in _PERIODS.items() if topic.name in topics}
    return {**found, Output.PRESSURES: CONTROL_ROWS}


def unit_of(name: str) -> str:
    """Return the unit that a figure's name ends in, or nothing."""
    return next((unit for end, unit in _UNITS.items() if name.endswith(f"_{end}")), "")


def _values(table: type[ParameterClass], texts: Sequence[str]) -> dict[str, object]:
    known = {row.name: row for row in rows(table)}
    values: dict[str, object] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not equals:
            msg = f"option '{text}' has no '='; write name=value, as in friction=0.5"
            raise ParameterError(msg)
        if name == _SEED:
            msg = f"option '{text}' is refused; the goal has a field of its own for the seed"
            raise ParameterError(msg)
        if name in values:
            msg = f"option '{name}' is given twice; give it once"
            raise ParameterError(msg)
        values[name] = _value(known[name], value) if name in known else value
    return values


def _value(row: ParameterRow, text: str) -> object:
    """Return the text as the option's own type, or as it is, so that the table says what is wrong with it."""
    kind = type(row.default)
    if kind is bool:
        return {"true": True, "false": False}.get(text.lower(), text)
    try:
        return kind(text)
    except ValueError:
        return text
