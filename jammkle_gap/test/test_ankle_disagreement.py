"""What counts as noise where no reference tells what a machine does: machines in good order are not all alike."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_gap.ankle.disagreement import kind_of, with_disagreement
from jammkle_gap.ankle.effects import ankle_library
from jammkle_gap.ankle.parts import prepared_for_parts
from jammkle_gap.ankle.runs import recording_of_run
from jammkle_sim.rigs.catalogue import RIGS, run_rig

if TYPE_CHECKING:
    from jammkle_gap.november.recording import Recording


@lru_cache(maxsize=2)
def pulled(rig: str) -> Recording:
    return recording_of_run(run_rig(rig, RIGS[rig].options(), lambda _: None, lambda: False))


@pytest.mark.parametrize(
    ("signal", "kind"),
    [
        ("achilles/pressure", "line/pressure"),
        ("peroneal_left/pressure", "line/pressure"),
        ("manifold/pressure", "manifold/pressure"),
        ("peroneal_left/extension", "peroneal/extension"),
        ("achilles_right/tension", "achilles/tension"),
        ("ankle_pitch/position", "ankle_pitch/position"),
        ("imu/specific_force_z", "imu/specific_force_z"),
    ],
)
def test_left_and_right_are_one_kind_and_so_are_lines(signal: str, kind: str) -> None:
    """Machines differ as much on one side as on the other."""
    assert kind_of(signal) == kind


def test_no_signal_has_less_noise_than_before_and_all_runs_together_count_once() -> None:
    """What a machine is off does not change from run to run."""
    before = pulled("tensile")
    for after in with_disagreement([before, before, before]):
        for one, other in zip(before.signals, after.signals, strict=True):
            assert other.noise >= one.noise
            if other.noise > one.noise:
                assert other.noise_time_s == pytest.approx(3.0 * float(np.ptp(one.time_s)))
        assert after.signal("manifold/pressure").noise > 10.0 * before.signal("manifold/pressure").noise


def test_it_counts_where_there_are_no_references_alone() -> None:
    """References tell what this very machine does."""
    recording = pulled("tensile")
    (alone,), _ = prepared_for_parts([recording], [], ankle_library())
    (beside,), _ = prepared_for_parts([recording], [recording], ankle_library())
    assert alone.signal("manifold/pressure").noise > beside.signal("manifold/pressure").noise
    assert beside.signal("manifold/pressure").noise == recording.signal("manifold/pressure").noise
