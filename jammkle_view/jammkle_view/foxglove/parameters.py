"""Parameters of the connection: one table that is declared, bounded, validated and documented from here."""

from __future__ import annotations

from dataclasses import dataclass

from jammkle_common.parameters import parameter
from jammkle_view.parameters import LOCAL_HOST

USUAL_PORT = 8765
"""Where the app looks unless it is told otherwise."""


@dataclass(frozen=True)
class FoxgloveParameters:
    """What can be set on the connection."""

    host: str = parameter(
        LOCAL_HOST, "Address that it listens on; 0.0.0.0 lets every machine of the network read the topics"
    )
    port: int = parameter(USUAL_PORT, "TCP port of the WebSocket; 0 takes any free one", "", 0, 65535)


NOT_INSTALLED = (
    "--foxglove needs foxglove-sdk, which is not installed: pip install 'jammkle[foxglove]', or "
    "`make extras` in a checkout"
)
