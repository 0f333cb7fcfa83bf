"""The `jammkle` command and what its verbs share. The verbs are each package's own, named by entry points."""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Any

from jammkle_common.command.errors import InputError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

COMMANDS = "jammkle.commands"
"""A Typer app each, with a command or a group of the entry point's name in it."""
EFFECTS_FILE = "jammkle.effects_file"
"""`load`: takes the path of an effects file and returns what it does to a rig (`jammkle_sim.rigs.rig`)."""
EXERCISE = "jammkle.exercise"
"""`record`: takes a live robot through exercises and records each; `is_simulated`: whether it is a simulated one
(`jammkle_bringup.exercise`)."""
HARDWARE = "jammkle.hardware"
"""Makes what the driver drives, by the name that its parameter `hardware` has (`jammkle_driver.hardware`)."""


def entries(group: str) -> dict[str, EntryPoint]:
    """Return what is installed, by name, sorted."""
    return {each.name: each for each in sorted(entry_points(group=group), key=lambda each: each.name)}


def provided(group: str, name: str, package: str) -> Any:
    """Return what an entry point stands for; `package` brings it along, for the error.

    Raises:
        InputError: the package is not installed.

    """
    found = entries(group).get(name)
    if found is None:
        msg = f"this needs the package {package}, which is not installed: build it and source the workspace"
        raise InputError(msg)
    return found.load()
