"""An effects file as the rigs take it: what `jammkle rig --effects` and the sim node load through an entry point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_gap.ankle.corrected import Correction, check_live, load_correction
from jammkle_gap.core.effects import BadEffectError
from jammkle_sim.rigs.rig import BadChangeError

if TYPE_CHECKING:
    from pathlib import Path

    from jammkle_sim.rigs.rig import Rig


@dataclass(frozen=True)
class RigChange:
    """Effects of a file."""

    correction: Correction

    def __call__(self, rig: Rig) -> Rig:
        """Return a rig with the effects in it.

        Raises:
            BadChangeError: the rig has not what an effect changes.

        """
        try:
            return self.correction(rig)
        except BadEffectError as error:
            raise BadChangeError(str(error)) from error

    def check_live(self) -> None:
        """Refuse effects that only a recording can show.

        Raises:
            BadChangeError: there are such in the file.

        """
        try:
            check_live(self.correction)
        except BadEffectError as error:
            raise BadChangeError(str(error)) from error


def load_change(file: Path) -> RigChange:
    """Read the file.

    Raises:
        BadChangeError: it cannot be used.

    """
    try:
        return RigChange(load_correction(file))
    except BadEffectError as error:
        raise BadChangeError(str(error)) from error
