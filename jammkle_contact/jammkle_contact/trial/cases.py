"""What a trial is made of: which stories, in which part, from which seed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_contact.drawing_robots import robot_stories
from jammkle_contact.learn import FIRST_TRIAL_SEED
from jammkle_contact.synthetic import walk

if TYPE_CHECKING:
    from jammkle_contact.story import Story

TUNING, HELD_OUT = "tuning", "held out"
STRIDES = 8
SOURCES = {
    TUNING: (("walk", "foot"), ("walk", "shank"), ("leg", "foot"), ("leg", "shank"), ("leg", "body")),
    HELD_OUT: (
        ("walk", "foot"),
        ("walk", "shank"),
        ("quadruped", "foot"),
        ("quadruped", "shank"),
        ("quadruped", "body"),
    ),
}
"""Source of stories and place of the IMU, by part: the robot of the held-out part is in none that is learned from."""


@dataclass(frozen=True)
class Case:
    """One run: everything else is drawn from its seed."""

    part: str
    source: str
    mount: str
    seed: int

    def stories(self) -> list[Story]:
        """Make its stories: one, or one per ankle; none where the simulation blew up."""
        wide = self.part == HELD_OUT
        if self.source == "walk":
            return [walk(self.seed, self.mount, STRIDES, wide=wide)]
        return robot_stories(self.source, self.seed, self.mount, wide=wide)


def cases_from(part: str, seed: int, count: int) -> list[Case]:
    """Return `count` cases of a part, its sources in turn.

    Args:
        part: One of SOURCES.
        seed: Added to the first seed of every trial, so that nothing was learned from it.
        count: How many.

    """
    sources = SOURCES[part]
    return [Case(part, *sources[i % len(sources)], FIRST_TRIAL_SEED + 10_000 * seed + i) for i in range(count)]
