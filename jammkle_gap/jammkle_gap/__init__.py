"""The sim-to-real gap: where simulation and robot disagree, and why. What others may use stands in `__all__`."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jammkle_gap.ankle.corrected import corrected_text
    from jammkle_gap.ankle.effects import ankle_library
    from jammkle_gap.landing import Ending, diagnose_landing, show_ending
    from jammkle_gap.landing_effects import Secret, draw

__all__ = ["Ending", "Secret", "ankle_library", "corrected_text", "diagnose_landing", "draw", "show_ending"]

_HOMES = {
    "Ending": "landing",
    "Secret": "landing_effects",
    "ankle_library": "ankle.effects",
    "corrected_text": "ankle.corrected",
    "diagnose_landing": "landing",
    "draw": "landing_effects",
    "show_ending": "landing",
}


def __getattr__(name: str) -> Any:
    """Load what is asked for when it is asked for: the command shall not wait for NumPy."""
    if name not in _HOMES:
        msg = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(msg)
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
