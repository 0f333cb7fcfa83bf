"""Options that more than one command takes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jammkle_common.command import results

ON_THE_GRAPH, ON_BAGS, ON_THE_BOARD = "On the graph", "On bags", "On the board"
WITHOUT_A_ROBOT, ON_THE_GAP = "Simulated, without the graph", "Simulation against reality"
"""Groups of verbs in `jammkle --help`."""


def _keep_stdout(path: Path | None) -> Path | None:
    if str(path) == results.STDOUT:
        results.keep_stdout_for_json()
    return path


JsonOption = Annotated[
    Path | None,
    typer.Option(
        "--json",
        help="Write the results to this file as JSON too; -: to stdout, and the rest to stderr.",
        metavar="FILE",
        callback=_keep_stdout,
    ),
]
NamespaceOption = Annotated[str, typer.Option("--namespace", help="ROS namespace of the ankle, for example lf_ankle.")]
