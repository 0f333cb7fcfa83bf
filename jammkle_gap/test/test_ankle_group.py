"""Which recordings share signatures."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import pytest

from jammkle_common import names
from jammkle_gap.ankle.recording import recording_of_run
from jammkle_gap.ankle.repeats import group_of, setting_text
from jammkle_sim.rigs.catalogue import RIGS, run_rig, scattered

if TYPE_CHECKING:
    from jammkle_gap.core.data import Recording

SHORT = {
    "tensile": {"vacuum_pa": 50e3, "speed_m_s": 0.05, "extension_m": 0.01},
    "pressure": {"cycles": 1, "jam_time_s": 0.6, "vent_time_s": 0.4},
    "drop": {"foot": "jammed"},
    "slip": {"foot": "unjammed", "speed_m_s": 0.05, "descent_m": 0.02},
    "landing": {},
}


def recorded(rig: str, repeat: int | None = None, **changed: object) -> Recording:
    """Run a rig, scattered if a repeat is given."""
    options = RIGS[rig].options(**{**SHORT[rig], **changed})
    chosen = options if repeat is None else scattered(rig, options, repeat)
    return recording_of_run(run_rig(rig, chosen, lambda _: None, lambda: False), f"{rig} {repeat}")


@pytest.mark.parametrize("rig", SHORT)
def test_scattered_runs_share_their_signatures(rig: str) -> None:
    """What a rig cannot set the same twice makes no group of its own."""
    assert len({group_of(recorded(rig, repeat)) for repeat in range(4)}) == 1


@pytest.mark.parametrize(
    ("rig", "changed"),
    [
        ("tensile", {"vacuum_pa": 30e3}),
        ("tensile", {"speed_m_s": 0.03}),
        ("tensile", {"channel": names.ACHILLES}),
        ("pressure", {"jam_time_s": 0.9}),
        ("pressure", {"cycles": 2}),
        ("pressure", {"channel": names.ACHILLES}),
        ("drop", {"drop_height_m": 0.07}),
        ("landing", {"slope_deg": 30.0}),
        ("landing", {"jam": "before"}),
    ],
)
def test_what_was_done_otherwise_has_signatures_of_its_own(rig: str, changed: dict[str, object]) -> None:
    """Whether the setting's short text tells of it or not."""
    assert group_of(recorded(rig)) != group_of(recorded(rig, **changed))


def test_the_short_text_of_a_setting_is_no_group() -> None:
    """Two programmes of the pressure rig read the same, and jam at other times."""
    one, other = recorded("pressure"), recorded("pressure", jam_time_s=0.9)
    assert setting_text(one) == setting_text(other)
    assert group_of(one) != group_of(other)


def test_what_two_recordings_measure_a_little_otherwise_is_one_group() -> None:
    """A vacuum that reads 0.8 kPa more, a carriage that reads half a per cent more."""
    one = recorded("tensile")
    course = one.inputs.course
    assert course is not None
    inputs = dataclasses.replace(one.inputs, course=dataclasses.replace(course, position_m=1.005 * course.position_m))
    signals = tuple(
        dataclasses.replace(each, values=each.values - 800.0) if each.name.endswith("/pressure") else each
        for each in one.signals
    )
    assert group_of(dataclasses.replace(one, inputs=inputs, signals=signals)) == group_of(one)
