"""The soak finds nothing in a driver and a board as they are, and does find a board that does not let go."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from jammkle_driver.fake.soak import soak

if TYPE_CHECKING:
    import pytest


def test_random_faults_leave_everything_safe() -> None:
    """Some of `make soak`: no missed safe state at the board's outputs, no channel that does not come back."""
    result = soak(40.0, 3)
    assert result.faults > 0
    assert result.missed == ()


def test_the_soak_sees_a_board_that_does_not_let_go(monkeypatch: pytest.MonkeyPatch) -> None:
    """A board without its watchdog keeps jamming while the driver stands still: that is what a soak is to find."""
    monkeypatch.setattr("jammkle_driver.fake.board.WATCHDOG_S", math.inf)
    monkeypatch.setattr("jammkle_driver.fake.soak._OF_THE_PLANT", 0.0)
    assert any("stall" in line for line in soak(15.0, 3).missed)
