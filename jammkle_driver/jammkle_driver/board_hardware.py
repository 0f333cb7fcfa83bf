"""A board on a Modbus line as hardware: the link's readings as samples and topics, on the node's own thread."""

from __future__ import annotations

import math
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING

from jammkle_common.command.errors import InputError
from jammkle_common.parameters import ParameterError
from jammkle_driver.board.line import check_port
from jammkle_driver.board.link import BoardLink
from jammkle_driver.board.wiring import load_wiring
from jammkle_driver.core.hypotheses import Spread
from jammkle_driver.hardware import Measured

if TYPE_CHECKING:
    from jammkle_driver.board.protocol import Exchange
    from jammkle_driver.board.wiring import Wiring
    from jammkle_driver.core.hardware import ActuatorCommand, LinkStatus
    from jammkle_driver.hardware import HardwareContext
    from jammkle_driver.parameters import DriverParameters

SURE_WITHIN_S = math.sqrt(12.0) * Spread().timing_s
"""By how much a cycle may be longer than the shortest one, s, for its readings to be evidence of a fault: anywhere in
so much time is a standard deviation of what the diagnosis bears. A host that stood still in between made it longer."""


class BoardHardware(BoardLink):
    """A board behind a serial line or a TCP connection. Implements `core.hardware.Hardware`.

    It publishes what a simulation would: pressures, absolute, and what the board has taken.
    """

    def __init__(self, context: HardwareContext) -> None:
        """Start to look for the board.

        Raises:
            ParameterError: `port` or `board_file` cannot be used.

        """
        parameters = context.parameters
        self._wiring = self.check(parameters)
        self._gauges = {place for place, sensor in self._wiring.sensors.items() if sensor.vacuum}
        self._context = context
        self._measured = Measured(context, self._wiring.sensors)
        self._shortest_s = math.inf
        self._closed = False
        self._error: Exception | None = None
        self._came: deque[Exchange] = deque(maxlen=10)
        super().__init__(parameters.port, self._wiring, parameters.safe_state, self._hand_over)

    @staticmethod
    def check(parameters: DriverParameters) -> Wiring:
        """Return how the board is wired.

        Raises:
            ParameterError: `port` or `board_file` cannot be used.

        """
        try:
            check_port(parameters.port)
            return load_wiring(Path(parameters.board_file) if parameters.board_file else None)
        except InputError as error:
            msg = f"parameter 'board_file': {error}"
            raise ParameterError(msg) from error
        except ValueError as error:
            msg = f"parameter 'port': {error}"
            raise ParameterError(msg) from error

    @property
    def link(self) -> LinkStatus:
        """What is known of the board now."""
        return self.status

    def close(self) -> None:
        """Send the last command and let go of the port."""
        super().close()
        self._closed = True
        self._came.clear()
        self._measured.close()

    def _hand_over(self, exchange: Exchange) -> None:
        """Take an exchange on the link's thread, and have the node fetch it on its own."""
        self._came.append(exchange)
        executor = self._context.node.executor
        if executor is not None:
            executor.create_task(self._deliver)

    def apply(self, command: ActuatorCommand) -> None:
        """Send a command with the next exchange."""
        error, self._error = self._error, None
        if error is not None:
            raise error
        super().apply(command)

    def _deliver(self) -> None:
        try:
            self._hand_on()
        except Exception as error:  # noqa: BLE001 - of a task it would end the process without letting go
            self._error = error

    def _hand_on(self) -> None:
        while self._came and not self._closed:
            exchange = self._came.popleft()
            self._shortest_s = min(self._shortest_s, exchange.took_s)
            timely = exchange.took_s - self._shortest_s <= SURE_WITHIN_S
            ambient_pa = self._context.ambient_pa()
            pressures_pa = {
                place: self._wiring.sensors[place].absolute_pa(measured_pa, ambient_pa)
                for place, measured_pa in exchange.sensors_pa.items()
            }
            self._measured.publish(pressures_pa, exchange.taken, self._gauges, at_s=exchange.at_s, timely=timely)
