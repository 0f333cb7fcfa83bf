"""The run sheet of a bag: what was done to the machine while it was recorded.

A bag of this project holds it in `sim_parameters`, beside all else that was simulated. For a bag of another recorder it
is a short file, `run.yaml`, in the folder of the bag, or beside it for all bags of a folder:

    rig: drop
    options:
      drop_height_m: 0.08
      foot: jammed
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import yaml

from jammkle_common.command.errors import InputError
from jammkle_common.names import SIM_PARAMETERS

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

FILE_NAME = "run.yaml"
TEMPLATE = f"""\
# {FILE_NAME}: what was done to the machine. Put it into the folder of the bag, or beside it for all bags of the folder.
rig: drop             # tensile, pressure, drop, slip, landing
options:              # as in `jammkle rig RIG --help`, in SI units; leave out what is not known
  drop_height_m: 0.05 # how it was released and driven is among them: release_time_s, speed_m_s, extension_m
  foot: jammed
"""


@dataclass(frozen=True)
class RunSheet:
    """What was done to a machine. How it was driven and released is among the options, if no sensor shows it."""

    rig: str = ""
    """What it was recorded on; empty: not known."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """How that was set, SI, by the names of the rig's options; those not named are not known."""

    def as_mapping(self) -> dict[str, Any]:
        """Return what is written into a bag or a file."""
        return {"rig": self.rig, "options": dict(self.options)}


def read_text(text: str, source: str) -> RunSheet:
    """Read a run sheet from YAML, whatever else it holds; `source` is what it is from, for the error.

    Raises:
        InputError: it is not YAML, or rig or options are not what they must be.

    """
    try:
        content: Any = yaml.safe_load(text)
    except yaml.YAMLError as error:
        msg = f"{source} is not YAML: {' '.join(str(error).split())}"
        raise InputError(msg) from error
    content = content if isinstance(content, dict) else {}
    options = content.get("options") or {}
    if not isinstance(options, dict):
        msg = f"{source} has options that are no table but '{options}'; write them as NAME: VALUE, one a line"
        raise InputError(msg)
    return RunSheet(str(content.get("rig") or ""), {str(name): _plain(value) for name, value in options.items()})


def read_sheet(bag: Path, recorded: str | None, name: str = "") -> RunSheet:
    """Return the run sheet of a bag; what a person wrote into its folder goes before what was recorded.

    Args:
        bag: Its folder or file.
        recorded: What the bag holds of `sim_parameters`; None: nothing.
        name: Of the bag, for errors.

    Raises:
        InputError: the file cannot be read.

    """
    own = RunSheet()
    if recorded is not None:
        own = read_text(recorded, f"{SIM_PARAMETERS.name} in bag {name or bag.name}")
    within, around = bag / FILE_NAME, bag.parent / FILE_NAME
    file = within if within.is_file() else around if around.is_file() and not own.rig else None
    if file is None:
        return own
    try:
        written = read_text(file.read_text(encoding="utf-8"), str(file))
    except (OSError, UnicodeDecodeError) as error:
        msg = f"run sheet {file} cannot be read: {error}"
        raise InputError(msg) from error
    return RunSheet(written.rig or own.rig, {**own.options, **written.options})


def _plain(value: Any) -> Any:
    """Return a number where YAML takes one for a word, such as 5e4, and yes and no as the words that they are."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value
