"""Twelve drops of the paper's rig: the first impact is reported as the fall ends."""

from __future__ import annotations

import math

import pytest

from jammkle_common.constants import NANOSECONDS_PER_SECOND, STANDARD_GRAVITY_M_S2
from jammkle_common.names import IMU
from jammkle_controller.core.events import ContactKind
from jammkle_controller.core.imu import ImuSample
from jammkle_controller.core.reading import Received
from jammkle_controller.parameters import ControllerParameters
from jammkle_controller.recordings import replay
from jammkle_sim.rigs.catalogue import run_rig, scattered
from jammkle_sim.rigs.drop import DropOptions

RELEASE_S = 1.0


@pytest.mark.parametrize("foot", ["unjammed", "jammed", "squash_ball"])
@pytest.mark.parametrize("repeat", range(4))
def test_the_impact_of_a_drop_is_reported_within_two_milliseconds_of_the_fall(foot: str, repeat: int) -> None:
    """The end of the fall is that of a free one from the height, which is good to a millisecond."""
    options = scattered("drop", DropOptions(foot=foot), repeat)
    imu = run_rig("drop", options, lambda _: None, lambda: False).topics[IMU.name]
    rows = zip(imu.time_s.tolist(), imu.values.tolist(), strict=True)
    samples = [ImuSample(round(at_s * NANOSECONDS_PER_SECOND), *row) for at_s, row in rows]
    events = replay([Received(sample.time_ns, sample) for sample in samples], ControllerParameters()).events
    assert [event.kind for event in events[:2]] == [ContactKind.LIFTOFF, ContactKind.IMPACT]
    fallen_s = math.sqrt(2.0 * options.drop_height_m / STANDARD_GRAVITY_M_S2)
    assert -0.001 < events[1].time_ns / NANOSECONDS_PER_SECOND - RELEASE_S - fallen_s < 0.0025
