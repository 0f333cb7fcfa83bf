"""How every node of this project starts, spins and ends."""

from __future__ import annotations

import faulthandler
import os
import signal
import sys
from typing import TYPE_CHECKING

import rclpy
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from jammkle_common.parameters import ParameterError
from jammkle_common.processes import talk_by_udp

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from types import FrameType

    from rclpy.executors import Executor
    from rclpy.node import Node

EXIT_BAD_INPUT = 2
_SPIN_TIMEOUT_S = 0.1


class StopFlag:
    """Set by SIGINT and SIGTERM; a loop asks it whether to go on."""

    def __init__(self) -> None:
        """Make an unset flag."""
        self._stopped = False

    def __bool__(self) -> bool:
        """Return True once the process was asked to stop."""
        return self._stopped

    def stop(self, _signal: int | None = None, _frame: FrameType | None = None) -> None:
        """Ask the loop to end; usable as a signal handler."""
        self._stopped = True


def run(*makers: Callable[[], Node], arguments: Sequence[str] | None = None) -> int:
    """Run nodes on one executor of one process until SIGINT or SIGTERM.

    rclpy's own signal handlers end the context before a last message can be sent, so a process keeps its own. A node
    may have `shut_down()`, which publishes the last, safe command while the context is still valid, also when the
    loop ended by an exception; the first may have `drive(executor, stop)`, which is the loop then.

    Args:
        makers: Make the nodes, in order, after rclpy.init; may raise ParameterError. They end in the reverse order.
        arguments: Command line (with `--ros-args`); None takes the process's own.

    Returns:
        The exit code: 0 after a signal, 2 after bad input, which was explained in one line on stderr.

    """
    faulthandler.enable()  # says where a process was that crashed in a library, or hung and was aborted
    stop = StopFlag()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop.stop)
    talk_by_udp(os.environ)
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        # rclpy's only class for a bad --ros-args or a parameter file that cannot be read is private.
        sys.stderr.write(f"the command line cannot be used: {error}\n")
        return EXIT_BAD_INPUT
    try:
        strange = remove_ros_args(sys.argv if arguments is None else ["", *arguments])[1:]
        if strange:
            sys.stderr.write(
                f"'{strange[0]}' is no argument of a node: its parameters and remappings follow --ros-args\n"
            )
            return EXIT_BAD_INPUT
        nodes: list[Node] = []
        executor = EventsExecutor()
        try:
            for make_node in makers:
                nodes.append(make_node())
                executor.add_node(nodes[-1])
            drive = getattr(nodes[0], "drive", _spin)
            drive(executor, stop)
        except (ParameterError, InvalidParameterTypeException) as error:
            if len(nodes) == len(makers):  # not of one that was being made
                raise
            sys.stderr.write(f"{error}\n")
            return EXIT_BAD_INPUT
        finally:
            # A defect that ends the loop must not leave a pump running and solenoids energised.
            for node in reversed(nodes):
                if hasattr(node, "shut_down"):
                    node.shut_down()
        executor.shutdown()  # first, so that nothing that arrives calls into a node that is gone
        for node in nodes:
            node.destroy_node()
        return 0
    finally:
        rclpy.try_shutdown()


def _spin(executor: Executor, stop: StopFlag) -> None:
    while not stop:
        executor.spin_once(timeout_sec=_SPIN_TIMEOUT_S)
