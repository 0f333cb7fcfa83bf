"""Which ankles a bag is of."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_graph import names

if TYPE_CHECKING:
    from collections.abc import Iterable

_TELLING: tuple[names.Topic, ...] = (
    names.IMU,
    names.LOAD_CELL,
    names.JOINT_STATES,
    names.MANIFOLD_PRESSURE,
    names.PUMP_DUTY,
    *names.PRESSURES.values(),
    *names.SOLENOIDS.values(),
)
"""Topics that every recording of an ankle has some of, whoever made it."""


def namespaces_in(topics: Iterable[str]) -> tuple[str, ...]:
    """Return the namespaces in which topics of an ankle stand, sorted; `/` for the outermost."""
    endings = tuple(f"/{topic.name}" for topic in _TELLING)
    found = {topic[: -len(end)] or "/" for topic in topics for end in endings if topic.endswith(end)}
    return tuple(sorted(found))
