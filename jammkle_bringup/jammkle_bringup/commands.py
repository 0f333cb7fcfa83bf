"""Verbs on the graph and on bags: their arguments, and where their results go."""

# ruff: noqa: PLC0415 - imported where needed: `jammkle --help` shall not wait for ROS, NumPy and plotly

from __future__ import annotations

import contextlib
import dataclasses
import datetime as dt
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from jammkle_bringup.core.node_table import SIM_HARDWARE, Robot
from jammkle_common.command import results
from jammkle_common.command.errors import GraphError, InputError, Interrupted, StopRequest
from jammkle_common.command.main import EXIT_BAD_INPUT, EXIT_FAILED, failed
from jammkle_common.command.options import ON_BAGS, ON_THE_GRAPH, JsonOption, NamespaceOption
from jammkle_common.names import normalised, resolved

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

app = typer.Typer(context_settings={"help_option_names": ["-h", "--help"]})

ChannelsArgument = Annotated[
    list[str] | None, typer.Argument(help="peroneal_left, peroneal_right, achilles; none means all.", metavar="CHANNEL")
]
BagArgument = Annotated[Path, typer.Argument(help="The bag: its folder, or one file of it.", metavar="BAG")]
AllOption = Annotated[
    bool, typer.Option("--all", "--verbose", help="Show every line of every node with all values, or all custom data.")
]

LEAST_RATE_HZ, LARGEST_RATE_HZ = 1e-6, 10_000.0
"""A row in eleven days, which still counts in whole nanoseconds, and ten times the fastest sensor."""
PAGE_NAME = "run.html"


@app.command(rich_help_panel=ON_THE_GRAPH)
def up(  # noqa: PLR0913, PLR0917 - as many as it has options
    robot: Annotated[
        Robot, typer.Option(help="What to bring up: one ankle, a leg on one, or a quadruped on four.")
    ] = Robot.ANKLE,
    hardware: Annotated[
        str,
        typer.Option(help="Behind the driver: sim, modbus (a board), fake (a small built-in plant), or a package's."),
    ] = SIM_HARDWARE,
    port: Annotated[
        str | None, typer.Option(help="Where the board is: a serial device, or tcp://HOST[:PORT].", metavar="DEV")
    ] = None,
    namespace: NamespaceOption = "/",
    speed: Annotated[
        float | None, typer.Option(help="Simulated time per real time; 0: as fast as possible.", show_default="1")
    ] = None,
    record: Annotated[Path | None, typer.Option(help="Record everything into this new bag.", metavar="DIR")] = None,
    params: Annotated[
        list[Path] | None, typer.Option(help="ROS parameter file (YAML); may be repeated.", metavar="FILE")
    ] = None,
    param: Annotated[
        list[str] | None,
        typer.Option(
            "-p",
            "--param",
            help="A parameter of a node, driver, for that of every ankle, or lf_ankle/driver; may be repeated.",
            metavar="NODE:NAME:=VALUE",
        ),
    ] = None,
    monitor: Annotated[  # noqa: FBT002 - a switch of the command line
        bool, typer.Option("--monitor", help="Let a simulated twin follow the robot and warn when it is left.")
    ] = False,
    view: Annotated[  # noqa: FBT002 - as above
        bool, typer.Option("--view", help="Show the robot on a page in the browser, with buttons to jam and unjam.")
    ] = False,
    foxglove: Annotated[  # noqa: FBT002 - as above
        bool, typer.Option("--foxglove", help="Let the Foxglove app look on, over a WebSocket; it can change nothing.")
    ] = False,
) -> int:
    """Start driver, controller and simulation (or hardware) and keep them up until Ctrl-C."""
    from jammkle_bringup.graph_options import GraphOptions, given_values, with_given
    from jammkle_bringup.up import up as run_graph

    options = GraphOptions(
        normalised(namespace),
        hardware,
        tuple(params or ()),
        record,
        given_values(robot, hardware, speed, port),
        robot,
        monitor=monitor,
        view=view,
        foxglove=foxglove,
    )
    try:
        return run_graph(with_given(options, param or ()), StopRequest())
    except Interrupted:  # while it was still starting: asked to stop, and nothing is left
        return 0


