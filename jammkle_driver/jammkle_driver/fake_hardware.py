"""A fake ankle in process as hardware: a board and a small plant that fail by script; publishes what a board would."""

from __future__ import annotations

import random
from pathlib import Path
from typing import TYPE_CHECKING

from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from jammkle_common.constants import STANDARD_ATMOSPHERE_PA
from jammkle_common.names import CHANNELS
from jammkle_common.parameters import ParameterError
from jammkle_driver.conversions import seconds
from jammkle_driver.core.hardware import LinkState
from jammkle_driver.fake.board import STEP_S, WATCHDOG_S, FakeBoard
from jammkle_driver.fake.faults import LinkFault
from jammkle_driver.fake.plant import FakePlant
from jammkle_driver.fake.script import ScriptError, read_script
from jammkle_driver.measured import Measured

if TYPE_CHECKING:
    from jammkle_driver.core.hardware import ActuatorCommand, LinkStatus
    from jammkle_driver.hardware_choice import HardwareContext

_LONGEST_LAG_S = 2.0 * WATCHDOG_S
"""Most time that is made up for at once, s: a process that stood still stops the plant, too, but its board lets go."""


class FakeHardware:
    """An ankle of plain numbers behind a board. Implements `core.hardware.Hardware`.

    Attributes:
        board: The board, for tests that let it or the plant behind it fail.

    """

    def __init__(self, context: HardwareContext) -> None:
        """Start the plant, vented.

        Raises:
            ParameterError: the script of faults cannot be read.

        """
        self._context = context
        given = context.parameters.fake_faults
        try:
            text = Path(given).read_text(encoding="utf-8") if given and Path(given).is_file() else given
            self._script = list(read_script(text))
        except (OSError, ScriptError) as error:
            msg = f"parameter 'fake_faults': {error}"
            raise ParameterError(msg) from error
        plant = FakePlant(CHANNELS, context.parameters.air(), STANDARD_ATMOSPHERE_PA)
        self.board = FakeBoard(plant)
        self._draw = random.Random(0)  # noqa: S311 - which telegrams noise hits is no secret
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._last_s = seconds(self._steady.now())
        self._measured = Measured(context, plant.places)
        self._timer = context.node.create_timer(STEP_S, self._exchange, clock=self._steady)

    @property
    def link(self) -> LinkStatus:
        """What is known of the board; it lets go as a board does when the driver stood still."""
        return self.board.link

    def apply(self, command: ActuatorCommand) -> None:
        """Hand the board a command, unless its cable is pulled."""
        self._catch_up()
        if self.board.link.state is LinkState.CONNECTED:
            self.board.hear(command)

    def acknowledge(self) -> None:
        """Take jams again."""
        self.board.acknowledge()

    def close(self) -> None:
        """Stop the plant."""
        self._context.node.destroy_timer(self._timer)
        self._measured.close()

    def _catch_up(self) -> None:
        """Take board and plant on to now; what is not a whole step is left for the next time."""
        now_s = seconds(self._steady.now())
        self._last_s = max(self._last_s, now_s - _LONGEST_LAG_S)
        passed_s = int((now_s - self._last_s) / STEP_S) * STEP_S
        self.board.advance(passed_s)
        self._last_s += passed_s

    def _exchange(self) -> None:
        """Let happen what the script says, and read all sensors, unless the line is in the way."""
        self._catch_up()
        while self._script and self._script[0].time_s <= self.board.plant.time_s:
            entry = self._script.pop(0)
            if entry.fault is None:
                self.board.heal()
            elif isinstance(entry.fault, LinkFault):
                self.board.inject(entry.fault, entry.size)
            else:
                self.board.plant.inject(entry.fault, entry.place, entry.size)
        if self.board.link.state is not LinkState.CONNECTED:
            return
        spoiled = self._draw.random() < self.board.noise_share
        self.board.count(int(not spoiled), int(spoiled))
        if not spoiled:
            self._measured.publish(self.board.plant.readings_pa(), self.board.driven)
