"""Effects files: read by the package that knows the effects, wherever it is installed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_common.command import EFFECTS_FILE, provided

if TYPE_CHECKING:
    from pathlib import Path

    from jammkle_sim.rigs.changes import Change


def load_change(file: Path) -> Change:
    """Return what the effects of a file do to a rig.

    Raises:
        BadChangeError: the file cannot be used.
        InputError: nobody is installed who could read it.

    """
    change: Change = provided(EFFECTS_FILE, "load", "jammkle_gap")(file)
    return change