@app.command(rich_help_panel=ON_THE_GRAPH)
def jam(
    channels: ChannelsArgument = None,
    vacuum_kpa: Annotated[float, typer.Option(help="Vacuum to hold, kPa below ambient.")] = 50.0,
    namespace: NamespaceOption = "/",
    json: JsonOption = None,
) -> int:
    """Jam channels: evacuate their tendons and hold the vacuum."""
    from jammkle_bringup.channels import jam as ask

    results.check_writable(json)
    return _answered(ask(normalised(namespace), channels or [], vacuum_kpa, StopRequest()), json)


@app.command(rich_help_panel=ON_THE_GRAPH)
def unjam(channels: ChannelsArgument = None, namespace: NamespaceOption = "/", json: JsonOption = None) -> int:
    """Unjam channels: vent their tendons to the atmosphere."""
    from jammkle_bringup.channels import unjam as ask

    results.check_writable(json)
    return _answered(ask(normalised(namespace), channels or [], StopRequest()), json)


@app.command(rich_help_panel=ON_THE_GRAPH)
def call(
    service: Annotated[
        str, typer.Argument(help="Such as driver/clear_fault or controller/set_auto.", metavar="SERVICE")
    ],
    value: Annotated[bool | None, typer.Argument(help="true or false, where it takes one.", metavar="VALUE")] = None,
    namespace: NamespaceOption = "/",
    json: JsonOption = None,
) -> int:
    """Call a service of a node: clear a fault, set automatic jamming or contact, pause or reset a simulation."""
    from jammkle_bringup.channels import call as ask

    results.check_writable(json)
    return _answered(ask(normalised(namespace), service, value, StopRequest()), json)


def _answered(answers: Any, json: Path | None) -> int:
    """Show the answer of a node, or of those of each of a robot's ankles."""
    from jammkle_bringup.channels import together

    answer, content = together(answers)
    results.write_json(json, content)
    if not answer.success:
        return failed(answer.message, EXIT_FAILED)
    typer.echo(answer.message)
    return 0


@app.command(rich_help_panel=ON_THE_GRAPH)
def status(namespace: NamespaceOption = "/", verbose: AllOption = False, json: JsonOption = None) -> int:  # noqa: FBT002
    """Show the state of every channel, and of the nodes' health what is not OK."""
    from jammkle_bringup import channels

    results.check_writable(json)
    ankles, health = channels.status(normalised(namespace), StopRequest())
    console = results.console()
    console.print(channels.status_line(ankles, health, verbose=verbose), markup=False)
    for ankle, jam_status in ankles.items():
        if jam_status.emergency_stopped:
            within = resolved(normalised(namespace), ankle) if ankle else normalised(namespace)
            asked = "jammkle call driver/clear_fault" + (f" --namespace {within}" if within != "/" else "")
            console.print(f"emergency stop: everything is released until `{asked}`")
    for table in channels.status_tables(ankles, health, verbose=verbose):
        console.print(table)
    content = {ankle: dataclasses.asdict(jam_status) for ankle, jam_status in ankles.items()}
    of_all = content.get("", {"ankles": content})
    results.write_json(json, {**of_all, "health": [dataclasses.asdict(line) for line in health]})
    return 0


@app.command(rich_help_panel=ON_THE_GRAPH)
def record(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of the new bag.", metavar="DIR")],
    namespace: NamespaceOption = "/",
    clock: Annotated[
        str, typer.Option(help="Log times: sim (/clock), system, or auto: /clock if somebody publishes it.")
    ] = "auto",
    json: JsonOption = None,
) -> int:
    """Record a namespace, /clock, /diagnostics and /tf into a bag (MCAP) until Ctrl-C."""
    from jammkle_bringup.recorder import record as record_graph

    results.check_writable(json)
    counts = record_graph(output, normalised(namespace), clock)
    results.write_json(json, {"bag": str(output), "messages": counts.messages, "by_topic": counts.by_topic})
    return 0


