"""How processes of ours start: tied to their parent, held until all are loaded, talking to others by UDP.

    python processes.py PARENT_PID COMMAND [ARGUMENT ...]              tied: end with the parent, then be the command
    python -m jammkle_common.processes MODULE [ARGUMENT ...]           held: load a node, start it after a line of input

**Tied.** The kernel sends SIGTERM when the parent ends, however it ends, so that a node still releases its solenoids
and a recorder still completes its bag. It is run as a script: doing the same between fork and exec (`preexec_fn`) is
not safe in a process with threads, and DDS has some.

**Held.** Loading a node takes most of the time of its start, and does nothing on the graph. `jammkle up` has it done
while it looks whether another graph is there; a line on the standard input then starts the node, and the end of the
input ends the process.

**By UDP**, so that a killed process stops nobody else. Fast DDS, the default of ROS 2 Jazzy, talks through queues in
shared memory within one machine. A process that is killed while it holds such a queue leaves it locked, and everybody
who publishes to it waits for `healthy_check_timeout_ms`, 1 s, once per queue (Fast DDS documentation, "Shared Memory
Transport"). Measured on a busy machine: of 24 controllers that were killed, 3 stopped driver and simulation for 2 to
3 s, and the board's watchdog let go of everything. By UDP none of 33.

Participants are also announced ten times a second for 5 s, not for half a second as by default. Who receives the first
announcement of a new participant answers with its own once, by UDP, and the new one, just starting, may miss it: it
then knew nothing of `jammkle up` until that announced itself again, 3 s after the time before.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import MutableMapping, Sequence

HEAVY: Final = "LOADED_LATER"
"""Name in a node's `__main__` for the modules that it loads only when it starts."""

_PR_SET_PDEATHSIG: Final = 1  # linux/prctl.h
_EXIT_ORPHANED: Final = 143  # what a shell reports for SIGTERM

_IMPLEMENTATION: Final = "RMW_IMPLEMENTATION"
_RANGE: Final = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_LOCALHOST_ONLY: Final = "ROS_LOCALHOST_ONLY"
_TRANSPORTS: Final = "FASTDDS_BUILTIN_TRANSPORTS"
_STATIC_PEERS: Final = "ROS_STATIC_PEERS"
_PROFILES: Final = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
_UDP: Final = "UDPv4"
_FOLDER: Final = os.path.dirname(__file__)  # noqa: PTH120 - pathlib would take half of the start of a tied process
_ON_THIS_MACHINE: Final = f"{_FOLDER}/udp_on_this_machine.xml"
_BEYOND: Final = f"{_FOLDER}/announced_for_longer.xml"
_OURS: Final = (_ON_THIS_MACHINE, _BEYOND)


def tied(command: Sequence[str]) -> list[str]:
    """Return a command that ends with this process; its first word is an absolute path."""
    # -S and -E: this file needs the standard library only, and starts in a few milliseconds that way
    return [sys.executable, "-S", "-E", __file__, str(os.getpid()), *command]


def held(command: Sequence[str]) -> list[str]:
    """Return the command that loads what a `python -m MODULE` loads, and waits for a line before it starts that."""
    python, option, module, *arguments = command
    return [python, option, __name__, module, *arguments]


def end_with_parent(parent: int) -> None:
    """Have the kernel send SIGTERM to this process when its parent, whose process id is given, ends."""
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != parent:  # the parent ended before the signal was set
        sys.exit(_EXIT_ORPHANED)


def talk_by_udp(environment: MutableMapping[str, str]) -> None:
    """Choose UDP for every participant that this process and its children will make.

    What a user has chosen stays: another middleware, a Fast DDS profile, `FASTDDS_BUILTIN_TRANSPORTS`, static peers
    (which the middleware reads with a range alone). With `ROS_LOCALHOST_ONLY=1` (deprecated) shared memory stays, too,
    since the middleware asks for it by itself.

    Args:
        environment: Of a process that is ours, `os.environ`; to be called when it starts. Fast DDS reads profiles once,
            with the first participant: later, the range would be another one, and shared memory still there.

    """
    if not (environment.get(_IMPLEMENTATION) or "rmw_fastrtps").startswith("rmw_fastrtps"):
        return
    if environment.get(_LOCALHOST_ONLY) == "1" or any(
        environment.get(name, _BEYOND) not in _OURS for name in _PROFILES
    ):
        return
    if environment.get(_STATIC_PEERS) or environment.get(_TRANSPORTS, _UDP) != _UDP:
        return
    if environment.get(_RANGE) == "LOCALHOST":
        # For this range rmw_fastrtps adds shared memory whatever a profile says; ours has the rest of what it sets.
        environment[_PROFILES[0]] = _ON_THIS_MACHINE
        environment[_RANGE] = "SYSTEM_DEFAULT"
    elif environment.get(_PROFILES[0], _BEYOND) == _BEYOND:
        environment[_TRANSPORTS] = _UDP
        environment[_PROFILES[0]] = _BEYOND


def main() -> int:
    """Be tied or held, as the first word is a process id or a module; return the exit code."""
    first, *rest = sys.argv[1:]
    if not first.isdigit():
        return _held(first, rest)
    end_with_parent(int(first))
    return os.execv(rest[0], rest)  # noqa: S606 - no shell is wanted; the command is the supervisor's own


def _held(name: str, arguments: Sequence[str]) -> int:
    """Load, wait, start; return the exit code of the node, or 0 if it was never to start."""
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
