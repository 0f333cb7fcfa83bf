"""A machine with a fault, made to do the same, stays comparable to its references, described or not."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import TYPE_CHECKING

import pytest

from jammkle_common import names
from jammkle_gap.ankle.bag import Bag, Samples
from jammkle_gap.ankle.recording import recordings_of
from jammkle_gap.ankle.repeats import difference
from studies.blind.reality.faults import FAULTS, FaultSetting
from studies.blind.reality.run import run
from studies.blind.reality.sensors import Plan
from studies.blind.reality.specimen import machine

if TYPE_CHECKING:
    from jammkle_gap.core.data import Recording
    from studies.blind.reality.sensors import Track

PLANS = {
    "tensile": {"vacuum_pa": 50e3, "speed_m_s": 0.04},
    "pressure": {"cycles": 1},
    "drop": {"foot": "jammed"},
    "landing": {"jam": "after"},
    "slip": {"foot": "jammed", "speed_m_s": 0.05, "descent_m": 0.02},
}
WORST = (
    ("pressure", "pressure_reads_off_manifold", "minimum"),
    ("pressure", "pressure_slope_achilles", "maximum"),
    ("pressure", "lost_samples", "maximum"),
    ("tensile", "late_joints", "maximum"),
    ("slip", "late_sensors", "maximum"),
    ("drop", "rail_rubs", "maximum"),
    ("drop", "bent_toe", "minimum"),
    ("drop", "clamped_short_achilles_pair", "maximum"),
    ("drop", "hasty_regulator", "minimum"),
    ("landing", "crooked_floor", "maximum"),
    ("landing", "torn_end_peroneal_left", "maximum"),
)
"""Faults that look most like another setting: of 249 faults on their rigs at either end of their range these were the
ones that did so on the way here."""
COLUMNS = ((r"fluid_(pressure)_pa", r"\1"), (r"linear_acceleration_([xyz])_m_s2", r"specific_force_\1"),
           (r"(angular_velocity_[xyz])_rad_s", r"\1"), (r"(force_[xyz])_n", r"\1"),
           (r"(\w+)\.(position|velocity)", r"\1/\2"), (r"(data)", r"\1"))  # fmt: skip


def samples(track: Track) -> Samples:
    """Return a track of the real machine as a bag has it, by a wall clock."""
    columns = {}
    for place, name in enumerate(track.columns):
        for pattern, template in COLUMNS:
            if re.fullmatch(pattern, name):
                columns[re.sub(pattern, template, name)] = track.values[:, place]
    return Samples(track.log_s + 1.7e9, track.stamp_s + 1.7e9, columns)


@lru_cache(maxsize=8)
def recorded(rig: str, seed: int, fault: str = "", end: str = "") -> Recording:
    """Run the real machine, and read what another recorder would have of it."""
    sizes = {name: getattr(each, end) for name, each in FAULTS[fault].parameters.items()} if fault else {}
    wrong = (FaultSetting(fault, sizes),) if fault else ()
    found = run(Plan(rig, PLANS[rig]), machine(3), wrong, seed)
    topics = {name: samples(track) for name, track in found.topics.items() if name != names.TENDON_STATES.name}
    (recording,) = recordings_of(Bag(f"{rig} {fault}", topics), rig)
    return recording


@pytest.mark.slow
@pytest.mark.parametrize("rig", PLANS)
def test_runs_of_one_setting_on_other_days_are_repeats(rig: str) -> None:
    """Jitter of stamps and starts, noise of scales, weather."""
    assert difference(recorded(rig, 1), recorded(rig, 2)) == ""


@pytest.mark.parametrize(("rig", "fault", "end"), WORST)
def test_a_fault_makes_no_other_setting(rig: str, fault: str, end: str) -> None:
    """Even where sensors lie about pressures and times, or a foot touches down elsewhere."""
    assert difference(recorded(rig, 1), recorded(rig, 2, fault, end)) == ""