@app.command(rich_help_panel=ON_THE_GRAPH)
def exercise(
    name: Annotated[str, typer.Argument(help="cycle, press, shake, tilt, or all.", metavar="NAME")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder that gets a bag per exercise.", metavar="DIR")],
    vacuum_kpa: Annotated[
        float | None,
        typer.Option(
            help="Vacuum of the jammed half, from 5 kPa to the driver's max_vacuum_pa, 70 kPa by default.",
            show_default="50, of press 20",
        ),
    ] = None,
    option: Annotated[
        list[str] | None,
        typer.Option(
            "-p",
            "--param",
            help="An option of the exercise, as run.yaml has it (SI), such as way_time_s:=0.3; may be repeated.",
            metavar="NAME:=VALUE",
        ),
    ] = None,
    namespace: NamespaceOption = "/",
    json: JsonOption = None,
) -> int:
    """Take a robot through exercises for a diagnosis, and record each with its run sheet."""
    from jammkle_bringup.core.node_table import option_value
    from jammkle_bringup.exercise import exercise as do
    from jammkle_common.bags.run_sheet import RunSheet
    from jammkle_sim.rigs.catalogue import EXERCISES

    if name != "all" and name not in EXERCISES:
        msg = f"NAME '{name}' does not exist; it must be one of {', '.join(EXERCISES)}, all"
        raise InputError(msg)
    results.check_writable(json)
    options: dict[str, object] = {} if vacuum_kpa is None else {"vacuum_pa": 1e3 * vacuum_kpa}
    options |= dict(option_value(text, text) for text in option or ())
    bags = {each: output / each for each in (tuple(EXERCISES) if name == "all" else (name,))}
    do({bag: RunSheet(each, options) for each, bag in bags.items()}, normalised(namespace), StopRequest())
    for bag in bags.values():
        typer.echo(str(bag))
    results.write_json(json, {"bags": {each: str(bag) for each, bag in bags.items()}})
    return 0


@app.command(rich_help_panel=ON_THE_GRAPH)
def demo(
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder in which the run gets a folder.", metavar="DIR")
    ] = Path("runs"),
    namespace: NamespaceOption = "/",
    effect: Annotated[
        str | None,
        typer.Option(help="What is done to the simulated ankle, by name.", show_default="drawn, and named at the end"),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(
            help="Draws the effect and its size: the same seed, the same demo.", show_default="another each time"
        ),
    ] = None,
    no_effect: Annotated[  # noqa: FBT002 - a switch of the command line
        bool, typer.Option("--no-effect", help="Leave the simulated ankle as its simulator has it.")
    ] = False,
    json: JsonOption = None,
) -> int:
    """Land a simulated ankle on a 40 degree slope, record it, and diagnose what is wrong with it."""
    from jammkle_bringup.demo import demo as land
    from jammkle_bringup.demo import fresh_folder, summary_table
    from jammkle_gap import HiddenEffect

    results.check_writable(json)
    if no_effect and effect is not None:
        return failed(f"--effect {effect} and --no-effect exclude each other: give one of them", EXIT_BAD_INPUT)
    hidden = HiddenEffect.nothing() if no_effect else HiddenEffect.drawn(effect, seed)
    today = dt.datetime.now(tz=dt.timezone.utc).astimezone().date()
    result = land(lambda: fresh_folder(output, today), normalised(namespace), hidden, StopRequest())
    console = results.console()
    console.print(summary_table(result.summary))
    for line in result.summary.missing:
        console.print(f"not in the bag: {line}", markup=False)
    console.print(f"picture: {result.picture}", markup=False)
    result.ending.show(console)
    console.print(f"page: {result.page}", markup=False)
    files = {"picture": str(result.picture), "page": str(result.page)}
    results.write_json(json, {**result.summary.as_json(), **files, **result.ending.as_json()})
    return result.exit_code


