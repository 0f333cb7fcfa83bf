"""Everything that can be wrong with the machine."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_reality.air_faults import AIR_FAULTS
from jammkle_reality.body_faults import BODY_FAULTS
from jammkle_reality.sensing_faults import SENSING_FAULTS
from jammkle_reality.tendon_faults import TENDON_FAULTS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_reality.faults import Fault

FAULTS: Mapping[str, Fault] = {**AIR_FAULTS, **TENDON_FAULTS, **SENSING_FAULTS, **BODY_FAULTS}
"""By name."""
