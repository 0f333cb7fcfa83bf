"""`python -m jammkle_common.command.held MODULE [ARGUMENT ...]`: load a node, and start it when told to.

Loading a node takes most of the time of its start, and does nothing on the graph. `jammkle up` has it done while it
looks whether another graph is there; a line on the standard input then lets the node start, and its end lets it not.
"""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.util import find_spec

HEAVY = "LOADED_LATER"
"""Name in a node's `__main__` for the modules that it loads only when it starts."""


def main() -> int:
    """Load, wait, start; return the exit code of the node, or 0 if it was never to start."""
    name, *arguments = sys.argv[1:]
    found = find_spec(name)
    # as `python -m` does: of a package its `__main__`, else the module itself
    is_package = found is not None and found.submodule_search_locations is not None
    module = import_module(f"{name}.__main__" if is_package else name)
    for each in getattr(module, HEAVY, ()):
        import_module(each)
    if not sys.stdin.readline():
        return 0
    sys.argv = [str(module.__file__), *arguments]
    return int(module.main())


if __name__ == "__main__":
    sys.exit(main())
