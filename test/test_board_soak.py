"""Some of `make soak` on the firmware."""

from __future__ import annotations

import pytest
from board_soak import soak

from boards import AVR


@pytest.mark.slow
@pytest.mark.skipif(AVR, reason="a simulator that is slower than real time keeps no bound")
def test_random_mishaps_on_the_firmware_leave_everything_safe(command: list[str]) -> None:
    """All outputs off at the pins after each, and every channel jams again after the repair."""
    result = soak(command, 10.0, 3)
    assert result.faults + result.events > 0
    assert result.missed == ()
