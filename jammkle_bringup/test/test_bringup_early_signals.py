"""A signal while the command still loads: no traceback, and the exit code of the subcommand's promise."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

SIGNAL_WHILE_LOADING = """
import os, sys
from jammkle_common.command.__main__ import main

class Interrupter:
    def find_spec(self, name, path=None, target=None):
        if name == sys.argv[-1]:
            os.kill(os.getpid(), int(sys.argv[-2]))

sys.meta_path.insert(0, Interrupter())
main()
"""


@pytest.mark.usefixtures("ros_domain")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("module", ["typer", "jammkle_common.command.main"])
@pytest.mark.parametrize(("subcommand", "code"), [("up", 0), ("record", 0), ("jam", 130), ("info", 130)])
def test_a_signal_while_loading_ends_well(subcommand: str, code: int, module: str, number: signal.Signals) -> None:
    """`up` and `record` run until a signal anyway and exit with 0, the others with 130; one line at most."""
    command = [sys.executable, "-c", SIGNAL_WHILE_LOADING, subcommand, str(int(number)), module]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == code, result.stderr
    assert result.stderr.splitlines() == ["jammkle: interrupted"]
    assert result.stdout == ""


def test_the_entry_point_loads_nothing_before_its_handlers() -> None:
    """Importing it leaves out the command, its argument parser and ROS."""
    code = (
        "import sys, jammkle_common.command.__main__; "
        "sys.exit(bool(set(sys.modules) & {'typer', 'rclpy', 'jammkle_common.command.main'}))"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
