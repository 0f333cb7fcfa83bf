"""`jammkle export`: write a bag as tables."""

from __future__ import annotations

import math
import shutil
from typing import TYPE_CHECKING

from rich.table import Table

from jammkle_common.command import results
from jammkle_common.command.errors import GraphError, InputError, StopRequest
from jammkle_common.command.results import progress_bar

if TYPE_CHECKING:
    from pathlib import Path

    from jammkle_bringup.core.export import Exported

LARGEST_RATE_HZ = 10_000.0
"""Ten times the fastest sensor."""


def export(
    bag: Path, folder: Path, *, wants_csv: bool, wants_parquet: bool, rate_hz: float | None, json: Path | None
) -> int:
    """Write the tables and return the exit code.

    Raises:
        InputError: the bag cannot be read, or something cannot be as asked for.
        GraphError: a table cannot be written.
        Interrupted: asked to stop; nothing is left.

    """
    if wants_csv and wants_parquet:
        msg = "--csv and --parquet exclude each other: give one of them"
        raise InputError(msg)
    if rate_hz is not None and not (math.isfinite(rate_hz) and 0.0 < rate_hz <= LARGEST_RATE_HZ):
        msg = f"--rate-hz {rate_hz:g} must be above 0 and at most {LARGEST_RATE_HZ:g} Hz"
        raise InputError(msg)
    results.check_writable(json)
    from jammkle_bringup.core.export import ExportRequest, TableFormat  # noqa: PLC0415 - after what can be wrong
    from jammkle_bringup.core.export import export as write_tables  # noqa: PLC0415 - as above

    stop = StopRequest()
    form = TableFormat.PARQUET if wants_parquet else TableFormat.CSV
    _make(folder)
    done = None
    try:
        with progress_bar(f"reading {bag}") as show:
            done = write_tables(ExportRequest(bag, folder, form, rate_hz), lambda share: show(share, ""), stop)
    except OSError as error:
        msg = f"a table cannot be written into {folder}: {error.strerror or error}"
        raise GraphError(msg) from error
    finally:
        if done is None:
            shutil.rmtree(folder, ignore_errors=True)
    results.console().print(_table(done, folder))
    results.write_json(json, done.as_json())
    return 0


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True)
    except FileExistsError as error:
        msg = f"--output {folder} exists: nothing is overwritten; choose another one or move it away"
        raise InputError(msg) from error
    except OSError as error:
        msg = f"folder {folder} cannot be made: {error.strerror}"
        raise InputError(msg) from error


def _table(done: Exported, folder: Path) -> Table:
    title = f"{folder}: time_s counts from ROS time {done.start_s:.9f} s"
    shown = Table("table", title=title, title_justify="left")
    for heading in ("rows", "columns"):
        shown.add_column(heading, justify="right")
    for table in done.tables:
        shown.add_row(table.file, str(table.rows), str(len(table.columns)))
    return shown
