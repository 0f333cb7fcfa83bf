"""Everything that can be wrong with the machine."""

from __future__ import annotations

from typing import TYPE_CHECKING

from studies.blind.reality.air_faults import AIR_FAULTS
from studies.blind.reality.body_faults import BODY_FAULTS
from studies.blind.reality.sensing_faults import SENSING_FAULTS
from studies.blind.reality.tendon_faults import TENDON_FAULTS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from studies.blind.reality.faults import Fault

FAULTS: Mapping[str, Fault] = {**AIR_FAULTS, **TENDON_FAULTS, **SENSING_FAULTS, **BODY_FAULTS}
"""By name."""
