"""Contact detection when the stream itself is bad: lost, late, repeated and unreadable samples, restarted clocks."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from jammkle_controller.core.events import ContactKind
from jammkle_controller.core.imu import ImuSample

LANDING = [ContactKind.LIFTOFF, ContactKind.IMPACT, ContactKind.SETTLED]
SOFT = (40.0, 0.5)
HARD = (150.0, 0.9)

few = settings(max_examples=30, deadline=None)
seeds = st.integers(0, 2**32 - 1)


def test_kick_after_the_clock_was_set_back_is_reported(streams: Any) -> None:
    """An impact on the old time line does not silence the new one."""
    samples = streams.sense(streams.kick(0.5, 40.0, 0.01))
    late = [sample._replace(time_ns=sample.time_ns + 60_000_000_000) for sample in samples]
    controller = streams.new_controller()
    assert [event.kind for event in streams.events_of(late, controller)] == [ContactKind.IMPACT, ContactKind.SETTLED]
    assert [event.kind for event in streams.events_of(samples, controller)] == [ContactKind.IMPACT, ContactKind.SETTLED]


@few
@given(data=st.data())
def test_bad_samples_change_nothing_but_the_counts(streams: Any, data: st.DataObject) -> None:
    """NaN, infinite, repeated and late samples strewn into a landing are counted and decide nothing."""
    samples = streams.sense(streams.drop(*HARD)[0], 500)
    places = data.draw(st.lists(st.integers(10, len(samples) - 1), max_size=20, unique=True))
    spoilt = list(samples)
    for place in sorted(places, reverse=True):
        good = samples[place]
        bad = data.draw(
            st.sampled_from(
                [
                    good._replace(time_ns=good.time_ns + 1, force_x=math.nan),
                    good._replace(time_ns=good.time_ns + 1, rate_z=math.inf),
                    good._replace(force_z=400.0),
                    good._replace(time_ns=good.time_ns - 5_000_000, force_z=400.0),
                ]
            )
        )
        spoilt.insert(place + 1, bad)
    controller = streams.new_controller()
    assert streams.events_of(spoilt, controller) == streams.events_of(samples)
    assert controller.gate.counts.ignored == len(places)
    assert controller.gate.counts.usable == len(samples)


@few
@given(seed=seeds, loss=st.floats(0.0, 0.3), jitter_s=st.floats(0.0, 0.0009))
def test_dropped_and_jittered_samples_report_the_same_recording(
    streams: Any, seed: int, loss: float, jitter_s: float
) -> None:
    """With up to 30 % of the samples lost and stamps off by up to 0.9 ms, a landing is still the same three events."""
    chance = np.random.default_rng(seed)
    force, contact_s = streams.drop(*SOFT)
    samples = [
        sample._replace(time_ns=sample.time_ns + 1_000_000 + round(chance.uniform(-jitter_s, jitter_s) * 1e9))
        for sample in streams.sense(force, 500)
        if chance.uniform() >= loss
    ]
    events = streams.events_of(samples)
    assert [event.kind for event in events] == LANDING
    assert -0.001 <= events[1].time_ns * 1e-9 - contact_s < 0.02


def test_restarted_clock_starts_a_new_recording(streams: Any) -> None:
    """When the stamps jump back to zero in mid-air, the landing that follows is reported like the first one."""
    samples = streams.sense(streams.drop(*SOFT)[0], 500)
    controller = streams.new_controller()
    in_the_air = next(i for i, sample in enumerate(samples) if sample.time_ns >= 380_000_000)
    assert [event.kind for event in streams.events_of(samples[:in_the_air], controller)] == [ContactKind.LIFTOFF]
    assert streams.events_of(samples, controller) == streams.events_of(samples)
    assert controller.gate.counts.restarts == 1


def test_landing_lost_in_a_gap_is_still_reported(streams: Any) -> None:
    """If the stream breaks off in mid-air and comes back on the ground, its first sample is the impact."""
    samples = streams.sense(streams.drop(*SOFT)[0], 500)
    broken = [sample for sample in samples if not 0.39 < sample.time_ns * 1e-9 < 0.7]
    impact = streams.events_of(broken)[1]
    assert impact.kind is ContactKind.IMPACT
    assert impact.time_ns == next(sample.time_ns for sample in broken if sample.time_ns > 600_000_000)


def test_gap_at_rest_is_no_event(streams: Any) -> None:
    """Half a second without samples while the body is tilted by 40 deg is neither slip nor impact."""
    before = streams.sense(streams.rest(0.5), 500)
    turn = np.array([[math.cos(0.7), 0.0, math.sin(0.7)], [0.0, 1.0, 0.0], [-math.sin(0.7), 0.0, math.cos(0.7)]])
    after = streams.sense(streams.rest(0.5), 500, turn=turn)
    assert (
        streams.events_of(before + [sample._replace(time_ns=sample.time_ns + 1_000_000_000) for sample in after]) == []
    )


@few
@given(force=st.lists(st.floats(-90.0, 90.0), min_size=1, max_size=300), step_ns=st.integers(200_000, 20_000_000))
def test_every_flight_ends_with_an_impact(streams: Any, force: list[float], step_ns: int) -> None:
    """On any stream at all, two lift-offs have an impact between them, and ground impacts keep the refractory time."""
    events = streams.events_of(
        [ImuSample(i * step_ns, 0.0, 0.0, value, 0.0, 0.0, 0.0) for i, value in enumerate(force)]
    )
    flying = False
    last_ns = -(10**12)
    for event in events:
        if event.kind is ContactKind.LIFTOFF:
            assert not flying
            flying = True
        elif event.kind is ContactKind.IMPACT:
            assert flying or event.time_ns - last_ns >= 150_000_000
            flying = False
            last_ns = event.time_ns
