"""Arguments of the verbs that work on the graph. What they do stands in modules of their own."""

# ruff: noqa: PLC0415 - imported where needed: `jammkle --help` shall not wait for ROS, NumPy and Matplotlib

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from jammkle_bringup.core.node_table import SIM_HARDWARE, Robot
from jammkle_common.command.errors import Interrupted, StopRequest
from jammkle_common.command.main import EXIT_BAD_INPUT, EXIT_FAILED, failed
from jammkle_common.command.options import ON_THE_GRAPH, JsonOption, NamespaceOption
from jammkle_common.names import normalised

app = typer.Typer(context_settings={"help_option_names": ["-h", "--help"]})

ChannelsArgument = Annotated[
    list[str] | None, typer.Argument(help="peroneal_left, peroneal_right, achilles; none means all.", metavar="CHANNEL")
]


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
    behaviour: Annotated[
        str | None,
        typer.Option(help="What a simulated leg or quadruped does: stand, walk, drop, slip.", show_default="stand"),
    ] = None,
    monitor: Annotated[  # noqa: FBT002 - a switch of the command line
        bool, typer.Option("--monitor", help="Let a simulated twin follow the robot and warn when it is left.")
    ] = False,
    robot_names: Annotated[  # noqa: FBT002 - as above
        bool,
        typer.Option("--robot-names", help="Call joints and channels as the robot does, too; --params says how."),
    ] = False,
    view: Annotated[  # noqa: FBT002 - as above
        bool, typer.Option("--view", help="Show the robot on a page in the browser, with buttons to jam and unjam.")
    ] = False,
    view_port: Annotated[
        int | None, typer.Option(help="TCP port of that page.", show_default="the first free one from 8080 on")
    ] = None,
    view_host: Annotated[
        str | None, typer.Option(help="Address it listens on; 0.0.0.0: every network.", show_default="this machine")
    ] = None,
    foxglove: Annotated[  # noqa: FBT002 - as above
        bool, typer.Option("--foxglove", help="Let the Foxglove app look on, over a WebSocket; it can change nothing.")
    ] = False,
    foxglove_port: Annotated[int | None, typer.Option(help="TCP port of that WebSocket.", show_default="8765")] = None,
    foxglove_host: Annotated[
        str | None, typer.Option(help="Address it listens on; 0.0.0.0: every network.", show_default="this machine")
    ] = None,
) -> int:
    """Start driver, controller and simulation (or hardware) and keep them up until Ctrl-C."""
    from jammkle_bringup.graph_options import (
        GraphOptions,
        foxglove_values,
        given_values,
        robot_values,
        viewer_values,
        with_given,
    )
    from jammkle_bringup.up import up as run_graph

    values = given_values(hardware, speed, port) | viewer_values(robot, view_host, view_port, view=view)
    values |= foxglove_values(foxglove_host, foxglove_port, foxglove=foxglove)
    for node, chosen in robot_values(robot, behaviour, hardware).items():
        values[node] = {**values.get(node, {}), **chosen}
    options = GraphOptions(
        normalised(namespace),
        hardware,
        tuple(params or ()),
        record,
        values,
        robot,
        monitor=monitor,
        view=view,
        foxglove=foxglove,
        robot_names=robot_names,
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
    from jammkle_bringup import channel_commands
    from jammkle_common.command import results

    results.check_writable(json)
    answers = channel_commands.jam(normalised(namespace), channels or [], vacuum_kpa, StopRequest())
    return _answered(*channel_commands.together(answers), json)


@app.command(rich_help_panel=ON_THE_GRAPH)
def unjam(channels: ChannelsArgument = None, namespace: NamespaceOption = "/", json: JsonOption = None) -> int:
    """Unjam channels: vent their tendons to the atmosphere."""
    from jammkle_bringup import channel_commands
    from jammkle_common.command import results

    results.check_writable(json)
    answers = channel_commands.unjam(normalised(namespace), channels or [], StopRequest())
    return _answered(*channel_commands.together(answers), json)


@app.command(rich_help_panel=ON_THE_GRAPH)
def status(
    namespace: NamespaceOption = "/",
    verbose: Annotated[  # noqa: FBT002 - a switch of the command line
        bool, typer.Option("--all", "--verbose", help="Show every line of every node, with all values.")
    ] = False,
    json: JsonOption = None,
) -> int:
    """Show the state of every channel, and of the nodes' health what is not OK."""
    import dataclasses

    from jammkle_bringup import channel_commands, report
    from jammkle_common.command import results

    results.check_writable(json)
    ankles, health = channel_commands.status(normalised(namespace), StopRequest())
    console = results.console()
    console.print(report.status_line(ankles, health, verbose=verbose), markup=False)
    for ankle, jam_status in ankles.items():
        if jam_status.emergency_stopped:
            driver = f"{ankle}/driver" if ankle else "driver"
            console.print(f"emergency stop: everything is released until {driver}/clear_fault")
    for table in report.status_tables(ankles, health, verbose=verbose):
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
    from jammkle_bringup.record import record as record_graph
    from jammkle_common.command import results

    results.check_writable(json)
    counts = record_graph(output, normalised(namespace), clock)
    results.write_json(json, {"bag": str(output), "messages": counts.messages, "by_topic": counts.by_topic})
    return 0


@app.command(rich_help_panel=ON_THE_GRAPH)
def demo(
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder in which the run gets a folder.", metavar="DIR")
    ] = Path("runs"),
    namespace: NamespaceOption = "/",
    effect: Annotated[
        str | None,
        typer.Option(help="What is done to the simulated ankle, by name.", show_default="drawn, and not told"),
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
    import datetime as dt

    from jammkle_bringup import report
    from jammkle_bringup.core.run_folder import fresh_folder
    from jammkle_bringup.demo import demo as land
    from jammkle_common.command import results
    from jammkle_gap import Riddle

    results.check_writable(json)
    if no_effect and effect is not None:
        return failed(f"--effect {effect} and --no-effect exclude each other: give one of them", EXIT_BAD_INPUT)
    riddle = Riddle.nothing() if no_effect else Riddle.drawn(effect, seed)
    today = dt.datetime.now(tz=dt.timezone.utc).astimezone().date()
    result = land(lambda: fresh_folder(output, today), normalised(namespace), riddle, StopRequest())
    console = results.console()
    console.print(report.summary_table(result.summary))
    for line in result.summary.missing:
        console.print(f"not in the bag: {line}", markup=False)
    console.print(f"picture: {result.picture}", markup=False)
    result.ending.show(console)
    console.print(f"page: {result.page}", markup=False)
    files = {"picture": str(result.picture), "page": str(result.page)}
    results.write_json(json, {**result.summary.as_json(), **files, **result.ending.as_json()})
    return result.exit_code


def _answered(answer: Any, content: dict[str, Any], json: Path | None) -> int:
    """Show what the driver, or each of a robot's, said to a request."""
    from jammkle_common.command import results

    results.write_json(json, content)
    if not answer.success:
        return failed(answer.message, EXIT_FAILED)
    typer.echo(answer.message)
    return 0
