"""The pressure rig: how fast the ankle jams and vents, and what leaks, valves and pump do to it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from jammkle_common.parameters import from_mapping
from jammkle_sim.rigs.catalogue import run_rig
from jammkle_sim.rigs.pressure import PressureOptions

if TYPE_CHECKING:
    from jammkle_sim.rigs.run import RigRun


def cycle(**values: object) -> RigRun:
    """Jam and vent as the options say."""
    return run_rig("pressure", from_mapping(PressureOptions, values), lambda _: None, lambda: False)


def test_all_four_tendons_jam_and_vent_in_time() -> None:
    """-50 kPa on all channels in under 0.5 s, venting in under 0.2 s, in every cycle, without going 2 kPa too deep."""
    results = cycle().results
    assert results["share_reached"] == 1.0
    assert 0.2 < results["jam_time_s"] < 0.5
    assert 0.01 < results["vent_time_s"] < 0.2
    assert results["deepest_vacuum_pa"] < 52e3


def test_one_tendon_jams_faster_than_four() -> None:
    """A channel of one tendon needs less time than the pair, the pair less than all."""
    one, pair, four = (
        cycle(channel=channel, cycles=1).results["jam_time_s"] for channel in ("peroneal_left", "achilles", "all")
    )
    assert one < pair < four


def test_other_channels_stay_vented() -> None:
    """Evacuating one channel leaves the others within the offset of their sensors."""
    run = cycle(channel="achilles", cycles=1)
    for channel in ("peroneal_left", "peroneal_right"):
        assert run.topics[f"{channel}/pressure"].values.min() > 100e3


@pytest.mark.parametrize(
    ("name", "value"),
    [("pump_free_flow_l_min", 3.0), ("valve_dead_time_s", 0.06), ("pump_ultimate_vacuum_pa", 60e3)],
)
def test_a_worse_part_takes_longer(name: str, value: float) -> None:
    """Half the pump, slow valves or a weaker pump: later, and still there."""
    assert cycle(cycles=1, **{name: value}).results["jam_time_s"] > cycle(cycles=1).results["jam_time_s"] + 0.015


def test_a_leak_too_large_for_the_pump_is_seen() -> None:
    """With a torn membrane the vacuum is not reached: the results say so and give no time, not of venting either."""
    results = cycle(cycles=1, leak_dm3_s_bar=0.05).results
    assert results["share_reached"] == 0.0
    assert not {"jam_time_s", "vent_time_s"} & set(results)
    assert results["deepest_vacuum_pa"] < 45e3
