"""Options that more than one command takes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

JsonOption = Annotated[
    Path | None, typer.Option("--json", help="Write the results to this file as JSON too.", metavar="FILE")
]
NamespaceOption = Annotated[str, typer.Option("--namespace", help="ROS namespace of the ankle, for example lf_ankle.")]
