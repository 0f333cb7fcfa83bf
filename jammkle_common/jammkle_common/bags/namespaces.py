"""Which ankles a bag is of."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_common import names

if TYPE_CHECKING:
    from collections.abc import Iterable

_TELLING: tuple[names.Topic, ...] = (
    names.IMU,
    names.LOAD_CELL,
    names.JAM_STATE,
    names.CONTACT_EVENTS,
    names.MANIFOLD_PRESSURE,
    names.PUMP_DUTY,
    *names.PRESSURES.values(),
    *names.SOLENOIDS.values(),
)
"""Topics of an ankle, of which every recording of one has some, whoever made it."""


def namespaces_in(topics: Iterable[str]) -> tuple[str, ...]:
    """Return the namespaces in which topics of an ankle stand, sorted; `/` for the outermost.

    Joint states alone do not make an ankle where there is one: a whole robot has them too.
    """
    known = tuple(topics)
    return _with(known, _TELLING) or _with(known, (names.JOINT_STATES,))


def _with(topics: Iterable[str], telling: Iterable[names.Topic]) -> tuple[str, ...]:
    endings = tuple(f"/{topic.name}" for topic in telling)
    return tuple(sorted({topic[: -len(end)] or "/" for topic in topics for end in endings if topic.endswith(end)}))
