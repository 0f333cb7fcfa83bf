"""What true causes left on machines whose cause was known: the calibration of conformal p-values."""

from __future__ import annotations

from functools import lru_cache
from importlib import resources
from typing import TYPE_CHECKING

import yaml

if TYPE_CHECKING:
    from jammkle_gap.core.data import Recording

_FILE = "conformity.yaml"


def known_nonconformity(_recording: Recording) -> tuple[float, ...]:
    """Return the nonconformity of true causes, rising; see `core.conformal`. All rigs share it, as there is too little.

    Infinite where the true cause was not among the effects that were fitted.
    """
    return _scores()


@lru_cache(maxsize=1)
def _scores() -> tuple[float, ...]:
    text = (resources.files("jammkle_gap.ankle") / _FILE).read_text(encoding="utf-8")
    return tuple(sorted(map(float, yaml.safe_load(text)["scores"])))
