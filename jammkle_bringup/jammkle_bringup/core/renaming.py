"""Joints and channels that a robot calls by names of its own, and back.

A mapping is text, `theirs=ours` parted by commas, as a parameter or the command line gives it:

    lf_foot_pitch=ankle_pitch, lf_foot_roll=-ankle_roll

Does not import rclpy.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from jammkle_common.names import ANKLE_JOINTS, CARRIAGE_JOINT, CHANNELS, LEG_JOINTS

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

KNOWN_JOINTS: tuple[str, ...] = (*ANKLE_JOINTS, *LEG_JOINTS, CARRIAGE_JOINT)
_WORD = re.compile(r"[^\s=,]+")
_TOPIC_PART = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


class RenamingError(ValueError):
    """A mapping of names that cannot be. The message is one line."""


class JointStates(Protocol):
    """A sensor_msgs/JointState, whoever made the class."""

    name: Sequence[str]
    position: Sequence[float]
    velocity: Sequence[float]
    effort: Sequence[float]


@dataclass(frozen=True)
class Joints:
    """Values of some joints; an empty list where the message had none of that kind.

    Attributes:
        name: Of each joint.
        position: rad; m for the carriage.
        velocity: rad/s, m/s.
        effort: N m, N.

    """

    name: tuple[str, ...]
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    effort: tuple[float, ...]


@dataclass(frozen=True)
class JointRenaming:
    """New names of joints, by the old ones, and the sign with which each counts."""

    new: Mapping[str, tuple[str, float]]

    @classmethod
    def parsed(cls, text: str) -> JointRenaming:
        """Read `theirs=ours, theirs=-ours`; with the minus, theirs counts the other way round.

        Raises:
            RenamingError: it has another form, a name stands twice, or ours is unknown.

        """
        found = {
            theirs: (ours.removeprefix("-"), -1.0 if ours.startswith("-") else 1.0)
            for theirs, ours in _pairs(text).items()
        }
        _check_ours([name for name, _ in found.values()], KNOWN_JOINTS, "joint")
        return cls(found)

    @property
    def reverse(self) -> JointRenaming:
        """The way back, with the same signs."""
        return JointRenaming({new: (old, sign) for old, (new, sign) in self.new.items()})

    def renamed(self, message: JointStates) -> Joints | None:
        """Return the joints that have a new name, in the order of the message; None if there is none."""
        kept = [(place, *self.new[name]) for place, name in enumerate(message.name) if name in self.new]
        if not kept:
            return None
        values = (
            tuple(sign * float(found[place]) for place, _, sign in kept) if len(found) else ()
            for found in (message.position, message.velocity, message.effort)
        )
        return Joints(tuple(name for _, name, _ in kept), *values)


@dataclass(frozen=True)
class ChannelRenaming:
    """What a robot calls the channels, all of them."""

    theirs_to_ours: Mapping[str, str]

    @classmethod
    def parsed(cls, text: str) -> ChannelRenaming:
        """Read `theirs=ours`; a channel that is not named keeps its name.

        Raises:
            RenamingError: it has another form, a name stands twice, cannot be part of a topic's, or ours is unknown.

        """
        given = _pairs(text)
        _check_ours(list(given.values()), CHANNELS, "channel")
        for theirs in given:
            if not _TOPIC_PART.fullmatch(theirs):
                msg = f"channel name '{theirs}' cannot be part of a topic's: use letters, digits and _, a letter first"
                raise RenamingError(msg)
        named = {ours: theirs for theirs, ours in given.items()}
        result = {named.get(ours, ours): ours for ours in CHANNELS}
        if len(result) < len(CHANNELS):
            twice = next(theirs for theirs in given if theirs in set(CHANNELS) - set(named))
            msg = f"'{twice}' would be two channels: name the channel that is called so until now as well"
            raise RenamingError(msg)
        return cls(result)

    def ours(self, theirs: Collection[str]) -> list[str]:
        """Return our names.

        Raises:
            RenamingError: the robot has no channel of that name.

        """
        for name in theirs:
            if name not in self.theirs_to_ours:
                msg = f"unknown channel '{name}': the channels are {', '.join(self.theirs_to_ours)}"
                raise RenamingError(msg)
        return [self.theirs_to_ours[name] for name in theirs]

    def theirs(self, ours: str) -> str:
        """Return the robot's name of a channel."""
        return next((theirs for theirs, known in self.theirs_to_ours.items() if known == ours), ours)

    def told(self, text: str) -> str:
        """Return a sentence with the robot's names in the place of ours."""
        return re.sub(rf"\b(?:{'|'.join(CHANNELS)})\b", lambda found: self.theirs(found.group()), text)


def _pairs(text: str) -> dict[str, str]:
    found: dict[str, str] = {}
    for part in filter(None, (each.strip() for each in text.split(","))):
        theirs, equals, ours = (each.strip() for each in part.partition("="))
        if not equals or not _WORD.fullmatch(theirs) or not _WORD.fullmatch(ours):
            msg = f"'{part}' must be theirs=ours, such as lf_foot_pitch=ankle_pitch"
            raise RenamingError(msg)
        if theirs in found:
            msg = f"'{theirs}' stands twice: give each name once"
            raise RenamingError(msg)
        found[theirs] = ours
    return found


def _check_ours(ours: Sequence[str], known: Sequence[str], what: str) -> None:
    for place, name in enumerate(ours):
        if name not in known:
            msg = f"'{name}' is no {what} of ours: use one of {', '.join(known)}"
            raise RenamingError(msg)
        if name in ours[:place]:
            msg = f"{what} '{name}' would have two names: give it one"
            raise RenamingError(msg)
