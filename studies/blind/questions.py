"""What one process is asked of one case, and all that it is told: bags, how their rig was set, ways of diagnosing."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from jammkle_common.command.errors import InputError
from jammkle_gap.ankle.sensors import SensorSet
from studies.blind import files


class Run(enum.Enum):
    """A way of diagnosing, and the folder of its answers."""

    WITH = "rig_5"
    """The headline: all references, and the sensors of the rig."""
    FEWER = "rig_3"
    """Three references per setting."""
    WITHOUT = "rig_0"
    """No reference."""
    ROBOT = "robot_5"
    """Without load cell and carriage."""
    INSTRUMENTED = "instrumented_5"
    """With tension and extension of every tendon."""
    BASELINES = "baselines"
    """What simpler methods say of what the headline looks at; as blind as the others."""
    ORACLE = "oracle"
    """Only the true effects on offer: how far the gap can be closed."""
    LEFT_OUT = "left_out"
    """The true effect not on offer."""
    CEILING = "ceiling"
    """With the reality itself as the simulator, and its own faults as the library."""


REFERENCES: Final = {Run.FEWER: 3, Run.WITHOUT: 0}
"""References per setting that a way takes; those not named take all."""
SENSORS: Final = {Run.ROBOT: SensorSet.ROBOT, Run.INSTRUMENTED: SensorSet.INSTRUMENTED}
"""Sensors that a way looks at; the others look at those of a robot, and the load cell where the rig has one."""


@dataclass(frozen=True)
class Way:
    """One answer that is asked for."""

    run: Run
    only: tuple[str, ...] = ()
    """Effects that are on offer, and no others; empty: all."""
    without: tuple[str, ...] = ()
    """Effects that are not on offer."""

    @property
    def references(self) -> int | None:
        """References per setting that it may look at; None: all."""
        return REFERENCES.get(self.run)

    @property
    def takes_references(self) -> bool:
        """Whether it may look at any."""
        return self.references != 0

    @property
    def sensors(self) -> SensorSet | None:
        """What it may look at; None: what a diagnosis looks at unless asked otherwise."""
        return SENSORS.get(self.run)


@dataclass(frozen=True)
class Questions:
    """What is asked of one case."""

    bags: tuple[Path, ...]
    references: tuple[Path, ...]
    """Of the same machine while healthy, for the ways that take them."""
    rig: str | None
    """What was recorded, where the bags do not tell."""
    settings: tuple[str, ...]
    """How it was set, where the bags do not tell: NAME=VALUE, as it is typed."""
    ways: tuple[Way, ...]
    """In the order in which they are answered."""


def write_questions(file: Path, asked: Questions) -> None:
    """Write questions for another process; of references only if a way takes them.

    Raises:
        InputError: the file cannot be written.

    """
    told = asked.references if any(way.takes_references for way in asked.ways) else ()
    content = {
        "format": files.FORMAT,
        "bags": [str(bag) for bag in asked.bags],
        "references": [str(bag) for bag in told],
        "rig": asked.rig,
        "settings": list(asked.settings),
        "ways": [{"run": way.run.value, "only": list(way.only), "without": list(way.without)} for way in asked.ways],
    }
    files.write_json(file, content)


def read_questions(file: Path) -> Questions:
    """Read questions.

    Raises:
        InputError: there are none, or they are not what they should be.

    """
    content = files.read_json(file, "questions", "`python -m studies.blind run` writes them")
    try:
        return Questions(
            tuple(map(Path, content["bags"])),
            tuple(map(Path, content["references"])),
            content["rig"],
            tuple(content["settings"]),
            tuple(Way(Run(way["run"]), tuple(way["only"]), tuple(way["without"])) for way in content["ways"]),
        )
    except (KeyError, TypeError, ValueError) as error:
        msg = f"questions {file} are not what `python -m studies.blind run` writes: {error}; have it write them"
        raise InputError(msg) from error


def said_file(folder: Path, run: Run) -> Path:
    """Return where a process writes an answer, in the folder of its questions."""
    return folder / f"{run.value}.json"
