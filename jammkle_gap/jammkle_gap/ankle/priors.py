"""Numbers that are known before anything is measured: constants of the machine, and what scatters from run to run."""

from __future__ import annotations

from dataclasses import dataclass

from jammkle_gap.core.effects import BadEffectError, EffectParameter

REACH = 5.0
"""Standard deviations between null and the bounds, where an entry gives none: what lies beyond is no scatter."""


@dataclass(frozen=True)
class PriorParameter(EffectParameter):
    """A number with a normal prior around its null; its source tells where the deviation comes from."""

    deviation: float
    """Standard deviation of the prior, in `unit`."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            BadEffectError: bounds as for any parameter, or a deviation that is not above 0.

        """
        super().__post_init__()
        if not 0.0 < self.deviation < float("inf"):
            msg = f"parameter '{self.name}' has a deviation of {self.deviation}; give a number above 0"
            raise BadEffectError(msg)
