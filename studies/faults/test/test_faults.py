"""Some of the trial of faults, and of the soaks: they find nothing in what is well, and what is not."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from boards import AVR
from fault_bench import ELSEWHERE, PLACED
from studies.faults import board_soak
from studies.faults.soak import soak
from studies.faults.trial import inject

if TYPE_CHECKING:
    from jammkle_driver.core.faults import Reason


@pytest.mark.parametrize(("seed", "reason"), list(enumerate((*PLACED, *ELSEWHERE))), ids=str)
def test_a_fault_is_reported_with_its_reason_and_place(seed: int, reason: Reason) -> None:
    """Each kind of fault, put into a random ankle at a random place, is named; the README has 500 of them."""
    outcome = inject(seed, reason)
    assert (outcome.reported, outcome.reported_place) == (reason, outcome.place)
    assert outcome.delay_s >= 0.0


def test_random_faults_leave_everything_safe() -> None:
    """No missed safe state at the board's outputs, no channel that does not come back."""
    result = soak(40.0, 3)
    assert result.faults > 0
    assert result.missed == ()


def test_the_soak_sees_a_board_that_does_not_let_go(monkeypatch: pytest.MonkeyPatch) -> None:
    """A board without its watchdog keeps jamming while the driver stands still: that is what a soak is to find."""
    monkeypatch.setattr("jammkle_driver.fake.WATCHDOG_S", math.inf)
    monkeypatch.setattr("studies.faults.soak._OF_THE_PLANT", 0.0)
    assert any("stall" in line for line in soak(15.0, 3).missed)


@pytest.mark.slow
@pytest.mark.skipif(AVR, reason="a simulator that is slower than real time keeps no bound")
def test_random_mishaps_on_the_firmware_leave_everything_safe(command: list[str]) -> None:
    """All outputs off at the pins after each, and every channel jams again after the repair."""
    result = board_soak.soak(command, 10.0, 3)
    assert result.faults + result.events > 0
    assert result.missed == ()
