"""Several nodes in one process: `python -m jammkle_bringup.composed [NODE ...] [--ros-args ...]`.

Without names the simulated ankle, its controller and its driver. On hardware: `composed controller driver`; of several
ankles `composed lf_ankle/controller lf_ankle/driver rf_ankle/controller rf_ankle/driver`. Parameters of one node stand
in a file, in its own section (`/**/driver`, `/lf_ankle/driver`). One process takes less of the processor and of memory;
its nodes share one core and one end, which is why `jammkle up` keeps them apart.
"""

from __future__ import annotations

import sys
from functools import partial
from typing import TYPE_CHECKING

from jammkle_common.names import CONTROLLER_NODE, DRIVER_NODE, SIM_NODE
from jammkle_common.runner import EXIT_BAD_INPUT, run

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rclpy.node import Node

_ROS_ARGUMENTS = "--ros-args"


def _sim(_within: str) -> Node:
    from jammkle_sim.kinds import RIG  # noqa: PLC0415 - loaded where it is asked for
    from jammkle_sim.node import SimNode  # noqa: PLC0415 - as above

    return SimNode(RIG)


def _controller(within: str) -> Node:
    from jammkle_controller.node import ControllerNode  # noqa: PLC0415 - as above

    return ControllerNode(namespace=within)


def _driver(within: str) -> Node:
    from jammkle_driver.node import DriverNode  # noqa: PLC0415 - as above

    node = DriverNode(namespace=within)
    node.start()
    return node


MAKERS: dict[str, Callable[[str], Node]] = {SIM_NODE: _sim, CONTROLLER_NODE: _controller, DRIVER_NODE: _driver}
"""By name, in the order in which they start; each gets the namespace of its ankle, empty where `__ns` says it.

The simulation is first, as it drives all; the driver last, as it lets go while the others are there.
"""
_NAMESPACE_RULE = "__ns:="


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until SIGINT or SIGTERM and return the exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    place = given.index(_ROS_ARGUMENTS) if _ROS_ARGUMENTS in given else len(given)
    names, ros = given[:place] or list(MAKERS), given[place:]
    wrong = _wrong(names, ros)
    if wrong:
        sys.stderr.write(f"{wrong}\n")
        return EXIT_BAD_INPUT
    if SIM_NODE in names:  # what is around a simulation runs on its clock, whatever is set for all; itself it does not
        ros = [*(ros or [_ROS_ARGUMENTS]), "-p", "use_sim_time:=true"]
    makers = [
        partial(make, path.rpartition("/")[0])
        for name, make in MAKERS.items()
        for path in dict.fromkeys(names)
        if path.rpartition("/")[2] == name
    ]
    return run(*makers, arguments=ros)


def _wrong(paths: Sequence[str], ros: Sequence[str]) -> str:
    """Return a line on what cannot be composed, or nothing."""
    for path in paths:
        within, _, name = path.rpartition("/")
        if name not in MAKERS or (within and name == SIM_NODE):
            return f"there is no node '{path}'; known are: {', '.join(MAKERS)}, and of an ankle lf_ankle/{DRIVER_NODE}"
        if within and any(word.startswith(_NAMESPACE_RULE) for word in ros):
            return f"'{path}' and {_NAMESPACE_RULE} exclude each other: leave one of them out"
    return ""


if __name__ == "__main__":
    sys.exit(main())
