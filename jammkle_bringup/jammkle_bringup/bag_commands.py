"""Arguments of the verbs that work on bags. What they do stands in modules of their own."""

# ruff: noqa: PLC0415 - imported where needed: `jammkle --help` shall not wait for ROS, NumPy and Matplotlib

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jammkle_common.command.main import EXIT_FAILED, failed
from jammkle_common.command.options import ON_BAGS, JsonOption

app = typer.Typer(context_settings={"help_option_names": ["-h", "--help"]})

BagArgument = Annotated[Path, typer.Argument(help="The bag: its folder, or one file of it.", metavar="BAG")]


@app.command(rich_help_panel=ON_BAGS)
def info(
    bag: BagArgument,
    verbose: Annotated[  # noqa: FBT002 - a switch of the command line
        bool, typer.Option("--all", "--verbose", help="Show all that the recorder added, such as parameters.")
    ] = False,
    json: JsonOption = None,
) -> int:
    """Show what a bag holds, and whether it is whole: duration, topics, types, counts, rates, QoS, custom data."""
    from jammkle_bringup import report
    from jammkle_bringup.core.bag_info import bag_info
    from jammkle_common.command import results
    from jammkle_common.command.results import progress_bar

    results.check_writable(json)
    with progress_bar(f"reading {bag}") as show:
        found = bag_info(bag, lambda share: show(share, ""))
    console = results.console()
    console.print(report.info_line(found), markup=False)
    for table in report.info_tables(found):
        console.print(table)
    for line in report.custom_lines(found, verbose=verbose):
        console.print(line, markup=False)
    results.write_json(json, found.as_json())
    return 0


@app.command(rich_help_panel=ON_BAGS)
def recover(
    bag: BagArgument,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="Folder of the whole bag; the one that was torn stays as it is.",
            metavar="DIR",
            show_default="the bag itself is completed",
        ),
    ] = None,
    json: JsonOption = None,
) -> int:
    """Make a bag whole that its recorder could not complete: killed, out of power, or on a full disk."""
    from jammkle_bringup import report
    from jammkle_common.bags.recovery import recover as make_whole
    from jammkle_common.command import results
    from jammkle_common.command.results import progress_bar

    results.check_writable(json)
    try:
        with progress_bar(f"reading {bag}") as show:
            done = make_whole(bag, lambda share: show(share, ""), output)
    except OSError as error:
        return failed(f"bag {bag} cannot be recovered: {error.strerror or error}", EXIT_FAILED)
    results.console().print(report.recovery_text(done), markup=False)
    results.write_json(json, done.as_json())
    return 0


@app.command(rich_help_panel=ON_BAGS)
def export(
    bag: BagArgument,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder of the tables; must not exist yet.", metavar="DIR")
    ] = Path("runs/export"),
    csv: Annotated[bool, typer.Option("--csv", help="Write CSV, the default.")] = False,  # noqa: FBT002 - a switch
    parquet: Annotated[bool, typer.Option("--parquet", help="Write Parquet.")] = False,  # noqa: FBT002 - a switch
    rate_hz: Annotated[
        float | None,
        typer.Option(
            help="Put all sampled topics on one time base, in one table, with so many rows per second.",
            show_default="a table for each topic, with its own times",
        ),
    ] = None,
    json: JsonOption = None,
) -> int:
    """Write a bag as tables, with units in the names of the columns."""
    from jammkle_bringup.export import export as write_tables

    return write_tables(bag, output, wants_csv=csv, wants_parquet=parquet, rate_hz=rate_hz, json=json)


@app.command(rich_help_panel=ON_BAGS)
def plot(
    bag: BagArgument,
    output: Annotated[
        Path,
        typer.Option("-o", "--output", help="Folder of new pictures, run.html and run.png.", metavar="DIR"),
    ] = Path("runs/plot"),
    namespace: Annotated[str | None, typer.Option(help="Namespace of the ankle, if the bag holds several.")] = None,
    json: JsonOption = None,
) -> int:
    """Draw a run: vacuum and states, pump, IMU with events, tension against extension; as a page and as PNG."""
    from jammkle_bringup.plot import plot as draw

    return draw(bag, output, namespace, json)


@app.command(rich_help_panel=ON_BAGS)
def rename(
    bag: BagArgument,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder of the new bag; must not exist yet.", metavar="DIR")
    ],
    joint: Annotated[
        list[str] | None,
        typer.Option(
            help="A joint and its name here, =- where it counts the other way round; may be repeated.",
            metavar="THEIRS=OURS",
        ),
    ] = None,
    topic: Annotated[
        list[str] | None,
        typer.Option(help="A topic and its new name, both in full; may be repeated.", metavar="/THEIRS=/OURS"),
    ] = None,
    json: JsonOption = None,
) -> int:
    """Write a bag of a robot with other names anew, so that every other verb knows its joints and topics."""
    from jammkle_bringup.rename import rename as write_anew

    return write_anew(bag, output, joint or [], topic or [], json)
