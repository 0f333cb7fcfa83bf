"""Several nodes of one ankle in one process: `python -m jammkle_bringup.composed [NODE ...] [--ros-args ...]`.

Without names the simulated ankle, its controller and its driver. On hardware: `composed controller driver`. Parameters
of one node stand in a file, in its own section (`/**/driver`). One process takes less of the processor and of
memory; its nodes share one core and one end, which is why `jammkle up` keeps them apart.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from jammkle_graph.names import CONTROLLER_NODE, DRIVER_NODE, SIM_NODE
from jammkle_graph.runner import EXIT_BAD_INPUT, run_together

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rclpy.executors import Executor
    from rclpy.node import Node

    from jammkle_graph.runner import StopFlag

_ROS_ARGUMENTS = "--ros-args"
_SPIN_S = 0.1


def _sim() -> Node:
    from jammkle_sim.landing import make_simulation  # noqa: PLC0415 - loaded where it is asked for
    from jammkle_sim.node import SimNode  # noqa: PLC0415 - as above

    return SimNode(make_simulation)


def _controller() -> Node:
    from jammkle_controller.node import ControllerNode  # noqa: PLC0415 - as above

    return ControllerNode()


def _driver() -> Node:
    from jammkle_driver.node import DriverNode  # noqa: PLC0415 - as above

    node = DriverNode()
    node.start()
    return node


MAKERS: dict[str, Callable[[], Node]] = {SIM_NODE: _sim, CONTROLLER_NODE: _controller, DRIVER_NODE: _driver}
"""By name, in the order in which they start."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until SIGINT or SIGTERM and return the exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    place = given.index(_ROS_ARGUMENTS) if _ROS_ARGUMENTS in given else len(given)
    names, ros = given[:place] or list(MAKERS), given[place:]
    unknown = [name for name in names if name not in MAKERS]
    if unknown:
        sys.stderr.write(f"there is no node '{unknown[0]}'; known are: {', '.join(MAKERS)}\n")
        return EXIT_BAD_INPUT
    if SIM_NODE in names:  # what is around a simulation runs on its clock, whatever is set for all; itself it does not
        ros = [*(ros or [_ROS_ARGUMENTS]), "-p", "use_sim_time:=true"]
    chosen = [name for name in MAKERS if name in names]
    return run_together([MAKERS[name] for name in chosen], ros, loop=_drive, shut_down=_shut_down)


def _drive(nodes: Sequence[Node], executor: Executor, stop: StopFlag) -> None:
    """Let the simulation drive all; it serves callbacks until its next step is due."""
    first: Any = nodes[0]
    if first.get_name() == SIM_NODE:
        first.drive(executor, stop)
        return
    while not stop:
        executor.spin_once(timeout_sec=_SPIN_S)


def _shut_down(nodes: Sequence[Node]) -> None:
    """End in the reverse order: the driver lets go while the others are there."""
    for node in reversed(nodes):
        last: Any = node
        last.shut_down()


if __name__ == "__main__":
    sys.exit(main())
