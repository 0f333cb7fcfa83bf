"""How our processes talk to others on the same machine: by UDP, so that a killed process stops nobody else.

Fast DDS, the default of ROS 2 Jazzy, talks through queues in shared memory within one machine. Who is killed while it
holds such a queue leaves it locked, and everybody who publishes to it waits for `healthy_check_timeout_ms`, 1 s, once
per queue (Fast DDS documentation, "Shared Memory Transport"). Measured on a busy machine: of 24 controllers that were
killed, 3 stopped driver and simulation for 2 to 3 s, and the board's watchdog let go of everything. By UDP none of 33.

They are also announced ten times a second for 5 s, not for half a second as by default. Who hears of a new participant
answers with its own announcement once, by UDP, and the new one, just starting, may miss it: seen on the wire, it then
knew nothing of `jammkle up` until that announced itself again, 3 s after the time before.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import MutableMapping

_IMPLEMENTATION: Final = "RMW_IMPLEMENTATION"
_RANGE: Final = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_LOCALHOST_ONLY: Final = "ROS_LOCALHOST_ONLY"
_TRANSPORTS: Final = "FASTDDS_BUILTIN_TRANSPORTS"
_STATIC_PEERS: Final = "ROS_STATIC_PEERS"
_PROFILES: Final = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
_UDP: Final = "UDPv4"
_ON_THIS_MACHINE: Final = str(Path(__file__).with_name("udp_on_this_machine.xml"))
_BEYOND: Final = str(Path(__file__).with_name("announced_for_longer.xml"))
_OURS: Final = (_ON_THIS_MACHINE, _BEYOND)


def talk_by_udp(environment: MutableMapping[str, str]) -> None:
    """Choose UDP for every participant that this process and its children will make.

    What a user has chosen stays: another middleware, a Fast DDS profile, `FASTDDS_BUILTIN_TRANSPORTS`, static peers
    (which the middleware reads with a range alone). With `ROS_LOCALHOST_ONLY=1` (deprecated) shared memory stays, too,
    since the middleware asks for it by itself.

    Args:
        environment: Of a process that is ours, `os.environ`; to be called when it starts. Fast DDS reads profiles once,
            with the first participant: later, the range would be another one, and shared memory still there.

    """
    if not (environment.get(_IMPLEMENTATION) or "rmw_fastrtps").startswith("rmw_fastrtps"):
        return
    if environment.get(_LOCALHOST_ONLY) == "1" or any(
        environment.get(name, _BEYOND) not in _OURS for name in _PROFILES
    ):
        return
    if environment.get(_STATIC_PEERS) or environment.get(_TRANSPORTS, _UDP) != _UDP:
        return
    if environment.get(_RANGE) == "LOCALHOST":
        # For this range rmw_fastrtps adds shared memory whatever a profile says; ours has the rest of what it sets.
        environment[_PROFILES[0]] = _ON_THIS_MACHINE
        environment[_RANGE] = "SYSTEM_DEFAULT"
    elif environment.get(_PROFILES[0], _BEYOND) == _BEYOND:
        environment[_TRANSPORTS] = _UDP
        environment[_PROFILES[0]] = _BEYOND
