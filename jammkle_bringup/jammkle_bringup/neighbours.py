"""Other graphs on the ROS graph: a lock file does not know of other users and machines.

Each new participant of DDS finds every other one by itself, most within 0.2 s, some only with the next announcement,
3 s later. In 80 looks at a running graph by three participants or four, on a machine with four times as much work as
cores, one had not found any of its three nodes after a second, and three lacked one of them. So several look together
for a second, and look on after the own nodes were started, until DISCOVERY_S have passed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_bringup.core.namespace_lock import already_up, ros_domain
from jammkle_common.command.errors import InputError
from jammkle_common.names import CLOCK, resolved

if TYPE_CHECKING:
    from collections.abc import Collection

    from jammkle_bringup.graph_client import GraphClient

LOOKERS = 3
"""Participants that look together."""

LOOK_S = 1.0
"""How long they look before nodes of a simulation are started."""


def refuse_if_there(client: GraphClient, names: Collection[str], look_s: float) -> str:
    """Look for nodes of these names, and for a /clock.

    Args:
        client: Looks.
        names: Full names of nodes that are to be started.
        look_s: For how long.

    Returns:
        The full name of the node that publishes /clock; empty if none does.

    Raises:
        InputError: one of the nodes is there already.
        Interrupted: the command was asked to stop.

    """
    client.wait_until(lambda: any(client.count(name) for name in names), look_s)
    there = sorted(name for name in names if client.count(name))
    if there:
        who = f"node {', '.join(there)}; one that was killed is seen for 20 s more"
        raise InputError(already_up(client.namespace, ros_domain(), who))
    clocks = client.publishers(CLOCK.name)
    return resolved(clocks[0].node_namespace, clocks[0].node_name) if clocks else ""


def refuse_if_doubled(client: GraphClient, names: Collection[str], *, makes_clock: bool) -> None:
    """Refuse to go on beside nodes of the same name, or another /clock, that came up late or were started together.

    Args:
        client: Looks.
        names: Full names of the nodes that were started.
        makes_clock: Whether one of them publishes /clock.

    Raises:
        InputError: as said.

    """
    doubled = sorted(name for name in names if client.count(name) > 1)
    if doubled:
        raise InputError(already_up(client.namespace, ros_domain(), f"a second node {', '.join(doubled)}"))
    clocks = [resolved(each.node_namespace, each.node_name) for each in client.publishers(CLOCK.name)]
    if makes_clock and len(clocks) > 1:
        msg = f"{CLOCK.name} comes from {' and '.join(sorted(clocks))}, which were started together: start one graph "
        msg += "after the other, so that the second takes the time of the first"
        raise InputError(msg)
