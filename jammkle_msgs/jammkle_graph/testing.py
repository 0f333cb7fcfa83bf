"""For tests: a ROS domain of one's own. Needs `domain_coordinator`, which is a test dependency only."""

from __future__ import annotations

import contextlib
import secrets
from typing import TYPE_CHECKING

from domain_coordinator import domain_id

if TYPE_CHECKING:
    from collections.abc import Iterator

DOMAINS = 100
"""Domains 1 to 100 are handed out, as domain_coordinator does by itself."""


@contextlib.contextmanager
def own_domain() -> Iterator[int]:
    """Reserve a ROS domain that no other test on this machine has now, and hand over its number.

    It is drawn at random: participants that were killed stay visible in their domain for some 20 s, and by itself
    domain_coordinator would hand out the same domain again at once.
    """
    with domain_id(lambda: secrets.randbelow(DOMAINS) + 1) as number:
        yield number
