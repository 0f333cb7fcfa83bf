"""What pumps and solenoids of a recording were told, and when."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from jammkle_common import names
from jammkle_common.bags.reading import opened
from jammkle_common.bags.times import BagTimes
from jammkle_common.constants import NANOSECONDS_PER_SECOND

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path


@dataclass(frozen=True)
class Told:
    """What pump or a solenoid of an ankle was told, from a time on, s. `channel` is empty for the pump."""

    time_s: float
    ankle: str
    channel: str
    value: float


def commands_of(path: Path, namespaces: Mapping[str, str]) -> list[Told]:
    """Return what pumps and solenoids were told, in order.

    Where the hardware has said when it took its commands (`actuator_states`), that counts, and the commands do not.

    Args:
        path: The bag.
        namespaces: Names of the ankles, by the namespaces in which they are.

    """
    asked: dict[str, list[Told]] = {name: [] for name in namespaces.values()}
    taken: dict[str, list[Told]] = {name: [] for name in namespaces.values()}
    topics: dict[str, tuple[str, str]] = {}
    for namespace, ankle in namespaces.items():
        inside = namespace.rstrip("/")
        topics |= {f"{inside}/{names.SOLENOIDS[channel].name}": (ankle, channel) for channel in names.CHANNELS}
        topics[f"{inside}/{names.PUMP_DUTY.name}"] = (ankle, "")
        topics[f"{inside}/{names.ACTUATOR_STATES.name}"] = (ankle, names.ACTUATOR_STATES.name)
    with opened(path) as reader:
        for connection, time_ns, _, data in BagTimes(reader).messages(reader.on(topics)):
            time_s = time_ns / NANOSECONDS_PER_SECOND
            ankle, what = topics[connection.topic]
            message: Any = reader.deserialize(data, connection.msgtype)
            if what == names.ACTUATOR_STATES.name:
                taken[ankle].append(Told(time_s, ankle, "", float(message.pump_duty)))
                pairs = zip(message.channels, message.energised, strict=True)
                taken[ankle] += [Told(time_s, ankle, channel, float(on)) for channel, on in pairs]
            else:
                asked[ankle].append(Told(time_s, ankle, what, float(message.data)))
    found = [each for ankle in asked for each in (taken[ankle] or asked[ankle])]
    return sorted(found, key=lambda each: each.time_s)
