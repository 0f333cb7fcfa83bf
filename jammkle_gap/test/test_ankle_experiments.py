"""Runs that a diagnosis may propose."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from jammkle_gap.ankle.problem import experiments
from jammkle_gap.report.words import times

if TYPE_CHECKING:
    from jammkle_gap.core.design import Experiment


@pytest.mark.parametrize("experiment", experiments(), ids=lambda each: each.name)
def test_every_plan_can_be_run(experiment: Experiment) -> None:
    """Each run on offer has a rig and options that exist, gives signals with a noise, and is named as its command."""
    recording = experiment.plan()
    assert experiment.name.startswith(f"rig {recording.inputs.rig}")
    assert recording.signals
    assert all(signal.deviation > 0.0 for signal in recording.signals)


def test_small_gaps_have_no_digits_to_read() -> None:
    """What lies far below the noise is nothing; large gaps are whole numbers."""
    assert [times(gap) for gap in (1e-9, 1.234, 12.34, 123.4)] == ["0.00", "1.23", "12.3", "123"]