@app.command(rich_help_panel=ON_BAGS)
def info(bag: BagArgument, verbose: AllOption = False, json: JsonOption = None) -> int:  # noqa: FBT002 - a switch
    """Show what a bag holds, and whether it is whole: duration, topics, types, counts, rates, QoS, custom data."""
    from jammkle_bringup.core.bag_info import bag_info, custom_lines, info_line, info_table
    from jammkle_common.bags.run_sheet import TEMPLATE

    results.check_writable(json)
    with _reading(bag) as show:
        found = bag_info(bag, show)
    console = results.console()
    console.print(info_line(found), markup=False)
    console.print(info_table(found))
    for line in custom_lines(found, verbose=verbose):
        console.print(line, markup=False)
    if not found.has_run_sheet:
        console.print("no run sheet: neither the bag nor a file says what was done to the machine. As a template:")
        console.print(TEMPLATE, markup=False, highlight=False)
    results.write_json(json, dataclasses.asdict(found))
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
    from jammkle_common.bags.recovery import recover as make_whole

    results.check_writable(json)
    try:
        with _reading(bag) as show:
            done = make_whole(bag, show, output)
    except OSError as error:
        return failed(f"bag {bag} cannot be recovered: {error.strerror or error}", EXIT_FAILED)
    results.console().print(done.text(), markup=False)
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
    if csv and parquet:
        msg = "--csv and --parquet exclude each other: give one of them"
        raise InputError(msg)
    if rate_hz is not None and not LEAST_RATE_HZ <= rate_hz <= LARGEST_RATE_HZ:
        msg = f"--rate-hz {rate_hz:g} must be {LEAST_RATE_HZ:g} to {LARGEST_RATE_HZ:g} Hz"
        raise InputError(msg)
    results.check_writable(json)
    from jammkle_bringup.core.export import export as write_tables
    from jammkle_bringup.core.export import exported_table

    stop = StopRequest()
    try:
        output.mkdir(parents=True)
    except FileExistsError as error:
        msg = f"--output {output} exists: nothing is overwritten; choose another one or move it away"
        raise InputError(msg) from error
    except OSError as error:
        msg = f"folder {output} cannot be made: {error.strerror}"
        raise InputError(msg) from error
    with _whole_or_gone(output, f"a table cannot be written into {output}"), _reading(bag) as show:
        done = write_tables(bag, output, "parquet" if parquet else "csv", rate_hz, show, stop)
    console = results.console()
    console.print(f"{output}: time_s counts from ROS time {done.start_s:.9f} s", markup=False)
    console.print(exported_table(done))
    results.write_json(json, dataclasses.asdict(done))
    return 0


@contextlib.contextmanager
def _reading(bag: Path) -> Iterator[Callable[[float], None]]:
    """Show a bar; give what takes the share that was read, 0 to 1."""
    with results.progress_bar(f"reading {bag}") as show:
        yield lambda share: show(share, "")


@contextlib.contextmanager
def _whole_or_gone(new: Path, failure: str) -> Iterator[None]:
    """Remove a new folder or file if the block does not come to its end; say what has failed on an error of a disk."""
    try:
        yield
    except BaseException as error:
        shutil.rmtree(new, ignore_errors=True)
        with contextlib.suppress(OSError):
            new.unlink(missing_ok=True)
        if isinstance(error, OSError):
            msg = f"{failure}: {error.strerror or error}"
            raise GraphError(msg) from error
        raise


@app.command(rich_help_panel=ON_BAGS)
def plot(
    bag: BagArgument,
    output: Annotated[
        Path, typer.Option("-o", "--output", help=f"Folder of the new page, {PAGE_NAME}.", metavar="DIR")
    ] = Path("runs/plot"),
    namespace: Annotated[str | None, typer.Option(help="Namespace of the ankle, if the bag holds several.")] = None,
    json: JsonOption = None,
) -> int:
    """Draw a run as a page: vacuum and states, pump, IMU with events, tension against extension."""
    from jammkle_bringup.core.run_plot import run_picture, write_html

    results.check_writable(json)
    page = output / PAGE_NAME
    if page.exists():
        msg = f"--output {output} holds {PAGE_NAME}: nothing is overwritten; choose another or move it away"
        raise InputError(msg)
    place = None if namespace is None else normalised(namespace)
    with _reading(bag) as show:
        picture = run_picture(bag, place, show, StopRequest())
    new = page if output.exists() else output
    results.make_folder(output)
    with _whole_or_gone(new, f"the page cannot be written into {output}"):
        write_html(picture, page)
    console = results.console()
    if picture.note:
        console.print(picture.note, markup=False)
    console.print(f"the page is {page}", markup=False)
    results.write_json(json, {"bag": str(bag), "page": str(page), "note": picture.note})
    return 0


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
    from jammkle_bringup.core.renaming import JointRenaming, topics_of
    from jammkle_bringup.core.renaming import rename as write_anew
    from jammkle_common.bags.writing import check_free

    if not joint and not topic:
        msg = "nothing to rename: give --joint theirs=ours or --topic /theirs=/ours"
        raise InputError(msg)
    joints, topics = JointRenaming.parsed(",".join(joint or ())), topics_of(topic or [])
    results.check_writable(json)
    check_free(output)
    with _whole_or_gone(output, f"bag {output} cannot be written"), _reading(bag) as show:
        count, changed = write_anew(bag, output, joints, topics, show, StopRequest())
    text = f"{output}: {count} messages"
    text += f", {changed} of them with renamed joints" if joints.new else ""
    results.console().print(text, markup=False)
    done = {"bag": str(output), "messages": count, "joint_messages": changed, "topics": topics}
    results.write_json(json, done)
    return 0
