"""The `jammkle` command: arguments in, exit code out. Its verbs are loaded when they are called or listed."""

from __future__ import annotations

import errno
import io
import os
import sys
from pathlib import Path
from typing import Annotated, Any, Protocol, runtime_checkable

import typer
from typer.core import TyperGroup

from jammkle_common import VERSION
from jammkle_common.command import COMMANDS, entries
from jammkle_common.command.errors import GraphError, InputError, Interrupted
from jammkle_common.messages import ROS_MODULES
from jammkle_common.parameters import renamed

_EXTRAS = {
    "viser": "this opens a page in the browser, and so needs viser: pip install 'jammkle[view]'",
    "plotly": "the page of a run needs plotly: pip install 'jammkle[bags]', or `make extras` in a checkout",
    "pyarrow": "tables need pyarrow: pip install 'jammkle[bags]', or `make extras` in a checkout",
    "sklearn": "studies need scikit-learn: `make extras` in a checkout",
}
"""What to say where a module is missing that only some verbs need, by its name."""
_EXTRAS["trimesh"] = _EXTRAS["viser"]
_NO_ROS = "this works on the graph, and so needs ROS 2 Jazzy: pip install 'jammkle[ros]', or source an installation"

EXIT_FAILED = 1
EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130


class _Verbs(TyperGroup):
    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ARG002 - as the library calls it
        """Return their names."""
        return list(entries(COMMANDS))

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return one of them; None if there is none of this name."""
        entry = entries(COMMANDS).get(cmd_name)
        if entry is None:
            self.commands = dict.fromkeys(entries(COMMANDS), self)  # what a wrong word is compared with
            return None
        brought: Any = typer.main.get_group(entry.load())
        return brought.get_command(ctx, cmd_name)


app = typer.Typer(
    cls=_Verbs,
    help="Bring up, command, watch and record legged robots' jammable ankles.",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@runtime_checkable
class _UsageProblem(Protocol):
    """What the argument parser raises when the command line is wrong."""

    exit_code: int

    def format_message(self) -> str:
        """Say what is wrong."""


def main(arguments: list[str] | None = None) -> int:
    """Run the `jammkle` command and return its exit code."""
    return run(app, arguments)


def run(command: typer.Typer, arguments: list[str] | None = None) -> int:
    """Run a command line, None: of this process; return 0 done, 1 failed, 2 bad input, 130 interrupted."""
    sys.stdout, sys.stderr = sys.stdout or _nowhere(), sys.stderr or _nowhere()  # the shell may have closed them
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a name of a file may be no text
    stdout = sys.stdout
    try:
        code = _run(command, arguments)
        stdout.flush()
    except OSError as error:
        if error.errno != errno.ENOSPC:
            raise
        with _nowhere() as nowhere:  # what is left of it cannot be written either
            os.dup2(nowhere.fileno(), stdout.fileno())
        return failed(f"the output cannot be written: {error.strerror}; make room, or write it elsewhere", EXIT_FAILED)
    else:
        return code
    finally:
        sys.stdout = stdout  # `--json -` has taken it


def _run(command: typer.Typer, arguments: list[str] | None) -> int:
    try:
        code: Any = command(arguments, standalone_mode=False)
    except InputError as error:
        return failed(str(error), EXIT_BAD_INPUT)
    except GraphError as error:
        return failed(str(error), EXIT_FAILED)
    except (Interrupted, KeyboardInterrupt, typer.Abort) as error:
        return failed(str(error) or "interrupted", EXIT_INTERRUPTED)
    except ModuleNotFoundError as error:
        missing = str(error.name).partition(".")[0]
        if missing not in ROS_MODULES and missing not in _EXTRAS:
            raise
        why = _EXTRAS.get(missing, _NO_ROS)
        return failed(f"{why} (there is no {error.name})", EXIT_FAILED)
    except Exception as error:
        if not isinstance(error, _UsageProblem):
            raise
        return failed(_where_it_went(error) or f"{error.format_message()} (see --help)", error.exit_code)
    return code if isinstance(code, int) else 0


def _nowhere() -> io.TextIOWrapper:
    return Path(os.devnull).open("w", encoding="utf-8")


def _where_it_went(error: Exception) -> str | None:
    """Return the line on an option that has another name now, if that is what the parser did not know."""
    context: Any = getattr(error, "ctx", None)
    option: str | None = getattr(error, "option_name", None)
    if context is None or option is None:
        return None
    known = [name for parameter in context.command.params for name in parameter.opts]
    return renamed(option, known, context.command_path)


def _show_version(wanted: bool) -> None:  # noqa: FBT001 - as the library calls it
    if wanted:
        typer.echo(f"jammkle {VERSION}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def start(
    context: typer.Context,
    version: Annotated[  # noqa: ARG001, FBT002 - a switch of the command line, which ends it
        bool, typer.Option("--version", help="Show the version and exit.", callback=_show_version, is_eager=True)
    ] = False,
) -> None:
    """Show the help if no subcommand is given."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def failed(message: str, exit_code: int) -> int:
    """Say one line and return the exit code."""
    sys.stderr.write(f"jammkle: {' '.join(message.split())}\n")
    return exit_code
