"""Read YAML that people write: each name once, 5e4 a number as in YAML 1.2 and ROS, dates as they are written.

PyYAML by itself keeps the last of two values without a word, and reads 5e4 as text, being of YAML 1.1.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import yaml

from jammkle_common.command.errors import InputError
from jammkle_common.parameters import shortened

if TYPE_CHECKING:
    from pathlib import Path

_MOST_DIGITS = 1000
"""Of a whole number. Chosen; Python itself refuses to convert more than 4300."""
_TIMESTAMP = "tag:yaml.org,2002:timestamp"


class _Loader(yaml.SafeLoader):
    """Refuses a name that stands twice, and numbers of too many digits."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:  # noqa: FBT001, FBT002 - PyYAML's
        lines: dict[str, int] = {}
        for key, value in node.value:
            if key.tag == "tag:yaml.org,2002:merge":
                continue
            name = str(self.construct_object(key, deep=True))
            line = key.start_mark.line + 1
            if name in lines:
                msg = f"{shortened(name)} stands in line {lines[name]} and again in line {line}; leave one of them"
                raise InputError(msg)
            lines[name] = line
            if isinstance(value, yaml.ScalarNode) and value.tag.endswith(":int") and len(value.value) > _MOST_DIGITS:
                msg = f"{name} is {shortened(value.value)}; a number must have at most {_MOST_DIGITS} digits"
                raise InputError(msg)
        return super().construct_mapping(node, deep)


_Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in known if tag != _TIMESTAMP]
    for first, known in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"), list("-+.0123456789")
)


def text_of(file: Path, source: str) -> str:
    """Return the text of a file; errors begin with the source.

    Raises:
        InputError: it cannot be read, or is no text.

    """
    try:
        return file.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        msg = f"{source} is no text in UTF-8; give a YAML file"
        raise InputError(msg) from error
    except (OSError, ValueError) as error:  # no path holds a zero
        msg = f"{source} cannot be read: {getattr(error, 'strerror', '') or error}"
        raise InputError(msg) from error


def read_file(file: Path, source: str) -> Any:
    """Return what a file holds: `text_of` and `read_yaml` in one."""
    return read_yaml(text_of(file, source), source)


def read_yaml(text: str, source: str) -> Any:
    """Return what a text holds.

    Args:
        text: YAML.
        source: Where it is from, for errors: a file, an option.

    Raises:
        InputError: it is not YAML, or a name stands in it twice. The message begins with the source.

    """
    try:
        return yaml.load(text, _Loader)  # noqa: S506 - a safe loader
    except InputError as error:
        msg = f"{source}: {error}"
        raise InputError(msg) from error
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError) as error:
        msg = f"{source} is not YAML: {' '.join(str(error).split())}"
        raise InputError(msg) from error
