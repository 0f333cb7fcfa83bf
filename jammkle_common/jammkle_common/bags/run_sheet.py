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

from jammkle_common.command.errors import InputError
from jammkle_common.names import SIM_PARAMETERS
from jammkle_common.parameters import is_number, shortened
from jammkle_common.yaml_text import read_yaml, text_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

FILE_NAME = "run.yaml"
KEYS = ("rig", "robot", "options")
"""What a run sheet is known by."""
_PARTS = (
    "ankle",
    "leg",
    "quadruped",
    "tendon",
    "pneumatics",
    "sensors",
    "hard_contact",
    "squash_ball",
    "standard_foot",
)
RECORDED = frozenset(("timestep_s", "ankles", "effects", *_PARTS))
"""What a bag of this project holds beside them: constants of the machine, which follow from the options."""
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
    robot: str = ""
    """Robot of ours that was simulated, and whose options these are; empty: it was none."""
    beside: Mapping[str, Any] = field(default_factory=dict, compare=False)
    """What a file holds beside these; empty for a bag."""

    def as_mapping(self) -> dict[str, Any]:
        """Return what is written into a bag or a file."""
        return {"rig": self.rig, "options": dict(self.options)}


def read_text(text: str, source: str) -> RunSheet:
    """Read a run sheet from YAML, whatever else it holds; `source` is what it is from, for the error.

    Raises:
        InputError: it is not YAML, or rig or options are not what they must be.

    """
    content = read_yaml(text, source)
    return _sheet_of(content if isinstance(content, dict) else {}, source, _plain)


def read_options(text: str, source: str) -> RunSheet | dict[str, Any]:
    """Read a file of options: a run sheet, or else a table of names and values, in whatever units the names say.

    Raises:
        InputError: it is neither; the message begins with the source.

    """
    content = read_yaml(text, source)
    if content is None:
        return {}
    if not isinstance(content, dict):
        msg = f"{source} holds {_kind(content)}; {_WRITE}"
        raise InputError(msg)
    if content.keys() & set(KEYS):
        return _sheet_of(content, source, _word)
    return {str(name): _word(value) for name, value in content.items()}


_WRITE = "write NAME: VALUE, one a line"


def _kind(content: Any) -> str:
    kinds = {list: "a list", str: "a text", bool: "a word"}
    return f"{kinds.get(type(content), 'a value')}, {shortened(content)}, and no mapping"


def _sheet_of(content: Mapping[str, Any], source: str, plain: Callable[[Any], Any]) -> RunSheet:
    options = content.get("options")
    options = {} if options is None else options
    if not isinstance(options, dict):
        msg = f"{source} has options that are {_kind(options)}; {_WRITE}"
        raise InputError(msg)
    taken = {str(name): plain(value) for name, value in options.items()}
    beside = {str(name): value for name, value in content.items() if name not in KEYS}
    return RunSheet(str(content.get("rig") or ""), taken, str(content.get("robot") or ""), beside)


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
    written = read_text(text_of(file, f"run sheet {file}"), str(file))
    return RunSheet(written.rig or own.rig, {**own.options, **written.options}, written.robot or own.robot)


def _word(value: Any) -> Any:
    """Return yes and no as the words that they are."""
    return ("yes" if value else "no") if isinstance(value, bool) else value


def _plain(value: Any) -> Any:
    """Return numbers in quotes as numbers too, in a run sheet that nobody has just typed."""
    return float(value) if isinstance(value, str) and is_number(value) else _word(value)
