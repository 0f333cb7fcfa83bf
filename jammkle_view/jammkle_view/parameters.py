"""Parameters of the viewer and of the connection for Foxglove: one table each, from which all else follows."""

from __future__ import annotations

from dataclasses import dataclass

from jammkle_common.parameters import parameter

LOCAL_HOST = "127.0.0.1"
"""Only this machine sees the page, unless somebody says otherwise: who sees it can jam."""
FIRST_PORT = 8080
NO_PAGE = "the page in the browser needs viser, which is not installed: pip install 'jammkle[view]'"
ANY_PORT = 0
"""Stands for the first free port from FIRST_PORT on."""


@dataclass(frozen=True)
class ViewerParameters:
    """What can be set on the viewer."""

    host: str = parameter(
        LOCAL_HOST,
        "Address that the page listens on; 0.0.0.0 lets every machine of the network see it, and jam",
    )
    port: int = parameter(
        ANY_PORT, f"TCP port of the page; 0 takes the first free one from {FIRST_PORT} on", "", 0, 65535
    )
    ankles: str = parameter(
        "",
        "Namespaces of the ankles on the page, relative to the viewer's own, parted by commas; empty: its own alone",
    )
    frame_rate_hz: float = parameter(
        36.0, "How often the scene moves; a fifth more than 30, so that late frames leave that many", "Hz", 1.0, 60.0
    )


USUAL_PORT = 8765
"""Where the app looks by default."""


@dataclass(frozen=True)
class FoxgloveParameters:
    """What can be set on the connection."""

    host: str = parameter(
        LOCAL_HOST, "Address that it listens on; 0.0.0.0 lets every machine of the network read the topics"
    )
    port: int = parameter(USUAL_PORT, "TCP port of the WebSocket; 0 takes any free one", "", 0, 65535)


NO_FOXGLOVE = (
    "--foxglove needs foxglove-sdk, which is not installed: pip install 'jammkle[foxglove]', or "
    "`make extras` in a checkout"
)
