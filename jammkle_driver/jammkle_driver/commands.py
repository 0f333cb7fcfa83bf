"""Arguments of `jammkle hardware`. What it does stands in `jammkle_driver.board`."""

# ruff: noqa: PLC0415 - imported where needed: `jammkle --help` shall not wait for pymodbus
from __future__ import annotations

from pathlib import Path  # noqa: TC003 - Typer reads annotations while it runs
from typing import TYPE_CHECKING, Annotated

import typer

from jammkle_common.command.errors import GraphError, InputError
from jammkle_common.command.main import EXIT_FAILED
from jammkle_common.command.options import ON_THE_BOARD, JsonOption

if TYPE_CHECKING:
    from jammkle_driver.board.check import CheckRow


hardware_app = typer.Typer(
    help="Look after the board: pump, valves and sensors, without the graph.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app = typer.Typer()
app.add_typer(hardware_app, name="hardware", rich_help_panel=ON_THE_BOARD)


@hardware_app.callback()
def group() -> None:
    """Look after the board: pump, valves and sensors, without the graph."""


@hardware_app.command()
def check(
    port: Annotated[str, typer.Option(help="A serial device, or tcp://HOST[:PORT].", metavar="DEV")],
    board_file: Annotated[
        Path | None,
        typer.Option(help="How the board is wired (YAML).", show_default="the project's own board", metavar="FILE"),
    ] = None,
    save_board_file: Annotated[
        Path | None, typer.Option(help="Where the calibrated board file of a bought board goes.", metavar="FILE")
    ] = None,
    yes: Annotated[  # noqa: FBT002 - a switch of the command line
        bool, typer.Option("--yes", help="Ask nothing: start at once, and leave the calibration as it is.")
    ] = False,
    json: JsonOption = None,
) -> int:
    """Check pump, valves, sensors and leaks, calibrate the sensors, and say what to do."""
    import asyncio

    from jammkle_common.command import results
    from jammkle_common.command.errors import Interrupted, StopRequest
    from jammkle_driver.board.commissioning import CommissioningOptions, Prompt, commission
    from jammkle_driver.board.line import LineError, check_port
    from jammkle_driver.board.wiring import load_wiring

    results.check_writable(json)
    results.check_writable(save_board_file, "--save-board-file")
    try:
        check_port(port)
        wiring = load_wiring(board_file)
    except ValueError as error:
        msg = f"--{error}" if str(error).startswith("port") else str(error)
        raise InputError(msg) from error
    prompt = Prompt()
    if not yes and not asyncio.run(prompt.agrees("Pump and valves will run: the ankle stiffens and softens. Go on?")):
        raise Interrupted
    options = CommissioningOptions(port, wiring, board_file, save_board_file, calibrates=not yes)
    try:
        rows = asyncio.run(commission(options, prompt, StopRequest()))
    except LineError as error:
        raise GraphError(str(error)) from error
    except Interrupted as error:
        msg = "interrupted: pump and valves are released"
        raise Interrupted(msg) from error
    results.console().print(_table(rows))
    content = [{"what": r.what, "passed": r.passed, "measured": r.measured, "to_do": r.to_do} for r in rows]
    results.write_json(json, {"passed": all(row.passed for row in rows), "rows": content})
    return 0 if all(row.passed for row in rows) else EXIT_FAILED


def _table(rows: list[CheckRow]) -> object:
    from rich.table import Table

    table = Table("what", "result", "measured", "what to do")
    for row in rows:
        table.add_row(row.what, "pass" if row.passed else "FAIL", row.measured, row.to_do)
    return table
