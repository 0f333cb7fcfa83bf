"""Changes to a rig that a file tells. Who reads such files is no matter of the rigs: a package brings it along."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from jammkle_sim.rigs.rig import Rig


class BadChangeError(ValueError):
    """A file of changes cannot be used; the message names it and says what would be right."""


class Change(Protocol):
    """What is done to a rig."""

    def __call__(self, rig: Rig) -> Rig:
        """Return a changed rig.

        Raises:
            BadChangeError: this rig has not what is changed.

        """

    def check_live(self) -> None:
        """Refuse what only a recording can show.

        Raises:
            BadChangeError: something in it cannot be simulated live.

        """
