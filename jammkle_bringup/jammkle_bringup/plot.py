"""`jammkle plot`: draw a bag as a page and as PNG."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_bringup.core.run_panels import run_picture
from jammkle_common.command import results
from jammkle_common.command.errors import GraphError, InputError, Interrupted, StopRequest
from jammkle_common.command.results import progress_bar
from jammkle_common.names import normalised

if TYPE_CHECKING:
    from pathlib import Path

PAGE_NAME, PNG_NAME = "run.html", "run.png"


def plot(bag: Path, folder: Path, namespace: str | None, json: Path | None) -> int:
    """Draw a bag and return the exit code.

    Raises:
        InputError: the bag cannot be read, the folder not be made, or a picture is there already.
        GraphError: a picture cannot be written.
        Interrupted: asked to stop.

    """
    results.check_writable(json)
    there = [name for name in (PAGE_NAME, PNG_NAME) if (folder / name).exists()]
    if there:
        msg = f"--output {folder} holds {' and '.join(there)}: nothing is overwritten; choose another or move them away"
        raise InputError(msg)
    stop = StopRequest()
    with progress_bar(f"reading {bag}") as show:
        picture = run_picture(
            bag, None if namespace is None else normalised(namespace), lambda share: show(share, ""), stop
        )
    if picture is None:
        raise Interrupted
    from jammkle_bringup.core.panels_html import write_html  # noqa: PLC0415 - a second that only a good bag needs
    from jammkle_bringup.core.panels_png import write_png  # noqa: PLC0415 - as above

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        msg = f"folder {folder} cannot be made: {error.strerror}"
        raise InputError(msg) from error
    try:
        write_html(picture, folder / PAGE_NAME)
        write_png(picture, folder / PNG_NAME)
    except OSError as error:
        msg = f"a picture cannot be written into {folder}: {error.strerror or error}"
        raise GraphError(msg) from error
    console = results.console()
    if picture.note:
        console.print(picture.note, markup=False)
    console.print(f"the pictures are {folder / PAGE_NAME} and {folder / PNG_NAME}", markup=False)
    results.write_json(
        json, {"bag": str(bag), "page": str(folder / PAGE_NAME), "png": str(folder / PNG_NAME), "note": picture.note}
    )
    return 0
