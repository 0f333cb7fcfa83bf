"""Which hardware stands behind the driver: found by name among what the installed packages bring along.

A package brings hardware of its own with an entry point of the group `jammkle.hardware`:

    entry_points={"jammkle.hardware": ["our_lab = our_package.our_module:make"]}

`make` takes a `HardwareContext` and returns a `jammkle_driver.core.hardware.Hardware`. If it has an attribute `check`,
that is called with the driver's parameters at start, and raises `ParameterError` where they cannot be used.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_common.command import HARDWARE, entries
from jammkle_common.parameters import ParameterError

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node

    from jammkle_driver.core.hardware import ActuatorCommand, Hardware, PressureSample
    from jammkle_driver.parameters import DriverParameters


@dataclass(frozen=True)
class HardwareContext:
    """What an implementation of `Hardware` is made from.

    Attributes:
        node: The driver's node, for topics and the graph's clock.
        take: Takes one pressure sample; to be called from the node's own thread.
        driven: Takes what the hardware says that it drives, and since when, s, or that it still does then, on the clock
            of the samples; from the node's own thread, with every change and at least 20 times a second. Readings
            count as evidence of a fault for as long as that is known. Hardware that never calls it is taken to do
            what `Hardware.apply` is given the moment that it is.
        parameters: The driver's parameters as they were when it was configured; `port`, `board_file` and `safe_state`
            are for the hardware alone.
        ambient_pa: Returns what is declared of the atmosphere now, Pa; sensors of vacuum count from it, and it may
            change while the node runs.

    """

    node: Node
    take: Callable[[PressureSample], None]
    driven: Callable[[ActuatorCommand, float], None]
    parameters: DriverParameters
    ambient_pa: Callable[[], float]


def check_hardware(name: str) -> None:
    """Refuse a name that no installed package knows.

    Raises:
        ParameterError: the name is unknown.

    """
    known = entries(HARDWARE)
    if name not in known:
        msg = f"parameter 'hardware' is '{name}'; it must be one of {', '.join(known)} (entry points of {HARDWARE})"
        raise ParameterError(msg)


def check_parameters(parameters: DriverParameters) -> None:
    """Refuse parameters that the hardware cannot use, before anything is started.

    Raises:
        ParameterError: the hardware is unknown, or does not take them.

    """
    check_hardware(parameters.hardware)
    check = getattr(entries(HARDWARE)[parameters.hardware].load(), "check", None)
    if check is not None:
        check(parameters)


def make_hardware(context: HardwareContext) -> Hardware:
    """Make the hardware that the parameter `hardware` names.

    Raises:
        ParameterError: the name is unknown, or what it names cannot be made from these parameters.

    """
    name = context.parameters.hardware
    check_hardware(name)
    made: Hardware = entries(HARDWARE)[name].load()(context)
    return made
