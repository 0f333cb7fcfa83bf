"""How every node of this project starts, spins and ends."""

from __future__ import annotations

import os
import signal
import sys
from typing import TYPE_CHECKING

import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions

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


def spin(_node: Node, executor: Executor, stop: StopFlag) -> None:
    """Serve callbacks until asked to stop."""
    while not stop:
        executor.spin_once(timeout_sec=_SPIN_TIMEOUT_S)


def run(
    make_node: Callable[[], Node],
    arguments: Sequence[str] | None = None,
    *,
    loop: Callable[..., None] = spin,
    shut_down: Callable[..., None] | None = None,
) -> int:
    """Run one node until SIGINT or SIGTERM.

    rclpy's own signal handlers end the context before a last message can be sent, so the node keeps its own:
    the loop ends, `shut_down` publishes the last, safe command while the context is still valid.

    Args:
        make_node: Makes the node after rclpy.init; may raise ParameterError.
        arguments: Command line (with `--ros-args`); None takes the process's own.
        loop: What to do until the flag is set: `loop(node, executor, stop)`.
        shut_down: Called with the node before it is destroyed, also when the loop ended by an exception.

    Returns:
        The exit code: 0 after a signal, 2 after bad input, which was explained in one line on stderr.

    """

    def end(nodes: Sequence[Node]) -> None:
        if shut_down is not None:
            shut_down(nodes[0])

    def drive(nodes: Sequence[Node], executor: Executor, stop: StopFlag) -> None:
        loop(nodes[0], executor, stop)

    return run_together((make_node,), arguments, loop=drive, shut_down=end)


def run_together(
    makers: Sequence[Callable[[], Node]],
    arguments: Sequence[str] | None,
    *,
    loop: Callable[[Sequence[Node], Executor, StopFlag], None],
    shut_down: Callable[[Sequence[Node]], None],
) -> int:
    """Run several nodes on one executor of one process, as `run` runs one.

    Args:
        makers: Make the nodes, in order.
        arguments: As for `run`; parameters of one of them stand in its section of a file.
        loop: What to do until the flag is set, with all of them.
        shut_down: As for `run`, with all that were made.

    Returns:
        The exit code, as `run`.

    """
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
        nodes: list[Node] = []
        executor = EventsExecutor()
        try:
            for make_node in makers:
                nodes.append(make_node())
                executor.add_node(nodes[-1])
            loop(nodes, executor, stop)
        except ParameterError as error:
            if len(nodes) == len(makers):  # not of one that was being made
                raise
            sys.stderr.write(f"{error}\n")
            return EXIT_BAD_INPUT
        finally:
            # A defect that ends the loop must not leave a pump running and solenoids energised.
            if nodes:
                shut_down(nodes)
        executor.shutdown()  # first, so that nothing that arrives calls into a node that is gone
        for node in nodes:
            node.destroy_node()
        return 0
    finally:
        rclpy.try_shutdown()
