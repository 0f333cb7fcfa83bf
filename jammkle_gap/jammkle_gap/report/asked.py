"""What a diagnosis was asked: recordings, effects on offer, sensors; what a page says beside the answer."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_common.command.results import Origin
    from jammkle_gap.core.effects import Nuisance


@dataclass(frozen=True)
class Asked:
    """One question, as its answer is shown beside."""

    bags: Sequence[str]
    references: Sequence[str]
    rigs: Sequence[str]
    sensors: str
    """Sensors that were used, such as `robot`."""
    library: str
    """File of the user's own effects; empty for none."""
    sentences: Mapping[str, str]
    """Of every effect on offer: what it is and what to check."""
    corrected: str
    """File of the corrected simulator."""
    origin: Origin
    """Version, date and command that made the page."""
    constants: Sequence[Nuisance] = field(default=())
    """Of the machine, which references calibrate."""
